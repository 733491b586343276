#pragma once

#include "engine/occlusion/ambient_occlusion_rows.h"

/// Which samples of a pixel need not be looked up (docs/math/occlusion.md, "What is skipped"). Included by the files
/// that are compiled for one instruction set each, so everything here has internal linkage. Loops have fixed lengths of
/// 16 or 32 so that compilers turn them into vector code.
namespace ars::cpu {
namespace {

struct SampleHeights {
    /// Step j of a ray can be hidden only if the cosine of its polar angle is at most cosines[j]; -1 beyond the last.
    alignas(64) float cosines[kMaxSteps];
    float largest;
    int count; ///< a multiple of 16
};

constexpr int kColumns = 2 * (kMaxTileRings + 1); ///< tiles side by side that are looked at; the pixel's is the 17th
static_assert(kColumns == 32 && kMaxTileRings == 15);

/// Largest of highest[16 - r .. 16 + r], for any compiler. Instruction sets that can do better bring their own.
struct PlainFold {
    static float largestWithin(const float* highest, int r) {
        float fold[16];
        for (int i = 0; i < 16; ++i) {
            const float a = highest[16 - i], b = highest[16 + i];
            const float larger = a > b ? a : b;
            fold[i] = i <= r ? larger : -__builtin_inff();
        }
        for (int i = 0; i < 8; ++i) fold[i] = fold[i] > fold[i + 8] ? fold[i] : fold[i + 8];
        for (int i = 0; i < 4; ++i) fold[i] = fold[i] > fold[i + 4] ? fold[i] : fold[i + 4];
        for (int i = 0; i < 2; ++i) fold[i] = fold[i] > fold[i + 2] ? fold[i] : fold[i + 2];
        return fold[0] > fold[1] ? fold[0] : fold[1];
    }
};

/// Largest excess of the tiles over the tangent plane, in inverse depth, within r = 0, 1, ... rings around the pixel.
template <typename Fold>
void tileExcess(const OcclusionRowInput& in, int rings, float* excess) {
    const OcclusionTiles& tiles = in.tiles;
    const float size = static_cast<float>(tiles.size);
    const float half = 0.5f * size - 0.5f; // pixel centres lie this far from the tile's
    int column = static_cast<int>(in.planeU - 1.0f) / tiles.size;
    column = column < 0               ? 0
             : column < tiles.columns ? column
                                      : tiles.columns - 1; // a filtered position may lie outside
    const int row = static_cast<int>(in.planeV - 1.0f) / tiles.size;
    const float slopeU = in.planeSlopeU, slopeV = in.planeSlopeV;
    const float firstU = 1.0f + (static_cast<float>(column - 16) + 0.5f) * size - in.planeU;
    alignas(64) float plane[kColumns];
    alignas(64) float highest[kColumns];
    for (int i = 0; i < kColumns; ++i) {
        plane[i] = in.planeW + slopeU * (firstU + size * static_cast<float>(i));
        highest[i] = -__builtin_inff();
    }
    for (int r = 0; r <= rings; ++r) {
        for (int side = 0; side < (r == 0 ? 1 : 2); ++side) {
            const int y = side == 0 ? row - r : row + r;
            if (y < 0 || y >= tiles.rows) continue;
            const long at = static_cast<long>(y) * tiles.stride + column; // its 16 empty tiles on the left included
            const float* top = tiles.top + at;
            const float* tileU = tiles.slopeU + at;
            const float* tileV = tiles.slopeV + at;
            const float base = slopeV * (1.0f + (static_cast<float>(y) + 0.5f) * size - in.planeV);
            for (int i = 0; i < kColumns; ++i) {
                const float bend = __builtin_fabsf(tileU[i] - slopeU) + __builtin_fabsf(tileV[i] - slopeV);
                const float above = (top[i] - (base + plane[i])) + half * bend;
                highest[i] = highest[i] > above ? highest[i] : above;
            }
        }
        // Only rows within r have been added; the square is cut out of them.
        excess[r] = Fold::largestWithin(highest, r);
    }
}

/// How far, in inverse depth, a hidden sample at distance s may be nearer than the surface that hides it; negative: it
/// must be farther. z is the largest depth of such a sample.
inline float hiddenBefore(const OcclusionRowInput& in, float s, float z) {
    const float nearest = in.originZ - s + in.bias - in.hidingDepth; // of the surface: thickness before the sample
    const float ahead = nearest > 2.0f * in.bias ? in.bias / (nearest * (nearest - in.bias)) : __builtin_inff();
    return in.bias > 0.0f ? ahead : in.bias / (z * z);
}

/// A sample that is hidden lies behind a pixel of the depth picture, whose surface is then higher above the tangent
/// plane than the sample is (bar the bias): samples higher than everything within their reach are open.
template <typename Fold = PlainFold>
void sampleHeights(const OcclusionRowInput& in, SampleHeights& heights) {
    heights.largest = 2.0f;
    heights.count = (in.distanceCount + 15) / 16 * 16;
    for (int j = 0; j < heights.count; ++j) heights.cosines[j] = j < in.distanceCount ? 2.0f : -1.0f;
    if (!(in.planeDistance > 0.0f) || in.distanceCount == 0) return;
    const float perTile = in.pixelsPerMetre / static_cast<float>(in.tiles.size);
    const float farthest = in.distances[in.distanceCount - 1];
    const float reach = farthest * perTile / (in.originZ - farthest);
    if (!(reach < static_cast<float>(kMaxTileRings - 1))) return;
    const int rings = static_cast<int>(reach) + 1;
    float excess[kMaxTileRings + 1];
    tileExcess<Fold>(in, rings, excess);
    // The sample may lie half a pixel from the centre whose depth it is compared with; the rest covers rounding.
    const float slack =
        0.501f * (__builtin_fabsf(in.planeSlopeU) + __builtin_fabsf(in.planeSlopeV)) + 2e-6f * in.planeW;
    float largest = -1.0f;
    for (int first = 0; first < heights.count; first += 16) {
        for (int k = 0; k < 16; ++k) {
            const int j = first + k;
            const float s = in.distances[j];
            const float z = in.originZ + s; // no sample of this step is deeper
            const int ring = static_cast<int>(s * perTile / (in.originZ - s)) + 1;
            const float above = excess[ring < rings ? ring : rings] + slack + hiddenBefore(in, s, z);
            const float cosine = in.planeDistance * z * above / s * 1.0001f + 1e-6f;
            heights.cosines[j] = above > 0.0f && j < in.distanceCount ? cosine : -1.0f;
        }
    }
    for (int j = 0; j < in.distanceCount; ++j) largest = largest > heights.cosines[j] ? largest : heights.cosines[j];
    heights.largest = largest;
}

} // namespace
} // namespace ars::cpu
