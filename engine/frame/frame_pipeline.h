#pragma once

#include "engine/core/camera.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/frame/buffer_catalogue.h"
#include "engine/frame/device_surfels.h"
#include "engine/frame/occlusion_stage.h"
#include "engine/light/prefilter.h"
#include "engine/shade/shading.h"
#include "engine/surfel/gbuffer.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

namespace ars {

/// Everything that a picture depends on but the avatar and the light's pixels. Plain values: the pipeline finds out by
/// itself what differs from the last frame.
struct FrameInputs {
    Pose pose;
    Camera camera;
    PartRadii radii = initialPartRadii();
    EnvironmentPlacement placement;
    SplatParams splat{.depth = DepthMode::Filtered}; ///< outlines stay put; Linear is the published form
    PoseSurfelsParams posing;
    OcclusionSettings occlusion;
    ShadingParams shading;
    /// Draft: the canonical surfels of the last evaluation are posed by skinning alone although pose or view changed.
    bool keepCanonical = false;
    /// Draft: rasterised visibility stays with the surfels that it was made for although the pose changed.
    bool keepVisibility = false;
    /// False: an interactive occlusion picture that stands is taken as it is instead of being refined further.
    bool refineOcclusion = true;
};
/// Whether both give the same picture.
bool sameInputs(const FrameInputs& a, const FrameInputs& b);

/// The stages of design section 1 that the pipeline runs itself, in their order.
enum class FrameStage { Evaluate, Pose, Splat, Occlude, Shade };
inline constexpr int kFrameStageCount = 5;
std::string_view frameStageName(FrameStage stage);

/// What a stage did for the last frame.
struct StageReport {
    FrameStage stage = FrameStage::Evaluate;
    bool ran = false;        ///< false: its last result still held
    double milliseconds = 0; ///< wall time of the last run (CUDA: see waitForTimings)
    std::uint64_t runs = 0;  ///< since the pipeline was made
};

/// Where a frame goes. Both keep their pictures and what they were made from, so that drafts of another size cost the
/// main picture nothing; surfels are shared.
enum class FrameTarget { Main, Draft };
inline constexpr int kFrameTargetCount = 2;

/// One flag for each stage.
using StageFlags = std::array<bool, kFrameStageCount>;

/// Stages 3 to 7 with memory of what changed: a new light shades again, a new radius poses radii, splats, occludes and
/// shades, a new camera splats and what follows, a new pose runs everything (design section 1). One thread at a time.
class FramePipeline {
public:
    /// @param device  where surfels, G-buffer and pictures live; Unavailable where it is not here
    static Result<std::unique_ptr<FramePipeline>> create(std::shared_ptr<AvatarEvaluator> avatar,
                                                         const Device& device = {});
    ~FramePipeline();
    FramePipeline(const FramePipeline&) = delete;
    FramePipeline& operator=(const FramePipeline&) = delete;

    /// The light of the next frames, filtered on the pipeline's device; null: frames have no shaded buffers.
    void setLight(std::shared_ptr<const PrefilteredLight> light);

    /// Brings the wanted buffers up to date. With interactive occlusion, further calls with the same inputs refine it.
    /// InvalidArgument naming what does not fit (camera, pose, a buffer without its light or channel).
    Status render(const FrameInputs& inputs, const std::vector<BufferId>& wanted,
                  FrameTarget target = FrameTarget::Main);
    /// The stages that `render` would run.
    StageFlags pending(const FrameInputs& inputs, const std::vector<BufferId>& wanted,
                       FrameTarget target = FrameTarget::Main) const;

    // What follows speaks of the last frame and its target.

    /// A buffer on the device; NotFound when it was not wanted.
    Result<ImageView<const float>> buffer(BufferId id) const;
    /// The same brought to host memory as a picture with its colour space. Occlusion is 0 where nothing is, as files
    /// have it.
    Result<Image> picture(BufferId id) const;
    /// The same into an image whose memory is used again.
    Status copyPicture(BufferId id, Image& image) const;
    /// Another number whenever the buffer's contents changed; 0 when it was not wanted. Never the same for two targets.
    std::uint64_t pictureVersion(BufferId id) const;

    /// The posed surfels, on the device; valid until the next frame.
    SurfelView liveSurfels() const;
    /// Another number whenever a posed surfel changed.
    std::uint64_t surfelVersion() const { return liveVersion_; }
    /// Copies of them in host memory.
    Result<Surfels> surfels() const;
    Result<std::vector<glm::vec3>> surfelMeans() const;
    /// World matrix of every joint (J).
    std::vector<glm::mat4> jointWorld() const;
    /// The canonical surfels are those of the frame's pose and, where its buffers show radiance, of its view; false in
    /// drafts that kept older ones.
    bool canonicalFresh() const;
    /// The last evaluation was for another view alone: it says nothing about what another pose costs.
    bool evaluatedViewAlone() const { return evaluatedViewAlone_; }

