#pragma once

#include "engine/core/parameters.h"
#include "engine/light/environment.h"

#include <glm/glm.hpp>

namespace ars {

/// Daylight through a clear or hazy atmosphere above a plain ground.
struct SkyParams {
    float sunElevationDeg = 35.0f; ///< above the horizon; below -18 it is night
    float sunAzimuthDeg = 40.0f;   ///< 0 is +z (in front of the body), 90 is +x
    float turbidity = 2.5f;        ///< 1 clear air ... 10 thick haze
    float groundAlbedo = 0.25f;    ///< of the grey ground
    float sunScale = 1.0f;         ///< brightness of the disc; 0 hides it
    float sunDiameterDeg = 0.533f; ///< the same light from a larger disc gives softer highlights
    bool normalise = true;         ///< fixed brightness whatever the hour; false keeps the true ratios of day and dusk
    int width = 1024;              ///< pixels; the height is half of it

    bool operator==(const SkyParams&) const = default;
};
const ParameterTable<SkyParams>& skyParameters();

struct Sky {
    Environment environment;
    double luminancePerUnit = 0.0; ///< cd/m^2 that the value 1 stands for
    glm::dvec3 sunDirection{0.0};  ///< unit, towards the sun, in the environment's frame
};

/// Renders the sky.
///
/// Rayleigh, aerosol and ozone terms of a spherical earth with the coefficients of Bruneton and Neyret (2008/2017),
/// single scattering integrated along each ray, multiple scattering by Hillaire's (2020) isotropic series. With
/// normalise, a white ball is lit to 0.5 on average; without, 1 stands for 20,000 cd/m^2. InvalidArgument: a parameter
/// out of range.
Result<Sky> generateSky(const SkyParams& params);

/// The sun above a place, by the declination and hour-angle formula (within half a degree).
/// @param latitudeDeg   north positive
/// @param dayOfYear     1 to 366
/// @param solarTimeHours  0 to 24, 12 when the sun is highest
/// @param northAzimuthDeg where north lies in the scene (0: +z)
struct SunPosition {
    double elevationDeg = 0.0;
    double azimuthDeg = 0.0;
};
SunPosition sunPosition(double latitudeDeg, int dayOfYear, double solarTimeHours, double northAzimuthDeg = 180.0);

} // namespace ars
