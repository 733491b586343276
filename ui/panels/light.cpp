#include "engine/scene/evaluate.h"
#include "ui/look/controls.h"
#include "ui/look/light_library.h"
#include "ui/look/light_map.h"
#include "ui/look/light_rows.h"
#include "ui/panel.h"
#include "ui/studio.h"

#include <array>
#include <cmath>
#include <filesystem>

namespace ars::ui {

namespace {

class LightPanel : public Panel {
public:
    const char* id() const override { return "light"; }
    const char* title() const override { return "Light"; }
    const char* help() const override { return "The environment that lights the body: files, sky, studio lamps."; }
    void draw(StudioContext& context) override;

private:
    void drawKind(StudioContext& context);
    void drawFile(StudioContext& context);
    void drawPlacement(StudioContext& context);
    void drawBackdrop(StudioContext& context);
    void drawTurntable(StudioContext& context);
    void askForFile(StudioContext& context);

    LightMap map_;
    LightLibrary library_;
    SunPlace place_;
    int lamp_ = 0;             ///< whose rows are shown
    double turnSeconds_ = 4.0; ///< of the next turntable
    double turns_ = 1.0;
};

void LightPanel::draw(StudioContext& context) {
    map_.draw(context, lamp_);
    drawPlacement(context);
    if (ImGui::CollapsingHeader("Source", ImGuiTreeNodeFlags_DefaultOpen)) {
        drawKind(context);
        switch (context.document().light.kind) {
        case LightKind::File:
            drawFile(context);
            break;
        case LightKind::Sky:
            skyRows(context, place_);
            break;
        case LightKind::Studio:
            studioRows(context, lamp_);
            break;
        case LightKind::Uniform:
            commandRow(context, "light.uniform", "radiance", "Radiance", context.document().light.uniformRadiance);
            break;
        }
    }
    if (ImGui::CollapsingHeader("Library", ImGuiTreeNodeFlags_DefaultOpen)) library_.draw(context);
    if (ImGui::CollapsingHeader("Backdrop", ImGuiTreeNodeFlags_DefaultOpen)) drawBackdrop(context);
    if (ImGui::CollapsingHeader("Turntable")) drawTurntable(context);
}

void LightPanel::drawPlacement(StudioContext& context) {
    const EnvironmentPlacement placement = placementAt(context.document(), context.session.timeS());
    commandRow(context, "light.rotate", "degrees", "Rotation", wrappedDegrees(placement.rotationDeg),
               ParameterRange{-180.0, 180.0});
    const double ev = placement.scale > 0.0f ? std::log2(static_cast<double>(placement.scale)) : -16.0;
    commandRow(context, "light.exposure", "ev", "Exposure", ev);
}

void LightPanel::drawKind(StudioContext& context) {
    static constexpr std::array<Choice, 4> kinds{{{"File", "A panorama from a file: .exr, .hdr or any picture."},
                                                  {"Sky", "Daylight, made from the sun's place and the haze."},
                                                  {"Studio", "Soft boxes around the body."},
                                                  {"Uniform", "The same light from everywhere."}}};
    const auto clicked = choiceButtons(context, "Kind", kinds, static_cast<int>(context.document().light.kind));
    if (!clicked) return;
    const auto kind = static_cast<LightKind>(*clicked);
    // Without a file there is nothing to change to yet: the answer of the dialog changes the kind.
    if (kind == LightKind::File && context.document().light.file.empty()) {
        askForFile(context);
        return;
    }
    runFromWidget(context, "light.kind",
                  {{"kind", std::string(EnumWords<LightKind>::words[static_cast<std::size_t>(*clicked)])}});
}

void LightPanel::askForFile(StudioContext& context) {
    FileQuestion question;
    question.title = "Open a light";
    question.endings = {".exr", ".hdr", ".png", ".jpg", ".jpeg"};
    question.folderKey = "light";
    question.chosen = [&session = context.session](const std::filesystem::path& path) {
        session.openAs(path, FileRole::Light);
    };
    context.studio.ask(std::move(question));
}

void LightPanel::drawFile(StudioContext& context) {
    const std::filesystem::path file = context.document().light.file;
    const std::string name = file.empty() ? "no file" : file.filename().string();
    rowLabel("Panorama");
    const float button = ImGui::GetFrameHeight() + ImGui::GetStyle().ItemSpacing.x;
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted(fitted(name, ImGui::GetContentRegionAvail().x - button, true).c_str());
    ui::help(context, file.empty() ? "No file is open yet." : file.string().c_str());
    ImGui::SameLine();
    ImGui::SetCursorPosX(ImGui::GetCursorPosX() + ImGui::GetContentRegionAvail().x - ImGui::GetFrameHeight());
    if (toolButton(icon::kFolder, "Open light. A panorama or a cube map: .exr, .hdr, .png, .jpg")) askForFile(context);
    const auto light = context.session.assets().light;
    if (!light || !light->source) return;
    for (const std::string& note : light->source->environment.notes) hint(note.c_str());
}

void LightPanel::drawBackdrop(StudioContext& context) {
    static constexpr std::array<Choice, 3> kinds{
        {{"Color", "A plain background; its colour is set in the Camera panel."},
         {"Checkerboard", "Shows where the picture is transparent."},
         {"Environment", "The light itself behind the body."}}};
    const LightSection& light = context.document().light;
    if (const auto clicked = choiceButtons(context, "Backdrop", kinds, static_cast<int>(light.backdrop))) {
        runFromWidget(context, "light.backdrop",
                      {{"kind", std::string(EnumWords<BackdropKind>::words[static_cast<std::size_t>(*clicked)])}});
    }
    ImGui::BeginDisabled(light.backdrop != BackdropKind::Environment);
    commandRow(context, "light.backdrop_blur", "amount", "Blur", context.document().light.backdropBlur);
    ImGui::EndDisabled();
}

void LightPanel::drawTurntable(StudioContext& context) {
    hint("Keys on the timeline turn the light around the body once or more; play it, or make a film of it.");
    const auto row = [&](const char* argument, const char* label, double& value) {
        const Command* command = findCommand("light.turntable");
        if (!command) return;
        for (const CommandArgument& a : command->arguments) {
            if (a.info.name != argument) continue;
            ParameterInfo info = a.info;
            info.name = label;
            ParameterValue edited = value;
            if (parameterRow(context, info, edited)) {
                if (const double* number = std::get_if<double>(&edited)) value = *number;
            }
        }
    };
    row("seconds", "Seconds", turnSeconds_);
    row("turns", "Turns", turns_);
    commandButton(context, "Make turntable", "light.turntable",
                  "Writes keys of the light's rotation over this time; the timeline then loops without a jump.",
                  {{"seconds", turnSeconds_}, {"turns", turns_}}, -1.0f);
}

} // namespace

std::unique_ptr<Panel> makeLightPanel() { return std::make_unique<LightPanel>(); }

} // namespace ars::ui
