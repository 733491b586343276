#include "ui/timeline/track_editor.h"

#include "engine/rig/motion.h"
#include "ui/studio.h"
#include "ui/timeline/transport_bar.h"
#include "ui/widgets.h"

#include <imgui.h>
#include <imgui_internal.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace ars::ui {
namespace {

constexpr float kRulerHeight = 24.0f; ///< design pixels
constexpr float kClipHeight = 17.0f;
constexpr float kRangeStrip = 8.0f; ///< upper part of the ruler, where the range's ends are dragged
constexpr float kGrabReach = 6.0f;

ImU32 faded(ImVec4 color, float alpha) {
    color.w *= alpha;
    return ImGui::GetColorU32(color);
}

void smallText(ImDrawList* draw, const ImVec2& at, ImU32 color, const std::string& text) {
    const float size = ImGui::GetFontSize() * 0.86f;
    draw->AddText(ImGui::GetFont(), size, at, color, text.c_str());
}

std::string secondsText(double seconds) {
    std::string text = fmt::format("{:.3f}", seconds);
    while (text.back() == '0') text.pop_back();
    if (text.back() == '.') text.pop_back();
    return text + " s";
}

} // namespace

void TrackEditor::drawRuler(StudioContext& context) {
    const ImVec2 start = ImGui::GetCursorScreenPos();
    const float height = kRulerHeight * context.scale;
    const float available = ImGui::GetContentRegionAvail().x;

    ImGui::PushStyleVar(ImGuiStyleVar_FramePadding, ImVec2(6.0f * context.scale, 0.0f));
    if (ImGui::Button("Fit", ImVec2(0.0f, height - 4.0f * context.scale))) fitted_ = true;
    help(context, "Shows the whole range. Wheel: zoom; middle drag or Shift+wheel: move; Ctrl+wheel: rows.");
    ImGui::PopStyleVar();

    ImGui::SetCursorScreenPos(ImVec2(start.x + headWidth_, start.y));
    ImGui::InvisibleButton("Ruler", ImVec2(std::max(available - headWidth_, 1.0f), height));
    const ImVec2 low = ImGui::GetItemRectMin();
    const ImVec2 high = ImGui::GetItemRectMax();
    navigate(context);
    dragRange(context, low, high);
    const double fps = context.document().timeline.framesPerSecond;
    if (ImGui::IsItemActive() && rangeEnd_ == 0) {
        const double time = snapToFrame(scale_.time(ImGui::GetIO().MousePos.x), fps);
        if (ImGui::IsItemActivated() || std::abs(time - context.session.timeS()) > kKeyTimeTolerance) {
            seekFromWidget(context, std::max(time, 0.0));
        }
    }
    help(context, "Drag: go through time. The bar on top is the range that plays: drag its ends.");
    drawRulerTicks(context, low, high);
    drawPlayhead(context, low.y, high.y, true);
}

void TrackEditor::dragRange(StudioContext& context, const ImVec2& low, const ImVec2& high) {
    const TimelineSection& timeline = context.document().timeline;
    const ImVec2 mouse = ImGui::GetIO().MousePos;
    const float reach = kGrabReach * context.scale;
    const bool inStrip = mouse.y < low.y + kRangeStrip * context.scale + 1.0f;
    const float fromStart = std::abs(mouse.x - scale_.x(timeline.startS));
    const float fromEnd = std::abs(mouse.x - scale_.x(timeline.endS));
    const int near = !inStrip || std::min(fromStart, fromEnd) > reach ? 0 : fromStart < fromEnd ? -1 : 1;
    if (ImGui::IsItemActivated()) rangeEnd_ = near;
    if (!ImGui::IsItemActive()) rangeEnd_ = 0;
    if (rangeEnd_ != 0 || (near != 0 && ImGui::IsItemHovered())) ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeEW);
    if (rangeEnd_ != 0) {
        const double frame = 1.0 / timeline.framesPerSecond;
        const double time = std::max(0.0, snapToFrame(scale_.time(mouse.x), timeline.framesPerSecond));
        const double start = rangeEnd_ < 0 ? std::min(time, timeline.endS - frame) : timeline.startS;
        const double end = rangeEnd_ > 0 ? std::max(time, timeline.startS + frame) : timeline.endS;
        if (start != timeline.startS || end != timeline.endS) {
            fitted_ = false; // the scale must not run away under the mouse
            runFromWidget(context, "timeline.range", {{"start", start}, {"end", end}});
        }
    }

    ImDrawList* draw = ImGui::GetWindowDrawList();
    draw->PushClipRect(low, high, true);
    draw->AddRectFilled(low, high, ImGui::GetColorU32(ImGuiCol_FrameBg));
    const float strip = 4.0f * context.scale;
    const float from = scale_.x(timeline.startS);
    const float to = scale_.x(timeline.endS);
    draw->AddRectFilled(ImVec2(from, low.y), ImVec2(to, high.y), faded(ImGui::GetStyleColorVec4(ImGuiCol_Text), 0.05f));
    draw->AddRectFilled(ImVec2(from, low.y), ImVec2(to, low.y + strip), faded(mutedColor(), 0.75f),
                        2.0f * context.scale);
    for (int end = -1; end <= 1; end += 2) {
        const float x = end < 0 ? from : to;
        const bool hot = rangeEnd_ == end || (rangeEnd_ == 0 && near == end && ImGui::IsItemHovered());
        draw->AddRectFilled(ImVec2(x - 2.0f * context.scale, low.y),
                            ImVec2(x + 2.0f * context.scale, low.y + kRangeStrip * context.scale),
                            hot ? ImGui::GetColorU32(accentColor()) : ImGui::GetColorU32(mutedColor()),
                            1.0f * context.scale);
    }
    draw->PopClipRect();
}

