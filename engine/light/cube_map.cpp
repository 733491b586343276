#include "engine/light/cube_map.h"

#include "engine/core/parallel.h"
#include "engine/light/prefilter_math.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::size_t kRowGrain = 8;

/// Above this multiple of the mean radiance light is carried over texel by texel, because a sampling grid would miss or
/// double it.
constexpr float kPeakFactor = 16.0f;

Status checkLatLong(const Image& picture) {
    if (picture.width > 0 && picture.height > 0 && picture.channels == 3 && picture.space != ColorSpace::Srgb &&
        picture.pixels.size() ==
            3 * static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height)) {
        return {};
    }
    return makeError(ErrorCode::InvalidArgument, "environment",
                     fmt::format("{}x{} with {} channels ({}), expected a linear picture with 3", picture.width,
                                 picture.height, picture.channels, colorSpaceName(picture.space)));
}

/// Solid angle of a pixel of row `row`.
double rowSolidAngle(int row, int width, int height) {
    return (std::cos(kPi * row / height) - std::cos(kPi * (row + 1) / height)) * 2.0 * kPi / width;
}

/// Half the size, each pixel the mean by solid angle of four.
Image halved(const Image& source) {
    Image half;
    half.width = source.width / 2;
    half.height = source.height / 2;
    half.channels = 3;
    half.pixels.resize(3 * static_cast<std::size_t>(half.width) * static_cast<std::size_t>(half.height));
    parallelFor(
        static_cast<std::size_t>(half.height),
        [&](std::size_t y) {
            const int row = static_cast<int>(y);
            const double upper = rowSolidAngle(2 * row, source.width, source.height);
            const double lower = rowSolidAngle(2 * row + 1, source.width, source.height);
            const float a = static_cast<float>(0.5 * upper / (upper + lower)), b = 0.5f - a;
            for (int x = 0; x < half.width; ++x) {
                for (int c = 0; c < 3; ++c) {
                    half.at(row, x, c) = a * (source.at(2 * row, 2 * x, c) + source.at(2 * row, 2 * x + 1, c)) +
                                         b * (source.at(2 * row + 1, 2 * x, c) + source.at(2 * row + 1, 2 * x + 1, c));
                }
            }
        },
        kRowGrain);
    return half;
}

inline float larger(float a, float b) { return a > b ? a : b; }

/// Arc tangent of y / x over the whole circle, absolute error below 2e-6: a hundredth of a texel of the widest
/// environment. Without branches, so that rows of them become vectors; the library's is what conversion would wait for.
inline float fastAtan2(float y, float x) {
    const float ax = std::fabs(x), ay = std::fabs(y);
    const float largest = larger(ax, ay), smallest = ax + ay - largest;
    const float t = smallest / larger(largest, 1e-30f), s = t * t;
    // Minimax polynomial of atan on [0, 1] (Abramowitz and Stegun 4.4.49).
    float r = 0.0028662257f;
    r = r * s - 0.0161657367f;
    r = r * s + 0.0429096138f;
    r = r * s - 0.0752896400f;
    r = r * s + 0.1065626393f;
    r = r * s - 0.1420889944f;
    r = r * s + 0.1999355085f;
    r = r * s - 0.3333314528f;
    r = t + t * s * r;
    r = ay > ax ? static_cast<float>(0.5 * kPi) - r : r;
    r = x < 0.0f ? static_cast<float>(kPi) - r : r;
    return y < 0.0f ? -r : r;
}

/// Places in a lat-long picture and weights of one row of samples on a face.
struct SampleRow {
    std::vector<float> x, y, weight;

    explicit SampleRow(std::size_t count) : x(count), y(count), weight(count) {}

