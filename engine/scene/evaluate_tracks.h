#pragma once

#include "engine/scene/document.h"

#include <array>
#include <cstddef>

namespace ars::tracks {

/// Where a time falls on a track: between keys `from` and `to`, or on `from` alone. `before` and `after` are the
/// neighbours that give the curve its slopes; equal to `from` or `to` at the ends.
struct Place {
    std::size_t before = 0, from = 0, to = 0, after = 0;
    double share = 0.0; ///< way from `from` to `to`, [0, 1)
    KeyInterpolation interpolation = KeyInterpolation::Step;
};

/// Times of the four keys of a place, seconds.
using Times = std::array<double, 4>;
using Four = std::array<double, 4>;

/// One number: the values of the four keys. Smooth is Hermite with slopes of the parabola through three keys
/// (Catmull-Rom on uneven times), 0 where the value turns back and at the ends, and limited (Fritsch and Carlson 1980)
/// so that the curve never leaves the range of its two keys.
double blend(const Place& place, const Times& times, const Four& values);

/// Slope at the middle one of three keys, per second; `h0`, `h1` their distances, `d0`, `d1` the differences.
double slope(double h0, double h1, double d0, double d1);

template <typename Value>
Place placeOn(const Track<Value>& track, double timeS) {
    Place place;
    const std::size_t last = track.size() - 1;
    if (!(timeS > track.front().timeS)) return place; // NaN, too
    if (timeS >= track.back().timeS) {
        place.before = place.from = place.to = place.after = last;
        return place;
    }
    // First key after the time; the ends are settled, so it has a neighbour before it.
    std::size_t low = 0, high = last;
    while (high - low > 1) {
        const std::size_t middle = (low + high) / 2;
        (track[middle].timeS <= timeS ? low : high) = middle;
    }
    place.from = low;
    place.to = high;
    place.before = low > 0 ? low - 1 : low;
    place.after = high < last ? high + 1 : high;
    place.share = (timeS - track[low].timeS) / (track[high].timeS - track[low].timeS);
    place.interpolation = track[low].interpolation;
    return place;
}

template <typename Value>
Times timesOf(const Track<Value>& track, const Place& place) {
    return {track[place.before].timeS, track[place.from].timeS, track[place.to].timeS, track[place.after].timeS};
}

} // namespace ars::tracks