void TrackEditor::drawRulerTicks(StudioContext& context, const ImVec2& low, const ImVec2& high) {
    ImDrawList* draw = ImGui::GetWindowDrawList();
    draw->PushClipRect(low, high, true);
    const float s = context.scale;
    const float letter = ImGui::GetFontSize() * 0.86f;
    const float spacing = 6.2f * ImGui::GetFontSize();
    for (const RulerTick& tick : rulerTicks(scale_, context.document().timeline.framesPerSecond, spacing)) {
        const float x = std::floor(scale_.x(tick.timeS)) + 0.5f;
        const float top = tick.labelled ? high.y - 13.0f * s : high.y - 3.0f * s;
        draw->AddLine(ImVec2(x, top), ImVec2(x, high.y), faded(mutedColor(), tick.labelled ? 0.8f : 0.4f));
        if (!tick.labelled) continue;
        const std::string frame = fmt::format("{}", tick.frame);
        const ImVec2 at(x + 4.0f * s, high.y - letter - 4.0f * s);
        const auto widthOf = [&](const std::string& text) {
            return ImGui::GetFont()->CalcTextSizeA(letter, FLT_MAX, 0.0f, text.c_str()).x;
        };
        // At the right end half a number would be a wrong one.
        const float seconds = at.x + widthOf(frame) + 5.0f * s;
        if (seconds - 5.0f * s > high.x) continue;
        smallText(draw, at, ImGui::GetColorU32(ImGuiCol_Text), frame);
        const std::string time = secondsText(tick.timeS);
        if (seconds + widthOf(time) <= high.x) smallText(draw, ImVec2(seconds, at.y), faded(mutedColor(), 0.9f), time);
    }
    draw->PopClipRect();
}

void TrackEditor::drawPlayhead(StudioContext& context, float top, float bottom, bool flag) {
    const float x = std::floor(scale_.x(context.session.timeS())) + 0.5f;
    if (x < scale_.left - 1.0f || x > scale_.left + scale_.width + 1.0f) return;
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const ImU32 color = ImGui::GetColorU32(accentColor());
    draw->AddLine(ImVec2(x, top), ImVec2(x, bottom), color, std::max(1.0f, context.scale));
    if (!flag) return;
    const float r = 4.5f * context.scale;
    draw->AddTriangleFilled(ImVec2(x - r, top), ImVec2(x + r, top), ImVec2(x, top + 1.6f * r), color);
}

/// After the widget that shows time: wheel and middle button.
void TrackEditor::navigate(StudioContext& context) {
    const ImGuiIO& io = ImGui::GetIO();
    if (ImGui::IsItemHovered()) {
        const bool rows = io.KeyCtrl; // the list below scrolls by itself then
        if (!rows) {
            ImGui::SetItemKeyOwner(ImGuiKey_MouseWheelY);
            ImGui::SetItemKeyOwner(ImGuiKey_MouseWheelX);
        }
        const float sideways = io.MouseWheelH + (io.KeyShift ? io.MouseWheel : 0.0f);
        if (sideways != 0.0f) {
            scale_.pan(sideways * 60.0f * context.scale);
            fitted_ = false;
        } else if (io.MouseWheel != 0.0f && !rows) {
            const float turn = context.settings.invertZoom ? -io.MouseWheel : io.MouseWheel;
            scale_.zoom(std::pow(1.2, static_cast<double>(turn)), io.MousePos.x);
            fitted_ = false;
        }
    }
    if (ImGui::IsWindowHovered(ImGuiHoveredFlags_ChildWindows | ImGuiHoveredFlags_AllowWhenBlockedByActiveItem) &&
        ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenBlockedByActiveItem) &&
        ImGui::IsMouseDragging(ImGuiMouseButton_Middle, 0.0f) && io.MouseDelta.x != 0.0f) {
        scale_.pan(io.MouseDelta.x);
        fitted_ = false;
    }
}

