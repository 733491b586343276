#include "engine/scene/assets.h"

#include "engine/light/studio.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace ars {
namespace {

constexpr std::string_view kShapeMark = "\nshape";

/// Everything of an avatar but its shape.
std::string avatarBaseKey(const AvatarSection& avatar) {
    return avatar.source + "\n" + restAvatarParameters().toJson(avatar.rest).dump() + std::string(kShapeMark);
}

} // namespace

std::string avatarKey(const AvatarSection& avatar) {
    if (namesTrainedAvatar(avatar.source)) return avatar.source; // neither sampling nor shape are its own to choose
    std::string key = avatarBaseKey(avatar);
    std::size_t count = avatar.betas.size();
    while (count > 0 && avatar.betas[count - 1] == 0.0f) --count; // missing coefficients are 0
    for (std::size_t i = 0; i < count; ++i) key += fmt::format(" {}", avatar.betas[i] + 0.0f);
    return key;
}

bool sameButShape(const AvatarSection& avatar, const AvatarAsset& relative) {
    return !relative.coarse && relative.key.starts_with(avatarBaseKey(avatar));
}

std::string lightKey(const LightSection& light) {
    const std::string kind(EnumWords<LightKind>::words[static_cast<std::size_t>(light.kind)]);
    switch (light.kind) {
    case LightKind::File:
        return kind + " " + light.file;
    case LightKind::Sky:
        return kind + " " + skyParameters().toJson(light.sky).dump();
    case LightKind::Studio:
        return kind + " " + studioToJson(light.studio).dump();
    case LightKind::Uniform:
        break;
    }
    return fmt::format("{} {}", kind, light.uniformRadiance);
}

std::string clipKey(const TimelineSection& timeline) { return timeline.clip; }

std::string captureKey(const CameraSection& camera) { return camera.capture; }

std::string pictureKey(const Document& document) {
    const CompareSection& compare = document.view.compare;
    const CameraSection& camera = document.camera;
    if (compare.kind == CompareKind::Picture && !compare.file.empty()) return compare.file + "\n" + compare.layer;
    if (compare.kind == CompareKind::Photograph && !camera.capture.empty() && !camera.datasetCamera.empty()) {
        return fmt::format("{}\n{}\n{}", camera.capture, camera.datasetCamera, camera.photograph);
    }
    return {};
}

std::optional<Document> otherDocument(const Document& document) {
    const CompareSection& compare = document.view.compare;
    if (compare.kind == CompareKind::Avatar && !compare.file.empty()) {
        Document other = document;
        other.avatar.source = compare.file;
        other.avatar.betas.clear();
        return other;
    }
    if (compare.kind == CompareKind::Held && compare.held) {
        Document other = document;
        other.avatar = compare.held->avatar;
        other.pose = compare.held->pose;
        other.light = compare.held->light;
        other.occlusion = compare.held->occlusion;
        return other;
    }
    return std::nullopt;
}

Result<SceneAssets> loadAssets(const Document& document, const Device& device, LightQuality quality,
                               const ProgressFunction& progress) {
    SceneAssets assets;
    ARS_TRY(assets.avatar, loadAvatarAsset(document.avatar, progress));
    ARS_TRY(assets.light, loadLightAsset(document.light, device, quality, progress));
    if (!clipKey(document.timeline).empty()) {
        ARS_TRY(assets.clip, loadClipAsset(document.timeline.clip, assets.avatar->evaluator->rig().skeleton, progress,
                                           assets.avatar->soleHeightM));
    }
    if (!captureKey(document.camera).empty()) {
        ARS_TRY(assets.capture, loadCaptureAsset(document.camera.capture));
    }
    const CompareSection& compare = document.view.compare;
    if (!pictureKey(document).empty()) {
        ARS_TRY(assets.picture, compare.kind == CompareKind::Picture
                                    ? loadPictureAsset(compare.file, compare.layer)
                                    : loadPhotographAsset(document.camera, *assets.capture));
    }
    if (const std::optional<Document> other = otherDocument(document)) {
        assets.otherAvatar = assets.avatar;
        assets.otherLight = assets.light;
        if (avatarKey(other->avatar) != assets.avatar->key) {
            ARS_TRY(assets.otherAvatar, loadAvatarAsset(other->avatar, progress));
        }
        if (lightKey(other->light) != assets.light->key) {
            ARS_TRY(assets.otherLight, loadLightAsset(other->light, device, quality, progress));
        }
    }
    return assets;
}

} // namespace ars
