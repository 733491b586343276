#pragma once

#include "engine/frame/color_map.h"
#include "engine/surfel/gbuffer.h"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// Every picture that a frame can show or write: what splatting gives and what is computed from it.
enum class BufferId : std::uint8_t {
    Beauty,
    Radiance,
    Albedo,
    Roughness,
    Normal,
    Depth,
    Position,
    AmbientOcclusion,
    Radius,
    RadiusPlus,
    RadiusMinus,
    Importance,
    Bone,
    Opacity,
    Diffuse,
    Specular,
};
inline constexpr int kBufferCount = 16;

/// What the numbers are, which decides how they are shown.
enum class BufferKind {
    LinearColor,  ///< light: exposure and tone curve, then sRGB
    LinearAlbedo, ///< a reflectance: sRGB without exposure
    SrgbColor,    ///< shown as it is
    Direction,    ///< unit vectors, camera space: (1 + x, 1 - y, 1 - z) / 2, the usual colours of a normal map
    Place,        ///< metres, world space: each axis over its range
    Scalar,       ///< one number: colour map over its range
};

/// One row of the catalogue.
struct BufferInfo {
    BufferId id;
    std::string_view name;    ///< EXR layer and word on the command line; "beauty" is the layer without a name
    std::string_view label;   ///< for people
    std::string_view symbol;  ///< the paper's
    std::string_view letters; ///< EXR channels in order
    BufferKind kind;
    std::string_view unit;
    float minimum; ///< range that is shown by default
    float maximum;
    ColorMap colorMap;
    std::optional<Channel> channel; ///< where splatting writes it; empty: computed from others
    std::string_view help;

    int channels() const { return static_cast<int>(letters.size()); }
};

/// All rows, in the order of BufferId.
std::span<const BufferInfo> bufferCatalogue();
const BufferInfo& bufferInfo(BufferId id);

/// "all", or names with commas between them ("albedo,ao,normal"). "all" leaves out R+ and R-, which only training
/// has. InvalidArgument names the word and those that exist.
Result<std::vector<BufferId>> parseBuffers(std::string_view text);

} // namespace ars
