#include "ui/look/sun_clock.h"

#include <glm/glm.hpp>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

glm::dvec3 directionOf(const SunPosition& sun) {
    const double azimuth = sun.azimuthDeg / kDegrees, elevation = sun.elevationDeg / kDegrees;
    return {std::cos(elevation) * std::sin(azimuth), std::sin(elevation), std::cos(elevation) * std::cos(azimuth)};
}

} // namespace

SunHour nearestSunHour(const SunPlace& place, const SunPosition& sun) {
    const glm::dvec3 wanted = directionOf(sun);
    const auto angle = [&](double hours) {
        const glm::dvec3 there = directionOf(sunPosition(place.latitudeDeg, place.dayOfYear, hours));
        // Of the chord: exact for small angles, where a dot product has no digits left.
        return 2.0 * std::asin(std::min(1.0, 0.5 * glm::length(there - wanted))) * kDegrees;
    };
    double best = 0.0;
    for (double hours = 0.0; hours < 24.0; hours += 0.25) {
        if (angle(hours) < angle(best)) best = hours;
    }
    double low = best - 0.25, high = best + 0.25;
    for (int i = 0; i < 40; ++i) {
        const double third = (high - low) / 3.0;
        if (angle(low + third) < angle(high - third)) {
            high -= third;
        } else {
            low += third;
        }
    }
    const double hours = 0.5 * (low + high);
    return {hours - 24.0 * std::floor(hours / 24.0), angle(hours)};
}

} // namespace ars::ui
