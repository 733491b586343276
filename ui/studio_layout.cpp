#include "ui/studio_state.h"

#include <imgui_internal.h>

#include <algorithm>

namespace ars::ui {
namespace {

/// Share of a length that is so many characters wide, within bounds.
float share(float wanted, float whole, float least, float most) { return std::clamp(wanted / whole, least, most); }

} // namespace

/// Viewport in the middle; what is looked at on the left, what is changed on the right, time below.
void Studio::State::buildLayout(unsigned dock) {
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    const ImVec2 size = viewport->WorkSize;
    const float letter = ImGui::GetFontSize();
    ImGui::DockBuilderRemoveNode(dock);
    ImGui::DockBuilderAddNode(dock, ImGuiDockNodeFlags_DockSpace);
    ImGui::DockBuilderSetNodePos(dock, viewport->WorkPos);
    ImGui::DockBuilderSetNodeSize(dock, size);
    ImGuiID middle = dock, left = 0, right = 0, bottom = 0;
    const float leftWidth = share(letter * 15.5f, size.x, 0.13f, 0.22f) * size.x;
    const float rightWidth = share(letter * 19.5f, size.x, 0.15f, 0.27f) * size.x;
    ImGui::DockBuilderSplitNode(middle, ImGuiDir_Right, rightWidth / size.x, &right, &middle);
    ImGui::DockBuilderSplitNode(middle, ImGuiDir_Left, leftWidth / (size.x - rightWidth), &left, &middle);
    ImGui::DockBuilderSplitNode(middle, ImGuiDir_Down, share(letter * 13.0f, size.y, 0.18f, 0.30f), &bottom, &middle);
    const auto put = [&](ImGuiID node, std::initializer_list<const char*> ids) {
        for (const char* id : ids) {
            if (const Panel* panel = find(id)) ImGui::DockBuilderDockWindow(panel->title(), node);
        }
    };
    put(middle, {"viewport"});
    put(left, {"buffers", "compare"});
    put(right, {"pose", "light", "occlusion", "camera"});
    put(bottom, {"timeline", "output", "training", "history", "performance", "jobs"});
    ImGui::DockBuilderFinish(dock);
    // The first tab of each group lies in front.
    for (ImGuiID node : {left, right, bottom}) {
        if (ImGuiDockNode* built = ImGui::DockBuilderGetNode(node)) {
            const char* front = node == left ? "buffers" : node == right ? "pose" : "timeline";
            if (const Panel* panel = find(front))
                built->SelectedTabId = ImHashStr("#TAB", 0, ImHashStr(panel->title()));
        }
    }
    settings.layout.clear();
    settings.layoutScale = appliedScale;
}

void Studio::State::drawDockSpace() {
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    const ImGuiID dock = ImGui::GetID("Dock");
    const bool usable = viewport->WorkSize.x > 1.0f && viewport->WorkSize.y > 1.0f;
    if (layoutWanted && usable) {
        layoutWanted = false;
        buildLayout(dock);
    }
    // The flags are private to the library still, but say just this.
    constexpr int kFlags =
        static_cast<int>(ImGuiDockNodeFlags_NoWindowMenuButton) | static_cast<int>(ImGuiDockNodeFlags_NoCloseButton);
    ImGui::DockSpaceOverViewport(dock, viewport, kFlags);
}

void Studio::State::scaleLayout(float factor) {
    for (const ImGuiStoragePair& pair : GImGui->DockContext.Nodes.Data) {
        if (auto* node = static_cast<ImGuiDockNode*>(pair.val_p)) {
            node->SizeRef.x *= factor;
            node->SizeRef.y *= factor;
        }
    }
}

void Studio::State::keepLayout() {
    ImGuiIO& io = ImGui::GetIO();
    if (!io.WantSaveIniSettings) return;
    io.WantSaveIniSettings = false;
    std::size_t size = 0;
    const char* text = ImGui::SaveIniSettingsToMemory(&size);
    settings.layout.assign(text, size);
}

} // namespace ars::ui
