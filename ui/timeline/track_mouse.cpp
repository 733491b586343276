#include "ui/timeline/track_editor.h"

#include "ui/timeline/transport_bar.h"
#include "ui/widgets.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {
namespace {

constexpr float kKeyReach = 6.5f; ///< design pixels around a key's middle that count as the key
constexpr float kDragThreshold = 3.0f;

const char* interpolationLabel(KeyInterpolation kind) {
    switch (kind) {
    case KeyInterpolation::Step:
        return "Step";
    case KeyInterpolation::Linear:
        return "Linear";
    case KeyInterpolation::Smooth:
        return "Smooth";
    }
    return "";
}

} // namespace

TrackEditor::Hit TrackEditor::hitTest(const std::vector<Place>& places, const ImVec2& point) const {
    Hit hit;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
        if (point.y < places[i].top || point.y >= places[i].top + places[i].height) continue;
        hit.row = static_cast<int>(i);
        if (point.y >= places[i].top + places[i].keys) break;
        float nearest = kKeyReach * rowHeight_ / 18.0f;
        for (std::size_t k = 0; k < rows_[i].keys.size(); ++k) {
            const float distance = std::abs(scale_.x(rows_[i].keys[k].timeS) - point.x);
            if (distance > nearest) continue;
            nearest = distance;
            hit.key = static_cast<int>(k);
        }
        break;
    }
    return hit;
}

std::vector<KeyRef> TrackEditor::refs(StudioContext& context, const Hit& hit) const {
    if (hit.key < 0) return {};
    const TrackRow& row = rows_[static_cast<std::size_t>(hit.row)];
    return keysBehind(context.document().timeline, jointNames_, row, row.keys[static_cast<std::size_t>(hit.key)].timeS);
}

void TrackEditor::actOnCanvas(StudioContext& context, const std::vector<Place>& places) {
    if (ImGui::IsItemActivated() && ImGui::IsMouseClicked(ImGuiMouseButton_Left)) pressed(context, places);
    if (ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left)) held(context);
    if (!ImGui::IsItemActive() && hold_ != Hold::None) {
        if (hold_ == Hold::Box && ImGui::IsMouseReleased(ImGuiMouseButton_Left)) selectInBox(context, places);
        selection_.endDrag();
        hold_ = Hold::None;
    }
    if (ImGui::IsItemHovered() && ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left) &&
        hitTest(places, ImGui::GetIO().MousePos).key < 0) {
        const double fps = context.document().timeline.framesPerSecond;
        seekFromWidget(context, std::max(0.0, snapToFrame(scale_.time(ImGui::GetIO().MousePos.x), fps)));
    }
    if (ImGui::IsItemHovered() && ImGui::IsMouseReleased(ImGuiMouseButton_Right)) {
        const Hit hit = hitTest(places, ImGui::GetIO().MousePos);
        const std::vector<KeyRef> keys = refs(context, hit);
        if (!keys.empty() && !selection_.containsAll(keys)) selection_.set(keys);
        menuTrack_ = hit.row >= 0 ? rows_[static_cast<std::size_t>(hit.row)].track : "";
        menuTimeS_ = keys.empty() ? snapToFrame(scale_.time(ImGui::GetIO().MousePos.x),
                                                context.document().timeline.framesPerSecond)
                                  : keys.front().timeS;
        menuOnKey_ = !keys.empty();
        if (!menuTrack_.empty()) ImGui::OpenPopup("key menu");
    }
    keyTip(context, places);
}

void TrackEditor::pressed(StudioContext& context, const std::vector<Place>& places) {
    const ImGuiIO& io = ImGui::GetIO();
    pressedAt_ = io.MousePos;
    pressedTimeS_ = scale_.time(io.MousePos.x);
    draggedS_ = 0.0;
    const Hit hit = hitTest(places, io.MousePos);
    const std::vector<KeyRef> keys = refs(context, hit);
    const bool more = io.KeyShift || io.KeyCtrl;
    if (keys.empty()) {
        if (!more) selection_.clear();
        hold_ = Hold::Box;
        return;
    }
    if (more && selection_.containsAll(keys)) {
        selection_.remove(keys);
        return;
    }
    if (more)
        selection_.add(keys);
    else if (!selection_.containsAll(keys))
        selection_.set(keys);
    grabbedS_ = keys.front().timeS;
    selection_.beginDrag();
    hold_ = Hold::Keys;
}

