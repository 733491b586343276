#pragma once

#include "engine/core/error.h"
#include "engine/scene/assets.h"

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

namespace ars {

/// The number in a photograph's name: the last digits of its stem ("00000012.jpg" and "frame_12.png" are 12).
std::optional<int> photographNumber(const std::filesystem::path& path);

/// The photographs of a camera beside a calibration: FOLDER/CAMERA/*, else FOLDER/images/CAMERA/*; jpg, jpeg and png in
/// any case, sorted by number, then by name. Folders below (masks) are left out. Where two differ in nothing but the
/// ending, the PNG is taken.
std::vector<std::filesystem::path> photographsOf(const std::filesystem::path& folder, std::string_view camera);

/// The photograph at an index of a camera's list (CameraSection::photograph, from 0). NotFound says what there is.
Result<std::filesystem::path> findPhotograph(const CaptureAsset& capture, std::string_view camera, int index);

} // namespace ars