    bool occlusionComplete() const { return target().occlusionComplete; }
    float occlusionShare() const { return target().occlusionShare; }
    /// How much a refining call takes: OcclusionRefinement::setSlices.
    void setRefinementSlices(int bands, int directions) {
        for (Target& t : targets_) t.refinement.setSlices(bands, directions);
    }
    double occlusionPreparationMs() const { return occlusion_.preparationMs(); }
    /// Whether the method has what it needs of the mesh, be it of an older pose; the others first spend a second on it.
    bool occlusionPrepared(const OcclusionSettings& settings) const { return occlusion_.prepared(settings); }
    const std::array<StageReport, kFrameStageCount>& stages() const { return reports_; }
    const SplatStats& splatStats() const { return splatStats_; }
    /// On CUDA stages are only queued, their times those of queueing, and a frame may lack its farthest surfels
    /// (SplatWorkspace::incomplete); with this, each stage waits for its end and frames are whole. Off by default.
    void waitForTimings(bool wait) { waitForTimings_ = wait; }
    /// Counting costs a little and, on CUDA, waits for the device; off by default.
    void collectSplatStats(bool collect) { collectStats_ = collect; }

    const AvatarEvaluator& avatar() const { return *avatar_; }
    const Device& device() const { return device_; }
    const FrameInputs& inputs() const { return target().inputs; }

private:
    /// Pictures of one size. A stage whose inputs' versions are those of its last run has nothing to do.
    struct Target {
        FrameInputs inputs; ///< of the last frame
        std::uint64_t cameraVersion = 0, occlusionSettingsVersion = 0, shadingVersion = 0;
        std::uint64_t gbufferVersion = 0, occlusionVersion = 0, shadedVersion = 0;
        std::uint64_t splattedLive = 0, splattedCamera = 0;
        std::uint64_t occludedGBuffer = 0, occludedSettings = 0;
        std::uint64_t shadedGBuffer = 0, shadedOcclusion = 0, shadedLight = 0, shadedShading = 0;
        SplatWorkspace splatWorkspace;
        GBuffer gbuffer;
        OcclusionRefinement refinement;
        bool occlusionComplete = true;
        float occlusionShare = 1.0f;
        PixelBuffer occlusion, beauty, diffuse, specular;
        bool shadedParts = false; ///< diffuse and specular belong to the last shading
        bool radiance = false;    ///< was among the wanted buffers of the last frame
    };
    /// What differs from the frame before.
    struct Changes {
        bool pose = false, radii = false, camera = false, occlusion = false, shading = false;
    };

    FramePipeline(std::shared_ptr<AvatarEvaluator> avatar, const Device& device);

    Target& target() { return targets_[static_cast<std::size_t>(current_)]; }
    const Target& target() const { return targets_[static_cast<std::size_t>(current_)]; }
    Changes changes(const FrameInputs& inputs, const Target& target) const;
    void adopt(const FrameInputs& inputs, const Changes& changes);
    Status evaluate(const FrameInputs& inputs, bool radiance);
    bool colorsFit(const Camera& camera) const;
    Status poseStage(const FrameInputs& inputs);
    Status poseOnHost(const FrameInputs& inputs, bool radiiOnly);
    Status poseOnDevice(const FrameInputs& inputs, bool newSurfels);
    Status splatStage(const FrameInputs& inputs, ChannelSet channels);
    Status occludeStage(const FrameInputs& inputs);
    Status shadeStage(const FrameInputs& inputs, bool parts);
    const PixelBuffer* pixels(BufferId id) const; ///< null when it was not wanted
    template <typename Work>
    Status timed(FrameStage stage, Work&& work);

    std::shared_ptr<AvatarEvaluator> avatar_;
    Device device_;
    std::shared_ptr<const PrefilteredLight> light_;

    std::uint64_t version_ = 0; ///< the last one given out
    std::uint64_t poseVersion_ = 0, radiiVersion_ = 0, lightVersion_ = 0;
    std::uint64_t canonicalVersion_ = 0, liveVersion_ = 0;
    std::uint64_t posedCanonical_ = 0, posedPose_ = 0, posedRadii_ = 0;

    Pose evaluatedPose_;                  ///< that canonical_ belongs to
    std::optional<Camera> evaluatedView_; ///< that its colours belong to; none: nobody wanted to see them
    bool evaluatedViewAlone_ = false;
    Pose pose_; ///< of the last frame, as the next two
    PoseSurfelsParams posing_;
    PartRadii radii_{};
    Surfels canonical_;
    PosedSurfels posed_;
    std::unique_ptr<DeviceSurfels> arrays_; ///< CUDA only
    OcclusionStage occlusion_;
    std::array<Target, kFrameTargetCount> targets_;
    FrameTarget current_ = FrameTarget::Main;
    SplatStats splatStats_;
    bool collectStats_ = false;
    bool waitForTimings_ = false;
    std::array<StageReport, kFrameStageCount> reports_;
};

} // namespace ars
