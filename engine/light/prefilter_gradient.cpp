#include "engine/light/prefilter_gradient.h"

#include "engine/core/parallel.h"
#include "engine/light/prefilter_gradient_kernels.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <string_view>
#include <tuple>
#include <utility>

namespace ars {

namespace {

constexpr std::string_view kOwner = "light: gradient";

std::size_t cubeFloats(int side) { return 18 * static_cast<std::size_t>(side) * static_cast<std::size_t>(side); }

/// A vector as a cube's picture; empty where its length is no cube's.
template <typename T>
ImageView<T> cubePicture(T* data, std::size_t count) {
    const int side = static_cast<int>(std::lround(std::sqrt(static_cast<double>(count) / 18.0)));
    if (side < 1 || cubeFloats(side) != count) return {};
    return {data, side, 6 * side, 3};
}

template <typename T, typename Gradients>
LightLevelViews<T> viewsOf(Gradients& gradients) {
    LightLevelViews<T> views;
    views.levels = gradients.levels;
    for (std::size_t l = 0; l < views.specular.size(); ++l) {
        views.specular[l] = cubePicture<T>(gradients.specular[l].data(), gradients.specular[l].size());
    }
    views.diffuse = cubePicture<T>(gradients.diffuse.data(), gradients.diffuse.size());
    return views;
}

Status checkLevel(std::string_view name, const ImageView<const float>& level, int side) {
    if (level.data && level.width == side && level.height == 6 * side && level.channels == 3) return {};
    return makeError(ErrorCode::InvalidArgument, "light gradient",
                     fmt::format("the {} level is {}x{} with {} channels, expected {}x{} with 3", name, level.width,
                                 level.height, level.channels, side, 6 * side));
}

Status checkSizes(int baseSize, int count, const LightLevelViews<const float>& levels, ImageView<float> gradBase) {
    if (count == 0 || levels.levels != count || gradBase.empty() || gradBase.width != baseSize ||
        gradBase.height != 6 * baseSize || gradBase.channels != 3) {
        return makeError(ErrorCode::InvalidArgument, "light gradient",
                         fmt::format("{} levels and a {}x{}x{} base, expected those of a base of side {}",
                                     levels.levels, gradBase.width, gradBase.height, gradBase.channels, baseSize));
    }
    for (int l = 0; l < count; ++l) {
        ARS_TRY_STATUS(
            checkLevel(fmt::format("specular {}", l), levels.specular[static_cast<std::size_t>(l)], baseSize >> l));
    }
    return checkLevel("diffuse", levels.diffuse, kSmallestLightLevel);
}

/// `gradient` back through the filter of level l, written to `target`.
FilterArguments levelArguments(int level, int count, TexelArea area, ImageView<const float> gradient,
                               ImageView<float> target) {
    const double roughness = levelRoughness<double>(level, count);
    return {gradient,
            target,
            static_cast<float>(roughness * roughness * roughness * roughness),
            static_cast<float>(specularCutoffCosine(roughness)),
            area,
            nullptr};
}

Status addDiffuseOnHost(const FilterArguments& arguments, PrefilterGradientWorkspace& workspace) {
    ARS_TRY_STATUS(workspace.diffuse.reshape({}, arguments.source.width, arguments.source.height, 3, kOwner));
    FilterArguments apart = arguments;
    apart.target = workspace.diffuse.view();
    cpu::filterDiffuseAdjoint(apart);
    for (std::size_t i = 0; i < apart.target.valueCount(); ++i) arguments.target[i] += apart.target[i];
    return {};
}

void averageBackwardOnHost(ImageView<const float> smaller, ImageView<float> larger) {
    const auto width = static_cast<std::size_t>(larger.width);
    parallelFor(
        static_cast<std::size_t>(larger.height),
        [&](std::size_t row) {
            for (std::size_t column = 0; column < width; ++column) {
                addAverageBackward(smaller.data, larger.data, width, row, column);
            }
        },
        16);
}

#ifdef ARS_HAVE_CUDA
/// 1 / sum of weights of every texel of a level, on a CUDA device: made there once, as on the host.
Result<const float*> deviceScales(const Device& device, const AdjointArguments& arguments, TexelArea area) {
    using Key = std::tuple<int, int, TexelArea, float, float>;
    static std::mutex mutex;
    // Never destroyed: when the process ends, a device may be gone before its tables.
    static auto& known = *new std::map<Key, PixelBuffer>;
    const std::lock_guard<std::mutex> lock(mutex);
    const Key key{device.index, arguments.size, area, arguments.alphaSquared, arguments.cutoffCosine};
    const auto found = known.find(key);
    if (found != known.end()) return std::as_const(found->second).view().data;
    ARS_TRY(PixelBuffer made, PixelBuffer::allocate(device, arguments.size, 6 * arguments.size, 1, kOwner));
    ARS_TRY_STATUS(cuda::specularScales(arguments, made.view().data, device.index));
    return std::as_const(known[key] = std::move(made)).view().data;
}

Result<AdjointArguments> deviceArguments(const Device& device, const FilterArguments& a) {
    AdjointArguments arguments;
    arguments.source = a.source.data;
    arguments.target = a.target.data;
    arguments.size = a.source.width;
    arguments.alphaSquared = a.alphaSquared;
    arguments.cutoffCosine = a.cutoffCosine;
    ARS_TRY(arguments.areas, cuda::texelAreas(device, arguments.size, a.area));
    return arguments;
}
#endif

Status specularBackward(const Device& device, const FilterArguments& arguments) {
    if (device.kind == DeviceKind::Host) {
        cpu::filterSpecularAdjoint(arguments);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    ARS_TRY(AdjointArguments adjoint, deviceArguments(device, arguments));
    ARS_TRY(adjoint.scales, deviceScales(device, adjoint, arguments.area));
    return cuda::filterSpecularAdjoint(adjoint, device.index);
#else
    return makeError(ErrorCode::Unavailable, "light gradient", "this build has no CUDA kernels");
#endif
}

/// Added to what the target holds.
Status diffuseBackward(const Device& device, const FilterArguments& arguments, PrefilterGradientWorkspace& workspace) {
    if (device.kind == DeviceKind::Host) return addDiffuseOnHost(arguments, workspace);
#ifdef ARS_HAVE_CUDA
    ARS_TRY(AdjointArguments adjoint, deviceArguments(device, arguments));
    adjoint.add = true;
    return cuda::filterDiffuseAdjoint(adjoint, device.index);
#else
    return makeError(ErrorCode::Unavailable, "light gradient", "this build has no CUDA kernels");
#endif
}

Status averageBackward(const Device& device, ImageView<const float> smaller, ImageView<float> larger) {
    if (device.kind == DeviceKind::Host) {
        averageBackwardOnHost(smaller, larger);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::averagePoolBackward(smaller, larger, device.index);
#else
    return makeError(ErrorCode::Unavailable, "light gradient", "this build has no CUDA kernels");
#endif
}

} // namespace

void LightLevelGradients::reset(const LightView<float>& light) {
    levels = light.levels;
    for (int l = 0; l < kMaxLightLevels; ++l) {
        specular[static_cast<std::size_t>(l)].assign(l < levels ? cubeFloats(light.specular[l].size) : 0, 0.0f);
    }
    diffuse.assign(cubeFloats(light.diffuse.size), 0.0f);
}

LightLevelViews<float> LightLevelGradients::view() { return viewsOf<float>(*this); }
LightLevelViews<const float> LightLevelGradients::view() const { return viewsOf<const float>(*this); }

Status prefilterLightBackward(const Device& device, int baseSize, const PrefilterParams& params,
                              const LightLevelViews<const float>& levels, ImageView<float> gradBase,
                              PrefilterGradientWorkspace& workspace) {
    const bool filterable =
        baseSize >= kSmallestLightBase && baseSize <= kMaxCubeSize && (baseSize & (baseSize - 1)) == 0;
    const int count = filterable ? lightLevelCount(baseSize) : 0;
    ARS_TRY_STATUS(checkSizes(baseSize, count, levels, gradBase));
    // The base averaged l times gets what its own level and the averages behind it pass back.
    std::vector<ImageView<float>> sums{gradBase};
    for (int l = 0; l < count; ++l) {
        const auto level = static_cast<std::size_t>(l);
        const int side = baseSize >> l;
        if (l > 0) {
            ARS_TRY_STATUS(workspace.sums[level].reshape(device, side, 6 * side, 3, kOwner));
            sums.push_back(workspace.sums[level].view());
        }
        ARS_TRY_STATUS(
            specularBackward(device, levelArguments(l, count, params.area, levels.specular[level], sums[level])));
    }
    ARS_TRY_STATUS(diffuseBackward(device, {levels.diffuse, sums.back(), 0.0f, 0.0f, params.area, nullptr}, workspace));
    for (std::size_t l = sums.size() - 1; l > 0; --l) ARS_TRY_STATUS(averageBackward(device, sums[l], sums[l - 1]));
    return {};
}

} // namespace ars
