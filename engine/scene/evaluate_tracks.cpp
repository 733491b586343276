#include "engine/scene/evaluate_tracks.h"

#include "engine/scene/evaluate.h"

#include <glm/gtc/quaternion.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ars {
namespace tracks {

double slope(double h0, double h1, double d0, double d1) {
    if (!(h0 > 0.0) || !(h1 > 0.0)) return 0.0; // an end
    const double s0 = d0 / h0, s1 = d1 / h1;
    if (s0 * s1 <= 0.0) return 0.0;
    const double parabola = (h1 * s0 + h0 * s1) / (h0 + h1);
    const double limit = 3.0 * std::min(std::abs(s0), std::abs(s1));
    return std::clamp(parabola, -limit, limit);
}

namespace {

/// Cubic Hermite over one second.
double hermite(double from, double to, double slopeFrom, double slopeTo, double t) {
    const double t2 = t * t, t3 = t2 * t;
    return (2 * t3 - 3 * t2 + 1) * from + (t3 - 2 * t2 + t) * slopeFrom + (3 * t2 - 2 * t3) * to + (t3 - t2) * slopeTo;
}

glm::dvec3 logarithm(const glm::dquat& rotation) {
    glm::dquat q = glm::normalize(rotation);
    if (q.w < 0.0) q = -q;
    const glm::dvec3 v(q.x, q.y, q.z);
    const double sine = glm::length(v);
    return v * (sine < 1e-12 ? 2.0 : 2.0 * std::atan2(sine, q.w) / sine);
}

glm::dquat exponential(const glm::dvec3& vector) {
    const double angle = glm::length(vector);
    const double scale = angle < 1e-6 ? 0.5 - angle * angle / 48.0 : std::sin(0.5 * angle) / angle;
    return glm::dquat(std::cos(0.5 * angle), scale * vector.x, scale * vector.y, scale * vector.z);
}

/// Inverse of the right Jacobian of the rotation group at `l`, applied to a body-fixed angular velocity: the speed of
/// the rotation vector that gives it (Chirikjian 2011, 10.86).
glm::dvec3 vectorSpeed(const glm::dvec3& l, const glm::dvec3& velocity) {
    const double angle = glm::length(l);
    const double factor =
        angle < 1e-4 ? 1.0 / 12.0 : 1.0 / (angle * angle) - 1.0 / (2.0 * angle * std::tan(0.5 * angle));
    const glm::dvec3 once = glm::cross(l, velocity);
    return velocity + 0.5 * once + factor * glm::cross(l, once);
}

glm::dvec3 slopes(double h0, double h1, const glm::dvec3& d0, const glm::dvec3& d1) {
    return {slope(h0, h1, d0.x, d1.x), slope(h0, h1, d0.y, d1.y), slope(h0, h1, d0.z, d1.z)};
}

/// Numbers of the four keys of a place, made by `value`.
template <typename Value, typename Number>
double blended(const Track<Value>& track, const Place& place, const Number& value) {
    return blend(place, timesOf(track, place),
                 {value(track[place.before].value), value(track[place.from].value), value(track[place.to].value),
                  value(track[place.after].value)});
}

/// The angle next to `reference`, radians.
double near(double angle, double reference) {
    return angle + 2.0 * std::numbers::pi * std::round((reference - angle) / (2.0 * std::numbers::pi));
}

/// The same with each angle within half a turn of the last, so that it goes the shorter way.
double blendAngles(const Place& place, const Times& times, Four angles) {
    angles[0] = near(angles[0], angles[1]);
    angles[2] = near(angles[2], angles[1]);
    angles[3] = near(angles[3], angles[2]);
    return blend(place, times, angles);
}

/// The eye as seen from the target.
struct Spherical {
    double azimuth = 0.0, elevation = 0.0, logDistance = 0.0;
    bool upright = false; ///< straight above or below: no azimuth of its own
};

Spherical sphericalOf(const SceneCamera& camera) {
    const glm::dvec3 away = camera.eye - camera.target;
    const double level = std::hypot(away.x, away.z), distance = std::max(glm::length(away), 1e-9);
    Spherical result;
    result.upright = level < 1e-9 * distance;
    result.azimuth = result.upright ? 0.0 : std::atan2(away.x, away.z);
    result.elevation = std::atan2(away.y, level);
    result.logDistance = std::log(distance);
    return result;
}

} // namespace

double blend(const Place& place, const Times& times, const Four& values) {
    const double from = values[1], to = values[2];
    if (place.from == place.to || place.interpolation == KeyInterpolation::Step) return from;
    if (place.interpolation == KeyInterpolation::Linear) return from + (to - from) * place.share;
    const double h = times[2] - times[1];
    const double a = slope(times[1] - times[0], h, from - values[0], to - from) * h;
    const double b = slope(h, times[3] - times[2], to - from, values[3] - to) * h;
    return hermite(from, to, a, b, place.share);
}

} // namespace tracks

