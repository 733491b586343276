#include "ui/viewport/magnifier.h"

#include "ui/studio.h"
#include "ui/viewport/probe.h"
#include "ui/widgets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr float kStep = 1.25f; ///< one notch of the wheel

std::string pixelNumber(float value) {
    const float size = std::abs(value);
    return size >= 100.0f  ? fmt::format("{:.0f}", value)
           : size >= 10.0f ? fmt::format("{:.1f}", value)
                           : fmt::format("{:.2f}", value);
}

} // namespace

PictureView Magnifier::magnified(PictureView view) const {
    if (!active()) return view;
    const double zoom = zoom_;
    view.camera.fx *= zoom;
    view.camera.fy *= zoom;
    view.camera.cx = (view.camera.cx - static_cast<double>(origin_.x * view.size.x)) * zoom;
    view.camera.cy = (view.camera.cy - static_cast<double>(origin_.y * view.size.y)) * zoom;
    return view;
}

void Magnifier::zoomAt(const PictureArea& area, const ImVec2& place, float factor) {
    const ImVec2 share((place.x - area.origin.x) / area.size.x, (place.y - area.origin.y) / area.size.y);
    const ImVec2 fixed(origin_.x + share.x / zoom_, origin_.y + share.y / zoom_);
    zoom_ = std::clamp(zoom_ * factor, 1.0f, kLargest);
    if (zoom_ < 1.02f) zoom_ = 1.0f;
    const float most = 1.0f - 1.0f / zoom_;
    origin_ =
        ImVec2(std::clamp(fixed.x - share.x / zoom_, 0.0f, most), std::clamp(fixed.y - share.y / zoom_, 0.0f, most));
}

void Magnifier::update(const ViewportInput& input, const PictureArea& area) {
    const ImGuiIO& io = ImGui::GetIO();
    if (!input.hovered || !io.KeyCtrl || io.MouseWheel == 0.0f) return;
    const float notches = input.context.settings.invertZoom ? -io.MouseWheel : io.MouseWheel;
    zoomAt(area, input.mouse, std::pow(kStep, notches));
}

void Magnifier::drawPixels(const ViewportInput& input, BufferId buffer) const {
    const Image* picture = input.frame ? input.frame->picture(buffer) : nullptr;
    if (!picture) return;
    const Camera& view = input.view.camera;
    const Camera& frame = input.frame->inputs.camera;
    const double side = view.fx / frame.fx; // screen pixels of a picture's pixel
    ImFont* font = input.context.studio.monospaced();
    const float size = ImGui::GetFontSize() * 0.72f;
    const int lines = std::min(picture->channels, 4);
    if (side < 4.2 * static_cast<double>(size) * 0.62 || side < lines * static_cast<double>(size)) return;
    auto columnOf = [&](double x) {
        return static_cast<int>(std::floor((x - view.cx) / view.fx * frame.fx + frame.cx));
    };
    auto rowOf = [&](double y) { return static_cast<int>(std::floor((y - view.cy) / view.fy * frame.fy + frame.cy)); };
    ImDrawList* list = ImGui::GetWindowDrawList();
    const int lastRow = std::min(rowOf(input.view.size.y), picture->height - 1);
    const int lastColumn = std::min(columnOf(input.view.size.x), picture->width - 1);
    for (int row = std::max(rowOf(0), 0); row <= lastRow; ++row) {
        for (int column = std::max(columnOf(0), 0); column <= lastColumn; ++column) {
            const double x = (column + 0.5 - frame.cx) / frame.fx * view.fx + view.cx + input.view.origin.x;
            const double y = (row + 0.5 - frame.cy) / frame.fy * view.fy + view.cy + input.view.origin.y;
            for (int c = 0; c < lines; ++c) {
                const std::string text = pixelNumber(picture->at(row, column, c));
                const ImVec2 extent = font->CalcTextSizeA(size, FLT_MAX, 0.0f, text.c_str());
                const ImVec2 at(std::floor(static_cast<float>(x) - 0.5f * extent.x),
                                std::floor(static_cast<float>(y) +
                                           (static_cast<float>(c) - 0.5f * static_cast<float>(lines)) * size));
                // Legible on any colour: light letters with a dark rim.
                list->AddText(font, size, ImVec2(at.x + 1, at.y + 1), IM_COL32(0, 0, 0, 200), text.c_str());
                list->AddText(font, size, at, IM_COL32(245, 245, 245, 255), text.c_str());
            }
        }
    }
}

void Magnifier::draw(const ViewportInput& input, BufferId buffer) {
    if (!active()) return;
    ImGui::PushClipRect(input.view.origin,
                        ImVec2(input.view.origin.x + input.view.size.x, input.view.origin.y + input.view.size.y), true);
    drawPixels(input, buffer);
    ImGui::PopClipRect();
    const std::string text = fmt::format("{:.{}f}x", zoom_, zoom_ < 10.0f ? 1 : 0);
    const ImVec2 place(input.view.origin.x + input.view.size.x - 10.0f * input.scale,
                       input.view.origin.y + 14.0f * input.scale + ImGui::GetFrameHeight());
    const ImVec2 size =
        drawPlate(ImGui::GetWindowDrawList(), place, ImVec2(1, 0), text.c_str(), Ink::Accent, input.scale);
    ImGui::SetCursorScreenPos(ImVec2(place.x - size.x, place.y));
    ImGui::SetNextItemAllowOverlap();
    if (ImGui::InvisibleButton("Magnifier", size)) reset();
    help(input.context, "The picture is enlarged (Ctrl + wheel). Click: as large as it is");
}

} // namespace ars::ui
