// Backward of posing: the maths against central differences in double, the arrays against differences of poseSurfels.
#include "engine/surfel/pose_surfels_gradient.h"
#include "engine/surfel/pose_surfels_gradient_math.h"

#include "engine/rig/pose.h"
#include "tests/support/devices.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>
#include <vector>

namespace ars {
namespace {

double dot(const glm::dquat& a, const glm::dquat& b) { return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z; }

TEST(PoseSurfelsGradient, RotationEqualsCentralDifferencesInDouble) {
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (int trial = 0; trial < 200; ++trial) {
        const glm::dquat turn =
            glm::normalize(glm::dquat(normal(random), normal(random), normal(random), normal(random)));
        const glm::dquat own(normal(random), normal(random), normal(random), normal(random)); // of any length
        const glm::dquat g(normal(random), normal(random), normal(random), normal(random));
        const glm::dquat expected = turnedRotationBackward(turn, own, g);
        const double parts[4] = {expected.w, expected.x, expected.y, expected.z};
        for (int c = 0; c < 4; ++c) {
            constexpr double kStep = 1e-6;
            const auto at = [&](double h) {
                glm::dquat q = own;
                (c == 0 ? q.w : c == 1 ? q.x : c == 2 ? q.y : q.z) += h;
                return dot(g, turnedRotation(turn, q));
            };
            EXPECT_NEAR(parts[c], (at(kStep) - at(-kStep)) / (2.0 * kStep), 1e-6 * (1.0 + std::abs(parts[c])));
        }
    }
}

/// Surfels that follow up to four of six joints; radii of three parts.
struct Scene {
    std::vector<glm::mat4> matrices;
    std::vector<glm::vec3> positions;
    std::vector<BodyPart> parts;
    SkinWeights weights;
    Surfels surfels;
    PartRadii radii = initialPartRadii();

    explicit Scene(std::size_t count) {
        std::mt19937 random(4);
        std::uniform_real_distribution<float> unit(-0.6f, 0.6f);
        for (int j = 0; j < 6; ++j) {
            const glm::quat q = quatFromAxisAngle({unit(random), unit(random), unit(random)});
            matrices.push_back(glm::mat4_cast(q));
            matrices.back()[3] = glm::vec4(unit(random), unit(random), unit(random), 1.0f);
            positions.emplace_back(unit(random), unit(random), unit(random));
            parts.push_back(static_cast<BodyPart>((j * 2) % 5));
        }
        std::vector<float> dense(count * 6, 0.0f);
        for (std::size_t i = 0; i < count; ++i) {
            for (std::size_t k = 0; k < 1 + i % 4; ++k) dense[i * 6 + (i + k) % 6] = 0.7f + unit(random);
            surfels.means.emplace_back(unit(random), unit(random), unit(random));
            for (int c = 0; c < 4; ++c) surfels.rotations.push_back(unit(random) + (c == 0 ? 1.0f : 0.0f));
            surfels.scales.emplace_back(0.01f, 0.02f);
            surfels.opacities.push_back(0.9f);
        }
        weights = *sparseWeights(dense, count, 6);
    }
    SurfelPosing posing() const { return {matrices, positions, parts, radii}; }
};

TEST(PoseSurfelsGradient, ArraysFollowDifferencesOfPosing) {
    constexpr std::size_t kCount = 40;
    Scene scene(kCount);
    std::mt19937 random(8);
    std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
    std::vector<glm::vec3> gMeans(kCount), gotMeans(kCount);
    std::vector<float> gRotations(4 * kCount), gRadii(kCount), gotRotations(4 * kCount);
    for (glm::vec3& g : gMeans) g = {unit(random), unit(random), unit(random)};
    for (float& g : gRotations) g = unit(random);
    for (float& g : gRadii) g = unit(random);
    PartRadii gotRadii{};
    ASSERT_TRUE(poseSurfelsBackward(scene.posing(), scene.weights, scene.surfels, {gMeans, gRotations, gRadii},
                                    gotMeans, gotRotations, gotRadii)
                    .ok());
    const auto loss = [&] {
        PosedSurfels posed;
        EXPECT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
        double sum = 0.0;
        for (std::size_t i = 0; i < kCount; ++i) {
            for (int c = 0; c < 3; ++c) sum += static_cast<double>(gMeans[i][c]) * posed.means[i][c];
            for (std::size_t c = 4 * i; c < 4 * i + 4; ++c)
                sum += static_cast<double>(gRotations[c]) * posed.rotations[c];
            sum += static_cast<double>(gRadii[i]) * posed.radii[i];
        }
        return sum;
    };
    const auto slope = [&](float& number, float step) {
        const float kept = number;
        number = kept + step;
        const double up = loss();
        number = kept - step;
        const double down = loss();
        number = kept;
        return (up - down) / (2.0 * step);
    };
    for (std::size_t i = 0; i < kCount; i += 3) {
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(gotMeans[i][c], slope(scene.surfels.means[i][c], 0.1f), 1e-3);
        for (std::size_t c = 4 * i; c < 4 * i + 4; ++c) {
            EXPECT_NEAR(gotRotations[c], slope(scene.surfels.rotations[c], 2e-3f), 2e-3);
        }
    }
    for (std::size_t g = 0; g < kBodyPartCount; ++g) {
        EXPECT_NEAR(gotRadii[g], slope(scene.radii[g], 0.05f), 1e-3) << bodyPartName(static_cast<BodyPart>(g));
    }
    EXPECT_EQ(gotRadii[static_cast<std::size_t>(BodyPart::Hand)], 0.0f) << "no joint of that part";
}

/// Arrays on a device, kept until the end of the test.
class DeviceMemory {
public:
    explicit DeviceMemory(const Device& device) : device_(device) {}

