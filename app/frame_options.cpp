#include "app/frame_options.h"

#include "app/rig_source.h"
#include "app/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

namespace ars::app {

namespace {

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

/// The group of a setting: which struct of the frame its table describes.
template <typename Visit>
void visitGroups(FrameInputs& inputs, Visit&& visit) {
    visit("splat", splatParameters(), inputs.splat);
    visit("pose", poseSurfelsParameters(), inputs.posing);
    visit("occlusion", occlusionParameters(), inputs.occlusion.screenSpace);
    visit("mesh_rays", meshOcclusionParameters(), inputs.occlusion.meshRays);
    visit("rasterised", rasterisedVisibilityParameters(), inputs.occlusion.rasterised);
    visit("baked", bakedVisibilityParameters(), inputs.occlusion.baked);
}

Status applySetting(const std::string& text, FrameInputs& inputs) {
    const std::size_t dot = text.find('.'), equal = text.find('=');
    if (dot == std::string::npos || equal == std::string::npos || dot > equal) {
        return wrongUsage("--set", fmt::format("expected GROUP.NAME=VALUE, found \"{}\"", printable(text)));
    }
    const std::string group = text.substr(0, dot), name = text.substr(dot + 1, equal - dot - 1);
    std::vector<std::string> groups;
    Status status;
    bool known = false;
    visitGroups(inputs, [&](const char* candidate, const auto& table, auto& params) {
        groups.push_back(candidate);
        if (group != candidate) return;
        known = true;
        status = table.setText(params, name, text.substr(equal + 1));
    });
    if (!known) {
        return wrongUsage("--set", fmt::format("no group \"{}\"; there are {}", printable(group), listed(groups)));
    }
    if (status.ok()) return status;
    // The place must be an option, so that this counts as wrong usage.
    return wrongUsage("--set", fmt::format("{}.{}", group, status.error().describe()));
}

Status applyOcclusion(const std::string& word, OcclusionSettings& occlusion) {
    const struct {
        const char* word;
        OcclusionMethod method;
    } methods[] = {{"body", OcclusionMethod::ScreenSpace},   {"reference", OcclusionMethod::ScreenSpace},
                   {"mesh_rays", OcclusionMethod::MeshRays}, {"rasterised", OcclusionMethod::Rasterised},
                   {"baked", OcclusionMethod::Baked},        {"off", OcclusionMethod::Off}};
    if (word.empty()) return {};
    std::vector<std::string> words;
    for (const auto& method : methods) {
        words.push_back(method.word);
        if (word != method.word) continue;
        occlusion.method = method.method;
        if (word == "body") occlusion.screenSpace = bodyOcclusion();
        if (word == "reference") occlusion.screenSpace = referenceOcclusion();
        return {};
    }
    return wrongUsage("--occlusion", fmt::format("no method \"{}\"; there are {}", printable(word), listed(words)));
}

Status checkRadius(float radius, const std::string& text) {
    if (radius > 0.0f && radius <= 10.0f) return {};
    return wrongUsage("--radius", fmt::format("expected metres above 0 and at most 10, found \"{}\"", printable(text)));
}

Status applyRadius(const std::string& text, PartRadii& radii) {
    std::size_t begin = 0;
    while (begin < text.size()) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        const std::string item = text.substr(begin, end - begin);
        begin = end + 1;
        const std::size_t equal = item.find('=');
        const std::string number = equal == std::string::npos ? item : item.substr(equal + 1);
        float value = 0;
        const auto parsed = std::from_chars(number.data(), number.data() + number.size(), value);
        if (parsed.ec != std::errc() || parsed.ptr != number.data() + number.size()) value = -1;
        ARS_TRY_STATUS(checkRadius(value, item));
        if (equal == std::string::npos) {
            radii = uniformPartRadii(value);
            continue;
        }
        std::vector<std::string> names;
        bool known = false;
        for (int part = 0; part < kBodyPartCount; ++part) {
            names.emplace_back(bodyPartName(static_cast<BodyPart>(part)));
            if (names.back() != item.substr(0, equal)) continue;
            radii[static_cast<std::size_t>(part)] = value;
            known = true;
        }
        if (!known) {
            return wrongUsage("--radius", fmt::format("no part \"{}\"; there are {}", printable(item.substr(0, equal)),
                                                      listed(names, 9)));
        }
    }
    return {};
}

} // namespace

Result<Device> chooseDevice(const std::string& text) {
    if (text == "auto") {
        const auto devices = availableDevices();
        return devices.size() > 1 ? devices[1] : Device{};
    }
    auto device = parseDevice(text);
    if (!device) return atPlace(device.error(), "--device");
    return device;
}

Status applyFrameOptions(const FrameOptions& options, FrameInputs& inputs) {
    ARS_TRY_STATUS(applyOcclusion(options.occlusion, inputs.occlusion));
    ARS_TRY_STATUS(applyRadius(options.radius, inputs.radii));
    for (const std::string& setting : options.settings) ARS_TRY_STATUS(applySetting(setting, inputs));
    if (const Status sound = validateOcclusionParams(inputs.occlusion.screenSpace); !sound) {
        return wrongUsage("--set", sound.error().describe());
    }
    return {};
}

Result<DisplaySettings> displaySettings(const DisplayOptions& options) {
    DisplaySettings settings;
    settings.tone.exposureEv = static_cast<float>(options.exposureEv);
    settings.tone.transparent = options.transparent;
    if (const Status set = toneParameters().setText(settings.tone, "curve", options.curve); !set) {
        return wrongUsage("--curve", set.error().message);
    }
    ARS_TRY(const std::vector<float> encoded, parseNumbers(options.background, "--background"));
    const bool inRange = std::all_of(encoded.begin(), encoded.end(), [](float v) { return v >= 0.0f && v <= 1.0f; });
    if ((encoded.size() != 1 && encoded.size() != 3) || !inRange) {
        return wrongUsage("--background", fmt::format("expected one number or R,G,B in [0,1], found \"{}\"",
                                                      printable(options.background)));
    }
    settings.tone.backgroundRed = srgbToLinear(encoded[0]);
    settings.tone.backgroundGreen = srgbToLinear(encoded[encoded.size() == 3 ? 1 : 0]);
    settings.tone.backgroundBlue = srgbToLinear(encoded[encoded.size() == 3 ? 2 : 0]);
    return settings;
}

std::string describeSettings() {
    FrameInputs inputs;
    std::string text;
    visitGroups(inputs, [&](const char* group, const auto& table, auto&) {
        std::vector<ParameterInfo> infos = table.infos();
        for (ParameterInfo& info : infos) info.name = fmt::format("{}.{}", group, info.name);
        text += describeParameters(infos);
    });
    return text;
}

Result<PictureSize> parseSize(const std::string& text, const std::string& option) {
    const auto wrong = [&] {
        return wrongUsage(option,
                          fmt::format("expected WIDTHxHEIGHT with sides of 1 to 16384, found \"{}\"", printable(text)));
    };
    const std::size_t cross = text.find('x');
    if (cross == std::string::npos) return wrong();
    PictureSize size;
    const auto number = [](std::string_view digits, int& value) {
        const auto parsed = std::from_chars(digits.data(), digits.data() + digits.size(), value);
        return parsed.ec == std::errc() && parsed.ptr == digits.data() + digits.size() && value >= 1 && value <= 16384;
    };
    const std::string_view view = text;
    if (!number(view.substr(0, cross), size.width) || !number(view.substr(cross + 1), size.height)) return wrong();
    return size;
}

} // namespace ars::app
