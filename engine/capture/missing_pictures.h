#pragma once

#include "engine/capture/layout.h"

#include <set>
#include <utility>

namespace ars {

/// What a missing_img_files.txt says.
struct MissingPictures {
    std::set<std::pair<int, int>> views; ///< camera (index) and frame number
    std::set<int> cameras;               ///< those that it names
    std::size_t strangers = 0;           ///< lines that name no picture of the capture
};

/// One path a line, slashes leaning either way, whatever stands before the camera's folder: "D:\x\CAMERA\00000003.jpg",
/// "images/cam00/00000003.jpg", masks too. A file that is not there means that nothing is missing.
Result<MissingPictures> readMissingPictures(const std::filesystem::path& path, const CaptureLayout& layout,
                                            const ReadLimits& limits = defaultReadLimits());
/// The same of text.
MissingPictures parseMissingPictures(std::string_view text, const CaptureLayout& layout);

} // namespace ars
