#include "ui/studio_state.h"

namespace ars::ui {

std::vector<std::unique_ptr<Panel>> makePanels() {
    std::vector<std::unique_ptr<Panel>> panels;
    for (const auto& make : {makeViewportPanel, makePosePanel, makeLightPanel, makeOcclusionPanel, makeCameraPanel,
                             makeBuffersPanel, makeComparePanel, makeTimelinePanel, makeOutputPanel, makeTrainingPanel,
                             makeHistoryPanel, makePerformancePanel, makeJobsPanel}) {
        panels.push_back(make());
    }
    return panels;
}

} // namespace ars::ui