    /// Row `row` of `size` x `size` samples of a face; x and y in pixels of a `width` x `height` picture, centres
    /// whole.
    void fill(int face, int row, int size, int width, int height) {
        const CubeFaceAxes<float> axes = cubeFaceAxes<float>(face);
        const float v = texelCoordinate<float>(row, size), step = 2.0f / static_cast<float>(size);
        const glm::vec3 start = axes.major + v * axes.down;
        const glm::vec3 right = axes.right;
        const float across = static_cast<float>(width), down = static_cast<float>(height);
        constexpr float kTurn = static_cast<float>(0.5 / kPi), kHalfTurn = static_cast<float>(1.0 / kPi);
        float *px = x.data(), *py = y.data(), *pw = weight.data();
        for (int i = 0; i < size; ++i) {
            const float u = (static_cast<float>(i) + 0.5f) * step - 1.0f;
            const float dx = start.x + u * right.x, dy = start.y + u * right.y, dz = start.z + u * right.z;
            const float square = 1.0f + u * u + v * v;
            pw[i] = 1.0f / (square * std::sqrt(square));
            px[i] = (0.5f - fastAtan2(dx, dz) * kTurn) * across - 0.5f;
            py[i] = fastAtan2(std::sqrt(dx * dx + dz * dz), dy) * kHalfTurn * down - 0.5f;
        }
    }
};

/// Bilinear lookup in a lat-long picture; wraps around, and over the poles to the opposite meridian.
struct LatLongSampler {
    const float* pixels;
    int width, height;

    const float* pixel(int row, int column) const {
        if (row < 0 || row >= height) {
            row = row < 0 ? -1 - row : 2 * height - 1 - row;
            column += width / 2;
        }
        column = column < 0 ? column + width : (column >= width ? column % width : column);
        return pixels +
               3 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column));
    }
    glm::vec3 operator()(float x, float y) const {
        const int x0 = static_cast<int>(x + 1.0f) - 1, y0 = static_cast<int>(y + 1.0f) - 1;
        const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
        const float *a = pixel(y0, x0), *b = pixel(y0, x0 + 1), *c = pixel(y0 + 1, x0), *e = pixel(y0 + 1, x0 + 1);
        glm::vec3 result;
        for (int k = 0; k < 3; ++k) {
            const float upper = a[k] + fx * (b[k] - a[k]), lower = c[k] + fx * (e[k] - c[k]);
            result[k] = upper + fy * (lower - upper);
        }
        return result;
    }
};

/// Every texel the mean of perTexel^2 samples, weighted by the solid angle that each stands for.
CubeMap gatherCube(const LatLongSampler& sample, int size, int perTexel) {
    CubeMap cube(size);
    const int fine = size * perTexel;
    parallelRanges(static_cast<std::size_t>(6 * size), kRowGrain, [&](std::size_t begin, std::size_t end) {
        SampleRow row(static_cast<std::size_t>(fine));
        std::vector<glm::vec4> sums(static_cast<std::size_t>(size));
        for (std::size_t line = begin; line < end; ++line) {
            const int face = static_cast<int>(line) / size, first = static_cast<int>(line) % size * perTexel;
            std::fill(sums.begin(), sums.end(), glm::vec4(0.0f));
            for (int k = 0; k < perTexel; ++k) {
                row.fill(face, first + k, fine, sample.width, sample.height);
                for (int i = 0; i < fine; ++i) {
                    const std::size_t at = static_cast<std::size_t>(i);
                    sums[static_cast<std::size_t>(i / perTexel)] +=
                        row.weight[at] * glm::vec4(sample(row.x[at], row.y[at]), 1.0f);
                }
            }
            float* out = cube.texels.data() + 3 * line * static_cast<std::size_t>(size);
            for (const glm::vec4& sum : sums) {
                for (int c = 0; c < 3; ++c) *out++ = sum[c] / sum.w;
            }
        }
    });
    return cube;
}

struct Peak {
    int row, column;
    glm::vec3 excess;
};

/// Takes away what exceeds `limit` and returns it; colours keep their hue on both sides.
std::vector<Peak> takePeaks(Image& picture, float limit) {
    std::vector<Peak> peaks;
    for (int row = 0; row < picture.height; ++row) {
        for (int column = 0; column < picture.width; ++column) {
            float* p = &picture.at(row, column, 0);
            const float largest = std::max({p[0], p[1], p[2]});
            if (!(largest > limit)) continue;
            const float keep = limit / largest;
            const glm::vec3 all(p[0], p[1], p[2]);
            for (int c = 0; c < 3; ++c) p[c] = keep * all[c];
            peaks.push_back({row, column, (1.0f - keep) * all});
        }
    }
    return peaks;
}

