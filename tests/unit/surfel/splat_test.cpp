#include "tests/unit/surfel/splat_support.h"

#include <numbers>

// The oracles of the rendering reference, section 8 (S1 to S6), against closed forms written here, for every renderer:
// the slow twin in double and float, every instruction set, every device.
namespace ars::test {
namespace {

constexpr SplatParams kGaussian{};
constexpr SplatParams kGaussianExact{.depth = DepthMode::Exact};
constexpr SplatParams kRay{.kernel = SurfelKernel::RaySplat};
constexpr ChannelSet kGeometry{Channel::Opacity, Channel::Depth, Channel::Normal, Channel::Position};

/// alpha of a Gaussian with the paper's limits.
double limitedAlpha(double opacity, double exponent) {
    const double alpha = std::min(0.99, opacity * std::exp(exponent));
    return alpha >= 1.0 / 255.0 ? alpha : 0.0;
}

TEST(SplatOracle, S1FacingSurfelIsTheClosedFormGaussian) {
    const Camera camera = straightCamera(48, 40, 300, 20.3, 23.9); // off-centre
    const double z = 2.0, sigma = 0.03, opacity = 0.8;
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {kGaussian, kGaussianExact, kRay}) {
            Surfels s;
            addSurfel(s, {0, 0, z}, {0, 0, -1}, sigma, sigma, opacity);
            const Pictures pictures = renderer.render(params, s, camera, kGeometry);
            const double pixelSigma2 = std::pow(300 * sigma / z, 2);
            int covered = 0;
            for (int row = 0; row < camera.height; ++row) {
                for (int column = 0; column < camera.width; ++column) {
                    const double d2 = std::pow(column + 0.5 - camera.cx, 2) + std::pow(row + 0.5 - camera.cy, 2);
                    // 2DGS: the disc itself or, where that is thinner, the low-pass exp(-d^2).
                    const double exponent = params.kernel == SurfelKernel::RaySplat
                                                ? -0.5 * std::min(d2 / pixelSigma2, 2 * d2)
                                                : -0.5 * d2 / (pixelSigma2 + 0.3);
                    if (std::abs(opacity * std::exp(exponent) * 255 - 1) < 1e-4) continue; // rounding decides
                    const double alpha = limitedAlpha(opacity, exponent);
                    ASSERT_NEAR(pictures.at(Channel::Opacity, row, column), alpha, 2e-6);
                    if (alpha == 0) continue;
                    ++covered;
                    ASSERT_NEAR(pictures.at(Channel::Depth, row, column), z, 2e-6);
                    ASSERT_NEAR(glm::distance(pictures.vec(Channel::Normal, row, column), glm::dvec3(0, 0, -1)), 0,
                                1e-6);
                }
            }
            // The footprint's radius is sqrt(2 ln(255 o) sigma'^2).
            const double variance = params.kernel == SurfelKernel::RaySplat ? pixelSigma2 : pixelSigma2 + 0.3;
            EXPECT_NEAR(covered, 2 * std::numbers::pi * std::log(255 * opacity) * variance, 25);
        }
    }
}

TEST(SplatOracle, S1SmallSurfelIsWidenedByTheLowPass) {
    const Camera camera = straightCamera(16, 16, 300, 8.5, 8.5);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        Surfels s;
        addSurfel(s, {0, 0, 3}, {0, 0, -1}, 1e-5, 1e-5, 1.0);
        const Pictures gaussian = renderer.render(kGaussian, s, camera, kGeometry);
        const Pictures ray = renderer.render(kRay, s, camera, kGeometry);
        EXPECT_NEAR(gaussian.at(Channel::Opacity, 8, 8), 0.99, 1e-6);
        EXPECT_NEAR(ray.at(Channel::Opacity, 8, 8), 0.99, 1e-6);
        EXPECT_NEAR(gaussian.at(Channel::Opacity, 8, 9), std::exp(-0.5 / (0.3 + 1e-6)), 1e-5);
        EXPECT_NEAR(ray.at(Channel::Opacity, 8, 9), std::exp(-1.0), 1e-5);
    }
}

