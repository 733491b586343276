#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/image_file.h"
#include "engine/rig/motion_import.h"
#include "engine/scene/assets.h"
#include "engine/scene/photographs.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

constexpr int kCoarseSurfels = 6000;
constexpr int kDraftLightWidth = 256;
constexpr int kDraftLightBase = 256;
/// Wider pictures of light are not copied for a draft.
constexpr int kWidestDraftedLight = 8192;

/// A part of a longer piece of work.
ProgressFunction within(const ProgressFunction& progress, double begin, double end) {
    if (!progress) return {};
    return [progress, begin, end](double fraction, std::string_view what) {
        return progress(begin + (end - begin) * std::clamp(fraction, 0.0, 1.0), what);
    };
}

// ---- avatars

/// What stands behind "rest:", or the error for what is no avatar's name.
Result<std::string> restSourceName(const std::string& source) {
    constexpr std::string_view prefix = "rest:";
    if (source.starts_with(prefix) && source.size() > prefix.size()) return source.substr(prefix.size());
    return makeError(ErrorCode::InvalidArgument, source,
                     fmt::format("expected rest:open, rest:FILE (a body, a skinned glb, a mesh) or the absolute path "
                                 "of a trained avatar, found {}",
                                 source.empty() ? "nothing" : "something else"));
}

std::shared_ptr<const AvatarAsset> avatarAsset(std::string key, std::unique_ptr<RestAvatar> avatar, bool coarse) {
    auto asset = std::make_shared<AvatarAsset>();
    asset->key = std::move(key);
    asset->coarse = coarse;
    asset->shapeNames = avatar->shapeNames();
    asset->expressionNames = avatar->expressionNames();
    asset->restBounds = boundsOf(avatar->mesh().mesh.positions);
    asset->soleHeightM = asset->restBounds.low.y;
    asset->notes = avatar->notes();
    for (const std::string& note : avatar->mesh().notes) asset->notes.push_back(note);
    asset->evaluator = std::move(avatar);
    return asset;
}

/// A trained avatar: its networks are the loader's affair, its body's proportions are fixed.
Result<std::shared_ptr<const AvatarAsset>> trainedAsset(const AvatarSection& avatar, const ProgressFunction& progress) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the networks"));
    ARS_TRY(OpenedTrainedAvatar opened, openTrainedAvatar(avatar.source));
    ARS_TRY_STATUS(reportProgress(progress, 1.0, "reading the networks"));
    auto asset = std::make_shared<AvatarAsset>();
    asset->key = avatarKey(avatar);
    asset->restBounds = boundsOf(opened.evaluator->mesh().mesh.positions);
    asset->soleHeightM = asset->restBounds.low.y;
    asset->notes = opened.evaluator->mesh().notes;
    asset->trained = AvatarAsset::Trained{.radii = opened.radii,
                                          .splat = opened.splat,
                                          .occluded = opened.occluded,
                                          .occlusion = opened.occlusion,
                                          .posing = opened.posing,
                                          .hasLight = opened.light.has_value(),
                                          .preset = std::move(opened.preset),
                                          .origin = std::move(opened.origin)};
    asset->evaluator = std::move(opened.evaluator);
    return std::shared_ptr<const AvatarAsset>(std::move(asset));
}

bool worthAForerunner(const RestAvatarOptions& options) {
    return options.maxSurfels > 2 * kCoarseSurfels || options.sampling == RestSampling::Vertices;
}

RestAvatarOptions coarseOptions(RestAvatarOptions options) {
    options.sampling = RestSampling::Surface;
    options.spacingM = 0.0f;
    options.maxSurfels = std::min(options.maxSurfels, kCoarseSurfels);
    return options;
}

Result<std::shared_ptr<const AvatarAsset>> reshapedAvatar(const AvatarSection& avatar,
                                                          const std::shared_ptr<const AvatarAsset>& relative) {
    const auto* rest = dynamic_cast<const RestAvatar*>(relative->evaluator.get());
    if (!rest) return makeError(ErrorCode::Unsupported, avatar.source, "this avatar has no shape");
    ARS_TRY(std::unique_ptr<RestAvatar> reshaped, rest->withShape(avatar.betas));
    return avatarAsset(avatarKey(avatar), std::move(reshaped), false);
}

// ---- lights

