#include "engine/light/atmosphere.h"

#include "engine/core/parallel.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

constexpr double kPi = 3.14159265358979323846;

// Green and blue are taken at the dominant wavelengths of Rec.709's primaries, red at 635 nm, inside its wide band: at
// the dominant 611 nm sunsets lose their orange, at the often seen 680 nm ozone spares red light and dusk turns violet.
// Scattering by air: Bruneton and Neyret (2008) give 13.558e-3 at 550 nm, and it falls with the fourth power of the
// wavelength. Ozone: their 1.881e-3 at 550 nm, and the Chappuis band's cross-sections relative to it (about 3.5, 3.35
// and 0.45 against 3.4e-21 cm^2; Gorshelev et al. 2014).
const glm::dvec3 kWavelengths(635.0, 549.1, 464.2);
const glm::dvec3 kRayleigh(7.631e-3, 13.647e-3, 26.72e-3); ///< at the ground, 1/km
constexpr double kRayleighHeightKm = 8.0;
const glm::dvec3 kOzone(1.95e-3, 1.85e-3, 0.25e-3); ///< at 25 km; falls to 0 within 15 km
constexpr double kAerosolHeightKm = 1.2;
constexpr double kAerosolAlbedo = 0.9;
constexpr double kAerosolForward = 0.76; ///< asymmetry g
constexpr double kAngstrom = 1.3;        ///< exponent of the aerosol's extinction, as in Preetham et al. (1999)
constexpr double kSunHalfWidth = 0.00465;

constexpr int kTransmittanceHeights = 48, kTransmittanceCosines = 192, kTransmittanceSteps = 48;
constexpr int kMultipleHeights = 12, kMultipleCosines = 40, kMultipleDirections = 48, kMultipleSteps = 20;

/// Place of a value in a table, between two entries.
struct TablePlace {
    std::size_t index;
    double fraction;

    TablePlace(double place, int size) {
        const double p = std::clamp(place, 0.0, 1.0) * (size - 1);
        index = std::min(static_cast<std::size_t>(p), static_cast<std::size_t>(size - 2));
        fraction = p - static_cast<double>(index);
    }
};

glm::dvec3 lookup(const std::vector<glm::dvec3>& table, TablePlace row, TablePlace column, int columns) {
    const std::size_t stride = static_cast<std::size_t>(columns);
    const glm::dvec3* a = &table[row.index * stride + column.index];
    const glm::dvec3* b = a + stride;
    return glm::mix(glm::mix(a[0], a[1], column.fraction), glm::mix(b[0], b[1], column.fraction), row.fraction);
}

/// Heights are denser near the ground.
double heightPlace(double radiusKm) {
    const double h = std::max(radiusKm - kGroundRadiusKm, 0.0) / (kTopRadiusKm - kGroundRadiusKm);
    return std::sqrt(h);
}

double radiusAt(double place) { return kGroundRadiusKm + place * place * (kTopRadiusKm - kGroundRadiusKm); }

double horizonCosine(double radiusKm) {
    const double ratio = kGroundRadiusKm / radiusKm;
    return -std::sqrt(std::max(1.0 - ratio * ratio, 0.0));
}

double smoothStep(double from, double to, double x) {
    const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

/// Sun cosines of the table of multiple scattering, denser about the horizon.
double multiplePlace(double sunCosine) { return 0.5 + 0.5 * std::copysign(std::sqrt(std::fabs(sunCosine)), sunCosine); }

} // namespace

Atmosphere::Atmosphere(double turbidity, double groundAlbedo) : groundAlbedo_(groundAlbedo) {
    const double pureAir = kRayleigh.y * kRayleighHeightKm;
    const double atGround = (turbidity - 1.0) * pureAir / kAerosolHeightKm;
    for (int c = 0; c < 3; ++c) aerosolExtinction_[c] = atGround * std::pow(kWavelengths[c] / 550.0, -kAngstrom);
    fillTransmittance();
    fillMultiple();
}

