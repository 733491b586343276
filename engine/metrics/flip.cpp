#include "engine/metrics/flip.h"

#include "engine/metrics/picture_sums.h"
#include "engine/metrics/separable_filter.h"

#include <algorithm>
#include <array>

// Section and equation numbers: P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", Proc. ACM
// Comput. Graph. Interact. Tech. 3(2), 2020.

namespace ars {

using namespace detail;

namespace {

constexpr std::string_view kPlace = "FLIP";
constexpr double kPi = 3.14159265358979323846;
constexpr std::size_t kGrain = 4096; ///< pixels a thread is woken for
using Vec3 = std::array<double, 3>;
using Planes = std::array<Plane, 3>;

/// Linear Rec.709 RGB to XYZ, and the white that they add up to.
constexpr double kToXyz[3][3] = {{10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794},
                                 {2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897},
                                 {1425312.0 / 73733382, 8788810.0 / 73733382, 70074185.0 / 73733382}};
constexpr Vec3 kWhite{kToXyz[0][0] + kToXyz[0][1] + kToXyz[0][2], kToXyz[1][0] + kToXyz[1][1] + kToXyz[1][2],
                      kToXyz[2][0] + kToXyz[2][1] + kToXyz[2][2]};

double srgbToLinear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

/// XYZ divided by the white's.
Vec3 rgbToRelativeXyz(const Vec3& rgb) {
    Vec3 xyz{};
    for (std::size_t i = 0; i < 3; ++i) {
        xyz[i] = (kToXyz[i][0] * rgb[0] + kToXyz[i][1] * rgb[1] + kToXyz[i][2] * rgb[2]) / kWhite[i];
    }
    return xyz;
}

Vec3 relativeXyzToRgb(const Vec3& relative) {
    // Cramer's rule on the matrix above.
    const auto& m = kToXyz;
    const Vec3 v{relative[0] * kWhite[0], relative[1] * kWhite[1], relative[2] * kWhite[2]};
    const auto minor = [&](int r0, int r1, int c0, int c1) { return m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0]; };
    const double determinant = m[0][0] * minor(1, 2, 1, 2) - m[0][1] * minor(1, 2, 0, 2) + m[0][2] * minor(1, 2, 0, 1);
    return {(v[0] * minor(1, 2, 1, 2) - v[1] * minor(0, 2, 1, 2) + v[2] * minor(0, 1, 1, 2)) / determinant,
            (-v[0] * minor(1, 2, 0, 2) + v[1] * minor(0, 2, 0, 2) - v[2] * minor(0, 1, 0, 2)) / determinant,
            (v[0] * minor(1, 2, 0, 1) - v[1] * minor(0, 2, 0, 1) + v[2] * minor(0, 1, 0, 1)) / determinant};
}

/// The linear opponent space Y Cx Cz in which contrast sensitivity is filtered (4.1.1).
Vec3 opponentOf(const Vec3& rgb) {
    const Vec3 xyz = rgbToRelativeXyz(rgb);
    return {116 * xyz[1] - 16, 500 * (xyz[0] - xyz[1]), 200 * (xyz[1] - xyz[2])};
}

Vec3 rgbOfOpponent(const Vec3& opponent) {
    const double y = (opponent[0] + 16) / 116;
    return relativeXyzToRgb({opponent[1] / 500 + y, y, y - opponent[2] / 200});
}

/// CIELAB whose chroma is scaled by lightness, for the Hunt effect (4.1.2, Eq. 6).
Vec3 huntLab(const Vec3& rgb) {
    const auto f = [](double t) {
        constexpr double delta = 6.0 / 29;
        return t > delta * delta * delta ? std::cbrt(t) : t / (3 * delta * delta) + 4.0 / 29;
    };
    const Vec3 xyz = rgbToRelativeXyz(rgb);
    const double fx = f(xyz[0]), fy = f(xyz[1]), fz = f(xyz[2]), lightness = 116 * fy - 16;
    return {lightness, 0.01 * lightness * 500 * (fx - fy), 0.01 * lightness * 200 * (fy - fz)};
}

/// City-block distance in lightness plus Euclidean in chroma (Eq. 7).
double hyabDistance(const Vec3& a, const Vec3& b) {
    return std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]);
}

