#pragma once

#include "engine/core/error.h"
#include "engine/shade/tone_gradient_math.h"

#include <cstddef>

namespace ars {

/// What both devices are given, checked: (pixels, 4) each.
struct ToneGradientArguments {
    const float* linear = nullptr;
    const float* gradDisplay = nullptr;
    float* gradLinear = nullptr;
    std::size_t pixels = 0;
    ToneSettings<float> tone;
};

/// One pixel from memory to memory.
ARS_HD inline void toneGradientPixel(const ToneGradientArguments& a, std::size_t i) {
    const float *pixel = a.linear + 4 * i, *g = a.gradDisplay + 4 * i;
    const glm::vec4 result =
        tonePixelBackward(a.tone, glm::vec4(pixel[0], pixel[1], pixel[2], pixel[3]), glm::vec4(g[0], g[1], g[2], g[3]));
    for (int c = 0; c < 4; ++c) a.gradLinear[4 * i + static_cast<std::size_t>(c)] = result[c];
}

namespace cuda {
/// Queued on the default stream of device `index`; does not wait.
Status toneMapBackward(const ToneGradientArguments& arguments, int index);
} // namespace cuda

} // namespace ars
