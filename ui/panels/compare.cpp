#include "engine/frame/buffer_catalogue.h"
#include "ui/look/controls.h"
#include "ui/panel.h"
#include "ui/studio.h"
#include "ui/viewport/comparison.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace ars::ui {

namespace {

class ComparePanel : public Panel {
public:
    const char* id() const override { return "compare"; }
    const char* title() const override { return "Compare"; }
    const char* help() const override {
        return "Two pictures against each other: split, blink, error map and measures.";
    }
    void draw(StudioContext& context) override;

private:
    void drawLayout(StudioContext& context);
    void drawKind(StudioContext& context);
    void drawOther(StudioContext& context);
    void drawBuffer(StudioContext& context);
    void drawHeld(StudioContext& context);
    void drawAvatar(StudioContext& context);
    void drawPicture(StudioContext& context);
    void drawNumbers(StudioContext& context);
    void drawTable(StudioContext& context, const ComparisonNumbers* numbers, bool measuring);
    void askForPicture(StudioContext& context);
    void askForAvatar(StudioContext& context);

    Comparison comparison_;
};

void ComparePanel::draw(StudioContext& context) {
    drawLayout(context);
    if (ImGui::CollapsingHeader("Other side", ImGuiTreeNodeFlags_DefaultOpen)) {
        drawKind(context);
        drawOther(context);
    }
    if (ImGui::CollapsingHeader("Measures", ImGuiTreeNodeFlags_DefaultOpen)) drawNumbers(context);
}

void ComparePanel::drawLayout(StudioContext& context) {
    static constexpr std::array<Choice, 5> layouts{{{"Off", "One picture, nothing to compare with."},
                                                    {"Side by side", "Both pictures, left and right."},
                                                    {"Split", "Both in one picture; drag the line between them."},
                                                    {"Blink", "Both in turn: the eye sees what jumps."},
                                                    {"Difference", "The error between both, as a map."}}};
    const auto layout = static_cast<int>(context.document().view.layout);
    const int count = static_cast<int>(layouts.size());
    if (const auto clicked = choiceButtons(context, "Layout", layouts, layout < count ? layout : -1)) {
        runFromWidget(context, "view.layout",
                      {{"layout", std::string(EnumWords<ViewLayout>::words[static_cast<std::size_t>(*clicked)])}});
    }
    if (context.document().view.layout == ViewLayout::Split) {
        commandRow(context, "compare.split", "position", "Line",
                   static_cast<double>(context.document().view.compare.splitPosition));
    }
}

void ComparePanel::askForPicture(StudioContext& context) {
    FileQuestion question;
    question.title = "Compare with a picture";
    question.endings = {".png", ".exr", ".jpg", ".jpeg", ".hdr"};
    question.folderKey = "compare";
    question.chosen = [&session = context.session](const std::filesystem::path& path) {
        session.openAs(path, FileRole::ComparePicture);
    };
    context.studio.ask(std::move(question));
}

void ComparePanel::askForAvatar(StudioContext& context) {
    FileQuestion question;
    question.title = "Compare with an avatar";
    question.endings = {".glb", ".gltf", ".npz"};
    question.folderKey = "avatar";
    question.chosen = [&session = context.session, &studio = context.studio](const std::filesystem::path& path) {
        const Status status = session.run("compare.avatar", {{"source", "rest:" + path.string()}});
        if (!status) studio.showError("Could not compare with this avatar", status.error().describe());
    };
    context.studio.ask(std::move(question));
}

void ComparePanel::drawKind(StudioContext& context) {
    static constexpr std::array<Choice, 5> kinds{
        {{"Buffer", "Another buffer of the same frame."},
         {"Held look", "The look that was held: settings, light, pose, avatar."},
         {"Avatar", "Another avatar in the same pose and light."},
         {"Picture", "A picture file: a ground truth, another program's."},
         {"Photograph", "The photograph of the dataset camera."}}};
    const CompareSection& compare = context.document().view.compare;
    const auto clicked = choiceButtons(context, "Kind", kinds, static_cast<int>(compare.kind));
    if (!clicked) return;
    const auto kind = static_cast<CompareKind>(*clicked);
    const Arguments argument = {
        {"kind", std::string(EnumWords<CompareKind>::words[static_cast<std::size_t>(*clicked)])}};
    // What has nothing to show yet is asked for instead of refused.
    if (kind == CompareKind::Held && !compare.held) {
        runFromWidget(context, "compare.hold", Arguments::object());
    } else if (kind == CompareKind::Picture || kind == CompareKind::Avatar) {
        if (context.session.run("compare.kind", argument)) return;
        if (kind == CompareKind::Picture) askForPicture(context);
        if (kind == CompareKind::Avatar) askForAvatar(context);
    } else {
        runFromWidget(context, "compare.kind", argument);
    }
}

void ComparePanel::drawOther(StudioContext& context) {
    switch (context.document().view.compare.kind) {
    case CompareKind::Buffer:
        drawBuffer(context);
        break;
    case CompareKind::Held:
        drawHeld(context);
        break;
    case CompareKind::Avatar:
        drawAvatar(context);
        break;
    case CompareKind::Picture:
        drawPicture(context);
        break;
    case CompareKind::Photograph: {
        const CameraSection& camera = context.document().camera;
        if (camera.capture.empty()) {
            hint("Open a capture in the Camera panel: its photographs stand on the other side.");
        } else if (camera.datasetCamera.empty()) {
            hint("Choose a dataset camera in the Camera panel: its photograph stands on the other side.");
        } else {
            hint(fmt::format("Photograph {} of camera {}. Step through them in the Camera panel.", camera.photograph,
                             camera.datasetCamera)
                     .c_str());
        }
        break;
    }
    }
}

void ComparePanel::drawBuffer(StudioContext& context) {
    const BufferId current = context.document().view.compare.buffer;
    rowLabel("Other buffer", "The buffer on the other side.");
    if (ImGui::BeginCombo("###Other buffer", std::string(bufferInfo(current).label).c_str(),
                          ImGuiComboFlags_HeightLarge)) {
        for (const BufferInfo& info : bufferCatalogue()) {
            if (ImGui::Selectable(std::string(info.label).c_str(), info.id == current)) {
                runFromWidget(context, "compare.buffer", {{"name", std::string(info.name)}});
            }
            ui::help(context, std::string(info.help).c_str());
        }
        ImGui::EndCombo();
    }
}

void ComparePanel::drawHeld(StudioContext& context) {
    hint("What was held stays on the other side while settings, light, pose and avatar change here.");
    const float share = shareOfRow(2);
    commandButton(context, "Hold again", "compare.hold", "Keeps the look as it is now.", Arguments::object(), share);
    ImGui::SameLine();
    commandButton(context, "Release", "compare.kind",
                  "Compares with a buffer again; the held look can be chosen again.", {{"kind", "buffer"}}, share);
}

void ComparePanel::drawAvatar(StudioContext& context) {
    const std::string source = context.document().view.compare.file;
    rowLabel("Avatar");
    ImGui::AlignTextToFramePadding();
    const std::string name = source.rfind("rest:", 0) == 0 ? source.substr(5) : source;
    ImGui::TextUnformatted(
        fitted(std::filesystem::path(name).filename().string(), ImGui::GetContentRegionAvail().x, true).c_str());
    ui::help(context, source.c_str());
    const float share = shareOfRow(2);
    if (ImGui::Button("Choose file", ImVec2(share, 0.0f))) askForAvatar(context);
    ui::help(context, "A skinned glTF or a body file.");
    ImGui::SameLine();
    commandButton(context, "Open body", "compare.avatar", "The body that comes with the program.",
                  {{"source", "rest:open"}}, share);
}

void ComparePanel::drawPicture(StudioContext& context) {
    const CompareSection& compare = context.document().view.compare;
    const std::filesystem::path file(compare.file);
    rowLabel("Picture");
    ImGui::AlignTextToFramePadding();
    const float button = ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x;
    const float start = ImGui::GetCursorPosX(), room = ImGui::GetContentRegionAvail().x - button;
    ImGui::TextUnformatted(fitted(file.filename().string(), room, true).c_str());
    ui::help(context, compare.file.c_str());
    ImGui::SameLine(start + room);
    if (toolButton(icon::kFolder, "Choose picture. A photograph, a ground truth, another program's rendering")) {
        askForPicture(context);
    }
    const auto picture = context.session.assets().picture;
    if (!picture || picture->layers.empty()) return;
    const auto shown = [](const std::string& layer) { return layer.empty() ? std::string("main picture") : layer; };
    rowLabel("Layer", "Which layer of the EXR.");
    if (ImGui::BeginCombo("###Layer", shown(compare.layer).c_str())) {
        for (const std::string& layer : picture->layers) {
            if (!ImGui::Selectable(shown(layer).c_str(), layer == context.document().view.compare.layer)) continue;
            runFromWidget(context, "compare.picture", {{"file", file.string()}, {"layer", layer}});
        }
        ImGui::EndCombo();
    }
    ui::help(context, "Ground truth often has a layer for every buffer; choose the one that is shown.");
}

void ComparePanel::drawNumbers(StudioContext& context) {
    static constexpr std::array<Choice, 3> measures{
        {{"Absolute", "The error map shows |a - b|."},
         {"Squared", "The error map shows (a - b)^2."},
         {"FLIP", "The error map shows what a person notices when both alternate."}}};
    hint("Error map of the layout Difference");
    const auto measure = static_cast<int>(context.document().view.compare.measure);
    if (const auto clicked = choiceButtons(context, "Measure", measures, measure)) {
        runFromWidget(context, "compare.measure",
                      {{"measure", std::string(EnumWords<ErrorMeasure>::words[static_cast<std::size_t>(*clicked)])}});
    }
    const std::shared_ptr<const Frame> frame = context.session.frame();
    const Image* picture = frame ? frame->picture(context.document().view.buffer) : nullptr;
    if (!picture) {
        hint("The picture is being rendered.");
        return;
    }
    const OtherSide other = comparison_.otherSide(context, frame, picture->width, picture->height);
    const ComparisonNumbers* numbers = comparison_.numbers(context, frame, other);
    if (!other.missing.empty()) {
        hint(fmt::format("No numbers: {}.", other.missing).c_str());
    } else if (numbers && !numbers->problem.empty()) {
        hint(fmt::format("No numbers: {}.", numbers->problem).c_str());
    } else {
        drawTable(context, numbers, comparison_.measuring());
    }
}

std::string numberOf(const std::optional<double>& value, const char* unit) {
    if (!value) return "-";
    return std::isinf(*value) ? std::string("equal") : fmt::format("{:.3f}{}", *value, unit);
}

void ComparePanel::drawTable(StudioContext& context, const ComparisonNumbers* numbers, bool measuring) {
    const ComparisonNumbers none;
    const ComparisonNumbers& shown = numbers ? *numbers : none;
    if (!ImGui::BeginTable("Numbers", 3, ImGuiTableFlags_SizingStretchProp)) return;
    const auto cell = [](const char* text) {
        ImGui::TableNextColumn();
        ImGui::TextColored(mutedColor(), "%s", text);
    };
    cell("");
    cell("Whole picture");
    cell("Body");
    ui::help(context, "Where the body covers at least half of the pixel.");
    const auto row = [&](const char* label, const char* tooltip, const std::optional<double>& whole,
                         const std::optional<double>& mask, const char* unit) {
        ImGui::TableNextRow();
        ImGui::TableNextColumn();
        ImGui::TextUnformatted(label);
        ui::help(context, tooltip);
        for (const auto* value : {&whole, &mask}) {
            ImGui::TableNextColumn();
            numberText(context, numbers ? numberOf(*value, unit).c_str() : "...");
            ui::help(context, tooltip);
        }
    };
    row("PSNR", "Peak signal to noise; more is better, equal pictures have no end of it.", shown.whole.psnr,
        shown.mask.psnr, " dB");
    row("SSIM", "Structural similarity; 1 is equal.", shown.whole.ssim, shown.mask.ssim, "");
    row("FLIP", "Mean difference that a person notices when both alternate; 0 is equal.", shown.whole.flip,
        shown.mask.flip, "");
    ImGui::EndTable();
    hint(measuring ? "Measuring..." : "Of both pictures as they are shown, over a plain background, at full quality.");
}

} // namespace

std::unique_ptr<Panel> makeComparePanel() { return std::make_unique<ComparePanel>(); }

} // namespace ars::ui
