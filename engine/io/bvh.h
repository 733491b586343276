#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

enum class BvhChannel { Xposition, Yposition, Zposition, Xrotation, Yrotation, Zrotation };

/// "Xposition"
std::string_view bvhChannelName(BvhChannel channel);
constexpr bool isRotation(BvhChannel channel) { return channel >= BvhChannel::Xrotation; }
/// 0 for x, 1 for y, 2 for z.
constexpr int channelAxis(BvhChannel channel) { return static_cast<int>(channel) % 3; }

/// One joint of a BVH hierarchy. Names may repeat: the index is the joint.
struct BvhJoint {
    std::string name;
    int parent = -1;        ///< index of an earlier joint, -1 for a root
    glm::vec3 offset{0.0f}; ///< from the parent, in the file's own length unit
    /// In file order, which is the order of multiplication: rotations "Z X Y" mean R = Rz Rx Ry.
    std::vector<BvhChannel> channels;
    std::size_t firstChannel = 0;    ///< where this joint's numbers start in a frame
    std::vector<glm::vec3> endSites; ///< offsets of "End Site" leaves
};

/// A Biovision hierarchy with its motion, as the file has it: angles in degrees, lengths in the file's unit (CMU's are
/// inches / 0.45, others centimetres, decimetres or metres), no axis changed.
struct BvhFile {
    std::vector<BvhJoint> joints; ///< parents before children
    double frameTimeS = 1.0 / 30.0;
    std::size_t frameCount = 0;
    std::size_t channelCount = 0; ///< numbers per frame
    std::vector<float> values;    ///< (frameCount, channelCount)

    std::span<const float> frame(std::size_t index) const {
        return std::span<const float>(values).subspan(index * channelCount, channelCount);
    }
    /// First joint of this name, or -1.
    int find(std::string_view name) const;
};

/// Reads a BVH file.
///
/// Accepted beyond the letter of the format: any white space and line ends, line breaks anywhere in the numbers,
/// keywords in any case, several roots, names with blanks, "End Site" with a name, lines that start with '#'.
/// Refused: BadFile "line 12: expected CHANNELS, found ..." for anything else, numbers that are not finite (with frame,
/// joint and channel), fewer or more numbers than frames x channels; LimitExceeded for too many joints, too deep a
/// nesting, too many numbers.
Result<BvhFile> readBvh(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<BvhFile> parseBvh(std::span<const std::byte> bytes, const ReadLimits& limits = defaultReadLimits());

/// Joints are written depth first whatever their order in `file`, numbers with as many digits as floats need.
/// InvalidArgument where checkBvh fails.
Status writeBvh(const std::filesystem::path& path, const BvhFile& file);
Result<std::string> formatBvh(const BvhFile& file);

/// InvalidArgument when a parent does not come first, channel ranges do not fit together, a number is not finite, or a
/// name cannot stand in a file.
Status checkBvh(const BvhFile& file);

} // namespace ars
