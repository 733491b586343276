#include "ui/look/buffer_pictures.h"
#include "ui/look/buffer_range.h"
#include "ui/look/controls.h"
#include "ui/look/picture_cache.h"
#include "ui/panel.h"
#include "ui/studio.h"
#include "ui/viewport/probe.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

namespace ars::ui {

namespace {

/// In the order of ViewLayout.
constexpr std::array<Choice, 7> kLayouts{{
    {"Single", "One buffer."},
    {"Side by side", "The buffer and the other side of the comparison, left and right."},
    {"Split", "Both in one picture, divided by a line that is dragged."},
    {"Blink", "Both in turn."},
    {"Difference", "The error between both, as a map."},
    {"Strip", "One large, and a strip of thumbnails below."},
    {"Grid", "The buffers of the strip in equal tiles."},
}};

bool needsTrainingRadii(BufferId buffer) { return buffer == BufferId::RadiusPlus || buffer == BufferId::RadiusMinus; }

class BuffersPanel : public Panel {
public:
    const char* id() const override { return "buffers"; }
    const char* title() const override { return "Buffers"; }
    const char* help() const override {
        return "Every picture behind the picture: which is shown, its range and its numbers.";
    }
    void draw(StudioContext& context) override;

private:
    void drawLayout(StudioContext& context);
    void drawCatalogue(StudioContext& context);
    void drawRow(StudioContext& context, const BufferInfo& info, const std::string& value);
    void drawStripBox(StudioContext& context, const BufferInfo& info);
    void drawCursor(StudioContext& context);

