#pragma once

#include "engine/scene/command.h"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

namespace ars {

/// The document with its history. Undo returns to the identical document: an entry keeps the sections that it changed,
/// before and after.
///
/// Moving about with the camera (camera.orbit, pan, dolly, fly, look, roll) would swamp the history: entries in a row
/// that changed the free camera alone and in that way become one, "Move camera", as soon as their gestures have ended.
class Editor {
public:
    explicit Editor(Document document = newDocument());

    const Document& document() const { return document_; }
    /// Another number after every change.
    std::uint64_t version() const { return version_; }

    /// Runs a command as one undo entry; a command that changes nothing leaves none. Errors leave the document as it
    /// was. NotFound for an unknown id; InvalidArgument for arguments; Unavailable or what the command says.
    /// @param gesture  calls in a row with the same text that is not empty become one entry (a drag); a drag that
    ///                 ends where it began leaves none
    Status run(std::string_view id, const Arguments& arguments, CommandContext& context, std::string_view gesture = {});
    /// The next call begins an entry of its own, whatever its gesture.
    void endGesture();
    /// Takes back what the running gesture has done (Escape while dragging), and what could be redone before it can be
    /// again. False where none runs.
    bool cancelGesture();

    bool canUndo() const { return position_ > 0; }
    bool canRedo() const { return position_ < entries_.size(); }
    bool undo(); ///< false where there is nothing
    bool redo();
    std::string undoLabel() const; ///< "" where there is nothing
    std::string redoLabel() const;

    /// One line of the history panel.
    struct HistoryLine {
        std::string label;
        std::string commandId;
        bool done = true; ///< false: can be redone
    };
    std::vector<HistoryLine> history() const;
    /// Goes to where `count` entries are done.
    void travel(std::size_t count);

    /// Another document with an empty history (open, new).
    /// @param saved  false: it differs from everything on disk (recovered, from a picture), so it counts as modified
    void replace(Document document, bool saved = true);
    /// Whether it differs from the one that was last saved.
    bool modified() const { return savedVersion_ != version_ && !(saved_ && document_ == *saved_); }
    void markSaved();
    /// The same for a save that ran beside: what was written, and version() when it began.
    void markSaved(Document written, std::uint64_t version);

    /// Oldest entries are dropped beyond so many bytes (about), but never the newest; default 256 MiB.
    void setHistoryLimit(std::size_t bytes);

private:
    /// The sections that differ between two documents; the others are empty.
    using Sections =
        std::tuple<std::optional<AvatarSection>, std::optional<PoseSection>, std::optional<TimelineSection>,
                   std::optional<CameraSection>, std::optional<LightSection>, std::optional<OcclusionSection>,
                   std::optional<ViewSection>>;
    struct Entry {
        std::string label;
        std::string commandId;
        Sections before, after;
        std::size_t bytes = 0;
    };
    static bool difference(const Document& before, Document& after, Entry& entry);
    static void apply(const Sections& sections, Document& document);
    static void append(Entry& entry, Entry&& later);
    static bool isEmpty(const Entry& entry);
    static bool isNavigation(const Entry& entry);
    static std::size_t bytesOf(const Entry& entry);
    void closeGesture();
    void foldNavigation();
    void record(Entry entry, std::string_view gesture);
    void push(Entry entry);
    void dropBack();
    void trim();

    Document document_;
    std::optional<Document> saved_;
    std::uint64_t version_ = 1;
    std::uint64_t savedVersion_ = 1; ///< 0: never saved
    std::vector<Entry> entries_;
    std::size_t position_ = 0; ///< entries before it are done
    std::size_t bytes_ = 0;    ///< of all entries
    std::size_t limit_ = 256u << 20;
    std::string gesture_;       ///< the running one; empty: none
    bool gestureEntry_ = false; ///< the newest entry is the running gesture's
    std::vector<Entry> undone_; ///< what could be redone when the running gesture began
};

} // namespace ars
