#pragma once

#include "engine/frame/avatar_evaluator.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/occlusion/baked_visibility.h"
#include "engine/occlusion/mesh_occlusion.h"
#include "engine/occlusion/rasterised_visibility.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace ars {

/// How ambient occlusion comes about: the paper's method, and those that its ablation compares with.
enum class OcclusionMethod {
    ScreenSpace, ///< the paper's, from depth, normal, radius, importance and bone direction
    MeshRays,    ///< rays against the posed mesh within the radius
    Rasterised,  ///< RAGA: visibility of the posed mesh from 512 directions
    Baked,       ///< GS-IR: spherical harmonics baked around the canonical body
    Off,         ///< O = 1
};
template <>
struct EnumWords<OcclusionMethod> {
    static constexpr std::array<std::string_view, 5> words{"screen_space", "mesh_rays", "rasterised", "baked", "off"};
};

struct OcclusionSettings {
    OcclusionMethod method = OcclusionMethod::ScreenSpace;
    OcclusionParams screenSpace; ///< preset `body`
    MeshOcclusionParams meshRays;
    RasterisedVisibilityParams rasterised;
    BakedVisibilityParams baked;

    bool operator==(const OcclusionSettings&) const = default;
};

/// What stage 6 looks at. Versions change when the thing behind them does.
struct OcclusionStageInputs {
    const AvatarEvaluator* avatar = nullptr;
    const Pose* pose = nullptr;
    std::uint64_t poseVersion = 0;
    const Surfels* canonical = nullptr;
    std::uint64_t canonicalVersion = 0;
    SurfelView live; ///< posed surfels on the pipeline's device
    const GBuffer* gbuffer = nullptr;
    std::uint64_t gbufferVersion = 0;
    Camera camera;
    SplatParams splat;
    OcclusionRefinement* refinement = nullptr; ///< of this G-buffer
    bool keepVisibility = false; ///< draft: rasterised visibility stays with the surfels that it was made for
};

/// Stage 6 of a frame, with what its methods keep between frames: trees, bakes, refinement.
class OcclusionStage {
public:
    /// Writes O of every pixel, in [0, 1], empty pixels 1, on the device of the G-buffer.
    ///
    /// ScreenSpace at quality `interactive` refines: calls with unchanged inputs add directions until complete().
    /// Rasterised visibility that was kept for another pose is not complete.
    /// Unsupported for the comparison methods on CUDA.
    Status run(const OcclusionSettings& settings, const OcclusionStageInputs& inputs, PixelBuffer& occlusion);

    /// False while an interactive picture still becomes finer.
    bool complete() const { return complete_; }
    /// Share of the directions that the picture holds, [0, 1].
    float share() const { return share_; }
    /// Time that the method spent on the mesh (tree, visibility, bake) in the last call, milliseconds; 0 where kept.
    double preparationMs() const { return preparationMs_; }
    /// Whether the method has its tree, visibility or bake, be it of another pose (then Rasterised needs
    /// keepVisibility to be quick).
    bool prepared(const OcclusionSettings& settings) const;

private:
    Status screenSpace(const OcclusionParams& params, const OcclusionStageInputs& inputs, PixelBuffer& occlusion);
    Status meshRays(const MeshOcclusionParams& params, const OcclusionStageInputs& inputs, PixelBuffer& occlusion);
    Status rasterised(const RasterisedVisibilityParams& params, const OcclusionStageInputs& inputs,
                      PixelBuffer& occlusion);
    Status baked(const BakedVisibilityParams& params, const OcclusionStageInputs& inputs, PixelBuffer& occlusion);
    Status splatValues(const std::vector<float>& values, const OcclusionStageInputs& inputs, PixelBuffer& occlusion);

    OcclusionWorkspace workspace_;
    SplatWorkspace splatWorkspace_;
    GBuffer splatted_;
    std::optional<MeshOcclusion> tree_;
    std::uint64_t treeVersion_ = 0;
    std::optional<RasterisedVisibility> visibility_;
    std::uint64_t visibilityVersion_ = 0;
    RasterisedVisibilityParams visibilityParams_; ///< that it was made with
    std::vector<float> visibilityValues_;         ///< of every surfel in that pose
    std::uint64_t visibilityCanonical_ = 0;
    std::optional<BakedVisibility> bake_;
    BakedVisibilityParams bakeParams_; ///< that it was made with
    std::vector<float> bakedValues_;
    std::uint64_t bakeVersion_ = 0;
    bool complete_ = true;
    float share_ = 1.0f;
    double preparationMs_ = 0.0;
};

} // namespace ars
