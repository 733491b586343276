#include "engine/frame/color_map.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars {

namespace {

/// Polynomial in t, coefficients from the constant upwards.
template <std::size_t N>
glm::vec3 polynomial(const std::array<glm::vec3, N>& coefficients, float t) {
    glm::vec3 value = coefficients[N - 1];
    for (std::size_t i = N - 1; i-- > 0;) value = value * t + coefficients[i];
    return glm::clamp(value, 0.0f, 1.0f);
}

// Least-squares fits of degree 6 and 5 to the published tables.
constexpr std::array<glm::vec3, 7> kViridis{{{0.27773f, 0.00541f, 0.33410f},
                                             {0.10509f, 1.40461f, 1.38459f},
                                             {-0.33086f, 0.21485f, 0.09510f},
                                             {-4.63423f, -5.79910f, -19.33244f},
                                             {6.22827f, 14.17993f, 56.69055f},
                                             {4.77638f, -13.74515f, -65.35303f},
                                             {-5.43546f, 4.64585f, 26.31244f}}};
constexpr std::array<glm::vec3, 7> kMagma{{{-0.00214f, -0.00075f, -0.00539f},
                                           {0.25166f, 0.67752f, 2.49403f},
                                           {8.35372f, -3.57772f, 0.31447f},
                                           {-27.66873f, 14.26473f, -13.64921f},
                                           {52.17614f, -27.94361f, 12.94417f},
                                           {-50.76853f, 29.04658f, 4.23415f},
                                           {18.65571f, -11.48977f, -5.60196f}}};
constexpr std::array<glm::vec3, 6> kTurbo{{{0.13572f, 0.09140f, 0.10667f},
                                           {4.61539f, 2.19419f, 12.64195f},
                                           {-42.66032f, 4.84297f, -60.58205f},
                                           {132.13108f, -14.18503f, 110.36277f},
                                           {-152.94239f, 4.27730f, -89.90311f},
                                           {59.28638f, 2.82957f, 27.34825f}}};

glm::vec3 signedColor(float t) {
    const glm::vec3 blue(0.10f, 0.32f, 0.72f), white(0.96f), red(0.78f, 0.13f, 0.13f);
    return t < 0.5f ? glm::mix(blue, white, 2.0f * t) : glm::mix(white, red, 2.0f * t - 1.0f);
}

} // namespace

std::string_view colorMapName(ColorMap map) {
    constexpr std::array<std::string_view, 5> names{"gray", "viridis", "magma", "turbo", "signed"};
    return names[static_cast<std::size_t>(map)];
}

glm::vec3 mapColor(ColorMap map, float t) {
    if (std::isnan(t)) return {1.0f, 0.0f, 1.0f};
    t = std::clamp(t, 0.0f, 1.0f);
    switch (map) {
    case ColorMap::Gray:
        return glm::vec3(t);
    case ColorMap::Viridis:
        return polynomial(kViridis, t);
    case ColorMap::Magma:
        return polynomial(kMagma, t);
    case ColorMap::Turbo:
        return polynomial(kTurbo, t);
    case ColorMap::Signed:
        return signedColor(t);
    }
    return glm::vec3(t);
}

} // namespace ars
