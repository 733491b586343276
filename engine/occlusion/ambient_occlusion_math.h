#pragma once

#include "engine/core/host_device.h"

#include <glm/glm.hpp>

#include <cmath>
#include <limits>

namespace ars {

/// Lanes of the widest vector unit that marches rays; azimuth tables are cut into pieces of this many.
inline constexpr int kOcclusionLanes = 16;
/// The depth picture that rays are marched through has this many empty pixels on every side: what leaves the picture
/// lands there and is not hidden. All pixel coordinates below are those of the padded picture.
inline constexpr int kOcclusionBorder = 1;
/// Samples nearer to the camera plane than this are outside the picture, metres.
inline constexpr float kOcclusionNearest = 1e-3f;

/// Depth of an empty pixel: it never hides, because nothing lies behind it.
template <typename T>
ARS_HD T emptyDepth() {
    return std::numeric_limits<T>::infinity();
}

template <typename T>
ARS_HD bool finite(T x) {
    return x - x == T(0);
}

// ---------------------------------------------------------------------------------------------------- directions

/// Azimuths and polar angles of one pixel.
struct OcclusionGrid {
    int azimuths = 0;
    int polarAngles = 0;
};

/// Paper Eq. (adp): delta_adp = delta / (1 + alpha I), I clamped to [0, 1]; round(2 / delta_adp) azimuths, round(1 /
/// delta_adp) polar angles. Integer counts: a step that is added up in float gains or loses a direction.
/// @param azimuthOnly  the importance makes the azimuth finer and leaves the polar angle
template <typename T>
ARS_HD OcclusionGrid occlusionGrid(T delta, T alpha, T importance, bool azimuthOnly) {
    const T clamped = importance > T(0) ? (importance < T(1) ? importance : T(1)) : T(0); // NaN gives 0
    const T finer = T(1) + alpha * clamped;
    OcclusionGrid grid;
    grid.azimuths = static_cast<int>(T(2) * finer / delta + T(0.5));
    grid.polarAngles = static_cast<int>((azimuthOnly ? T(1) : finer) / delta + T(0.5));
    return grid;
}

inline constexpr double kOcclusionPi = 3.14159265358979323846;

/// Mid-points in both angles: theta_t = (t + 1/2) pi / 2n, phi_i = (i + 1/2) 2 pi / n. An edge-inclusive polar grid
/// puts weightless directions on the horizon and the pole and is 2 % off for a flat plane.
template <typename T>
ARS_HD T polarAngle(int index, int count) {
    return (static_cast<T>(index) + T(0.5)) * T(0.5 * kOcclusionPi) / static_cast<T>(count);
}
template <typename T>
ARS_HD T azimuthAngle(int index, int count) {
    return (static_cast<T>(index) + T(0.5)) * T(2.0 * kOcclusionPi) / static_cast<T>(count);
}

/// A full grid cut into subsets of at most `most` directions, each spread evenly over the hemisphere: polar angles t
/// with t mod rowStride = row, of each the azimuths i with i mod azimuthStride = residue; the residue moves on from row
/// to row, so that azimuths of neighbouring rows interleave. Every direction is in exactly one subset.
struct OcclusionSubsets {
    int rowStride = 1;
    int azimuthStride = 1;

