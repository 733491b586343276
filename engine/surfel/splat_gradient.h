#pragma once

#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "engine/surfel/gbuffer.h"
#include "engine/surfel/splat.h"
#include "engine/surfel/surfels.h"

#include <glm/glm.hpp>

#include <array>
#include <cstdint>
#include <vector>

namespace ars {

/// dL/d of the pictures that splatting wrote; an empty view passes nothing. Sizes and channels as the pictures'.
struct GBufferGradients {
    std::array<ImageView<const float>, kChannelCount> pictures;

    ImageView<const float>& operator[](Channel channel) { return pictures[static_cast<std::size_t>(channel)]; }
    const ImageView<const float>& operator[](Channel channel) const {
        return pictures[static_cast<std::size_t>(channel)];
    }
};

/// dL/d of N surfels, one array per attribute of Surfels. Quaternions: of the numbers as given, the length that
/// splatting divides out included. Attributes that the surfels lack or no gradient came for stay empty.
struct SurfelGradients {
    std::vector<glm::vec3> means;
    std::vector<float> rotations; ///< (N, 4)
    std::vector<glm::vec2> scales;
    std::vector<float> opacities;
    std::vector<glm::vec3> colors;
    std::vector<glm::vec3> albedos;
    std::vector<float> roughnesses;
    std::vector<float> radii;
    std::vector<float> radiiPlus;
    std::vector<float> radiiMinus;
    std::vector<float> importances;
    std::vector<glm::vec3> bones;
};

/// Where the gradients of N surfels go, all on one device: zeros when they are given, of which those of surfels that no
/// pixel shows stay.
struct SurfelGradientArrays {
    float* means = nullptr;                ///< (N, 3), and the next three: must be given
    float* rotations = nullptr;            ///< (N, 4)
    float* scales = nullptr;               ///< (N, 2)
    float* opacities = nullptr;            ///< (N)
    float* attributes[kChannelCount] = {}; ///< (N, channelWidth) by channel; null is not written
};

struct SplatBackwardParams {
    /// Channels whose gradient reaches their own attribute alone, not where surfels lie and how opaque they are: the
    /// paper's occlusion path (radius -> attribute only), and what only exists to be looked at.
    ChannelSet detached{Channel::Radius, Channel::RadiusPlus, Channel::RadiusMinus, Channel::Importance, Channel::Bone};
};

/// Memory that is kept between steps; never used from two threads at once.
struct SplatGradientWorkspace {
    // Host.
    SplatWorkspace tiles;             ///< the surfels of each tile, as the forward pass lists them
    Buffer instanceSums;              ///< what each pair of a surfel and a tile passes to the surfel
    Buffer slotStarts, slotInstances; ///< these pairs by surfel
    std::vector<Buffer> tileMemory;   ///< one per thread
    // CUDA.
    Buffer rows, features;                                     ///< projected surfels
    Buffer pixelGradients;                                     ///< dL/dSum of the features, of depth, of opacity
    Buffer alphaGradients;                                     ///< (entries) dL/dlog2Alpha
    Buffer entryPixels, entries, sortedEntries, sortedSurfels; ///< (entries)
    Buffer sortScratch, outputs;
};

/// The true gradient of splat() with its cut-offs held fixed (rendering reference 1.5; docs/math/splat.md). All sums
/// are taken in a fixed order: the result depends neither on the number of threads nor on chance.
///
/// @param surfels       host or CUDA arrays, those that splat() got
/// @param forward       what splat() gave for the same surfels, camera and parameters, on the same device
/// @param contributors  its lists. CUDA needs them; the host blends its tiles once more instead, which costs less than
///                      making and reading lists, and takes null.
/// @param gradients     dL/d of its pictures, on the surfels' device
/// @param out           on the host: every array is resized to N; entries of surfels that no pixel shows are 0. CUDA
///                      waits for the device to bring them.
/// @return InvalidArgument when sizes differ or something lies on another device, naming it; LimitExceeded above
///         2^31 - 1 entries of the lists (CUDA) or 2^32 - 1 pairs of a surfel and a tile (host); OutOfMemory naming the
///         part; Unavailable without CUDA kernels
Status splatBackward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                     const ContributorLists* contributors, const GBufferGradients& gradients,
                     SplatGradientWorkspace& workspace, SurfelGradients& out, const SplatBackwardParams& options = {});

/// The same to arrays on the surfels' device. On CUDA the work is queued on the default stream and not waited for.
/// @return also InvalidArgument where one of the first four arrays is missing
Status splatBackward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                     const ContributorLists* contributors, const GBufferGradients& gradients,
                     SplatGradientWorkspace& workspace, const SurfelGradientArrays& out,
                     const SplatBackwardParams& options = {});

} // namespace ars