/// Adds a peak as the tent that bilinear interpolation would make of it, its flux kept exactly.
/// @param angles  texelSolidAngles of the cube
void scatterPeak(const Peak& peak, int width, int height, int perPixel, const std::vector<float>& angles,
                 CubeMap& cube) {
    const int count = 2 * perPixel;
    double total = 0.0;
    const auto tent = [&](int i) { return 1.0 - std::fabs((i + 0.5) / perPixel - 1.0); };
    for (int i = 0; i < count; ++i) total += tent(i);
    const glm::dvec3 whole = glm::dvec3(peak.excess) * rowSolidAngle(peak.row, width, height) / (total * total);
    for (int i = 0; i < count; ++i) {
        for (int j = 0; j < count; ++j) {
            double v = (peak.row - 0.5 + (i + 0.5) / perPixel) / height;
            double u = (peak.column - 0.5 + (j + 0.5) / perPixel) / width;
            if (v < 0.0 || v > 1.0) {
                v = v < 0.0 ? -v : 2.0 - v;
                u += 0.5;
            }
            const CubeTaps<float> taps = cubeTaps(glm::vec3(latLongDirection(u, v)), cube.size);
            for (int k = 0; k < 4; ++k) {
                const double share = tent(i) * tent(j) * static_cast<double>(taps.weight[k]) /
                                     static_cast<double>(angles[taps.index[k] % angles.size()]);
                for (std::size_t c = 0; c < 3; ++c) {
                    cube.texels[3 * taps.index[k] + c] += static_cast<float>(whole[static_cast<int>(c)] * share);
                }
            }
        }
    }
}

/// Scales each channel so that the whole has the flux that it came from; sampling is off by parts in ten thousand, in
/// pictures of a few pixels by parts in ten.
void keepFlux(float* pixels, std::size_t count, const glm::dvec3& wanted, const glm::dvec3& found) {
    for (int c = 0; c < 3; ++c) {
        const double scale = found[c] > 0.0 && wanted[c] > 0.0 ? wanted[c] / found[c] : 1.0;
        const float factor = std::isfinite(scale) ? static_cast<float>(scale) : 1.0f;
        for (std::size_t i = 0; i < count; ++i) pixels[3 * i + static_cast<std::size_t>(c)] *= factor;
    }
}

/// Largest of the three mean radiances.
float meanRadiance(const glm::dvec3& flux) {
    return static_cast<float>(std::max({flux.x, flux.y, flux.z}) / (4.0 * kPi));
}

} // namespace

std::vector<float> texelSolidAngles(int size, TexelArea area) {
    const std::size_t n = static_cast<std::size_t>(std::max(size, 0));
    std::vector<float> angles(n * n);
    if (area == TexelArea::Nvdiffrec) {
        for (std::size_t i = 0; i < angles.size(); ++i) {
            angles[i] =
                static_cast<float>(nvdiffrecTexelArea<double>(static_cast<int>(i / n), static_cast<int>(i % n), size));
        }
        return angles;
    }
    // A face is symmetrical in both axes and their order: an eighth is enough.
    const std::size_t half = (n + 1) / 2;
    parallelFor(
        half,
        [&](std::size_t y) {
            for (std::size_t x = 0; x <= y; ++x) {
                const float angle =
                    static_cast<float>(exactTexelArea<double>(static_cast<int>(y), static_cast<int>(x), size));
                for (const std::size_t a : {y, n - 1 - y}) {
                    for (const std::size_t b : {x, n - 1 - x}) angles[a * n + b] = angles[b * n + a] = angle;
                }
            }
        },
        kRowGrain);
    return angles;
}

glm::dvec3 latLongDirection(double u, double v) {
    const double angle = 2.0 * kPi * (0.5 - u), polar = kPi * v;
    return {std::sin(polar) * std::sin(angle), std::cos(polar), std::sin(polar) * std::cos(angle)};
}

glm::dvec2 latLongPlace(const glm::dvec3& direction) {
    const double flat = std::sqrt(direction.x * direction.x + direction.z * direction.z);
    return {0.5 - std::atan2(direction.x, direction.z) / (2.0 * kPi), std::atan2(flat, direction.y) / kPi};
}

