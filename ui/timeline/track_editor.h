#pragma once

#include "ui/panel.h"
#include "ui/timeline/key_selection.h"
#include "ui/timeline/time_scale.h"
#include "ui/timeline/track_rows.h"

#include <imgui.h>

#include <cstdint>
#include <set>
#include <string>
#include <vector>

namespace ars::ui {

/// Ruler, clip and tracks with their keys. Fills what is left of the panel.
class TrackEditor {
public:
    void draw(StudioContext& context);
    /// Of all tracks, sorted; of the last draw.
    const std::vector<double>& keyTimes() const { return keyTimes_; }
    /// Reads the document's tracks again when it has changed.
    void refresh(StudioContext& context);

private:
    /// Where a row lies on the screen.
    struct Place {
        float top = 0.0f;
        float keys = 0.0f; ///< height of the part with the keys
        float height = 0.0f;
        float middle() const { return top + 0.5f * keys; }
    };
    struct Hit {
        int row = -1;
        int key = -1;
    };

    void layOut(StudioContext& context);
    // Ruler and clip (track_ruler.cpp)
    void drawRuler(StudioContext& context);
    void drawRulerTicks(StudioContext& context, const ImVec2& low, const ImVec2& high);
    void dragRange(StudioContext& context, const ImVec2& low, const ImVec2& high);
    void drawClip(StudioContext& context);
    void navigate(StudioContext& context);
    void drawPlayhead(StudioContext& context, float top, float bottom, bool flag);
    // Rows
    void drawTracks(StudioContext& context);
    std::vector<Place> placeRows(float top) const;
    void drawHead(StudioContext& context, std::size_t index, const Place& place);
    void drawRow(StudioContext& context, std::size_t index, const Place& place);
    void drawKey(StudioContext& context, const TrackRow& row, std::size_t index, const Place& place);
    void drawCurve(StudioContext& context, const TrackRow& row, const Place& place);
    void toggleKey(StudioContext& context, const TrackRow& row);
    // What the mouse does to keys (track_mouse.cpp)
    Hit hitTest(const std::vector<Place>& places, const ImVec2& point) const;
    void actOnCanvas(StudioContext& context, const std::vector<Place>& places);
    void pressed(StudioContext& context, const std::vector<Place>& places);
    void held(StudioContext& context);
    void selectInBox(StudioContext& context, const std::vector<Place>& places);
    void drawBox() const;
    void canvasMenu(StudioContext& context);
    void keyTip(StudioContext& context, const std::vector<Place>& places);
    std::vector<KeyRef> refs(StudioContext& context, const Hit& hit) const;

    std::vector<TrackRow> rows_;
    std::vector<double> keyTimes_;
    std::vector<std::string> jointNames_;
    std::uint64_t version_ = 0;
    bool stale_ = true;
    std::set<std::string> unfolded_;
    KeySelection selection_;

    TimeScale scale_;
    bool fitted_ = true; ///< nobody zoomed or panned: the range stays in view
    float headWidth_ = 0.0f;
    float rowHeight_ = 0.0f;
    float curveHeight_ = 0.0f;

    enum class Hold { None, Keys, Box };
    Hold hold_ = Hold::None;
    ImVec2 pressedAt_{0, 0};
    double grabbedS_ = 0.0; ///< time of the key under the mouse when it was pressed
    double draggedS_ = 0.0; ///< how far the keys have been moved
    double pressedTimeS_ = 0.0;
    int rangeEnd_ = 0; ///< -1, +1: this end of the range is dragged
    double clipPressedS_ = 0.0;
    std::string menuTrack_;
    double menuTimeS_ = 0.0;
    bool menuOnKey_ = false;
};

} // namespace ars::ui