    BufferThumbnails thumbnails_;
    BufferRange range_;
};

void BuffersPanel::draw(StudioContext& context) {
    thumbnails_.update(context.document(), context.session.frame());
    drawLayout(context);
    if (ImGui::CollapsingHeader("Shown buffer", ImGuiTreeNodeFlags_DefaultOpen)) range_.draw(context);
    if (ImGui::CollapsingHeader("Catalogue", ImGuiTreeNodeFlags_DefaultOpen)) {
        wantProbe();
        drawCatalogue(context);
    }
}

void BuffersPanel::drawLayout(StudioContext& context) {
    const ViewLayout layout = context.document().view.layout;
    if (const auto clicked = choiceButtons(context, "Layout", kLayouts, static_cast<int>(layout))) {
        runFromWidget(context, "view.layout",
                      {{"layout", std::string(EnumWords<ViewLayout>::words[static_cast<std::size_t>(*clicked)])}});
    }
}

/// Where the cursor is; the numbers themselves stand in the rows.
void BuffersPanel::drawCursor(StudioContext& context) {
    const ViewportProbe& probe = viewportProbe();
    std::string text = "Point at the picture to read it.";
    if (probe.inside) {
        text = fmt::format("Pixel {}, {}", probe.column, probe.row);
        if (!probe.jointName.empty()) text += fmt::format("  {}", wordsOf(probe.jointName));
        if (!probe.partName.empty()) text += fmt::format(" ({})", probe.partName);
        if (!probe.covered) text += "  background";
    }
    hint(fitted(text, ImGui::GetContentRegionAvail().x).c_str());
    ui::help(context, "The pixel of the frame under the cursor, and the joint and part whose skin it is.");
}

namespace {

/// Numbers short enough for a row: vectors and colours with two decimals, alpha left out (opacity has its own row). The
/// table beside the cursor has them all.
std::string rowNumbers(const ProbeValue& read) {
    if (read.channels == 1) return probeText(read);
    std::string text;
    for (int c = 0; c < std::min(read.channels, 3); ++c) {
        text += fmt::format("{}{:.2f}", c > 0 ? " " : "", read.values[static_cast<std::size_t>(c)]);
    }
    return text;
}

} // namespace

void BuffersPanel::drawCatalogue(StudioContext& context) {
    drawCursor(context);
    const ViewportProbe& probe = viewportProbe();
    for (const BufferInfo& info : bufferCatalogue()) {
        std::string value;
        for (const ProbeValue& read : probe.values) {
            if (probe.inside && read.buffer == info.id) value = rowNumbers(read);
        }
        drawRow(context, info, value);
    }
    hint("Ticked buffers stand in the strip and in the grid.");
}

void BuffersPanel::drawRow(StudioContext& context, const BufferInfo& info, const std::string& value) {
    const bool shown = context.document().view.buffer == info.id;
    const float height = std::floor(1.75f * ImGui::GetTextLineHeight()), picture = std::floor(height * 4.0f / 3.0f);
    const float gap = ImGui::GetStyle().ItemInnerSpacing.x;
    const float box = ImGui::GetFrameHeight() + gap;
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    const float width = ImGui::GetContentRegionAvail().x - box;
    const bool clicked = ImGui::Selectable(fmt::format("###{}", info.label).c_str(), shown, ImGuiSelectableFlags_None,
                                           ImVec2(width, height));
    std::string tooltip(info.help);
    if (needsTrainingRadii(info.id)) tooltip += ". Computed where \"training radii\" is on (Occlusion panel).";
    ui::help(context, tooltip.c_str(), info.symbol.empty() ? nullptr : std::string(info.symbol).c_str(),
             info.unit.empty() ? nullptr : std::string(info.unit).c_str());
    if (clicked) runFromWidget(context, "view.buffer", {{"name", std::string(info.name)}});

    ImDrawList* draw = ImGui::GetWindowDrawList();
    const ImVec2 end(corner.x + picture, corner.y + height);
    if (const Texture* texture = thumbnails_.find(info.id)) {
        // Cut to 4:3 about the middle, whatever the window's shape.
        const float aspect = static_cast<float>(texture->width()) / static_cast<float>(std::max(texture->height(), 1));
        const float wide = std::min(1.0f, (4.0f / 3.0f) / aspect), tall = std::min(1.0f, aspect / (4.0f / 3.0f));
        draw->AddImage(textureOf(*texture), corner, end, ImVec2(0.5f - 0.5f * wide, 0.5f - 0.5f * tall),
                       ImVec2(0.5f + 0.5f * wide, 0.5f + 0.5f * tall));
    } else {
        draw->AddRectFilled(corner, end, ImGui::GetColorU32(ImGuiCol_FrameBg));
    }
    if (shown) draw->AddRect(corner, end, ImGui::GetColorU32(accentColor()), 0.0f, 0, 1.5f * context.scale);

    const float textTop = corner.y + 0.5f * (height - ImGui::GetTextLineHeight());
    const std::string right = value.empty() ? std::string(info.symbol) : value;
    ImFont* font = value.empty() ? ImGui::GetFont() : context.studio.monospaced();
    ImGui::PushFont(font, value.empty() ? 0.0f : 0.9f * ImGui::GetStyle().FontSizeBase);
    const float rightWidth = ImGui::CalcTextSize(right.c_str()).x;
    draw->AddText(ImVec2(corner.x + width - rightWidth - 0.5f * gap, textTop),
                  ImGui::GetColorU32(value.empty() ? mutedColor() : ImGui::GetStyleColorVec4(ImGuiCol_Text)),
                  right.c_str());
    ImGui::PopFont();
    const float left = end.x + gap;
    const std::string label = fitted(info.label, corner.x + width - rightWidth - 1.5f * gap - left);
    draw->AddText(ImVec2(left, textTop), ImGui::GetColorU32(ImGuiCol_Text), label.c_str());
    ImGui::SameLine(0.0f, gap);
    ImGui::SetCursorPosY(ImGui::GetCursorPosY() + 0.5f * (height - ImGui::GetFrameHeight()));
    drawStripBox(context, info);
}

void BuffersPanel::drawStripBox(StudioContext& context, const BufferInfo& info) {
    std::vector<BufferId> strip = context.document().view.strip;
    const auto found = std::find(strip.begin(), strip.end(), info.id);
    bool inStrip = found != strip.end();
    const bool last = inStrip && strip.size() == 1;
    ImGui::BeginDisabled(last);
    if (ImGui::Checkbox(fmt::format("###Strip {}", info.label).c_str(), &inStrip)) {
        if (inStrip) {
            strip.push_back(info.id);
        } else {
            strip.erase(found);
        }
        // In the catalogue's order, so that a tile keeps its place when it comes back.
        std::sort(strip.begin(), strip.end());
        std::string names;
        for (const BufferId id : strip) names += fmt::format("{}{}", names.empty() ? "" : ",", bufferInfo(id).name);
        runFromWidget(context, "view.strip", {{"buffers", names}});
    }
    ImGui::EndDisabled();
    ui::help(context,
             last ? "The last one stays: a strip needs a picture." : "Whether it stands in the strip and in the grid.");
}

} // namespace

std::unique_ptr<Panel> makeBuffersPanel() { return std::make_unique<BuffersPanel>(); }

} // namespace ars::ui