AirSample Atmosphere::air(double heightKm) const {
    const double h = std::max(heightKm, 0.0);
    AirSample sample;
    sample.rayleigh = kRayleigh * std::exp(-h / kRayleighHeightKm);
    const glm::dvec3 aerosol = aerosolExtinction_ * std::exp(-h / kAerosolHeightKm);
    sample.aerosol = kAerosolAlbedo * aerosol;
    sample.extinction = sample.rayleigh + aerosol + kOzone * std::max(0.0, 1.0 - std::fabs(h - 25.0) / 15.0);
    return sample;
}

double Atmosphere::groundDistance(double radiusKm, double viewCosine) {
    const double b = radiusKm * viewCosine;
    const double d = b * b - radiusKm * radiusKm + kGroundRadiusKm * kGroundRadiusKm;
    if (d < 0.0 || b >= 0.0) return -1.0;
    return std::max(-b - std::sqrt(d), 0.0);
}

double Atmosphere::topDistance(double radiusKm, double viewCosine) {
    const double b = radiusKm * viewCosine;
    const double d = b * b - radiusKm * radiusKm + kTopRadiusKm * kTopRadiusKm;
    return -b + std::sqrt(std::max(d, 0.0));
}

double Atmosphere::rayleighPhase(double cosine) { return 3.0 / (16.0 * kPi) * (1.0 + cosine * cosine); }

double Atmosphere::aerosolPhase(double cosine) {
    // Cornette and Shanks (1992).
    constexpr double g = kAerosolForward;
    const double base = 1.0 + g * g - 2.0 * g * cosine;
    return 3.0 / (8.0 * kPi) * (1.0 - g * g) * (1.0 + cosine * cosine) / ((2.0 + g * g) * base * std::sqrt(base));
}

glm::dvec3 Atmosphere::opticalDepth(double radiusKm, double cosine) const {
    const double length = topDistance(radiusKm, cosine);
    glm::dvec3 depth(0.0);
    double from = 0.0;
    for (int i = 0; i < kTransmittanceSteps; ++i) {
        const double t = (i + 1.0) / kTransmittanceSteps, to = t * t * length, at = 0.5 * (from + to);
        const double radius = std::sqrt(radiusKm * radiusKm + at * at + 2.0 * radiusKm * at * cosine);
        depth += air(radius - kGroundRadiusKm).extinction * (to - from);
        from = to;
    }
    return depth;
}

void Atmosphere::fillTransmittance() {
    transmittance_.resize(static_cast<std::size_t>(kTransmittanceHeights * kTransmittanceCosines));
    parallelFor(
        transmittance_.size(),
        [&](std::size_t i) {
            const int row = static_cast<int>(i) / kTransmittanceCosines,
                      column = static_cast<int>(i) % kTransmittanceCosines;
            const double radius = radiusAt(static_cast<double>(row) / (kTransmittanceHeights - 1));
            // From the horizon (denser) to the zenith.
            const double place = static_cast<double>(column) / (kTransmittanceCosines - 1),
                         horizon = horizonCosine(radius);
            transmittance_[i] = glm::exp(-opticalDepth(radius, horizon + place * place * (1.0 - horizon)));
        },
        64);
}

glm::dvec3 Atmosphere::sunTransmittance(double radiusKm, double sunCosine) const {
    const double horizon = horizonCosine(radiusKm);
    const double above = sunCosine - horizon;
    const double seen = smoothStep(-kSunHalfWidth, kSunHalfWidth, above);
    if (seen <= 0.0) return glm::dvec3(0.0);
    const double place = std::sqrt(std::max(above, 0.0) / (1.0 - horizon));
    return seen * lookup(transmittance_, TablePlace(heightPlace(radiusKm), kTransmittanceHeights),
                         TablePlace(place, kTransmittanceCosines), kTransmittanceCosines);
}

glm::dvec3 Atmosphere::multiple(double radiusKm, double sunCosine) const {
    return lookup(multiple_, TablePlace(heightPlace(radiusKm), kMultipleHeights),
                  TablePlace(multiplePlace(sunCosine), kMultipleCosines), kMultipleCosines);
}

