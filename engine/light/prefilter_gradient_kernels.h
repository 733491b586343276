#pragma once

#include "engine/light/prefilter_kernels.h"
#include "engine/light/prefilter_math.h"

namespace ars {

// What one thread of the CUDA adjoints does, host and device: tests run it in loops on the host.

/// A level whose backward is taken; cubes of one side and one device.
struct AdjointArguments {
    const float* source = nullptr; ///< (6, N, N, 3): dL/d of the filtered level
    float* target = nullptr;       ///< (6, N, N, 3): receives dL/d of what was filtered
    const float* scales = nullptr; ///< (6, N, N): 1 / sum of each filtered texel's weights; specular only
    const float* areas = nullptr;  ///< (N, N) solid angles
    int size = 0;                  ///< N
    float alphaSquared = 0.0f;     ///< roughness^4; specular only
    float cutoffCosine = 0.0f;     ///< specular only
    bool add = false;              ///< to what target holds

    ARS_HD std::size_t faceTexels() const { return static_cast<std::size_t>(size) * static_cast<std::size_t>(size); }
    ARS_HD std::size_t texels() const { return 6 * faceTexels(); }
};

/// Unit direction of texel `i`, and the face that it lies on.
ARS_HD inline glm::vec3 cubeTexelDirection(std::size_t i, int size, int& face) {
    const std::size_t n = static_cast<std::size_t>(size);
    face = static_cast<int>(i / (n * n));
    const float u = texelCoordinate<float>(static_cast<int>(i % n), size);
    const float v = texelCoordinate<float>(static_cast<int>(i / n % n), size);
    const glm::vec3 d = cubeDirection<float>(face, u, v);
    return d * (1.0f / std::sqrt(glm::dot(d, d)));
}

/// body(texel of the level, texel of its face, weight without solid angle) over the texels in the lobe about texel `i`:
/// those of one of `lanes` lanes that share them.
template <typename Body>
ARS_HD inline void forLobeTexels(const AdjointArguments& a, std::size_t i, int lane, int lanes, const Body& body) {
    int ownFace = 0;
    const glm::vec3 axis = cubeTexelDirection(i, a.size, ownFace);
    const float cosine = a.cutoffCosine, sine = std::sqrt(1.0f - cosine * cosine);
    for (int k = 0; k < 6; ++k) {
        // The texel's own face first: a cone that ends inside it touches no other.
        const int face = (ownFace + k) % 6;
        ConeSpan span;
        if (!coneSpan(axis, cosine, sine, face, a.size, span)) continue;
        for (int y = span.y0; y < span.y1; ++y) {
            const float v = texelCoordinate<float>(y, a.size);
            const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(a.size);
            for (int x = span.x0 + lane; x < span.x1; x += lanes) {
                const float weight =
                    specularTexelWeight(span.right, span.down, span.major, texelCoordinate<float>(x, a.size), v, 1.0f,
                                        a.alphaSquared, cosine);
                const std::size_t inFace = row + static_cast<std::size_t>(x);
                body(static_cast<std::size_t>(face) * a.faceTexels() + inFace, inFace, weight);
            }
        }
        if (k == 0 && span.x0 > 0 && span.y0 > 0 && span.x1 < a.size && span.y1 < a.size) return;
    }
}

/// One lane's part of the sum of the weights with which the filter made texel `i`.
ARS_HD inline float specularWeightsPart(const AdjointArguments& a, std::size_t i, int lane, int lanes) {
    float sum = 0.0f;
    forLobeTexels(a, i, lane, lanes,
                  [&](std::size_t, std::size_t inFace, float weight) { sum += weight * a.areas[inFace]; });
    return sum;
}

/// One lane's part of what texel `i` of the base gets: the weight depends on the angle between two texels, so the
/// texels that it gave to are those of its own lobe. The sum is still to be multiplied by its solid angle.
ARS_HD inline glm::vec3 specularAdjointPart(const AdjointArguments& a, std::size_t i, int lane, int lanes) {
    glm::vec3 sum(0.0f);
    forLobeTexels(a, i, lane, lanes, [&](std::size_t texel, std::size_t, float weight) {
        const float* g = a.source + 3 * texel;
        sum += weight * a.scales[texel] * glm::vec3(g[0], g[1], g[2]);
    });
    return sum;
}

ARS_HD inline glm::vec3 diffuseAdjointPart(const AdjointArguments& a, std::size_t i, int lane, int lanes) {
    int face = 0;
    const glm::vec3 axis = cubeTexelDirection(i, a.size, face);
    glm::vec3 sum(0.0f);
    for (std::size_t s = static_cast<std::size_t>(lane); s < a.texels(); s += static_cast<std::size_t>(lanes)) {
        const float weight = diffuseTexelWeight(glm::dot(axis, cubeTexelDirection(s, a.size, face)), 1.0f);
        sum += weight * glm::vec3(a.source[3 * s], a.source[3 * s + 1], a.source[3 * s + 2]);
    }
    return sum;
}

/// The end of both: `sum` over all lanes.
ARS_HD inline void writeAdjoint(const AdjointArguments& a, std::size_t i, const glm::vec3& sum) {
    const float area = a.areas[i % a.faceTexels()];
    for (int c = 0; c < 3; ++c) {
        float& to = a.target[3 * i + static_cast<std::size_t>(c)];
        to = (a.add ? to : 0.0f) + sum[c] * area;
    }
}

/// A texel of the larger cube (side `width`) gets a quarter of the smaller one's: backward of an average. Rows count
/// through all faces.
ARS_HD inline void addAverageBackward(const float* smaller, float* larger, std::size_t width, std::size_t row,
                                      std::size_t column) {
    const float* from = smaller + 3 * (row / 2 * (width / 2) + column / 2);
    float* to = larger + 3 * (row * width + column);
    for (int c = 0; c < 3; ++c) to[c] += 0.25f * from[c];
}

namespace cuda {
/// Queued on the default stream of device `index`; none of them waits.
Status averagePoolBackward(ImageView<const float> smaller, ImageView<float> larger, int index);
/// `scales` receives 1 / sum of weights, 0 where that is 0.
Status specularScales(const AdjointArguments& arguments, float* scales, int index);
Status filterSpecularAdjoint(const AdjointArguments& arguments, int index);
Status filterDiffuseAdjoint(const AdjointArguments& arguments, int index);
} // namespace cuda

} // namespace ars
