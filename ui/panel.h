#pragma once

#include "engine/scene/session.h"
#include "ui/settings.h"

#include <memory>
#include <string_view>
#include <vector>

namespace ars::ui {

/// What every panel gets. Panels hold no truth: they read the session and run commands.
struct Studio;

struct StudioContext {
    Session& session;
    Settings& settings;
    Studio& studio;     ///< dialogs, file chooser, palette (ui/studio.h)
    float scale = 1.0f; ///< pixels per design pixel: text and icons grow with it

    const Document& document() const { return session.document(); }
};

/// A dockable window. draw() fills it; the shell opens and closes it.
class Panel {
public:
    virtual ~Panel() = default;
    virtual const char* id() const = 0;    ///< stable, for settings and tests: "pose"
    virtual const char* title() const = 0; ///< for people: "Pose"
    virtual const char* help() const = 0;  ///< one sentence for the menu's tooltip
    virtual bool openByDefault() const { return true; }
    virtual void draw(StudioContext& context) = 0;
    /// Widgets that fill the panel to its edge (viewport) want no padding.
    virtual bool padded() const { return true; }
};

// One factory for each file in ui/panels/.
std::unique_ptr<Panel> makeViewportPanel();  ///< viewport.cpp and its companions
std::unique_ptr<Panel> makePosePanel();      ///< pose.cpp: joint tree, numbers, mirror, library, shape, expression
std::unique_ptr<Panel> makeTimelinePanel();  ///< timeline.cpp
std::unique_ptr<Panel> makeLightPanel();     ///< light.cpp
std::unique_ptr<Panel> makeOcclusionPanel(); ///< occlusion.cpp
std::unique_ptr<Panel> makeCameraPanel();    ///< camera.cpp
std::unique_ptr<Panel> makeBuffersPanel();  ///< buffers.cpp: which buffer, ranges, colour maps, values under the cursor
std::unique_ptr<Panel> makeComparePanel();  ///< compare.cpp
std::unique_ptr<Panel> makeOutputPanel();   ///< output.cpp: screenshot, film, EXR
std::unique_ptr<Panel> makeTrainingPanel(); ///< training.cpp: start, watch, pause and resume a training
std::unique_ptr<Panel> makeHistoryPanel();  ///< history.cpp: undo list
std::unique_ptr<Panel> makePerformancePanel(); ///< performance.cpp: stages, rates, memory
std::unique_ptr<Panel> makeJobsPanel();        ///< jobs.cpp: work beside the window, notices, log

} // namespace ars::ui
