#include "engine/scene/editor.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <exception>
#include <tuple>
#include <utility>

namespace ars {

namespace {

constexpr std::array<std::string_view, 6> kNavigation{"camera.orbit", "camera.pan",  "camera.dolly",
                                                      "camera.fly",   "camera.look", "camera.roll"};
constexpr std::string_view kNavigationLabel = "Move camera";

template <typename T>
std::size_t heapBytes(const std::vector<T>& values) {
    return values.capacity() * sizeof(T);
}

std::size_t heapBytes(const StudioParams& studio) {
    std::size_t bytes = heapBytes(studio.lamps);
    for (const StudioLamp& lamp : studio.lamps) bytes += lamp.name.capacity();
    return bytes;
}

std::size_t sizeOf(const AvatarSection& avatar) {
    return sizeof(avatar) + avatar.source.capacity() + heapBytes(avatar.betas);
}

std::size_t sizeOf(const PoseSection& pose) {
    return sizeof(pose) + heapBytes(pose.pose.rotations) + heapBytes(pose.pose.expression);
}

std::size_t sizeOf(const TimelineSection& timeline) {
    std::size_t bytes = sizeof(timeline) + timeline.clip.capacity() + heapBytes(timeline.joints) +
                        heapBytes(timeline.root) + heapBytes(timeline.expression) + heapBytes(timeline.camera) +
                        heapBytes(timeline.lightRotationDeg) + heapBytes(timeline.lightExposureEv);
    for (const JointTrack& track : timeline.joints) bytes += heapBytes(track.keys);
    for (const auto& key : timeline.expression) bytes += heapBytes(key.value);
    for (const auto& track : timeline.radii) bytes += heapBytes(track);
    return bytes;
}

std::size_t sizeOf(const CameraSection& camera) {
    return sizeof(camera) + camera.capture.capacity() + camera.datasetCamera.capacity();
}

std::size_t sizeOf(const LightSection& light) {
    return sizeof(light) + light.file.capacity() + heapBytes(light.studio);
}

std::size_t sizeOf(const OcclusionSection& occlusion) { return sizeof(occlusion); }

std::size_t sizeOf(const ViewSection& view) {
    const CompareSection& compare = view.compare;
    std::size_t bytes = sizeof(view) + heapBytes(view.strip) + compare.file.capacity() + compare.layer.capacity();
    // Entries share what is held; counted for one of them at least.
    if (compare.held && compare.held.use_count() <= 4) {
        bytes += sizeof(HeldLook) + sizeOf(compare.held->pose) + heapBytes(compare.held->light.studio);
    }
    return bytes;
}

/// In the order of Editor::Sections.
constexpr auto kMembers = std::tuple(&Document::avatar, &Document::pose, &Document::timeline, &Document::camera,
                                     &Document::light, &Document::occlusion, &Document::view);
constexpr std::size_t kCameraSection = 3;

/// Calls `visit` with the number of every section as a compile-time constant.
template <typename Visit>
void forEachSection(Visit&& visit) {
    [&visit]<std::size_t... I>(std::index_sequence<I...>) {
        (visit(std::integral_constant<std::size_t, I>{}), ...);
    }(std::make_index_sequence<std::tuple_size_v<decltype(kMembers)>>{});
}

} // namespace

/// Fills the entry's sections; those that are equal are put back to the very bits they had (0 and -0 are equal).
bool Editor::difference(const Document& before, Document& after, Entry& entry) {
    bool differs = false;
    forEachSection([&](auto i) {
        constexpr auto member = std::get<i>(kMembers);
        if (before.*member == after.*member) {
            after.*member = before.*member;
            return;
        }
        differs = true;
        std::get<i>(entry.before) = before.*member;
        std::get<i>(entry.after) = after.*member;
    });
    return differs;
}

void Editor::apply(const Sections& sections, Document& document) {
    forEachSection([&](auto i) {
        if (const auto& section = std::get<i>(sections)) document.*std::get<i>(kMembers) = *section;
    });
}

/// Makes one entry of two that follow each other; sections that are back where they were leave it.
void Editor::append(Entry& entry, Entry&& later) {
    forEachSection([&](auto i) {
        auto& before = std::get<i>(entry.before);
        auto& after = std::get<i>(entry.after);
        if (!std::get<i>(later.after)) return;
        if (!before) before = std::move(std::get<i>(later.before));
        after = std::move(std::get<i>(later.after));
        if (*before == *after) {
            before.reset();
            after.reset();
        }
    });
    entry.bytes = bytesOf(entry);
}

bool Editor::isEmpty(const Entry& entry) {
    bool empty = true;
    forEachSection([&](auto i) { empty = empty && !std::get<i>(entry.after); });
    return empty;
}

bool Editor::isNavigation(const Entry& entry) {
    bool cameraAlone = true;
    forEachSection(
        [&](auto i) { cameraAlone = cameraAlone && std::get<i>(entry.after).has_value() == (i == kCameraSection); });
    return cameraAlone && std::find(kNavigation.begin(), kNavigation.end(), entry.commandId) != kNavigation.end();
}

std::size_t Editor::bytesOf(const Entry& entry) {
    std::size_t bytes = sizeof(entry) + entry.label.capacity() + entry.commandId.capacity();
    forEachSection([&](auto i) {
        for (const Sections* sections : {&entry.before, &entry.after}) {
            if (const auto& section = std::get<i>(*sections)) bytes += sizeOf(*section) - sizeof(*section);
        }
    });
    return bytes;
}

Editor::Editor(Document document) : document_(std::move(document)), saved_(document_) {}

Status Editor::run(std::string_view id, const Arguments& arguments, CommandContext& context, std::string_view gesture) {
    const Command* command = findCommand(id);
    if (!command) return makeError(ErrorCode::NotFound, std::string(id), "there is no command of this name");
    if (command->enabled) ARS_TRY_STATUS(command->enabled(document_, context));
    ARS_TRY(const Arguments checked, checkArguments(*command, arguments, document_, context));
    Document changed = document_;
    try {
        ARS_TRY_STATUS(command->apply(changed, checked, context));
    } catch (const std::exception& failure) {
        return makeError(ErrorCode::Internal, command->id,
                         fmt::format("the command failed, nothing was changed: {}", failure.what()));
    }
    if (gesture.empty() || gesture != gesture_) closeGesture();
    gesture_ = gesture;
    Entry entry;
    if (!difference(document_, changed, entry)) return {};
    entry.label = command->describe ? command->describe(checked) : command->label;
    entry.commandId = command->id;
    entry.bytes = bytesOf(entry);
    document_ = std::move(changed);
    ++version_;
    record(std::move(entry), gesture);
    return {};
}

void Editor::record(Entry entry, std::string_view gesture) {
    if (!gesture.empty() && gestureEntry_) {
        Entry& newest = entries_.back();
        bytes_ -= newest.bytes;
        if (newest.commandId == entry.commandId) newest.label = entry.label;
        append(newest, std::move(entry));
        bytes_ += newest.bytes;
        if (isEmpty(newest)) {
            dropBack();
            gestureEntry_ = false;
        }
    } else {
        // A drag that is cancelled or comes back leaves what could be redone.
        if (!gesture.empty() && undone_.empty()) {
            undone_.assign(std::make_move_iterator(entries_.begin() + static_cast<std::ptrdiff_t>(position_)),
                           std::make_move_iterator(entries_.end()));
            for (const Entry& undone : undone_) bytes_ -= undone.bytes;
        } else {
            for (std::size_t i = position_; i < entries_.size(); ++i) bytes_ -= entries_[i].bytes;
        }
        entries_.resize(position_);
        push(std::move(entry));
        gestureEntry_ = !gesture.empty();
        if (gesture.empty()) foldNavigation();
    }
    trim();
}

void Editor::push(Entry entry) {
    bytes_ += entry.bytes;
    entries_.push_back(std::move(entry));
    position_ = entries_.size();
}

void Editor::dropBack() {
    bytes_ -= entries_.back().bytes;
    entries_.pop_back();
    position_ = std::min(position_, entries_.size());
}

/// Joins the newest entry with the one before it where both only moved the camera.
void Editor::foldNavigation() {
    if (position_ != entries_.size() || position_ < 2) return;
    Entry& newest = entries_[position_ - 1];
    Entry& before = entries_[position_ - 2];
    if (!isNavigation(newest) || !isNavigation(before)) return;
    bytes_ -= before.bytes + newest.bytes;
    append(before, std::move(newest));
    before.label = kNavigationLabel;
    bytes_ += before.bytes;
    newest.bytes = 0;
    dropBack();
    if (isEmpty(entries_.back())) dropBack();
}

void Editor::closeGesture() {
    if (gesture_.empty()) return;
    gesture_.clear();
    if (gestureEntry_) {
        foldNavigation();
    } else if (position_ == entries_.size()) {
        for (Entry& entry : undone_) {
            bytes_ += entry.bytes;
            entries_.push_back(std::move(entry));
        }
    }
    gestureEntry_ = false;
    undone_.clear();
}

void Editor::endGesture() { closeGesture(); }

bool Editor::cancelGesture() {
    if (gesture_.empty()) return false;
    if (gestureEntry_) {
        apply(entries_.back().before, document_);
        ++version_;
        dropBack();
        gestureEntry_ = false;
    }
    closeGesture();
    return true;
}

bool Editor::undo() {
    closeGesture();
    if (position_ == 0) return false;
    apply(entries_[--position_].before, document_);
    ++version_;
    return true;
}

bool Editor::redo() {
    closeGesture();
    if (position_ == entries_.size()) return false;
    apply(entries_[position_++].after, document_);
    ++version_;
    return true;
}

std::string Editor::undoLabel() const { return canUndo() ? entries_[position_ - 1].label : std::string(); }
std::string Editor::redoLabel() const { return canRedo() ? entries_[position_].label : std::string(); }

std::vector<Editor::HistoryLine> Editor::history() const {
    std::vector<HistoryLine> lines;
    lines.reserve(entries_.size());
    for (std::size_t i = 0; i < entries_.size(); ++i) {
        lines.push_back({entries_[i].label, entries_[i].commandId, i < position_});
    }
    return lines;
}

void Editor::travel(std::size_t count) {
    closeGesture();
    count = std::min(count, entries_.size());
    while (position_ > count && undo()) {
    }
    while (position_ < count && redo()) {
    }
}

void Editor::replace(Document document, bool saved) {
    document_ = std::move(document);
    entries_.clear();
    undone_.clear();
    gesture_.clear();
    gestureEntry_ = false;
    position_ = 0;
    bytes_ = 0;
    ++version_;
    if (saved) return markSaved();
    saved_.reset();
    savedVersion_ = 0;
}

void Editor::markSaved() { markSaved(document_, version_); }

void Editor::markSaved(Document written, std::uint64_t version) {
    saved_ = std::move(written);
    savedVersion_ = version;
}

void Editor::setHistoryLimit(std::size_t bytes) {
    limit_ = bytes;
    trim();
}

void Editor::trim() {
    std::size_t dropped = 0;
    while (bytes_ > limit_ && dropped + 1 < position_) bytes_ -= entries_[dropped++].bytes;
    entries_.erase(entries_.begin(), entries_.begin() + static_cast<std::ptrdiff_t>(dropped));
    position_ -= dropped;
    while (bytes_ > limit_ && entries_.size() > std::max<std::size_t>(position_, 1)) dropBack();
}

} // namespace ars
