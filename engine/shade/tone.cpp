#include "engine/shade/tone.h"

#include "engine/core/parameter_ranges.h"
#include "engine/shade/tone_kernels.h"

#include <cmath>

namespace ars {
namespace {

Result<ToneArguments> checkedArguments(const ToneParams& params, ImageView<const float> linear, int width, int height,
                                       int channels, bool there) {
    if (linear.empty() || !there) return makeError(ErrorCode::InvalidArgument, "tone", "a picture is missing");
    if ((linear.channels != 3 && linear.channels != 4) || linear.width < 1 || linear.height < 1) {
        return makeError(ErrorCode::InvalidArgument, "tone",
                         fmt::format("linear picture of {}x{} with {} channels, expected 3 or 4", linear.width,
                                     linear.height, linear.channels));
    }
    if (width != linear.width || height != linear.height || channels != 4) {
        return makeError(ErrorCode::InvalidArgument, "tone",
                         fmt::format("display picture is {}x{} with {} channels, expected {}x{} with 4", width, height,
                                     channels, linear.width, linear.height));
    }
    ARS_TRY_STATUS(checkRanges(toneParameters(), params, "tone"));
    ToneArguments arguments;
    arguments.linear = linear.data;
    arguments.channels = linear.channels;
    arguments.pixels = linear.pixelCount();
    arguments.tone = {std::exp2(params.exposureEv), static_cast<int>(params.curve), params.transparent,
                      glm::vec3(params.backgroundRed, params.backgroundGreen, params.backgroundBlue)};
    return arguments;
}

Status run(const Device& device, const ToneArguments& arguments) {
    if (device.kind == DeviceKind::Host) {
        cpu::toneMap(arguments);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::toneMap(arguments, device.index);
#else
    return makeError(ErrorCode::Unavailable, "tone", "this build has no CUDA kernels");
#endif
}

} // namespace

const ParameterTable<ToneParams>& toneParameters() {
    using P = ToneParams;
    using enum ParameterTier;
    static const ParameterTable<ToneParams> table{
        {"exposure", &P::exposureEv, {-16, 16}, "EV", Basic, "Stops of exposure before the curve."},
        {"curve", &P::curve, {}, "", Basic, "How bright light is brought onto the screen; none clips."},
        {"transparent", &P::transparent, {}, "", Advanced, "Keep alpha instead of composing over the background."},
        {"background_red", &P::backgroundRed, {0, 1}, "", Basic, "Background behind the avatar, linear red."},
        {"background_green", &P::backgroundGreen, {0, 1}, "", Basic, "Background behind the avatar, linear green."},
        {"background_blue", &P::backgroundBlue, {0, 1}, "", Basic, "Background behind the avatar, linear blue."},
    };
    return table;
}

Status toneMap(const Device& device, const ToneParams& params, ImageView<const float> linear,
               ImageView<float> display) {
    ARS_TRY(ToneArguments arguments,
            checkedArguments(params, linear, display.width, display.height, display.channels, !display.empty()));
    arguments.display = display.data;
    return run(device, arguments);
}

Status toneMap(const Device& device, const ToneParams& params, ImageView<const float> linear,
               ImageView<std::uint8_t> display) {
    ARS_TRY(ToneArguments arguments,
            checkedArguments(params, linear, display.width, display.height, display.channels, !display.empty()));
    arguments.bytes = display.data;
    return run(device, arguments);
}

} // namespace ars
