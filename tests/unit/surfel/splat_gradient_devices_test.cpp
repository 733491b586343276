// Backward of splatting, many ways: every instruction set and device against CUDA's pass in plain loops, and against
// itself with other threads. What the numbers should be is splat_gradient_test.cpp's to say.
#include "tests/unit/surfel/splat_gradient_support.h"

#include <limits>
#include <utility>

namespace ars::test {
namespace {

/// dL/d of all pictures at random; those of empty pixels are not finite, because nobody may look at them.
struct RandomGradients {
    std::array<std::vector<float>, kChannelCount> values;
    GBufferGradients views;

    RandomGradients(const Camera& camera, ChannelSet channels, const Surfels& surfels, const SplatParams& params) {
        GBuffer gbuffer;
        SplatWorkspace workspace;
        EXPECT_TRUE(splat(params, viewOf(surfels), camera, channels, gbuffer, workspace).ok());
        std::mt19937 random(77);
        std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
        const ImageView<const float> opacity = std::as_const(gbuffer)[Channel::Opacity].view();
        for (int i = 0; i < kChannelCount; ++i) {
            const auto channel = static_cast<Channel>(i);
            if (!channels.has(channel)) continue;
            const auto width = static_cast<std::size_t>(channelWidth(channel));
            std::vector<float>& picture = values[static_cast<std::size_t>(i)];
            for (std::size_t k = 0; k < opacity.pixelCount() * width; ++k) {
                const bool empty = opacity[k / width] == 0.0f;
                picture.push_back(empty ? std::numeric_limits<float>::quiet_NaN() : unit(random));
            }
            views[channel] = {picture.data(), camera.width, camera.height, channelWidth(channel)};
        }
    }
};

std::vector<double> flat(const SurfelGradients& g, int attribute) {
    std::vector<double> numbers;
    const auto add = [&](const auto& values) {
        const auto* data = reinterpret_cast<const float*>(values.data());
        numbers.assign(data, data + values.size() * sizeof(values[0]) / sizeof(float));
    };
    switch (attribute) {
    case 0:
        add(g.means);
        break;
    case 1:
        add(g.rotations);
        break;
    case 2:
        add(g.scales);
        break;
    case 3:
        add(g.opacities);
        break;
    case 4:
        add(g.colors);
        break;
    case 5:
        add(g.albedos);
        break;
    case 6:
        add(g.roughnesses);
        break;
    case 7:
        add(g.radii);
        break;
    case 8:
        add(g.importances);
        break;
    default:
        add(g.bones);
    }
    return numbers;
}
constexpr int kAttributes = 10;

constexpr ChannelSet kFew{Channel::Opacity, Channel::Radiance};

class SplatGradientDevices : public ::testing::TestWithParam<int> {
protected:
    static SplatParams params() {
        const SplatParams all[] = {{},
                                   {.depth = DepthMode::Exact},
                                   {.kernel = SurfelKernel::RaySplat},
                                   {.twoSided = true},
                                   {.depth = DepthMode::Filtered}};
        return all[GetParam()];
    }
};

// Sides that are no multiples of a tile, more surfels per tile than one product takes, all channels and few.
TEST_P(SplatGradientDevices, EveryPathAgreesWithThePassOverLists) {
    const Camera camera = straightCamera(75, 53, 55, 22.7, 40.2);
    const Surfels surfels = randomSurfels(1500, 300u + static_cast<unsigned>(GetParam()));
    for (const ChannelSet& channels : {kAllChannels, kFew}) {
        const RandomGradients gradients(camera, channels, surfels, params());
        const BackwardCase everything{params(), surfels, camera, channels, gradients.views, {}};
        SurfelGradients expected;
        ASSERT_TRUE(emulatedBackward(everything, expected).ok());
        for (const Backward& backward : backwards()) {
            SCOPED_TRACE(backward.name);
            SurfelGradients got;
            ASSERT_TRUE(backward.run(everything, got).ok());
            for (int attribute = 0; attribute < kAttributes; ++attribute) {
                const std::vector<double> a = flat(got, attribute), b = flat(expected, attribute);
                ASSERT_EQ(a.size(), b.size());
                double off = 0.0, size = 0.0;
                for (std::size_t i = 0; i < a.size(); ++i) {
                    ASSERT_TRUE(std::isfinite(a[i])) << "attribute " << attribute << ", number " << i;
                    off += (a[i] - b[i]) * (a[i] - b[i]);
                    size += b[i] * b[i];
                }
                // Sums in another order, and other roundings of the exponential at the cut-offs.
                EXPECT_LE(std::sqrt(off), 1e-3 * std::sqrt(size)) << "attribute " << attribute;
                EXPECT_EQ(a.empty(), size == 0.0) << "attribute " << attribute;
            }
        }
    }
}
INSTANTIATE_TEST_SUITE_P(Kernels, SplatGradientDevices, ::testing::Range(0, 5));

TEST(SplatGradientDevice, NumberOfThreadsDoesNotMatter) {
    const Camera camera = straightCamera(160, 120, 120, 80, 60);
    const Surfels surfels = randomSurfels(20000, 12);
    const RandomGradients gradients(camera, kAllChannels, surfels, {});
    const BackwardCase everything{{}, surfels, camera, kAllChannels, gradients.views, {}};
    const int before = threadCount();
    for (const Backward& backward : backwards()) {
        SCOPED_TRACE(backward.name);
        SurfelGradients one, five;
        setThreadCount(1);
        ASSERT_TRUE(backward.run(everything, one).ok());
        setThreadCount(5);
        ASSERT_TRUE(backward.run(everything, five).ok());
        for (int attribute = 0; attribute < kAttributes; ++attribute) {
            EXPECT_EQ(flat(one, attribute), flat(five, attribute));
        }
    }
    setThreadCount(before);
}

TEST(SplatGradientDevice, ASurfelThatWasLeftOutGetsNothing) {
    const Camera camera = straightCamera(40, 40, 40, 20, 20);
    Surfels surfels = randomSurfels(200, 9);
    // Splatted, but without a gradient of its own: the surfel is left out of all pictures.
    surfels.roughnesses[17] = std::numeric_limits<float>::quiet_NaN();
    const ChannelSet channels{Channel::Opacity, Channel::Albedo, Channel::Roughness};
    RandomGradients gradients(camera, channels, surfels, {});
    gradients.views[Channel::Roughness] = {};
    for (const Backward& backward : backwards()) {
        SCOPED_TRACE(backward.name);
        SurfelGradients got;
        ASSERT_TRUE(backward.run({{}, surfels, camera, channels, gradients.views, {}}, got).ok());
        EXPECT_EQ(got.means[17], glm::vec3(0.0f));
        EXPECT_EQ(got.albedos[17], glm::vec3(0.0f));
        EXPECT_TRUE(got.roughnesses.empty());
    }
}

/// Lists as CUDA leaves them where a pixel was counted more entries than it has: some of weight 0 behind its own.
void addEmptyEntries(ContributorLists& lists, std::size_t surfels) {
    const std::size_t pixels = lists.starts.bytes() / sizeof(std::uint64_t) - 1;
    std::vector<std::uint64_t> starts{0};
    std::vector<std::uint32_t> slots;
    std::vector<float> weights;
    for (std::size_t p = 0; p < pixels; ++p) {
        const std::uint64_t begin = lists.starts.as<std::uint64_t>()[p], end = lists.starts.as<std::uint64_t>()[p + 1];
        for (std::uint64_t e = begin; e < end; ++e) {
            slots.push_back(lists.surfels.as<std::uint32_t>()[e]);
            weights.push_back(lists.weights.as<float>()[e]);
        }
        slots.insert(slots.end(), p % 3, static_cast<std::uint32_t>(surfels));
        weights.insert(weights.end(), p % 3, 0.0f);
        starts.push_back(slots.size());
    }
    const auto put = [](Buffer& buffer, const auto& values) {
        const auto bytes = std::as_bytes(std::span(values));
        buffer = Buffer::allocate({}, bytes.size(), "test: lists").value();
        ASSERT_TRUE(uploadBuffer(buffer, bytes).ok());
    };
    put(lists.starts, starts);
    put(lists.surfels, slots);
    put(lists.weights, weights);
    lists.entries = slots.size();
}

// The first surfel lies behind the camera: nothing was projected where an entry without a surfel might look.
TEST(SplatGradientDevice, EntriesOfWeightZeroSayNothing) {
    const Camera camera = straightCamera(45, 33, 40, 22, 16);
    Surfels surfels = randomSurfels(400, 31);
    surfels.means[0].z = -5.0f;
    const RandomGradients gradients(camera, kAllChannels, surfels, {});
    const BackwardCase everything{{}, surfels, camera, kAllChannels, gradients.views, {}};
    SurfelGradients plain, padded;
    ASSERT_TRUE(emulatedBackward(everything, plain).ok());
    ASSERT_TRUE(emulatedBackward(everything, padded, [&](ContributorLists& lists) {
                    addEmptyEntries(lists, surfels.count());
                }).ok());
    for (int attribute = 0; attribute < kAttributes; ++attribute) {
        EXPECT_EQ(flat(padded, attribute), flat(plain, attribute)) << "attribute " << attribute;
    }
}

// The results of both forms, bit for bit, on every device that is here.
TEST(SplatGradientDevice, ArraysOnTheDeviceGetWhatVectorsGet) {
    const Camera camera = straightCamera(60, 44, 50, 30, 22);
    const Surfels surfels = randomSurfels(700, 5);
    const RandomGradients gradients(camera, kAllChannels, surfels, {});
    const BackwardCase everything{{}, surfels, camera, kAllChannels, gradients.views, {}};
    for (const Device& device : devicesUnderTest()) {
        SCOPED_TRACE(deviceName(device));
        SurfelGradients vectors, arrays;
        ASSERT_TRUE(backwardOn(device, CpuPath::Best, everything, vectors).ok());
        ASSERT_TRUE(backwardToArrays(device, everything, arrays).ok());
        for (int attribute = 0; attribute < kAttributes; ++attribute) {
            EXPECT_EQ(flat(arrays, attribute), flat(vectors, attribute)) << "attribute " << attribute;
        }
    }
}

TEST(SplatGradientDevice, WhatDoesNotFitIsNamed) {
    const Camera camera = straightCamera(20, 20, 20, 10, 10);
    const Surfels surfels = randomSurfels(50, 2);
    GBuffer gbuffer;
    SplatWorkspace workspace;
    ASSERT_TRUE(splat({}, viewOf(surfels), camera, kFew, gbuffer, workspace).ok());
    const RandomGradients gradients(camera, kFew, surfels, {});
    SplatGradientWorkspace memory;
    SurfelGradients out;
    const auto sentence = [&](const SurfelView& view, const GBufferGradients& given, const ContributorLists* lists) {
        const Status status = splatBackward({}, view, camera, gbuffer, lists, given, memory, out);
        return status ? std::string() : status.error().describe();
    };
    EXPECT_EQ(sentence(viewOf(surfels), gradients.views, nullptr), "");
    SurfelView elsewhere = viewOf(surfels);
    elsewhere.device = {DeviceKind::Cuda, 0};
    EXPECT_NE(
        sentence(elsewhere, gradients.views, nullptr).find("the pictures lie on cpu, expected the surfels' cuda:0"),
        std::string::npos);
    const ContributorLists none;
    EXPECT_NE(sentence(viewOf(surfels), gradients.views, &none).find("contributor lists are not those"),
              std::string::npos);
    GBufferGradients more = gradients.views;
    more[Channel::Depth] = {gradients.values[0].data(), 20, 20, 1};
    EXPECT_NE(sentence(viewOf(surfels), more, nullptr).find("a gradient of depth was given, which was not splatted"),
              std::string::npos);
    SurfelGradientArrays arrays = prepareOutputs(surfels.count(), gradients.views, out);
    arrays.scales = nullptr;
    const Status missing =
        splatBackward({}, viewOf(surfels), camera, gbuffer, nullptr, gradients.views, memory, arrays);
    ASSERT_FALSE(missing.ok());
    EXPECT_NE(missing.error().describe().find("scales and opacities need an array each"), std::string::npos);
}

} // namespace
} // namespace ars::test