Result<Environment> environmentOf(const LightSection& light, LightQuality quality) {
    const int most = quality == LightQuality::Draft ? kDraftLightWidth : kMaxEnvironmentWidth;
    switch (light.kind) {
    case LightKind::File:
        return looksLikeTrainedAvatar(light.file) ? trainedAvatarLight(light.file) : readEnvironment(light.file);
    case LightKind::Sky: {
        SkyParams params = light.sky;
        params.width = std::min(params.width, most);
        ARS_TRY(Sky sky, generateSky(params));
        return std::move(sky.environment);
    }
    case LightKind::Studio: {
        StudioParams params = light.studio;
        params.width = std::min(params.width, most);
        return generateStudio(params);
    }
    case LightKind::Uniform:
        break;
    }
    return uniformEnvironment(light.uniformRadiance);
}

Result<std::shared_ptr<const LightAsset>> filteredLight(const LightSection& light, Environment environment,
                                                        const LightTarget& target, LightQuality quality,
                                                        const ProgressFunction& progress) {
    const bool draft = quality == LightQuality::Draft;
    const std::string name = light.kind == LightKind::File
                                 ? light.file
                                 : std::string(EnumWords<LightKind>::words[static_cast<std::size_t>(light.kind)]);
    ARS_TRY(LightSource source,
            filterLight(name, std::move(environment), target.device, quality,
                        draft ? std::min(kDraftLightBase, target.baseSize) : target.baseSize, progress));
    auto asset = std::make_shared<LightAsset>();
    asset->key = lightKey(light);
    asset->quality = quality;
    asset->source = std::make_shared<const LightSource>(std::move(source));
    return std::shared_ptr<const LightAsset>(std::move(asset));
}

std::string_view doing(const LightSection& light) {
    return light.kind == LightKind::File ? "reading the light" : "making the light";
}

// ---- clips

std::vector<std::string> clipNotes(const RetargetReport& report) {
    std::vector<std::string> notes;
    if (report.skippedFrames > 0) {
        notes.push_back(fmt::format("the motion begins with {} frames of rest pose, left out", report.skippedFrames));
    }
    if (report.firstFrameIsRest) {
        notes.push_back("its zero pose is no standing person, so its first frame gave the rest pose");
    }
    return notes;
}

} // namespace

Result<std::shared_ptr<const AvatarAsset>> loadAvatarAsset(const AvatarSection& avatar,
                                                           const ProgressFunction& progress) {
    return loadAvatarAsset(avatar, nullptr, nullptr, progress);
}

Result<std::shared_ptr<const AvatarAsset>>
loadAvatarAsset(const AvatarSection& avatar, const std::shared_ptr<const AvatarAsset>& relative,
                const std::function<void(std::shared_ptr<const AvatarAsset>)>& early,
                const ProgressFunction& progress) {
    if (relative && !relative->shapeNames.empty() && sameButShape(avatar, *relative)) {
        return reshapedAvatar(avatar, relative);
    }
    if (namesTrainedAvatar(avatar.source)) return trainedAsset(avatar, progress);
    ARS_TRY(const std::string name, restSourceName(avatar.source));
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the body"));
    ARS_TRY(RestInput source, readRestInput(name, within(progress, 0.0, 0.5)));
    if (early && worthAForerunner(avatar.rest)) {
        auto coarse = makeRestAvatar(source, avatar.betas, coarseOptions(avatar.rest), within(progress, 0.5, 0.6));
        if (!coarse) return atPlace(std::move(coarse).error(), name);
        early(avatarAsset(avatarKey(avatar), std::move(coarse).value(), true));
    }
    auto whole = makeRestAvatar(std::move(source), avatar.betas, avatar.rest, within(progress, 0.6, 1.0));
    if (!whole) return atPlace(std::move(whole).error(), name);
    return avatarAsset(avatarKey(avatar), std::move(whole).value(), false);
}

Result<std::shared_ptr<const LightAsset>> loadLightAsset(const LightSection& light, const LightTarget& target,
                                                         LightQuality quality, const ProgressFunction& progress) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, doing(light)));
    ARS_TRY(Environment environment, environmentOf(light, quality));
    return filteredLight(light, std::move(environment), target, quality, progress);
}

