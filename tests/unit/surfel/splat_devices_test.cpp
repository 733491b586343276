#include "tests/unit/surfel/splat_support.h"

// One picture, many ways: the fast paths against the slow twin in double, against one another, and against themselves
// with other threads and another order in memory (S8).
namespace ars::test {
namespace {

constexpr SplatParams kGaussian{};
constexpr SplatParams kGaussianExact{.depth = DepthMode::Exact};
constexpr SplatParams kRay{.kernel = SurfelKernel::RaySplat};

/// Largest allowed difference of a channel: absolute for those within [0, 1], more where little opacity is divided by
/// itself, and with the square of the depth for metres (planes that run away from their centres: z = p_z / (1 + q)).
double tolerance(Channel channel, double opacity, double depth) {
    const bool spatial = channel == Channel::Depth || channel == Channel::Position;
    const double scale = channel == Channel::Opacity ? 1 : 1 / std::max(0.02, opacity);
    return 1e-5 * (spatial ? 2 * std::max(1.0, depth * depth) : 1) * scale;
}

struct Comparison {
    int different = 0; ///< pixels with a value further off than the tolerance
    int excused = 0;   ///< of these, pixels where an alpha is within 1e-4 of 1/255 or a transmittance of 1e-4
    double worst = 0;  ///< largest difference at pixels that are not excused
};

Comparison compare(const Pictures& found, const Pictures& expected, const std::vector<ReferencePixel>& pixels) {
    Comparison result;
    const auto count = static_cast<std::size_t>(found.width * found.height);
    for (std::size_t p = 0; p < count; ++p) {
        const double opacity = expected.channels.at(Channel::Opacity)[p];
        const double depth = expected.channels.at(Channel::Depth)[p];
        double worst = 0;
        for (const auto& [channel, values] : expected.channels) {
            const auto parts = static_cast<std::size_t>(channelWidth(channel));
            for (std::size_t k = p * parts; k < (p + 1) * parts; ++k) {
                const double off = std::abs(found.channels.at(channel)[k] - values[k]);
                worst = std::max(worst, std::isfinite(off) ? off / tolerance(channel, opacity, depth) : 1e9);
            }
        }
        const bool threshold = pixels[p].margin < 1e-4 || std::abs(opacity - kMinOpacity) < 1e-5;
        if (worst > 1) {
            ++result.different;
            result.excused += threshold;
        }
        if (!threshold) result.worst = std::max(result.worst, worst);
    }
    return result;
}

class SplatAgainstReference : public ::testing::TestWithParam<int> {};

TEST_P(SplatAgainstReference, EveryPathEqualsTheDoubleTwin) {
    const SplatParams all[] = {kGaussian, kGaussianExact, kRay, {.twoSided = true}, {.depth = DepthMode::Filtered}};
    const SplatParams params = all[GetParam()];
    // A side that is no multiple of a tile, a principal point near a corner, more than one staged batch per tile.
    const Camera camera = straightCamera(75, 53, 55, 22.7, 40.2);
    const Surfels s = randomSurfels(2500, 100u + static_cast<unsigned>(GetParam()));
    std::vector<ReferencePixel> pixels;
    const Pictures expected = referenceSplat<double>(params, s, camera, kAllChannels, &pixels);
    std::size_t longest = 0;
    for (const ReferencePixel& pixel : pixels) longest = std::max(longest, pixel.contributors.size());
    EXPECT_GT(longest, 8u);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        const Comparison c = compare(renderer.render(params, s, camera, kAllChannels), expected, pixels);
        std::printf("%s: worst %.2f of the tolerance, %d threshold pixels differ\n", renderer.name.c_str(), c.worst,
                    c.excused);
        EXPECT_EQ(c.different, c.excused);
        EXPECT_LT(c.excused, 75 * 53 / 100);
    }
}
INSTANTIATE_TEST_SUITE_P(Kernels, SplatAgainstReference, ::testing::Range(0, 5));

TEST(SplatDevices, ContributorsAreThoseOfTheDoubleTwin) {
    const Camera camera = straightCamera(40, 33, 35, 20, 16);
    const Surfels s = randomSurfels(900, 8);
    for (const SplatParams& params : {kGaussian, kRay}) {
        std::vector<ReferencePixel> pixels;
        referenceSplat<double>(params, s, camera, {}, &pixels);
        for (const Device& device : devicesUnderTest()) {
            const DeviceSurfels there(s, device);
            for (const CpuPath path : availableCpuPaths()) {
                SplatWorkspace workspace;
                workspace.setCpuPath(path);
                GBuffer gbuffer;
                ContributorLists lists;
                ASSERT_TRUE(splat(params, there.view(), camera, {}, gbuffer, workspace, &lists).ok());
                std::vector<std::uint64_t> starts(pixels.size() + 1);
                std::vector<std::uint32_t> surfels(lists.entries);
                std::vector<float> weights(lists.entries);
                ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(starts)), lists.starts).ok());
                ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(surfels)), lists.surfels).ok());
                ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(weights)), lists.weights).ok());
                for (std::size_t p = 0; p < pixels.size(); ++p) {
                    if (pixels[p].margin < 1e-4) continue;
                    ASSERT_EQ(starts[p + 1] - starts[p], pixels[p].contributors.size());
                    for (std::size_t k = 0; k < pixels[p].contributors.size(); ++k) {
                        ASSERT_EQ(surfels[starts[p] + k], pixels[p].contributors[k].first);
                        ASSERT_NEAR(weights[starts[p] + k], pixels[p].contributors[k].second, 1e-5);
                    }
                }
            }
        }
    }
}

