#pragma once

#include "engine/frame/buffer_catalogue.h"
#include "engine/frame/color_map.h"
#include "engine/frame/occlusion_stage.h"
#include "engine/frame/rest_avatar.h"
#include "engine/light/environment.h"
#include "engine/light/sky.h"
#include "engine/light/studio.h"
#include "engine/rig/body_parts.h"
#include "engine/rig/pose.h"
#include "engine/shade/shading.h"
#include "engine/shade/tone.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"

#include <glm/glm.hpp>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars {

/// What a person edits and a project file holds: plain values without any loaded thing. Files are named, never held;
/// SceneAssets (assets.h) has what they contain. Every edit is a command (command.h); sections are the grain of undo.

/// Whose body, and how its surfels are made.
struct AvatarSection {
    /// "rest:open", "rest:FILE", or a trained avatar: NAME.avatar, a run (its newest checkpoint), a checkpoint.
    /// Absolute.
    std::string source = "rest:open";
    RestAvatarOptions rest;   ///< of rest: avatars
    std::vector<float> betas; ///< shape coefficients of bodies that have them; missing ones are 0

    bool operator==(const AvatarSection&) const = default;
};

/// The pose that holds wherever neither clip nor keys say otherwise.
struct PoseSection {
    Pose pose = restPose(55);
    bool useLimits = true;       ///< drags respect the joints' range of motion
    bool keepOrientation = true; ///< a dragged hand or foot keeps its orientation in the world

    bool operator==(const PoseSection&) const;
};

enum class KeyInterpolation {
    Step,   ///< holds until the next key
    Linear, ///< straight (rotations: slerp)
    Smooth, ///< Hermite with Catmull-Rom tangents, flat where the value turns back (no overshoot); rotations:
            ///< squad-like
};
template <>
struct EnumWords<KeyInterpolation> {
    static constexpr std::array<std::string_view, 3> words{"step", "linear", "smooth"};
};

/// A value at a time. Tracks are sorted by time, no two keys within kKeyTimeTolerance.
template <typename Value>
struct Key {
    double timeS = 0.0;
    Value value{};
    KeyInterpolation interpolation = KeyInterpolation::Smooth; ///< up to the next key

    bool operator==(const Key&) const = default;
};
template <typename Value>
using Track = std::vector<Key<Value>>;
inline constexpr double kKeyTimeTolerance = 1e-4; ///< seconds

/// Absolute keys replace the joint's rotation; those on a clip are turned onto it: R = R_clip R_key, so that a clip can
/// be corrected for a moment (the identity leaves it as it is).
enum class JointLayer { Absolute, OnClip };
template <>
struct EnumWords<JointLayer> {
    static constexpr std::array<std::string_view, 2> words{"absolute", "on_clip"};
};

struct JointTrack {
    int joint = 0;
    JointLayer layer = JointLayer::Absolute;
    Track<glm::quat> keys;

    bool operator==(const JointTrack&) const = default;
};

/// A camera as a person moves it: it looks from the eye at the target.
struct SceneCamera {
    glm::dvec3 eye{0.0, 1.0, 3.6};
    glm::dvec3 target{0.0, 0.95, 0.0}; ///< also what orbiting turns about
    double rollDeg = 0.0;              ///< about the line of sight, positive turns the picture clockwise
    double verticalFieldDeg = 32.0;

    bool operator==(const SceneCamera&) const = default;
};

/// Motion over time. The current time is part of the document: reopening shows the same picture.
struct TimelineSection {
    std::string clip;         ///< motion file, absolute path; empty: none
    double clipOffsetS = 0.0; ///< when the clip begins
    double startS = 0.0;      ///< range that plays
    double endS = 4.0;
    double framesPerSecond = 30.0; ///< grid of keys and films
    double timeS = 0.0;
    double speed = 1.0;
    bool loop = true;
    bool autoKey = false;           ///< edits become keys at the current time
    std::vector<JointTrack> joints; ///< sorted by joint
    Track<glm::vec3> root;          ///< Pose::translation; with a clip an offset added to the clip's
    Track<std::vector<float>> expression;
    Track<SceneCamera> camera;
    Track<float> lightRotationDeg;
    Track<float> lightExposureEv;
    std::array<Track<float>, kBodyPartCount> radii;

    bool operator==(const TimelineSection&) const = default;
};

struct CameraSection {
    SceneCamera camera;
    std::string capture;       ///< calibration_full.json, absolute path; empty: none
    std::string datasetCamera; ///< name of the capture's camera that is looked through; empty: the free camera
    int photograph = 0;        ///< frame number of the photograph beside it

    bool operator==(const CameraSection&) const = default;
};

enum class LightKind { File, Sky, Studio, Uniform };
template <>
struct EnumWords<LightKind> {
    static constexpr std::array<std::string_view, 4> words{"file", "sky", "studio", "uniform"};
};
enum class BackdropKind { Color, Checkerboard, Environment };
template <>
struct EnumWords<BackdropKind> {
    static constexpr std::array<std::string_view, 3> words{"color", "checkerboard", "environment"};
};

