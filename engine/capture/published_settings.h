#pragma once

#include "engine/capture/capture.h"

#include <span>
#include <string_view>
#include <vector>

namespace ars {

/// A use of a published subject, in the words of the command line (trainingSplit's `cameras` and `frames`).
struct PublishedSplit {
    std::string_view name;
    std::string_view cameras; ///< empty: all
    std::string_view frames;  ///< empty: all; kFrameList: those of frame_ids.txt in the capture
};
inline constexpr std::string_view kFrameList = "frame_ids.txt";

/// A subject whose publishers or users wrote down how it is trained and tested (avatar reference 5).
struct PublishedSubject {
    std::string_view name; ///< "avatarrex_zzr", as published configurations call it
    CaptureKind kind;
    std::string_view alias;             ///< name of the folder as downloaded, without case
    int cameraCount = 0;                ///< of the whole recording; a capture with another number is not this one
    std::vector<PublishedSplit> splits; ///< the first is "train"
    std::string_view note;              ///< what is not published, else empty
};

std::span<const PublishedSubject> publishedSubjects();

/// The subject that a capture is, by the names in its path and the number of its cameras; null for any other.
const PublishedSubject* findPublishedSubject(CaptureKind kind, const std::filesystem::path& folder,
                                             std::size_t cameraCount);
/// By name; null where there is none.
const PublishedSubject* publishedSubject(std::string_view name);

} // namespace ars
