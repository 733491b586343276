#include "app/render_document.h"

#include "engine/capture/calibration.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/project.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace ars::app {
namespace fs = std::filesystem;

namespace {

/// The least exposure that a document holds: black.
constexpr float kDarkestEv = -64.0f;

std::string absolutePath(const std::string& path) {
    std::error_code failure;
    const fs::path absolute = fs::absolute(path, failure);
    return failure ? path : absolute.lexically_normal().string();
}

AvatarSection avatarOf(const RenderedFrame& frame) {
    AvatarSection avatar;
    const std::string prefix = "rest:", source = frame.options->avatar;
    if (!source.starts_with(prefix)) {
        avatar.source = absolutePath(source);
        return avatar;
    }
    avatar.source = source == prefix + "open" ? source : prefix + absolutePath(source.substr(prefix.size()));
    avatar.rest = frame.rest;
    return avatar;
}

/// Generated lights by their words ("sky:12,40", readLight), else a file.
LightSection lightOf(const RenderOptions& options, const EnvironmentPlacement& placement) {
    LightSection light;
    const std::string& source = options.environment;
    const std::size_t colon = source.find(':');
    const std::string word = source.substr(0, colon);
    const std::string variant = colon == std::string::npos ? "" : source.substr(colon + 1);
    if (word == "sky") {
        light.kind = LightKind::Sky;
        const char* end = variant.data() + variant.size();
        const auto elevation = std::from_chars(variant.data(), end, light.sky.sunElevationDeg);
        if (elevation.ptr < end) std::from_chars(elevation.ptr + 1, end, light.sky.sunAzimuthDeg);
    } else if (word == "studio") {
        light.kind = LightKind::Studio;
        const auto& words = EnumWords<StudioPreset>::words;
        for (std::size_t i = 0; i < words.size(); ++i) {
            if (variant == words[i] || (variant.empty() && i == 0))
                light.studio = studioPreset(static_cast<StudioPreset>(i));
        }
    } else if (source == "uniform") {
        light.kind = LightKind::Uniform;
        light.uniformRadiance = 1.0f;
    } else {
        light.kind = LightKind::File;
        light.file = absolutePath(source);
    }
    light.rotationDeg = placement.rotationDeg;
    light.exposureEv = placement.scale > 0.0f ? std::max(kDarkestEv, std::log2(placement.scale)) : kDarkestEv;
    light.backdrop = options.display.backdrop ? BackdropKind::Environment : BackdropKind::Color;
    return light;
}

CameraSection cameraOf(const RenderOptions& options, const FrameInputs& inputs) {
    CameraSection section;
    const double distance = inputs.camera.toCamera(glm::dvec3(inputs.pose.translation)).z;
    section.camera = sceneCameraOf(inputs.camera, std::max(0.1, distance));
    const std::size_t colon = options.camera.rfind(':');
    std::error_code failure;
    if (colon == std::string::npos || fs::exists(options.camera, failure)) return section;
    section.capture = absolutePath(options.camera.substr(0, colon));
    section.datasetCamera = options.camera.substr(colon + 1);
    return section;
}

/// The motion as the clip of the timeline, where the studio reads the file as this rendering did.
void addClip(const RenderedFrame& frame, TimelineSection& timeline) {
    const RenderOptions& options = *frame.options;
    if (!frame.motion || options.framesPerSecond > 0.0 || !options.map.empty() || options.up != "auto") return;
    const std::string path = absolutePath(options.motion);
    const auto clip = loadClipAsset(path, *frame.skeleton, {}, frame.soleHeightM);
    if (!clip) return;
    const Motion& played = *(*clip)->motion;
    const std::size_t first = frame.number - frame.frame, count = frame.motion->frames.size();
    if (played.framesPerSecond != frame.motion->framesPerSecond || played.frames.size() < first + count) return;
    for (std::size_t i = 0; i < count; ++i) {
        const Pose &a = played.frames[first + i], &b = frame.motion->frames[i];
        if (a.rotations != b.rotations || a.translation != b.translation) return;
    }
    timeline.clip = path;
    timeline.framesPerSecond = played.framesPerSecond;
    timeline.startS = static_cast<double>(first) / played.framesPerSecond;
    timeline.endS = static_cast<double>(first + count) / played.framesPerSecond;
    timeline.timeS = static_cast<double>(frame.number) / played.framesPerSecond;
}

} // namespace

Document documentOfFrame(const RenderedFrame& frame) {
    const FrameInputs& inputs = *frame.inputs;
    Document document;
    document.avatar = avatarOf(frame);
    document.pose.pose = inputs.pose;
    addClip(frame, document.timeline);
    document.camera = cameraOf(*frame.options, inputs);
    document.light = lightOf(*frame.options, inputs.placement);
    document.occlusion.radii = inputs.radii;
    document.occlusion.initial = frame.initialRadii;
    document.occlusion.settings = inputs.occlusion;
    document.occlusion.posing = inputs.posing;
    document.occlusion.splat = inputs.splat;
    document.occlusion.shading = inputs.shading;
    document.view.buffer = BufferId::Beauty;
    document.view.tone = frame.tone;
    document.view.tone.transparent = false; // of files alone
    return document;
}

std::string renderedDocument(const RenderedFrame& frame) {
    Json json = documentToJson(documentOfFrame(frame));
    Json facts{{"program", fmt::format("ars {}", ARS_VERSION)},
               {"device", deviceName(frame.device)},
               {"surfels", frame.surfels},
               {"light", lightQualityName(frame.lightQuality)},
               {"camera", cameraToJson(frame.inputs->camera)}};
    if (frame.motion) facts["motion"] = Json{{"file", absolutePath(frame.options->motion)}, {"frame", frame.number}};
    json["picture"] = std::move(facts);
    return json.dump();
}

} // namespace ars::app
