#include "engine/occlusion/ambient_occlusion_tiles.h"

#if defined(__x86_64__)
#include <immintrin.h>

namespace ars::cpu {
namespace {

struct Pixel256 {
    __m256 originU, originV, originZ, right, bottom, bias, hidingDepth;
    __m256i stride;
    const float* depth;
};

/// Sign bits of the first `count` of eight lanes.
__m256 firstLanes(int count) {
    const __m256i index = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    return _mm256_castsi256_ps(_mm256_cmpgt_epi32(_mm256_set1_epi32(count), index));
}

/// The steps that a row must look up, one bit each.
unsigned long long neededSteps(const SampleHeights& heights, float cosine) {
    unsigned long long steps = 0;
    const __m256 row = _mm256_set1_ps(cosine);
    for (int j = 0; j < heights.count; j += 8) {
        const __m256 needed = _mm256_cmp_ps(row, _mm256_load_ps(heights.cosines + j), _CMP_LE_OQ);
        steps |= static_cast<unsigned long long>(_mm256_movemask_ps(needed)) << j;
    }
    return steps;
}

/// Lanes of `lanes` whose rays are not hidden at any of the steps.
__m256 openRays(const Pixel256& p, __m256 du, __m256 dv, __m256 dz, const float* distances, unsigned long long steps,
                __m256 lanes) {
    const __m256 zero = _mm256_setzero_ps();
    const __m256 one = _mm256_set1_ps(1.0f);
    __m256 open = lanes;
    for (; steps != 0; steps &= steps - 1) {
        const __m256 s = _mm256_set1_ps(distances[__builtin_ctzll(steps)]);
        const __m256 z = _mm256_add_ps(p.originZ, _mm256_mul_ps(s, dz));
        const __m256 inverse = _mm256_div_ps(one, z);
        __m256 u = _mm256_mul_ps(_mm256_add_ps(p.originU, _mm256_mul_ps(s, du)), inverse);
        __m256 v = _mm256_mul_ps(_mm256_add_ps(p.originV, _mm256_mul_ps(s, dv)), inverse);
        u = _mm256_max_ps(_mm256_min_ps(u, p.right), zero);
        v = _mm256_max_ps(_mm256_min_ps(v, p.bottom), zero);
        const __m256i at =
            _mm256_add_epi32(_mm256_mullo_epi32(_mm256_cvttps_epi32(v), p.stride), _mm256_cvttps_epi32(u));
        const __m256 depth = _mm256_i32gather_ps(p.depth, at, 4);
        const __m256 behind = _mm256_sub_ps(_mm256_add_ps(z, p.bias), depth);
        const __m256 hidden =
            _mm256_and_ps(_mm256_cmp_ps(behind, zero, _CMP_GE_OQ), _mm256_cmp_ps(behind, p.hidingDepth, _CMP_LE_OQ));
        open = _mm256_andnot_ps(hidden, open);
        if (_mm256_movemask_ps(open) == 0) break;
    }
    return open;
}

} // namespace

void marchRowsAvx2(const OcclusionRowInput& input, int* hits) {
    SampleHeights heights;
    sampleHeights(input, heights);
    const Pixel256 pixel{
        _mm256_set1_ps(input.originU),     _mm256_set1_ps(input.originV),   _mm256_set1_ps(input.originZ),
        _mm256_set1_ps(input.right),       _mm256_set1_ps(input.bottom),    _mm256_set1_ps(input.bias),
        _mm256_set1_ps(input.hidingDepth), _mm256_set1_epi32(input.stride), input.depth};
    for (int r = 0; r < input.rowCount; ++r) {
        const OcclusionRow& row = input.rows[r];
        hits[r] = 0;
        if (row.cosine > heights.largest) continue;
        const unsigned long long steps = neededSteps(heights, row.cosine);
        const __m256 sine = _mm256_set1_ps(row.sine);
        const __m256 poleU = _mm256_set1_ps(row.cosine * input.poleU);
        const __m256 poleV = _mm256_set1_ps(row.cosine * input.poleV);
        const __m256 poleZ = _mm256_set1_ps(row.cosine * input.poleZ);
        for (int i = 0; i < row.count; i += 8) {
            const __m256 lanes = firstLanes(row.count - i);
            const int at = row.start + i;
            const __m256 du = _mm256_add_ps(_mm256_mul_ps(sine, _mm256_load_ps(input.azimuthU + at)), poleU);
            const __m256 dv = _mm256_add_ps(_mm256_mul_ps(sine, _mm256_load_ps(input.azimuthV + at)), poleV);
            const __m256 dz = _mm256_add_ps(_mm256_mul_ps(sine, _mm256_load_ps(input.azimuthZ + at)), poleZ);
            const __m256 open = openRays(pixel, du, dv, dz, input.distances, steps, lanes);
            hits[r] += __builtin_popcount(static_cast<unsigned>(_mm256_movemask_ps(_mm256_andnot_ps(open, lanes))));
        }
    }
}

} // namespace ars::cpu
#endif
