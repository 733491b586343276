#pragma once

#include "engine/scene/asset_store.h"
#include "engine/scene/jobs.h"
#include "engine/scene/session.h"
#include "engine/scene/session_notices.h"

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars {

/// What a session consists of; shared by session*.cpp alone.
struct Session::State {
    using Clock = std::chrono::steady_clock;

    explicit State(SessionOptions given);
    ~State();

    SessionOptions options;
    std::vector<Recovery> recoveries; ///< looked for before this program saves its own
    std::optional<Autosave> autosave;
    RecentFiles recentFiles;
    Editor editor;
    Clipboard clipboard;
    std::filesystem::path projectPath;
    std::filesystem::path trainingRun;
    std::uint64_t trainingRunsOpened = 0;
    std::vector<Notice> notices;

    std::unique_ptr<JobRunner> jobs;
    AssetStore store;
    FrameWorker worker;
    std::unique_ptr<FrameWorker> otherWorker; ///< only while the other side is seen

    Transport transport;
    int width = 0, height = 0;
    std::vector<BufferId> wantedBuffers;
    bool interacting = false;
    std::optional<Clock::time_point> lastGesture;
    /// What the last update() saw: where nothing changed there is nothing to do.
    struct Seen {
        std::uint64_t document = 0, assets = 0;
        bool dragging = false;
        bool other = false;
        bool operator==(const Seen&) const = default;
    };
    std::optional<Seen> seen;
    std::string frameError;                  ///< that was told last
    std::shared_ptr<const Frame> errorFrame; ///< what was shown then
    bool asked = false;                      ///< frames of the present state have been asked for

    void notify(Notice notice) { notices.push_back(std::move(notice)); }
    CommandContext context(double timeS) { return {store.assets(), clipboard, timeS}; }
    Status run(std::string_view id, const Arguments& arguments, std::string_view gesture = {});
    double timeS() const { return transport.playing ? transport.timeS : editor.document().timeline.timeS; }
    /// Something is being dragged, or was a moment ago.
    bool dragging() const;
    bool moving() const { return dragging() || transport.playing; }
    void replace(Document document, const std::filesystem::path& project, bool saved);
    void stop(); ///< playing, without storing the time

    // session_open.cpp
    void openAs(const std::filesystem::path& path, FileRole role);
    void openProject(const std::filesystem::path& path, FileRole role);
    void openPose(const std::filesystem::path& path);
    void openAvatar(const std::filesystem::path& path, const std::string& source);
    void openRun(const std::filesystem::path& path);
    Status enterAvatar(const std::string& source);
    /// A trained avatar that is not there yet is loaded first, so that what it learned comes into the document with it.
    bool opensBeside(std::string_view command, const Arguments& arguments) const;
    void endOfGesture();
    void remember(const std::filesystem::path& path); ///< among the recent files
    void tell(const std::filesystem::path& path, const std::vector<std::string>& notes);
    Status enterCapture(const std::string& calibration);
    Status enterComparison(const std::string& file);
    AssetStore::Opening opening(const std::filesystem::path& path, std::function<Status()> edit);

    // session_frames.cpp
    bool otherSideSeen() const;
    void advanceTransport(double seconds);
    void askForFrames();
    void dropOtherWorker();
    void reportFailures();
    bool settled() const;
};

/// `path` as it stands in documents: absolute, without "." and "..".
std::filesystem::path absolutePath(const std::filesystem::path& path);

/// Layouts in which the other side of the comparison is seen.
bool showsTwoSides(ViewLayout layout);

} // namespace ars
