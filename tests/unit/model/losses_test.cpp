#include "engine/core/parallel.h"
#include "model/loss/loss_chains.h"
#include "model/loss/losses.h"

#include <ATen/ATen.h>
#include <glm/gtc/quaternion.hpp>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <functional>
#include <random>

namespace ars {
namespace {

using Loss = std::function<at::Tensor(const at::Tensor&)>;

at::Tensor randomTensor(std::vector<std::int64_t> sizes, std::uint64_t seed, double low = 0, double high = 1) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(low, high);
    at::Tensor result = at::empty(sizes, at::kDouble);
    for (std::int64_t i = 0; i < result.numel(); ++i) result.data_ptr<double>()[i] = uniform(random);
    return result;
}

/// Largest |autograd - central difference| of a double input over the largest difference; kinks are the caller's to
/// avoid.
double gradientError(const Loss& loss, const at::Tensor& at, double step = 1e-6) {
    at::Tensor x = at.detach().clone().requires_grad_(true);
    loss(x).backward();
    at::Tensor gradient = x.grad().contiguous();
    at::Tensor moved = at.detach().clone().contiguous();
    auto* values = moved.data_ptr<double>();
    double worst = 0, largest = 0;
    at::NoGradGuard off;
    for (std::int64_t i = 0; i < moved.numel(); ++i) {
        const double before = values[i];
        values[i] = before + step;
        const double plus = loss(moved).item<double>();
        values[i] = before - step;
        const double minus = loss(moved).item<double>();
        values[i] = before;
        const double difference = (plus - minus) / (2 * step);
        worst = std::max(worst, std::abs(difference - gradient.data_ptr<double>()[i]));
        largest = std::max(largest, std::abs(difference));
    }
    EXPECT_GT(largest, 0.0);
    return worst / largest;
}

/// The same in float against the gradient in double.
double floatError(const Loss& loss, const at::Tensor& at) {
    at::Tensor exact = at.detach().clone().requires_grad_(true), rough = at.to(at::kFloat).requires_grad_(true);
    const at::Tensor exactValue = loss(exact), roughValue = loss(rough);
    EXPECT_NEAR(exactValue.item<double>(), roughValue.item<double>(), 1e-4 * std::abs(exactValue.item<double>()));
    exactValue.backward();
    roughValue.backward();
    const at::Tensor difference = rough.grad().to(at::kDouble) - exact.grad();
    return difference.abs().max().item<double>() / exact.grad().abs().max().item<double>();
}

Camera testCamera(int width, int height) {
    Camera camera;
    camera.width = width;
    camera.height = height;
    camera.fx = 31;
    camera.fy = 29;
    camera.cx = 0.4 * width;
    camera.cy = 0.55 * height;
    return camera;
}

at::Tensor unitNormals(std::vector<std::int64_t> sizes, std::uint64_t seed) {
    const at::Tensor n = randomTensor(std::move(sizes), seed, -1, 1);
    return n / n.norm(2, -1, true);
}

/// 1 but for a hole and an empty border on one side.
at::Tensor opacityWithHole(std::int64_t height, std::int64_t width) {
    at::Tensor opacity = at::ones({height, width, 1}, at::kDouble);
    opacity.select(1, width - 1).fill_(0);
    opacity[3][4].fill_(0);
    return opacity;
}

TEST(L1Loss, IsTheMeanOverPixelsOfTheMask) {
    const at::Tensor a = randomTensor({7, 5, 3}, 1), b = randomTensor({7, 5, 3}, 2);
    EXPECT_NEAR(l1Loss(a, b).item<double>(), (a - b).abs().mean().item<double>(), 1e-14);
    at::Tensor mask = at::zeros({7, 5, 1}, at::kDouble);
    mask[2][3].fill_(1);
    mask[6][4].fill_(1);
    const double expected = ((a - b).abs()[2][3].sum() + (a - b).abs()[6][4].sum()).item<double>() / 6;
    EXPECT_NEAR(l1Loss(a, b, mask).item<double>(), expected, 1e-14);
    EXPECT_EQ(l1Loss(a, b, at::zeros_like(mask)).item<double>(), 0.0);
}

TEST(L1Loss, GradientIsThatOfCentralDifferences) {
    const at::Tensor a = randomTensor({7, 5, 3}, 1), b = randomTensor({7, 5, 3}, 2);
    const at::Tensor mask = randomTensor({7, 5, 1}, 3).gt(0.4).to(at::kDouble);
    const Loss loss = [&](const at::Tensor& x) { return l1Loss(x, b, mask); };
    EXPECT_LT(gradientError(loss, a), 1e-7);
    EXPECT_LT(floatError(loss, a), 1e-6);
    const Loss byTarget = [&](const at::Tensor& x) { return l1Loss(a, x, mask); };
    EXPECT_LT(gradientError(byTarget, b), 1e-7);
}

TEST(OffsetLoss, IsTheMeanSquareOrTheMeanLength) {
    const at::Tensor offsets = randomTensor({40, 3}, 4, -0.1, 0.1);
    EXPECT_NEAR(offsetLoss(offsets).item<double>(), offsets.square().sum(1).mean().item<double>(), 1e-15);
    EXPECT_NEAR(offsetLoss(offsets, false).item<double>(), offsets.norm(2, 1).mean().item<double>(), 1e-15);
    for (const bool squared : {true, false}) {
        const Loss loss = [&](const at::Tensor& x) { return offsetLoss(x, squared); };
        EXPECT_LT(gradientError(loss, offsets), 1e-7);
        EXPECT_LT(floatError(loss, offsets), 1e-5);
    }
}

TEST(OffsetLoss, HasNoGradientWhereNothingIsOffset) {
    at::Tensor offsets = at::zeros({3, 3}).requires_grad_(true);
    offsetLoss(offsets, false).backward();
    EXPECT_EQ(offsets.grad().abs().max().item<float>(), 0.0f);
}

TEST(DepthNormals, OfATiltedPlaneAreThePlanesNormal) {
    const Camera camera = testCamera(24, 20);
    const glm::dvec3 normal = glm::normalize(glm::dvec3(0.3, -0.5, -0.8));
    at::Tensor depth = at::empty({20, 24, 1}, at::kDouble);
    for (int y = 0; y < 20; ++y) {
        for (int x = 0; x < 24; ++x)
            depth[y][x][0] = glm::dot(normal, glm::dvec3(0, 0, 3)) / glm::dot(normal, camera.ray(x + 0.5, y + 0.5));
    }
    const at::Tensor opacity = opacityWithHole(20, 24);
    const at::Tensor normals = depthNormals(depth, opacity, camera);
    for (int y = 0; y < 20; ++y) {
        for (int x = 0; x < 24; ++x) {
            const bool border = y == 0 || x == 0 || y == 19 || x >= 22;
            const bool hole = std::abs(y - 3) + std::abs(x - 4) <= 1;
            for (int c = 0; c < 3; ++c) {
                EXPECT_NEAR(normals[y][x][c].item<double>(), border || hole ? 0.0 : normal[c], 1e-10)
                    << y << " " << x << " " << c;
            }
        }
    }
}

TEST(DepthNormals, GradientIsThatOfCentralDifferences) {
    const Camera camera = testCamera(9, 8);
    const at::Tensor depth = randomTensor({8, 9, 1}, 5, 2.5, 2.7), opacity = opacityWithHole(8, 9);
    const at::Tensor weights = randomTensor({8, 9, 3}, 6, -1, 1);
    const Loss loss = [&](const at::Tensor& x) {
        return (depthNormals(x, opacity, camera) * weights.to(x.scalar_type())).sum();
    };
    EXPECT_LT(gradientError(loss, depth), 1e-7);
    EXPECT_LT(floatError(loss, depth), 1e-3);
}

TEST(DepthNormalLoss, IsOneMinusTheCosineOverPixelsThatHaveBoth) {
    const Camera camera = testCamera(9, 8);
    const at::Tensor depth = randomTensor({8, 9, 1}, 5, 2.5, 2.7), opacity = opacityWithHole(8, 9);
    at::Tensor normal = unitNormals({8, 9, 3}, 7);
    normal[5][5].fill_(0);
    const at::Tensor other = depthNormals(depth, opacity, camera);
    const at::Tensor both = (other.norm(2, 2) > 0).logical_and(normal.norm(2, 2) > 0);
    const double expected = ((1 - (normal * other).sum(2)) * both).sum().item<double>() / both.sum().item<double>();
    EXPECT_GT(both.sum().item<double>(), 10);
    EXPECT_NEAR(depthNormalLoss(normal, depth, opacity, camera).item<double>(), expected, 1e-12);
}

TEST(DepthNormalLoss, GradientsAreThoseOfCentralDifferences) {
    const Camera camera = testCamera(9, 8);
    const at::Tensor depth = randomTensor({8, 9, 1}, 5, 2.5, 2.7), opacity = opacityWithHole(8, 9);
    const at::Tensor normal = unitNormals({8, 9, 3}, 7);
    const Loss byNormal = [&](const at::Tensor& x) { return depthNormalLoss(x, depth, opacity, camera); };
    const Loss byDepth = [&](const at::Tensor& x) { return depthNormalLoss(normal, x, opacity, camera); };
    EXPECT_LT(gradientError(byNormal, normal), 1e-7);
    EXPECT_LT(gradientError(byDepth, depth), 1e-7);
    EXPECT_LT(floatError(byDepth, depth), 1e-3);
}

TEST(CurvatureLoss, IsZeroOnAPlaneAndKnownOnAnEdge) {
    at::Tensor normal = at::zeros({4, 6, 3}, at::kDouble);
    normal.select(2, 2).fill_(-1);
    const at::Tensor opacity = at::ones({4, 6, 1}, at::kDouble);
    EXPECT_EQ(curvatureLoss(normal, opacity).item<double>(), 0.0);
    // Right half turned by 90 degrees: both columns at the edge see one neighbour that differs by (1, 0, 1).
    normal.narrow(1, 3, 3).select(2, 2).fill_(0);
    normal.narrow(1, 3, 3).select(2, 0).fill_(1);
    EXPECT_NEAR(curvatureLoss(normal, opacity).item<double>(), 4 * 2 * 2.0 / 24, 1e-14);
    at::Tensor half = opacity.clone();
    half.narrow(1, 3, 3).fill_(0.4);
    EXPECT_EQ(curvatureLoss(normal, half).item<double>(), 0.0) << "neighbours outside the foreground do not count";
}

TEST(CurvatureLoss, GradientIsThatOfCentralDifferences) {
    const at::Tensor normal = unitNormals({8, 9, 3}, 8), opacity = opacityWithHole(8, 9);
    const Loss loss = [&](const at::Tensor& x) { return curvatureLoss(x, opacity); };
    EXPECT_LT(gradientError(loss, normal), 1e-7);
    EXPECT_LT(floatError(loss, normal), 1e-6);
}

TEST(CanonicalNeighbours, AreTheNearestWithoutFarPairs) {
    std::vector<glm::vec3> points;
    for (int i = 0; i < 10; ++i) points.emplace_back(0.01f * static_cast<float>(i), 0.0f, 0.0f);
    points.emplace_back(5.0f, 0.0f, 0.0f);
    const NeighbourPairs pairs = canonicalNeighbours(points, 4, 3.5f);
    ASSERT_EQ(pairs.first.numel(), pairs.second.numel());
    EXPECT_EQ(pairs.first.numel(), 10 * 4 - 2) << "the ends' fourth neighbours are 0.04 away, the lone point's all";
    for (std::int64_t m = 0; m < pairs.first.numel(); ++m) {
        const auto i = pairs.first[m].item<std::int64_t>(), j = pairs.second[m].item<std::int64_t>();
        EXPECT_NE(i, 10);
        EXPECT_NE(j, 10);
        EXPECT_LE(std::abs(i - j), 3);
        const float farthest = i == 0 || i == 9 ? 0.04f : i == 1 || i == 8 ? 0.03f : 0.02f;
        EXPECT_NEAR(pairs.farthest[m].item<float>(), farthest, 1e-6f);
    }
}

TEST(NormalDeformationLoss, IsTheFormulaOverThePairs) {
    std::vector<glm::vec3> points;
    const at::Tensor places = randomTensor({60, 3}, 9);
    for (std::int64_t i = 0; i < 60; ++i)
        points.emplace_back(places[i][0].item<float>(), places[i][1].item<float>(), places[i][2].item<float>());
    const NeighbourPairs pairs = canonicalNeighbours(points);
    const at::Tensor means = randomTensor({60, 3}, 10), normals = unitNormals({60, 3}, 11);
    const at::Tensor some = at::arange(0, pairs.first.numel(), 3, at::kLong);
    for (const at::Tensor& chosen : {at::Tensor(), some}) {
        const at::Tensor pick = chosen.defined() ? chosen : at::arange(pairs.first.numel(), at::kLong);
        const at::Tensor i = pairs.first.index_select(0, pick), j = pairs.second.index_select(0, pick);
        const at::Tensor sigma = pairs.farthest.to(at::kDouble).index_select(0, pick);
        const at::Tensor square = (means.index_select(0, i) - means.index_select(0, j)).square().sum(1);
        const at::Tensor cosine = (normals.index_select(0, i) * normals.index_select(0, j)).sum(1).abs();
        const double expected = ((-square / sigma.square()).exp() * (1 - cosine)).mean().item<double>();
        EXPECT_NEAR(normalDeformationLoss(pairs, means, normals, chosen).item<double>(), expected, 1e-12);
        const Loss loss = [&](const at::Tensor& x) { return normalDeformationLoss(pairs, means, x, chosen); };
        EXPECT_LT(gradientError(loss, normals), 1e-7);
        EXPECT_LT(floatError(loss, normals), 1e-4);
    }
    at::Tensor leaf = means.clone().requires_grad_(true), normalLeaf = normals.clone().requires_grad_(true);
    normalDeformationLoss(pairs, leaf, normalLeaf).backward();
    EXPECT_FALSE(leaf.grad().defined()) << "the weights are detached";
    const NeighbourPairs none = canonicalNeighbours({});
    EXPECT_EQ(normalDeformationLoss(none, means, normals).item<double>(), 0.0);
}

TEST(NormalsOfRotations, AreTheThirdColumn) {
    at::Tensor q = randomTensor({30, 4}, 12, -1, 1);
    q = q / q.norm(2, 1, true);
    const at::Tensor normals = normalsOfRotations(q);
    for (std::int64_t i = 0; i < 30; ++i) {
        const glm::dquat turn(q[i][0].item<double>(), q[i][1].item<double>(), q[i][2].item<double>(),
                              q[i][3].item<double>());
        const glm::dvec3 expected = turn * glm::dvec3(0, 0, 1);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(normals[i][c].item<double>(), expected[c], 1e-12);
    }
    const at::Tensor weights = randomTensor({30, 3}, 13, -1, 1);
    const Loss loss = [&](const at::Tensor& x) { return (normalsOfRotations(x) * weights.to(x.scalar_type())).sum(); };
    EXPECT_LT(gradientError(loss, q), 1e-7);
    // What devices other than the host take.
    EXPECT_LT((chains::normalsOfRotations(q) - normals).abs().max().item<double>(), 1e-14);
    const Loss chain = [&](const at::Tensor& x) {
        return (chains::normalsOfRotations(x) * weights.to(x.scalar_type())).sum();
    };
    EXPECT_LT(gradientError(chain, q), 1e-7);
}

// LPIPS's term as devices other than the host take it, by its definition; a pixel where nothing fires passes nothing.
TEST(LossChains, FeatureDistance) {
    const at::Tensor f = randomTensor({1, 4, 3, 2}, 60), g = randomTensor({1, 4, 3, 2}, 61), w = randomTensor({4}, 62);
    double expected = 0;
    for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < 2; ++x) {
            double lengthF = 0, lengthG = 0;
            const auto at = [&](const at::Tensor& t, int c) { return t[0][c][y][x].item<double>(); };
            for (int c = 0; c < 4; ++c) {
                lengthF += at(f, c) * at(f, c);
                lengthG += at(g, c) * at(g, c);
            }
            for (int c = 0; c < 4; ++c) {
                const double difference = at(f, c) / std::sqrt(lengthF) - at(g, c) / std::sqrt(lengthG);
                expected += w[c].item<double>() * difference * difference / 6;
            }
        }
    }
    EXPECT_NEAR(chains::featureDistance(f, g, w).item<double>(), expected, 1e-9);
    EXPECT_LT(gradientError(
                  [&](const at::Tensor& x) {
                      return chains::featureDistance(x, g.to(x.scalar_type()), w.to(x.scalar_type()));
                  },
                  f),
              1e-6);
    at::Tensor dark = f.clone();
    dark.narrow(3, 0, 1).zero_();
    dark.requires_grad_(true);
    chains::featureDistance(at::relu(dark), g, w).backward();
    EXPECT_TRUE(at::isfinite(dark.grad()).all().item<bool>());
    EXPECT_EQ(dark.grad().narrow(3, 0, 1).abs().max().item<double>(), 0.0);
}

