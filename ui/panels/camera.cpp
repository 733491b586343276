#include "engine/io/image.h"
#include "engine/scene/evaluate.h"
#include "ui/look/capture_list.h"
#include "ui/look/controls.h"
#include "ui/panel.h"
#include "ui/studio.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <vector>

namespace ars::ui {

namespace {

class CameraPanel : public Panel {
public:
    const char* id() const override { return "camera"; }
    const char* title() const override { return "Camera"; }
    const char* help() const override {
        return "Where the picture is taken from, exposure and overlays, dataset cameras.";
    }
    void draw(StudioContext& context) override;

private:
    void drawViews(StudioContext& context);
    void drawNumbers(StudioContext& context);
    void drawTone(StudioContext& context);
    void drawOverlays(StudioContext& context);

    CaptureList captures_;
};

void CameraPanel::draw(StudioContext& context) {
    drawViews(context);
    if (ImGui::CollapsingHeader("Placement", ImGuiTreeNodeFlags_DefaultOpen)) drawNumbers(context);
    if (ImGui::CollapsingHeader("Dataset cameras", ImGuiTreeNodeFlags_DefaultOpen)) captures_.draw(context);
    if (ImGui::CollapsingHeader("Exposure and tone", ImGuiTreeNodeFlags_DefaultOpen)) drawTone(context);
    if (ImGui::CollapsingHeader("Overlays", ImGuiTreeNodeFlags_DefaultOpen)) drawOverlays(context);
}

/// The presets that the command knows, in its order.
void CameraPanel::drawViews(StudioContext& context) {
    const Command* command = findCommand("camera.preset");
    if (!command || command->arguments.empty()) return;
    const std::vector<std::string>& names = command->arguments[0].info.choices;
    std::vector<std::string> labels;
    for (const std::string& name : names) labels.push_back(wordsOf(name));
    std::vector<Choice> choices;
    for (const std::string& label : labels) choices.push_back({label.c_str(), "Looks at the body from there."});
    if (const auto clicked = choiceButtons(context, "View", choices, -1)) {
        runFromWidget(context, "camera.preset", {{"name", names[static_cast<std::size_t>(*clicked)]}});
    }
    const float share = shareOfRow(2);
    commandButton(context, "Focus", "camera.focus",
                  "Moves the camera so that the selected joint, or the whole body, fills the picture (F).",
                  Arguments::object(), share);
    ImGui::SameLine();
    commandButton(context, "Reset camera", "camera.reset", "Back to where a new project starts.", Arguments::object(),
                  share);
}

bool placeRow(const StudioContext& context, const char* label, const char* tooltip, glm::dvec3& place) {
    rowLabel(label, tooltip);
    const std::string id = fmt::format("##{}", label);
    const bool changed =
        ImGui::DragScalarN(id.c_str(), ImGuiDataType_Double, &place.x, 3, 0.005f, nullptr, nullptr, "%.2f");
    help(context, tooltip, nullptr, "metres; x to the body's left, y up, z to its front");
    return changed;
}

void CameraPanel::drawNumbers(StudioContext& context) {
    const bool dataset = !context.document().camera.datasetCamera.empty();
    if (dataset) hint("The numbers are those of the free camera; a dataset camera is looked through now.");
    SceneCamera camera = cameraAt(context.document(), context.session.timeS());
    bool changed = placeRow(context, "Eye", "Where the camera stands.", camera.eye);
    changed |= placeRow(context, "Target", "What it looks at, and what orbiting turns about.", camera.target);
    const Command* command = findCommand("camera.set");
    const auto number = [&](const char* argument, const char* label, double& value) {
        if (!command) return;
        for (const CommandArgument& a : command->arguments) {
            if (a.info.name != argument) continue;
            ParameterInfo info = a.info;
            info.name = label;
            ParameterValue edited = value;
            if (!parameterRow(context, info, edited)) continue;
            if (const double* typed = std::get_if<double>(&edited)) value = *typed;
            changed = true;
        }
    };
    number("field", "Field of view", camera.verticalFieldDeg);
    number("roll", "Roll", camera.rollDeg);
    if (!changed) return;
    runFromWidget(context, "camera.set",
                  {{"eye_x", camera.eye.x},
                   {"eye_y", camera.eye.y},
                   {"eye_z", camera.eye.z},
                   {"target_x", camera.target.x},
                   {"target_y", camera.target.y},
                   {"target_z", camera.target.z},
                   {"roll", camera.rollDeg},
                   {"field", camera.verticalFieldDeg}});
}

void CameraPanel::drawTone(StudioContext& context) {
    commandRow(context, "view.exposure", "ev", "Exposure",
               static_cast<double>(context.document().view.tone.exposureEv));
    static constexpr std::array<Choice, 3> curves{{{"None", "Clamps: the one in which pictures are compared."},
                                                   {"ACES", "Film-like, with strong contrast."},
                                                   {"AgX", "Soft highlights that keep their colour."}}};
    const ToneParams& tone = context.document().view.tone;
    rowLabel("Tone curve", "How bright light is brought onto the screen.");
    if (const auto clicked = choiceButtons(context, "Tone curve", curves, static_cast<int>(tone.curve))) {
        runFromWidget(context, "view.tone_curve",
                      {{"curve", std::string(EnumWords<ToneCurve>::words[static_cast<std::size_t>(*clicked)])}});
    }
    const ToneParams& now = context.document().view.tone;
    float color[3] = {linearToSrgb(now.backgroundRed), linearToSrgb(now.backgroundGreen),
                      linearToSrgb(now.backgroundBlue)};
    rowLabel("Background", "Colour behind the body where no environment is shown.");
    if (ImGui::ColorEdit3("##Background", color, ImGuiColorEditFlags_DisplayRGB | ImGuiColorEditFlags_PickerHueWheel)) {
        runFromWidget(context, "view.background", {{"red", color[0]}, {"green", color[1]}, {"blue", color[2]}});
    }
    ui::help(context, "Colour behind the body where no environment is shown; exposure does not change it.", nullptr,
             "sRGB");
}

void CameraPanel::drawOverlays(StudioContext& context) {
    struct Row {
        const char* label;
        const char* command;
        bool ViewSection::* value;
        const char* tooltip;
    };
    static constexpr std::array<Row, 6> rows{{
        {"Floor grid", "view.grid", &ViewSection::grid, "A grid of one metre on the floor."},
        {"Skeleton", "view.skeleton", &ViewSection::skeleton, "Bones and joints over the body."},
        {"Body parts", "view.parts", &ViewSection::parts, "The nine parts painted over the body."},
        {"Radius spheres", "view.radius_spheres", &ViewSection::radiusSpheres,
         "A sphere of radius r_g at the joints of every part."},
        {"Surfel discs", "view.surfel_discs", &ViewSection::surfelDiscs,
         "Surfels as opaque discs instead of the splatted picture."},
        {"Legend", "view.legend", &ViewSection::legend, "Range and colour map of a data buffer in the viewport."},
    }};
    const bool two = ImGui::GetContentRegionAvail().x > 17.0f * ImGui::GetFontSize();
    const float half = ImGui::GetCursorPosX() + 0.5f * ImGui::GetContentRegionAvail().x;
    for (std::size_t i = 0; i < rows.size(); ++i) {
        if (two && i % 2 == 1) ImGui::SameLine(half);
        toggle(context, rows[i].label, rows[i].command, context.document().view.*rows[i].value, rows[i].tooltip);
    }
}

} // namespace

std::unique_ptr<Panel> makeCameraPanel() { return std::make_unique<CameraPanel>(); }

} // namespace ars::ui
