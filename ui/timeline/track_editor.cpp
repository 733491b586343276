#include "ui/timeline/track_editor.h"

#include "engine/scene/evaluate.h"
#include "ui/pose/joint_tree_view.h"
#include "ui/studio.h"
#include "ui/widgets.h"

#include <imgui.h>
#include <imgui_internal.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {
namespace {

constexpr float kHeadWidth = 160.0f; ///< design pixels
constexpr float kRowHeight = 18.0f;
constexpr float kCurveHeight = 38.0f;
constexpr float kKeyRadius = 4.6f;

ImU32 faded(ImVec4 color, float alpha) {
    color.w *= alpha;
    return ImGui::GetColorU32(color);
}

/// Square holds, diamond is straight, disc is smooth.
void drawKeyShape(ImDrawList* draw, const ImVec2& c, float r, KeyInterpolation kind, ImU32 fill, ImU32 edge) {
    if (kind == KeyInterpolation::Step) {
        const float h = 0.8f * r;
        draw->AddRectFilled(ImVec2(c.x - h, c.y - h), ImVec2(c.x + h, c.y + h), fill);
        draw->AddRect(ImVec2(c.x - h, c.y - h), ImVec2(c.x + h, c.y + h), edge);
        return;
    }
    const ImVec2 left(c.x - r, c.y), top(c.x, c.y - r), right(c.x + r, c.y), bottom(c.x, c.y + r);
    if (kind == KeyInterpolation::Linear) {
        draw->AddQuadFilled(left, top, right, bottom, fill);
        draw->AddQuad(left, top, right, bottom, edge);
        return;
    }
    draw->AddCircleFilled(c, 0.92f * r, fill);
    draw->AddCircle(c, 0.92f * r, edge);
}

/// Names a key for whoever drives the window by names ("camera 0").
void nameItem(const std::string& name, const ImRect& box) {
    [[maybe_unused]] ImGuiContext& g = *ImGui::GetCurrentContext();
    const ImGuiID id = ImGui::GetID(name.c_str());
    ImGui::ItemAdd(box, id, nullptr, ImGuiItemFlags_NoNav | ImGuiItemFlags_NoTabStop);
    IMGUI_TEST_ENGINE_ITEM_INFO(id, name.c_str(), ImGuiItemStatusFlags_None);
}

} // namespace

void TrackEditor::refresh(StudioContext& context) {
    const std::vector<std::string>& names = readPose(context).skeleton->names;
    const std::uint64_t version = context.session.editor().version();
    if (!stale_ && version == version_ && names == jointNames_) return;
    stale_ = false;
    version_ = version;
    jointNames_ = names;
    const TimelineSection& timeline = context.document().timeline;
    rows_ = trackRows(timeline, jointNames_, unfolded_);
    keyTimes_ = allKeyTimes(timeline);
    if (!selection_.dragging()) selection_.forgetMissing(timeline, jointNames_);
}

void TrackEditor::draw(StudioContext& context) {
    refresh(context);
    layOut(context);
    ImGui::PushStyleVar(ImGuiStyleVar_ItemSpacing, ImVec2(0.0f, 1.0f * context.scale));
    drawRuler(context);
    drawClip(context);
    drawTracks(context);
    ImGui::PopStyleVar();
    if (!selection_.empty() && !ImGui::GetIO().WantTextInput &&
        ImGui::Shortcut(ImGuiKey_Delete, ImGuiInputFlags_RouteFocused)) {
        selection_.deleteKeys(context);
    }
}

void TrackEditor::layOut(StudioContext& context) {
    const float available = ImGui::GetContentRegionAvail().x;
    const float scrollbar = ImGui::GetStyle().ScrollbarSize;
    headWidth_ = std::min(kHeadWidth * context.scale, 0.4f * available);
    rowHeight_ = kRowHeight * context.scale;
    curveHeight_ = kCurveHeight * context.scale;
    scale_.left = ImGui::GetCursorScreenPos().x + headWidth_;
    scale_.width = std::max(available - headWidth_ - scrollbar, 1.0f);
    const TimelineSection& timeline = context.document().timeline;
    if (fitted_) scale_.fit(timeline.startS, timeline.endS);
}