/// Terms a sqrt(pi/b) exp(-pi^2 r^2 / b) of the contrast sensitivity filters, r in degrees (Table 1).
struct Gaussian {
    double a, b;
};
constexpr Gaussian kAchromatic{1, 0.0047}, kRedGreen{1, 0.0053}, kBlueYellow1{34.1, 0.04}, kBlueYellow2{13.5, 0.025};

/// Contrast sensitivity (4.1.1): each channel blurred as the eye does at this distance. Two-dimensional filters whose
/// sum is 1, cut off at three standard deviations of the widest.
Planes filteredByEye(const Planes& opponent, double pixelsPerDegree) {
    const int radius = static_cast<int>(std::ceil(3 * std::sqrt(kBlueYellow1.b / (2 * kPi * kPi)) * pixelsPerDegree));
    // Sum of a term over the cut-off square; it is a product of two sums, as the term is.
    const auto blurred = [&](const Plane& plane, const Gaussian& term, double& weight) {
        const double sigma = std::sqrt(term.b / (2 * kPi * kPi)) * pixelsPerDegree;
        double sum = 0;
        for (int i = -radius; i <= radius; ++i) sum += std::exp(-0.5 * i * i / (sigma * sigma));
        weight = term.a * std::sqrt(kPi / term.b) * sum * sum;
        const std::vector<double> taps = gaussianTaps(sigma, radius);
        return filterSeparable(plane, taps, taps, Border::Repeat);
    };
    double alone = 0, w1 = 0, w2 = 0; // a channel of one term needs no weight
    Planes result{blurred(opponent[0], kAchromatic, alone), blurred(opponent[1], kRedGreen, alone),
                  blurred(opponent[2], kBlueYellow1, w1)};
    const Plane narrow = blurred(opponent[2], kBlueYellow2, w2);
    for (std::size_t p = 0; p < narrow.values.size(); ++p) {
        result[2].values[p] = (w1 * result[2].values[p] + w2 * narrow.values[p]) / (w1 + w2);
    }
    return result;
}

/// One picture taken apart: its filtered colour in Hunt-adjusted Lab and its unfiltered lightness in [0, 1].
struct Seen {
    std::vector<Vec3> lab;
    Plane lightness;
};

Seen see(Picture picture, double pixelsPerDegree) {
    Planes opponent;
    opponent.fill(Plane(picture.width, picture.height));
    Seen seen;
    seen.lightness = Plane(picture.width, picture.height);
    seen.lab.resize(picture.pixelCount());
    parallelFor(
        picture.pixelCount(),
        [&](std::size_t p) {
            Vec3 linear{};
            for (std::size_t c = 0; c < 3; ++c) {
                linear[c] = srgbToLinear(std::clamp(static_cast<double>(picture.pixel(p)[c]), 0.0, 1.0));
            }
            const Vec3 color = opponentOf(linear);
            for (std::size_t c = 0; c < 3; ++c) opponent[c].values[p] = color[c];
            seen.lightness.values[p] = (color[0] + 16) / 116;
        },
        kGrain);
    const Planes filtered = filteredByEye(opponent, pixelsPerDegree);
    parallelFor(
        picture.pixelCount(),
        [&](std::size_t p) {
            Vec3 rgb = rgbOfOpponent({filtered[0].values[p], filtered[1].values[p], filtered[2].values[p]});
            for (double& c : rgb) c = std::clamp(c, 0.0, 1.0);
            seen.lab[p] = huntLab(rgb);
        },
        kGrain);
    return seen;
}

/// Edges and points (4.2): lengths of the first and second derivative of lightness at the scale of the eye's edge
/// detectors.
struct Features {
    std::vector<double> edges, points;
};

/// Derivatives whose positive and negative taps each add up to 1.
std::vector<double> balanced(std::vector<double> taps) {
    double positive = 0, negative = 0;
    for (const double t : taps) (t > 0 ? positive : negative) += t;
    for (double& t : taps) t /= t > 0 ? positive : -negative;
    return taps;
}

