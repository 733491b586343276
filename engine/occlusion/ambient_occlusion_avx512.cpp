#include "engine/occlusion/ambient_occlusion_tiles.h"

#if defined(__x86_64__)
#include <immintrin.h>

#if defined(__GNUC__) && !defined(__clang__)
// GCC 12 takes the "undefined" operand inside its own _mm512_min_ps for ours (GCC bug 105593).
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

namespace ars::cpu {
namespace {

struct Fold512 {
    static float largestWithin(const float* highest, int r) {
        const auto left = static_cast<__mmask16>(0xffffu << (16 - r));
        const auto right = static_cast<__mmask16>((2u << r) - 1u);
        const __m512 none = _mm512_set1_ps(-__builtin_inff());
        return _mm512_reduce_max_ps(
            _mm512_max_ps(_mm512_mask_load_ps(none, left, highest), _mm512_mask_load_ps(none, right, highest + 16)));
    }
};

struct Pixel512 {
    __m512 originU, originV, originZ, right, bottom, bias, hidingDepth;
    __m512i stride;
    const float* depth;
};

/// The steps that a row must look up, one bit each.
unsigned long long neededSteps(const SampleHeights& heights, float cosine) {
    unsigned long long steps = 0;
    const __m512 row = _mm512_set1_ps(cosine);
    for (int j = 0; j < heights.count; j += 16) {
        const __mmask16 needed = _mm512_cmp_ps_mask(row, _mm512_load_ps(heights.cosines + j), _CMP_LE_OQ);
        steps |= static_cast<unsigned long long>(needed) << j;
    }
    return steps;
}

/// Lanes of `lanes` whose rays are not hidden at any of the steps.
__mmask16 openRays(const Pixel512& p, __m512 du, __m512 dv, __m512 dz, const float* distances, unsigned long long steps,
                   __mmask16 lanes) {
    const __m512 zero = _mm512_setzero_ps();
    const __m512 one = _mm512_set1_ps(1.0f);
    __mmask16 open = lanes;
    for (; steps != 0; steps &= steps - 1) {
        const __m512 s = _mm512_set1_ps(distances[__builtin_ctzll(steps)]);
        const __m512 z = _mm512_add_ps(p.originZ, _mm512_mul_ps(s, dz));
        const __m512 inverse = _mm512_div_ps(one, z);
        __m512 u = _mm512_mul_ps(_mm512_add_ps(p.originU, _mm512_mul_ps(s, du)), inverse);
        __m512 v = _mm512_mul_ps(_mm512_add_ps(p.originV, _mm512_mul_ps(s, dv)), inverse);
        u = _mm512_max_ps(_mm512_min_ps(u, p.right), zero);
        v = _mm512_max_ps(_mm512_min_ps(v, p.bottom), zero);
        const __m512i at =
            _mm512_add_epi32(_mm512_mullo_epi32(_mm512_cvttps_epi32(v), p.stride), _mm512_cvttps_epi32(u));
        const __m512 depth = _mm512_i32gather_ps(at, p.depth, 4);
        const __m512 behind = _mm512_sub_ps(_mm512_add_ps(z, p.bias), depth);
        const __mmask16 hidden = _mm512_mask_cmp_ps_mask(_mm512_mask_cmp_ps_mask(open, behind, zero, _CMP_GE_OQ),
                                                         behind, p.hidingDepth, _CMP_LE_OQ);
        open = static_cast<__mmask16>(open & ~hidden);
        if (open == 0) break;
    }
    return open;
}

} // namespace

void marchRowsAvx512(const OcclusionRowInput& input, int* hits) {
    SampleHeights heights;
    sampleHeights<Fold512>(input, heights);
    const Pixel512 pixel{
        _mm512_set1_ps(input.originU),     _mm512_set1_ps(input.originV),   _mm512_set1_ps(input.originZ),
        _mm512_set1_ps(input.right),       _mm512_set1_ps(input.bottom),    _mm512_set1_ps(input.bias),
        _mm512_set1_ps(input.hidingDepth), _mm512_set1_epi32(input.stride), input.depth};
    for (int r = 0; r < input.rowCount; ++r) {
        const OcclusionRow& row = input.rows[r];
        hits[r] = 0;
        if (row.cosine > heights.largest) continue;
        const unsigned long long steps = neededSteps(heights, row.cosine);
        const __m512 sine = _mm512_set1_ps(row.sine);
        const __m512 poleU = _mm512_set1_ps(row.cosine * input.poleU);
        const __m512 poleV = _mm512_set1_ps(row.cosine * input.poleV);
        const __m512 poleZ = _mm512_set1_ps(row.cosine * input.poleZ);
        for (int i = 0; i < row.count; i += 16) {
            const int left = row.count - i;
            const auto lanes = static_cast<__mmask16>(left >= 16 ? 0xffffu : (1u << left) - 1u);
            const int at = row.start + i;
            const __m512 du = _mm512_add_ps(_mm512_mul_ps(sine, _mm512_load_ps(input.azimuthU + at)), poleU);
            const __m512 dv = _mm512_add_ps(_mm512_mul_ps(sine, _mm512_load_ps(input.azimuthV + at)), poleV);
            const __m512 dz = _mm512_add_ps(_mm512_mul_ps(sine, _mm512_load_ps(input.azimuthZ + at)), poleZ);
            const __mmask16 open = openRays(pixel, du, dv, dz, input.distances, steps, lanes);
            hits[r] += __builtin_popcount(static_cast<unsigned>(lanes & ~open));
        }
    }
}

} // namespace ars::cpu
#endif
