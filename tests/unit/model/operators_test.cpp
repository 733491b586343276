// The operators of engine/ as functions of autograd, each by itself: against the engine's own backward, number for
// number, and against central differences of the float operator where that is smooth or linear. The maths itself is
// held to 1e-6 in double by the tests of engine/.
#include "engine/shade/shading_gradient.h"
#include "engine/shade/tone_gradient.h"
#include "engine/surfel/splat_gradient.h"
#include "tests/unit/model/operators_support.h"

#include <algorithm>
#include <array>

namespace ars {
namespace {

using test::expectDifferences;
using test::leaf;
using test::randomNumbers;

constexpr std::array kSplatted{Channel::Opacity,  Channel::Depth,  Channel::Normal,    Channel::Position,
                               Channel::Radiance, Channel::Albedo, Channel::Roughness, Channel::Radius};

/// @param attached  leaves the radius out, whose gradient does not reach geometry
double splatLoss(const SplatParams& params, const test::SmoothSurfels& scene, bool attached) {
    SplatScratchPool pool;
    const at::NoGradGuard guard;
    const GBufferTensors pictures = splatTensors(params, scene.surfels, scene.camera, test::kTrainingChannels, pool);
    double sum = 0.0;
    for (const Channel channel : kSplatted) {
        if (attached && channel == Channel::Radius) continue;
        sum += test::weighted(pictures[channel], static_cast<std::uint64_t>(channel));
    }
    return sum;
}

void splatBackwardPass(const SplatParams& params, const test::SmoothSurfels& scene) {
    SplatScratchPool pool;
    const GBufferTensors pictures = splatTensors(params, scene.surfels, scene.camera, test::kTrainingChannels, pool);
    at::Tensor sum = at::zeros({});
    for (const Channel channel : kSplatted) {
        sum = sum + test::weightedTensor(pictures[channel], static_cast<std::uint64_t>(channel));
    }
    sum.backward();
}

class SplatOperator : public ::testing::TestWithParam<std::pair<SurfelKernel, DepthMode>> {};

TEST_P(SplatOperator, FollowsCentralDifferences) {
    const SplatParams params{.kernel = GetParam().first, .depth = GetParam().second};
    const test::SmoothSurfels scene;
    splatBackwardPass(params, scene);
    const SurfelTensors& s = scene.surfels;
    const auto geometry = [&] { return splatLoss(params, scene, true); };
    const auto all = [&] { return splatLoss(params, scene, false); };
    expectDifferences("means", s.means, s.means.grad(), 4e-3f, 1e-3, geometry);
    expectDifferences("rotations", s.rotations, s.rotations.grad(), 8e-3f, 1e-3, geometry);
    expectDifferences("scales", s.scales, s.scales.grad(), 4e-3f, 1e-3, geometry);
    expectDifferences("opacities", s.opacities, s.opacities.grad(), 4e-3f, 1e-3, geometry);
    expectDifferences("colors", s.colors, s.colors.grad(), 0.25f, 1e-3, all);
    expectDifferences("albedos", s.albedos, s.albedos.grad(), 0.25f, 1e-3, all);
    expectDifferences("roughnesses", s.roughnesses, s.roughnesses.grad(), 0.25f, 1e-3, all);
    expectDifferences("radii", s.radii, s.radii.grad(), 0.25f, 1e-3, all);
}

INSTANTIATE_TEST_SUITE_P(Kernels, SplatOperator,
                         ::testing::Values(std::pair{SurfelKernel::GaussianSurfel, DepthMode::Linear},
                                           std::pair{SurfelKernel::GaussianSurfel, DepthMode::Filtered},
                                           std::pair{SurfelKernel::RaySplat, DepthMode::Exact}));

TEST(SplatOperator, IsTheEnginesBackwardNumberForNumber) {
    const test::SmoothSurfels scene;
    splatBackwardPass({}, scene);

    const Surfels surfels = surfelsFromTensors(scene.surfels);
    GBuffer gbuffer;
    SplatWorkspace workspace;
    ASSERT_TRUE(splat({}, viewOf(surfels), scene.camera, test::kTrainingChannels, gbuffer, workspace).ok());
    std::array<at::Tensor, kChannelCount> weights;
    GBufferGradients gradients;
    for (const Channel channel : kSplatted) {
        at::Tensor& tensor = weights[static_cast<std::size_t>(channel)];
        tensor = randomNumbers({scene.camera.height, scene.camera.width, channelWidth(channel)},
                               static_cast<std::uint64_t>(channel), -1.0f, 1.0f);
        gradients[channel] = viewOf(tensor);
    }
    SplatGradientWorkspace memory;
    SurfelGradients expected;
    ASSERT_TRUE(splatBackward({}, viewOf(surfels), scene.camera, gbuffer, nullptr, gradients, memory, expected).ok());
    const SurfelTensors& s = scene.surfels;
    EXPECT_TRUE(at::equal(s.means.grad(), tensorOf(std::span<const glm::vec3>(expected.means))));
    EXPECT_TRUE(at::equal(s.rotations.grad().flatten(), tensorOf(std::span<const float>(expected.rotations))));
    EXPECT_TRUE(at::equal(s.scales.grad(), tensorOf(std::span<const glm::vec2>(expected.scales))));
    EXPECT_TRUE(at::equal(s.opacities.grad().flatten(), tensorOf(std::span<const float>(expected.opacities))));
    EXPECT_TRUE(at::equal(s.albedos.grad(), tensorOf(std::span<const glm::vec3>(expected.albedos))));
    EXPECT_TRUE(at::equal(s.radii.grad().flatten(), tensorOf(std::span<const float>(expected.radii))));
}

TEST(SplatOperator, TakesEveryShapeOfASingleNumberAndGivesItBack) {
    test::SmoothSurfels scene;
    const at::Tensor flat = leaf(scene.surfels.opacities.detach().flatten());
    scene.surfels.opacities = flat;
    splatBackwardPass({}, scene);
    EXPECT_EQ(flat.grad().sizes(), flat.sizes());
}

TEST(SplatOperator, WhatIsDetachedHasNoHistory) {
    const test::SmoothSurfels scene;
    SplatScratchPool pool;
    const GBufferTensors pictures = splatTensors({}, scene.surfels, scene.camera, test::kTrainingChannels, pool);
    for (const Channel channel : {Channel::RadiusPlus, Channel::RadiusMinus, Channel::Importance, Channel::Bone}) {
        EXPECT_FALSE(pictures[channel].requires_grad()) << channelName(channel);
    }
    pictures[Channel::Radius].sum().backward();
    const auto isZero = [](const at::Tensor& g) { return !g.defined() || g.eq(0).all().item<bool>(); };
    EXPECT_FALSE(isZero(scene.surfels.radii.grad()));
    for (const at::Tensor& t : {scene.surfels.means, scene.surfels.rotations, scene.surfels.scales,
                                scene.surfels.opacities, scene.surfels.albedos}) {
        EXPECT_TRUE(isZero(t.grad())) << "the radius passes nothing to where surfels lie";
    }
}

TEST(SplatOperator, WithoutGradientsNothingIsKept) {
    test::SmoothSurfels scene;
    SplatScratchPool pool;
    const at::NoGradGuard guard;
    const GBufferTensors pictures = splatTensors({}, scene.surfels, scene.camera, {Channel::Albedo}, pool);
    EXPECT_FALSE(pictures[Channel::Albedo].requires_grad());
    EXPECT_TRUE(pictures[Channel::Opacity].defined());
    EXPECT_FALSE(pictures[Channel::Depth].defined());
}

TEST(SplatOperator, MemoryOfOneStepIsUsedByTheNext) {
    const test::SmoothSurfels scene;
    SplatScratchPool pool;
    std::vector<const float*> places;
    for (int step = 0; step < 3; ++step) {
        // Two views of a step live at once and must not share.
        const GBufferTensors first = splatTensors({}, scene.surfels, scene.camera, test::kTrainingChannels, pool);
        const GBufferTensors second = splatTensors({}, scene.surfels, scene.camera, test::kTrainingChannels, pool);
        const float* a = first[Channel::Albedo].const_data_ptr<float>();
        const float* b = second[Channel::Albedo].const_data_ptr<float>();
        EXPECT_NE(a, b);
        (first[Channel::Albedo].sum() + second[Channel::Albedo].sum()).backward();
        std::vector<const float*> now{std::min(a, b), std::max(a, b)};
        if (step > 0) {
            EXPECT_EQ(now, places) << "step " << step;
        }
        places = now;
    }
}

TEST(SplatOperator, FailuresAreNamed) {
    test::SmoothSurfels scene;
    SplatScratchPool pool;
    const auto message = [&](const std::function<void()>& act) -> std::string {
        try {
            act();
        } catch (const OperatorFailure& failure) {
            return failure.error().describe();
        }
        return "nothing was thrown";
    };
    SurfelTensors wrong = scene.surfels;
    wrong.scales = at::ones({test::SmoothSurfels::kCount, 3});
    EXPECT_EQ(message([&] { splatTensors({}, wrong, scene.camera, {Channel::Albedo}, pool); }),
              "splat: scales is (5, 3), expected (5, 2)");
    wrong = scene.surfels;
    wrong.albedos = at::ones({5, 3}, at::kDouble);
    EXPECT_NE(message([&] { splatTensors({}, wrong, scene.camera, {Channel::Albedo}, pool); }).find("expected float"),
              std::string::npos);
    wrong.albedos = at::Tensor();
    EXPECT_NE(message([&] { splatTensors({}, wrong, scene.camera, {Channel::Albedo}, pool); }).find("albedo"),
              std::string::npos);
    // Tensors of a device that engine/ does not know, and of two devices.
    const auto nowhere = at::TensorOptions(at::kFloat).device(at::kMeta);
    wrong = scene.surfels;
    wrong.means = at::empty({5, 3}, nowhere);
    EXPECT_EQ(message([&] { splatTensors({}, wrong, scene.camera, {Channel::Albedo}, pool); }),
              "splat: means is Float on meta, expected float in host memory or on a CUDA device");
    for (at::Tensor SurfelTensors::* member :
         {&SurfelTensors::rotations, &SurfelTensors::opacities, &SurfelTensors::albedos, &SurfelTensors::bones}) {
        wrong = scene.surfels;
        wrong.bones = at::zeros({5, 3});
        wrong.*member = at::empty((wrong.*member).sizes(), nowhere);
        const std::string said = message([&] { splatTensors({}, wrong, scene.camera, {Channel::Albedo}, pool); });
        EXPECT_NE(said.find("lies on meta, expected cpu as the others of this call"), std::string::npos) << said;
    }
    const auto light = lightTensors(at::ones({6, 64, 64, 3}));
    GBufferTensors pictures = splatTensors({}, scene.surfels, scene.camera, test::kTrainingChannels, pool);
    pictures[Channel::Normal] = at::empty(pictures[Channel::Normal].sizes(), nowhere);
    EXPECT_NE(message([&] { shadeTensors({}, pictures, {}, scene.camera, light); }).find("normal lies on meta"),
              std::string::npos);
    OcclusionWorkspace memory;
    EXPECT_NE(message([&] { occlusionTensor({}, pictures, scene.camera, memory, 0); }).find("normal lies on meta"),
              std::string::npos);
    EXPECT_NE(message([&] { lightTensors(at::empty({6, 64, 64, 3}, nowhere)); }).find("on meta"), std::string::npos);
    EXPECT_NE(message([&] { toneTensor({}, at::empty({4, 4, 4}, nowhere)); }).find("on meta"), std::string::npos);
    // Through autograd's engine, too.
    const at::Tensor once =
        splatTensors({}, scene.surfels, scene.camera, {Channel::Albedo}, pool)[Channel::Albedo].sum();
    once.backward();
    EXPECT_THROW(once.backward(), std::exception);
}

TEST(PoseOperator, FollowsCentralDifferencesAndDetaches) {
    test::NineParts scene(0.3f);
    // Few surfels are enough here, of any rotation.
    scene.canonical.means = leaf(scene.canonical.means);
    scene.canonical.rotations = leaf(scene.canonical.rotations * 1.2f);
    const at::Tensor radii = leaf(scene.initialRadii);
    const auto loss = [&] {
        const at::NoGradGuard guard;
        const SurfelTensors live = poseSurfelTensors(scene.context, scene.canonical, radii);
        return test::weighted(live.means, 1) + test::weighted(live.rotations, 2) + test::weighted(live.radii, 3);
    };
    const SurfelTensors live = poseSurfelTensors(scene.context, scene.canonical, radii);
    (test::weightedTensor(live.means, 1) + test::weightedTensor(live.rotations, 2) +
     test::weightedTensor(live.radii, 3))
        .backward();
    expectDifferences("means", scene.canonical.means, scene.canonical.means.grad(), 0.1f, 1e-3, loss, 331);
    expectDifferences("rotations", scene.canonical.rotations, scene.canonical.rotations.grad(), 2e-2f, 1e-3, loss, 331);
    expectDifferences("radii", radii, radii.grad(), 0.02f, 1e-3, loss);
    for (const at::Tensor& t : {live.radiiPlus, live.radiiMinus, live.importances, live.bones}) {
        ASSERT_TRUE(t.defined());
        EXPECT_FALSE(t.requires_grad());
    }
    EXPECT_TRUE(live.albedos.is_same(scene.canonical.albedos)) << "other attributes are handed on";
}

/// Pictures of random numbers that shading can use.
struct ShadingPictures {
    static constexpr int kWidth = 11, kHeight = 7;
    Camera camera = lookAtCamera({0.2, 0.1, 3.0}, {0.0, 0.0, 0.0}, 40.0, kWidth, kHeight);
    GBufferTensors gbuffer;
    at::Tensor occlusion = leaf(randomNumbers({kHeight, kWidth, 1}, 1, 0.2f, 1.0f));
    at::Tensor texels = leaf(randomNumbers({6, 64, 64, 3}, 2, 0.2f, 1.0f));

