#include "engine/light/prefilter.h"

#include "engine/light/prefilter_kernels.h"
#include "engine/light/prefilter_math.h"
#include "engine/light/split_sum_lut.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <tuple>
#include <utility>
#include <vector>

namespace ars {
namespace {

constexpr std::string_view kOwner = "light: prefiltered levels";

bool isCubePicture(const ImageView<const float>& base) {
    const int n = base.width;
    return base.data && base.channels == 3 && n >= kSmallestLightBase && n <= kMaxCubeSize && (n & (n - 1)) == 0 &&
           base.height == 6 * n;
}

/// Integral of the GGX distribution over the angle from 0 to that of tangent t, but for a factor: of (1 + t^2) /
/// (t^2 + alpha^2)^2 dt.
double distributionIntegral(double t, double alpha) {
    const double b2 = alpha * alpha;
    return (1.0 - b2) * (t / (2.0 * b2 * (t * t + b2)) + std::atan(t / alpha) / (2.0 * b2 * alpha)) +
           std::atan(t / alpha) / alpha;
}

Status averagePool(const Device& device, ImageView<const float> source, ImageView<float> target) {
    if (device.kind == DeviceKind::Host) {
        cpu::averagePool(source, target);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::averagePool(source, target, device.index);
#else
    return makeError(ErrorCode::Unavailable, "light", "this build has no CUDA kernels");
#endif
}

Status filterLevel(const Device& device, FilterArguments arguments, bool diffuse) {
    if (device.kind == DeviceKind::Host) {
        diffuse ? cpu::filterDiffuse(arguments) : cpu::filterSpecular(arguments);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    ARS_TRY(arguments.areas, cuda::texelAreas(device, arguments.source.width, arguments.area));
    return diffuse ? cuda::filterDiffuse(arguments, device.index) : cuda::filterSpecular(arguments, device.index);
#else
    return makeError(ErrorCode::Unavailable, "light", "this build has no CUDA kernels");
#endif
}

/// A draft halves no level below this side: the smallest costs next to nothing.
constexpr int kSmallestDraftLevel = 16;

/// Sides of the levels: halves down to 16, one step further for a draft.
int levelSide(int baseSize, int level, LightQuality quality) {
    const int side = baseSize >> level;
    return quality == LightQuality::Draft ? std::max(side / 2, std::min(side, kSmallestDraftLevel)) : side;
}

/// The chain of averages: pooled[k] has side base >> k, for k >= 1.
Status poolChain(const Device& device, ImageView<const float> base, PrefilteredLight& light) {
    ImageView<const float> source = base;
    for (int k = 1; base.width >> k >= kSmallestLightLevel; ++k) {
        PixelBuffer& target = light.pooled[static_cast<std::size_t>(k)];
        const int side = base.width >> k;
        ARS_TRY_STATUS(target.reshape(device, side, 6 * side, 3, kOwner));
        ARS_TRY_STATUS(averagePool(device, source, target.view()));
        source = std::as_const(target).view();
    }
    return {};
}

ImageView<const float> pooledOfSide(ImageView<const float> base, const PrefilteredLight& light, int side) {
    std::size_t k = 0;
    while (base.width >> k > side) ++k;
    return k == 0 ? base : light.pooled[k].view();
}

} // namespace

#ifdef ARS_HAVE_CUDA
Result<const float*> cuda::texelAreas(const Device& device, int size, TexelArea area) {
    using Key = std::tuple<int, int, TexelArea>;
    static std::mutex mutex;
    // Never destroyed: when the process ends, a device may be gone before its tables.
    static auto& tables = *new std::map<Key, PixelBuffer>;
    const std::lock_guard<std::mutex> lock(mutex);
    PixelBuffer& table = tables[{device.index, size, area}];
    if (table.empty()) {
        ARS_TRY(PixelBuffer made, PixelBuffer::allocate(device, size, size, 1, "light: solid angles"));
        const std::vector<float> angles = texelSolidAngles(size, area);
        ARS_TRY_STATUS(uploadBuffer(made.memory(), std::as_bytes(std::span<const float>(angles))));
        table = std::move(made);
    }
    return std::as_const(table).view().data;
}
#endif

std::string_view lightQualityName(LightQuality quality) { return quality == LightQuality::Draft ? "draft" : "exact"; }

int lightLevelCount(int baseSize) {
    int levels = 1;
    while (baseSize >> levels >= kSmallestLightLevel) ++levels;
    return levels;
}

double specularCutoffCosine(double roughness) {
    const double alpha = roughness * roughness;
    const double all = distributionIntegral(1e12, alpha);
    double low = 0.0, high = 0.5 * 3.14159265358979323846;
    for (int i = 0; i < 60; ++i) {
        const double middle = 0.5 * (low + high);
        (distributionIntegral(std::tan(middle), alpha) < 0.99 * all ? low : high) = middle;
    }
    return std::cos(high);
}

LightView<float> PrefilteredLight::view(const EnvironmentPlacement& placement) const {
    LightView<float> view;
    view.levels = levels;
    for (int l = 0; l < levels; ++l) {
        const PixelBuffer& level = specular[static_cast<std::size_t>(l)];
        view.specular[l] = {level.view().data, level.width()};
    }
    view.diffuse = {diffuse.view().data, diffuse.width()};
    if (lut) {
        view.lut = lut->view().data;
        view.lutSize = lut->width();
    }
    view.worldToEnvironment = glm::mat3(worldToEnvironment(static_cast<double>(placement.rotationDeg)));
    view.scale = placement.scale;
    return view;
}

Status prefilterLight(const Device& device, ImageView<const float> base, const PrefilterParams& params,
                      PrefilteredLight& light) {
    if (!isCubePicture(base)) {
        return makeError(
            ErrorCode::InvalidArgument, "light base",
            fmt::format("{}x{} with {} channels, expected N x 6N with 3 and N a power of two from {} to {}", base.width,
                        base.height, base.channels, kSmallestLightBase, kMaxCubeSize));
    }
    light.levels = 0;
    ARS_TRY(light.lut, splitSumLut(device));
    ARS_TRY_STATUS(poolChain(device, base, light));
    const LightQuality quality = device.kind == DeviceKind::Host ? params.quality : LightQuality::Exact;
    const int levels = lightLevelCount(base.width);
    for (int l = 0; l < levels; ++l) {
        const int side = levelSide(base.width, l, quality);
        const double roughness = levelRoughness<double>(l, levels);
        PixelBuffer& target = light.specular[static_cast<std::size_t>(l)];
        ARS_TRY_STATUS(target.reshape(device, side, 6 * side, 3, kOwner));
        const FilterArguments arguments{pooledOfSide(base, light, side),
                                        target.view(),
                                        static_cast<float>(roughness * roughness * roughness * roughness),
                                        static_cast<float>(specularCutoffCosine(roughness)),
                                        params.area,
                                        nullptr};
        ARS_TRY_STATUS(filterLevel(device, arguments, false));
    }
    ARS_TRY_STATUS(light.diffuse.reshape(device, kSmallestLightLevel, 6 * kSmallestLightLevel, 3, kOwner));
    ARS_TRY_STATUS(filterLevel(
        device,
        {pooledOfSide(base, light, kSmallestLightLevel), light.diffuse.view(), 0.0f, 0.0f, params.area, nullptr},
        true));
    light.levels = levels;
    light.quality = quality;
    light.baseSize = base.width;
    return {};
}

Status prefilterLight(const Device& device, const CubeMap& base, const PrefilterParams& params,
                      PrefilteredLight& light) {
    if (!isCubePicture(base.view()) || device.kind == DeviceKind::Host) {
        return prefilterLight(device, base.view(), params, light);
    }
    PixelBuffer& copy = light.pooled[0];
    ARS_TRY_STATUS(copy.reshape(device, base.size, 6 * base.size, 3, kOwner));
    ARS_TRY_STATUS(uploadBuffer(copy.memory(), std::as_bytes(std::span<const float>(base.texels))));
    return prefilterLight(device, std::as_const(copy).view(), params, light);
}

} // namespace ars