Features featuresOf(const Plane& lightness, double pixelsPerDegree) {
    const double sigma = 0.5 * 0.082 * pixelsPerDegree; // the width of an edge detector is 0.082 degrees
    const int radius = static_cast<int>(std::ceil(3 * sigma));
    const std::vector<double> smooth = gaussianTaps(sigma, radius);
    std::vector<double> first, second;
    for (int i = -radius; i <= radius; ++i) {
        const double g = std::exp(-0.5 * i * i / (sigma * sigma));
        first.push_back(-i * g);
        second.push_back((i * i / (sigma * sigma) - 1) * g);
    }
    const auto length = [&](const std::vector<double>& derivative) {
        const Plane x = filterSeparable(lightness, smooth, derivative, Border::Repeat);
        const Plane y = filterSeparable(lightness, derivative, smooth, Border::Repeat);
        std::vector<double> result(x.values.size());
        for (std::size_t p = 0; p < result.size(); ++p) result[p] = std::hypot(x.values[p], y.values[p]);
        return result;
    };
    return {length(balanced(first)), length(balanced(second))};
}

/// Colour differences from 0 to the largest mapped to [0, 1]: up to 0.4 of the largest linearly to [0, 0.95], the rest
/// compressed (Eq. 9).
double redistributed(double powered, double largest) {
    constexpr double share = 0.4, target = 0.95;
    const double knee = share * largest;
    return powered < knee ? target / knee * powered : target + (powered - knee) / (largest - knee) * (1 - target);
}

Result<std::vector<double>> flipValues(Picture reference, Picture test, const FlipParams& params) {
    ARS_TRY_STATUS(checkPair(kPlace, reference, test, 3));
    if (!(params.pixelsPerDegree >= 1 && params.pixelsPerDegree <= 1000)) {
        return makeError(ErrorCode::InvalidArgument, std::string(kPlace),
                         fmt::format("{} pixels per degree, expected 1 to 1000", params.pixelsPerDegree));
    }
    for (std::size_t p = 0; p < reference.pixelCount(); ++p) {
        if (!allFinite(reference.pixel(p), 3) || !allFinite(test.pixel(p), 3)) return pixelNotFinite(kPlace, test, p);
    }
    constexpr double kColorPower = 0.7, kFeaturePower = 0.5;
    const Seen a = see(reference, params.pixelsPerDegree), b = see(test, params.pixelsPerDegree);
    const Features fa = featuresOf(a.lightness, params.pixelsPerDegree),
                   fb = featuresOf(b.lightness, params.pixelsPerDegree);
    const double largest = std::pow(hyabDistance(huntLab({0, 1, 0}), huntLab({0, 0, 1})), kColorPower); // Eq. 8
    std::vector<double> values(a.lab.size());
    parallelFor(
        values.size(),
        [&](std::size_t p) {
            const double color = redistributed(std::pow(hyabDistance(a.lab[p], b.lab[p]), kColorPower), largest);
            const double feature = std::max(std::abs(fa.edges[p] - fb.edges[p]), std::abs(fa.points[p] - fb.points[p]));
            // Eq. 11 and 12: differences of features raise those of colour.
            const double raised = std::pow(std::clamp(feature / std::sqrt(2.0), 0.0, 1.0), kFeaturePower);
            values[p] = std::pow(color, 1 - raised);
        },
        kGrain);
    return values;
}

} // namespace

Status flipMap(Picture reference, Picture test, ImageView<float> map, const FlipParams& params) {
    if (map.empty() || map.width != reference.width || map.height != reference.height || map.channels != 1) {
        return makeError(
            ErrorCode::InvalidArgument, std::string(kPlace),
            fmt::format("a map of {}x{} with {} channels for pictures of {}x{}, expected the same size and 1",
                        map.width, map.height, map.channels, reference.width, reference.height));
    }
    ARS_TRY(const std::vector<double> values, flipValues(reference, test, params));
    for (std::size_t p = 0; p < values.size(); ++p) map[p] = static_cast<float>(values[p]);
    return {};
}

Result<double> meanFlip(Picture reference, Picture test, Picture mask, const FlipParams& params) {
    ARS_TRY(const std::vector<double> values, flipValues(reference, test, params));
    ARS_TRY_STATUS(checkMask(kPlace, mask, reference));
    double sum = 0;
    std::size_t pixels = 0;
    for (std::size_t p = 0; p < values.size(); ++p) {
        if (!counts(mask, p)) continue;
        sum += values[p];
        ++pixels;
    }
    if (pixels == 0) return noPixelCounts(kPlace);
    return sum / static_cast<double>(pixels);
}

} // namespace ars
