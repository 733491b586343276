#include "engine/frame/occlusion_stage.h"
#include "engine/scene/setting_groups.h"
#include "ui/look/controls.h"
#include "ui/look/part_table.h"
#include "ui/panel.h"

#include <fmt/format.h>

#include <array>

namespace ars::ui {

namespace {

struct MethodText {
    const char* label;
    const char* help;
    const char* pace; ///< how long a person waits for it
};

/// In the order of OcclusionMethod.
constexpr std::array<MethodText, 5> kMethods{{
    {"Screen space", "The paper's: rays through the depth map within the radius of each part.",
     "Live. A draft while something moves, all directions at rest."},
    {"Mesh rays", "Rays against the posed mesh within the same radii: the reference to judge by.",
     "Slow: a second or so for every picture."},
    {"RAGA", "Visibility of the posed mesh from 512 directions, without a radius (comparison).",
     "Slow: the mesh is drawn 512 times for every pose."},
    {"GS-IR", "Baked once around the canonical body, so it does not follow the pose (comparison).",
     "Bakes for some seconds, then it is live."},
    {"Off", "No occlusion: all light arrives everywhere.", "Live."},
}};

class OcclusionPanel : public Panel {
public:
    const char* id() const override { return "occlusion"; }
    const char* title() const override { return "Occlusion"; }
    const char* help() const override {
        return "Ambient occlusion: the radius of each body part, and how it is computed.";
    }
    void draw(StudioContext& context) override;

private:
    void drawRadii(StudioContext& context);
    void drawShow(StudioContext& context);
    void drawMethod(StudioContext& context);
};

void OcclusionPanel::draw(StudioContext& context) {
    drawShow(context);
    if (ImGui::CollapsingHeader("Radii", ImGuiTreeNodeFlags_DefaultOpen)) drawRadii(context);
    if (ImGui::CollapsingHeader("Method", ImGuiTreeNodeFlags_DefaultOpen)) drawMethod(context);
    const OcclusionSection& occlusion = context.document().occlusion;
    if (ImGui::CollapsingHeader("Shading", ImGuiTreeNodeFlags_DefaultOpen)) {
        parameterRows(context, "shading", shadingParameters(), occlusion.shading);
    }
    if (ImGui::CollapsingHeader("Importance and radii of surfels")) {
        hint("How radius and importance go from the joints to the surfels (R, I).");
        parameterRows(context, "posing", poseSurfelsParameters(), occlusion.posing);
    }
}

/// Which map of the occlusion is looked at, and what is painted on the body.
void OcclusionPanel::drawShow(StudioContext& context) {
    static constexpr std::array<Choice, 4> maps{
        {{"Shaded", "The relit picture."},
         {"AO", "Ambient occlusion O: share of the hemisphere that is open."},
         {"Radius", "The radius map R, blended from the nine parts."},
         {"Importance", "The importance map I: where more directions are taken."}}};
    static constexpr std::array<BufferId, 4> buffers{BufferId::Beauty, BufferId::AmbientOcclusion, BufferId::Radius,
                                                     BufferId::Importance};
    int current = -1;
    for (int i = 0; i < 4; ++i) {
        if (buffers[static_cast<std::size_t>(i)] == context.document().view.buffer) current = i;
    }
    if (const auto clicked = choiceButtons(context, "Show", maps, current)) {
        const BufferInfo& info = bufferInfo(buffers[static_cast<std::size_t>(*clicked)]);
        runFromWidget(context, "view.buffer", {{"name", std::string(info.name)}});
    }
    const ViewSection& view = context.document().view;
    toggle(context, "Parts", "view.parts", view.parts,
           "Paints the nine parts over the body, in the colours of the list.");
    sameLineIfFits(ImGui::CalcTextSize("Spheres").x + ImGui::GetFrameHeight() * 1.5f);
    toggle(context, "Spheres", "view.radius_spheres", context.document().view.radiusSpheres,
           "A sphere of radius r_g at the joints of every part; drag one in the viewport to change its radius.");
}

void OcclusionPanel::drawRadii(StudioContext& context) {
    partTable(context);
    const float share = shareOfRow(3);
    commandButton(context, "Reset all", "occlusion.reset", "Every unlocked part back to its initial radius.",
                  Arguments::object(), share);
    ImGui::SameLine();
    commandButton(context, "-10 %", "occlusion.scale", "Every unlocked radius a tenth smaller.", {{"factor", 0.9}},
                  share);
    ImGui::SameLine();
    commandButton(context, "+10 %", "occlusion.scale", "Every unlocked radius a tenth larger.", {{"factor", 1.1}},
                  share);
}

void OcclusionPanel::drawMethod(StudioContext& context) {
    const OcclusionSettings& settings = context.document().occlusion.settings;
    const auto method = static_cast<std::size_t>(settings.method);
    std::array<Choice, kMethods.size()> choices;
    for (std::size_t i = 0; i < kMethods.size(); ++i) choices[i] = {kMethods[i].label, kMethods[i].help};
    if (const auto clicked = choiceButtons(context, "Method", choices, static_cast<int>(method))) {
        const auto word = EnumWords<OcclusionMethod>::words[static_cast<std::size_t>(*clicked)];
        runFromWidget(context, "occlusion.method", {{"name", std::string(word)}});
    }
    hint(kMethods[method].help);
    hint(kMethods[method].pace);
    const OcclusionSettings& now = context.document().occlusion.settings;
    switch (now.method) {
    case OcclusionMethod::ScreenSpace: {
        rowLabel("Preset", "Sets all rows below at once.");
        const float share = shareOfRow(2);
        commandButton(context, "Body", "occlusion.preset",
                      "For bodies: all 16 steps of a ray, hidden only R/100 or more behind.", {{"name", "body"}},
                      share);
        ImGui::SameLine();
        commandButton(context, "Reference", "occlusion.preset", "The constants of GI-GS, as published.",
                      {{"name", "reference"}}, share);
        parameterRows(context, "occlusion", occlusionParameters(), now.screenSpace);
        break;
    }
    case OcclusionMethod::MeshRays:
        parameterRows(context, "mesh_rays", meshOcclusionParameters(), now.meshRays);
        break;
    case OcclusionMethod::Rasterised:
        parameterRows(context, "rasterised", rasterisedVisibilityParameters(), now.rasterised);
        break;
    case OcclusionMethod::Baked:
        parameterRows(context, "baked", bakedVisibilityParameters(), now.baked);
        break;
    case OcclusionMethod::Off:
        break;
    }
}

} // namespace

std::unique_ptr<Panel> makeOcclusionPanel() { return std::make_unique<OcclusionPanel>(); }

} // namespace ars::ui
