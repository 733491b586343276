#pragma once

#include "engine/core/camera.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/occlusion/ambient_occlusion_math.h"
#include "engine/occlusion/ambient_occlusion_rows.h"

#include <cstddef>
#include <vector>

namespace ars {

/// Sines and cosines of every count of directions that the parameters allow, in the memory of one device.
///
/// For n azimuths, p = n rounded up to 16: cos(phi_i) (p), sin(phi_i) (p), then the same ordered by residue for subsets
/// (cos (p), sin (p): piece r of 16 holds the azimuths r, r + p/16, r + 2 p/16 ...). For n polar angles: sin, cos and
/// the weight cos sin, n each.
struct OcclusionTables {
    const int* azimuthOffsets = nullptr; ///< of the counts firstAzimuths, firstAzimuths + 1, ... into `values`
    const int* polarOffsets = nullptr;
    const float* values = nullptr;
    int firstAzimuths = 0;
    int firstPolarAngles = 0;

    ARS_HD const float* azimuths(int count) const { return values + azimuthOffsets[count - firstAzimuths]; }
    ARS_HD const float* polarAngles(int count) const { return values + polarOffsets[count - firstPolarAngles]; }
};

ARS_HD inline int roundedToLanes(int count) {
    return (count + kOcclusionLanes - 1) / kOcclusionLanes * kOcclusionLanes;
}

inline constexpr int kMaxOcclusionRadii = 3;
/// Side of the smallest tile of the depth bounds, pixels.
inline constexpr int kSmallestTile = 8;
/// Empty tiles beside each row of them, both sides together.
inline constexpr int kTileMargins = 32;

/// What both devices are given, checked: pointers of one device.
struct OcclusionArguments {
    OcclusionParams params;
    OcclusionMarch<float> march;
    OcclusionTables tables;
    const float* depth = nullptr;      ///< (height, width)
    const float* normal = nullptr;     ///< (height, width, 3)
    const float* importance = nullptr; ///< (height, width) or null
    const float* bone = nullptr;       ///< (height, width, 3) or null
    const float* opacity = nullptr;    ///< (height, width) or null
    const float* radius[kMaxOcclusionRadii] = {};
    float* occlusion[kMaxOcclusionRadii] = {};
    int radii = 1;
    float* sums = nullptr; ///< (height, width, 2) occluded and total weight so far, or null; then radii is 1
    int pass = 0;          ///< subset of the directions; with `sums` it counts from 0 and pixels that are complete rest
    bool subset = false;   ///< take one subset rather than all directions
    int firstRow = 0;      ///< host: of those that are written
    int endRow = 0;        ///< host: after the last of them
    float* paddedDepth = nullptr;   ///< (height + 2, stride) scratch
    float* tiles = nullptr;         ///< host: (3, tileCapacity) scratch, or null: nothing is skipped
    std::size_t tileCapacity = 0;   ///< tiles of kSmallestTile that cover the picture, with margins
    unsigned int* pixels = nullptr; ///< CUDA: [0] count, [1] next, then (height x width) indices; scratch

    ARS_HD bool covered(std::size_t pixel) const { return !opacity || opacity[pixel] >= kMinOpacity; }
    /// Usable depth at padded coordinates, 0 outside the picture.
    ARS_HD float depthAt(int column, int row) const {
        const int x = column - kOcclusionBorder, y = row - kOcclusionBorder;
        if (x < 0 || y < 0 || x >= march.width || y >= march.height) return 0.0f;
        const std::size_t at =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(march.width) + static_cast<std::size_t>(x);
        return usableDepth(depth[at], covered(at));
    }
};

/// One foreground pixel, ready to be marched.
struct OcclusionPixel {
    glm::vec3 origin{0.0f};                               ///< homogeneous
    glm::vec3 tangent{0.0f}, bitangent{0.0f}, pole{0.0f}; ///< homogeneous
    glm::vec3 position{0.0f}, normal{0.0f};               ///< camera space
    OcclusionGrid grid;
};

/// False for an empty pixel (ambient_occlusion.h, OcclusionInputs); its occlusion is 1. `column`, `row`: padded.
ARS_HD inline bool occlusionPixel(const OcclusionArguments& a, int column, int row, OcclusionPixel& pixel) {
    const std::size_t at = static_cast<std::size_t>(row - kOcclusionBorder) * static_cast<std::size_t>(a.march.width) +
                           static_cast<std::size_t>(column - kOcclusionBorder);
    if (!(usableDepth(a.depth[at], a.covered(at)) > 0.0f)) return false;
    pixel.position =
        filteredPosition(a.march, column, row, a.params.median, [&a](int c, int r) { return a.depthAt(c, r); });
    if (!(pixel.position.z > kOcclusionNearest)) return false;
    const glm::vec3 normal(a.normal[3 * at], a.normal[3 * at + 1], a.normal[3 * at + 2]);
    const glm::vec3 bone = a.bone ? glm::vec3(a.bone[3 * at], a.bone[3 * at + 1], a.bone[3 * at + 2]) : glm::vec3(0.0f);
    OcclusionFrame<float> frame;
    if (!occlusionFrame(normal, bone, frame)) return false;
    pixel.origin = toHomogeneous(a.march, pixel.position);
    pixel.tangent = toHomogeneous(a.march, frame.tangent);
    pixel.bitangent = toHomogeneous(a.march, frame.bitangent);
    pixel.pole = toHomogeneous(a.march, frame.normal);
    pixel.normal = frame.normal;
    const bool adaptive = a.params.adaptive != OcclusionAdaptive::Off && a.importance;
    pixel.grid = occlusionGrid(a.params.delta, a.params.alpha, adaptive ? a.importance[at] : 0.0f,
                               a.params.adaptive == OcclusionAdaptive::Azimuth);
    return true;
}

/// A radius that can be marched.
ARS_HD inline bool usableRadius(float radius) { return radius > 0.0f && finite(radius); }

namespace cpu {
/// Fills paddedDepth and writes every pixel of `occlusion`.
void ambientOcclusion(const OcclusionArguments& arguments);
/// The cost of the same picture by the plain evaluation, ray by ray.
OcclusionCost countTaps(const OcclusionArguments& arguments);

/// The row functions that this CPU can run, fastest first, by name.
struct NamedMarchRows {
    const char* name = "";
    MarchRows march = nullptr;
};
std::vector<NamedMarchRows> availableMarchRows();
/// Uses this one from now on (null: the fastest); tests compare them.
void setMarchRows(MarchRows march);
} // namespace cpu

namespace cuda {
/// Queued on the default stream of device `index`; does not wait.
Status ambientOcclusion(const OcclusionArguments& arguments, int index);
} // namespace cuda

} // namespace ars