struct LightSection {
    LightKind kind = LightKind::Studio;
    /// Of kind File, absolute path: a picture, a folder of six faces, or a trained avatar, whose learned light it then
    /// is; kept while a generator is used.
    std::string file;
    SkyParams sky;
    StudioParams studio = studioPreset(StudioPreset::ThreePoint);
    float uniformRadiance = 0.5f;
    float rotationDeg = 0.0f; ///< about +y, positive takes +z towards +x; [-360, 360]
    float exposureEv = 0.0f;  ///< the light's strength is 2^EV
    BackdropKind backdrop = BackdropKind::Color;
    float backdropBlur = 0.0f; ///< [0, 1]

    bool operator==(const LightSection&) const = default;
};

/// The paper's learned radii, as a person tunes them.
struct OcclusionSection {
    PartRadii radii = initialPartRadii();   ///< r_g, metres
    PartRadii initial = initialPartRadii(); ///< what reset returns to: r_init, or the learned ones of a trained avatar
    std::array<bool, kBodyPartCount> locked{};
    OcclusionSettings settings;
    PoseSurfelsParams posing;
    SplatParams splat{.depth = DepthMode::Filtered};
    ShadingParams shading;

    bool operator==(const OcclusionSection&) const = default;
};

/// How one buffer is shown where it differs from the catalogue.
struct BufferDisplay {
    std::optional<std::pair<float, float>> range;
    std::optional<ColorMap> colorMap;

    bool operator==(const BufferDisplay&) const = default;
};

enum class ViewLayout {
    Single,     ///< one buffer
    SideBySide, ///< it and the other side of the comparison, left and right
    Split,      ///< both in one picture, divided by a line that is dragged
    Blink,      ///< both in turn
    Difference, ///< the error map between both
    Strip,      ///< one large and a strip of thumbnails of every buffer
    Grid,       ///< the buffers of `strip` in equal tiles
};
template <>
struct EnumWords<ViewLayout> {
    static constexpr std::array<std::string_view, 7> words{"single",     "side_by_side", "split", "blink",
                                                           "difference", "strip",        "grid"};
};

enum class CompareKind {
    Buffer,     ///< another buffer of the same frame
    Held,       ///< the same buffer under the held look (settings, light, pose, avatar at the time of compare.hold)
    Avatar,     ///< the same buffer of another avatar
    Picture,    ///< a picture file, or a layer of an EXR
    Photograph, ///< the photograph of the capture's camera
};
template <>
struct EnumWords<CompareKind> {
    static constexpr std::array<std::string_view, 5> words{"buffer", "held", "avatar", "picture", "photograph"};
};
enum class ErrorMeasure { Absolute, Squared, Flip };
template <>
struct EnumWords<ErrorMeasure> {
    static constexpr std::array<std::string_view, 3> words{"absolute", "squared", "flip"};
};

/// What compare.hold keeps.
struct HeldLook {
    AvatarSection avatar;
    PoseSection pose;
    LightSection light;
    OcclusionSection occlusion;

    bool operator==(const HeldLook&) const = default;
};

struct CompareSection {
    CompareKind kind = CompareKind::Buffer;
    BufferId buffer = BufferId::Albedo; ///< of kind Buffer
    std::string file;                   ///< of kinds Picture and Avatar, absolute path
    std::string layer;                  ///< of an EXR: name of the layer; empty: its main picture
    ErrorMeasure measure = ErrorMeasure::Absolute;
    float splitPosition = 0.5f;           ///< [0, 1]
    std::shared_ptr<const HeldLook> held; ///< null: nothing held

    bool operator==(const CompareSection&) const; ///< compares what `held` holds
};

/// What is shown on the screen of the scene. Panels and windows are settings, not document.
struct ViewSection {
    BufferId buffer = BufferId::Beauty;
    ViewLayout layout = ViewLayout::Single;
    std::vector<BufferId> strip{BufferId::Beauty, BufferId::Albedo,    BufferId::Roughness,
                                BufferId::Normal, BufferId::Depth,     BufferId::AmbientOcclusion,
                                BufferId::Radius, BufferId::Importance};
    std::array<BufferDisplay, kBufferCount> buffers;
    ToneParams tone{
        .curve = ToneCurve::Agx, .backgroundRed = 0.015f, .backgroundGreen = 0.015f, .backgroundBlue = 0.017f};
    CompareSection compare;
    bool grid = true;
    bool skeleton = false;
    bool parts = false;         ///< the nine parts painted over the body
    bool radiusSpheres = false; ///< a sphere of radius r_g at the joints of every part
    bool surfelDiscs = false;   ///< surfels as opaque discs instead of the splatted picture
    bool legend = true;         ///< range and colour map of a data buffer
    int selectedJoint = -1;     ///< -1: none
    int selectedPart = -1;      ///< index of BodyPart, -1: none

    bool operator==(const ViewSection&) const = default;
};

struct Document {
    AvatarSection avatar;
    PoseSection pose;
    TimelineSection timeline;
    CameraSection camera;
    LightSection light;
    OcclusionSection occlusion;
    ViewSection view;

    bool operator==(const Document&) const = default;
};

/// What a new project starts with: the open body, relaxed and on its soles, three lamps, camera in front of it.
Document newDocument();

} // namespace ars