std::vector<TrackEditor::Place> TrackEditor::placeRows(float top) const {
    std::vector<Place> places;
    places.reserve(rows_.size());
    for (const TrackRow& row : rows_) {
        const float height = row.curve ? rowHeight_ + curveHeight_ : rowHeight_;
        places.push_back({top, rowHeight_, height});
        top += height;
    }
    return places;
}

void TrackEditor::drawTracks(StudioContext& context) {
    const ImVec2 size(0.0f, std::max(ImGui::GetContentRegionAvail().y, rowHeight_));
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(0, 0));
    const bool open = ImGui::BeginChild("tracks", size);
    ImGui::PopStyleVar();
    if (open) {
        const ImVec2 start = ImGui::GetCursorScreenPos();
        std::vector<Place> places = placeRows(start.y);
        const float total = places.empty() ? 0.0f : places.back().top + places.back().height - start.y;
        const float height = std::max(total, ImGui::GetContentRegionAvail().y);
        const ImVec2 windowLow = ImGui::GetWindowPos();
        const float windowHigh = windowLow.y + ImGui::GetWindowHeight();

        ImGui::SetCursorScreenPos(ImVec2(start.x + headWidth_, start.y));
        ImGui::InvisibleButton("Keys", ImVec2(scale_.width, height),
                               ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                                   ImGuiButtonFlags_MouseButtonMiddle);
        navigate(context);
        actOnCanvas(context, places);
        canvasMenu(context);
        // Keys and rows may have come and gone by now.
        refresh(context);
        places = placeRows(start.y);
        for (std::size_t i = 0; i < rows_.size(); ++i) {
            if (places[i].top + places[i].height < windowLow.y || places[i].top > windowHigh) continue;
            drawRow(context, i, places[i]);
            drawHead(context, i, places[i]);
        }
        ImGui::PushClipRect(ImVec2(scale_.left, windowLow.y), ImVec2(scale_.left + scale_.width, windowHigh), true);
        if (hold_ == Hold::Box) drawBox();
        drawPlayhead(context, windowLow.y, windowHigh, false);
        ImGui::PopClipRect();
        ImGui::SetCursorScreenPos(ImVec2(start.x, start.y + total));
        ImGui::Dummy(ImVec2(1.0f, 0.0f));
    }
    ImGui::EndChild();
}

