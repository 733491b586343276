#include "engine/occlusion/radius_gradient.h"

#include "engine/core/parallel.h"
#include "engine/occlusion/radius_gradient_math.h"

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

Status backwardRadius(const RadiusGradientParams& params, ImageView<const float> gradOcclusion,
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
    parallelFor(
        gradRadius.pixelCount(),
        [&](std::size_t p) {
            const bool covered = opacity[p] >= params.minOpacity;
            gradRadius[p] = covered
                                ? gradOcclusion[p] * occlusionSlope(occlusionPlus[p], occlusionMinus[p], radiusPlus[p],
                                                                    radiusMinus[p], params.minRadiusStepM)
                                : 0.0f;
        },
        4096);
    return {};
}

} // namespace ars
