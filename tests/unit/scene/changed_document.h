#pragma once

#include "engine/scene/document.h"

#include <cmath>

namespace ars::test {

/// Every row of a parameter table moved away from what it is, within its range.
template <typename Struct>
void changeAll(const ParameterTable<Struct>& table, Struct& params) {
    for (const ParameterInfo& info : table.infos()) {
        ParameterValue value = table.get(params, info.name).value();
        if (auto* flag = std::get_if<bool>(&value)) {
            *flag = !*flag;
        } else if (auto* text = std::get_if<std::string>(&value)) {
            if (info.choices.empty()) {
                *text += " \"\xc3\xa4\\\" changed";
            } else {
                *text = info.choices[*text == info.choices[0] ? 1 : 0];
            }
        } else {
            const auto between = [&](double was) {
                double low = info.range.minimum, high = info.range.maximum;
                if (low == high) low = was, high = was + 2.0;
                const double at = low + (high - low) / 3.0;
                return std::abs(at - was) > 1e-3 * (high - low) ? at : low + (high - low) / 2.0;
            };
            if (auto* number = std::get_if<double>(&value)) *number = between(*number);
            if (auto* whole = std::get_if<std::int64_t>(&value)) {
                *whole = static_cast<std::int64_t>(std::floor(between(static_cast<double>(*whole))));
            }
        }
        const Status set = table.set(params, info.name, value);
        if (!set.ok()) std::abort();
    }
}

template <typename Value>
Track<Value> twoKeys(Value first, Value second) {
    return {{0.1, std::move(first), KeyInterpolation::Linear}, {1.0 / 3.0, std::move(second), KeyInterpolation::Step}};
}

inline void changeOcclusion(OcclusionSection& occlusion) {
    for (std::size_t part = 0; part < kBodyPartCount; ++part) {
        occlusion.radii[part] *= 1.1f;
        occlusion.initial[part] *= 0.7f;
        occlusion.locked[part] = true;
    }
    OcclusionSettings& settings = occlusion.settings;
    settings.method = OcclusionMethod::Baked;
    changeAll(occlusionParameters(), settings.screenSpace);
    changeAll(meshOcclusionParameters(), settings.meshRays);
    changeAll(rasterisedVisibilityParameters(), settings.rasterised);
    changeAll(bakedVisibilityParameters(), settings.baked);
    settings.baked.centerM = {0.1f, 0.2f, 0.3f};
    changeAll(poseSurfelsParameters(), occlusion.posing);
    changeAll(splatParameters(), occlusion.splat);
    occlusion.shading = {false, false, 0.07f};
}

inline void changeLight(LightSection& light) {
    light.kind = LightKind::File;
    light.file = "/nowhere/lights/city \xc3\xa9.exr";
    changeAll(skyParameters(), light.sky);
    changeAll(studioParameters(), light.studio);
    light.studio.lamps.resize(2);
    for (StudioLamp& lamp : light.studio.lamps) changeAll(studioLampParameters(), lamp);
    light.uniformRadiance = 0.7f;
    light.rotationDeg = -33.3f;
    light.exposureEv = 1.7f;
    light.backdrop = BackdropKind::Environment;
    light.backdropBlur = 0.3f;
}

inline void changeTimeline(TimelineSection& timeline) {
    timeline.clip = "/nowhere/motions/walk.bvh";
    timeline.clipOffsetS = -0.1;
    timeline.startS = 0.2;
    timeline.endS = 7.7;
    timeline.framesPerSecond = 23.976;
    timeline.timeS = 1.0 / 3.0;
    timeline.speed = 0.5;
    timeline.loop = false;
    timeline.autoKey = true;
    const glm::quat turned = quatFromAxisAngle({0.3f, -0.2f, 0.9f}), other = quatFromAxisAngle({0.1f, 0.0f, 0.0f});
    timeline.joints = {{3, JointLayer::OnClip, twoKeys(turned, other)},
                       {18, JointLayer::Absolute, twoKeys(other, turned)}};
    timeline.root = twoKeys(glm::vec3(0.1f, 0.2f, 0.3f), glm::vec3(0.4f));
    timeline.expression = twoKeys<std::vector<float>>({0.1f}, {0.3f, -0.7f});
    timeline.camera = twoKeys(SceneCamera{{1, 2, 3}, {4, 5, 6}, 7, 8}, SceneCamera{{1.1, 2.1, 3.1}, {}, 0.1, 40});
    timeline.lightRotationDeg = twoKeys(10.1f, 370.2f);
    timeline.lightExposureEv = twoKeys(-1.1f, 2.3f);
    for (std::size_t part = 0; part < kBodyPartCount; ++part) {
        timeline.radii[part] = twoKeys(0.1f + 0.01f * static_cast<float>(part), 0.3f);
    }
}

inline void changeView(ViewSection& view) {
    view.buffer = BufferId::Depth;
    view.layout = ViewLayout::Grid;
    view.strip = {BufferId::Opacity, BufferId::Bone};
    for (std::size_t i = 0; i < kBufferCount; ++i) {
        view.buffers[i].range = {0.1f, 0.3f + static_cast<float>(i)};
        view.buffers[i].colorMap = i % 2 == 0 ? ColorMap::Turbo : ColorMap::Gray;
    }
    changeAll(toneParameters(), view.tone);
    view.grid = !view.grid;
    view.skeleton = !view.skeleton;
    view.parts = !view.parts;
    view.radiusSpheres = !view.radiusSpheres;
    view.surfelDiscs = !view.surfelDiscs;
    view.legend = !view.legend;
    view.selectedJoint = 20;
    view.selectedPart = 4;
    view.compare = {
        CompareKind::Picture, BufferId::Normal, "/nowhere/truth.exr", "albedo", ErrorMeasure::Flip, 0.25f, nullptr};
}

/// A document in which every field differs from Document{}; exact binary fractions are avoided, so that a number that
/// is rounded on its way is found.
inline Document changedDocument() {
    Document document;
    document.avatar.source = "rest:/nowhere/bodies/me.npz";
    changeAll(restAvatarParameters(), document.avatar.rest);
    document.avatar.betas = {0.1f, -2.3f};
    Pose& pose = document.pose.pose;
    for (std::size_t joint = 0; joint < pose.rotations.size(); ++joint) {
        const float angle = 0.01f * static_cast<float>(joint + 1);
        pose.rotations[joint] = quatFromAxisAngle({angle, -0.3f, 2.0f * angle});
    }
    pose.translation = {0.1f, 0.7f, -1e-7f};
    pose.expression = {0.3f, 0.6f};
    document.pose.useLimits = false;
    document.pose.keepOrientation = false;
    changeTimeline(document.timeline);
    document.camera = {
        {{0.1, 1.7, 2.9}, {0.01, 0.02, 0.03}, -12.3, 45.6}, "/nowhere/calibration_full.json", "cam 7", 42};
    changeLight(document.light);
    changeOcclusion(document.occlusion);
    changeView(document.view);
    auto held = std::make_shared<HeldLook>();
    held->avatar = document.avatar;
    held->pose = document.pose;
    held->light = document.light;
    held->occlusion = document.occlusion;
    document.view.compare.held = std::move(held);
    return document;
}

} // namespace ars::test
