#pragma once

#include "engine/core/parameters.h"
#include "engine/light/environment.h"

#include <glm/glm.hpp>
#include <nlohmann/json_fwd.hpp>

#include <array>
#include <string>
#include <vector>

namespace ars {

enum class LampShape { Rectangle, Round };
template <>
struct EnumWords<LampShape> {
    static constexpr std::array<std::string_view, 2> words{"rectangle", "round"};
};

/// A flat lamp that faces the subject at the origin.
struct StudioLamp {
    std::string name = "lamp";
    LampShape shape = LampShape::Rectangle;
    float azimuthDeg = 45.0f;   ///< 0 is +z (in front of the body), 90 is +x
    float elevationDeg = 35.0f; ///< above the horizon
    float distanceM = 2.0f;
    float widthM = 1.0f;
    float heightM = 1.0f;
    float rollDeg = 0.0f;   ///< about its axis
    float softness = 0.25f; ///< 0 hard edge ... 1 bright only in the middle
    float intensity = 1.0f; ///< radiance of a white card at the origin that faces the lamp, whatever its size
    float temperatureK = 5600.0f;
    float tintRed = 1.0f, tintGreen = 1.0f, tintBlue = 1.0f; ///< linear filter over the lamp

    bool operator==(const StudioLamp&) const = default;
};
const ParameterTable<StudioLamp>& studioLampParameters();

/// Soft boxes in a grey room.
struct StudioParams {
    std::vector<StudioLamp> lamps;
    float floorRadiance = 0.03f;
    float horizonRadiance = 0.06f;
    float ceilingRadiance = 0.10f;
    int width = 1024; ///< pixels; the height is half of it

    bool operator==(const StudioParams&) const = default;
};
/// Rows of everything but the lamps.
const ParameterTable<StudioParams>& studioParameters();

enum class StudioPreset { ThreePoint, Rim, Beauty, Overcast };
template <>
struct EnumWords<StudioPreset> {
    static constexpr std::array<std::string_view, 4> words{"three_point", "rim", "beauty", "overcast"};
};
StudioParams studioPreset(StudioPreset preset);

/// Renders the studio; each lamp's light is exact whatever the picture's size. InvalidArgument names lamp and
/// parameter; LimitExceeded beyond 64 lamps.
Result<Environment> generateStudio(const StudioParams& params);

nlohmann::json studioToJson(const StudioParams& params);
Result<StudioParams> studioFromJson(const nlohmann::json& json);

/// Linear Rec.709 colour of a black body with luminance 1 (Kim et al. 2002 for the locus); 6504 K is about white.
/// @param temperatureK clamped to [1667, 25000]
glm::dvec3 blackBodyColor(double temperatureK);

} // namespace ars