using namespace tracks;

float sampleTrack(const Track<float>& track, double timeS) {
    return static_cast<float>(blended(track, placeOn(track, timeS), [](float value) { return double(value); }));
}

glm::vec3 sampleTrack(const Track<glm::vec3>& track, double timeS) {
    const Place place = placeOn(track, timeS);
    glm::vec3 result;
    for (int c = 0; c < 3; ++c) {
        result[c] = static_cast<float>(blended(track, place, [c](const glm::vec3& value) { return double(value[c]); }));
    }
    return result;
}

std::vector<float> sampleTrack(const Track<std::vector<float>>& track, double timeS) {
    const Place place = placeOn(track, timeS);
    if (place.from == place.to) return track[place.from].value;
    std::vector<float> result(std::max(track[place.from].value.size(), track[place.to].value.size()));
    for (std::size_t i = 0; i < result.size(); ++i) {
        result[i] = static_cast<float>(blended(
            track, place, [i](const std::vector<float>& value) { return i < value.size() ? double(value[i]) : 0.0; }));
    }
    return result;
}

glm::quat sampleTrack(const Track<glm::quat>& track, double timeS) {
    const Place place = placeOn(track, timeS);
    if (place.from == place.to || place.interpolation == KeyInterpolation::Step) return track[place.from].value;
    const glm::dquat before(track[place.before].value), from(track[place.from].value), to(track[place.to].value),
        after(track[place.after].value);
    const glm::dvec3 way = logarithm(glm::inverse(from) * to); // the shorter one
    if (place.interpolation == KeyInterpolation::Linear) {
        return glm::quat(glm::normalize(from * exponential(place.share * way)));
    }
    // Angular velocities at both keys as for numbers, then a Hermite curve of the rotation vector away from `from`.
    const Times times = timesOf(track, place);
    const double h = times[2] - times[1];
    const glm::dvec3 speedFrom = h * slopes(times[1] - times[0], h, logarithm(glm::inverse(before) * from), way);
    const glm::dvec3 speedTo = h * slopes(h, times[3] - times[2], way, logarithm(glm::inverse(to) * after));
    const glm::dvec3 endSpeed = vectorSpeed(way, speedTo);
    glm::dvec3 vector;
    for (int c = 0; c < 3; ++c) vector[c] = hermite(0.0, way[c], speedFrom[c], endSpeed[c], place.share);
    return glm::quat(glm::normalize(from * exponential(vector)));
}

SceneCamera sampleTrack(const Track<SceneCamera>& track, double timeS) {
    const Place place = placeOn(track, timeS);
    if (place.from == place.to || place.interpolation == KeyInterpolation::Step) return track[place.from].value;
    const Times times = timesOf(track, place);
    std::array<Spherical, 4> eyes{sphericalOf(track[place.before].value), sphericalOf(track[place.from].value),
                                  sphericalOf(track[place.to].value), sphericalOf(track[place.after].value)};
    // Straight above or below any azimuth will do: the neighbour's keeps the way straight.
    if (eyes[1].upright) eyes[1].azimuth = eyes[2].azimuth;
    if (eyes[2].upright) eyes[2].azimuth = eyes[1].azimuth;
    if (eyes[0].upright) eyes[0].azimuth = eyes[1].azimuth;
    if (eyes[3].upright) eyes[3].azimuth = eyes[2].azimuth;
    const auto ofEyes = [&eyes](double Spherical::* member) {
        return Four{eyes[0].*member, eyes[1].*member, eyes[2].*member, eyes[3].*member};
    };
    SceneCamera result;
    for (int c = 0; c < 3; ++c) {
        result.target[c] = blended(track, place, [c](const SceneCamera& camera) { return camera.target[c]; });
    }
    const double azimuth = blendAngles(place, times, ofEyes(&Spherical::azimuth));
    const double elevation = blend(place, times, ofEyes(&Spherical::elevation));
    const double distance = std::exp(blend(place, times, ofEyes(&Spherical::logDistance)));
    result.eye = result.target + distance * glm::dvec3(std::sin(azimuth) * std::cos(elevation), std::sin(elevation),
                                                       std::cos(azimuth) * std::cos(elevation));
    const double degree = std::numbers::pi / 180.0;
    const auto roll = [degree](const SceneCamera& camera) { return camera.rollDeg * degree; };
    result.rollDeg = blendAngles(place, times,
                                 {roll(track[place.before].value), roll(track[place.from].value),
                                  roll(track[place.to].value), roll(track[place.after].value)}) /
                     degree;
    result.verticalFieldDeg = blended(track, place, [](const SceneCamera& camera) { return camera.verticalFieldDeg; });
    return result;
}

} // namespace ars