glm::dvec3 Atmosphere::multipleAt(double radiusKm, double sunCosine) const {
    // Hillaire, "A scalable and production ready sky and atmosphere rendering technique" (2020), eqs. 5 to 10: light
    // scattered twice, and the factor of its infinite repetition, both taken as isotropic.
    const double sunSine = std::sqrt(1.0 - sunCosine * sunCosine);
    glm::dvec3 second(0.0), transfer(0.0);
    for (int k = 0; k < kMultipleDirections; ++k) {
        const double cosine = 1.0 - 2.0 * (k + 0.5) / kMultipleDirections, angle = 2.39996322972865332 * k;
        const double sine = std::sqrt(1.0 - cosine * cosine);
        const double toGround = groundDistance(radiusKm, cosine);
        const double length = toGround >= 0.0 ? toGround : topDistance(radiusKm, cosine);
        const double viewSun = cosine * sunCosine + sine * sunSine * std::cos(angle);
        glm::dvec3 through(1.0);
        const double step = length / kMultipleSteps;
        for (int i = 0; i < kMultipleSteps; ++i) {
            const double at = (i + 0.5) * step;
            const double radius = std::sqrt(radiusKm * radiusKm + at * at + 2.0 * radiusKm * at * cosine);
            const AirSample sample = air(radius - kGroundRadiusKm);
            const glm::dvec3 scattering = sample.rayleigh + sample.aerosol;
            const glm::dvec3 passed = glm::exp(-sample.extinction * step);
            const glm::dvec3 gathered = through * scattering * (1.0 - passed) / sample.extinction;
            const double sunHere = (radiusKm * sunCosine + at * viewSun) / radius;
            second += gathered * sunTransmittance(radius, sunHere) / (4.0 * kPi);
            transfer += gathered;
            through *= passed;
        }
        if (toGround >= 0.0) {
            const double sunHere = (radiusKm * sunCosine + length * viewSun) / kGroundRadiusKm;
            second +=
                through * groundAlbedo_ / kPi * std::max(sunHere, 0.0) * sunTransmittance(kGroundRadiusKm, sunHere);
        }
    }
    second /= static_cast<double>(kMultipleDirections);
    transfer /= static_cast<double>(kMultipleDirections);
    return second / (1.0 - glm::min(transfer, glm::dvec3(0.98)));
}

void Atmosphere::fillMultiple() {
    multiple_.resize(static_cast<std::size_t>(kMultipleHeights * kMultipleCosines));
    parallelFor(
        multiple_.size(),
        [&](std::size_t i) {
            const int row = static_cast<int>(i) / kMultipleCosines, column = static_cast<int>(i) % kMultipleCosines;
            const double place = 2.0 * column / (kMultipleCosines - 1) - 1.0;
            const double radius = radiusAt(static_cast<double>(row) / (kMultipleHeights - 1));
            multiple_[i] = multipleAt(std::min(radius, kTopRadiusKm - 1e-3), std::copysign(place * place, place));
        },
        8);
}

RayLight Atmosphere::march(double radiusKm, double viewCosine, double sunCosine, double viewSun, int steps) const {
    const double toGround = groundDistance(radiusKm, viewCosine);
    const double length = toGround >= 0.0 ? toGround : topDistance(radiusKm, viewCosine);
    RayLight light;
    double from = 0.0;
    for (int i = 0; i < steps; ++i) {
        // Steps grow with distance: the air is densest here.
        const double t = (i + 1.0) / steps, to = t * t * length, at = 0.5 * (from + to);
        const double radius = std::sqrt(radiusKm * radiusKm + at * at + 2.0 * radiusKm * at * viewCosine);
        const AirSample sample = air(radius - kGroundRadiusKm);
        const glm::dvec3 passed = glm::exp(-sample.extinction * (to - from));
        const glm::dvec3 weight = light.transmittance * (1.0 - passed) / sample.extinction;
        const double sunHere = (radiusKm * sunCosine + at * viewSun) / radius;
        const glm::dvec3 sun = sunTransmittance(radius, sunHere);
        light.rayleigh += weight * sample.rayleigh * sun;
        light.aerosol += weight * sample.aerosol * sun;
        light.multiple += weight * (sample.rayleigh + sample.aerosol) * multiple(radius, sunHere);
        light.transmittance *= passed;
        from = to;
    }
    return light;
}

} // namespace ars
