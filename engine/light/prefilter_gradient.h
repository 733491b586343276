#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/light/prefilter.h"

#include <array>
#include <vector>

namespace ars {

/// One number for every texel and colour of a PrefilteredLight's levels, on one device, not owned: dL/d of them. Cubes
/// are pictures `side` wide and 6 `side` high with 3 channels.
template <typename T>
struct LightLevelViews {
    std::array<ImageView<T>, kMaxLightLevels> specular;
    ImageView<T> diffuse;
    int levels = 0; ///< 0: there is no light

    /// Views that only read.
    operator LightLevelViews<const T>() const
        requires(!std::is_const_v<T>)
    {
        LightLevelViews<const T> views;
        for (std::size_t l = 0; l < specular.size(); ++l) views.specular[l] = specular[l];
        views.diffuse = diffuse;
        views.levels = levels;
        return views;
    }
};

/// dL/d of the levels of a PrefilteredLight in host memory that it owns: each (6, side, side, 3).
struct LightLevelGradients {
    std::array<std::vector<float>, kMaxLightLevels> specular;
    std::vector<float> diffuse;
    int levels = 0;

    /// Zeros in the sizes of a light's view.
    void reset(const LightView<float>& light);
    /// Valid until a vector is resized. A vector that is no cube has an empty view.
    LightLevelViews<float> view();
    LightLevelViews<const float> view() const;
};

/// Scratch memory of a device, kept between steps: keep one for each pipeline; never use one from two threads at once.
struct PrefilterGradientWorkspace {
    std::array<PixelBuffer, kMaxLightLevels> sums; ///< [l]: dL/d of the base averaged l times; [0] is not used
    PixelBuffer diffuse;                           ///< what the diffuse cube passes back
};

/// Backward of prefilterLight at LightQuality::Exact, which is linear: dL/dBase from dL/d of the levels, the exact
/// adjoint of every filter (docs/math/light.md, Backward). Every texel is a sum of its own in a fixed order: the same
/// numbers come out each time, on CUDA too.
/// @param device    of everything; on CUDA the work is queued on the default stream
/// @param baseSize  side of the base
/// @param gradBase  (6 baseSize high, baseSize wide, 3), written
/// @return InvalidArgument when a level's size is not that of such a base; OutOfMemory; Unavailable for CUDA in a build
///         without it
Status prefilterLightBackward(const Device& device, int baseSize, const PrefilterParams& params,
                              const LightLevelViews<const float>& levels, ImageView<float> gradBase,
                              PrefilterGradientWorkspace& workspace);

} // namespace ars
