#include "ui/viewport/marks.h"

#include "ui/studio.h"
#include "ui/widgets.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace ars::ui {

namespace {

ImU32 colorOf(Ink ink) { return ImGui::GetColorU32(inkColor(ink)); }

} // namespace

std::string qualityText(const Frame& frame) {
    const Camera& camera = frame.inputs.camera;
    std::string text;
    switch (frame.quality) {
    case FrameQuality::Draft:
        text = fmt::format("draft {}x{}", camera.width, camera.height);
        break;
    case FrameQuality::Refining:
        text = fmt::format("refining {:.0f} %", 100.0f * frame.occlusionShare);
        break;
    case FrameQuality::Full:
        text = "full";
        break;
    }
    if (frame.light && frame.light->quality == LightQuality::Draft) text += "  \xc2\xb7  draft light";
    return text;
}

void drawBadge(const ViewportInput& input) {
    if (!input.frame) return;
    const std::string text = qualityText(*input.frame);
    const float margin = 10.0f * input.scale;
    const ImVec2 corner(input.view.origin.x + input.view.size.x - margin, input.view.origin.y + margin);
    const Ink ink = input.frame->quality == FrameQuality::Draft ? Ink::Accent : Ink::Muted;
    drawPlate(ImGui::GetWindowDrawList(), corner, ImVec2(1, 0), text.c_str(), ink, input.scale);
}

std::string bufferLabel(BufferId buffer) {
    const BufferInfo& info = bufferInfo(buffer);
    return info.symbol.empty() ? std::string(info.label) : fmt::format("{}  {}", info.label, info.symbol);
}

void drawLabel(const PictureView& view, float scale, const std::string& text) {
    const float margin = 10.0f * scale;
    drawPlate(ImGui::GetWindowDrawList(), ImVec2(view.origin.x + margin, view.origin.y + margin), ImVec2(0, 0),
              text.c_str(), Ink::Text, scale);
}

void drawAxes(const ViewportInput& input) {
    struct Tip {
        double depth;
        int axis;
        ImVec2 at;
    };
    constexpr ImU32 colors[3] = {IM_COL32(216, 98, 92, 255), IM_COL32(128, 184, 96, 255), IM_COL32(92, 142, 216, 255)};
    constexpr const char* names[3] = {"x", "y", "z"};
    constexpr const char* presets[3] = {"left", "top", "front"};
    const float length = 24.0f * input.scale, margin = 38.0f * input.scale;
    const ImVec2 center(input.view.origin.x + margin, input.view.origin.y + input.view.size.y - margin);
    std::array<Tip, 3> tips;
    for (int axis = 0; axis < 3; ++axis) {
        const glm::dvec3 d = input.view.camera.rotation[axis]; // the world's axis in camera space
        tips[static_cast<std::size_t>(axis)] = {
            d.z, axis,
            ImVec2(center.x + length * static_cast<float>(d.x), center.y + length * static_cast<float>(d.y))};
    }
    std::sort(tips.begin(), tips.end(), [](const Tip& a, const Tip& b) { return a.depth > b.depth; });
    ImDrawList* list = ImGui::GetWindowDrawList();
    const float radius = 7.5f * input.scale;
    for (const Tip& tip : tips) {
        ImGui::SetCursorScreenPos(ImVec2(tip.at.x - radius, tip.at.y - radius));
        ImGui::SetNextItemAllowOverlap();
        const std::string id = fmt::format("Axis {}", names[tip.axis]);
        if (ImGui::InvisibleButton(id.c_str(), ImVec2(2 * radius, 2 * radius))) {
            const Status done = input.context.session.run("camera.preset", {{"name", presets[tip.axis]}});
            if (!done.ok()) input.context.studio.toast(done.error().describe());
        }
        help(input.context, tip.axis == 0   ? "Look at the body's left side"
                            : tip.axis == 1 ? "Look from above"
                                            : "Look at the front");
        const ImU32 color = colors[tip.axis];
        list->AddLine(center, tip.at, color, 1.6f * input.scale);
        list->AddCircleFilled(tip.at, ImGui::IsItemHovered() ? 1.2f * radius : radius, color);
        const ImVec2 size = ImGui::CalcTextSize(names[tip.axis]);
        list->AddText(ImVec2(std::floor(tip.at.x - 0.5f * size.x), std::floor(tip.at.y - 0.54f * size.y)),
                      IM_COL32(20, 20, 22, 255), names[tip.axis]);
    }
}

