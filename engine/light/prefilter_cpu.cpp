#include "engine/core/parallel.h"
#include "engine/light/prefilter_kernels.h"
#include "engine/light/prefilter_lanes.h"
#include "engine/light/prefilter_math.h"

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <tuple>
#include <vector>

namespace ars::cpu {
namespace {

constexpr std::size_t kRowGrain = 4;

struct FilterFunctions {
    lanes::SpecularSum specular;
    lanes::DiffuseSum diffuse;
};

constexpr FilterFunctions kPortable{lanes::specularSumPortable, lanes::diffuseSumPortable};

bool supported(FilterInstructions instructions) {
#if defined(__x86_64__)
    if (instructions == FilterInstructions::Avx2)
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    if (instructions == FilterInstructions::Avx512) {
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("fma");
    }
#endif
    return instructions == FilterInstructions::Portable;
}

/// Sixteen floats at once pay where a cone is wider than this, texels; narrower rows would mostly be cut off.
constexpr double kWideCone = 32.0;

FilterInstructions bestInstructions(double coneWidth) {
    if (coneWidth >= kWideCone && supported(FilterInstructions::Avx512)) return FilterInstructions::Avx512;
    return supported(FilterInstructions::Avx2) ? FilterInstructions::Avx2 : FilterInstructions::Portable;
}

std::atomic<FilterInstructions> chosenInstructions{FilterInstructions::Best};

FilterFunctions filterFunctions(float cosine, int size) {
    FilterInstructions instructions = chosenInstructions.load();
    if (instructions == FilterInstructions::Best) {
        // Texels of a face are about a quarter turn / size wide.
        instructions = bestInstructions(2.0 * std::acos(static_cast<double>(cosine)) * size / 1.5708);
    }
#if defined(__x86_64__)
    switch (instructions) {
    case FilterInstructions::Avx512:
        return {lanes::specularSumAvx512, lanes::diffuseSumAvx512};
    case FilterInstructions::Avx2:
        return {lanes::specularSumAvx2, lanes::diffuseSumAvx2};
    default:
        break;
    }
#endif
    return kPortable;
}

/// What depends on the side alone.
struct LevelGeometry {
    std::vector<float> inverseLength, solidAngle, coordinate;
};

LevelGeometry makeGeometry(std::size_t size, std::size_t stride, TexelArea area) {
    const std::vector<float> angles = texelSolidAngles(static_cast<int>(size), area);
    LevelGeometry geometry;
    geometry.inverseLength.assign(size * stride, 0.0f);
    geometry.solidAngle.assign(size * stride, 0.0f);
    geometry.coordinate.assign(stride + lanes::kPadding, 0.0f);
    for (std::size_t x = 0; x < size; ++x) {
        geometry.coordinate[x] = texelCoordinate<float>(static_cast<int>(x), static_cast<int>(size));
    }
    for (std::size_t y = 0; y < size; ++y) {
        for (std::size_t x = 0; x < size; ++x) {
            const double u = geometry.coordinate[x], v = geometry.coordinate[y];
            geometry.inverseLength[y * stride + x] = static_cast<float>(1.0 / std::sqrt(u * u + v * v + 1.0));
            geometry.solidAngle[y * stride + x] = angles[y * size + x];
        }
    }
    return geometry;
}

/// Kept for the next light: the sides are few, and making them takes as long as filtering a draft.
std::shared_ptr<const LevelGeometry> levelGeometry(std::size_t size, std::size_t stride, TexelArea area) {
    static std::mutex mutex;
    static std::map<std::pair<std::size_t, TexelArea>, std::shared_ptr<const LevelGeometry>> known;
    const std::lock_guard<std::mutex> lock(mutex);
    std::shared_ptr<const LevelGeometry>& geometry = known[{size, area}];
    if (!geometry) geometry = std::make_shared<const LevelGeometry>(makeGeometry(size, stride, area));
    return geometry;
}

/// The planes of one level and the memory behind them.
struct LevelPlanes {
    lanes::Planes planes;
    std::shared_ptr<const LevelGeometry> geometry;
    std::unique_ptr<float[]> colors;
};

LevelPlanes makePlanes(ImageView<const float> source, std::shared_ptr<const LevelGeometry> geometry) {
    const std::size_t size = static_cast<std::size_t>(source.width);
    const std::size_t stride = size + lanes::kPadding;
    const std::size_t plane = 6 * size * stride;
    LevelPlanes level;
    level.geometry = std::move(geometry);
    // Uninitialised: every float that is read is written below, on the thread that uses it.
    level.colors = std::unique_ptr<float[]>(new float[3 * plane]);
    float* colors = level.colors.get();
    parallelFor(
        6 * size,
        [&](std::size_t row) {
            const float* from = source.data + 3 * row * size;
            for (std::size_t c = 0; c < 3; ++c) {
                float* to = colors + c * plane + row * stride;
                for (std::size_t x = 0; x < size; ++x) to[x] = from[3 * x + c];
                // Padding has no solid angle, but 0 x NaN is NaN.
                for (std::size_t x = size; x < stride; ++x) to[x] = 0.0f;
            }
        },
        16);
    level.planes = {colors,
                    colors + plane,
                    colors + 2 * plane,
                    level.geometry->inverseLength.data(),
                    level.geometry->solidAngle.data(),
                    level.geometry->coordinate.data(),
                    size,
                    stride};
    return level;
}

LevelPlanes makePlanes(ImageView<const float> source, TexelArea area) {
    const std::size_t size = static_cast<std::size_t>(source.width);
    return makePlanes(source, levelGeometry(size, size + lanes::kPadding, area));
}

/// Planes whose texels all have the solid angle 1: the adjoint sums over what was filtered, not over the sphere.
LevelPlanes makeUnweightedPlanes(ImageView<const float> source, TexelArea area) {
    const std::size_t size = static_cast<std::size_t>(source.width), stride = size + lanes::kPadding;
    auto geometry = std::make_shared<LevelGeometry>(*levelGeometry(size, stride, area));
    for (std::size_t y = 0; y < size; ++y) {
        for (std::size_t x = 0; x < size; ++x) geometry->solidAngle[y * stride + x] = 1.0f;
    }
    return makePlanes(source, std::move(geometry));
}

lanes::Span laneSpan(const ConeSpan& span) {
    const auto index = [](int i) { return static_cast<std::size_t>(i); };
    return {index(span.face), index(span.x0), index(span.x1), index(span.y0),
            index(span.y1),   span.right,     span.down,      span.major};
}

/// The parts of the faces that a cone touches; a cone that ends inside its own face touches no other.
int coneSpans(const glm::vec3& axis, int ownFace, float cosine, float sine, int size, lanes::Span* spans) {
    ConeSpan own;
    int count = 0;
    if (coneSpan(axis, cosine, sine, ownFace, size, own)) spans[count++] = laneSpan(own);
    if (count == 1 && own.x0 > 0 && own.y0 > 0 && own.x1 < size && own.y1 < size) return count;
    for (int face = 0; face < 6; ++face) {
        ConeSpan span;
        if (face != ownFace && coneSpan(axis, cosine, sine, face, size, span)) spans[count++] = laneSpan(span);
    }
    return count;
}

/// body(float* texel, spans, count) for every texel of the target, with the cone about its direction.
template <typename Body>
void forEveryTexel(const FilterArguments& arguments, float cosine, float sine, Body&& body) {
    const int size = arguments.target.width, sourceSize = arguments.source.width;
    parallelFor(
        static_cast<std::size_t>(arguments.target.height),
        [&](std::size_t line) {
            const int face = static_cast<int>(line) / size, row = static_cast<int>(line) % size;
            const float v = texelCoordinate<float>(row, size);
            float* texel = arguments.target.at(static_cast<int>(line), 0);
            for (int column = 0; column < size; ++column, texel += 3) {
                const float u = texelCoordinate<float>(column, size);
                const glm::vec3 axis = glm::normalize(cubeDirection<float>(face, u, v));
                lanes::Span spans[6];
                body(texel, spans, coneSpans(axis, face, cosine, sine, sourceSize, spans));
            }
        },
        kRowGrain);
}

} // namespace

bool useFilterInstructions(FilterInstructions instructions) {
    if (instructions != FilterInstructions::Best && !supported(instructions)) return false;
    chosenInstructions = instructions;
    return true;
}

void averagePool(ImageView<const float> source, ImageView<float> target) {
    const std::size_t width = static_cast<std::size_t>(target.width);
    parallelFor(
        static_cast<std::size_t>(target.height),
        [&](std::size_t y) {
            const float* upper = source.data + 2 * y * 6 * width;
            const float* lower = upper + 6 * width;
            float* out = target.data + y * 3 * width;
            for (std::size_t x = 0; x < width; ++x) {
                for (std::size_t c = 0; c < 3; ++c) {
                    const std::size_t i = 6 * x + c;
                    out[3 * x + c] = 0.25f * (upper[i] + upper[i + 3] + lower[i] + lower[i + 3]);
                }
            }
        },
        16);
}

void filterSpecular(const FilterArguments& arguments) {
    const LevelPlanes level = makePlanes(arguments.source, arguments.area);
    const float cosine = arguments.cutoffCosine, sine = std::sqrt(1.0f - cosine * cosine);
    const lanes::SpecularSum sumSpans = filterFunctions(cosine, arguments.source.width).specular;
    forEveryTexel(arguments, cosine, sine, [&](float* texel, const lanes::Span* spans, int count) {
        float sum[4];
        sumSpans(level.planes, spans, count, arguments.alphaSquared, cosine, sum);
        const float scale = sum[3] > 0.0f ? 1.0f / sum[3] : 0.0f;
        for (int c = 0; c < 3; ++c) texel[c] = sum[c] * scale;
    });
}

void filterDiffuse(const FilterArguments& arguments) {
    const LevelPlanes level = makePlanes(arguments.source, arguments.area);
    const lanes::DiffuseSum sumSpans = filterFunctions(0.0f, arguments.source.width).diffuse;
    // The cone of a right angle: a hemisphere.
    forEveryTexel(arguments, 0.0f, 1.0f, [&](float* texel, const lanes::Span* spans, int count) {
        sumSpans(level.planes, spans, count, static_cast<float>(kDiffuseCosineLimit), texel);
    });
}

namespace {

/// 1 / sum of weights of every texel of a level. It depends on side and lobe alone: training asks for the same few
/// again and again, and summing them takes as long as the adjoint itself.
std::shared_ptr<const std::vector<float>> inverseWeights(const FilterArguments& arguments) {
    using Key = std::tuple<int, TexelArea, float, float>;
    static std::mutex mutex;
    static std::map<Key, std::shared_ptr<const std::vector<float>>> known;
    const Key key{arguments.source.width, arguments.area, arguments.alphaSquared, arguments.cutoffCosine};
    {
        const std::lock_guard<std::mutex> lock(mutex);
        const auto found = known.find(key);
        if (found != known.end()) return found->second;
    }
    const int size = arguments.source.width;
    const float cosine = arguments.cutoffCosine, sine = std::sqrt(1.0f - cosine * cosine);
    const lanes::SpecularSum sumSpans = filterFunctions(cosine, size).specular;
    const std::vector<float> black(arguments.source.valueCount(), 0.0f);
    const LevelPlanes level = makePlanes({black.data(), size, 6 * size, 3}, arguments.area);
    std::vector<float> sums(arguments.source.valueCount());
    FilterArguments summing = arguments;
    summing.target = {sums.data(), size, 6 * size, 3};
    forEveryTexel(summing, cosine, sine, [&](float* texel, const lanes::Span* spans, int count) {
        float sum[4];
        sumSpans(level.planes, spans, count, arguments.alphaSquared, cosine, sum);
        texel[0] = sum[3] > 0.0f ? 1.0f / sum[3] : 0.0f;
    });
    auto inverse = std::make_shared<std::vector<float>>(arguments.source.pixelCount());
    for (std::size_t i = 0; i < inverse->size(); ++i) (*inverse)[i] = sums[3 * i];
    const std::lock_guard<std::mutex> lock(mutex);
    return known[key] = std::move(inverse);
}

} // namespace

// Both weights are symmetric in the two directions but for the solid angle, which is that of the texel that was
// filtered: the adjoint is the same sum over the level's gradient (divided by the sum of its weights), times that solid
// angle.

void filterSpecularAdjoint(const FilterArguments& arguments) {
    const ImageView<const float>& gradient = arguments.source;
    const int size = gradient.width;
    const float cosine = arguments.cutoffCosine, sine = std::sqrt(1.0f - cosine * cosine);
    const lanes::SpecularSum sumSpans = filterFunctions(cosine, size).specular;
    const std::shared_ptr<const std::vector<float>> scales = inverseWeights(arguments);
    std::vector<float> divided(gradient.valueCount());
    for (std::size_t texel = 0; texel < scales->size(); ++texel) {
        const float* from = gradient.data + 3 * texel;
        const float scale = (*scales)[texel];
        for (std::size_t c = 0; c < 3; ++c) divided[3 * texel + c] = from[c] * scale;
    }
    const LevelPlanes level = makeUnweightedPlanes({divided.data(), size, 6 * size, 3}, arguments.area);
    const std::vector<float> angles = texelSolidAngles(size, arguments.area);
    forEveryTexel(arguments, cosine, sine, [&](float* texel, const lanes::Span* spans, int count) {
        float sum[4];
        sumSpans(level.planes, spans, count, arguments.alphaSquared, cosine, sum);
        const std::size_t index = static_cast<std::size_t>(texel - arguments.target.data) / 3;
        for (int c = 0; c < 3; ++c) texel[c] = sum[c] * angles[index % angles.size()];
    });
}

void filterDiffuseAdjoint(const FilterArguments& arguments) {
    const int size = arguments.source.width;
    const LevelPlanes level = makeUnweightedPlanes(arguments.source, arguments.area);
    const std::vector<float> angles = texelSolidAngles(size, arguments.area);
    const lanes::DiffuseSum sumSpans = filterFunctions(0.0f, size).diffuse;
    forEveryTexel(arguments, 0.0f, 1.0f, [&](float* texel, const lanes::Span* spans, int count) {
        sumSpans(level.planes, spans, count, static_cast<float>(kDiffuseCosineLimit), texel);
        const std::size_t index = static_cast<std::size_t>(texel - arguments.target.data) / 3;
        for (int c = 0; c < 3; ++c) texel[c] *= angles[index % angles.size()];
    });
}

} // namespace ars::cpu