Result<std::shared_ptr<const LightAsset>>
loadLightAsset(const LightSection& light, const LightTarget& target,
               const std::function<void(std::shared_ptr<const LightAsset>)>& early, const ProgressFunction& progress) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, doing(light)));
    const bool file = light.kind == LightKind::File;
    if (early && !file) {
        ARS_TRY(std::shared_ptr<const LightAsset> draft,
                loadLightAsset(light, target, LightQuality::Draft, within(progress, 0.0, 0.3)));
        early(std::move(draft));
    }
    ARS_TRY(Environment environment, environmentOf(light, LightQuality::Exact));
    if (early && file && environment.picture.width <= kWidestDraftedLight) {
        ARS_TRY(std::shared_ptr<const LightAsset> draft,
                filteredLight(light, environment, target, LightQuality::Draft, within(progress, 0.1, 0.3)));
        early(std::move(draft));
    }
    return filteredLight(light, std::move(environment), target, LightQuality::Exact, within(progress, 0.3, 1.0));
}

Result<std::shared_ptr<const ClipAsset>> loadClipAsset(const std::string& path, const Skeleton& skeleton,
                                                       const ProgressFunction& progress,
                                                       std::optional<float> soleHeightM) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "reading the motion"));
    MotionImportOptions options;
    options.soleHeightM = soleHeightM;
    RetargetReport report;
    ARS_TRY(Motion motion, importMotion(path, skeleton, options, &report));
    if (motion.frames.empty()) return makeError(ErrorCode::BadFile, path, "the motion has no frame");
    ARS_TRY_STATUS(reportProgress(progress, 1.0, "reading the motion"));
    auto asset = std::make_shared<ClipAsset>();
    asset->key = path;
    asset->notes = clipNotes(report);
    asset->motion = std::make_shared<const Motion>(std::move(motion));
    return std::shared_ptr<const ClipAsset>(std::move(asset));
}

Result<std::shared_ptr<const CaptureAsset>> loadCaptureAsset(const std::string& path) {
    auto asset = std::make_shared<CaptureAsset>();
    asset->key = path;
    auto cameras = readCalibration(path);
    if (cameras) {
        asset->cameras = std::move(cameras).value();
    } else if (const auto single = readCameraJson(path)) {
        asset->cameras.push_back({fs::path(path).stem().string(), *single, {}});
    } else {
        return std::move(cameras).error();
    }
    for (const CalibratedCamera& camera : asset->cameras) {
        asset->photographs.push_back(photographsOf(fs::path(path).parent_path(), camera.name));
    }
    return std::shared_ptr<const CaptureAsset>(std::move(asset));
}

Result<std::shared_ptr<const PictureAsset>> loadPictureAsset(const std::string& path, const std::string& layer) {
    auto asset = std::make_shared<PictureAsset>();
    asset->key = path + "\n" + layer;
    ARS_TRY(const std::vector<std::byte> head, readFileHead(path, 16));
    if (recogniseImage(head) == ImageFormat::Exr) {
        ARS_TRY(const ExrImage exr, readExr(path));
        asset->layers = exrLayers(exr);
        const bool unnamed = std::find(asset->layers.begin(), asset->layers.end(), "") != asset->layers.end();
        const std::string chosen = layer.empty() && !unnamed && !asset->layers.empty() ? asset->layers.front() : layer;
        auto image = exrLayer(exr, chosen);
        if (!image) return atPlace(std::move(image).error(), path);
        asset->image = std::move(image).value();
        if (chosen == "radiance") asset->image.space = ColorSpace::Srgb; // docs/conventions.md, EXR channels
        return std::shared_ptr<const PictureAsset>(std::move(asset));
    }
    if (!layer.empty()) {
        return makeError(ErrorCode::NotFound, path, fmt::format("there is no layer \"{}\": it is no EXR", layer));
    }
    ARS_TRY(asset->image, readImageFile(path));
    return std::shared_ptr<const PictureAsset>(std::move(asset));
}

Result<std::shared_ptr<const PictureAsset>> loadPhotographAsset(const CameraSection& camera,
                                                                const CaptureAsset& capture) {
    ARS_TRY(const fs::path file, findPhotograph(capture, camera.datasetCamera, camera.photograph));
    auto asset = std::make_shared<PictureAsset>();
    Document key; // of which only the camera counts
    key.camera = camera;
    key.view.compare.kind = CompareKind::Photograph;
    asset->key = pictureKey(key);
    ARS_TRY(asset->image, readImageFile(file));
    return std::shared_ptr<const PictureAsset>(std::move(asset));
}

} // namespace ars