void TrackEditor::drawHead(StudioContext& context, std::size_t index, const Place& place) {
    const TrackRow& row = rows_[index];
    const float s = context.scale;
    const float left = scale_.left - headWidth_;
    const float indent = static_cast<float>(row.depth) * 12.0f * s;
    ImDrawList* draw = ImGui::GetWindowDrawList();
    ImGui::PushID(row.track.c_str());

    const float keyBox = rowHeight_;
    ImGui::SetCursorScreenPos(ImVec2(left, place.top));
    const bool fold = ImGui::InvisibleButton("Fold", ImVec2(headWidth_ - keyBox - 6.0f * s, rowHeight_));
    const bool hovered = ImGui::IsItemHovered();
    if (hovered) {
        draw->AddRectFilled(ImGui::GetItemRectMin(), ImGui::GetItemRectMax(), ImGui::GetColorU32(ImGuiCol_FrameBg),
                            3.0f * s);
    }
    if (row.foldable) {
        ImGui::RenderArrow(draw, ImVec2(left + indent + 3.0f * s, place.middle() - 0.35f * ImGui::GetFontSize()),
                           ImGui::GetColorU32(mutedColor()), row.unfolded ? ImGuiDir_Down : ImGuiDir_Right, 0.7f);
    }
    const float textTop = place.middle() - 0.5f * ImGui::GetFontSize();
    const float textLeft = left + indent + 18.0f * s;
    draw->AddText(ImVec2(textLeft, textTop),
                  ImGui::GetColorU32(row.depth > 0 ? mutedColor() : ImGui::GetStyleColorVec4(ImGuiCol_Text)),
                  row.label.c_str());
    std::string note = row.onClip ? "on clip" : "";
    if (const Track<float>* track = scalarTrack(context.document().timeline, row.track); track && !track->empty()) {
        char number[32];
        std::snprintf(number, sizeof(number), scalarFormat(row.track),
                      static_cast<double>(sampleTrack(*track, context.session.timeS())));
        note = number;
    }
    if (!note.empty()) {
        const float size = 0.86f * ImGui::GetFontSize();
        const float width = ImGui::GetFont()->CalcTextSizeA(size, FLT_MAX, 0.0f, note.c_str()).x;
        const float right = left + headWidth_ - keyBox - 8.0f * s;
        if (right - width > textLeft + ImGui::CalcTextSize(row.label.c_str()).x + 4.0f * s) {
            draw->AddText(ImGui::GetFont(), size, ImVec2(right - width, place.middle() - 0.5f * size),
                          ImGui::GetColorU32(mutedColor()), note.c_str());
        }
    }
    if (row.foldable)
        help(context,
             scalarTrack(context.document().timeline, row.track) ? "Shows the curve" : "Shows the single tracks");
    if (fold && row.foldable) {
        if (!unfolded_.erase(row.track)) unfolded_.insert(row.track);
        stale_ = true;
    }

    ImGui::SetCursorScreenPos(ImVec2(left + headWidth_ - keyBox - 4.0f * s, place.top));
    const bool press = ImGui::InvisibleButton("Key", ImVec2(keyBox, rowHeight_));
    const double now = context.session.timeS();
    const bool keyed = std::any_of(row.keys.begin(), row.keys.end(), [now](const KeyMark& key) {
        return std::abs(key.timeS - now) <= kKeyTimeTolerance;
    });
    const ImVec2 c(left + headWidth_ - 0.5f * keyBox - 4.0f * s, place.middle());
    const float r = kKeyRadius * s;
    const ImVec2 l(c.x - r, c.y), t(c.x, c.y - r), rr(c.x + r, c.y), b(c.x, c.y + r);
    const ImU32 color = ImGui::GetColorU32(ImGui::IsItemHovered() || keyed ? accentColor() : mutedColor());
    if (keyed)
        draw->AddQuadFilled(l, t, rr, b, color);
    else
        draw->AddQuad(l, t, rr, b, color);
    help(context, keyed ? "Delete the key at the current time" : "Key at the current time");
    ImGui::PopID();
    if (press) toggleKey(context, row);
}

void TrackEditor::toggleKey(StudioContext& context, const TrackRow& row) {
    const double now = context.session.timeS();
    std::vector<std::pair<std::string, Arguments>> calls;
    for (const KeyMark& key : row.keys) {
        if (std::abs(key.timeS - now) > kKeyTimeTolerance) continue;
        for (const KeyRef& one : keysBehind(context.document().timeline, jointNames_, row, key.timeS)) {
            calls.emplace_back("timeline.delete_key", Arguments{{"track", one.track}, {"time", one.timeS}});
        }
    }
    if (calls.empty()) calls.emplace_back("timeline.key", Arguments{{"track", row.track}});
    runTogether(context, calls);
}

void TrackEditor::drawRow(StudioContext& context, std::size_t index, const Place& place) {
    const TrackRow& row = rows_[index];
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const ImVec2 low(scale_.left, place.top);
    const ImVec2 high(scale_.left + scale_.width, place.top + place.height);
    ImGui::PushClipRect(low, high, true);
    if (index % 2 == 0) draw->AddRectFilled(low, high, faded(ImGui::GetStyleColorVec4(ImGuiCol_Text), 0.025f));
    const TimelineSection& timeline = context.document().timeline;
    const ImU32 outside = faded(ImGui::GetStyleColorVec4(ImGuiCol_WindowBg), 0.55f);
    const float from = scale_.x(timeline.startS);
    const float to = scale_.x(timeline.endS);
    if (from > low.x) draw->AddRectFilled(low, ImVec2(std::min(from, high.x), high.y), outside);
    if (to < high.x) draw->AddRectFilled(ImVec2(std::max(to, low.x), low.y), high, outside);
    if (row.curve) drawCurve(context, row, place);

    // Only what is visible: a motion may have thousands of keys.
    const double reach = 8.0 * context.scale / scale_.pixelsPerSecond;
    const auto before = [](const KeyMark& key, double time) { return key.timeS < time; };
    const auto first = std::lower_bound(row.keys.begin(), row.keys.end(), scale_.firstS - reach, before);
    const auto last = std::lower_bound(first, row.keys.end(), scale_.lastS() + reach, before);
    if (row.keys.size() > 1) {
        const float begin = std::max(low.x, scale_.x(row.keys.front().timeS));
        const float end = std::min(high.x, scale_.x(row.keys.back().timeS));
        if (end > begin) {
            draw->AddLine(ImVec2(begin, place.middle()), ImVec2(end, place.middle()), faded(mutedColor(), 0.35f),
                          2.0f * context.scale);
        }
    }
    for (auto key = first; key != last; ++key) {
        drawKey(context, row, static_cast<std::size_t>(key - row.keys.begin()), place);
    }
    ImGui::PopClipRect();
}

