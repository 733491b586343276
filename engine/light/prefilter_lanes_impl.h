#pragma once

#include "engine/light/ggx_weight.h"
#include "engine/light/prefilter_lanes.h"

// The body of prefilter_lanes_*.cpp, for Width floats at once. Everything is in an unnamed namespace on purpose: each
// of those files has its own copy.
namespace ars::lanes {
namespace {

template <int Width>
struct VectorOf {
    typedef float Type __attribute__((vector_size(Width * sizeof(float))));
};

template <typename V>
inline void load(V& vector, const float* from) {
    __builtin_memcpy(&vector, from, sizeof(V));
}

template <int Width>
inline float sumOf(const typename VectorOf<Width>::Type& vector) {
    if constexpr (Width == 4) {
        return (vector[0] + vector[1]) + (vector[2] + vector[3]);
    } else {
        typename VectorOf<Width / 2>::Type halves[2];
        __builtin_memcpy(halves, &vector, sizeof(vector));
        return sumOf<Width / 2>(halves[0] + halves[1]);
    }
}

/// Below this alpha^2 1 - n.w is taken from the difference of the directions, because rounding of n.w itself (6e-8)
/// would show in the lobe; above, the cheaper dot product serves.
constexpr float kNarrowLobe = 5e-4f;

template <int Width, bool Narrow>
void specularSumOf(const Planes& planes, const Span* spans, int count, float alphaSquared, float cosine,
                   float* result) {
    using V = typename VectorOf<Width>::Type;
    const V none = {};
    const float limit = 1.0f - cosine;
    V red = none, green = none, blue = none, weights = none;
    for (int s = 0; s < count; ++s) {
        const Span span = spans[s];
        for (std::size_t y = span.y0; y < span.y1; ++y) {
            const float v = planes.coordinate[y];
            const float base = span.major + span.down * v;
            const std::size_t row = y * planes.stride;
            const std::size_t texels = span.face * planes.size * planes.stride + row;
            for (std::size_t x = span.x0; x < span.x1; x += Width) {
                V u, inverse, solidAngle, r, g, b, e;
                load(u, planes.coordinate + x);
                load(inverse, planes.inverseLength + row + x);
                load(solidAngle, planes.solidAngle + row + x);
                load(r, planes.red + texels + x);
                load(g, planes.green + texels + x);
                load(b, planes.blue + texels + x);
                if constexpr (Narrow) {
                    const V dx = u * inverse - span.right, dy = v * inverse - span.down, dz = inverse - span.major;
                    e = 0.5f * (dx * dx + dy * dy + dz * dz);
                } else {
                    e = 1.0f - (base + span.right * u) * inverse;
                }
                const V weight = (e <= limit) ? ggxWeight(e, solidAngle, alphaSquared) : none;
                red += weight * r;
                green += weight * g;
                blue += weight * b;
                weights += weight;
            }
        }
    }
    result[0] = sumOf<Width>(red);
    result[1] = sumOf<Width>(green);
    result[2] = sumOf<Width>(blue);
    result[3] = sumOf<Width>(weights);
}

template <int Width>
void specularSum(const Planes& planes, const Span* spans, int count, float alphaSquared, float cosine, float* result) {
    if (alphaSquared < kNarrowLobe) {
        specularSumOf<Width, true>(planes, spans, count, alphaSquared, cosine, result);
    } else {
        specularSumOf<Width, false>(planes, spans, count, alphaSquared, cosine, result);
    }
}

template <int Width>
void diffuseSum(const Planes& planes, const Span* spans, int count, float limit, float* result) {
    using V = typename VectorOf<Width>::Type;
    const V none = {};
    V red = none, green = none, blue = none;
    for (int s = 0; s < count; ++s) {
        const Span span = spans[s];
        for (std::size_t y = span.y0; y < span.y1; ++y) {
            const float base = span.major + span.down * planes.coordinate[y];
            const std::size_t row = y * planes.stride;
            const std::size_t texels = span.face * planes.size * planes.stride + row;
            for (std::size_t x = span.x0; x < span.x1; x += Width) {
                V u, inverse, solidAngle, r, g, b;
                load(u, planes.coordinate + x);
                load(inverse, planes.inverseLength + row + x);
                load(solidAngle, planes.solidAngle + row + x);
                load(r, planes.red + texels + x);
                load(g, planes.green + texels + x);
                load(b, planes.blue + texels + x);
                V cosine = (base + span.right * u) * inverse;
                cosine = (cosine > 0.0f) ? cosine : none;
                cosine = (cosine < limit) ? cosine : none + limit;
                const V weight = cosine * solidAngle * 0.31830988618379067154f;
                red += weight * r;
                green += weight * g;
                blue += weight * b;
            }
        }
    }
    result[0] = sumOf<Width>(red);
    result[1] = sumOf<Width>(green);
    result[2] = sumOf<Width>(blue);
}

} // namespace
} // namespace ars::lanes
