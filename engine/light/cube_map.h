#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/io/image.h"
#include "engine/light/light_math.h"

#include <vector>

namespace ars {

inline constexpr int kMaxCubeSize = 4096; ///< side of a face

/// Linear radiance from all directions as six square faces: (6, size, size, 3), faces +x -x +y -y +z -z, rows from the
/// top (directions: cubeFaceAxes). As a picture it is `size` wide and 6 `size` high.
struct CubeMap {
    int size = 0;
    std::vector<float> texels;

    CubeMap() = default;
    explicit CubeMap(int side)
        : size(side),
          texels(static_cast<std::size_t>(18) * static_cast<std::size_t>(side) * static_cast<std::size_t>(side)) {}

    float* texel(int face, int row, int column) { return texels.data() + 3 * cubeTexelIndex(face, row, column, size); }
    const float* texel(int face, int row, int column) const {
        return texels.data() + 3 * cubeTexelIndex(face, row, column, size);
    }
    ImageView<const float> view() const { return {texels.data(), size, 6 * size, 3}; }
    ImageView<float> view() { return {texels.data(), size, 6 * size, 3}; }
    CubeView<float> lookupView() const { return {texels.data(), size}; }
};

/// How much of the sphere a texel counts for.
enum class TexelArea {
    Exact,     ///< its solid angle; all texels sum to 4 pi
    Nvdiffrec, ///< the product of arc tangents of nvdiffrec's kernels, about 8 % too much at 16x16; for parity only
};

/// (size, size): the weight of every texel of one face, steradians; all faces are alike.
std::vector<float> texelSolidAngles(int size, TexelArea area = TexelArea::Exact);

/// Lat-long picture (docs/conventions.md, Environments) to cube. Picture: linear, 3 channels, finite, not negative.
///
/// What is brighter than its surroundings (a sun) is carried over texel by texel with its flux, the rest is sampled
/// bilinearly on a grid in every cube texel: the sum of radiance times solid angle is kept within 1e-3 whatever the two
/// sizes are.
/// @param size  side of a face, [1, kMaxCubeSize]
/// @return InvalidArgument: size, channels or colour space.
Result<CubeMap> cubeFromLatLong(const Image& latLong, int size);

/// Cube to lat-long, bilinear across edges; four samples a pixel. InvalidArgument: sides outside [1, 32768].
Result<Image> latLongFromCube(const CubeMap& cube, int width, int height);

/// Integral of radiance over the sphere, W/m^2 or what the radiance's unit makes of it (constant L: 4 pi L).
glm::dvec3 totalFlux(const CubeMap& cube);
glm::dvec3 totalFlux(const Image& latLong);

/// The direction of a place in a lat-long picture, u and v in [0, 1] from its left and top edge, and back.
glm::dvec3 latLongDirection(double u, double v);
glm::dvec2 latLongPlace(const glm::dvec3& direction);

} // namespace ars
