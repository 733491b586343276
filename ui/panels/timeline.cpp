#include "ui/panel.h"
#include "ui/timeline/track_editor.h"
#include "ui/timeline/transport_bar.h"

#include <imgui.h>

namespace ars::ui {
namespace {

/// Playing, keys and the clip.
class TimelinePanel : public Panel {
public:
    const char* id() const override { return "timeline"; }
    const char* title() const override { return "Timeline"; }
    const char* help() const override { return "Plays motions; keys of pose, camera, light and radii."; }
    void draw(StudioContext& context) override {
        tracks_.refresh(context);
        drawTransportBar(context, tracks_.keyTimes());
        tracks_.draw(context);
    }

private:
    TrackEditor tracks_;
};

} // namespace

std::unique_ptr<Panel> makeTimelinePanel() { return std::make_unique<TimelinePanel>(); }

} // namespace ars::ui
