#include "model/training/training_parameters.h"

namespace ars {
namespace {

constexpr double kMostSteps = 1e8;
constexpr double kLargestRate = 1e38; // a rate that makes numbers overflow is the step's to report
constexpr double kLargestWeight = 1e6;

} // namespace

const ParameterTable<ScheduleParams>& scheduleParameters() {
    using S = ScheduleParams;
    using enum ParameterTier;
    static const ParameterTable<S> table{
        {"template_steps",
         &S::templateSteps,
         {0, kMostSteps},
         "",
         Basic,
         "Steps of stage 0, in which the networks learn to give the template."},
        {"radiance_steps",
         &S::radianceSteps,
         {0, kMostSteps},
         "",
         Basic,
         "Steps of stage 1, in which shape and a colour that includes the light are learned."},
        {"pbr_steps",
         &S::pbrSteps,
         {0, kMostSteps},
         "",
         Basic,
         "Steps of stage 2, in which materials, light and occlusion radii are learned."},
        {"network_rate", &S::networkRate, {0, kLargestRate}, "", Basic, "Adam's rate of the networks, stages 0 and 1."},
        {"network_rate_pbr", &S::networkRatePbr, {0, kLargestRate}, "", Basic, "Adam's rate of the networks, stage 2."},
        {"geometry_share",
         &S::geometryShare,
         {0, 10},
         "",
         Advanced,
         "Rate of the geometry networks over the networks' rate."},
        {"base_rate",
         &S::baseRate,
         {0, kLargestRate},
         "",
         Advanced,
         "Adam's rate of the surfels' own base values (decoding.learn_base)."},
        {"base_geometry_share",
         &S::baseGeometryShare,
         {0, 10},
         "",
         Expert,
         "Rate of the base's position, opacity, scale and rotation over base_rate."},
        {"light_rate", &S::lightRate, {0, kLargestRate}, "", Advanced, "Adam's rate of the learned light."},
        {"radius_rate",
         &S::radiusRate,
         {0, kLargestRate},
         "",
         Advanced,
         "Adam's rate of the nine radius offsets [delta_g]."},
        {"final_rate_share",
         &S::finalRateShare,
         {0, 1},
         "",
         Advanced,
         "Over each stage every rate falls to this share of itself, along a cosine."},
        {"warm_up_steps",
         &S::warmUpSteps,
         {0, kMostSteps},
         "",
         Advanced,
         "At the start of each stage rates rise from 0 over so many steps."},
        {"beta1", &S::beta1, {0, 0.9999}, "", Expert, "Adam's decay of the mean gradient."},
        {"beta2", &S::beta2, {0, 0.999999}, "", Expert, "Adam's decay of the mean squared gradient."},
        {"views_per_step",
         &S::viewsPerStep,
         {1, 64},
         "",
         Advanced,
         "Cameras of one pose in a step; they share one evaluation of the networks."},
        {"image_scale", &S::imageScale, {1, 8}, "", Basic, "Pictures are made so many times smaller."},
        {"band_pixels",
         &S::bandPixels,
         {0, 32},
         "px",
         Advanced,
         "Half-width of the band along the outline in which nothing is compared; pixels of soft alpha always belong to "
         "it."},
        {"crop_margin",
         &S::cropMargin,
         {-1, 4096},
         "px",
         Advanced,
         "Pictures are cropped to the person and this margin; -1 keeps them whole."},
        {"perceptual_crop_after",
         &S::perceptualCropAfter,
         {0, kMostSteps},
         "",
         Expert,
         "Steps after stage 0 from which on the perceptual loss looks at windows instead of the whole person."},
        {"perceptual_size",
         &S::perceptualSize,
         {0, 4096},
         "px",
         Expert,
         "Side of the square in which the perceptual loss sees the person; 0 compares the pictures as they are."},
        {"view_noise",
         &S::viewNoise,
         {0, 10},
         "",
         Expert,
         "Standard deviation of the noise added to view directions, which keeps colours from learning cameras."},
        {"seed",
         &S::seed,
         {0, 2147483647},
         "",
         Basic,
         "Start of all random numbers: networks, order of the data, backgrounds, crops."},
    };
    return table;
}

const ParameterTable<LossParams>& lossParameters() {
    using L = LossParams;
    using enum ParameterTier;
    static const ParameterTable<L> table{
        {"l1", &L::l1, {0, kLargestWeight}, "", Basic, "Weight of the mean absolute colour difference [L_1]."},
        {"perceptual", &L::perceptual, {0, kLargestWeight}, "", Basic, "Weight of the perceptual loss [L_lpips]."},
        {"perceptual_backbone",
         &L::perceptualBackbone,
         {},
         "",
         Advanced,
         "LPIPS backbone weights; without them the stand-in ms_ssim_gradient is used."},
        {"perceptual_heads",
         &L::perceptualHeads,
         {},
         "",
         Advanced,
         "LPIPS linear weights that belong to the backbone."},
        {"offset",
         &L::offset,
         {0, kLargestWeight},
         "",
         Advanced,
         "Weight of the surfels' distances from the template [L_reg]."},
        {"offset_squared", &L::offsetSquared, {}, "", Expert, "Squared distances as printed, or plain ones."},
        {"consistency",
         &L::consistency,
         {0, kLargestWeight},
         "",
         Advanced,
         "Weight of normals against depth at the start [L_cons]."},
        {"consistency_end",
         &L::consistencyEnd,
         {0, kLargestWeight},
         "",
         Advanced,
         "The same from half of the training on."},
        {"curvature", &L::curvature, {0, kLargestWeight}, "", Advanced, "Weight of bent normals [L_curv]."},
        {"normal_deformation",
         &L::normalDeformation,
         {0, kLargestWeight},
         "",
         Advanced,
         "Weight of neighbours' normals turning apart, stage 1 [L_nd]."},
        {"normal_pairs",
         &L::normalPairs,
         {0, 100000000},
         "",
         Expert,
         "Random pairs of neighbours that it looks at in a step."},
        {"brdf_variation",
         &L::brdfVariation,
         {0, kLargestWeight},
         "",
         Advanced,
         "Weight of the total variation of albedo and roughness, stage 2 [L_tv]."},
        {"light_variation",
         &L::lightVariation,
         {0, kLargestWeight},
         "",
         Advanced,
         "Weight of the total variation of the light, stage 2 [L_tv]."},
        {"white_light",
         &L::whiteLight,
         {0, kLargestWeight},
         "",
         Advanced,
         "Weight of the light's distance from grey, stage 2 [L_light]."},
        {"radiance_in_pbr",
         &L::radianceInPbr,
         {0, kLargestWeight},
         "",
         Expert,
         "Keeps the radiance loss in stage 2 at this weight (not in the paper)."},
        {"opacity_mask",
         &L::opacityMask,
         {0, kLargestWeight},
         "",
         Expert,
         "Weight of the difference of opacity and mask (not in the paper)."},
    };
    return table;
}

const ParameterTable<LightLearningParams>& lightLearningParameters() {
    using L = LightLearningParams;
    using enum ParameterTier;
    static const ParameterTable<L> table{
        {"cube_size", &L::cubeSize, {64, 2048}, "px", Advanced, "Side of a face of the learned light, a power of two."},
        {"initial", &L::initial, {0, 1000}, "", Advanced, "Grey radiance of the light at the start."},
        {"file", &L::file, {}, "", Basic, "A known environment instead of a learned light; it stays as it is."},
        {"learn", &L::learn, {}, "", Basic, "Learns the light in stage 2; off keeps it as it starts."},
    };
    return table;
}

const ParameterTable<FreezeParams>& freezeParameters() {
    using F = FreezeParams;
    using enum ParameterTier;
    static const ParameterTable<F> table{
        {"geometry", &F::geometry, {}, "", Advanced, "Shape, opacity and rotation stay as they are."},
        {"materials", &F::materials, {}, "", Advanced, "Albedo, roughness and colour stay as they are."},
        {"light", &F::light, {}, "", Advanced, "The light stays as it is."},
        {"radii", &F::radii, {}, "", Basic, "Occlusion radii: learned, fixed at their start, or no occlusion at all."},
    };
    return table;
}

const ParameterTable<RunParams>& runParameters() {
    using R = RunParams;
    using enum ParameterTier;
    static const ParameterTable<R> table{
        {"device",
         &R::device,
         {},
         "",
         Basic,
         "Where steps are computed: auto is a CUDA device where there is one, otherwise the processor."},
        {"checkpoint_steps", &R::checkpointSteps, {1, kMostSteps}, "", Basic, "A checkpoint every so many steps."},
        {"preview_steps", &R::previewSteps, {0, kMostSteps}, "", Basic, "A preview every so many steps; 0 for none."},
        {"checkpoints_kept", &R::checkpointsKept, {1, 1000}, "", Advanced, "So many of the newest checkpoints stay."},
        {"milestone_steps",
         &R::milestoneSteps,
         {0, kMostSteps},
         "",
         Advanced,
         "Checkpoints at multiples of this stay for ever; 0 for none."},
        {"metrics_steps", &R::metricsSteps, {1, kMostSteps}, "", Advanced, "A row of metrics every so many steps."},
        {"cache_megabytes",
         &R::cacheMegabytes,
         {16, 1048576},
         "MB",
         Advanced,
         "Memory for pictures that were read and cropped."},
        {"cache_folder", &R::cacheFolder, {}, "", Advanced, "Folder that keeps them between runs; empty for none."},
    };
    return table;
}

const ParameterTable<TrainingConfig>& trainingDataParameters() {
    using C = TrainingConfig;
    using enum ParameterTier;
    static const ParameterTable<C> table{
        {"cameras",
         &C::cameras,
         {},
         "",
         Basic,
         "Cameras to train with (names or ranges); empty for the subject's published ones, else all."},
        {"frames", &C::frames, {}, "", Basic, "Frames to train with; empty for the published ones, else all."},
    };
    return table;
}

} // namespace ars
