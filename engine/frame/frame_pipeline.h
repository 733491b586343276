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
};

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
    Status render(const FrameInputs& inputs, const std::vector<BufferId>& wanted);

    /// A buffer of the last frame, on the device; NotFound when it was not wanted.
    Result<ImageView<const float>> buffer(BufferId id) const;
    /// The same brought to host memory as a picture with its colour space. Occlusion is 0 where nothing is, as files
    /// have it.
    Result<Image> picture(BufferId id) const;

    bool occlusionComplete() const { return occlusion_.complete(); }
    float occlusionShare() const { return occlusion_.share(); }
    double occlusionPreparationMs() const { return occlusion_.preparationMs(); }
    const std::array<StageReport, kFrameStageCount>& stages() const { return reports_; }
    const SplatStats& splatStats() const { return splatStats_; }
    /// On CUDA stages are only queued and their times those of queueing; with this, each waits for its end. Off by
    /// default: a frame then never waits.
    void waitForTimings(bool wait) { waitForTimings_ = wait; }
    /// Counting costs a little and, on CUDA, waits for the device; off by default.
    void collectSplatStats(bool collect) { collectStats_ = collect; }

    const AvatarEvaluator& avatar() const { return *avatar_; }
    const Device& device() const { return device_; }
    const FrameInputs& inputs() const { return inputs_; }

private:
    FramePipeline(std::shared_ptr<AvatarEvaluator> avatar, const Device& device);

    Status evaluate(const FrameInputs& inputs);
    Status poseStage(const FrameInputs& inputs);
    Status poseOnHost(const FrameInputs& inputs, bool radiiOnly);
    Status poseOnDevice(const FrameInputs& inputs, bool newSurfels);
    Status splatStage(const FrameInputs& inputs, ChannelSet channels);
    Status occludeStage(const FrameInputs& inputs);
    Status shadeStage(const FrameInputs& inputs, const std::vector<BufferId>& wanted);
    SurfelView liveSurfels() const;
    template <typename Work>
    Status timed(FrameStage stage, Work&& work);

    std::shared_ptr<AvatarEvaluator> avatar_;
    Device device_;
    FrameInputs inputs_; ///< of the last frame
    std::shared_ptr<const PrefilteredLight> light_;

    // Version of each thing: a stage whose inputs' versions are those of its last run has nothing to do.
    std::uint64_t version_ = 0; ///< the last one given out
    std::uint64_t poseVersion_ = 0, radiiVersion_ = 0, cameraVersion_ = 0, lightVersion_ = 0;
    std::uint64_t canonicalVersion_ = 0, liveVersion_ = 0, gbufferVersion_ = 0, occlusionVersion_ = 0;
    std::uint64_t evaluatedPose_ = 0, evaluatedCamera_ = 0;
    std::uint64_t posedCanonical_ = 0, posedPose_ = 0, posedRadii_ = 0;
    std::uint64_t splattedLive_ = 0, splattedCamera_ = 0;
    std::uint64_t occludedGBuffer_ = 0;
    std::uint64_t shadedGBuffer_ = 0, shadedOcclusion_ = 0, shadedLight_ = 0;
    std::uint64_t occlusionSettingsVersion_ = 0, occludedSettings_ = 0;
    std::uint64_t shadingVersion_ = 0, shadedShading_ = 0;

    Surfels canonical_;
    PosedSurfels posed_;
    std::unique_ptr<DeviceSurfels> arrays_; ///< CUDA only
    SplatWorkspace splatWorkspace_;
    SplatStats splatStats_;
    bool collectStats_ = false;
    bool waitForTimings_ = false;
    GBuffer gbuffer_;
    OcclusionStage occlusion_;
    PixelBuffer occlusionPicture_, beauty_, diffuse_, specular_;
    bool shadedParts_ = false; ///< diffuse_ and specular_ belong to the last shading
    std::array<StageReport, kFrameStageCount> reports_;
};

} // namespace ars
