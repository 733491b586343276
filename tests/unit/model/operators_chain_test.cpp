// From canonical surfels, radii and light to the shaded sRGB picture and back: the operators of a training step
// together.
#include "tests/unit/model/operators_support.h"

#include <array>

namespace ars {
namespace {

using test::leaf;
using test::NineParts;

/// Outer difference of the whole chain along a direction of delta, r_g = r_init (1 + delta_g). The step is that of R+
/// and R- (5 %), so both look at the same two occlusion maps wherever the direction moves a surfel's radius as a whole,
/// and what remains is that shading and the sRGB curve are not linear over the step.
double outerDifference(NineParts& scene, const std::shared_ptr<LightTensors>& light, const at::Tensor& direction) {
    const at::NoGradGuard guard;
    constexpr double kStep = 0.05;
    const auto loss = [&](double step) {
        return scene.picture(direction * step, light).to(at::kDouble).sum().item<double>();
    };
    return (loss(kStep) - loss(-kStep)) / (2.0 * kStep);
}

/// @param bound  of the difference, relative to the largest slope of the nine
void expectChain(float blend, double bound) {
    NineParts scene(blend);
    const auto light = lightTensors(scene.texels);
    const at::Tensor offsets = leaf(at::zeros(9));
    scene.picture(offsets, light).sum().backward();
    std::array<double, 9> outer{};
    double size = 0.0;
    for (std::size_t g = 0; g < 9; ++g) {
        at::Tensor direction = at::zeros(9);
        direction[static_cast<std::int64_t>(g)] = 1.0f;
        outer[g] = outerDifference(scene, light, direction);
        size = std::max(size, std::abs(outer[g]));
    }
    for (std::size_t g = 0; g < 9; ++g) {
        const double found = offsets.grad()[static_cast<std::int64_t>(g)].item<double>();
        EXPECT_NEAR(found, outer[g], bound * size) << bodyPartName(static_cast<BodyPart>(g));
        if (blend == 0.0f) {
            EXPECT_LT(outer[g], -0.05 * size) << "a groove must darken with its radius, or nothing is tested";
        }
    }
    // All parts together move every radius as R+ and R- do, however parts are blended.
    const double all = outerDifference(scene, light, at::ones(9));
    EXPECT_NEAR(offsets.grad().sum().item<double>(), all, 0.01 * std::abs(all));
}

TEST(OperatorChain, OffsetsOfAllNinePartsFollowOuterDifferences) { expectChain(0.0f, 0.012); }

/// A surfel of two parts has R+ and R- from both, an outer step from one: another secant of the same curve.
TEST(OperatorChain, BlendedPartsStayNearOuterDifferences) { expectChain(0.3f, 0.12); }

/// dL/d of everything that training changes, for some views.
std::vector<at::Tensor> stepGradients(NineParts& scene, const std::vector<Camera>& views) {
    SurfelTensors& c = scene.canonical;
    const SurfelTensors kept = c;
    c.means = leaf(kept.means);
    c.rotations = leaf(kept.rotations);
    c.scales = leaf(kept.scales);
    c.opacities = leaf(kept.opacities);
    c.albedos = leaf(kept.albedos);
    c.roughnesses = leaf(kept.roughnesses);
    const at::Tensor offsets = leaf(at::zeros(9)), texels = leaf(scene.texels);
    const auto light = lightTensors(texels);
    at::Tensor loss = at::zeros({});
    const Camera first = scene.camera;
    for (const Camera& view : views) {
        scene.camera = view;
        loss = loss + test::weightedTensor(scene.picture(offsets, light), 4);
    }
    scene.camera = first;
    loss.backward();
    const std::vector<at::Tensor> result{c.means.grad(),   c.rotations.grad(),   c.scales.grad(), c.opacities.grad(),
                                         c.albedos.grad(), c.roughnesses.grad(), offsets.grad(),  texels.grad()};
    c = kept;
    return result;
}

TEST(OperatorChain, SameNumbersForOneAndTwoThreads) {
    NineParts scene(0.3f);
    const int before = threadCount();
    setThreadCount(1);
    const auto one = stepGradients(scene, {scene.camera});
    setThreadCount(2);
    const auto two = stepGradients(scene, {scene.camera});
    setThreadCount(before);
    for (std::size_t i = 0; i < one.size(); ++i) {
        EXPECT_GT(one[i].abs().sum().item<double>(), 0.0) << "gradient " << i;
        EXPECT_TRUE(at::equal(one[i], two[i])) << "gradient " << i;
    }
}

TEST(OperatorChain, ViewsOfOneStepAddUp) {
    NineParts scene(0.3f);
    const Camera side = lookAtCamera({0.5, 0.2, 2.3}, {0.0, 0.0, 0.0}, 30.0, NineParts::kSide, NineParts::kSide);
    const auto first = stepGradients(scene, {scene.camera}), second = stepGradients(scene, {side});
    const auto both = stepGradients(scene, {scene.camera, side});
    for (std::size_t i = 0; i < both.size(); ++i) {
        const at::Tensor sum = first[i] + second[i];
        EXPECT_LT((both[i] - sum).abs().max().item<double>(), 1e-5 * sum.abs().max().item<double>()) << i;
    }
}

TEST(OperatorChain, OcclusionPassesNothingToGeometryAndMaterial) {
    NineParts scene(0.3f);
    SurfelTensors& c = scene.canonical;
    for (at::Tensor* t : {&c.means, &c.rotations, &c.scales, &c.opacities, &c.albedos, &c.roughnesses}) *t = leaf(*t);
    const at::Tensor offsets = leaf(at::zeros(9));
    scene.occlusionOf(offsets).sum().backward();
    EXPECT_EQ(offsets.grad().ne(0).sum().item<std::int64_t>(), 9);
    for (const at::Tensor& t : {c.means, c.rotations, c.scales, c.opacities, c.albedos, c.roughnesses}) {
        EXPECT_TRUE(!t.grad().defined() || t.grad().eq(0).all().item<bool>());
    }
}

} // namespace
} // namespace ars
