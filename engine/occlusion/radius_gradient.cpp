#include "engine/occlusion/radius_gradient.h"

#include "engine/core/parallel.h"
#include "engine/occlusion/radius_gradient_kernels.h"

#include <string_view>

namespace ars {

namespace {

template <typename T>
Status checkView(std::string_view name, const ImageView<T>& view, const ImageView<float>& expected) {
    if (!view.empty() && view.width == expected.width && view.height == expected.height && view.channels == 1)
        return {};
    return makeError(ErrorCode::InvalidArgument, "radius gradient",
                     fmt::format("{} is {}x{} with {} channels, expected {}x{} with 1", name, view.width, view.height,
                                 view.channels, expected.width, expected.height));
}

} // namespace

Status backwardRadius(const Device& device, const RadiusGradientParams& params, ImageView<const float> gradOcclusion,
                      ImageView<const float> occlusionPlus, ImageView<const float> occlusionMinus,
                      ImageView<const float> radiusPlus, ImageView<const float> radiusMinus,
                      ImageView<const float> opacity, ImageView<float> gradRadius) {
    ARS_TRY_STATUS(checkView("dL/dR", gradRadius, gradRadius));
    ARS_TRY_STATUS(checkView("dL/dO", gradOcclusion, gradRadius));
    ARS_TRY_STATUS(checkView("O+", occlusionPlus, gradRadius));
    ARS_TRY_STATUS(checkView("O-", occlusionMinus, gradRadius));
    ARS_TRY_STATUS(checkView("R+", radiusPlus, gradRadius));
    ARS_TRY_STATUS(checkView("R-", radiusMinus, gradRadius));
    ARS_TRY_STATUS(checkView("opacity", opacity, gradRadius));
    const RadiusGradientArguments arguments{
        gradOcclusion.data, occlusionPlus.data, occlusionMinus.data,     radiusPlus.data,   radiusMinus.data,
        opacity.data,       gradRadius.data,    gradRadius.pixelCount(), params.minOpacity, params.minRadiusStepM};
    if (device.kind == DeviceKind::Host) {
        parallelFor(arguments.pixels, [&arguments](std::size_t p) { radiusGradientPixel(arguments, p); }, 4096);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::backwardRadius(arguments, device.index);
#else
    return makeError(ErrorCode::Unavailable, "radius gradient", "this build has no CUDA kernels");
#endif
}

} // namespace ars