void drawProbe(const ViewportInput& input, const ViewportProbe& probe) {
    if (!probe.inside) return;
    ImFont* font = input.context.studio.monospaced();
    if (font) ImGui::PushFont(font, 0.0f);
    struct Line {
        std::string name, text, unit;
    };
    std::vector<Line> lines;
    for (const ProbeValue& value : probe.values) {
        const BufferInfo& info = bufferInfo(value.buffer);
        lines.push_back({std::string(info.label), probe.covered ? probeText(value) : "-", std::string(info.unit)});
    }
    std::string head = fmt::format("pixel {}, {}", probe.column, probe.row);
    if (!probe.jointName.empty()) head += fmt::format("   {} / {}", probe.jointName, probe.partName);
    const float row = ImGui::GetTextLineHeight() * 1.2f, pad = 9.0f * input.scale, gap = 14.0f * input.scale;
    float names = 0.0f, texts = 0.0f, units = 0.0f;
    for (const Line& line : lines) {
        names = std::max(names, ImGui::CalcTextSize(line.name.c_str()).x);
        texts = std::max(texts, ImGui::CalcTextSize(line.text.c_str()).x);
        units = std::max(units, ImGui::CalcTextSize(line.unit.c_str()).x);
    }
    const float width =
        std::max(names + gap + texts + (units > 0 ? 0.5f * gap + units : 0.0f), ImGui::CalcTextSize(head.c_str()).x) +
        2 * pad;
    const float height = row * static_cast<float>(lines.size() + 1) + 2 * pad;
    // Beside the cursor, on the side that has room.
    ImVec2 low(input.mouse.x + 20.0f * input.scale, input.mouse.y + 12.0f * input.scale);
    const ImVec2 end(input.view.origin.x + input.view.size.x, input.view.origin.y + input.view.size.y);
    if (low.x + width > end.x) low.x = std::max(input.mouse.x - 20.0f * input.scale - width, input.view.origin.x);
    if (low.y + height > end.y) low.y = std::max(end.y - height, input.view.origin.y);
    ImDrawList* list = ImGui::GetWindowDrawList();
    list->AddRectFilled(low, ImVec2(low.x + width, low.y + height), ImGui::GetColorU32(plateColor()),
                        5.0f * input.scale);
    const float x = std::floor(low.x + pad);
    float y = std::floor(low.y + pad);
    list->AddText(ImVec2(x, y), colorOf(Ink::Accent), head.c_str());
    for (const Line& line : lines) {
        y += row;
        list->AddText(ImVec2(x, std::floor(y)), colorOf(Ink::Muted), line.name.c_str());
        list->AddText(ImVec2(x + names + gap, std::floor(y)), colorOf(Ink::Text), line.text.c_str());
        list->AddText(ImVec2(x + names + 1.5f * gap + texts, std::floor(y)), colorOf(Ink::Muted), line.unit.c_str());
    }
    if (font) ImGui::PopFont();
}

void drawNotice(const PictureView& view, float scale, const std::string& text) {
    const ImVec2 center(view.origin.x + 0.5f * view.size.x, view.origin.y + 0.5f * view.size.y);
    drawPlate(ImGui::GetWindowDrawList(), center, ImVec2(0.5f, 0.5f), text.c_str(), Ink::Muted, scale);
}

} // namespace ars::ui