    ARS_HD int count() const { return rowStride * azimuthStride; }
};

ARS_HD inline OcclusionSubsets occlusionSubsets(const OcclusionGrid& grid, int most) {
    OcclusionSubsets subsets;
    subsets.azimuthStride = (grid.azimuths + kOcclusionLanes - 1) / kOcclusionLanes;
    const int rows = most / kOcclusionLanes > 1 ? most / kOcclusionLanes : 1;
    subsets.rowStride = (grid.polarAngles + rows - 1) / rows;
    return subsets;
}

/// Where the subset of a pass starts.
struct OcclusionSubset {
    int row = 0;
    int residue = 0;
};

/// A step of about the golden section of n that has no divisor in common with n: k step mod n for k = 0, 1, ... visits
/// all of [0, n), far apart ones after one another.
ARS_HD inline int goldenStep(int n) {
    int step = static_cast<int>(0.618f * static_cast<float>(n) + 0.5f);
    for (step = step > 1 ? step : 1;; ++step) {
        int a = n, b = step;
        while (b != 0) {
            const int rest = a % b;
            a = b;
            b = rest;
        }
        if (a == 1) return step;
    }
}

/// Passes 0, 1, ... count()-1 visit every subset once. The first takes the middle row of each group: alone it is the
/// least biased.
ARS_HD inline OcclusionSubset occlusionSubset(const OcclusionSubsets& subsets, int pass) {
    const int k = pass % subsets.count();
    const int turn = k / subsets.rowStride;
    const int within = k % subsets.rowStride;
    OcclusionSubset subset;
    subset.row = ((subsets.rowStride - 1) / 2 + within * goldenStep(subsets.rowStride)) % subsets.rowStride;
    subset.residue = (turn * goldenStep(subsets.azimuthStride) + within) % subsets.azimuthStride;
    return subset;
}

/// Residue of the azimuths of polar angle t in a subset.
ARS_HD inline int occlusionResidue(const OcclusionSubsets& subsets, const OcclusionSubset& subset, int t) {
    return (subset.residue + t / subsets.rowStride * (subsets.azimuthStride / 2 + 1)) % subsets.azimuthStride;
}

// ---------------------------------------------------------------------------------------------------- one pixel

/// Orthonormal frame of a surface point: paper supplement Eqs. (proj), (basis), at the pixel.
template <typename T>
struct OcclusionFrame {
    glm::vec<3, T> tangent{T(0)}, bitangent{T(0)}, normal{T(0)};
};

/// t = normalise(q - (q.n) n), b = n x t. Where q is missing or stands on the surface (|t'| < 1e-3) the camera's up
/// takes its place, and where that does too its x axis: the azimuth grid only starts elsewhere. False for a normal that
/// is zero or not finite.
template <typename T>
ARS_HD bool occlusionFrame(const glm::vec<3, T>& normal, const glm::vec<3, T>& bone, OcclusionFrame<T>& frame) {
    const T length2 = glm::dot(normal, normal);
    if (!(length2 > T(1e-12)) || !finite(length2)) return false;
    const glm::vec<3, T> n = normal * (T(1) / std::sqrt(length2));
    glm::vec<3, T> t = bone - glm::dot(bone, n) * n;
    T t2 = glm::dot(t, t);
    if (!(t2 >= T(1e-6)) || !finite(t2)) {
        t = glm::vec<3, T>(T(0), T(-1), T(0)) + n.y * n;
        t2 = glm::dot(t, t);
    }
    if (!(t2 >= T(1e-6))) {
        t = glm::vec<3, T>(T(1), T(0), T(0)) - n.x * n;
        t2 = glm::dot(t, t);
    }
    frame.normal = n;
    frame.tangent = t * (T(1) / std::sqrt(t2));
    frame.bitangent = glm::cross(n, frame.tangent);
    return true;
}

/// How rays are marched; everything that a picture's pixels share.
template <typename T>
struct OcclusionMarch {
    int width = 0, height = 0;        ///< of the picture, without its border
    int stride = 0;                   ///< of the padded depth, pixels
    T fx = 0, fy = 0, cx = 0, cy = 0; ///< pixels; cx and cy from the padded edge
    int steps = 16, firstStep = 1, lastStep = 16;
    T biasM = 0, biasPerRadius = 0, thicknessM = 0;
    bool depthFactor = false;
};

/// A point or direction of camera space before the division by z: (u, v) = (x, y) / z in pixels. Linear, so that a ray
/// in space stays a ray here and a sample costs three multiply-adds and one division.
template <typename T>
ARS_HD glm::vec<3, T> toHomogeneous(const OcclusionMarch<T>& march, const glm::vec<3, T>& camera) {
    return {march.fx * camera.x + march.cx * camera.z, march.fy * camera.y + march.cy * camera.z, camera.z};
}

/// Camera-space position of a pixel centre at depth z; `column` and `row` count from the padded edge.
template <typename T>
ARS_HD glm::vec<3, T> pixelPosition(const OcclusionMarch<T>& march, int column, int row, T z) {
    return {(static_cast<T>(column) + T(0.5) - march.cx) / march.fx * z,
            (static_cast<T>(row) + T(0.5) - march.cy) / march.fy * z, z};
}

/// What a radius means at a pixel.
template <typename T>
struct OcclusionReach {
    T length = 0; ///< of the rays, metres
    T bias = 0;   ///< a sample this far in front of the depth map is still hidden, metres
    T depth = 0;  ///< thickness + bias: width of the hiding interval, metres
};

template <typename T>
ARS_HD OcclusionReach<T> occlusionReach(const OcclusionMarch<T>& march, T radius, T z) {
    OcclusionReach<T> reach;
    const T grow = T(1) + z * T(0.01);
    reach.length = march.depthFactor ? radius * (grow * grow) : radius;
    reach.bias = march.biasM + march.biasPerRadius * radius;
    reach.depth = march.thicknessM + reach.bias;
    return reach;
}

/// True where a sample of depth `sample` is hidden by the surface at `depth`: it lies at most `thickness` behind it
/// and, by -bias or more, not in front of it. An empty pixel (infinite depth) never hides.
template <typename T>
ARS_HD bool hides(T depth, T sample, const OcclusionReach<T>& reach) {
    const T behind = (sample + reach.bias) - depth;
    return behind >= T(0) && behind <= reach.depth;
}

/// Marches one ray; true when a sample of it is hidden.
/// @param depth      (height + 2, stride) padded depth, emptyDepth() where nothing is
/// @param origin, direction  homogeneous (toHomogeneous)
/// @param taps       counts the samples that were looked up
template <typename T>
ARS_HD bool rayIsHidden(const OcclusionMarch<T>& march, const T* depth, const glm::vec<3, T>& origin,
                        const glm::vec<3, T>& direction, const OcclusionReach<T>& reach, int* taps = nullptr) {
    const T step = reach.length / static_cast<T>(march.steps);
    const T right = static_cast<T>(march.width + kOcclusionBorder);
    const T bottom = static_cast<T>(march.height + kOcclusionBorder);
    for (int j = march.firstStep; j <= march.lastStep; ++j) {
        const T s = static_cast<T>(j) * step;
        const T z = origin.z + s * direction.z;
        if (!(z > T(kOcclusionNearest))) return false;
        const T inverse = T(1) / z;
        const T u = (origin.x + s * direction.x) * inverse;
        const T v = (origin.y + s * direction.y) * inverse;
        // A straight ray that has left the picture does not come back. NaN counts as outside.
        if (!(u >= T(kOcclusionBorder) && u < right && v >= T(kOcclusionBorder) && v < bottom)) return false;
        if (taps) ++*taps;
        const std::size_t at = static_cast<std::size_t>(static_cast<int>(v)) * static_cast<std::size_t>(march.stride) +
                               static_cast<std::size_t>(static_cast<int>(u));
        if (hides(depth[at], z, reach)) return true;
    }
    return false;
}

/// Homogeneous direction sin(theta) (cos(phi) t + sin(phi) b) + cos(theta) n from the azimuth's part and the normal's.
template <typename T>
ARS_HD glm::vec<3, T> rayDirection(const glm::vec<3, T>& azimuth, const glm::vec<3, T>& pole, T sine, T cosine) {
    return sine * azimuth + cosine * pole;
}

/// O = 1 - strength occluded / total, clamped.
template <typename T>
ARS_HD T occlusionFromWeights(T occluded, T total, T strength) {
    if (!(total > T(0))) return T(1);
    const T open = T(1) - strength * (occluded / total);
    return open > T(0) ? (open < T(1) ? open : T(1)) : T(0);
}

/// What a picture says about a pixel's depth: metres, 0 where it is empty or makes no sense.
template <typename T>
ARS_HD T usableDepth(T depth, bool covered) {
    return covered && depth > T(0) && finite(depth) ? depth : T(0);
}

/// Median of nine by exchanges (Paeth's network: 20 of them).
template <typename T>
ARS_HD T medianOfNine(T (&p)[9]) {
    const auto order = [](T& a, T& b) {
        if (b < a) {
            const T c = a;
            a = b;
            b = c;
        }
    };
    order(p[0], p[3]), order(p[1], p[4]), order(p[2], p[5]), order(p[0], p[1]), order(p[0], p[2]);
    order(p[4], p[5]), order(p[3], p[5]), order(p[1], p[2]), order(p[3], p[4]), order(p[1], p[3]);
    order(p[1], p[6]), order(p[4], p[6]), order(p[2], p[6]), order(p[2], p[3]), order(p[4], p[7]);
    order(p[2], p[4]), order(p[3], p[7]), order(p[4], p[8]), order(p[3], p[8]), order(p[3], p[4]);
    return p[4];
}

/// Camera-space position of a pixel, z = 0 where it is empty. `depthAt(column, row)` gives the usable depth in padded
/// coordinates, 0 outside the picture. With `median`: of each coordinate over 3x3 pixels, empty ones and the outside
/// counting as (0, 0, 0), as GI-GS does.
template <typename T, typename DepthAt>
ARS_HD glm::vec<3, T> filteredPosition(const OcclusionMarch<T>& march, int column, int row, bool median,
                                       const DepthAt& depthAt) {
    if (!median) return pixelPosition(march, column, row, depthAt(column, row));
    T x[9], y[9], z[9];
    for (int k = 0; k < 9; ++k) {
        const int c = column + k % 3 - 1;
        const int r = row + k / 3 - 1;
        const glm::vec<3, T> p = pixelPosition(march, c, r, depthAt(c, r));
        x[k] = p.x;
        y[k] = p.y;
        z[k] = p.z;
    }
    return {medianOfNine(x), medianOfNine(y), medianOfNine(z)};
}

} // namespace ars