TEST(SplatOracle, S2TiltedSurfelHasTheLinearAndTheExactDepth) {
    const double focal = 200, z = 2.0, phi = 0.6, sigma = 0.06;
    const Camera camera = straightCamera(64, 48, focal, 32.5, 24.5);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        Surfels s;
        addSurfel(s, {0, 0, z}, {std::sin(phi), 0, -std::cos(phi)}, sigma, sigma, 0.9);
        const Pictures linear = renderer.render(kGaussian, s, camera, kGeometry);
        const Pictures exact = renderer.render(kGaussianExact, s, camera, kGeometry);
        const Pictures filtered = renderer.render({.depth = DepthMode::Filtered}, s, camera, kGeometry);
        const Pictures ray = renderer.render(kRay, s, camera, kGeometry);
        for (int column = 24; column < 41; ++column) {
            const double a = (column + 0.5 - camera.cx) / focal;
            const double zLinear = z * (1 + a * std::tan(phi)), zExact = z / (1 - a * std::tan(phi));
            EXPECT_NEAR(linear.at(Channel::Depth, 24, column), zLinear, 1e-5);
            EXPECT_NEAR(exact.at(Channel::Depth, 24, column), zExact, 1e-5);
            EXPECT_NEAR(ray.at(Channel::Depth, 24, column), zExact, 1e-5);
            EXPECT_NEAR((zExact - zLinear) / zExact, std::pow(a * std::tan(phi), 2), 1e-12);
            const double variance = std::pow(focal * sigma * std::cos(phi) / z, 2) + 0.3;
            const double offset = focal * a;
            // The mean of z given the offset: the covariance of z and x on the disc over the widened variance of x.
            const double covariance = sigma * std::sin(phi) * sigma * std::cos(phi) * focal / z;
            EXPECT_NEAR(filtered.at(Channel::Depth, 24, column), z + covariance * offset / variance, 1e-5);
            EXPECT_NEAR(filtered.at(Channel::Opacity, 24, column), linear.at(Channel::Opacity, 24, column), 1e-7);
            EXPECT_NEAR(linear.at(Channel::Opacity, 24, column), limitedAlpha(0.9, -0.5 * offset * offset / variance),
                        3e-6);
            // 2DGS: distance along the disc from the mean to where the ray meets it.
            const double along = zExact * a * std::cos(phi) + (zExact - z) * std::sin(phi);
            const double rho = std::min(std::pow(along / sigma, 2), 2 * offset * offset);
            EXPECT_NEAR(ray.at(Channel::Opacity, 24, column), limitedAlpha(0.9, -0.5 * rho), 1e-5);
        }
        for (int row = 14; row < 35; ++row) {
            const double offset = row + 0.5 - camera.cy, variance = std::pow(focal * sigma / z, 2) + 0.3;
            EXPECT_NEAR(linear.at(Channel::Opacity, row, 32), limitedAlpha(0.9, -0.5 * offset * offset / variance),
                        3e-6);
        }
        const glm::dvec3 normal(std::sin(phi), 0, -std::cos(phi));
        EXPECT_NEAR(glm::distance(linear.vec(Channel::Normal, 24, 32), normal), 0, 1e-6);
    }
}

TEST(SplatOracle, S3TwoSurfelsBlendInDepthOrderWhateverTheirOrderInMemory) {
    const Camera camera = straightCamera(24, 24, 200, 12.5, 12.5);
    const double a1 = 0.6, a2 = 0.7, z1 = 1.5, z2 = 2.0;
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {kGaussian, kRay}) {
            Pictures pictures[2];
            for (const int swapped : {0, 1}) {
                Surfels s;
                for (const int i : {swapped, 1 - swapped}) {
                    addSurfel(s, {0, 0, i == 0 ? z1 : z2}, {0, 0, -1}, 0.05, 0.05, i == 0 ? a1 : a2);
                    s.radii.back() = i == 0 ? 0.1f : 0.3f;
                }
                pictures[swapped] = renderer.render(params, s, camera, {Channel::Depth, Channel::Radius});
                const double opacity = 1 - (1 - a1) * (1 - a2), behind = (1 - a1) * a2;
                EXPECT_NEAR(pictures[swapped].at(Channel::Opacity, 12, 12), opacity, 1e-6);
                EXPECT_NEAR(pictures[swapped].at(Channel::Depth, 12, 12), (a1 * z1 + behind * z2) / opacity, 2e-6);
                EXPECT_NEAR(pictures[swapped].at(Channel::Radius, 12, 12), (a1 * 0.1 + behind * 0.3) / opacity, 1e-6);
            }
            EXPECT_EQ(pictures[0].channels, pictures[1].channels);
        }
    }
}