    template <typename T>
    T* upload(const std::vector<T>& values) {
        Buffer buffer = *Buffer::allocate(device_, values.size() * sizeof(T), "test");
        EXPECT_TRUE(uploadBuffer(buffer, std::as_bytes(std::span(values))).ok());
        buffers_.push_back(std::move(buffer));
        return static_cast<T*>(buffers_.back().data());
    }
    template <typename T>
    void download(const T* from, std::vector<T>& values) {
        for (const Buffer& buffer : buffers_) {
            if (buffer.data() != from) continue;
            EXPECT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(values)), buffer).ok());
        }
    }

private:
    Device device_;
    std::vector<Buffer> buffers_;
};

// Host and device share what is done to one surfel; they differ by fused multiply-adds and in the order of the radii's
// sums.
TEST(PoseSurfelsGradient, EveryDeviceAgreesWithTheHost) {
    constexpr std::size_t kCount = 40000; // more than the blocks that sum the radii take at once
    Scene scene(kCount);
    std::mt19937 random(9);
    std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
    std::vector<glm::vec3> gMeans(kCount), means(kCount), gotMeans(kCount);
    std::vector<float> gRotations(4 * kCount), gRadii(kCount), rotations(4 * kCount), gotRotations(4 * kCount);
    for (glm::vec3& g : gMeans) g = {unit(random), unit(random), unit(random)};
    for (float& g : gRotations) g = unit(random);
    for (float& g : gRadii) g = unit(random);
    PartRadii radii{};
    ASSERT_TRUE(poseSurfelsBackward(scene.posing(), scene.weights, scene.surfels, {gMeans, gRotations, gRadii}, means,
                                    rotations, radii)
                    .ok());
    for (const Device& device : test::devicesUnderTest()) {
        SCOPED_TRACE(deviceName(device));
        DeviceMemory memory(device);
        PoseSurfelsGradientArrays a;
        a.count = kCount;
        a.jointCount = scene.matrices.size();
        a.matrices = memory.upload(scene.matrices);
        a.parts = memory.upload(scene.parts);
        a.joints = memory.upload(scene.weights.joints);
        a.weights = memory.upload(scene.weights.weights);
        a.rotations = memory.upload(scene.surfels.rotations);
        a.posedMeans = memory.upload(gMeans);
        a.posedRotations = memory.upload(gRotations);
        a.gradRotations = memory.upload(gotRotations);
        a.posedRadii = memory.upload(gRadii);
        std::vector<float> gotRadii(kBodyPartCount, 7.0f);
        a.partRadii = memory.upload(gotRadii);
        PoseGradientWorkspace workspace;
        for (int pass = 0; pass < 2; ++pass) { // the second in place, with the memory of the first
            a.means = pass == 0 ? memory.upload(gotMeans) : const_cast<glm::vec3*>(a.posedMeans);
            ASSERT_TRUE(poseSurfelsBackwardOnDevice(device, a, workspace).ok());
            memory.download(a.means, gotMeans);
            memory.download(a.gradRotations, gotRotations);
            memory.download(a.partRadii, gotRadii);
            for (std::size_t i = 0; i < kCount; ++i) {
                ASSERT_LT(glm::distance(gotMeans[i], means[i]), 2e-6f);
                for (std::size_t c = 4 * i; c < 4 * i + 4; ++c) ASSERT_NEAR(gotRotations[c], rotations[c], 2e-5f);
            }
            for (std::size_t g = 0; g < kBodyPartCount; ++g) EXPECT_NEAR(gotRadii[g], radii[g], 1e-4f);
        }
    }
}

TEST(PoseSurfelsGradient, ArraysThatAreMissingAreNamed) {
    Scene scene(3);
    const std::vector<float> three(3);
    PoseGradientWorkspace workspace;
    PoseSurfelsGradientArrays a;
    a.count = 3;
    a.jointCount = scene.matrices.size();
    const auto sentence = [&] {
        const Status status = poseSurfelsBackwardOnDevice({}, a, workspace);
        return status ? std::string() : status.error().describe();
    };
    EXPECT_NE(sentence().find("joints and weights must be given"), std::string::npos);
    a.joints = scene.weights.joints.data();
    a.weights = scene.weights.weights.data();
    a.posedRadii = three.data();
    EXPECT_NE(sentence().find("the joints' parts must be given"), std::string::npos);
    a.parts = scene.parts.data();
    EXPECT_NE(sentence().find("needs its result"), std::string::npos);
    std::vector<float> radii(kBodyPartCount);
    a.partRadii = radii.data();
    EXPECT_EQ(sentence(), "");
}

TEST(PoseSurfelsGradient, WrongCountsAreNamed) {
    Scene scene(5);
    const std::vector<float> three(3);
    PartRadii radii{};
    const Status status =
        poseSurfelsBackward(scene.posing(), scene.weights, scene.surfels, {{}, {}, three}, {}, {}, radii);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("dL/dradii has 3 entries, expected 5"), std::string::npos);
}

} // namespace
} // namespace ars
