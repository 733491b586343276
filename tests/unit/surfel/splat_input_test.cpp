#include "tests/unit/surfel/splat_support.h"

#include <numeric>

#include <nlohmann/json.hpp>

#include <limits>

// What is wrong with the input gets a sentence or a defined picture.
namespace ars::test {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

Status splatError(const Surfels& surfels, const Camera& camera, ChannelSet wanted) {
    SplatWorkspace workspace;
    GBuffer gbuffer;
    Status status = splat({}, viewOf(surfels), camera, wanted, gbuffer, workspace);
    EXPECT_TRUE(status.ok() || gbuffer.channels == ChannelSet{});
    return status;
}

void expectSentence(const Status& status, ErrorCode code, const std::string& part) {
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, code);
    EXPECT_NE(status.error().describe().find(part), std::string::npos) << status.error().describe();
}

TEST(SplatInput, UnsoundCamerasAreRefused) {
    const Surfels s = randomSurfels(3, 1);
    const Camera sound = straightCamera(20, 20, 20, 10, 10);
    Camera c = sound;
    c.width = 0;
    expectSentence(splatError(s, c, {}), ErrorCode::InvalidArgument, "0x20");
    c = sound;
    c.fx = 0;
    expectSentence(splatError(s, c, {}), ErrorCode::InvalidArgument, "focal");
    c = sound;
    c.cx = std::numeric_limits<double>::quiet_NaN();
    expectSentence(splatError(s, c, {}), ErrorCode::InvalidArgument, "not finite");
    c = sound;
    c.rotation = glm::dmat3(0.0);
    expectSentence(splatError(s, c, {}), ErrorCode::InvalidArgument, "no rotation");
    c = sound;
    c.translation.y = std::numeric_limits<double>::infinity();
    expectSentence(splatError(s, c, {}), ErrorCode::InvalidArgument, "not finite");
}

TEST(SplatInput, AMissingAttributeIsNamed) {
    const Camera camera = straightCamera(20, 20, 20, 10, 10);
    Surfels s = randomSurfels(3, 1);
    s.radiiPlus.clear();
    expectSentence(splatError(s, camera, kAllChannels), ErrorCode::InvalidArgument, "radiiPlus");
    s.colors.clear();
    expectSentence(splatError(s, camera, {Channel::Radiance}), ErrorCode::InvalidArgument, "colors");
    EXPECT_TRUE(splatError(s, camera, {Channel::Normal, Channel::Position, Channel::Depth}).ok());
    SurfelView view = viewOf(s);
    view.rotations = nullptr;
    SplatWorkspace workspace;
    GBuffer gbuffer;
    expectSentence(splat({}, view, camera, {}, gbuffer, workspace), ErrorCode::InvalidArgument, "rotations");
    view.count = std::size_t(1) << 40;
    expectSentence(splat({}, view, camera, {}, gbuffer, workspace), ErrorCode::LimitExceeded, "2147483647");
}

TEST(SplatInput, NoSurfelsGiveEmptyPictures) {
    const Camera camera = straightCamera(21, 18, 20, 10, 10);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        const Pictures pictures = renderer.render({}, Surfels{}, camera, kAllChannels);
        for (const auto& [channel, values] : pictures.channels) {
            EXPECT_EQ(values, std::vector<double>(values.size(), 0.0)) << channelName(channel);
        }
        EXPECT_EQ(pictures.channels.size(), static_cast<std::size_t>(kChannelCount));
    }
}