TEST(SplatOracle, S3EqualDepthsKeepTheOrderOfTheirIndices) {
    const Camera camera = straightCamera(16, 16, 100, 8.5, 8.5);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        Surfels s;
        for (int i = 0; i < 5; ++i) {
            addSurfel(s, {0, 0, 2}, {0, 0, -1}, 0.05, 0.05, 0.5);
            s.radii.back() = static_cast<float>(i);
        }
        // weights 1/2, 1/4, 1/8, 1/16, 1/32
        const double sum = (1.0 / 4 + 2.0 / 8 + 3.0 / 16 + 4.0 / 32) / (31.0 / 32);
        EXPECT_NEAR(renderer.render(kGaussian, s, camera, {Channel::Radius}).at(Channel::Radius, 8, 8), sum, 1e-6);
    }
}

/// Surfels of alpha 1/2 at the centre of one pixel: 13 leave T = 2^-13 = 1.22e-4, a 14th would leave less than 1e-4, so
/// the pixel ends for good, also for a later one of alpha 0.1 that would have left 1.1e-4.
TEST(SplatOracle, S3PixelsEndBeforeTheirTransmittanceFallsBelowTheLimit) {
    const Camera camera = straightCamera(16, 16, 100, 8.5, 8.5);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {kGaussian, kRay}) {
            for (const int count : {13, 14, 300}) { // 300: more than one staged batch
                Surfels s;
                for (int i = 0; i < count; ++i) addSurfel(s, {0, 0, 2 + 0.001 * i}, {0, 0, -1}, 0.05, 0.05, 0.5);
                addSurfel(s, {0, 0, 3}, {0, 0, -1}, 0.05, 0.05, 0.1);
                const double left = std::pow(0.5, 13) * (count == 13 ? 0.9 : 1.0);
                EXPECT_NEAR(renderer.render(params, s, camera, {}).at(Channel::Opacity, 8, 8), 1 - left, 1e-6);
            }
        }
    }
}

/// A tilted surfel outside the field: Sigma'_xx = (f s / z)^2 (t.x - slope t.z)^2 + 0.3 with the slope held at its
/// limit, (1.15 W - cx) / f, instead of x/z = 1.
TEST(SplatOracle, SlopeIsLimitedInsideTheJacobian) {
    const double focal = 30, sigma = 0.5, opacity = 0.9;
    const Camera camera = straightCamera(32, 33, focal, 12, 16.5);
    const double limit = (1.15 * 32 - 12) / focal, half = std::sqrt(0.5);
    const double variance = std::pow(focal * sigma / 2 * half * (1 + limit), 2) + 0.3;
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        Surfels s;
        addSurfel(s, {2, 0, 2}, {-half, 0, -half}, sigma, sigma, opacity);
        const Pictures pictures = renderer.render(kGaussian, s, camera, {});
        for (int column = 24; column < 32; ++column) {
            const double offset = column + 0.5 - (12 + focal);
            EXPECT_NEAR(pictures.at(Channel::Opacity, 16, column),
                        limitedAlpha(opacity, -0.5 * offset * offset / variance), 3e-6);
        }
    }
}

TEST(SplatOracle, S4BackFacesAreCulledByOneKernelAndFlippedByTheOther) {
    const Camera camera = straightCamera(32, 32, 200, 16, 16);
    const glm::dvec3 front = glm::normalize(glm::dvec3(0.3, 0.2, -1));
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        Surfels facing, turned;
        addSurfel(facing, {0, 0, 2}, front, 0.05, 0.05, 0.9);
        turned = facing;
        // Half a turn about the surfel's own first tangent: q (0, 1, 0, 0).
        const std::vector<float> q = facing.rotations;
        turned.rotations = {-q[1], q[0], q[3], -q[2]};
        const Pictures none = renderer.render(kGaussian, turned, camera, kGeometry);
        EXPECT_EQ(none.channels.at(Channel::Opacity), std::vector<double>(32 * 32, 0.0));
        EXPECT_EQ(none.stats.of(SurfelFate::BackFacing), 1u);
        for (const SplatParams& params : {kRay, SplatParams{.twoSided = true}}) {
            const Pictures seen = renderer.render(params, turned, camera, kGeometry);
            const Pictures expected = renderer.render(params, facing, camera, kGeometry);
            for (const auto& [channel, values] : expected.channels) {
                for (std::size_t i = 0; i < values.size(); ++i) {
                    ASSERT_NEAR(seen.channels.at(channel)[i], values[i], 2e-5) << channelName(channel);
                }
            }
            EXPECT_NEAR(glm::distance(seen.vec(Channel::Normal, 16, 16), front), 0, 1e-6);
        }
    }
}

