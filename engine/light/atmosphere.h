#pragma once

#include <glm/glm.hpp>

#include <vector>

namespace ars {

// The air above a spherical earth, for sky.cpp. Kilometres; three wavelengths (635, 549 and 464 nm) stand for Rec.709's
// red, green and blue, and the sun above the air is white with irradiance 1.

inline constexpr double kGroundRadiusKm = 6360.0;
inline constexpr double kTopRadiusKm = 6460.0;

/// Coefficients at one height, 1/km.
struct AirSample {
    glm::dvec3 rayleigh{0.0}, aerosol{0.0}; ///< scattering
    glm::dvec3 extinction{0.0};
};

/// What one ray gathers on its way, phase functions not applied.
struct RayLight {
    glm::dvec3 rayleigh{0.0}, aerosol{0.0}; ///< single scattering
    glm::dvec3 multiple{0.0};               ///< every further order
    glm::dvec3 transmittance{1.0};          ///< of the whole way
};

class Atmosphere {
public:
    /// @param turbidity    1 clear ... 10 haze: optical thickness of all air over that of pure air, at 550 nm
    /// @param groundAlbedo of the sphere below, [0, 1]
    Atmosphere(double turbidity, double groundAlbedo);

    AirSample air(double heightKm) const;
    /// Of sunlight on its way to a point, with the earth's shadow (and the sun's half-width as its penumbra).
    glm::dvec3 sunTransmittance(double radiusKm, double sunCosine) const;
    /// Single and multiple scattering along a ray from `radiusKm`, until it leaves the air or meets the ground.
    /// @param viewCosine, sunCosine  with the vertical; viewSun between ray and sun
    RayLight march(double radiusKm, double viewCosine, double sunCosine, double viewSun, int steps) const;
    /// Distance to the ground, or negative where the ray misses it.
    static double groundDistance(double radiusKm, double viewCosine);
    static double topDistance(double radiusKm, double viewCosine);

    static double rayleighPhase(double cosine);
    static double aerosolPhase(double cosine);

private:
    glm::dvec3 opticalDepth(double radiusKm, double cosine) const;
    void fillTransmittance();
    void fillMultiple();
    glm::dvec3 multiple(double radiusKm, double sunCosine) const;
    glm::dvec3 multipleAt(double radiusKm, double sunCosine) const;

    glm::dvec3 aerosolExtinction_{0.0};
    double groundAlbedo_;
    std::vector<glm::dvec3> transmittance_; ///< (heights, cosines)
    std::vector<glm::dvec3> multiple_;      ///< (heights, sun cosines)
};

} // namespace ars
