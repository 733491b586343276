#pragma once

#include "engine/core/progress.h"
#include "engine/scene/assets.h"
#include "engine/scene/editor.h"
#include "engine/scene/export.h"
#include "engine/scene/frame_worker.h"
#include "engine/scene/project.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

struct SessionOptions {
    Device device;
    std::filesystem::path stateFolder = ars::stateFolder();
    bool autosave = true;
    Document document = newDocument(); ///< that it begins with
    int lightBase = kDefaultLightBase; ///< side of the lights' cubes, a power of two in [64, 4096]; small: quick tests
    std::function<void()> wake;        ///< called on any thread when update() has something to pick up; may be null
};

/// Work that goes on beside the window.
struct JobStatus {
    std::uint64_t id = 0;
    std::string title;   ///< "Opening forest.exr"
    std::string what;    ///< "prefiltering level 3 of 6"
    double fraction = 0; ///< [0, 1]; negative: unknown
    bool cancellable = true;
};

/// Something that the person should read.
struct Notice {
    enum class Kind { Done, Note, Error };
    Kind kind = Kind::Note;
    std::string title; ///< "Could not open forest.exr"
    std::string text;  ///< the error's sentence
    std::string hint;  ///< what to do about it; may be empty
};

/// What `open` makes of a file.
/// A training run is followed (trainingRun), and its newest checkpoint opened as an avatar.
enum class FileRole { Project, Avatar, Light, Clip, PoseFile, Capture, ComparePicture, PictureOfOurs, Run };

/// Plays the timeline. Not part of the document: where it stops is (timeline.seek).
struct Transport {
    bool playing = false;
    double timeS = 0.0;
};

/// The studio without its window: a document with history, what it needs from files, the frames that show it, and the
/// work beside. All calls on one thread, none waits; loading, filtering, rendering, saving and exporting run on threads
/// of their own and are picked up by update().
class Session {
public:
    explicit Session(SessionOptions options);
    ~Session(); ///< cancels jobs and waits for them

    // --- document
    const Document& document() const;
    const Editor& editor() const;
    const SceneAssets& assets() const; ///< of the document, or while they load those before
    /// Runs a command (see Editor::run). The error is returned and not put among the notices.
    Status run(std::string_view id, const Arguments& arguments = Arguments::object(), std::string_view gesture = {});
    Status commandEnabled(const Command& command) const;
    void endGesture();
    bool cancelGesture();
    bool undo();
    bool redo();
    void travel(std::size_t entries);

    // --- files
    /// Opens any file that the program knows, told by its content: loads beside, and when that went well runs the
    /// command that brings it into the document (projects and pictures of ours replace the document). A failure becomes
    /// a notice and leaves the document alone.
    void open(const std::filesystem::path& path);
    /// The same with the role given ("open as clip").
    void openAs(const std::filesystem::path& path, FileRole role);
    /// By content, without reading it all. Unsupported with what the file is.
    static Result<FileRole> roleOf(const std::filesystem::path& path);
    void newProject();
    /// @param project  where it lives; empty: nowhere yet
    /// @param saved    it is what stands there; false (a recovered document): it counts as modified
    void replaceDocument(Document document, const std::filesystem::path& project, bool saved = false);
    /// Writes beside; a notice tells the end.
    void save(const std::filesystem::path& path);
    const std::filesystem::path& projectPath() const; ///< empty: never saved
    RecentFiles& recentFiles();
    /// The run folder that was opened last, for whoever shows it; empty: none. The count goes up with every opening.
    const std::filesystem::path& trainingRun() const;
    std::uint64_t trainingRunsOpened() const;
    std::vector<Recovery> recoveries() const; ///< found when the session began

    // --- jobs
    std::vector<JobStatus> jobs() const;
    void cancel(std::uint64_t job);
    std::uint64_t screenshot(const ScreenshotOptions& options);
    std::uint64_t video(const VideoOptions& options);
    /// Any other work beside the window: `work` runs on a thread, `done` in update(). Returns the job's number. A
    /// failure becomes a notice; quiet work is neither listed nor spoken of.
    std::uint64_t start(std::string title, std::function<Status(const ProgressFunction&)> work,
                        std::function<void(const Status&)> done = {}, bool quiet = false);
    std::vector<Notice> takeNotices();
    void notify(Notice notice);
    /// What brings update() about, for work on threads of panels' own; callable on any thread.
    std::function<void()> waker() const;

    // --- frames
    /// Size of the picture in pixels, and what is to be seen besides the document's own buffer.
    void setViewport(int width, int height);
    void setWantedBuffers(std::vector<BufferId> buffers);
    /// True while the person drags something: drafts are shown.
    void setInteracting(bool interacting);
    std::shared_ptr<const Frame> frame() const;      ///< newest; null before the first
    std::shared_ptr<const Frame> otherFrame() const; ///< compare kinds Held and Avatar; null otherwise
    FrameWorker& worker();
    /// Time on the screen: the transport's while it plays.
    double timeS() const;
    Transport& transport();
    void play();
    void pause(); ///< stores the time in the document

    /// Once per window frame: adopts finished loads, advances the transport, autosaves, asks for frames.
    /// @param secondsSinceLast  for playing
    void update(double secondsSinceLast);
    /// Everything asked for is there: assets loaded, frame full, no jobs.
    bool settled() const;
    /// For scripts and tests without a window: update() until settled; false on timeout.
    bool settle(std::chrono::milliseconds timeout);

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace ars
