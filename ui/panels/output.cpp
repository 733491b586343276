#include "engine/scene/export.h"
#include "ui/look/controls.h"
#include "ui/look/output_jobs.h"
#include "ui/panel.h"
#include "ui/studio.h"

#include <imgui_stdlib.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

namespace ars::ui {

namespace fs = std::filesystem;

namespace {

constexpr const char* kFolderKey = "output";

/// What R+ and R- need is rarely computed: they are not offered.
bool offered(BufferId buffer) { return buffer != BufferId::RadiusPlus && buffer != BufferId::RadiusMinus; }

class OutputPanel : public Panel {
public:
    const char* id() const override { return "output"; }
    const char* title() const override { return "Output"; }
    const char* help() const override { return "Screenshots, layered EXR and films of the timeline."; }
    bool openByDefault() const override { return true; }
    void draw(StudioContext& context) override;

private:
    enum class PictureKind { Png, Exr };
    enum class FilmKind { Mp4, Pictures };

    void chooseNames(const StudioContext& context);
    void drawScreenshot(StudioContext& context);
    void drawLayers(StudioContext& context);
    void drawFilm(StudioContext& context);
    void drawRange(StudioContext& context);
    void drawFile(StudioContext& context, const char* label, std::string& file, std::vector<std::string> endings);
    void drawSize(StudioContext& context, int& width, int& height, bool even);
    void drawCommand(StudioContext& context, const char* id, const std::string& command);
    ScreenshotOptions screenshotOptions() const;
    VideoOptions filmOptions(const Document& document) const;

