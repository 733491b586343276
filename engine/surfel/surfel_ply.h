#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/surfel/surfels.h"

#include <filesystem>

namespace ars {

/// Reads a set of surfels in the property layout of 3D Gaussian Splatting.
///
/// Element "vertex" with x y z (metres), rot_0..3 (w x y z, of any length but 0), scale_0..1 (natural logarithm of
/// metres), opacity (logit), f_dc_0..2 (colour = 0.5 + 0.2820948 f_dc), and optionally albedo_0..2, roughness, radius,
/// importance (raw, linear). Other properties, scale_2 and nx ny nz among them, are not looked at. f_dc may be absent
/// as a whole; then there are no colours.
/// @return as readPly, and BadFile for a property that is missing or incomplete (albedo_0 without albedo_1) or holds a
///         number that is not finite, a row with a zero quaternion, or a scale whose exponential is no float.
Result<Surfels> readSurfelPly(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

/// The inverse, binary little-endian; also writes scale_2 = log 1e-6 and nx ny nz = 0 for other viewers. Opacities are
/// kept within [1e-6, 1 - 1e-6] so that their logit is finite. Without colours f_dc is 0 (mid grey). radiiPlus,
/// radiiMinus and bones are not written: they follow from the pose.
/// @return InvalidArgument as checkSurfels, or for a scale that is not positive (surfel named); Io as writePly.
Status writeSurfelPly(const std::filesystem::path& path, const Surfels& surfels);

} // namespace ars
