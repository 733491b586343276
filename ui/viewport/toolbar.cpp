#include "ui/viewport/toolbar.h"

#include "ui/studio.h"
#include "ui/viewport/marks.h"
#include "ui/viewport/probe.h"
#include "ui/widgets.h"

#include <fmt/format.h>

#include <array>
#include <string>

namespace ars::ui {

namespace {

constexpr std::array<const char*, 7> kLayoutNames{"Single",     "Side by side", "Split", "Blink",
                                                  "Difference", "Strip",        "Grid"};

void runOnce(StudioContext& context, const char* command, const Arguments& arguments) {
    const Status done = context.session.run(command, arguments);
    if (!done.ok()) context.studio.toast(done.error().describe());
}

void bufferChoice(StudioContext& context) {
    const BufferId shown = context.document().view.buffer;
    ImGui::SetNextItemWidth(ImGui::GetFontSize() * 10.0f);
    if (ImGui::BeginCombo("###Buffer", std::string(bufferInfo(shown).label).c_str(), ImGuiComboFlags_HeightLargest)) {
        for (const BufferInfo& info : bufferCatalogue()) {
            // R+ and R- exist only in training.
            if (info.id == BufferId::RadiusPlus || info.id == BufferId::RadiusMinus) continue;
            if (ImGui::Selectable(std::string(info.label).c_str(), info.id == shown)) {
                runOnce(context, "view.buffer", {{"name", info.name}});
            }
            help(context, std::string(info.help).c_str(), std::string(info.symbol).c_str(),
                 std::string(info.unit).c_str());
        }
        ImGui::EndCombo();
    }
    help(context, std::string(bufferInfo(shown).help).c_str(), std::string(bufferInfo(shown).symbol).c_str());
}

void layoutChoice(StudioContext& context) {
    const auto layout = static_cast<std::size_t>(context.document().view.layout);
    ImGui::SetNextItemWidth(ImGui::GetFontSize() * 7.5f);
    if (ImGui::BeginCombo("###Layout", kLayoutNames[layout], ImGuiComboFlags_HeightLargest)) {
        for (std::size_t i = 0; i < kLayoutNames.size(); ++i) {
            if (ImGui::Selectable(kLayoutNames[i], i == layout)) {
                runOnce(context, "view.layout", {{"layout", std::string(EnumWords<ViewLayout>::words[i])}});
            }
        }
        ImGui::EndCombo();
    }
    help(context, "One picture, two that are compared, or many buffers at once");
}

void toggle(StudioContext& context, const char* icon, const char* text, bool on, const char* command) {
    ImGui::SameLine(0.0f, 2.0f * context.scale);
    if (toolButton(icon, text, on)) runOnce(context, command, {{"enabled", !on}});
}

void datasetCameras(StudioContext& context) {
    const CameraSection& camera = context.document().camera;
    if (camera.capture.empty()) return;
    ImGui::SameLine(0.0f, 10.0f * context.scale);
    if (toolButton(icon::kChevronLeft, "Previous camera of the capture"))
        runOnce(context, "camera.previous_dataset", {});
    ImGui::SameLine(0.0f, 2.0f * context.scale);
    if (toolButton(icon::kChevronRight, "Next camera of the capture")) runOnce(context, "camera.next_dataset", {});
    if (camera.datasetCamera.empty()) return;
    ImGui::SameLine(0.0f, 2.0f * context.scale);
    if (toolButton(icon::kClose, "Leave the capture's camera")) runOnce(context, "camera.leave_dataset", {});
}

} // namespace

float drawViewportToolbar(StudioContext& context) {
    const ViewSection& view = context.document().view;
    const float gap = 6.0f * context.scale;
    const float height = ImGui::GetFrameHeight() + 2.0f * gap;
    const ImVec2 start = ImGui::GetCursorScreenPos();
    ImGui::SetCursorScreenPos(ImVec2(start.x + gap, start.y + gap));
    bufferChoice(context);
    ImGui::SameLine(0.0f, gap);
    layoutChoice(context);
    datasetCameras(context);
    ImGui::SameLine(0.0f, 8.0f * context.scale);
    ImGui::Dummy(ImVec2(0.0f, 0.0f));
    toggle(context, icon::kGrid, "Grid: the floor in metres and tenths", view.grid, "view.grid");
    toggle(context, icon::kBone, "Skeleton: bones and joints over the picture", view.skeleton, "view.skeleton");
    toggle(context, icon::kPalette, "Parts: the nine parts painted over the body", view.parts, "view.parts");
    toggle(context, icon::kRing, "Spheres: the occlusion radius at every joint; drag a rim to change it",
           view.radiusSpheres, "view.radius_spheres");
    toggle(context, icon::kDot, "Discs: surfels as opaque discs", view.surfelDiscs, "view.surfel_discs");
    toggle(context, icon::kContrast, "Legend: range and colours of a data buffer", view.legend, "view.legend");
    ImGui::SameLine(0.0f, 2.0f * context.scale);
    if (toolButton(icon::kEyedropper, "Values: numbers of all buffers beside the cursor (V)", probePinned())) {
        pinProbe(!probePinned());
    }
    return height;
}

} // namespace ars::ui