void TrackEditor::drawClip(StudioContext& context) {
    const TimelineSection& timeline = context.document().timeline;
    const float height = kClipHeight * context.scale;
    const ImVec2 start = ImGui::GetCursorScreenPos();
    const float available = ImGui::GetContentRegionAvail().x;
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const float textTop = start.y + 0.5f * (height - ImGui::GetFontSize());
    draw->AddText(ImVec2(start.x + 18.0f * context.scale, textTop), ImGui::GetColorU32(ImGuiCol_Text), "Clip");
    if (!timeline.clip.empty()) {
        ImGui::SetCursorScreenPos(ImVec2(start.x + headWidth_ - height - 4.0f * context.scale, start.y));
        ImGui::PushStyleVar(ImGuiStyleVar_FramePadding, ImVec2(0.0f, 0.5f * (height - ImGui::GetFontSize())));
        if (toolButton(icon::kClose, "Close clip. Its keys stay")) {
            runFromWidget(context, "timeline.close_clip", Arguments::object());
        }
        ImGui::PopStyleVar();
    }
    ImGui::SetCursorScreenPos(ImVec2(start.x + headWidth_, start.y));
    ImGui::InvisibleButton("Clip", ImVec2(std::max(available - headWidth_, 1.0f), height));
    const ImVec2 low = ImGui::GetItemRectMin();
    const ImVec2 high = ImGui::GetItemRectMax();
    navigate(context);
    draw->PushClipRect(low, high, true);
    if (timeline.clip.empty()) {
        smallText(draw, ImVec2(low.x + 8.0f * context.scale, textTop), ImGui::GetColorU32(mutedColor()),
                  "Drop a motion file here: npz, npy, bvh, glb");
        help(context, "Without a clip the body holds its pose, wherever no keys say otherwise.");
    } else {
        const auto& clip = context.session.assets().clip;
        const double length = clip && clip->motion ? clip->motion->durationS() : timeline.endS - timeline.clipOffsetS;
        const float from = scale_.x(timeline.clipOffsetS);
        const float to = std::max(scale_.x(timeline.clipOffsetS + length), from + 3.0f);
        const bool hot = ImGui::IsItemHovered() || ImGui::IsItemActive();
        draw->AddRectFilled(ImVec2(from, low.y + 1.0f), ImVec2(to, high.y - 1.0f),
                            faded(accentColor(), hot ? 0.42f : 0.3f), 3.0f * context.scale);
        const std::string name = std::filesystem::path(timeline.clip).filename().string();
        const std::string text = clip && clip->motion ? fmt::format("{}   {}", name, secondsText(length)) : name;
        smallText(draw, ImVec2(std::max(from, low.x) + 7.0f * context.scale, textTop + 1.0f),
                  ImGui::GetColorU32(ImGuiCol_Text), text);
        help(context,
             fmt::format("{}\nBegins at {}. Drag: moves it in time.", timeline.clip, secondsText(timeline.clipOffsetS))
                 .c_str());
        if (ImGui::IsItemActivated()) {
            clipPressedS_ = timeline.clipOffsetS;
            pressedAt_ = ImGui::GetIO().MousePos;
        }
        if (ImGui::IsItemActive() && ImGui::IsMouseDragging(ImGuiMouseButton_Left, 2.0f)) {
            const double moved = (ImGui::GetIO().MousePos.x - pressedAt_.x) / scale_.pixelsPerSecond;
            const double offset = snapToFrame(clipPressedS_ + moved, timeline.framesPerSecond);
            if (std::abs(offset - timeline.clipOffsetS) > kKeyTimeTolerance) {
                runFromWidget(context, "timeline.clip_offset", {{"time", offset}});
            }
        }
    }
    draw->PopClipRect();
    drawPlayhead(context, low.y, high.y, false);
}

} // namespace ars::ui
