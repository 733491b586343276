#include "app/light.h"

#include "app/frame_options.h"
#include "app/progress_bar.h"
#include "app/text.h"
#include "engine/frame/light_source.h"
#include "engine/io/exr.h"
#include "engine/io/hdr.h"
#include "engine/io/jpeg.h"
#include "engine/io/png.h"
#include "engine/light/split_sum_lut.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

Status applySettings(const std::vector<std::string>& settings, const auto& table, auto& params) {
    for (const std::string& setting : settings) {
        const std::size_t equal = setting.find('=');
        if (equal == std::string::npos) {
            return wrongUsage("--set", fmt::format("expected NAME=VALUE, found \"{}\"", printable(setting)));
        }
        const Status set = table.setText(params, setting.substr(0, equal), setting.substr(equal + 1));
        if (!set) return wrongUsage("--set", set.error().describe());
    }
    return {};
}

/// The environment itself, generated with the settings where it is a sky or a studio.
Result<Environment> openLight(const LightOptions& options) {
    if (options.settings.empty()) {
        auto light = readLight(options.source);
        if (!light && light.error().code == ErrorCode::InvalidArgument) {
            return wrongUsage("LIGHT", light.error().describe());
        }
        return light;
    }
    if (options.source == "sky") {
        SkyParams params;
        ARS_TRY_STATUS(applySettings(options.settings, skyParameters(), params));
        ARS_TRY(Sky sky, generateSky(params));
        return std::move(sky.environment);
    }
    if (options.source.starts_with("studio")) {
        StudioParams params = studioPreset(StudioPreset::ThreePoint);
        const auto& words = EnumWords<StudioPreset>::words;
        for (std::size_t i = 0; i < words.size(); ++i) {
            if (options.source == fmt::format("studio:{}", words[i]))
                params = studioPreset(static_cast<StudioPreset>(i));
        }
        ARS_TRY_STATUS(applySettings(options.settings, studioParameters(), params));
        return generateStudio(params);
    }
    return wrongUsage("--set", "only the sky and the studio have settings");
}

struct LightFacts {
    glm::dvec3 flux{0.0};
    double brightest = 0.0;
    glm::dvec3 brightestDirection{0.0};
};

LightFacts factsOf(const Image& picture) {
    LightFacts facts;
    facts.flux = totalFlux(picture);
    for (int row = 0; row < picture.height; ++row) {
        for (int column = 0; column < picture.width; ++column) {
            const double luminance = 0.2126 * picture.at(row, column, 0) + 0.7152 * picture.at(row, column, 1) +
                                     0.0722 * picture.at(row, column, 2);
            if (luminance <= facts.brightest) continue;
            facts.brightest = luminance;
            facts.brightestDirection = latLongDirection((column + 0.5) / picture.width, (row + 0.5) / picture.height);
        }
    }
    return facts;
}

/// The picture turned, scaled and of the wanted size: by way of a cube where pixels must be averaged.
Result<Image> converted(const LightOptions& options, const Image& picture) {
    Image result = picture;
    const double turn = options.rotationDeg / 360.0;
    if (turn != 0.0) {
        for (int row = 0; row < picture.height; ++row) {
            for (int column = 0; column < picture.width; ++column) {
                // Positive rotation takes +z (the middle) towards +x (a quarter to the left).
                const double x = column + turn * picture.width;
                const double floor = std::floor(x);
                const auto left =
                    static_cast<int>(std::fmod(std::fmod(floor, picture.width) + picture.width, picture.width));
                const int right = (left + 1) % picture.width;
                const float f = static_cast<float>(x - floor);
                for (int c = 0; c < 3; ++c) {
                    result.at(row, column, c) = (1 - f) * picture.at(row, left, c) + f * picture.at(row, right, c);
                }
            }
        }
    }
    for (float& value : result.pixels) value *= static_cast<float>(options.scale);
    if (options.size.empty()) return result;
    ARS_TRY(const PictureSize size, parseSize(options.size, "--size"));
    int side = 64;
    while (side < kMaxCubeSize && 4 * side < size.width) side *= 2;
    ARS_TRY(const CubeMap cube, cubeFromLatLong(result, side));
    return latLongFromCube(cube, size.width, size.height);
}

