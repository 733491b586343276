#include "ui/look/output_jobs.h"

#include "engine/core/process.h"
#include "ui/studio.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <system_error>

namespace ars::ui {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kKeptFiles = 8;

void openFolder(StudioContext& context, const fs::path& folder) {
    const auto child = ChildProcess::start({"xdg-open", folder.string()}, "/dev/null", true);
    if (child) return;
    ImGui::SetClipboardText(folder.string().c_str());
    context.studio.toast("No program to open folders was found; the path is in the clipboard");
}

std::string numberText(double value) { return fmt::format("{:.6g}", value); }

} // namespace

std::span<const SizePreset> sizePresets() {
    static constexpr std::array<SizePreset, 8> presets{{{"1280 x 720 (HD)", 1280, 720},
                                                        {"1920 x 1080 (Full HD)", 1920, 1080},
                                                        {"2560 x 1440", 2560, 1440},
                                                        {"3840 x 2160 (4K)", 3840, 2160},
                                                        {"1024 x 1024 (square)", 1024, 1024},
                                                        {"2048 x 2048 (square)", 2048, 2048},
                                                        {"1080 x 1350 (portrait)", 1080, 1350},
                                                        {"1080 x 1920 (upright)", 1080, 1920}}};
    return presets;
}

fs::path freeName(const fs::path& file) {
    std::error_code ignored;
    if (file.empty() || !fs::exists(file, ignored)) return file;
    // "picture-3.png" goes on with "picture-4.png", not with "picture-3-2.png".
    std::string stem = file.stem().string();
    int number = 2;
    const std::size_t dash = stem.find_last_of('-');
    const std::string tail = dash == std::string::npos ? "" : stem.substr(dash + 1);
    if (!tail.empty() && tail.size() < 7 &&
        std::all_of(tail.begin(), tail.end(), [](char c) { return c >= '0' && c <= '9'; })) {
        number = std::stoi(tail) + 1;
        stem.resize(dash);
    }
    for (;; ++number) {
        const fs::path next = file.parent_path() / fmt::format("{}-{}{}", stem, number, file.extension().string());
        if (!fs::exists(next, ignored)) return next;
    }
}

std::string shellWord(const std::string& text) {
    const auto plain = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
               std::string_view("/._-+=:,@%").find(c) != std::string_view::npos;
    };
    if (!text.empty() && std::all_of(text.begin(), text.end(), plain)) return text;
    std::string quoted = "'";
    for (const char c : text) quoted += c == '\'' ? "'\\''" : std::string(1, c);
    return quoted + "'";
}

std::string screenshotCommand(const fs::path& project, const ScreenshotOptions& options) {
    std::string command =
        fmt::format("ars render --project {} --size {}x{}", shellWord(project.string()), options.width, options.height);
    if (options.transparent) command += " --transparent";
    if (!options.buffers.empty()) {
        command += " --aov ";
        for (std::size_t i = 0; i < options.buffers.size(); ++i) {
            command += fmt::format("{}{}", i > 0 ? "," : "", bufferInfo(options.buffers[i]).name);
        }
    }
    return command + " --out " + shellWord(options.file.string());
}

std::string filmCommand(const fs::path& project, const VideoOptions& options) {
    std::string command = fmt::format("ars render --project {} --film --size {}x{}", shellWord(project.string()),
                                      options.width, options.height);
    if (options.framesPerSecond > 0.0) command += " --fps " + numberText(options.framesPerSecond);
    if (options.startS != 0.0 || options.endS != 0.0) {
        command += fmt::format(" --range {}:{}", numberText(options.startS), numberText(options.endS));
    }
    return command + " --out " + shellWord(options.file.string());
}

void OutputJobs::started(std::uint64_t job, const fs::path& file) { running_.push_back({job, file}); }

/// A job that is gone has ended; where its file stands, it went well.
std::vector<fs::path> OutputJobs::follow(const std::vector<JobStatus>& jobs) {
    std::vector<fs::path> finished;
    for (auto running = running_.begin(); running != running_.end();) {
        const bool alive =
            std::any_of(jobs.begin(), jobs.end(), [&](const JobStatus& j) { return j.id == running->job; });
        if (alive) {
            ++running;
            continue;
        }
        std::error_code ignored;
        if (fs::exists(running->file, ignored)) {
            written_.erase(std::remove(written_.begin(), written_.end(), running->file), written_.end());
            written_.insert(written_.begin(), running->file);
            finished.push_back(running->file);
            if (written_.size() > kKeptFiles) written_.resize(kKeptFiles);
        }
        running = running_.erase(running);
    }
    return finished;
}

std::vector<fs::path> OutputJobs::draw(StudioContext& context) {
    const std::vector<JobStatus> jobs = context.session.jobs();
    std::vector<fs::path> finished = follow(jobs);
    for (const Running& running : running_) {
        const auto job =
            std::find_if(jobs.begin(), jobs.end(), [&](const JobStatus& j) { return j.id == running.job; });
        if (job == jobs.end()) continue;
        ImGui::PushID(static_cast<int>(running.job));
        const float cancel = buttonWidth("Cancel") + ImGui::GetStyle().ItemSpacing.x;
        const std::string text = fmt::format("{}  {}", running.file.filename().string(), job->what);
        const float fraction =
            job->fraction < 0.0 ? -1.0f * static_cast<float>(ImGui::GetTime()) : static_cast<float>(job->fraction);
        ImGui::ProgressBar(fraction, ImVec2(ImGui::GetContentRegionAvail().x - cancel, 0.0f),
                           fitted(text, ImGui::GetContentRegionAvail().x - cancel - 8.0f).c_str());
        help(context, fmt::format("{}\n{}", running.file.string(), job->what).c_str());
        ImGui::SameLine();
        if (ImGui::Button("Cancel")) context.session.cancel(running.job);
        help(context, "Stops; nothing half done is left.");
        ImGui::PopID();
    }
    drawWritten(context);
    return finished;
}

void OutputJobs::drawWritten(StudioContext& context) {
    if (written_.empty()) return;
    heading("Written");
    for (const fs::path& file : written_) {
        ImGui::PushID(file.c_str());
        const float buttons = 2.0f * (ImGui::GetFrameHeight() + ImGui::GetStyle().ItemInnerSpacing.x);
        ImGui::AlignTextToFramePadding();
        const float room = ImGui::GetContentRegionAvail().x - buttons;
        const float start = ImGui::GetCursorPosX();
        ImGui::TextUnformatted(fitted(file.filename().string(), room, true).c_str());
        help(context, file.string().c_str());
        ImGui::SameLine(start + room);
        if (toolButton(icon::kFolder, "Open folder. Shows the file's folder in the desktop's file manager")) {
            std::error_code ignored;
            openFolder(context, fs::is_directory(file, ignored) ? file : file.parent_path());
        }
        ImGui::SameLine(0.0f, ImGui::GetStyle().ItemInnerSpacing.x);
        if (toolButton(icon::kCopy, "Copy path. Puts the file's path into the clipboard")) {
            ImGui::SetClipboardText(file.string().c_str());
        }
        ImGui::PopID();
    }
}

} // namespace ars::ui