TEST(SplatOracle, S5ConstantFeaturesStayConstantWhereverThereIsOpacity) {
    const Camera camera = straightCamera(56, 40, 45, 30.2, 17.7);
    Surfels s = randomSurfels(300, 5);
    for (std::size_t i = 0; i < s.count(); ++i) {
        s.radii[i] = 0.123f;
        s.importances[i] = 1.0f;
        s.albedos[i] = {0.2f, 0.4f, 0.8f};
        s.bones[i] = {0.6f, 0.0f, 0.8f};
    }
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {kGaussian, kRay}) {
            const Pictures pictures = renderer.render(params, s, camera, kAllChannels);
            int covered = 0;
            for (int row = 0; row < camera.height; ++row) {
                for (int column = 0; column < camera.width; ++column) {
                    const bool there = pictures.at(Channel::Opacity, row, column) > kMinOpacity;
                    covered += there;
                    ASSERT_NEAR(pictures.at(Channel::Radius, row, column), there ? 0.123 : 0, 3e-6);
                    ASSERT_NEAR(pictures.at(Channel::Importance, row, column), there ? 1 : 0, 1e-5);
                    ASSERT_NEAR(pictures.at(Channel::Albedo, row, column, 1), there ? 0.4 : 0, 1e-5);
                    ASSERT_NEAR(pictures.at(Channel::Bone, row, column, 2), there ? 0.8 : 0, 1e-5);
                    ASSERT_NEAR(glm::length(pictures.vec(Channel::Normal, row, column)), there ? 1 : 0, 1e-5);
                }
            }
            EXPECT_GT(covered, 500);
        }
    }
}

/// Weights sum to 1 - T, in the order of depth, and make the pictures.
TEST(SplatOracle, S5ContributorsPartitionTheOpacity) {
    const Camera camera = straightCamera(50, 37, 45, 24, 18);
    const Surfels s = randomSurfels(400, 6);
    for (const Device& device : devicesUnderTest()) {
        for (const SplatParams& params : {kGaussian, kRay}) {
            const DeviceSurfels there(s, device);
            SplatWorkspace workspace;
            GBuffer gbuffer;
            ContributorLists lists;
            SplatStats stats;
            ASSERT_TRUE(splat(params, there.view(), camera, kAllChannels, gbuffer, workspace, &lists, &stats).ok());
            const Pictures pictures = download(gbuffer);
            std::vector<std::uint64_t> starts(50 * 37 + 1);
            std::vector<std::uint32_t> surfels(lists.entries);
            std::vector<float> weights(lists.entries);
            ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(starts)), lists.starts).ok());
            ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(surfels)), lists.surfels).ok());
            ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(weights)), lists.weights).ok());
            ASSERT_EQ(starts.back(), lists.entries);
            EXPECT_EQ(stats.blended, lists.entries);
            for (std::size_t p = 0; p + 1 < starts.size(); ++p) {
                double sum = 0, radius = 0;
                for (std::uint64_t e = starts[p]; e < starts[p + 1]; ++e) {
                    ASSERT_LT(surfels[e], s.count());
                    if (e > starts[p]) {
                        ASSERT_LE(s.means[surfels[e - 1]].z, s.means[surfels[e]].z);
                    }
                    sum += weights[e];
                    radius += weights[e] * s.radii[surfels[e]];
                }
                ASSERT_NEAR(sum, pictures.channels.at(Channel::Opacity)[p], 1e-6);
                if (sum > 2 * kMinOpacity) {
                    ASSERT_NEAR(radius / sum, pictures.channels.at(Channel::Radius)[p], 1e-5);
                }
            }
        }
    }
}

/// A sheet z = z0 + k x of overlapping surfels. Linear depth is off by z q^2 with q = k a / (1 + k x/z)... at most
/// z (3 px k / f)^2 here; the exact kernels by rounding alone.
TEST(SplatOracle, S6PlanarSheetHasItsDepthAndItsNormal) {
    const double z0 = 2.0, k = 0.5, focal = 80;
    const Camera camera = straightCamera(48, 48, focal, 20.0, 27.0);
    Surfels s;
    const glm::dvec3 normal = glm::normalize(glm::dvec3(k, 0, -1));
    for (double y = -1.2; y <= 1.2; y += 0.04) {
        for (double x = -1.2; x <= 1.6; x += 0.04) addSurfel(s, {x, y, z0 + k * x}, normal, 0.03, 0.03, 0.9);
    }
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {kGaussian, kGaussianExact, kRay}) {
            const bool exact = params.depth == DepthMode::Exact || params.kernel == SurfelKernel::RaySplat;
            const Pictures pictures = renderer.render(params, s, camera, kGeometry);
            auto point = [&](int row, int column) {
                return pictures.at(Channel::Depth, row, column) * glm::dvec3(camera.ray(column + 0.5, row + 0.5));
            };
            for (int row = 2; row < camera.height - 2; ++row) {
                for (int column = 2; column < camera.width - 2; ++column) {
                    const double expected = z0 / (1 - k * (column + 0.5 - camera.cx) / focal);
                    ASSERT_GT(pictures.at(Channel::Opacity, row, column), 0.95);
                    ASSERT_NEAR(pictures.at(Channel::Depth, row, column), expected,
                                exact ? 1e-5 * expected : 1.5e-3 * expected);
                    ASSERT_NEAR(glm::distance(pictures.vec(Channel::Position, row, column), point(row, column)), 0,
                                1e-5);
                    ASSERT_NEAR(glm::distance(pictures.vec(Channel::Normal, row, column), normal), 0, 1e-5);
                    const glm::dvec3 fromDepth =
                        glm::normalize(glm::cross(point(row, column + 1) - point(row, column - 1),
                                                  point(row - 1, column) - point(row + 1, column)));
                    ASSERT_GT(glm::dot(fromDepth, normal), 1 - 1e-3);
                }
            }
        }
    }
}

