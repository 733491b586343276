#include "ui/look/capture_list.h"

#include "engine/scene/assets.h"
#include "ui/studio.h"

#include <imgui_stdlib.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <vector>

namespace ars::ui {

namespace {

bool contains(const std::string& text, const std::string& part) {
    const auto same = [](unsigned char a, unsigned char b) { return std::tolower(a) == std::tolower(b); };
    return std::search(text.begin(), text.end(), part.begin(), part.end(), same) != text.end();
}

/// As a format that stands for itself.
std::string printable(const std::string& text) {
    std::string format;
    for (const char c : text) format += c == '%' ? "%%" : std::string(1, c);
    return format;
}

int cameraIndex(const CaptureAsset& capture, const std::string& name) {
    for (std::size_t i = 0; i < capture.cameras.size(); ++i) {
        if (capture.cameras[i].name == name) return static_cast<int>(i);
    }
    return -1;
}

} // namespace

void CaptureList::askForCapture(StudioContext& context) {
    FileQuestion question;
    question.title = "Open a capture's cameras";
    question.endings = {".json"};
    question.folderKey = "capture";
    question.chosen = [&session = context.session](const std::filesystem::path& path) {
        session.openAs(path, FileRole::Capture);
    };
    context.studio.ask(std::move(question));
}

void CaptureList::draw(StudioContext& context) {
    const std::string file = context.document().camera.capture;
    if (iconButton(icon::kFolder, "Open capture")) askForCapture(context);
    help(context, "The calibration of a multi-view capture (calibration_full.json): its cameras and photographs.");
    if (file.empty()) {
        hint("Open a capture to look through its cameras and to compare with its photographs.");
        return;
    }
    ImGui::SameLine();
    commandButton(context, "Close", "camera.close_capture", "Forgets the capture; the camera stays where it is.");
    const std::filesystem::path path(file);
    const std::string name = fmt::format("{}/{}", path.parent_path().filename().string(), path.filename().string());
    hint(fitted(name, ImGui::GetContentRegionAvail().x, true).c_str());
    help(context, file.c_str());
    const auto capture = context.session.assets().capture;
    if (!capture) {
        hint("Reading the cameras...");
        return;
    }
    drawCameras(context);
    drawPhotograph(context);
}

void CaptureList::drawCameras(StudioContext& context) {
    const auto capture = context.session.assets().capture;
    const std::string current = context.document().camera.datasetCamera;
    const float share = shareOfRow(3);
    commandButton(context, "Previous", "camera.previous_dataset", "Looks through the camera before.",
                  Arguments::object(), share);
    ImGui::SameLine();
    commandButton(context, "Next", "camera.next_dataset", "Looks through the next camera.", Arguments::object(), share);
    ImGui::SameLine();
    commandButton(context, "Leave", "camera.leave_dataset",
                  "Back to the free camera, which starts where the dataset camera was.", Arguments::object(), share);
    ImGui::SetNextItemWidth(-FLT_MIN);
    ImGui::InputTextWithHint("##Search cameras", fmt::format("Search {} cameras", capture->cameras.size()).c_str(),
                             &search_);
    const float line = ImGui::GetTextLineHeightWithSpacing();
    const auto matching = std::count_if(capture->cameras.begin(), capture->cameras.end(),
                                        [&](const CalibratedCamera& camera) { return contains(camera.name, search_); });
    const float lines = std::clamp(static_cast<float>(matching), 1.0f, 6.0f);
    if (ImGui::BeginChild("Cameras", ImVec2(0.0f, lines * line + 2.0f * ImGui::GetStyle().WindowPadding.y),
                          ImGuiChildFlags_Borders)) {
        for (const CalibratedCamera& camera : capture->cameras) {
            if (!contains(camera.name, search_)) continue;
            const bool selected = camera.name == current;
            if (ImGui::Selectable(camera.name.c_str(), selected)) {
                runFromWidget(context, "camera.dataset", {{"name", camera.name}});
            }
            help(context, fmt::format("{}x{} pixels, {:.1f} degrees from top to bottom{}", camera.camera.width,
                                      camera.camera.height, camera.verticalFieldDeg(),
                                      camera.distorted() ? "; its photographs are distorted by the lens" : "")
                              .c_str());
            if (selected && shown_ != current) ImGui::SetScrollHereY(0.5f);
        }
        if (matching == 0) hint("No camera of this name.");
    }
    ImGui::EndChild();
    shown_ = current;
}

void CaptureList::drawPhotograph(StudioContext& context) {
    const auto capture = context.session.assets().capture;
    const CameraSection camera = context.document().camera;
    const int index = cameraIndex(*capture, camera.datasetCamera);
    if (index < 0) {
        hint("Choose a camera to see its photographs.");
        return;
    }
    const auto i = static_cast<std::size_t>(index);
    const std::size_t count = i < capture->photographs.size() ? capture->photographs[i].size() : 0;
    if (count == 0) {
        hint("No photographs lie beside this camera.");
        return;
    }
    rowLabel("Photograph", "Which photograph of this camera the picture is compared with.");
    const std::vector<std::filesystem::path>& files = capture->photographs[i];
    const int last = static_cast<int>(count) - 1;
    int place = std::clamp(camera.photograph, 0, last);
    const float button = ImGui::GetFrameHeight(), gap = ImGui::GetStyle().ItemInnerSpacing.x;
    const auto choose = [&](int wanted) {
        runFromWidget(context, "camera.photograph", {{"frame", std::clamp(wanted, 0, last)}});
    };
    // The name says more than the place in the list: files need not begin at 0 nor follow each other.
    const std::string number = fitted(files[static_cast<std::size_t>(place)].stem().string(), 8.0f * button, true);
    ImGui::SetNextItemWidth(std::max(1.0f, ImGui::GetContentRegionAvail().x - 2.0f * (button + gap)));
    if (ImGui::SliderInt("###Photograph", &place, 0, last, printable(number).c_str(),
                         ImGuiSliderFlags_AlwaysClamp | ImGuiSliderFlags_NoInput)) {
        choose(place);
    }
    help(context, files[static_cast<std::size_t>(place)].string().c_str());
    ImGui::SameLine(0.0f, gap);
    if (toolButton(icon::kChevronLeft, "Previous photograph")) choose(place - 1);
    ImGui::SameLine(0.0f, gap);
    if (toolButton(icon::kChevronRight, "Next photograph")) choose(place + 1);
    if (ImGui::Button("Compare with photograph", ImVec2(-FLT_MIN, 0.0f))) {
        const std::array<CommandCall, 2> calls{CommandCall{"compare.kind", {{"kind", "photograph"}}},
                                               CommandCall{"view.layout", {{"layout", "split"}}}};
        runTogether(context, "compare with photograph", calls);
    }
    help(context, "Splits the viewport between the picture and the photograph; drag the line between them.");
}

} // namespace ars::ui
