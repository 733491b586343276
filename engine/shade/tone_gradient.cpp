#include "engine/shade/tone_gradient.h"

#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/shade/tone_gradient_kernels.h"

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

} // namespace

Status toneMapBackward(const Device& device, const ToneParams& params, ImageView<const float> linear,
                       ImageView<const float> gradDisplay, ImageView<float> gradLinear) {
    ARS_TRY_STATUS(checkRanges(toneParameters(), params, "tone gradient"));
    ARS_TRY_STATUS(checkView("the linear picture", linear.width, linear.height, linear.channels, linear));
    ARS_TRY_STATUS(checkView("dL/ddisplay", gradDisplay.width, gradDisplay.height, gradDisplay.channels, linear));
    ARS_TRY_STATUS(checkView("dL/dlinear", gradLinear.width, gradLinear.height, gradLinear.channels, linear));
    if (linear.empty() || gradDisplay.empty() || gradLinear.empty()) {
        return makeError(ErrorCode::InvalidArgument, "tone gradient", "a picture is missing");
    }
    const ToneSettings<float> tone{std::exp2(params.exposureEv), static_cast<int>(params.curve), params.transparent,
                                   glm::vec3(params.backgroundRed, params.backgroundGreen, params.backgroundBlue)};
    const ToneGradientArguments arguments{linear.data, gradDisplay.data, gradLinear.data, linear.pixelCount(), tone};
    if (device.kind == DeviceKind::Host) {
        parallelFor(arguments.pixels, [&arguments](std::size_t i) { toneGradientPixel(arguments, i); }, 2048);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::toneMapBackward(arguments, device.index);
#else
    return makeError(ErrorCode::Unavailable, "tone gradient", "this build has no CUDA kernels");
#endif
}

} // namespace ars