    // What will be written: choices of the moment, which no project keeps.
    std::shared_ptr<std::string> pictureFile_ =
        std::make_shared<std::string>(); ///< a dialog may answer after the panel
    std::shared_ptr<std::string> filmFile_ = std::make_shared<std::string>();
    PictureKind pictureKind_ = PictureKind::Png;
    FilmKind filmKind_ = FilmKind::Mp4;
    int width_ = 1920, height_ = 1080;
    int filmWidth_ = 1280, filmHeight_ = 720;
    bool transparent_ = false;
    std::vector<BufferId> layers_; ///< empty: all
    bool wholeRange_ = true;
    double startS_ = 0.0, endS_ = 0.0;
    double framesPerSecond_ = 0.0; ///< 0: the timeline's
    OutputJobs jobs_;
};

fs::path startFolder(const StudioContext& context) {
    std::error_code ignored;
    const auto known = context.settings.folders.find(kFolderKey);
    if (known != context.settings.folders.end() && fs::is_directory(known->second, ignored)) return known->second;
    if (!context.session.projectPath().empty()) return context.session.projectPath().parent_path();
    const char* home = std::getenv("HOME");
    return home && *home ? fs::path(home) : fs::current_path(ignored);
}

std::string projectName(const StudioContext& context) {
    const fs::path& project = context.session.projectPath();
    return project.empty() ? "picture" : project.stem().string();
}

/// The file with another ending ("" for none).
std::string withEnding(const std::string& file, const char* ending) {
    return fs::path(file).replace_extension(ending).string();
}

void OutputPanel::chooseNames(const StudioContext& context) {
    const fs::path folder = startFolder(context);
    const std::string name = projectName(context);
    if (pictureFile_->empty()) *pictureFile_ = freeName(folder / (name + ".png")).string();
    if (filmFile_->empty()) *filmFile_ = freeName(folder / ((name == "picture" ? "film" : name) + ".mp4")).string();
}

void OutputPanel::draw(StudioContext& context) {
    chooseNames(context);
    // Below the viewport there is more width than height: both stand beside each other.
    const bool beside = ImGui::GetContentRegionAvail().x > 36.0f * ImGui::GetFontSize();
    if (beside) {
        const ImVec2 half(shareOfRow(2), 0.0f);
        if (ImGui::BeginChild("Screenshot side", half, ImGuiChildFlags_AutoResizeY)) drawScreenshot(context);
        ImGui::EndChild();
        ImGui::SameLine();
        if (ImGui::BeginChild("Film side", half, ImGuiChildFlags_AutoResizeY)) drawFilm(context);
        ImGui::EndChild();
    } else {
        if (ImGui::CollapsingHeader("Screenshot", ImGuiTreeNodeFlags_DefaultOpen)) drawScreenshot(context);
        if (ImGui::CollapsingHeader("Film", ImGuiTreeNodeFlags_DefaultOpen)) drawFilm(context);
    }
    // The next one gets a name of its own: nothing that was just written is replaced by accident.
    for (const fs::path& file : jobs_.draw(context)) {
        if (file == *pictureFile_) *pictureFile_ = freeName(file).string();
        if (file == *filmFile_) *filmFile_ = freeName(file).string();
    }
}

void OutputPanel::drawFile(StudioContext& context, const char* label, std::string& file,
                           std::vector<std::string> endings) {
    rowLabel(label, "Where it is written. The whole document goes into the file: dropping it on the window brings "
                    "pose, light and camera back.");
    const float button = ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x;
    ImGui::SetNextItemWidth(-button);
    ImGui::InputText(fmt::format("###{}", label).c_str(), &file);
    ui::help(context, file.c_str());
    ImGui::SameLine(0.0f, ImGui::GetStyle().ItemInnerSpacing.x);
    if (toolButton(icon::kFolder, "Choose file. Opens a dialog for the name")) {
        FileQuestion question;
        question.title = "Write to";
        question.saving = true;
        question.suggestedName = fs::path(file).filename().string();
        question.endings = std::move(endings);
        question.folderKey = kFolderKey;
        const auto target = &file == pictureFile_.get() ? pictureFile_ : filmFile_;
        question.chosen = [target](const fs::path& path) { *target = path.string(); };
        context.studio.ask(std::move(question));
    }
}

void OutputPanel::drawSize(StudioContext& context, int& width, int& height, bool even) {
    rowLabel("Size", "Width and height in pixels.");
    const float arrow = ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x;
    ImGui::SetNextItemWidth(-arrow);
    int size[2] = {width, height};
    const int least = even ? 2 : 1, most = 16384;
    if (ImGui::DragScalarN("##Pixels", ImGuiDataType_S32, size, 2, 2.0f, &least, &most, "%d px",
                           ImGuiSliderFlags_AlwaysClamp)) {
        width = even ? std::max(2, size[0] / 2 * 2) : size[0];
        height = even ? std::max(2, size[1] / 2 * 2) : size[1];
    }
    ui::help(context, even ? "Width and height; films take even numbers." : "Width and height, at most 16384.");
    ImGui::SameLine(0.0f, ImGui::GetStyle().ItemInnerSpacing.x);
    if (ImGui::BeginCombo("###Size", "", ImGuiComboFlags_NoPreview | ImGuiComboFlags_PopupAlignLeft)) {
        for (const SizePreset& p : sizePresets()) {
            if (ImGui::Selectable(p.label, p.width == width && p.height == height)) {
                width = p.width;
                height = p.height;
            }
        }
        ImGui::EndCombo();
    }
    ui::help(context, "Sizes that are often wanted.");
}

void OutputPanel::drawLayers(StudioContext& context) {
    std::size_t count = layers_.size();
    const auto all = static_cast<std::size_t>(std::count_if(bufferCatalogue().begin(), bufferCatalogue().end(),
                                                            [](const BufferInfo& b) { return offered(b.id); }));
    if (layers_.empty()) count = all;
    rowLabel("Layers", "Which buffers the EXR holds, each as a layer of its own.");
    if (!ImGui::BeginCombo("###Layers", count == all ? "all buffers" : fmt::format("{} of {}", count, all).c_str(),
                           ImGuiComboFlags_HeightLarge)) {
        return;
    }
    for (const BufferInfo& info : bufferCatalogue()) {
        if (!offered(info.id)) continue;
        bool wanted = layers_.empty() || std::find(layers_.begin(), layers_.end(), info.id) != layers_.end();
        if (!ImGui::Checkbox(std::string(info.label).c_str(), &wanted)) continue;
        if (layers_.empty()) {
            for (const BufferInfo& other : bufferCatalogue()) {
                if (offered(other.id)) layers_.push_back(other.id);
            }
        }
        if (wanted) {
            layers_.push_back(info.id);
        } else if (layers_.size() > 1) {
            layers_.erase(std::remove(layers_.begin(), layers_.end(), info.id), layers_.end());
        }
        std::sort(layers_.begin(), layers_.end());
        if (layers_.size() == all) layers_.clear();
    }
    ImGui::EndCombo();
    (void)context;
}

ScreenshotOptions OutputPanel::screenshotOptions() const {
    ScreenshotOptions options;
    options.file = *pictureFile_;
    options.width = width_;
    options.height = height_;
    options.transparent = transparent_ && pictureKind_ == PictureKind::Png;
    if (pictureKind_ == PictureKind::Exr) options.buffers = layers_;
    return options;
}

void OutputPanel::drawScreenshot(StudioContext& context) {
    ImGui::PushID("Picture");
    static constexpr std::array<Choice, 2> kinds{
        {{"PNG picture", "The buffer as it is shown, with its colours and backdrop."},
         {"EXR layers", "Numbers: every chosen buffer as a layer, linear light."}}};
    if (const auto clicked = choiceButtons(context, "Format", kinds, static_cast<int>(pictureKind_))) {
        pictureKind_ = static_cast<PictureKind>(*clicked);
        *pictureFile_ = freeName(withEnding(*pictureFile_, *clicked == 0 ? ".png" : ".exr")).string();
    }
    drawSize(context, width_, height_, false);
    if (pictureKind_ == PictureKind::Png) {
        ImGui::Checkbox("Transparent background", &transparent_);
        ui::help(context, "Straight alpha instead of background and backdrop.");
    } else {
        drawLayers(context);
    }
    drawFile(context, "File", *pictureFile_, {pictureKind_ == PictureKind::Png ? ".png" : ".exr"});
    std::error_code ignored;
    const bool replaces = fs::exists(*pictureFile_, ignored);
    const ScreenshotOptions options = screenshotOptions();
    ImGui::BeginDisabled(pictureFile_->empty());
    if (ImGui::Button(replaces ? "Replace picture###Save picture" : "Save picture###Save picture",
                      ImVec2(-FLT_MIN, 0.0f))) {
        jobs_.started(context.session.screenshot(options), options.file);
        context.settings.folders[kFolderKey] = options.file.parent_path().string();
    }
    ImGui::EndDisabled();
    ui::help(context, replaces ? "A file of this name is there already; it is replaced when the new one is complete."
                               : "Renders at full quality beside the window.");
    drawCommand(context, "Picture command", screenshotCommand(context.session.projectPath(), options));
    ImGui::PopID();
}

VideoOptions OutputPanel::filmOptions(const Document& document) const {
    VideoOptions options;
    options.file = *filmFile_;
    options.width = filmWidth_;
    options.height = filmHeight_;
    options.framesPerSecond = framesPerSecond_;
    if (!wholeRange_) {
        options.startS = startS_;
        options.endS = endS_;
    } else {
        options.startS = document.timeline.startS;
        options.endS = document.timeline.endS;
    }
    return options;
}

void OutputPanel::drawRange(StudioContext& context) {
    const TimelineSection& timeline = context.document().timeline;
    if (wholeRange_) {
        startS_ = timeline.startS;
        endS_ = timeline.endS;
    }
    rowLabel("Range", "Seconds of the timeline, from and to.");
    const float button = ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x;
    ImGui::SetNextItemWidth(-button);
    double range[2] = {startS_, endS_};
    const double least = 0.0, most = 36000.0;
    if (ImGui::DragScalarN("##Range", ImGuiDataType_Double, range, 2, 0.02f, &least, &most, "%.2f s",
                           ImGuiSliderFlags_AlwaysClamp)) {
        wholeRange_ = false;
        startS_ = range[0];
        endS_ = std::max(range[1], range[0] + 1e-3);
    }
    ui::help(context,
             wholeRange_ ? "The timeline's own range; change it for a part." : "Seconds of the timeline, from and to.");
    ImGui::SameLine(0.0f, ImGui::GetStyle().ItemInnerSpacing.x);
    ImGui::BeginDisabled(wholeRange_);
    if (toolButton(icon::kReset, "Whole timeline. The range that plays")) wholeRange_ = true;
    ImGui::EndDisabled();
    double rate = framesPerSecond_ > 0.0 ? framesPerSecond_ : timeline.framesPerSecond;
    rowLabel("Frame rate", "Frames a second of the film; the timeline's unless it is changed.");
    const double slowest = 1.0, fastest = 120.0;
    if (ImGui::SliderScalar("###Frame rate", ImGuiDataType_Double, &rate, &slowest, &fastest, "%.0f fps",
                            ImGuiSliderFlags_AlwaysClamp)) {
        framesPerSecond_ = rate;
    }
    ui::help(context, fmt::format("Frames a second; the timeline has {:g}.", timeline.framesPerSecond).c_str());
}

void OutputPanel::drawFilm(StudioContext& context) {
    ImGui::PushID("Movie");
    static constexpr std::array<Choice, 2> kinds{
        {{"MP4 film", "One film file, H.264."}, {"PNG frames", "A folder with one PNG for every frame."}}};
    if (const auto clicked = choiceButtons(context, "Format", kinds, static_cast<int>(filmKind_))) {
        filmKind_ = static_cast<FilmKind>(*clicked);
        *filmFile_ = freeName(withEnding(*filmFile_, *clicked == 0 ? ".mp4" : "")).string();
    }
    drawSize(context, filmWidth_, filmHeight_, true);
    drawRange(context);
    drawFile(context, filmKind_ == FilmKind::Mp4 ? "File" : "Folder", *filmFile_,
             filmKind_ == FilmKind::Mp4 ? std::vector<std::string>{".mp4"} : std::vector<std::string>{});
    const VideoOptions options = filmOptions(context.document());
    const double rate =
        options.framesPerSecond > 0.0 ? options.framesPerSecond : context.document().timeline.framesPerSecond;
    const int frames = std::max(1, static_cast<int>(std::lround((options.endS - options.startS) * rate)) + 1);
    std::error_code ignored;
    const bool replaces = fs::exists(*filmFile_, ignored);
    ImGui::BeginDisabled(filmFile_->empty());
    if (ImGui::Button(
            fmt::format("{} ({} frames)###Save film", replaces ? "Replace film" : "Save film", frames).c_str(),
            ImVec2(-FLT_MIN, 0.0f))) {
        jobs_.started(context.session.video(options), options.file);
        context.settings.folders[kFolderKey] = options.file.parent_path().string();
    }
    ImGui::EndDisabled();
    ui::help(context, replaces ? "A file of this name is there already; it is replaced when the new one is complete."
                               : "Renders every frame at full quality beside the window.");
    drawCommand(context, "Film command", filmCommand(context.session.projectPath(), options));
    ImGui::PopID();
}

/// The same without a window: on a server, in a script.
void OutputPanel::drawCommand(StudioContext& context, const char* id, const std::string& command) {
    if (!ImGui::TreeNodeEx(fmt::format("Command line###{}", id).c_str(), ImGuiTreeNodeFlags_SpanAvailWidth)) return;
    if (context.session.projectPath().empty()) {
        hint("Save the project: its file renders the same without a window, on any machine.");
    } else {
        ImGui::PushFont(context.studio.monospaced(), 0.9f * ImGui::GetStyle().FontSizeBase);
        hint(command.c_str());
        ImGui::PopFont();
        if (iconButton(icon::kCopy, "Copy command")) {
            ImGui::SetClipboardText(command.c_str());
            context.studio.toast("The command is in the clipboard");
        }
        ui::help(context, "Gives the same pictures; save the project first.");
    }
    ImGui::TreePop();
}

} // namespace

std::unique_ptr<Panel> makeOutputPanel() { return std::make_unique<OutputPanel>(); }

} // namespace ars::ui