    ShadingPictures() {
        gbuffer[Channel::Albedo] = leaf(randomNumbers({kHeight, kWidth, 3}, 3));
        gbuffer[Channel::Roughness] = leaf(randomNumbers({kHeight, kWidth, 1}, 4, 0.15f, 0.9f));
        at::Tensor normal = randomNumbers({kHeight, kWidth, 3}, 5, -0.5f, 0.5f);
        normal.select(2, 2).fill_(-1.0f);
        gbuffer[Channel::Normal] = leaf(normal);
        gbuffer[Channel::Opacity] = leaf(randomNumbers({kHeight, kWidth, 1}, 6, 0.3f, 1.0f));
    }
    at::Tensor beauty(const std::shared_ptr<LightTensors>& light) const {
        return shadeTensors({}, gbuffer, occlusion, camera, light);
    }
    double loss(const std::shared_ptr<LightTensors>& light) const {
        const at::NoGradGuard guard;
        return test::weighted(beauty(light), 7);
    }
    /// With the texels as they are now.
    double lossOfTexels() const {
        const at::NoGradGuard guard;
        return loss(lightTensors(texels));
    }
};

TEST(ShadeOperator, FollowsDifferencesWhereItIsLinear) {
    const ShadingPictures scene;
    const auto light = lightTensors(scene.texels);
    test::weightedTensor(scene.beauty(light), 7).backward();
    const auto loss = [&] { return scene.loss(light); };
    const auto& g = scene.gbuffer;
    expectDifferences("albedo", g[Channel::Albedo], g[Channel::Albedo].grad(), 0.25f, 1e-3, loss, 11);
    expectDifferences("occlusion", scene.occlusion, scene.occlusion.grad(), 0.1f, 1e-3, loss, 5);
    expectDifferences("opacity", g[Channel::Opacity], g[Channel::Opacity].grad(), 0.1f, 1e-3, loss, 5);
    // One texel is a small part of any pixel's light: a large step.
    expectDifferences(
        "texels", scene.texels, scene.texels.grad(), 20.0f, 1e-3, [&] { return scene.lossOfTexels(); }, 18013);
}

TEST(ShadeOperator, IsTheEnginesBackwardNumberForNumber) {
    const ShadingPictures scene;
    test::weightedTensor(scene.beauty(lightTensors(scene.texels)), 7).backward();
    PrefilteredLight light;
    ASSERT_TRUE(prefilterLight({}, {scene.texels.const_data_ptr<float>(), 64, 384, 3}, {}, light).ok());
    const auto& g = scene.gbuffer;
    const at::Tensor weights = randomNumbers({ShadingPictures::kHeight, ShadingPictures::kWidth, 4}, 7, -1.0f, 1.0f);
    at::Tensor normal = at::empty_like(g[Channel::Normal].detach());
    at::Tensor roughness = at::empty_like(g[Channel::Roughness].detach());
    LightLevelGradients levels;
    levels.reset(light.view());
    ShadingGradientWorkspace workspace;
    ASSERT_TRUE(shadeBackward({}, {},
                              {viewOf(g[Channel::Albedo]),
                               viewOf(g[Channel::Roughness]),
                               viewOf(g[Channel::Normal]),
                               viewOf(g[Channel::Opacity]),
                               viewOf(scene.occlusion),
                               {},
                               scene.camera,
                               light.view()},
                              viewOf(weights),
                              {{}, writableViewOf(roughness), writableViewOf(normal), {}, {}, levels.view()}, workspace)
                    .ok());
    EXPECT_TRUE(at::equal(g[Channel::Normal].grad(), normal));
    EXPECT_TRUE(at::equal(g[Channel::Roughness].grad(), roughness));
    at::Tensor base = at::empty({6, 64, 64, 3});
    PrefilterGradientWorkspace memory;
    ASSERT_TRUE(prefilterLightBackward({}, 64, {}, levels.view(), {base.data_ptr<float>(), 64, 384, 3}, memory).ok());
    EXPECT_TRUE(at::equal(scene.texels.grad(), base));
}

/// <A x, y> = <x, A^T y>: the picture is linear in the texels, so the difference of any two lights is exact.
TEST(ShadeOperator, TheLightsGradientIsTheAdjoint) {
    const ShadingPictures scene;
    test::weightedTensor(scene.beauty(lightTensors(scene.texels)), 7).backward();
    const at::Tensor direction = randomNumbers(scene.texels.sizes(), 8);
    const double before = scene.lossOfTexels();
    {
        const at::NoGradGuard guard;
        scene.texels.add_(direction);
    }
    const double expected = (scene.texels.grad().to(at::kDouble) * direction.to(at::kDouble)).sum().item<double>();
    EXPECT_NEAR(scene.lossOfTexels() - before, expected, 1e-4 * std::abs(expected));
}

TEST(ShadeOperator, OcclusionAndGradientsMayBeAbsent) {
    ShadingPictures scene;
    const at::Tensor open = shadeTensors({}, scene.gbuffer, {}, scene.camera, lightTensors(scene.texels.detach()));
    open.sum().backward();
    EXPECT_TRUE(scene.gbuffer[Channel::Albedo].grad().defined());
    EXPECT_FALSE(scene.texels.grad().defined());
    const at::Tensor ones = at::ones_like(scene.occlusion.detach());
    const at::NoGradGuard guard;
    EXPECT_TRUE(at::equal(open, shadeTensors({}, scene.gbuffer, ones, scene.camera, lightTensors(scene.texels))));
    EXPECT_THROW(lightTensors(at::zeros({6, 48, 48, 3})), OperatorFailure);
    EXPECT_THROW(lightTensors(at::zeros({6, 64, 32, 3})), OperatorFailure);
}

TEST(ToneOperator, FollowsCentralDifferences) {
    for (const ToneCurve curve : {ToneCurve::None, ToneCurve::Aces, ToneCurve::Agx}) {
        const ToneParams params{.curve = curve, .backgroundRed = 0.4f, .backgroundBlue = 0.1f};
        at::Tensor values = randomNumbers({4, 6, 4}, 3, 0.1f, 0.45f);
        values.select(2, 3).fill_(0.7f);
        const at::Tensor linear = leaf(values);
        test::weightedTensor(toneTensor(params, linear), 4).backward();
        expectDifferences("linear", linear, linear.grad(), 4e-3f, 1e-3, [&] {
            const at::NoGradGuard guard;
            return test::weighted(toneTensor(params, linear), 4);
        });
    }
}

TEST(ToneOperator, DerivativesOfDerivativesAreRefused) {
    const at::Tensor linear = leaf(randomNumbers({2, 2, 4}, 3, 0.2f, 0.5f));
    const at::Tensor display = toneTensor({}, linear);
    EXPECT_THROW(torch::autograd::grad({display.sum()}, {linear}, {}, true, true), OperatorFailure);
}

TEST(OcclusionOperator, ReachesTheRadiusAlone) {
    test::NineParts scene;
    GBufferTensors gbuffer;
    {
        const at::NoGradGuard guard;
        scene.occlusionOf(at::zeros(9), &gbuffer);
    }
    for (const Channel channel : {Channel::Depth, Channel::Normal, Channel::Radius, Channel::RadiusPlus,
                                  Channel::RadiusMinus, Channel::Importance, Channel::Bone, Channel::Opacity}) {
        gbuffer[channel] = leaf(gbuffer[channel]);
    }
    const at::Tensor open = occlusionTensor(scene.occlusion, gbuffer, scene.camera, scene.workspace, 3);
    open.sum().backward();
    for (const Channel channel : {Channel::Depth, Channel::Normal, Channel::RadiusPlus, Channel::RadiusMinus,
                                  Channel::Importance, Channel::Bone, Channel::Opacity}) {
        EXPECT_FALSE(gbuffer[channel].grad().defined()) << channelName(channel) << " receives exactly zero";
    }
    ASSERT_TRUE(gbuffer[Channel::Radius].grad().defined());
    EXPECT_GT(gbuffer[Channel::Radius].grad().abs().sum().item<double>(), 0.0);

    // (O+ - O-) / (R+ - R-) of three separate calls.
    const at::NoGradGuard guard;
    const auto at = [&](Channel radius) {
        GBufferTensors other = gbuffer;
        other[Channel::Radius] = gbuffer[radius];
        return occlusionTensor(scene.occlusion, other, scene.camera, scene.workspace, 3);
    };
    const at::Tensor step = gbuffer[Channel::RadiusPlus] - gbuffer[Channel::RadiusMinus];
    const at::Tensor slope = (at(Channel::RadiusPlus) - at(Channel::RadiusMinus)) / step;
    const at::Tensor expected = at::where(step.abs() >= 1e-6, slope, at::zeros_like(slope));
    EXPECT_LT((expected - gbuffer[Channel::Radius].grad()).abs().max().item<double>(),
              1e-5 * expected.abs().max().item<double>());
    EXPECT_TRUE(at::equal(open, at(Channel::Radius))) << "the maps of a triple are those of single calls";
}

} // namespace
} // namespace ars