TEST(SplatDevices, S8OrderInMemoryDoesNotMatter) {
    const Camera camera = straightCamera(70, 41, 50, 30, 25);
    const Surfels s = randomSurfels(1500, 21);
    std::vector<std::size_t> order(s.count());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::shuffle(order.begin(), order.end(), std::mt19937(3));
    Surfels shuffled;
    for (const std::size_t i : order) {
        shuffled.means.push_back(s.means[i]);
        for (std::size_t k = 0; k < 4; ++k) shuffled.rotations.push_back(s.rotations[4 * i + k]);
        shuffled.scales.push_back(s.scales[i]);
        shuffled.opacities.push_back(s.opacities[i]);
        shuffled.radii.push_back(s.radii[i]);
    }
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {kGaussian, kRay}) {
            const ChannelSet wanted{Channel::Depth, Channel::Normal, Channel::Radius};
            const Pictures a = renderer.render(params, s, camera, wanted);
            const Pictures b = renderer.render(params, shuffled, camera, wanted);
            for (const auto& [channel, values] : a.channels) {
                for (std::size_t i = 0; i < values.size(); ++i) {
                    ASSERT_NEAR(b.channels.at(channel)[i], values[i], 1e-6) << channelName(channel);
                }
            }
        }
    }
}

/// Tiles: a picture cut out of a larger one (the principal point moved by less than a tile) falls differently into
/// tiles and sub-tiles, and must hold the same numbers to 1e-6... where the slope limit does not come in: no surfel is
/// wide.
TEST(SplatDevices, S8TileBordersDoNotMatter) {
    Surfels s;
    std::mt19937 random(4);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    for (int i = 0; i < 800; ++i) {
        const glm::dvec3 mean(0.6 * unit(random) - 0.3, 0.6 * unit(random) - 0.3, 2 + 0.5 * unit(random));
        addSurfel(s, mean, glm::normalize(glm::dvec3(unit(random) - 0.5, unit(random) - 0.5, -1)),
                  0.01 + 0.03 * unit(random), 0.02, 0.2 + 0.8 * unit(random), 6 * unit(random));
    }
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {kGaussian, kRay}) {
            const ChannelSet wanted{Channel::Depth, Channel::Radius};
            const Pictures whole = renderer.render(params, s, straightCamera(64, 64, 128, 32, 32), wanted);
            for (const int cut : {1, 7, 11}) {
                const Pictures part =
                    renderer.render(params, s, straightCamera(64 - cut, 64 - cut, 128, 32 - cut, 32 - cut), wanted);
                int different = 0;
                for (int row = cut; row < 64; ++row) {
                    for (int column = cut; column < 64; ++column) {
                        for (const Channel channel : {Channel::Opacity, Channel::Radius}) {
                            different += std::abs(part.at(channel, row - cut, column - cut) -
                                                  whole.at(channel, row, column)) > 2e-5;
                        }
                    }
                }
                // Means move against pixel centres by float rounding, so a threshold pixel may turn.
                EXPECT_LE(different, 4);
            }
        }
    }
}

TEST(SplatDevices, NumberOfThreadsDoesNotMatter) {
    const Camera camera = straightCamera(160, 120, 120, 80, 60);
    const Surfels s = randomSurfels(40000, 12); // more than one chunk in every parallel step
    const int before = threadCount();
    for (const CpuPath path : availableCpuPaths()) {
        for (const SplatParams& params : {kGaussian, kRay}) {
            setThreadCount(1);
            const Pictures one = deviceSplat({}, path, params, s, camera, kAllChannels);
            setThreadCount(5);
            const Pictures five = deviceSplat({}, path, params, s, camera, kAllChannels);
            EXPECT_EQ(one.channels, five.channels) << pathName(path);
            EXPECT_EQ(one.stats.blended, five.stats.blended);
            EXPECT_EQ(one.stats.fates, five.stats.fates);
        }
    }
    setThreadCount(before);
}

TEST(SplatDevices, AnAttributeMayBeLeftOut) {
    const Camera camera = straightCamera(40, 40, 40, 20, 20);
    const Surfels s = randomSurfels(300, 13);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        const Pictures all = renderer.render(kGaussian, s, camera, kAllChannels);
        for (const auto& [channel, values] : all.channels) {
            const Pictures alone = renderer.render(kGaussian, s, camera, {channel});
            EXPECT_EQ(alone.channels.size(), channel == Channel::Opacity ? 1u : 2u);
            for (std::size_t i = 0; i < values.size(); ++i) ASSERT_NEAR(alone.channels.at(channel)[i], values[i], 1e-6);
        }
    }
}

TEST(SplatDevices, WorkspaceAndPicturesServeAnyNextFrame) {
    for (const Device& device : devicesUnderTest()) {
        SplatWorkspace workspace;
        GBuffer gbuffer;
        for (const int side : {40, 90, 17}) {
            for (const std::size_t count : {2000u, 10u, 400u}) {
                const Camera camera = straightCamera(side, side + 3, side, side / 2.0, side / 2.0);
                const Surfels s = randomSurfels(count, 31);
                const DeviceSurfels there(s, device);
                const ChannelSet wanted = count == 10 ? ChannelSet{Channel::Depth} : kAllChannels;
                ASSERT_TRUE(splat(kGaussian, there.view(), camera, wanted, gbuffer, workspace, nullptr, nullptr).ok());
                const Pictures reused = download(gbuffer);
                const Pictures fresh = deviceSplat(device, CpuPath::Best, kGaussian, s, camera, wanted);
                EXPECT_EQ(reused.channels, fresh.channels);
            }
        }
        EXPECT_FALSE(workspace.incomplete());
    }
}

} // namespace
} // namespace ars::test