/// A turned camera: normals and bones come out in camera space, positions in world space.
TEST(SplatOracle, SpacesAreThoseOfTheGBuffer) {
    const Camera camera = lookAtCamera({1.0, 0.5, 2.0}, {0, 0.3, 0}, 40, 33, 33);
    const glm::dvec3 mean(0, 0.3, 0), towards = glm::normalize(camera.centerWorld() - mean);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        Surfels s;
        addSurfel(s, mean, towards, 0.05, 0.05, 0.95);
        s.bones[0] = {0, 1, 0};
        for (const SplatParams& params : {kGaussian, kRay}) {
            const Pictures pictures = renderer.render(params, s, camera, kAllChannels);
            EXPECT_NEAR(glm::distance(pictures.vec(Channel::Normal, 16, 16), glm::dvec3(0, 0, -1)), 0, 1e-6);
            EXPECT_NEAR(glm::distance(pictures.vec(Channel::Position, 16, 16), mean), 0, 1e-5);
            EXPECT_NEAR(glm::distance(pictures.vec(Channel::Bone, 16, 16), camera.rotation * glm::dvec3(0, 1, 0)), 0,
                        1e-6);
            EXPECT_NEAR(pictures.at(Channel::Depth, 16, 16), glm::length(camera.centerWorld() - mean), 1e-5);
        }
    }
}

/// Reference 1.2: inside the Jacobian x/z stays within the picture's field widened by 15 % on either side, here for a
/// principal point near the left edge; the same limits as 1.3 tan(fov/2) for a central one.
TEST(SplatOracle, SlopeLimitFollowsThePrincipalPoint) {
    const SplatView<double> central =
        splatView(straightCamera(200, 100, 80, 100, 50), SurfelKernel::GaussianSurfel, false);
    EXPECT_NEAR(central.maxSlope.x, 1.3 * 100 / 80.0, 1e-12);
    EXPECT_NEAR(central.minSlope.x, -1.3 * 100 / 80.0, 1e-12);
    EXPECT_NEAR(central.maxSlope.y, 1.3 * 50 / 80.0, 1e-12);
    const SplatView<double> shifted =
        splatView(straightCamera(200, 100, 80, 10, 50), SurfelKernel::GaussianSurfel, false);
    EXPECT_NEAR(shifted.maxSlope.x, (190 + 30) / 80.0, 1e-12);
    EXPECT_NEAR(shifted.minSlope.x, (-10 - 30) / 80.0, 1e-12);
}

/// Moving the principal point by whole pixels moves the picture by whole pixels.
TEST(SplatOracle, PrincipalPointShiftsThePicture) {
    const Surfels s = randomSurfels(200, 9);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        const Pictures left = renderer.render(kGaussianExact, s, straightCamera(64, 32, 60, 20, 16), kGeometry);
        const Pictures right = renderer.render(kGaussianExact, s, straightCamera(64, 32, 60, 36, 16), kGeometry);
        int different = 0;
        for (int row = 0; row < 32; ++row) {
            for (int column = 4; column < 44; ++column) {
                const double a = left.at(Channel::Opacity, row, column),
                             b = right.at(Channel::Opacity, row, column + 16);
                different += std::abs(a - b) > 2e-4;
            }
        }
        // Wide surfels whose mean lies outside the picture meet the slope limit, which moves with the principal point.
        EXPECT_LT(different, 64 * 32 / 50);
    }
}

} // namespace
} // namespace ars::test
