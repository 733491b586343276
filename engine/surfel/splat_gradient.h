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

struct SplatBackwardParams {
    /// Channels whose gradient reaches their own attribute alone, not where surfels lie and how opaque they are: the
    /// paper's occlusion path (radius -> attribute only), and what only exists to be looked at.
    ChannelSet detached{Channel::Radius, Channel::RadiusPlus, Channel::RadiusMinus, Channel::Importance, Channel::Bone};
};

/// Memory that is kept between steps; never used from two threads at once.
struct SplatGradientWorkspace {
    std::vector<unsigned char> rows;         ///< projected surfels
    std::vector<float> features;             ///< (N, stride)
    std::vector<float> pixelGradients;       ///< (pixels, stride + 2): dL/dSum of the features, of depth, of opacity
    std::vector<float> alphaGradients;       ///< (entries) dL/dlog2Alpha
    std::vector<std::uint64_t> surfelStarts; ///< (N + 1)
    /// What one pair of a surfel and a pixel passes on.
    struct Entry {
        std::uint16_t x, y;  ///< pixel
        float alphaGradient; ///< dL/dlog2Alpha
        float weight;        ///< alpha T
    };
    std::vector<Entry> surfelEntries; ///< (entries) by surfel, in the order of pixels
    std::vector<std::uint32_t> counts;
};

/// The true gradient of splat() with its cut-offs held fixed (rendering reference 1.5; docs/math/splat.md). The sums
/// over pixels are taken in a fixed order: the result does not depend on the number of threads.
///
/// @param forward, contributors  what splat() gave for the same surfels, camera and parameters
/// @param gradients  dL/d of its pictures
/// @param out        every array is resized to N; entries of surfels that no pixel shows are 0
/// @return InvalidArgument when sizes differ, naming the picture; Unsupported on CUDA
Status splatBackward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                     const ContributorLists& contributors, const GBufferGradients& gradients,
                     SplatGradientWorkspace& workspace, SurfelGradients& out, const SplatBackwardParams& options = {});

} // namespace ars
