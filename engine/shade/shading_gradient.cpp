#include "engine/shade/shading_gradient.h"

#include "engine/core/parallel.h"
#include "engine/shade/shading_gradient_kernels.h"

#include <algorithm>
#include <string_view>

namespace ars {
namespace {

/// Pieces of the picture that collect the light's gradient for themselves and are then summed in their order: the
/// result does not depend on the number of threads. Few, because each has a copy of the light.
constexpr std::size_t kPieces = 4;

template <typename T>
Status checkView(std::string_view name, const ImageView<T>& view, int width, int height, int channels) {
    if (view.width == width && view.height == height && view.channels == channels && !view.empty()) return {};
    return makeError(ErrorCode::InvalidArgument, "shading gradient",
                     fmt::format("{} is {}x{} with {} channels, expected {}x{} with {}", name, view.width, view.height,
                                 view.channels, width, height, channels));
}

Status checkOptional(std::string_view name, const ImageView<float>& view, const Camera& camera, int channels) {
    return view.empty() ? Status{} : checkView(name, view, camera.width, camera.height, channels);
}

Status checkOutputs(const ShadingGradientOutputs& outputs, const Camera& camera, const LightView<float>& light) {
    ARS_TRY_STATUS(checkOptional("dL/dalbedo", outputs.albedo, camera, 3));
    ARS_TRY_STATUS(checkOptional("dL/droughness", outputs.roughness, camera, 1));
    ARS_TRY_STATUS(checkOptional("dL/dnormal", outputs.normal, camera, 3));
    ARS_TRY_STATUS(checkOptional("dL/dopacity", outputs.opacity, camera, 1));
    ARS_TRY_STATUS(checkOptional("dL/docclusion", outputs.occlusion, camera, 1));
    if (outputs.light.levels == 0) return {};
    if (outputs.light.levels != light.levels) {
        return makeError(
            ErrorCode::InvalidArgument, "shading gradient",
            fmt::format("dL/dlight has {} levels, expected the light's {}", outputs.light.levels, light.levels));
    }
    for (int l = 0; l < light.levels; ++l) {
        const int side = light.specular[l].size;
        ARS_TRY_STATUS(checkView(fmt::format("dL/dlight, level {},", l),
                                 outputs.light.specular[static_cast<std::size_t>(l)], side, 6 * side, 3));
    }
    return checkView("dL/dlight, the diffuse cube,", outputs.light.diffuse, light.diffuse.size, 6 * light.diffuse.size,
                     3);
}

ShadingGradientArguments makeArguments(const ShadingArguments& shading, ImageView<const float> gradBeauty,
                                       const ShadingGradientOutputs& outputs) {
    return {shading,
            gradBeauty.data,
            outputs.albedo.data,
            outputs.roughness.data,
            outputs.normal.data,
            outputs.opacity.data,
            outputs.occlusion.data};
}

/// A buffer of at least `bytes` on `device`; what it held is lost when it is made anew.
Status reserve(Buffer& buffer, const Device& device, std::size_t bytes) {
    if (buffer.data() && buffer.device() == device && buffer.bytes() >= bytes) return {};
    buffer = Buffer();
    ARS_TRY(buffer, Buffer::allocate(device, bytes, "shading gradient: light"));
    return {};
}

/// Each piece of the picture adds to its own part of `parts` (kPieces, layout.count), or to none without `layout`.
void backwardPieces(const ShadingGradientArguments& arguments, const LightLayout* layout, float* parts) {
    const auto width = static_cast<std::size_t>(arguments.shading.width);
    const std::size_t pixels = width * static_cast<std::size_t>(arguments.shading.height);
    const std::size_t size = (pixels + kPieces - 1) / kPieces;
    parallelFor(
        kPieces,
        [&](std::size_t piece) {
            float* part = layout ? parts + piece * layout->count : nullptr;
            if (part) std::fill_n(part, layout->count, 0.0f);
            for (std::size_t p = piece * size; p < std::min(pixels, (piece + 1) * size); ++p) {
                shadePixelBackward(arguments, static_cast<int>(p / width), static_cast<int>(p % width), layout,
                                   [part](std::size_t place, float value) { part[place] += value; });
            }
        },
        1);
}

void sumPieces(const LightLayout& layout, const float* parts, const LightLevelViews<float>& light) {
    for (int l = 0; l <= layout.levels; ++l) {
        const ImageView<float>& target =
            l < layout.levels ? light.specular[static_cast<std::size_t>(l)] : light.diffuse;
        const float* from = parts + layout.start[l];
        for (std::size_t i = 0; i < target.valueCount(); ++i) {
            float sum = from[i];
            for (std::size_t k = 1; k < kPieces; ++k) sum += from[k * layout.count + i];
            target[i] = sum;
        }
    }
}

Status backwardOnHost(const ShadingGradientArguments& arguments, const LightLevelViews<float>& light,
                      ShadingGradientWorkspace& workspace) {
    if (light.levels == 0) {
        backwardPieces(arguments, nullptr, nullptr);
        return {};
    }
    const LightLayout layout = lightLayout(arguments.shading.light);
    ARS_TRY_STATUS(reserve(workspace.light, {}, kPieces * layout.count * sizeof(float)));
    auto* parts = static_cast<float*>(workspace.light.data());
    backwardPieces(arguments, &layout, parts);
    sumPieces(layout, parts, light);
    return {};
}

#ifdef ARS_HAVE_CUDA
Status backwardOnCuda(const ShadingGradientArguments& arguments, const LightLevelViews<float>& light,
                      ShadingGradientWorkspace& workspace, const Device& device) {
    if (light.levels == 0) return cuda::shadeBackward(arguments, nullptr, light, device.index);
    cuda::LightSums sums;
    sums.layout = lightLayout(arguments.shading.light);
    // The sums, and behind them the bound.
    const std::size_t bytes = sums.layout.count * sizeof(long long);
    ARS_TRY_STATUS(reserve(workspace.light, device, bytes + sizeof(unsigned int)));
    sums.sums = static_cast<long long*>(workspace.light.data());
    sums.bound = reinterpret_cast<unsigned int*>(sums.sums + sums.layout.count);
    return cuda::shadeBackward(arguments, &sums, light, device.index);
}
#endif

} // namespace

Status shadeBackward(const Device& device, const ShadingParams& params, const ShadingInputs& inputs,
                     ImageView<const float> gradBeauty, const ShadingGradientOutputs& outputs,
                     ShadingGradientWorkspace& workspace) {
    ARS_TRY(const ShadingArguments shading, shadingArguments(params, inputs));
    ARS_TRY_STATUS(checkView("dL/dbeauty", gradBeauty, inputs.camera.width, inputs.camera.height, 4));
    ARS_TRY_STATUS(checkOutputs(outputs, inputs.camera, inputs.light));
    const ShadingGradientArguments arguments = makeArguments(shading, gradBeauty, outputs);
    if (device.kind == DeviceKind::Host) return backwardOnHost(arguments, outputs.light, workspace);
#ifdef ARS_HAVE_CUDA
    return backwardOnCuda(arguments, outputs.light, workspace, device);
#else
    return makeError(ErrorCode::Unavailable, "shading gradient", "this build has no CUDA kernels");
#endif
}

} // namespace ars
