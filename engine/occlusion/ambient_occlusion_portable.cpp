#include "engine/occlusion/ambient_occlusion_math.h"
#include "engine/occlusion/ambient_occlusion_tiles.h"

namespace ars::cpu {
namespace {

/// The same samples as rayIsHidden, at the distances of a list; outside the picture lies the border.
bool rayIsHiddenAt(const OcclusionRowInput& in, const glm::vec3& direction, const OcclusionReach<float>& reach,
                   const float* distances, int count) {
    for (int j = 0; j < count; ++j) {
        const float s = distances[j];
        const float z = in.originZ + s * direction.z;
        const float inverse = 1.0f / z;
        const float u = std::fmax(std::fmin((in.originU + s * direction.x) * inverse, in.right), 0.0f);
        const float v = std::fmax(std::fmin((in.originV + s * direction.y) * inverse, in.bottom), 0.0f);
        const std::size_t at = static_cast<std::size_t>(static_cast<int>(v)) * static_cast<std::size_t>(in.stride) +
                               static_cast<std::size_t>(static_cast<int>(u));
        if (hides(in.depth[at], z, reach)) return true;
    }
    return false;
}

} // namespace

void marchRowsPortable(const OcclusionRowInput& input, int* hits) {
    SampleHeights heights;
    sampleHeights(input, heights);
    const glm::vec3 pole(input.poleU, input.poleV, input.poleZ);
    const OcclusionReach<float> reach{0.0f, input.bias, input.hidingDepth};
    float distances[kMaxSteps];
    for (int r = 0; r < input.rowCount; ++r) {
        const OcclusionRow& row = input.rows[r];
        hits[r] = 0;
        if (row.cosine > heights.largest) continue;
        int needed = 0;
        for (int j = 0; j < input.distanceCount; ++j) {
            if (row.cosine <= heights.cosines[j]) distances[needed++] = input.distances[j];
        }
        for (int i = row.start; i < row.start + row.count; ++i) {
            const glm::vec3 azimuth(input.azimuthU[i], input.azimuthV[i], input.azimuthZ[i]);
            const glm::vec3 direction = rayDirection(azimuth, pole, row.sine, row.cosine);
            hits[r] += rayIsHiddenAt(input, direction, reach, distances, needed) ? 1 : 0;
        }
    }
}

} // namespace ars::cpu