glm::dvec3 totalFlux(const CubeMap& cube) {
    const std::vector<float> angles = texelSolidAngles(cube.size);
    double red = 0.0, green = 0.0, blue = 0.0;
    const float* texel = cube.texels.data();
    for (int face = 0; face < 6; ++face) {
        for (const float angle : angles) {
            red += static_cast<double>(texel[0] * angle);
            green += static_cast<double>(texel[1] * angle);
            blue += static_cast<double>(texel[2] * angle);
            texel += 3;
        }
    }
    return {red, green, blue};
}

glm::dvec3 totalFlux(const Image& latLong) {
    glm::dvec3 flux(0.0);
    for (int row = 0; row < latLong.height; ++row) {
        glm::dvec3 sum(0.0);
        for (int column = 0; column < latLong.width; ++column) {
            for (int c = 0; c < 3; ++c) sum[c] += static_cast<double>(latLong.at(row, column, c));
        }
        flux += sum * rowSolidAngle(row, latLong.width, latLong.height);
    }
    return flux;
}

Result<CubeMap> cubeFromLatLong(const Image& latLong, int size) {
    ARS_TRY_STATUS(checkLatLong(latLong));
    if (size < 1 || size > kMaxCubeSize) {
        return makeError(ErrorCode::InvalidArgument, "cube map",
                         fmt::format("side {}, expected 1 to {}", size, kMaxCubeSize));
    }
    Image picture = latLong;
    const glm::dvec3 wanted = totalFlux(picture);
    while (picture.width >= 8 * size && picture.width % 2 == 0 && picture.height % 2 == 0) picture = halved(picture);

    // Pixels of the picture for each texel of the cube, along an axis.
    const double ratio = static_cast<double>(picture.width) / (4.0 * size);
    std::vector<Peak> peaks;
    constexpr double kLeastRatio = 0.125; // below, every pixel covers so many texels that sampling cannot miss it
    if (ratio >= kLeastRatio) peaks = takePeaks(picture, kPeakFactor * meanRadiance(wanted));
    const glm::dvec3 basis = peaks.empty() ? wanted : totalFlux(picture);
    const int perTexel = std::clamp(static_cast<int>(std::ceil(2.0 * ratio)), 1, 8);
    CubeMap cube = gatherCube(LatLongSampler{picture.pixels.data(), picture.width, picture.height}, size, perTexel);
    keepFlux(cube.texels.data(), cube.texels.size() / 3, basis, totalFlux(cube));
    if (!peaks.empty()) {
        const std::vector<float> angles = texelSolidAngles(size);
        const int perPixel = std::max(1, static_cast<int>(std::ceil(2.0 / ratio)));
        for (const Peak& peak : peaks) scatterPeak(peak, picture.width, picture.height, perPixel, angles, cube);
    }
    return cube;
}

Result<Image> latLongFromCube(const CubeMap& cube, int width, int height) {
    const ReadLimits limits = defaultReadLimits();
    ARS_TRY(const std::size_t count, imageValueCount(width, height, 3, limits));
    Image picture;
    picture.width = width;
    picture.height = height;
    picture.channels = 3;
    picture.pixels.resize(count);
    const int perPixel = std::clamp(static_cast<int>(std::ceil(8.0 * cube.size / width)), 2, 8);
    parallelFor(
        static_cast<std::size_t>(height),
        [&](std::size_t row) {
            for (int column = 0; column < width; ++column) {
                glm::vec3 sum(0.0f);
                for (int k = 0; k < perPixel * perPixel; ++k) {
                    const double u = (column + (k % perPixel + 0.5) / perPixel) / width;
                    const double v = (static_cast<double>(row) + (k / perPixel + 0.5) / perPixel) / height;
                    sum += lookupCube(cube.lookupView(), glm::vec3(latLongDirection(u, v)));
                }
                for (int c = 0; c < 3; ++c) {
                    picture.at(static_cast<int>(row), column, c) = sum[c] / static_cast<float>(perPixel * perPixel);
                }
            }
        },
        kRowGrain);
    keepFlux(picture.pixels.data(), picture.pixels.size() / 3, totalFlux(cube), totalFlux(picture));
    return picture;
}

} // namespace ars
