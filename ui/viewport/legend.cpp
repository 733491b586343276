#include "ui/viewport/legend.h"

#include "ui/viewport/comparison.h"
#include "ui/widgets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr float kWidth = 12.0f; ///< design pixels
constexpr float kHeight = 150.0f;
constexpr float kMargin = 14.0f;
constexpr int kSteps = 32;

struct Bar {
    ImVec2 low, high;
};

Bar barOf(const PictureView& view, float scale) {
    const float height = std::min(kHeight * scale, 0.5f * view.size.y);
    const float right = view.origin.x + view.size.x - kMargin * scale;
    const float middle = view.origin.y + 0.5f * view.size.y;
    return {ImVec2(right - kWidth * scale, middle - 0.5f * height), ImVec2(right, middle + 0.5f * height)};
}

ImU32 colorAt(ColorMap map, float t) {
    const glm::vec3 c = mapColor(map, t);
    return ImGui::GetColorU32(ImVec4(c.r, c.g, c.b, 1.0f));
}

void drawBar(ImDrawList* list, const Bar& bar, ColorMap map, float scale) {
    const ImVec2 edge(1.0f * scale, 1.0f * scale);
    list->AddRectFilled(ImVec2(bar.low.x - edge.x, bar.low.y - edge.y),
                        ImVec2(bar.high.x + edge.x, bar.high.y + edge.y), IM_COL32(16, 16, 18, 200), 2.0f * scale);
    for (int i = 0; i < kSteps; ++i) {
        const float t0 = static_cast<float>(i) / kSteps, t1 = static_cast<float>(i + 1) / kSteps;
        const float y0 = bar.low.y + t0 * (bar.high.y - bar.low.y), y1 = bar.low.y + t1 * (bar.high.y - bar.low.y);
        const ImU32 top = colorAt(map, 1.0f - t0), bottom = colorAt(map, 1.0f - t1);
        list->AddRectFilledMultiColor(ImVec2(bar.low.x, y0), ImVec2(bar.high.x, y1), top, top, bottom, bottom);
    }
}

std::string rangeText(float value) {
    return std::abs(value) < 1.0f ? fmt::format("{:.3g}", value) : fmt::format("{:.4g}", value);
}

} // namespace

void drawColorBar(const PictureView& view, float scale, ColorMap map, const std::string& minimum,
                  const std::string& maximum, const std::string& title) {
    ImDrawList* list = ImGui::GetWindowDrawList();
    const Bar bar = barOf(view, scale);
    drawBar(list, bar, map, scale);
    const float gap = 5.0f * scale;
    drawPlate(list, ImVec2(bar.high.x, bar.low.y - gap), ImVec2(1, 1), maximum.c_str(), Ink::Text, scale);
    drawPlate(list, ImVec2(bar.high.x, bar.high.y + gap), ImVec2(1, 0), minimum.c_str(), Ink::Text, scale);
    if (!title.empty()) {
        drawPlate(list, ImVec2(bar.low.x - gap, 0.5f * (bar.low.y + bar.high.y)), ImVec2(1, 0.5f), title.c_str(),
                  Ink::Text, scale);
    }
}

void Legend::end(const ViewportInput& input, BufferId buffer, bool maximum, const ImVec2& low, const ImVec2& high) {
    const Document& document = input.context.document();
    const PresentSettings now = presentSettings(document, buffer, input.context.session.timeS());
    ImGui::SetCursorScreenPos(low);
    ImGui::SetNextItemAllowOverlap();
    ImGui::InvisibleButton(maximum ? "Legend/Maximum" : "Legend/Minimum", ImVec2(high.x - low.x, high.y - low.y));
    if (ImGui::IsItemHovered() || ImGui::IsItemActive()) {
        ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeNS);
        ImGui::GetWindowDrawList()->AddRect(low, high, ImGui::GetColorU32(inkColor(Ink::Accent)), 4.0f * input.scale, 0,
                                            1.5f * input.scale);
    }
    help(input.context, "Drag up or down to change this end of the range. Right click: the buffer's own range.",
         std::string(bufferInfo(buffer).symbol).c_str(), std::string(bufferInfo(buffer).unit).c_str());
    if (ImGui::IsItemHovered() && ImGui::IsMouseReleased(ImGuiMouseButton_Right)) {
        gesture_.run(input.context, "view.reset_range", {{"buffer", bufferInfo(buffer).name}});
    }
    if (ImGui::IsItemActivated()) {
        startMinimum_ = now.minimum;
        startMaximum_ = now.maximum;
        startY_ = input.mouse.y;
        gesture_.begin(input.context.session, "range");
    }
    if (ImGui::IsItemActive() && gesture_.active() && ImGui::GetIO().MouseDelta.y != 0.0f) {
        const float span = startMaximum_ - startMinimum_;
        const float change = (startY_ - input.mouse.y) / (kHeight * input.scale) * span;
        // The ends never meet: a range of nothing shows nothing.
        const float least = 0.02f * span;
        const float low_ = maximum ? startMinimum_ : std::min(startMinimum_ + change, startMaximum_ - least);
        const float high_ = maximum ? std::max(startMaximum_ + change, startMinimum_ + least) : startMaximum_;
        gesture_.run(input.context, "view.range",
                     {{"buffer", bufferInfo(buffer).name}, {"minimum", low_}, {"maximum", high_}});
    }
    if (ImGui::IsItemDeactivated()) gesture_.end(input.context.session);
}

void Legend::draw(const ViewportInput& input, BufferId buffer) {
    const BufferInfo& info = bufferInfo(buffer);
    if (!input.context.document().view.legend) return;
    if (info.kind != BufferKind::Scalar && info.kind != BufferKind::Place) return;
    const PresentSettings settings = presentSettings(input.context.document(), buffer, input.context.session.timeS());
    ImDrawList* list = ImGui::GetWindowDrawList();
    const Bar bar = barOf(input.view, input.scale);
    if (info.kind == BufferKind::Scalar) {
        drawBar(list, bar, settings.colorMap, input.scale);
    } else {
        // Three axes: red, green and blue grow along x, y and z.
        const float third = (bar.high.x - bar.low.x) / 3.0f;
        for (int axis = 0; axis < 3; ++axis) {
            const ImU32 top = IM_COL32(axis == 0 ? 255 : 0, axis == 1 ? 255 : 0, axis == 2 ? 255 : 0, 255);
            const float x = bar.low.x + third * static_cast<float>(axis);
            list->AddRectFilledMultiColor(ImVec2(x, bar.low.y), ImVec2(x + third, bar.high.y), top, top, IM_COL32_BLACK,
                                          IM_COL32_BLACK);
        }
    }
    const std::string unit = info.unit.empty() ? std::string() : " " + std::string(info.unit);
    const float gap = 5.0f * input.scale;
    auto label = [&](float y, float anchor, float value, bool maximum) {
        const ImVec2 place(bar.high.x, y);
        const ImVec2 size =
            drawPlate(list, place, ImVec2(1, anchor), (rangeText(value) + unit).c_str(), Ink::Text, input.scale);
        const ImVec2 low(place.x - size.x, place.y - anchor * size.y);
        end(input, buffer, maximum, low, ImVec2(low.x + size.x, low.y + size.y));
    };
    label(bar.low.y - gap, 1.0f, settings.maximum, true);
    label(bar.high.y + gap, 0.0f, settings.minimum, false);
}

} // namespace ars::ui
