#include "ui/look/part_table.h"

#include "engine/rig/body_parts.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/frame_worker.h"
#include "ui/studio.h"

#include <fmt/format.h>

#include <cmath>

namespace ars::ui {

namespace {

constexpr const char* kMirrorNote =
    "Left and right share one radius, as the paper learns them: a change here is mirrored by itself.";

struct PartRow {
    BodyPart part;
    float radiusM, initialM, leastM, mostM;
    bool locked;
    std::string word, label;
};

PartRow partRow(const Document& document, const PartRadii& radii, int index) {
    const auto part = static_cast<BodyPart>(index);
    const auto i = static_cast<std::size_t>(index);
    const float bound = bodyPartInitialRadiusM(part);
    const std::string word(bodyPartName(part));
    return {part,
            radii[i],
            document.occlusion.initial[i],
            kMinRadiusFactor * bound,
            kMaxRadiusFactor * bound,
            document.occlusion.locked[i],
            word,
            wordsOf(word)};
}

void nameCell(StudioContext& context, const PartRow& row, bool selected) {
    const glm::vec3 color = bodyPartColors()[static_cast<std::size_t>(row.part)];
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    const float height = ImGui::GetFrameHeight(), chip = 0.5f * height;
    ImGui::PushStyleVar(ImGuiStyleVar_SelectableTextAlign, ImVec2(0.0f, 0.5f));
    ImGui::SetCursorPosX(ImGui::GetCursorPosX() + chip + ImGui::GetStyle().ItemInnerSpacing.x);
    if (ImGui::Selectable(row.label.c_str(), selected, ImGuiSelectableFlags_None, ImVec2(0.0f, height))) {
        Arguments arguments = Arguments::object();
        if (!selected) arguments["part"] = row.word;
        runFromWidget(context, "view.select_part", arguments);
    }
    ImGui::PopStyleVar();
    help(
        context,
        fmt::format("Selects the {} here and on the body; again to select nothing. {}", row.word, kMirrorNote).c_str());
    const float top = corner.y + 0.5f * (height - chip);
    ImGui::GetWindowDrawList()->AddRectFilled(ImVec2(corner.x, top), ImVec2(corner.x + chip, top + chip),
                                              ImGui::GetColorU32(ImVec4(color.x, color.y, color.z, 1.0f)),
                                              0.25f * chip);
}

void radiusCell(StudioContext& context, const PartRow& row) {
    float radius = row.radiusM;
    ImGui::SetNextItemWidth(-FLT_MIN);
    ImGui::BeginDisabled(row.locked);
    const std::string id = "##" + row.label + " radius";
    if (ImGui::SliderFloat(id.c_str(), &radius, row.leastM, row.mostM, "%.3f m", ImGuiSliderFlags_AlwaysClamp)) {
        runFromWidget(context, "occlusion.radius", {{"part", row.word}, {"metres", radius}});
    }
    ImGui::EndDisabled();
    help(context,
         fmt::format("How far the {} looks for what hides its light. Now {:.3f} m, initially {:.3f} m.\n{}{}", row.word,
                     row.radiusM, row.initialM, row.locked ? "Locked. " : "", kMirrorNote)
             .c_str(),
         "r_g", fmt::format("{:g} .. {:g} m", row.leastM, row.mostM).c_str());
    // The initial value as a tick on the slider: how far one went is seen at a glance.
    const ImVec2 low = ImGui::GetItemRectMin(), high = ImGui::GetItemRectMax();
    const float grab = ImGui::GetStyle().GrabMinSize, pad = 2.0f;
    const float place = (row.initialM - row.leastM) / (row.mostM - row.leastM);
    const float x = std::floor(low.x + pad + 0.5f * grab + place * (high.x - low.x - 2.0f * pad - grab));
    ImVec4 color = mutedColor();
    color.w = 0.9f;
    ImGui::GetWindowDrawList()->AddLine(ImVec2(x, high.y - 4.0f * context.scale), ImVec2(x, high.y),
                                        ImGui::GetColorU32(color), context.scale);
}

void factorCell(StudioContext& context, const PartRow& row) {
    const bool changed = std::fabs(row.radiusM - row.initialM) > 1e-5f;
    ImGui::AlignTextToFramePadding();
    ImGui::PushStyleColor(ImGuiCol_Text, changed ? ImGui::GetStyleColorVec4(ImGuiCol_Text) : mutedColor());
    numberText(context, fmt::format("{:.2f}x", row.initialM > 0.0f ? row.radiusM / row.initialM : 1.0f).c_str());
    ImGui::PopStyleColor();
    help(context, fmt::format("Relative to the initial radius, {:.3f} m.", row.initialM).c_str(), "r_g / r_init");
}

} // namespace

void partTable(StudioContext& context) {
    const PartRadii radii = radiiAt(context.document(), context.session.timeS());
    const float button = ImGui::GetFrameHeight();
    const float name = button + ImGui::CalcTextSize("Shoulder").x;
    const bool wide = ImGui::GetContentRegionAvail().x > 24.0f * ImGui::GetFontSize();
    ImGui::PushStyleVar(ImGuiStyleVar_CellPadding, ImVec2(3.0f * context.scale, 1.0f * context.scale));
    if (!ImGui::BeginTable("Parts", wide ? 6 : 5, ImGuiTableFlags_SizingFixedFit)) {
        ImGui::PopStyleVar();
        return;
    }
    ImGui::TableSetupColumn("Part", ImGuiTableColumnFlags_WidthFixed, name);
    ImGui::TableSetupColumn("Radius", ImGuiTableColumnFlags_WidthStretch);
    if (wide) {
        ImGui::TableSetupColumn("Initial", ImGuiTableColumnFlags_WidthFixed, ImGui::CalcTextSize("0.250 m").x);
    }
    ImGui::TableSetupColumn("Factor", ImGuiTableColumnFlags_WidthFixed, ImGui::CalcTextSize("0.00x ").x);
    ImGui::TableSetupColumn("Lock", ImGuiTableColumnFlags_WidthFixed, button);
    ImGui::TableSetupColumn("Reset", ImGuiTableColumnFlags_WidthFixed, button);
    for (int i = 0; i < kBodyPartCount; ++i) {
        const PartRow row = partRow(context.document(), radii, i);
        const bool selected = context.document().view.selectedPart == i;
        ImGui::TableNextRow();
        if (selected) {
            ImVec4 color = accentColor();
            color.w = 0.14f;
            ImGui::TableSetBgColor(ImGuiTableBgTarget_RowBg0, ImGui::GetColorU32(color));
        }
        ImGui::TableNextColumn();
        nameCell(context, row, selected);
        ImGui::TableNextColumn();
        radiusCell(context, row);
        if (wide) {
            ImGui::TableNextColumn();
            ImGui::AlignTextToFramePadding();
            ImGui::TextColored(mutedColor(), "%.3f m", static_cast<double>(row.initialM));
            help(context, "The initial radius, which reset returns to.", "r_init", "m");
        }
        ImGui::TableNextColumn();
        factorCell(context, row);
        ImGui::TableNextColumn();
        ImGui::PushID(row.label.c_str());
        if (toolButton(row.locked ? icon::kLock : icon::kUnlock,
                       row.locked ? "Unlock. The radius can be changed again"
                                  : "Lock. Scaling and dragging leave it alone",
                       row.locked)) {
            runFromWidget(context, "occlusion.lock", {{"part", row.word}, {"locked", !row.locked}});
        }
        ImGui::TableNextColumn();
        ImGui::BeginDisabled(row.locked || std::fabs(row.radiusM - row.initialM) < 1e-6f);
        if (toolButton(icon::kReset, "Reset. Back to the initial radius")) {
            runFromWidget(context, "occlusion.reset", {{"part", row.word}});
        }
        ImGui::EndDisabled();
        ImGui::PopID();
    }
    ImGui::EndTable();
    ImGui::PopStyleVar();
}

} // namespace ars::ui
