#pragma once

#include "engine/capture/capture.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// A prepared view in few bytes that keep every number: colours and alpha in 8 bits where all of them fit, else in 16,
/// the band in one bit, what is unknown in another. About 4 bytes a pixel for an 8-bit capture that is neither scaled
/// nor undistorted.
std::vector<std::byte> packView(const CapturedView& view);
/// Exactly what was packed. BadFile for bytes that packView did not write, by structure and checksum.
Result<CapturedView> unpackView(std::span<const std::byte> bytes);

/// Reads views of one capture with one set of options and keeps them, packed, in memory (least recently used go first)
/// and, if asked, in a folder of files that may be deleted at any moment. Safe to use from several threads.
class ViewCache {
public:
    struct Options {
        ViewOptions view;
        std::size_t memoryBytes = std::size_t(1) << 30;
        std::filesystem::path folder; ///< empty: memory only
        std::size_t folderBytes = std::size_t(8) << 30;
    };
    struct Counts {
        std::uint64_t fromMemory = 0, fromFolder = 0, decoded = 0;
    };

    /// Io where the folder cannot be made or listed.
    static Result<std::unique_ptr<ViewCache>> open(std::shared_ptr<const Capture> capture, Options options);
    ~ViewCache();
    ViewCache(const ViewCache&) = delete;
    ViewCache& operator=(const ViewCache&) = delete;

    /// readView, or what an earlier one gave: bit for bit the same. A file in the folder counts only for pictures of
    /// the same path, size, time of change, camera and options; a damaged one is passed over. What the disk refuses to
    /// keep is not kept, with one warning in the log.
    Result<std::shared_ptr<const CapturedView>> read(ViewId view);

    std::size_t memoryBytes() const; ///< held now
    Counts counts() const;

private:
    ViewCache();
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace ars
