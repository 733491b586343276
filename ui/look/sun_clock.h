#pragma once

#include "engine/light/sky.h"

namespace ars::ui {

/// Day and place at which the sun of a sky is read as a time of day. Not part of the document, which has the sun's
/// direction alone.
struct SunPlace {
    double latitudeDeg = 48.0; ///< north positive
    int dayOfYear = 172;       ///< 1 to 366
};

/// The solar time, [0, 24) hours, at which the sun comes nearest to a direction.
struct SunHour {
    double hours = 12.0;
    double errorDeg = 0.0; ///< angle that is left: the direction may be one that the sun never takes there
};
SunHour nearestSunHour(const SunPlace& place, const SunPosition& sun);

} // namespace ars::ui
