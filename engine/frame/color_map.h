#pragma once

#include <glm/glm.hpp>

#include <string_view>

namespace ars {

/// How a number becomes a colour on the screen. Perceptual maps are polynomial fits of the published tables, within
/// 0.02 of them, turbo within 0.13 (at its dark end).
enum class ColorMap {
    Gray,
    Viridis, ///< matplotlib's default
    Magma,   ///< matplotlib's
    Turbo,   ///< Google's rainbow, for telling depths apart
    Signed,  ///< blue - white - red, 0 of the data in the middle of the range
};

/// "gray", "viridis", "magma", "turbo", "signed".
std::string_view colorMapName(ColorMap map);

/// The sRGB-encoded colour of t in [0, 1]; outside it is clamped, NaN is magenta.
glm::vec3 mapColor(ColorMap map, float t);

} // namespace ars