TEST(TotalVariation, CountsPairsInsideTheForeground) {
    const at::Tensor picture = randomTensor({6, 7, 3}, 14), all = at::ones({6, 7, 1}, at::kDouble);
    const double across = (picture.narrow(1, 1, 6) - picture.narrow(1, 0, 6)).abs().sum().item<double>();
    const double down = (picture.narrow(0, 1, 5) - picture.narrow(0, 0, 5)).abs().sum().item<double>();
    EXPECT_NEAR(totalVariation(picture, all).item<double>(), (across + down) / (3 * (6 * 6 + 5 * 7)), 1e-14);
    at::Tensor two = at::full({6, 7, 1}, 0.5, at::kDouble);
    two[2][3].fill_(0.6);
    two[3][3].fill_(0.6);
    EXPECT_NEAR(totalVariation(picture, two).item<double>(),
                (picture[2][3] - picture[3][3]).abs().mean().item<double>(), 1e-14);
    const at::Tensor opacity = opacityWithHole(6, 7);
    const Loss loss = [&](const at::Tensor& x) { return totalVariation(x, opacity); };
    EXPECT_LT(gradientError(loss, picture), 1e-7);
    EXPECT_LT(floatError(loss, picture), 1e-6);
}

TEST(LightTotalVariation, StaysWithinFaces) {
    at::Tensor cube = at::zeros({6, 4, 4, 3}, at::kDouble);
    for (int face = 0; face < 6; ++face) cube[face].fill_(face);
    EXPECT_EQ(lightTotalVariation(cube).item<double>(), 0.0);
    const at::Tensor random = randomTensor({6, 4, 4, 3}, 15);
    const double across = (random.narrow(2, 1, 3) - random.narrow(2, 0, 3)).abs().sum().item<double>();
    const double down = (random.narrow(1, 1, 3) - random.narrow(1, 0, 3)).abs().sum().item<double>();
    EXPECT_NEAR(lightTotalVariation(random).item<double>(), (across + down) / (3 * 6 * 24), 1e-14);
    EXPECT_LT(gradientError([](const at::Tensor& x) { return lightTotalVariation(x); }, random), 1e-7);
}

