#pragma once

#include "engine/scene/session.h"
#include "ui/look/controls.h"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace ars::ui {

/// A size that pictures and films are often wanted in.
struct SizePreset {
    const char* label;
    int width, height;
};
std::span<const SizePreset> sizePresets();

/// `file` where nothing of this name is there yet, else the first free of NAME-2, NAME-3 ... with the same ending.
std::filesystem::path freeName(const std::filesystem::path& file);

/// `path` as one word of a shell's command line.
std::string shellWord(const std::string& text);
/// What renders the same without a window.
std::string screenshotCommand(const std::filesystem::path& project, const ScreenshotOptions& options);
std::string filmCommand(const std::filesystem::path& project, const VideoOptions& options);

/// Pictures and films that this panel started: progress with cancel, and the files that were written last.
class OutputJobs {
public:
    void started(std::uint64_t job, const std::filesystem::path& file);
    /// @return the files that were finished since the last call
    std::vector<std::filesystem::path> draw(StudioContext& context);
    bool running() const { return !running_.empty(); }

private:
    struct Running {
        std::uint64_t job = 0;
        std::filesystem::path file;
    };
    std::vector<std::filesystem::path> follow(const std::vector<JobStatus>& jobs);
    void drawWritten(StudioContext& context);

    std::vector<Running> running_;
    std::vector<std::filesystem::path> written_; ///< newest first
};

} // namespace ars::ui
