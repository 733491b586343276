#include "engine/frame/light_source.h"

#include <fmt/format.h>

#include <charconv>

namespace ars {

namespace {

Error wrongVariant(const std::string& source, std::string_view expected) {
    return makeError(ErrorCode::InvalidArgument, source, fmt::format("expected {}", expected));
}

Result<Environment> skyLight(const std::string& source, std::string_view variant) {
    SkyParams params;
    if (!variant.empty()) {
        constexpr std::string_view form = "sky:ELEVATION,AZIMUTH in degrees, such as sky:12,40";
        const std::size_t comma = variant.find(',');
        if (comma == std::string_view::npos) return wrongVariant(source, form);
        const auto number = [](std::string_view text, float& value) {
            const auto end = text.data() + text.size();
            const auto parsed = std::from_chars(text.data(), end, value);
            return parsed.ec == std::errc() && parsed.ptr == end;
        };
        if (!number(variant.substr(0, comma), params.sunElevationDeg) ||
            !number(variant.substr(comma + 1), params.sunAzimuthDeg)) {
            return wrongVariant(source, form);
        }
    }
    ARS_TRY(Sky sky, generateSky(params));
    return std::move(sky.environment);
}

Result<Environment> studioLight(const std::string& source, std::string_view variant) {
    const auto& words = EnumWords<StudioPreset>::words;
    for (std::size_t i = 0; i < words.size(); ++i) {
        if (variant == words[i] || (variant.empty() && i == 0)) {
            return generateStudio(studioPreset(static_cast<StudioPreset>(i)));
        }
    }
    return wrongVariant(source, "studio:three_point, studio:rim, studio:beauty or studio:overcast");
}

} // namespace

Result<Environment> readLight(const std::string& source) {
    const std::size_t colon = source.find(':');
    const std::string word = source.substr(0, colon);
    const std::string variant = colon == std::string::npos ? "" : source.substr(colon + 1);
    if (word == "sky") return skyLight(source, variant);
    if (word == "studio") return studioLight(source, variant);
    if (source == "uniform") return uniformEnvironment(1.0f);
    return readEnvironment(source);
}

Result<LightSource> readLightSource(const std::string& source, const Device& device, LightQuality quality, int baseSize,
                                    const ProgressFunction& progress) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the light"));
    ARS_TRY(Environment environment, readLight(source));
    return filterLight(source, std::move(environment), device, quality, baseSize, progress);
}

Result<LightSource> filterLight(std::string name, Environment environment, const Device& device, LightQuality quality,
                                int baseSize, const ProgressFunction& progress) {
    LightSource light;
    light.name = std::move(name);
    light.environment = std::move(environment);
    ARS_TRY_STATUS(reportProgress(progress, 0.2, "filtering the light"));
    ARS_TRY(light.base, cubeFromLatLong(light.environment.picture, baseSize));
    light.filtered = std::make_shared<PrefilteredLight>();
    PrefilterParams params;
    params.quality = quality;
    ARS_TRY_STATUS(prefilterLight(device, light.base, params, *light.filtered));
    ARS_TRY_STATUS(reportProgress(progress, 1.0, "filtering the light"));
    return light;
}

} // namespace ars