TEST(WhiteLightLoss, IsZeroForGreyLightAndTheFormulaElse) {
    EXPECT_LT(whiteLightLoss(at::full({6, 4, 4, 3}, 0.7, at::kDouble)).item<double>(), 1e-15);
    const at::Tensor light = randomTensor({6, 4, 4, 3}, 16, 0, 3);
    const double expected = (light - light.mean(3, true)).abs().mean().item<double>();
    EXPECT_NEAR(whiteLightLoss(light).item<double>(), expected, 1e-14);
    const Loss loss = [](const at::Tensor& x) { return whiteLightLoss(x); };
    EXPECT_LT(gradientError(loss, light), 1e-7);
    EXPECT_LT(floatError(loss, light), 1e-5);
}

TEST(Losses, SayWhatDoesNotFit) {
    const at::Tensor picture = at::zeros({4, 5, 3});
    EXPECT_THROW(l1Loss(picture, at::zeros({4, 6, 3})), c10::Error);
    EXPECT_THROW(depthNormalLoss(picture, at::zeros({4, 5, 1}), at::ones({4, 5, 1}), testCamera(4, 4)), c10::Error);
    EXPECT_THROW(totalVariation(picture, at::ones({4, 4, 1})), c10::Error);
}

TEST(Losses, AreTheSameOnAnyNumberOfThreads) {
    const at::Tensor picture = randomTensor({90, 70, 3}, 17).to(at::kFloat), target = at::rand({90, 70, 3});
    at::Tensor one = picture.clone().requires_grad_(true), all = picture.clone().requires_grad_(true);
    const int threads = threadCount();
    const auto value = [&](at::Tensor& x) {
        const at::Tensor loss = l1Loss(x, target) + totalVariation(x, {}) + curvatureLoss(x, at::ones({90, 70, 1}));
        loss.backward();
        return loss.item<float>();
    };
    setThreadCount(1);
    const float first = value(one);
    setThreadCount(3);
    const float second = value(all);
    setThreadCount(threads);
    EXPECT_EQ(first, second);
    EXPECT_TRUE(at::equal(one.grad(), all.grad()));
}

TEST(ConsistencyWeight, RampsOverTheFirstHalf) {
    EXPECT_DOUBLE_EQ(consistencyWeight(0.025, 0.125, 0.0), 0.025);
    EXPECT_DOUBLE_EQ(consistencyWeight(0.025, 0.125, 0.25), 0.075);
    EXPECT_DOUBLE_EQ(consistencyWeight(0.025, 0.125, 0.5), 0.125);
    EXPECT_DOUBLE_EQ(consistencyWeight(0.025, 0.125, 1.0), 0.125);
}

} // namespace
} // namespace ars