void TrackEditor::drawKey(StudioContext& context, const TrackRow& row, std::size_t index, const Place& place) {
    const KeyMark& key = row.keys[index];
    const ImVec2 c(scale_.x(key.timeS), place.middle());
    const bool several = !row.members.empty();
    bool chosen = false;
    if (!selection_.empty()) {
        const auto refs = keysBehind(context.document().timeline, jointNames_, row, key.timeS);
        chosen = selection_.containsAll(refs);
    }
    const float r = kKeyRadius * context.scale;
    const ImVec4 plain = ImGui::GetStyleColorVec4(ImGuiCol_Text);
    const ImVec4 color = chosen ? accentColor() : plain;
    drawKeyShape(ImGui::GetWindowDrawList(), c, r, key.interpolation,
                 faded(color, chosen    ? 1.0f
                              : several ? 0.85f
                                        : 0.7f),
                 ImGui::GetColorU32(ImGuiCol_WindowBg));
    nameItem(fmt::format("{} {}", row.track, index), ImRect(c.x - r, c.y - r, c.x + r, c.y + r));
}

void TrackEditor::drawCurve(StudioContext& context, const TrackRow& row, const Place& place) {
    const Track<float>* track = scalarTrack(context.document().timeline, row.track);
    if (!track || track->empty()) return;
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const float s = context.scale;
    const float top = place.top + place.keys + 2.0f * s;
    const float bottom = place.top + place.height - 4.0f * s;
    float low = track->front().value;
    float high = low;
    for (const Key<float>& key : *track) {
        low = std::min(low, key.value);
        high = std::max(high, key.value);
    }
    const float span = std::max(high - low, 1e-6f);
    const auto y = [&, from = low, height = bottom - top](float value) {
        return high - from < 1e-6f ? 0.5f * (top + bottom) : bottom - (value - from) / span * height;
    };
    draw->AddRectFilled(ImVec2(scale_.left, top - 1.0f), ImVec2(scale_.left + scale_.width, bottom + 1.0f),
                        faded(ImGui::GetStyleColorVec4(ImGuiCol_FrameBg), 0.6f), 3.0f * s);
    const float step = 2.0f * s;
    draw->PathClear();
    for (float x = scale_.left; x <= scale_.left + scale_.width; x += step) {
        draw->PathLineTo(ImVec2(x, std::clamp(y(sampleTrack(*track, scale_.time(x))), top, bottom)));
    }
    draw->PathStroke(faded(accentColor(), 0.9f), ImDrawFlags_None, 1.4f * s);
    for (const Key<float>& key : *track) {
        const float x = scale_.x(key.timeS);
        if (x < scale_.left - 4.0f || x > scale_.left + scale_.width + 4.0f) continue;
        draw->AddCircleFilled(ImVec2(x, y(key.value)), 2.4f * s, ImGui::GetColorU32(accentColor()));
    }
    // Bounds at the left edge.
    const float size = 0.78f * ImGui::GetFontSize();
    const auto text = [&](float value, float at) {
        char number[32];
        std::snprintf(number, sizeof(number), scalarFormat(row.track), static_cast<double>(value));
        draw->AddText(ImGui::GetFont(), size, ImVec2(scale_.left + 4.0f * s, at), ImGui::GetColorU32(mutedColor()),
                      number);
    };
    text(high, top);
    if (high - low >= 1e-6f) text(low, bottom - size);
}

} // namespace ars::ui
