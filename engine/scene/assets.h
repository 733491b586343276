#pragma once

#include "engine/capture/calibration.h"
#include "engine/core/buffer.h"
#include "engine/core/progress.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/frame/framing.h"
#include "engine/frame/light_source.h"
#include "engine/rig/motion.h"
#include "engine/scene/document.h"
#include "engine/scene/trained_avatar.h"

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// What a document's files and generators contain. Each is immutable once made and shared between threads; the
/// evaluator alone is used by one thread at a time (its frame worker), its rig and mesh by all.

struct AvatarAsset {
    std::string key; ///< avatarKey of the section that it was made from
    std::shared_ptr<AvatarEvaluator> evaluator;
    std::vector<std::string> shapeNames;      ///< one per shape coefficient; empty where the body has none
    std::vector<std::string> expressionNames; ///< one per expression coefficient
    Bounds restBounds;                        ///< of the mesh in its rest pose
    float soleHeightM = 0.0f;                 ///< lowest y of the mesh in its rest pose
    bool coarse = false;                      ///< a forerunner with few surfels, shown until the avatar is there
    std::vector<std::string> notes;

    /// What a trained avatar brings besides its surfels.
    struct Trained {
        PartRadii radii = initialPartRadii(); ///< learned, metres
        // That it was trained with.
        SplatParams splat;
        bool occluded = true; ///< false: shaded without occlusion
        OcclusionParams occlusion;
        PoseSurfelsParams posing;
        bool hasLight = false; ///< trainedAvatarLight has one
        std::string preset;
        std::string origin; ///< in words
    };
    std::optional<Trained> trained; ///< nothing for rest: avatars
};

struct LightAsset {
    std::string key;
    std::shared_ptr<const LightSource> source;
    LightQuality quality = LightQuality::Exact; ///< Draft: a forerunner, smaller and less exact
};

struct ClipAsset {
    std::string key;
    std::shared_ptr<const Motion> motion;
    std::vector<std::string> notes;
};

/// Cameras of a capture and the photographs that lie beside the calibration (photographs.h), in the order of their
/// numbers; CameraSection::photograph is an index into them. A camera file without a name (a single camera) gets the
/// file's.
struct CaptureAsset {
    std::string key;
    std::vector<CalibratedCamera> cameras;
    std::vector<std::vector<std::filesystem::path>> photographs; ///< of each camera; may be empty
};

/// A picture to compare with: one layer as it was read.
struct PictureAsset {
    std::string key;
    Image image;
    std::vector<std::string> layers; ///< that the file has
};

struct SceneAssets {
    std::shared_ptr<const AvatarAsset> avatar;
    std::shared_ptr<const LightAsset> light;
    std::shared_ptr<const ClipAsset> clip;
    std::shared_ptr<const CaptureAsset> capture;
    std::shared_ptr<const PictureAsset> picture;    ///< of compare, kinds Picture and Photograph
    std::shared_ptr<const AvatarAsset> otherAvatar; ///< of compare, kinds Avatar and Held
    std::shared_ptr<const LightAsset> otherLight;   ///< of compare, kind Held
};

/// Keys that say which asset a document needs: equal keys, equal asset. Empty where the document needs none.
std::string avatarKey(const AvatarSection& avatar);
std::string lightKey(const LightSection& light); ///< without rotation, exposure, backdrop
std::string clipKey(const TimelineSection& timeline);
std::string captureKey(const CameraSection& camera);
std::string pictureKey(const Document& document); ///< of compare kinds Picture and Photograph

/// The other side of the comparison where it is rendered (kinds Avatar and Held): the document that it shows. Nothing
/// for the other kinds, and where there is no avatar named or nothing held.
std::optional<Document> otherDocument(const Document& document);

/// Where lights are filtered, and how large. Converts from a device alone.
struct LightTarget {
    LightTarget(const Device& where = {}, int side = kDefaultLightBase) : device(where), baseSize(side) {}
    Device device;
    int baseSize; ///< side of the cube, a power of two in [64, 4096]
};

/// Loads one thing, on the calling thread. Errors as the readers', with the path; Cancelled through progress.
/// Avatars are "rest:open", "rest:FILE" (a body, a skinned glb, a mesh) or the path of a trained one
/// (trained_avatar.h).
Result<std::shared_ptr<const AvatarAsset>> loadAvatarAsset(const AvatarSection& avatar,
                                                           const ProgressFunction& progress = {});
/// Drafts are smaller throughout: generated pictures of 256 pixels, a cube of at most 256.
Result<std::shared_ptr<const LightAsset>> loadLightAsset(const LightSection& light, const LightTarget& target,
                                                         LightQuality quality, const ProgressFunction& progress = {});
/// @param skeleton     of the avatar that will play it
/// @param soleHeightM  lowest point of that avatar at rest; unset: 3 cm below its feet's joints
Result<std::shared_ptr<const ClipAsset>> loadClipAsset(const std::string& path, const Skeleton& skeleton,
                                                       const ProgressFunction& progress = {},
                                                       std::optional<float> soleHeightM = {});
Result<std::shared_ptr<const CaptureAsset>> loadCaptureAsset(const std::string& path);
/// @param layer  of an EXR; empty: the layer without a name, else the first
Result<std::shared_ptr<const PictureAsset>> loadPictureAsset(const std::string& path, const std::string& layer);
/// The photograph that a document looks at: loadPictureAsset with the key of kind Photograph. NotFound where the camera
/// or the photograph is not there, with those that are.
Result<std::shared_ptr<const PictureAsset>> loadPhotographAsset(const CameraSection& camera,
                                                                const CaptureAsset& capture);

/// The same in two steps, for windows: `early` receives, on the calling thread, something to look at while the rest is
/// loaded (few surfels, a draft light). It is not called where the whole comes as quickly.
/// @param relative  an avatar of the same source and settings, whose shape alone may differ; null: none
Result<std::shared_ptr<const AvatarAsset>>
loadAvatarAsset(const AvatarSection& avatar, const std::shared_ptr<const AvatarAsset>& relative,
                const std::function<void(std::shared_ptr<const AvatarAsset>)>& early, const ProgressFunction& progress);
Result<std::shared_ptr<const LightAsset>>
loadLightAsset(const LightSection& light, const LightTarget& target,
               const std::function<void(std::shared_ptr<const LightAsset>)>& early, const ProgressFunction& progress);
/// Whether `relative` of the function above helps to make `avatar`.
bool sameButShape(const AvatarSection& avatar, const AvatarAsset& relative);

/// Everything that a document names, one after the other: for rendering without a window and for tests.
Result<SceneAssets> loadAssets(const Document& document, const Device& device,
                               LightQuality quality = LightQuality::Exact, const ProgressFunction& progress = {});

} // namespace ars