Status writeLight(const fs::path& path, const Image& picture, const Json& document) {
    std::string ending = path.extension().string();
    std::transform(ending.begin(), ending.end(), ending.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (ending == ".exr") {
        ExrImage exr;
        exr.textAttributes["ars"] = document.dump();
        ARS_TRY_STATUS(addExrLayer(exr, "", picture, "RGB", ExrPixelType::Float));
        return writeExr(path, exr);
    }
    if (ending == ".hdr") return writeHdr(path, picture);
    if (ending == ".png" || ending == ".jpg" || ending == ".jpeg") {
        ARS_TRY(const Image shown, convertColorSpace(picture, ColorSpace::Srgb));
        if (ending != ".png") return writeJpeg(path, shown);
        PngWriteOptions png;
        png.text["ars"] = document.dump();
        return writePng(path, shown, png);
    }
    return wrongUsage("--out", fmt::format("expected a name that ends in .exr, .hdr, .png or .jpg, found \"{}\"",
                                           printable(path.filename().string())));
}

/// A cube as a row of six faces, +x -x +y -y +z -z, which readers tell by its shape.
Image stripOf(ImageView<const float> cube) {
    Image strip;
    const int side = cube.width;
    strip.width = 6 * side;
    strip.height = side;
    strip.channels = 3;
    strip.pixels.resize(cube.valueCount());
    for (int face = 0; face < 6; ++face) {
        for (int row = 0; row < side; ++row) {
            const float* source = cube.at(face * side + row, 0);
            std::copy(source, source + 3 * side,
                      &strip.pixels[(static_cast<std::size_t>(row) * static_cast<std::size_t>(strip.width) +
                                     static_cast<std::size_t>(face * side)) *
                                    3]);
        }
    }
    return strip;
}

Result<Image> stripOf(const PixelBuffer& buffer) {
    std::vector<float> values(buffer.view().valueCount());
    ARS_TRY_STATUS(downloadBuffer(std::as_writable_bytes(std::span(values)), buffer.memory()));
    return stripOf(ImageView<const float>{values.data(), buffer.width(), buffer.height(), buffer.channels()});
}

struct PrefilterResult {
    std::vector<fs::path> files;
    double milliseconds = 0;
    double draftMilliseconds = 0;
};

Result<PrefilterResult> writePrefiltered(const LightOptions& options, const Environment& environment,
                                         const Json& document) {
    ARS_TRY(const Device device, chooseDevice(options.device));
    PrefilterResult result;
    ARS_TRY(const CubeMap base, cubeFromLatLong(environment.picture, options.lightSize));
    PrefilteredLight light;
    const auto timed = [&](LightQuality quality, double& milliseconds) -> Status {
        PrefilterParams params;
        params.quality = quality;
        const auto begin = std::chrono::steady_clock::now();
        ARS_TRY_STATUS(prefilterLight(device, base, params, light));
        ARS_TRY_STATUS(waitForDevice(device));
        milliseconds = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
        return {};
    };
    ARS_TRY_STATUS(timed(LightQuality::Draft, result.draftMilliseconds));
    ARS_TRY_STATUS(timed(LightQuality::Exact, result.milliseconds));
    const fs::path folder = options.prefilter;
    for (int level = 0; level < light.levels; ++level) {
        ARS_TRY(const Image strip, stripOf(light.specular[static_cast<std::size_t>(level)]));
        result.files.push_back(folder / fmt::format("specular_{}.exr", level));
        ARS_TRY_STATUS(writeLight(result.files.back(), strip, document));
    }
    ARS_TRY(const Image diffuse, stripOf(light.diffuse));
    result.files.push_back(folder / "irradiance.exr");
    ARS_TRY_STATUS(writeLight(result.files.back(), diffuse, document));
    std::vector<float> table(light.lut->view().valueCount());
    ARS_TRY_STATUS(downloadBuffer(std::as_writable_bytes(std::span(table)), light.lut->memory()));
    Image lut;
    lut.width = light.lut->width();
    lut.height = light.lut->height();
    lut.channels = 3;
    lut.space = ColorSpace::Data;
    for (std::size_t i = 0; i < table.size(); i += 2)
        lut.pixels.insert(lut.pixels.end(), {table[i], table[i + 1], 0.0f});
    result.files.push_back(folder / "split_sum.exr");
    ARS_TRY_STATUS(writeLight(result.files.back(), lut, document));
    return result;
}

Status light(const LightOptions& options, ProgressBar& bar) {
    if (!(options.scale >= 0.0) || !std::isfinite(options.rotationDeg)) {
        return wrongUsage("--scale", "expected a factor of 0 or more");
    }
    ARS_TRY_STATUS(reportProgress(bar.function(), 0.0, "reading the light"));
    ARS_TRY(Environment environment, openLight(options));
    ARS_TRY(environment.picture, converted(options, environment.picture));
    const Json document{{"program", fmt::format("ars {}", ARS_VERSION)},
                        {"light", options.source},
                        {"settings", options.settings},
                        {"rotation_deg", options.rotationDeg},
                        {"scale", options.scale}};
    std::vector<fs::path> files;
    if (!options.out.empty()) {
        Image picture = environment.picture;
        if (options.cube > 0) {
            ARS_TRY(const CubeMap cube, cubeFromLatLong(picture, options.cube));
            picture = stripOf(cube.view());
        }
        ARS_TRY_STATUS(writeLight(options.out, picture, document));
        files.push_back(options.out);
    }
    PrefilterResult filtered;
    if (!options.prefilter.empty()) {
        ARS_TRY_STATUS(reportProgress(bar.function(), 0.3, "filtering the light"));
        ARS_TRY(filtered, writePrefiltered(options, environment, document));
        files.insert(files.end(), filtered.files.begin(), filtered.files.end());
    }
    bar.clear();
    const LightFacts facts = factsOf(environment.picture);
    const glm::dvec3 mean = facts.flux / (4.0 * std::numbers::pi);
    if (options.output.json) {
        Json json{{"light", options.source},
                  {"width", environment.picture.width},
                  {"height", environment.picture.height},
                  {"mean_radiance", {mean.x, mean.y, mean.z}},
                  {"brightest_luminance", facts.brightest},
                  {"brightest_direction",
                   {facts.brightestDirection.x, facts.brightestDirection.y, facts.brightestDirection.z}},
                  {"files", Json::array()},
                  {"notes", environment.notes}};
        for (const fs::path& file : files) json["files"].push_back(file.string());
        if (!options.prefilter.empty()) {
            json["prefilter_ms"] = filtered.milliseconds;
            json["prefilter_draft_ms"] = filtered.draftMilliseconds;
        }
        printJson(json);
        return {};
    }
    fmt::print("{}: {}x{}, mean radiance {:.3g} {:.3g} {:.3g}, brightest {:.4g} towards ({:.2f}, {:.2f}, {:.2f})\n",
               printable(options.source), environment.picture.width, environment.picture.height, mean.x, mean.y, mean.z,
               facts.brightest, facts.brightestDirection.x, facts.brightestDirection.y, facts.brightestDirection.z);
    if (!options.prefilter.empty()) {
        fmt::print("filtered in {:.0f} ms (draft {:.0f} ms)\n", filtered.milliseconds, filtered.draftMilliseconds);
    }
    for (const fs::path& file : files) fmt::print("{}\n", printable(file.string()));
    for (const std::string& note : environment.notes) printNote(note, options.output);
    return {};
}

} // namespace

int runLight(const LightOptions& options) {
    ProgressBar bar(options.output.quiet);
    const Status status = light(options, bar);
    bar.clear();
    return status.ok() ? kSuccess : reportError(status.error(), options.output);
}

std::string describeLightSettings() {
    return "Settings of sky:\n" + describeParameters(skyParameters().infos()) + "Settings of studio:\n" +
           describeParameters(studioParameters().infos());
}

} // namespace ars::app
