#pragma once

#include "engine/core/error.h"
#include "engine/core/progress.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/light/cube_map.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"

#include <nlohmann/json_fwd.hpp>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace ars {

/// What is evaluated: any avatar, a rest: one too.
struct EvaluatedAvatar {
    std::shared_ptr<AvatarEvaluator> evaluator;
    PartRadii radii = initialPartRadii();
    std::optional<CubeMap> light; ///< that PBR pictures are shaded with; none: radiance only
    SplatParams splat;
    OcclusionParams occlusion;
    bool occlude = true; ///< false: shaded without occlusion, as it was trained
    PoseSurfelsParams posing;
    std::string name;
};

/// ag: full picture over white, as Animatable Gaussians is evaluated; heldout: the same on held-out cameras; masked:
/// inside the mask (avatar reference 7).
enum class EvaluationProtocol { Ag, HeldOut, Masked };

struct EvaluationOptions {
    EvaluationProtocol protocol = EvaluationProtocol::Masked;
    std::string split; ///< of namedSplit; empty: the one that the protocol is about where the capture has it, else all
    std::string cameras, frames;
    std::filesystem::path outFolder; ///< report.json, report.txt, pictures/; empty: nothing is written
    int pictures = 8;                ///< how many views are written as pictures
    std::filesystem::path
        light; ///< the capture's true light, for relit figures; empty: lights/*.exr beside the capture
    std::filesystem::path lpipsBackbone, lpipsHeads; ///< weight files of readLpips; both or none
};

/// Renders every view of the split and compares: PSNR, SSIM, mask IoU of radiance and PBR pictures; with ground truth
/// in CAMERA/gt: normal angle (degrees), depth (mm), albedo (dB, after one scale per channel over all pictures),
/// roughness, AO, relit PSNR with and without the albedo scale; the photograph itself as albedo under the same
/// alignment. With the weight files LPIPS of full pictures. Per view and in the mean, with protocol, split, cameras and
/// frames named.
/// @return errors of the readers; InvalidArgument where one LPIPS file is given without the other
Result<nlohmann::ordered_json> evaluateAvatar(const EvaluatedAvatar& avatar, const std::filesystem::path& capture,
                                              const EvaluationOptions& options, const ProgressFunction& progress = {});
/// The table that a terminal shows.
std::string evaluationTable(const nlohmann::ordered_json& report);

/// Irradiance (16x16 cube, exact cosine filter) of two lights: Pearson correlation over texels and channels after one
/// scale.
double irradianceCorrelation(const CubeMap& a, const CubeMap& b);

} // namespace ars