/// One broken surfel of each kind beside sound ones: counted under its own fate, and the picture is that of the others.
TEST(SplatInput, BrokenSurfelsAreLeftOutAndCounted) {
    struct Case {
        const char* name;
        SurfelFate fate;
        std::function<void(Surfels&, std::size_t)> harm;
    };
    const Case cases[] = {
        {"NaN mean", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.means[i].y = kNaN; }},
        {"infinite mean", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.means[i].z = kInfinity; }},
        {"NaN quaternion", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.rotations[4 * i + 2] = kNaN; }},
        {"NaN scale", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.scales[i].x = kNaN; }},
        {"NaN opacity", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.opacities[i] = kNaN; }},
        {"NaN colour", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.colors[i].z = kNaN; }},
        {"infinite radius", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.radii[i] = kInfinity; }},
        {"huge mean", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.means[i] = glm::vec3(3e38f); }},
        {"huge scale", SurfelFate::NotFinite, [](Surfels& s, std::size_t i) { s.scales[i] = glm::vec2(1e30f); }},
        {"far to the side", SurfelFate::OutsidePicture, [](Surfels& s, std::size_t i) { s.means[i] = {1e3f, 0, 2}; }},
        {"zero scale", SurfelFate::Degenerate, [](Surfels& s, std::size_t i) { s.scales[i].y = 0; }},
        {"negative scale", SurfelFate::Degenerate, [](Surfels& s, std::size_t i) { s.scales[i].y = -1; }},
        {"zero quaternion", SurfelFate::Degenerate,
         [](Surfels& s, std::size_t i) {
             std::fill_n(s.rotations.begin() + static_cast<std::ptrdiff_t>(4 * i), 4, 0.0f);
         }},
        {"transparent", SurfelFate::Transparent, [](Surfels& s, std::size_t i) { s.opacities[i] = 0.0039f; }},
        {"negative opacity", SurfelFate::Transparent, [](Surfels& s, std::size_t i) { s.opacities[i] = -5; }},
        {"behind", SurfelFate::TooNear, [](Surfels& s, std::size_t i) { s.means[i].z = -2; }},
        {"in the lens", SurfelFate::TooNear, [](Surfels& s, std::size_t i) { s.means[i] = {0, 0, 0.009f}; }},
        {"edge-on", SurfelFate::Grazing,
         [](Surfels& s, std::size_t i) {
             s.means[i] = {0, 0, 2.5f};
             const auto q = rotationTo(glm::normalize(glm::dvec3(1, 0, -0.0099)));
             std::copy(q.begin(), q.end(), s.rotations.begin() + static_cast<std::ptrdiff_t>(4 * i));
         }},
    };
    const Camera camera = straightCamera(40, 30, 40, 20, 15);
    for (const Renderer& renderer : renderers()) {
        if (renderer.name.starts_with("reference")) continue; // looks at attributes only where it blends them
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {SplatParams{}, SplatParams{.kernel = SurfelKernel::RaySplat}}) {
            for (const Case& one : cases) {
                SCOPED_TRACE(one.name);
                Surfels harmed = randomSurfels(20, 77), sound = harmed;
                one.harm(harmed, 7);
                sound.opacities[7] = 0; // leaves it out
                const Pictures found = renderer.render(params, harmed, camera, kAllChannels);
                const Pictures expected = renderer.render(params, sound, camera, kAllChannels);
                EXPECT_EQ(found.channels, expected.channels);
                EXPECT_EQ(found.stats.visible(), expected.stats.visible());
                std::uint64_t sum = 0;
                for (const std::uint64_t fate : found.stats.fates) sum += fate;
                EXPECT_EQ(sum, 20u);
                const std::uint64_t extra = one.fate == SurfelFate::Transparent ? 0 : 1;
                EXPECT_EQ(found.stats.of(one.fate), expected.stats.of(one.fate) + extra) << surfelFateName(one.fate);
            }
        }
    }
}

/// Numbers from 1e-38 to 1e38 everywhere: no trap, no overflow of an integer (the sanitizers watch), and no picture
/// that is not finite where the attributes are small.
TEST(SplatInput, AnyFloatsGiveFinitePictures) {
    std::mt19937 random(5);
    std::uniform_real_distribution<float> exponent(-38, 38), unit(0, 1);
    auto wild = [&] { return (unit(random) < 0.5f ? -1.0f : 1.0f) * std::pow(10.0f, exponent(random)); };
    Surfels s = randomSurfels(3000, 6);
    for (std::size_t i = 0; i < s.count(); ++i) {
        if (unit(random) < 0.4f) s.means[i][static_cast<int>(i % 3)] = wild();
        if (unit(random) < 0.4f) s.scales[i] = {std::abs(wild()), std::abs(wild())};
        if (unit(random) < 0.2f) s.rotations[4 * i + i % 4] = wild();
        if (unit(random) < 0.2f) s.opacities[i] = wild();
    }
    const Camera camera = straightCamera(48, 40, 40, 20, 15);
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        for (const SplatParams& params : {SplatParams{}, SplatParams{.depth = DepthMode::Exact, .twoSided = true},
                                          SplatParams{.kernel = SurfelKernel::RaySplat}}) {
            const Pictures pictures = renderer.render(params, s, camera, kAllChannels);
            for (const double opacity : pictures.channels.at(Channel::Opacity)) {
                ASSERT_GE(opacity, 0);
                ASSERT_LE(opacity, 1);
            }
            for (const Channel channel : {Channel::Normal, Channel::Albedo, Channel::Radius, Channel::Bone}) {
                for (const double value : pictures.channels.at(channel)) ASSERT_TRUE(std::abs(value) <= 1.001);
            }
        }
    }
}

