#include "ui/pose/pose_grid.h"

#include "engine/scene/project.h"
#include "ui/studio.h"
#include "ui/widgets.h"

#include <imgui.h>
#include <misc/cpp/imgui_stdlib.h>

#include <algorithm>
#include <filesystem>

namespace ars::ui {
namespace {

constexpr float kTileWidth = 68.0f; ///< design pixels
constexpr float kTileAspect = static_cast<float>(kThumbnailHeight) / kThumbnailWidth;

/// As much of a text as fits, with dots where it was cut.
std::string shortened(const std::string& text, float width) {
    if (ImGui::CalcTextSize(text.c_str()).x <= width) return text;
    std::string cut = text;
    while (!cut.empty() && ImGui::CalcTextSize((cut + "\xe2\x80\xa6").c_str()).x > width) {
        do {
            cut.pop_back();
        } while (!cut.empty() && (static_cast<unsigned char>(cut.back()) & 0xC0u) == 0x80u);
    }
    return cut + "\xe2\x80\xa6";
}

void drawFigure(const ImVec2& low, const ImVec2& high, ImU32 color) {
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const float w = high.x - low.x;
    const ImVec2 c(0.5f * (low.x + high.x), low.y + 0.36f * (high.y - low.y));
    draw->AddCircle(ImVec2(c.x, c.y - 0.16f * w), 0.09f * w, color);
    draw->AddLine(ImVec2(c.x, c.y - 0.07f * w), ImVec2(c.x, c.y + 0.25f * w), color);
    draw->AddLine(ImVec2(c.x - 0.2f * w, c.y + 0.02f * w), ImVec2(c.x + 0.2f * w, c.y + 0.02f * w), color);
    draw->AddLine(ImVec2(c.x, c.y + 0.25f * w), ImVec2(c.x - 0.13f * w, c.y + 0.55f * w), color);
    draw->AddLine(ImVec2(c.x, c.y + 0.25f * w), ImVec2(c.x + 0.13f * w, c.y + 0.55f * w), color);
}

} // namespace

void PoseGrid::refresh(StudioContext& context, const PoseReading& reading) {
    if (!thumbnails_) thumbnails_ = std::make_unique<Thumbnails>(stateFolder() / "thumbnails");
    const bool shownAgain = ImGui::GetFrameCount() > lastFrame_ + 1;
    lastFrame_ = ImGui::GetFrameCount();
    const std::string& source = context.document().avatar.source;
    if (!stale_ && !shownAgain && names_ == reading.skeleton->names && source_ == source) return;
    stale_ = false;
    names_ = reading.skeleton->names;
    source_ = source;
    items_.clear();
    for (PoseLibraryEntry& entry : poseLibrary()) {
        Item item;
        if (Result<NamedPose> pose = libraryPose(entry.name, *reading.skeleton)) {
            item.pose = std::move(pose->pose);
            item.key = thumbnailKey(source, item.pose);
        } else {
            item.problem = pose.error().describe();
        }
        item.entry = std::move(entry);
        items_.push_back(std::move(item));
    }
}

void PoseGrid::draw(StudioContext& context, const PoseReading& reading, float blend) {
    refresh(context, reading);
    std::vector<ThumbnailWish> wishes;
    for (const Item& item : items_) {
        if (item.problem.empty()) wishes.push_back({item.key, item.pose});
    }
    thumbnails_->update(context.session, wishes);

    const float gap = 5.0f * context.scale;
    const float available = ImGui::GetContentRegionAvail().x;
    const int columns = std::max(1, static_cast<int>((available + gap) / (kTileWidth * context.scale + gap)));
    const float width = std::floor((available - gap * static_cast<float>(columns - 1)) / static_cast<float>(columns));
    const ImVec2 size(width, std::floor(width * kTileAspect));
    ImGui::PushStyleVar(ImGuiStyleVar_ItemSpacing, ImVec2(gap, gap));
    for (std::size_t i = 0; i < items_.size(); ++i) {
        if (i % static_cast<std::size_t>(columns) != 0) ImGui::SameLine();
        drawItem(context, items_[i], size, blend);
    }
    ImGui::PopStyleVar();
    drawSave(context, reading);
    drawDeletion(context);
}

void PoseGrid::drawItem(StudioContext& context, const Item& item, const ImVec2& size, float blend) {
    const std::string& label = item.entry.label.empty() ? item.entry.name : item.entry.label;
    ImGui::PushID(item.entry.name.c_str());
    const bool pressed = ImGui::InvisibleButton(("###Pose " + item.entry.name).c_str(), size);
    const ImVec2 low = ImGui::GetItemRectMin();
    const ImVec2 high = ImGui::GetItemRectMax();
    const float rounding = ImGui::GetStyle().FrameRounding;
    const bool hovered = ImGui::IsItemHovered();
    ImDrawList* draw = ImGui::GetWindowDrawList();
    draw->AddRectFilled(low, high, ImGui::GetColorU32(hovered ? ImGuiCol_FrameBgHovered : ImGuiCol_FrameBg), rounding);
    if (const Texture* texture = thumbnails_->find(item.key)) {
        draw->AddImageRounded(ImTextureRef(static_cast<ImTextureID>(texture->name())), low, high, ImVec2(0, 0),
                              ImVec2(1, 1), IM_COL32_WHITE, rounding);
    } else {
        drawFigure(low, high, ImGui::GetColorU32(item.problem.empty() ? mutedColor() : badColor()));
    }
    const float band = ImGui::GetFontSize() * 0.86f + 4.0f * context.scale;
    const ImVec4 shade = ImGui::GetStyleColorVec4(ImGuiCol_WindowBg);
    draw->AddRectFilled(ImVec2(low.x, high.y - band), high,
                        ImGui::GetColorU32(ImVec4(shade.x, shade.y, shade.z, 0.72f)), rounding,
                        ImDrawFlags_RoundCornersBottom);
    ImGui::PushFont(nullptr, ImGui::GetStyle().FontSizeBase * 0.86f);
    const std::string text = shortened(label, size.x - 8.0f * context.scale);
    const float textWidth = ImGui::CalcTextSize(text.c_str()).x;
    draw->AddText(ImVec2(0.5f * (low.x + high.x - textWidth), high.y - band + 2.0f * context.scale),
                  ImGui::GetColorU32(ImGuiCol_Text), text.c_str());
    ImGui::PopFont();
    if (hovered) draw->AddRect(low, high, ImGui::GetColorU32(accentColor()), rounding);

    const std::string tip = !item.problem.empty()
                                ? item.problem
                                : fmt::format("{}\nA click takes this pose over{}.{}", label,
                                              blend < 1.0f ? fmt::format(" by {:.0f} %", blend * 100.0f) : "",
                                              item.entry.ownedByUser ? " Right click: delete." : "");
    help(context, tip.c_str());
    if (pressed && item.problem.empty()) {
        runFromWidget(context, "pose.preset", {{"name", item.entry.name}, {"blend", blend}});
    }
    if (ImGui::BeginPopupContextItem("pose menu")) {
        if (ImGui::MenuItem("Apply", nullptr, false, item.problem.empty())) {
            runFromWidget(context, "pose.preset", {{"name", item.entry.name}, {"blend", blend}});
        }
        if (ImGui::MenuItem("Delete", nullptr, false, item.entry.ownedByUser)) deleting_ = item.entry.name;
        ImGui::EndPopup();
    }
    ImGui::PopID();
}

void PoseGrid::drawSave(StudioContext& context, const PoseReading& reading) {
    ImGui::Spacing();
    const float button = ImGui::CalcTextSize("Save pose").x + 2.0f * ImGui::GetStyle().FramePadding.x;
    ImGui::SetNextItemWidth(ImGui::GetContentRegionAvail().x - button - ImGui::GetStyle().ItemInnerSpacing.x);
    ImGui::InputTextWithHint("###Pose name", "Name of this pose", &newName_);
    const bool entered = ImGui::IsItemDeactivated() && ImGui::IsKeyPressed(ImGuiKey_Enter);
    help(context, "The pose on the screen is kept in the library under this name.");
    ImGui::SameLine(0.0f, ImGui::GetStyle().ItemInnerSpacing.x);
    // Never disabled: the field may hand its text over only when this button is pressed.
    const bool pressed = ImGui::Button("Save pose", ImVec2(button, 0.0f));
    if ((!pressed && !entered) || newName_.empty()) return;
    if (const auto saved = saveLibraryPose(newName_, reading.pose, *reading.skeleton); saved) {
        context.studio.toast(fmt::format("Saved the pose \"{}\"", newName_));
        newName_.clear();
        stale_ = true;
    } else {
        context.studio.showError("Could not save the pose", saved.error().describe());
    }
}

void PoseGrid::drawDeletion(StudioContext& context) {
    constexpr const char* title = "Delete pose";
    if (!deleting_.empty() && !ImGui::IsPopupOpen(title)) ImGui::OpenPopup(title);
    if (!ImGui::BeginPopupModal(title, nullptr, ImGuiWindowFlags_AlwaysAutoResize)) return;
    ImGui::Text("Delete \"%s\" from the library? This cannot be undone.", deleting_.c_str());
    ImGui::Spacing();
    if (ImGui::Button("Delete")) {
        const auto item =
            std::find_if(items_.begin(), items_.end(), [this](const Item& one) { return one.entry.name == deleting_; });
        std::error_code error;
        if (item != items_.end() && item->entry.ownedByUser) std::filesystem::remove(item->entry.file, error);
        if (error) context.studio.showError("Could not delete the pose", error.message());
        stale_ = true;
        deleting_.clear();
        ImGui::CloseCurrentPopup();
    }
    ImGui::SameLine();
    if (ImGui::Button("Keep") || ImGui::IsKeyPressed(ImGuiKey_Escape)) {
        deleting_.clear();
        ImGui::CloseCurrentPopup();
    }
    ImGui::EndPopup();
}

} // namespace ars::ui
