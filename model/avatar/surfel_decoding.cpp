#include "model/avatar/surfel_decoding.h"

#include "engine/surfel/knn.h"

#include <ATen/ATen.h>

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

constexpr float kMinRoughness = 0.08f;

double logit(double probability) { return std::log(probability / (1.0 - probability)); }

/// Normal as third axis; the first runs where the surface falls away from the map's axis (z).
glm::quat frameOf(const glm::vec3& normal) {
    glm::vec3 steep = glm::vec3(0.0f, 0.0f, 1.0f) - normal.z * normal;
    if (glm::dot(steep, steep) < 1e-8f) steep = glm::vec3(1.0f, 0.0f, 0.0f) - normal.x * normal;
    const glm::vec3 first = glm::normalize(steep);
    return glm::normalize(glm::quat_cast(glm::mat3(first, glm::cross(normal, first), normal)));
}

/// What a map pixel covers on a surface of this normal, as standard deviations along the frame's tangents.
glm::vec2 footprint(const glm::vec3& normal, float pixelM, const DecodingParams& params) {
    const float stretch = std::min(1.0f / std::max(std::abs(normal.z), 1e-3f), static_cast<float>(params.maxStretch));
    return static_cast<float>(params.scaleFactor) * pixelM * glm::vec2(stretch, 1.0f);
}

Result<std::vector<glm::vec2>> initialScales(const CanonicalMaps& maps, const DecodingParams& params) {
    std::vector<glm::vec2> scales(maps.pointCount());
    if (params.initialScale == InitialScale::Neighbours) {
        ARS_TRY(const std::vector<float> spacings, neighborDistances(maps.positions));
        for (std::size_t i = 0; i < scales.size(); ++i) {
            scales[i] = glm::vec2(static_cast<float>(params.scaleFactor) * spacings[i]);
        }
        return scales;
    }
    const float pixelM = 2.0f * maps.halfExtentM / static_cast<float>(maps.size);
    for (std::size_t i = 0; i < scales.size(); ++i) scales[i] = footprint(maps.normals[i], pixelM, params);
    return scales;
}

at::Tensor learnedZeros(std::int64_t points, std::int64_t width, bool learned) {
    if (!learned) return {};
    return at::zeros({points, width}).set_requires_grad(true);
}

at::Tensor withBase(const at::Tensor& raw, const at::Tensor& base, std::int64_t begin, std::int64_t width) {
    return base.defined() ? raw + base.slice(1, begin, begin + width) : raw;
}

/// Product of quaternions w, x, y, z, row by row.
at::Tensor quaternionProduct(const at::Tensor& a, const at::Tensor& b) {
    const std::vector<at::Tensor> p = a.unbind(1), q = b.unbind(1);
    return at::stack(
        {p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3], p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
         p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1], p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]},
        1);
}

} // namespace

const ParameterTable<DecodingParams>& decodingParameters() {
    using P = DecodingParams;
    static const ParameterTable<P> table{
        {"offset_scale", &P::offsetScale, {1e-4, 1}, "m", ParameterTier::Expert, "Metres per unit of raw position."},
        {"initial_scale",
         &P::initialScale,
         {},
         "",
         ParameterTier::Advanced,
         "Where scales begin: what a map pixel covers of the surface, or the distance to three neighbours."},
        {"scale_factor",
         &P::scaleFactor,
         {0.05, 10},
         "",
         ParameterTier::Advanced,
         "Initial standard deviation over that size."},
        {"max_stretch",
         &P::maxStretch,
         {1, 100},
         "",
         ParameterTier::Expert,
         "Largest stretch of a footprint where the surface turns away from the map's axis."},
        {"initial_opacity", &P::initialOpacity, {1e-3, 0.999}, "", ParameterTier::Advanced, "Opacity before training."},
        {"inset",
         &P::insetM,
         {-0.05, 0.05},
         "m",
         ParameterTier::Expert,
         "Surfels begin this far inside the template's surface."},
        {"initial_albedo", &P::initialAlbedo, {1e-3, 0.999}, "", ParameterTier::Expert, "Albedo before training."},
        {"initial_roughness",
         &P::initialRoughness,
         {0.08, 0.999},
         "",
         ParameterTier::Expert,
         "Roughness before training."},
        {"learn_base",
         &P::learnBase,
         {},
         "",
         ParameterTier::Advanced,
         "Surfels have base values of their own, learned beside the networks (an addition to the paper)."},
    };
    return table;
}

Result<SurfelBase> surfelBase(const CanonicalMaps& maps, const DecodingParams& params) {
    const std::size_t count = maps.pointCount();
    std::vector<glm::vec3> points(count);
    std::vector<float> rotations(4 * count);
    for (std::size_t i = 0; i < count; ++i) {
        points[i] = maps.positions[i] - static_cast<float>(params.insetM) * maps.normals[i];
        const glm::quat q = frameOf(maps.normals[i]);
        const std::array<float, 4> wxyz{q.w, q.x, q.y, q.z};
        std::copy(wxyz.begin(), wxyz.end(), rotations.begin() + static_cast<std::ptrdiff_t>(4 * i));
    }
    const auto n = static_cast<std::int64_t>(count);
    ARS_TRY(const std::vector<glm::vec2> scales, initialScales(maps, params));
    SurfelBase base;
    base.points = tensorOf(points);
    base.rotations = tensorOf(rotations).view({n, 4});
    base.logScales = at::log(tensorOf(scales));
    base.geometry = learnedZeros(n, 10, params.learnBase);
    base.materials = learnedZeros(n, 4, params.learnBase);
    base.colors = learnedZeros(n, 3, params.learnBase);
    return base;
}

DecodedSurfels decodeSurfels(const DecodingParams& params, const SurfelBase& base, const RawAttributes& raw) {
    DecodedSurfels decoded;
    SurfelTensors& surfels = decoded.surfels;
    if (raw.offsets.defined()) {
        decoded.offsets = params.offsetScale * withBase(raw.offsets, base.geometry, 0, 3);
        surfels.means = base.points + decoded.offsets;
        surfels.opacities =
            at::sigmoid(logit(params.initialOpacity) + withBase(raw.opacities, base.geometry, 3, 1)).squeeze(1);
        surfels.scales = at::exp(base.logScales + withBase(raw.scales.slice(1, 0, 2), base.geometry, 4, 2));
        const at::Tensor identity = at::tensor({1.0f, 0.0f, 0.0f, 0.0f}, base.rotations.options());
        surfels.rotations = quaternionProduct(base.rotations, identity + withBase(raw.rotations, base.geometry, 6, 4));
    }
    if (raw.albedos.defined()) {
        surfels.albedos = at::sigmoid(logit(params.initialAlbedo) + withBase(raw.albedos, base.materials, 0, 3));
        const double start = (params.initialRoughness - kMinRoughness) / (1.0 - kMinRoughness);
        surfels.roughnesses =
            (kMinRoughness + (1.0 - kMinRoughness) * at::sigmoid(logit(std::clamp(start, 1e-3, 0.999)) +
                                                                 withBase(raw.roughnesses, base.materials, 3, 1)))
                .squeeze(1);
    }
    if (raw.colors.defined()) surfels.colors = decodeColors(base, raw.colors);
    return decoded;
}

at::Tensor decodeColors(const SurfelBase& base, const at::Tensor& raw) {
    return 0.5 + withBase(raw, base.colors, 0, 3);
}

} // namespace ars
