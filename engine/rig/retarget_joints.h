#pragma once

#include "engine/core/error.h"
#include "engine/rig/retarget.h"

#include <array>
#include <map>
#include <string>
#include <string_view>

namespace ars {

/// Joints of a source skeleton by SMPL-X joint; -1 where the map names none that is there.
struct MappedJoints {
    std::array<int, kSmplxJointCount> first; ///< where the joint lies
    std::array<int, kSmplxJointCount> last;  ///< whose rotation it takes
};

/// A name as maps compare it: lower-case letters and digits, no namespace.
std::string comparableJointName(std::string_view name);

MappedJoints resolveMap(const RetargetMap& map, const Skeleton& source);

/// NotFound names the joints that a transfer needs and the map does not find.
Status checkMapped(const MappedJoints& mapped, const std::string& mapName, const Skeleton& source);

} // namespace ars
