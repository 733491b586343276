#include "engine/shade/tone_gradient.h"

#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/shade/tone_gradient_math.h"

#include <cmath>
#include <string_view>

namespace ars {

namespace {

Status checkView(std::string_view name, int width, int height, int channels, const ImageView<const float>& linear) {
    if (width == linear.width && height == linear.height && channels == 4) return {};
    return makeError(ErrorCode::InvalidArgument, "tone gradient",
                     fmt::format("{} is {}x{} with {} channels, expected {}x{} with 4", name, width, height, channels,
                                 linear.width, linear.height));
}

glm::vec4 pixelOf(const ImageView<const float>& view, std::size_t pixel) {
    const float* p = view.pixel(pixel);
    return {p[0], p[1], p[2], p[3]};
}

} // namespace

Status toneMapBackward(const ToneParams& params, ImageView<const float> linear, ImageView<const float> gradDisplay,
                       ImageView<float> gradLinear) {
    ARS_TRY_STATUS(checkRanges(toneParameters(), params, "tone gradient"));
    ARS_TRY_STATUS(checkView("the linear picture", linear.width, linear.height, linear.channels, linear));
    ARS_TRY_STATUS(checkView("dL/ddisplay", gradDisplay.width, gradDisplay.height, gradDisplay.channels, linear));
    ARS_TRY_STATUS(checkView("dL/dlinear", gradLinear.width, gradLinear.height, gradLinear.channels, linear));
    const ToneSettings<float> tone{std::exp2(params.exposureEv), static_cast<int>(params.curve), params.transparent,
                                   glm::vec3(params.backgroundRed, params.backgroundGreen, params.backgroundBlue)};
    parallelFor(
        linear.pixelCount(),
        [&](std::size_t p) {
            const glm::vec4 g = tonePixelBackward(tone, pixelOf(linear, p), pixelOf(gradDisplay, p));
            float* to = gradLinear.pixel(p);
            for (int c = 0; c < 4; ++c) to[c] = g[c];
        },
        2048);
    return {};
}

} // namespace ars
