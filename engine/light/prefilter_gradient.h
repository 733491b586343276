#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/light/prefilter.h"

#include <array>
#include <vector>

namespace ars {

/// dL/d of the levels of a PrefilteredLight, host: each (6, side, side, 3).
struct LightLevelGradients {
    std::array<std::vector<float>, kMaxLightLevels> specular;
    std::vector<float> diffuse;
    int levels = 0;

    /// Zeros in the sizes of a light's view.
    void reset(const LightView<float>& light);
};

/// Backward of prefilterLight at LightQuality::Exact, which is linear: dL/dBase from dL/d of the levels, the exact
/// adjoint of every filter (docs/math/light.md, Backward).
/// @param baseSize  side of the base
/// @param gradBase  (6 baseSize high, baseSize wide, 3), written
/// @return InvalidArgument when a level's size is not that of such a base
Status prefilterLightBackward(int baseSize, const PrefilterParams& params, const LightLevelGradients& levels,
                              ImageView<float> gradBase);

} // namespace ars
