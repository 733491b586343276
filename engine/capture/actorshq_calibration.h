#pragma once

#include "engine/capture/calibration.h"

#include <string_view>

namespace ars {

/// ActorsHQ's calibration.csv: a header line with the columns name, w, h, rx, ry, rz, tx, ty, tz, fx, fy, px, py in any
/// order, and optionally k1, k2, k3; one line a camera, in the file's order, which is the cameras' numbering.
///
/// The file holds the camera's place in the world: x_world = Rodrigues(r) x_cam + t, metres, camera axes x right, y
/// down, z forward. It is inverted here: R = Rodrigues(r)^T, T = -R t. Focal lengths and principal points are fractions
/// of the picture: fx w, fy h, px w, py h pixels.
///
/// BadFile with the line for a column that is missing, a word that is no number, sizes and focal lengths that are not
/// positive, and a name that comes twice; LimitExceeded beyond 4,096 cameras.
Result<std::vector<CalibratedCamera>> parseActorsHqCalibration(std::string_view text);

/// The same of a file; the path is the error's place.
Result<std::vector<CalibratedCamera>> readActorsHqCalibration(const std::filesystem::path& path,
                                                              const ReadLimits& limits = defaultReadLimits());

} // namespace ars