void TrackEditor::held(StudioContext& context) {
    const ImGuiIO& io = ImGui::GetIO();
    if (hold_ == Hold::Keys && selection_.dragging()) {
        if (!ImGui::IsMouseDragging(ImGuiMouseButton_Left, kDragThreshold) && draggedS_ == 0.0) return;
        const double fps = context.document().timeline.framesPerSecond;
        const double wanted = grabbedS_ + (scale_.time(io.MousePos.x) - pressedTimeS_);
        const double delta = std::max(snapToFrame(wanted, fps) - grabbedS_, -selection_.originStartS());
        if (std::abs(delta - draggedS_) <= kKeyTimeTolerance) return;
        draggedS_ = delta;
        selection_.drag(context, delta, io.KeyAlt);
    }
}

void TrackEditor::drawBox() const {
    const ImVec2 mouse = ImGui::GetIO().MousePos;
    const ImVec2 low(std::min(mouse.x, pressedAt_.x), std::min(mouse.y, pressedAt_.y));
    const ImVec2 high(std::max(mouse.x, pressedAt_.x), std::max(mouse.y, pressedAt_.y));
    ImVec4 color = accentColor();
    ImGui::GetWindowDrawList()->AddRect(low, high, ImGui::GetColorU32(color));
    color.w = 0.12f;
    ImGui::GetWindowDrawList()->AddRectFilled(low, high, ImGui::GetColorU32(color));
}

void TrackEditor::selectInBox(StudioContext& context, const std::vector<Place>& places) {
    const ImVec2 mouse = ImGui::GetIO().MousePos;
    if (std::hypot(mouse.x - pressedAt_.x, mouse.y - pressedAt_.y) < kDragThreshold) return;
    const double from = scale_.time(std::min(mouse.x, pressedAt_.x));
    const double to = scale_.time(std::max(mouse.x, pressedAt_.x));
    const float top = std::min(mouse.y, pressedAt_.y);
    const float bottom = std::max(mouse.y, pressedAt_.y);
    for (std::size_t i = 0; i < rows_.size(); ++i) {
        if (places[i].middle() < top || places[i].middle() > bottom) continue;
        for (const KeyMark& key : rows_[i].keys) {
            if (key.timeS < from || key.timeS > to) continue;
            selection_.add(keysBehind(context.document().timeline, jointNames_, rows_[i], key.timeS));
        }
    }
}

void TrackEditor::canvasMenu(StudioContext& context) {
    if (!ImGui::BeginPopup("key menu")) return;
    if (menuOnKey_) {
        const std::string title = selection_.size() == 1 ? "1 key" : fmt::format("{} keys", selection_.size());
        ImGui::TextDisabled("%s", title.c_str());
        ImGui::Separator();
        for (const KeyInterpolation kind :
             {KeyInterpolation::Step, KeyInterpolation::Linear, KeyInterpolation::Smooth}) {
            if (ImGui::MenuItem(interpolationLabel(kind))) selection_.interpolate(context, kind);
        }
        ImGui::Separator();
        if (ImGui::MenuItem("Delete", "Del")) selection_.deleteKeys(context);
        if (ImGui::MenuItem("Go there")) seekFromWidget(context, menuTimeS_);
    } else {
        if (ImGui::MenuItem("Key here")) {
            runTogether(context, {{"timeline.seek", {{"time", std::max(0.0, menuTimeS_)}}},
                                  {"timeline.key", {{"track", menuTrack_}}}});
        }
        const bool any = std::any_of(rows_.begin(), rows_.end(), [this](const TrackRow& row) {
            return row.track == menuTrack_ && !row.keys.empty();
        });
        if (ImGui::MenuItem("Clear track", nullptr, false, any)) {
            runFromWidget(context, "timeline.clear_track", {{"track", menuTrack_}});
        }
    }
    ImGui::EndPopup();
}

void TrackEditor::keyTip(StudioContext& context, const std::vector<Place>& places) {
    if (hold_ != Hold::None || !ImGui::IsItemHovered() || !context.settings.tooltips) return;
    const Hit hit = hitTest(places, ImGui::GetIO().MousePos);
    if (hit.key < 0) return;
    const TrackRow& row = rows_[static_cast<std::size_t>(hit.row)];
    const KeyMark& key = row.keys[static_cast<std::size_t>(hit.key)];
    const std::string text =
        fmt::format("{}, frame {}, {:.3f} s, {}\nDrag: move. Alt+drag: copy. Del: delete. Right click: interpolation.",
                    row.label, frameAt(key.timeS, context.document().timeline.framesPerSecond), key.timeS,
                    EnumWords<KeyInterpolation>::words[static_cast<std::size_t>(key.interpolation)]);
    help(context, text.c_str());
}

} // namespace ars::ui
