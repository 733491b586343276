#include "engine/light/split_sum_lut.h"

#include "engine/core/parallel.h"

#include <cmath>
#include <cstring>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

namespace ars {
namespace {

constexpr double kPi = 3.14159265358979323846;
/// Samples of a table entry: rings and angles. They agree with 400 x 400 within 2e-3 everywhere (split_sum_test.cpp).
constexpr int kRings = 24, kAngles = 8;
/// Samples that are summed side by side, for the compiler to make vectors of.
constexpr std::size_t kLanes = 64;

/// Midpoints of the unit half-disc, as columns; the other half mirrors it because the view lies in the plane of
/// symmetry.
template <typename T>
struct DiscSamples {
    std::vector<T> x, y, rest; ///< place, and sqrt(1 - x^2)
    std::vector<T> weight;     ///< all sum to 1

    DiscSamples(int rings, int angles) {
        double total = 0.0;
        for (int i = 0; i < rings; ++i) {
            // The long tail of GGX lies at the disc's border; rings get thinner towards it, area 1 - s^3.
            const double s = 1.0 - (i + 0.5) / rings, share = 3.0 * s * s;
            const double radius = std::sqrt(1.0 - s * s * s);
            for (int j = 0; j < angles; ++j) {
                const double angle = kPi * ((j + 0.5) / angles - 0.5);
                add(radius * std::cos(angle), radius * std::sin(angle), share);
                total += share;
            }
        }
        for (T& w : weight) w /= T(total);
        while (x.size() % kLanes != 0) add(0.0, 0.0, 0.0);
    }

private:
    void add(double px, double py, double share) {
        x.push_back(T(px));
        y.push_back(T(py));
        rest.push_back(T(std::sqrt(1.0 - px * px)));
        weight.push_back(T(share));
    }
};

template <typename T>
T positive(T x) {
    return x > T(0) ? x : T(0);
}

/// Smith's Lambda of GGX.
template <typename T>
T smithLambda(T cosine, T alphaSquared) {
    const T c2 = cosine * cosine;
    return T(0.5) * (std::sqrt(T(1) + alphaSquared * (T(1) - c2) / c2) - T(1));
}

/// Both integrals by sampling visible normals (Heitz 2018): each sample counts G2 / G1, which is never above 1.
template <typename T>
void integrate(T nov, T roughness, const DiscSamples<T>& samples, T& a, T& b) {
    const T alpha = roughness * roughness, alphaSquared = alpha * alpha;
    const T sine = std::sqrt(positive(T(1) - nov * nov));
    const T length = std::sqrt(alphaSquared * sine * sine + nov * nov);
    const T vx = alpha * sine / length, vz = nov / length;
    const T blend = T(0.5) * (T(1) + vz);
    const T view = T(1) + smithLambda(nov, alphaSquared);
    T sumA[kLanes] = {}, sumB[kLanes] = {};
    for (std::size_t first = 0; first < samples.x.size(); first += kLanes) {
        for (std::size_t k = 0; k < kLanes; ++k) {
            const T sx = samples.x[first + k];
            const T y = (T(1) - blend) * samples.rest[first + k] + blend * samples.y[first + k];
            const T z = std::sqrt(positive(T(1) - sx * sx - y * y));
            // The half vector: x in the plane of the view, y across it, z along the normal.
            const T hx = alpha * (z * vx - y * vz), hy = alpha * sx, hz = positive(y * vx + z * vz);
            const T norm = T(1) / std::sqrt(hx * hx + hy * hy + hz * hz);
            const T voh = (hx * sine + hz * nov) * norm;
            const T nol = T(2) * voh * hz * norm - nov;
            // Light from below counts nothing; its cosine is held away from 0 only so that nothing divides by it.
            const T lit = nol > T(1e-6) ? nol : T(1e-6);
            const T all = samples.weight[first + k] * view / (view + smithLambda(lit, alphaSquared));
            const T weight = nol > T(0) ? all : T(0);
            const T m = T(1) - voh, m2 = m * m, fresnel = m2 * m2 * m;
            sumA[k] += (T(1) - fresnel) * weight;
            sumB[k] += fresnel * weight;
        }
    }
    a = b = T(0);
    for (std::size_t k = 0; k < kLanes; ++k) {
        a += sumA[k];
        b += sumB[k];
    }
}

void fillTable(ImageView<float> table) {
    const DiscSamples<float> samples(kRings, kAngles);
    const float step = 1.0f / static_cast<float>(kSplitSumLutSize);
    parallelFor(
        static_cast<std::size_t>(kSplitSumLutSize),
        [&](std::size_t row) {
            const float roughness = (static_cast<float>(row) + 0.5f) * step;
            for (int column = 0; column < kSplitSumLutSize; ++column) {
                float* out = table.at(static_cast<int>(row), column);
                integrate((static_cast<float>(column) + 0.5f) * step, roughness, samples, out[0], out[1]);
            }
        },
        1);
}

Result<std::shared_ptr<const PixelBuffer>> makeTable() {
    ARS_TRY(PixelBuffer table,
            PixelBuffer::allocate({}, kSplitSumLutSize, kSplitSumLutSize, 2, "light: split-sum table"));
    fillTable(table.view());
    return std::shared_ptr<const PixelBuffer>(std::make_shared<PixelBuffer>(std::move(table)));
}

} // namespace

Result<std::shared_ptr<const PixelBuffer>> splitSumLut(const Device& device) {
    static std::mutex mutex;
    // Never destroyed: when the process ends, a device may be gone before its table.
    static auto& tables = *new std::map<std::pair<int, int>, std::shared_ptr<const PixelBuffer>>;
    const auto key = [](const Device& d) { return std::make_pair(static_cast<int>(d.kind), d.index); };
    const std::lock_guard<std::mutex> lock(mutex);
    std::shared_ptr<const PixelBuffer>& host = tables[key(Device{})];
    if (!host) {
        ARS_TRY(host, makeTable());
    }
    if (device.kind == DeviceKind::Host) return host;
    std::shared_ptr<const PixelBuffer>& there = tables[key(device)];
    if (!there) {
        ARS_TRY(PixelBuffer copy,
                PixelBuffer::allocate(device, kSplitSumLutSize, kSplitSumLutSize, 2, "light: split-sum table"));
        ARS_TRY_STATUS(copyBuffer(copy.memory(), host->memory(), host->memory().bytes()));
        there = std::make_shared<PixelBuffer>(std::move(copy));
    }
    return there;
}

void splitSumEntry(double normalDotView, double roughness, int samplesPerAxis, double& a, double& b) {
    integrate(normalDotView, roughness, DiscSamples<double>(samplesPerAxis, samplesPerAxis), a, b);
}

} // namespace ars
