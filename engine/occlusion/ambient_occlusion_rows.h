#pragma once

/// The inner loop of ambient occlusion on the CPU, compiled once for each instruction set. This header and the files
/// that implement it use nothing but plain types: an inline function of a library, compiled here for AVX-512, could be
/// the copy that the linker keeps for the whole program.
namespace ars::cpu {

/// Tiles that are looked at around a pixel in each direction, at most.
inline constexpr int kMaxTileRings = 15;
inline constexpr int kMaxSteps = 64;

/// An upper bound of the depth picture for each square tile of it, in inverse depth w = 1/z, in which planes are
/// linear: every covered pixel of the tile has w <= top + slopeU (u - centre) + slopeV (v - centre). Empty tiles have
/// top -inf; 16 of them stand before and 16 after each row.
struct OcclusionTiles {
    const float* top = nullptr;    ///< (rows, stride)
    const float* slopeU = nullptr; ///< per pixel
    const float* slopeV = nullptr;
    int columns = 0, rows = 0;
    int stride = 0; ///< columns + 32
    int size = 8;   ///< pixels
};

/// One polar angle of one pixel with the azimuths that are marched, a piece of the pixel's arrays that starts at a
/// multiple of 16.
struct OcclusionRow {
    float sine = 0.0f, cosine = 0.0f;
    int start = 0, count = 0;
};

/// One pixel in homogeneous coordinates of the padded picture (ambient_occlusion_math.h). Every sample of it has
/// z > kOcclusionNearest; who calls makes sure.
struct OcclusionRowInput {
    const float* depth = nullptr; ///< padded
    int stride = 0;
    float right = 0.0f, bottom = 0.0f; ///< coordinates of the border's far pixels
    float originU = 0.0f, originV = 0.0f, originZ = 0.0f;
    float poleU = 0.0f, poleV = 0.0f, poleZ = 0.0f; ///< the normal
    const float* azimuthU = nullptr;                ///< cos(phi) t + sin(phi) b; aligned to 64 bytes, padded to 16
    const float* azimuthV = nullptr;
    const float* azimuthZ = nullptr;
    const float* distances = nullptr; ///< (kMaxSteps) of the samples, metres; the last one again beyond distanceCount
    int distanceCount = 0;
    float bias = 0.0f, hidingDepth = 0.0f;
    const OcclusionRow* rows = nullptr;
    int rowCount = 0;

    /// The tangent plane in inverse depth: planeW at (planeU, planeV), padded pixels, and its slopes. planeDistance is
    /// the plane's distance from the camera; 0: nothing is culled.
    OcclusionTiles tiles;
    float planeU = 0.0f, planeV = 0.0f, planeW = 0.0f, planeSlopeU = 0.0f, planeSlopeV = 0.0f, planeDistance = 0.0f;
    float pixelsPerMetre =
        0.0f; ///< a sample at distance s is at most s pixelsPerMetre / (z - s) pixels from the origin
};

/// hits[r] = rays of row r with a hidden sample.
using MarchRows = void (*)(const OcclusionRowInput& input, int* hits);

void marchRowsPortable(const OcclusionRowInput& input, int* hits);
#if defined(__x86_64__)
void marchRowsAvx2(const OcclusionRowInput& input, int* hits);
void marchRowsAvx512(const OcclusionRowInput& input, int* hits);
#endif

} // namespace ars::cpu