/// A disc that reaches behind the camera has no bounding ellipse; it still ends at the picture's edges.
TEST(SplatInput, ADiscThroughTheCamerasPlaneStillCoversThePicture) {
    const Camera camera = straightCamera(32, 32, 30, 16, 16);
    Surfels s;
    addSurfel(s, {0, 0.5, 1.0}, {0, -1, 0}, 2.0, 2.0, 0.9); // a floor half a metre below (y points down)
    for (const Renderer& renderer : renderers()) {
        SCOPED_TRACE(renderer.name);
        const Pictures pictures =
            renderer.render({.kernel = SurfelKernel::RaySplat}, s, camera, {Channel::Depth, Channel::Position});
        for (int row = 18; row < 32; ++row) {
            const double depth = 0.5 / ((row + 0.5 - 16) / 30);
            if (depth > 9 || depth < 0.11) continue; // beyond ten times the centre's depth it is left out
            EXPECT_NEAR(pictures.at(Channel::Depth, row, 20), depth, 1e-4 * depth);
            EXPECT_NEAR(pictures.at(Channel::Position, row, 20, 1), 0.5, 1e-4);
        }
        EXPECT_EQ(pictures.at(Channel::Opacity, 8, 20), 0);
    }
}

/// Memory for an absurd amount of work is refused in words. (The surfels lie at one address: only their number is
/// large.)
TEST(SplatInput, TooLittleMemoryIsASentence) {
    const Surfels s = randomSurfels(1, 1);
    SurfelView view = viewOf(s);
    view.count = 2147483647; // needs 137 GB before the first surfel is read
    const auto memory = deviceMemory({});
    if (memory && memory->freeBytes > 2147483647ull * 64) return; // a machine that has it would go on to read them
    SplatWorkspace workspace;
    GBuffer gbuffer;
    expectSentence(splat({}, view, straightCamera(8, 8, 8, 4, 4), {}, gbuffer, workspace), ErrorCode::OutOfMemory,
                   "splat: projected surfels");
    EXPECT_EQ(gbuffer.channels, ChannelSet{});
}

TEST(SplatInput, ParametersHaveATable) {
    SplatParams params;
    const auto& table = splatParameters();
    ASSERT_TRUE(table.setText(params, "kernel", "ray_splat").ok());
    ASSERT_TRUE(table.setText(params, "depth", "exact").ok());
    ASSERT_TRUE(table.setText(params, "two_sided", "true").ok());
    EXPECT_EQ(params.kernel, SurfelKernel::RaySplat);
    EXPECT_EQ(params.depth, DepthMode::Exact);
    EXPECT_TRUE(params.twoSided);
    EXPECT_FALSE(table.setText(params, "kernel", "box").ok());
    EXPECT_EQ(table.toJson(params)["kernel"], "ray_splat");
}

/// A cloud far beyond any avatar: everything is counted in 64 bits and nothing grows with the square.
TEST(SplatInput, TenMillionSurfelsAreAPicture) {
    const std::size_t count = 10'000'000;
    Surfels s;
    s.means.resize(count);
    s.rotations.assign(4 * count, 0.0f);
    s.scales.assign(count, glm::vec2(1e-3f));
    s.opacities.assign(count, 0.5f);
    for (std::size_t i = 0; i < count; ++i) {
        // A box of points before the camera, each seen from its front (half a turn about x).
        s.means[i] = {0.8f * (static_cast<float>(i % 1000) / 1000.0f - 0.5f),
                      0.8f * (static_cast<float>(i / 1000 % 1000) / 1000.0f - 0.5f),
                      2.0f + 0.01f * static_cast<float>(i / 1'000'000)};
        s.rotations[4 * i + 1] = 1.0f;
    }
    GBuffer gbuffer;
    SplatWorkspace workspace;
    SplatStats stats;
    const Status status = splat({}, viewOf(s), straightCamera(64, 64, 80, 32, 32), {Channel::Opacity, Channel::Depth},
                                gbuffer, workspace, nullptr, &stats);
    ASSERT_TRUE(status.ok()) << status.error().describe();
    EXPECT_EQ(stats.surfels, count);
    EXPECT_EQ(std::accumulate(stats.fates.begin(), stats.fates.end(), std::uint64_t(0)), count);
    EXPECT_EQ(stats.visible(), count);
    EXPECT_GE(stats.instances, count);
    const auto depth = gbuffer[Channel::Depth].view();
    EXPECT_NEAR(depth[32 * 64 + 32], 2.0f, 1e-3f) << "the nearest layer hides the others";
}

} // namespace
} // namespace ars::test
