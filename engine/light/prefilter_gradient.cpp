#include "engine/light/prefilter_gradient.h"

#include "engine/light/prefilter_kernels.h"
#include "engine/light/prefilter_math.h"

#include <cmath>

namespace ars {

namespace {

std::size_t cubeFloats(int side) { return 18 * static_cast<std::size_t>(side) * static_cast<std::size_t>(side); }

Status checkLevel(const char* name, const std::vector<float>& values, int side) {
    if (values.size() == cubeFloats(side)) return {};
    return makeError(ErrorCode::InvalidArgument, "light gradient",
                     fmt::format("the {} level has {} numbers, expected {} (6 faces of {}x{})", name, values.size(),
                                 cubeFloats(side), side, side));
}

/// Adds what an average of 2x2 texels passes back.
void poolBackward(const std::vector<float>& from, int side, std::vector<float>& to) {
    const auto width = static_cast<std::size_t>(side);
    for (std::size_t row = 0; row < 6 * width; ++row) {
        for (std::size_t column = 0; column < width; ++column) {
            for (std::size_t c = 0; c < 3; ++c) {
                const float quarter = 0.25f * from[3 * (row * width + column) + c];
                const std::size_t upper = 3 * (2 * row * 2 * width + 2 * column) + c, lower = upper + 6 * width;
                to[upper] += quarter;
                to[upper + 3] += quarter;
                to[lower] += quarter;
                to[lower + 3] += quarter;
            }
        }
    }
}

} // namespace

void LightLevelGradients::reset(const LightView<float>& light) {
    levels = light.levels;
    for (int l = 0; l < kMaxLightLevels; ++l) {
        specular[static_cast<std::size_t>(l)].assign(l < levels ? cubeFloats(light.specular[l].size) : 0, 0.0f);
    }
    diffuse.assign(cubeFloats(light.diffuse.size), 0.0f);
}

Status prefilterLightBackward(int baseSize, const PrefilterParams& params, const LightLevelGradients& levels,
                              ImageView<float> gradBase) {
    const int count = baseSize >= kSmallestLightBase ? lightLevelCount(baseSize) : 0;
    if (count == 0 || levels.levels != count || gradBase.width != baseSize || gradBase.height != 6 * baseSize ||
        gradBase.channels != 3) {
        return makeError(ErrorCode::InvalidArgument, "light gradient",
                         fmt::format("{} levels and a {}x{}x{} base, expected those of a base of side {}",
                                     levels.levels, gradBase.width, gradBase.height, gradBase.channels, baseSize));
    }
    // sums[k]: dL/d of the base averaged k times, from its own level and from the averages behind it.
    std::vector<std::vector<float>> sums(static_cast<std::size_t>(count));
    for (int l = 0; l < count; ++l) {
        const auto level = static_cast<std::size_t>(l);
        const int side = baseSize >> l;
        ARS_TRY_STATUS(checkLevel("specular", levels.specular[level], side));
        sums[level].resize(cubeFloats(side));
        const double roughness = levelRoughness<double>(l, count);
        const FilterArguments arguments{{levels.specular[level].data(), side, 6 * side, 3},
                                        {sums[level].data(), side, 6 * side, 3},
                                        static_cast<float>(roughness * roughness * roughness * roughness),
                                        static_cast<float>(specularCutoffCosine(roughness)),
                                        params.area,
                                        nullptr};
        cpu::filterSpecularAdjoint(arguments);
    }
    ARS_TRY_STATUS(checkLevel("diffuse", levels.diffuse, kSmallestLightLevel));
    std::vector<float> diffuse(cubeFloats(kSmallestLightLevel));
    cpu::filterDiffuseAdjoint({{levels.diffuse.data(), kSmallestLightLevel, 6 * kSmallestLightLevel, 3},
                               {diffuse.data(), kSmallestLightLevel, 6 * kSmallestLightLevel, 3},
                               0.0f,
                               0.0f,
                               params.area,
                               nullptr});
    std::vector<float>& smallest = sums.back();
    for (std::size_t i = 0; i < smallest.size(); ++i) smallest[i] += diffuse[i];
    for (int l = count - 1; l > 0; --l)
        poolBackward(sums[static_cast<std::size_t>(l)], baseSize >> l, sums[static_cast<std::size_t>(l - 1)]);
    std::copy(sums[0].begin(), sums[0].end(), gradBase.data);
    return {};
}

} // namespace ars
