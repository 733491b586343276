// Stage 4: canonical surfels to live ones, with radius, importance and bone direction.
#include "engine/surfel/pose_surfels.h"

#include "engine/core/parallel.h"
#include "engine/surfel/pose_surfels_math.h"
#include "tests/support/devices.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

namespace ars {
namespace {

constexpr std::size_t kJoints = 6;

/// Surfels, joints and a pose at random: blends of up to five turned and moved joints.
struct Scene {
    std::vector<glm::mat4> matrices;
    std::vector<glm::vec3> jointPositions;
    std::vector<BodyPart> parts;
    SkinWeights weights;
    Surfels surfels;

    SurfelPosing posing() const { return {matrices, jointPositions, parts}; }
};

glm::quat randomTurn(std::mt19937& random, float most) {
    std::uniform_real_distribution<float> number(-most, most);
    return quatFromAxisAngle({number(random), number(random), number(random)});
}

Scene randomScene(std::size_t count, unsigned seed = 1) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> number(-0.5f, 0.5f);
    Scene scene;
    for (std::size_t j = 0; j < kJoints; ++j) {
        scene.matrices.push_back(glm::mat4_cast(randomTurn(random, 0.7f)));
        scene.matrices.back()[3] = glm::vec4(number(random), number(random), number(random), 1.0f);
        scene.jointPositions.emplace_back(number(random), number(random), number(random));
        scene.parts.push_back(static_cast<BodyPart>((j * 4) % kBodyPartCount));
    }
    std::vector<float> dense(count * kJoints, 0.0f);
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t k = 0; k < 1 + i % 5; ++k) dense[i * kJoints + (i + k) % kJoints] = 0.6f + number(random);
        scene.surfels.means.emplace_back(number(random), number(random), number(random));
        const glm::quat q = randomTurn(random, 2.0f);
        scene.surfels.rotations.insert(scene.surfels.rotations.end(), {q.w, q.x, q.y, q.z});
        scene.surfels.scales.emplace_back(0.01f, 0.02f);
        scene.surfels.opacities.push_back(0.9f);
        scene.surfels.albedos.emplace_back(0.1f, 0.2f, 0.3f);
    }
    scene.weights = *sparseWeights(dense, count, kJoints);
    return scene;
}

/// One surfel at `mean`, its frame along the axes, following joints 0 and 1.
Scene twoJoints(const glm::vec3& mean, float firstWeight) {
    Scene scene = randomScene(1);
    scene.matrices.assign(2, glm::mat4(1.0f));
    scene.jointPositions.assign(2, glm::vec3(0.0f));
    scene.parts = {BodyPart::Torso, BodyPart::Hand};
    scene.weights = *sparseWeights(std::vector<float>{firstWeight, 1.0f - firstWeight}, 1, 2);
    scene.surfels.means[0] = mean;
    scene.surfels.rotations = {1.0f, 0.0f, 0.0f, 0.0f};
    return scene;
}

glm::quat rotationOf(const std::vector<float>& rotations, std::size_t i) {
    return {rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2], rotations[4 * i + 3]};
}

TEST(PoseSurfels, AStillPoseChangesNothing) {
    Scene scene = randomScene(100);
    scene.matrices.assign(kJoints, glm::mat4(1.0f));
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    for (std::size_t i = 0; i < posed.count(); ++i) {
        EXPECT_LT(glm::distance(posed.means[i], scene.surfels.means[i]), 1e-6f);
        EXPECT_GT(std::abs(glm::dot(rotationOf(posed.rotations, i), rotationOf(scene.surfels.rotations, i))),
                  1.0f - 1e-6f);
        EXPECT_LT(glm::distance(posed.bones[i], glm::vec3(0, 1, 0)), 1e-6f);
    }
    EXPECT_TRUE(posed.radiiPlus.empty());
    EXPECT_TRUE(posed.radiiMinus.empty());
}

// Formulas by hand: torso 0.25 m and hand 0.04 m at weights 3/4 and 1/4.
TEST(PoseSurfels, ImportanceRadiusAndStepsAreThePrintedFormulas) {
    Scene scene = twoJoints({0.0f, 0.0f, 0.0f}, 0.75f);
    scene.jointPositions = {{0.15f, 0.0f, 0.0f}, {0.0f, 0.03f, 0.04f}};
    PoseSurfelsParams params;
    params.trainingRadii = true;
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels(params, scene.posing(), scene.weights, scene.surfels, posed).ok());
    const double torso = 0.75 * 0.25, hand = 0.25 * 0.04;
    EXPECT_NEAR(posed.radii[0], torso + hand, 1e-7);
    EXPECT_NEAR(posed.importances[0], (torso * std::exp(-1.0) + hand * std::exp(-0.05 / 0.15)) / (torso + hand), 1e-6);
    EXPECT_NEAR(posed.radiiPlus[0], 1.05 * (torso + hand), 1e-6);
    EXPECT_NEAR(posed.radiiMinus[0], 0.95 * (torso + hand), 1e-6);

    // 5 % of 0.03 m is less than the smallest step of 2 mm. The importance stays with the initial radii.
    SurfelPosing posing = scene.posing();
    posing.radii = uniformPartRadii(0.03f);
    const float importance = posed.importances[0];
    ASSERT_TRUE(poseSurfels(params, posing, scene.weights, scene.surfels, posed).ok());
    EXPECT_NEAR(posed.radii[0], 0.03, 1e-7);
    EXPECT_NEAR(posed.radiiPlus[0], 0.032, 1e-7);
    EXPECT_NEAR(posed.radiiMinus[0], 0.028, 1e-7);
    EXPECT_EQ(posed.importances[0], importance);
}

TEST(PoseSurfels, ImportanceIsOneAtAJointAndFallsToOneOverEOverSigma) {
    for (const float distance : {0.0f, 0.15f, 0.3f, 2.0f}) {
        Scene scene = twoJoints({0.0f, distance, 0.0f}, 1.0f);
        PosedSurfels posed;
        ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
        EXPECT_NEAR(posed.importances[0], std::exp(-distance / 0.15), 1e-6);
    }
    // Weights that do not sum to one scale r, but neither I nor q.
    Scene scene = twoJoints({0.0f, 0.15f, 0.0f}, 1.0f);
    scene.weights.weights[0] = 0.5f;
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    EXPECT_NEAR(posed.importances[0], std::exp(-0.5 * 0.15 / 0.15), 1e-6) << "half the way: the blend halves the mean";
    EXPECT_NEAR(posed.radii[0], 0.125, 1e-7);
    EXPECT_NEAR(posed.bones[0].y, 1.0, 1e-6);
    scene.weights.weights[0] = 0.0f;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    EXPECT_EQ(posed.importances[0], 0.0f) << "no weight at all";
}

TEST(PoseSurfels, BoneDirectionBlendsTheJointsAxes) {
    Scene scene = twoJoints({0.1f, 0.2f, 0.3f}, 0.5f);
    scene.matrices[1] = glm::mat4_cast(quatFromAxisAngle({0.0f, 0.0f, 1.5707963f})); // e_y to -e_x
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    EXPECT_LT(glm::distance(posed.bones[0], glm::vec3(-std::sqrt(0.5f), std::sqrt(0.5f), 0.0f)), 1e-6f);

    // Where opposite turns cancel the direction still has unit length.
    scene.matrices[0] = glm::mat4_cast(quatFromAxisAngle({0.0f, 0.0f, -1.5707963f}));
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    EXPECT_NEAR(glm::length(posed.bones[0]), 1.0f, 1e-5f);
    EXPECT_NEAR(glm::length(rotationOf(posed.rotations, 0)), 1.0f, 1e-5f);
}

// The rig's skinning is the oracle of means and normals; its rotation is tested against a singular value decomposition.
TEST(PoseSurfels, AgreesWithTheSkinningOfMeshes) {
    const Scene scene = randomScene(3000, 7);
    std::vector<glm::vec3> normals, points(3000), turned(3000);
    for (std::size_t i = 0; i < 3000; ++i) {
        normals.push_back(glm::mat3_cast(rotationOf(scene.surfels.rotations, i))[2]);
    }
    ASSERT_TRUE(skinPointsAndNormals(scene.matrices, scene.weights, scene.surfels.means, normals, points, turned).ok());
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    for (std::size_t i = 0; i < 3000; ++i) {
        EXPECT_LT(glm::distance(posed.means[i], points[i]), 1e-6f);
        EXPECT_LT(glm::distance(glm::mat3_cast(rotationOf(posed.rotations, i))[2], turned[i]), 2e-5f) << i;
    }
}

TEST(PoseSurfels, FloatAgreesWithDouble) {
    const Scene scene = randomScene(2000, 3);
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    std::vector<Affine<double>> matrices;
    std::vector<glm::dvec3> joints;
    std::vector<double> radii;
    for (std::size_t j = 0; j < kJoints; ++j) {
        matrices.push_back(affineFrom<double>(scene.matrices[j]));
        joints.emplace_back(scene.jointPositions[j]);
        radii.push_back(bodyPartInitialRadiusM(scene.parts[j]));
    }
    for (std::size_t i = 0; i < posed.count(); ++i) {
        double weights[kMaxInfluences];
        for (std::size_t k = 0; k < kMaxInfluences; ++k) weights[k] = scene.weights.weights[i * kMaxInfluences + k];
        const Influences<double> influences{&scene.weights.joints[i * kMaxInfluences], weights, kMaxInfluences};
        const Affine<double> blend = blendAffine(matrices.data(), influences.joints, weights, kMaxInfluences);
        const PosedSurfel<double> expected =
            posedSurfel(blend, glm::dvec3(scene.surfels.means[i]), glm::dquat(rotationOf(scene.surfels.rotations, i)));
        EXPECT_LT(glm::distance(expected.mean, glm::dvec3(posed.means[i])), 1e-6);
        EXPECT_GT(std::abs(glm::dot(expected.rotation, glm::dquat(rotationOf(posed.rotations, i)))), 1.0 - 1e-6);
        EXPECT_LT(glm::distance(expected.bone, glm::dvec3(posed.bones[i])), 1e-5);
        EXPECT_NEAR(blendedRadius(influences, radii.data()), posed.radii[i], 1e-7);
        EXPECT_NEAR(surfelImportance(influences, expected.mean, joints.data(), radii.data(), 0.15),
                    posed.importances[i], 2e-6);
    }
}

TEST(PoseSurfels, ARigidMotionOfTheRootTurnsEverything) {
    const Scene scene = randomScene(500, 5);
    PosedSurfels still, moved;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, still).ok());
    const glm::quat turn = quatFromAxisAngle({0.4f, 1.1f, -0.3f});
    glm::mat4 motion = glm::mat4_cast(turn);
    motion[3] = glm::vec4(0.5f, -0.2f, 2.0f, 1.0f);
    Scene other = scene;
    for (glm::mat4& m : other.matrices) m = motion * m;
    for (glm::vec3& p : other.jointPositions) p = glm::vec3(motion * glm::vec4(p, 1.0f));
    ASSERT_TRUE(poseSurfels({}, other.posing(), scene.weights, scene.surfels, moved).ok());
    for (std::size_t i = 0; i < still.count(); ++i) {
        EXPECT_LT(glm::distance(moved.means[i], glm::vec3(motion * glm::vec4(still.means[i], 1.0f))), 2e-6f);
        EXPECT_GT(std::abs(glm::dot(rotationOf(moved.rotations, i), turn * rotationOf(still.rotations, i))), 1 - 1e-5f);
        EXPECT_LT(glm::distance(moved.bones[i], turn * still.bones[i]), 2e-5f);
        EXPECT_NEAR(moved.importances[i], still.importances[i], 2e-6f);
        EXPECT_EQ(moved.radii[i], still.radii[i]);
    }
}

TEST(PoseSurfels, CanonicalMatricesAreTakenOut) {
    Skeleton skeleton = smplxSkeleton(std::vector<glm::vec3>(kSmplxJointCount, glm::vec3(0.1f, 0.9f, 0.0f)));
    const std::vector<glm::mat4> canonical = skinningMatrices(skeleton, canonicalPose());
    Pose pose = restPose(kSmplxJointCount);
    pose.rotations[1] = quatFromAxisAngle({0.3f, 0.2f, 0.1f});
    pose.translation = {1.0f, 2.0f, 3.0f};
    const std::vector<glm::mat4> posed = skinningMatrices(skeleton, pose);
    const auto matrices = canonicalToPosed(posed, canonical);
    ASSERT_TRUE(matrices.ok());
    for (std::size_t j = 0; j < posed.size(); ++j) {
        const glm::mat4 back = (*matrices)[j] * canonical[j];
        for (int c = 0; c < 4; ++c) EXPECT_LT(glm::length(back[c] - posed[j][c]), 2e-6f) << j;
    }
    EXPECT_EQ(*canonicalToPosed(posed, {}), posed);
    const std::vector<glm::vec3> joints = posedJointPositions(skeleton, pose);
    EXPECT_LT(glm::distance(joints[0], glm::vec3(1.1f, 2.9f, 3.0f)), 1e-6f);

    std::vector<glm::mat4> flat = canonical;
    flat[3] = glm::mat4(0.0f);
    const auto failed = canonicalToPosed(posed, flat);
    ASSERT_FALSE(failed.ok());
    EXPECT_EQ(failed.error().code, ErrorCode::InvalidArgument);
    EXPECT_NE(failed.error().describe().find("joint 3"), std::string::npos);
    flat.pop_back();
    EXPECT_EQ(canonicalToPosed(posed, flat).error().code, ErrorCode::InvalidArgument);
}

TEST(PoseSurfels, RotationsOfAnyLengthAndNoneAreUnderstood) {
    Scene scene = randomScene(4, 2);
    const glm::quat first = rotationOf(scene.surfels.rotations, 0);
    for (int k = 0; k < 4; ++k) {
        scene.surfels.rotations[4 + k] = 3.0f * scene.surfels.rotations[k];
        scene.surfels.rotations[8 + k] = 0.0f;
        scene.surfels.rotations[12 + k] = std::numeric_limits<float>::quiet_NaN();
    }
    scene.matrices.assign(kJoints, glm::mat4(1.0f));
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    EXPECT_GT(std::abs(glm::dot(rotationOf(posed.rotations, 1), first)), 1.0f - 1e-5f);
    EXPECT_NEAR(glm::length(rotationOf(posed.rotations, 1)), 1.0f, 1e-5f);
    EXPECT_EQ(rotationOf(posed.rotations, 2), glm::quat(1.0f, 0.0f, 0.0f, 0.0f));
    EXPECT_EQ(rotationOf(posed.rotations, 3), glm::quat(1.0f, 0.0f, 0.0f, 0.0f));
}

TEST(PoseSurfels, RadiiAloneAreComputedAnew) {
    const Scene scene = randomScene(50);
    PoseSurfelsParams params;
    params.trainingRadii = true;
    PosedSurfels whole, posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    SurfelPosing posing = scene.posing();
    posing.radii = {0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f, 0.8f, 0.9f};
    ASSERT_TRUE(poseSurfels(params, posing, scene.weights, scene.surfels, whole).ok());
    const std::vector<glm::vec3> means = posed.means;
    posing.matrices = {};
    posing.jointPositions = {};
    ASSERT_TRUE(poseRadii(params, posing, scene.weights, posed).ok());
    EXPECT_EQ(posed.radii, whole.radii);
    EXPECT_EQ(posed.radiiPlus, whole.radiiPlus);
    EXPECT_EQ(posed.radiiMinus, whole.radiiMinus);
    EXPECT_EQ(posed.means, means);
}

TEST(PoseSurfels, TheLiveViewSharesWhatDoesNotChange) {
    const Scene scene = randomScene(5);
    PosedSurfels posed;
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, posed).ok());
    const SurfelView view = liveView(scene.surfels, posed);
    EXPECT_EQ(view.count, 5u);
    EXPECT_EQ(view.means, posed.means.data());
    EXPECT_EQ(view.albedos, scene.surfels.albedos.data());
    EXPECT_EQ(view.scales, scene.surfels.scales.data());
    EXPECT_EQ(view.colors, nullptr);
    EXPECT_EQ(view.radiiPlus, nullptr);
    const Surfels live = liveSurfels(scene.surfels, posed);
    EXPECT_TRUE(checkSurfels(live).ok());
    EXPECT_EQ(live.means, posed.means);
    EXPECT_EQ(live.albedos, scene.surfels.albedos);
}

TEST(PoseSurfels, ManyThreadsGiveTheSameAsOne) {
    const Scene scene = randomScene(9000, 11);
    PosedSurfels first, second;
    const int threads = threadCount();
    setThreadCount(1);
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, first).ok());
    setThreadCount(3);
    ASSERT_TRUE(poseSurfels({}, scene.posing(), scene.weights, scene.surfels, second).ok());
    setThreadCount(threads);
    EXPECT_EQ(std::memcmp(first.rotations.data(), second.rotations.data(), first.rotations.size() * 4), 0);
    EXPECT_EQ(first.importances, second.importances);
}

/// Copies of host arrays on a device, kept until the end of the test.
class DeviceArrays {
public:
    explicit DeviceArrays(const Device& device) : device_(device) {}
    template <typename T>
    T* upload(const std::vector<T>& values) {
        Buffer buffer = *Buffer::allocate(device_, values.size() * sizeof(T), "test");
        EXPECT_TRUE(uploadBuffer(buffer, std::as_bytes(std::span(values))).ok());
        buffers_.push_back(std::move(buffer));
        return static_cast<T*>(buffers_.back().data());
    }
    template <typename T>
    std::vector<T> download(const T* data, std::size_t count) {
        std::vector<T> values(count);
        for (const Buffer& buffer : buffers_) {
            if (buffer.data() == data) {
                EXPECT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(values)), buffer).ok());
            }
        }
        return values;
    }

private:
    Device device_;
    std::vector<Buffer> buffers_;
};

// Host and device share the per-surfel functions; they differ by fused multiply-adds and the device's exponential.
TEST(PoseSurfels, EveryDeviceAgreesWithTheHost) {
    const std::size_t count = 1000;
    const Scene scene = randomScene(count, 13);
    PoseSurfelsParams params;
    params.trainingRadii = true;
    PosedSurfels expected;
    ASSERT_TRUE(poseSurfels(params, scene.posing(), scene.weights, scene.surfels, expected).ok());
    std::vector<float> initial;
    for (const BodyPart part : scene.parts) initial.push_back(bodyPartInitialRadiusM(part));
    for (const Device& device : test::devicesUnderTest()) {
        DeviceArrays memory(device);
        PoseSurfelsArrays a;
        a.count = count;
        a.jointCount = kJoints;
        a.matrices = memory.upload(scene.matrices);
        a.jointPositions = memory.upload(scene.jointPositions);
        a.jointRadii = a.jointInitialRadii = memory.upload(initial);
        a.joints = memory.upload(scene.weights.joints);
        a.weights = memory.upload(scene.weights.weights);
        a.means = memory.upload(scene.surfels.means);
        a.rotations = memory.upload(scene.surfels.rotations);
        a.posedMeans = memory.upload(std::vector<glm::vec3>(count));
        a.posedRotations = memory.upload(std::vector<float>(4 * count));
        a.radii = memory.upload(std::vector<float>(count));
        a.radiiPlus = memory.upload(std::vector<float>(count));
        a.radiiMinus = memory.upload(std::vector<float>(count));
        a.importances = memory.upload(std::vector<float>(count));
        a.bones = memory.upload(std::vector<glm::vec3>(count));
        ASSERT_TRUE(poseSurfelsOnDevice(params, device, a).ok()) << deviceName(device);
        const auto means = memory.download<glm::vec3>(a.posedMeans, count);
        const auto rotations = memory.download<float>(a.posedRotations, 4 * count);
        const auto radii = memory.download<float>(a.radii, count);
        const auto plus = memory.download<float>(a.radiiPlus, count);
        const auto minus = memory.download<float>(a.radiiMinus, count);
        const auto importances = memory.download<float>(a.importances, count);
        const auto bones = memory.download<glm::vec3>(a.bones, count);
        for (std::size_t i = 0; i < count; ++i) {
            EXPECT_LT(glm::distance(means[i], expected.means[i]), 1e-6f);
            EXPECT_GT(std::abs(glm::dot(rotationOf(rotations, i), rotationOf(expected.rotations, i))), 1.0f - 2e-6f);
            EXPECT_NEAR(radii[i], expected.radii[i], 1e-6f);
            EXPECT_NEAR(plus[i], expected.radiiPlus[i], 1e-6f);
            EXPECT_NEAR(minus[i], expected.radiiMinus[i], 1e-6f);
            EXPECT_NEAR(importances[i], expected.importances[i], 2e-6f);
            EXPECT_LT(glm::distance(bones[i], expected.bones[i]), 1e-5f);
        }
    }
}

TEST(PoseSurfels, BadInputIsRefusedInOneSentence) {
    const Scene scene = randomScene(3);
    PosedSurfels posed;
    auto message = [&](const PoseSurfelsParams& params, const SurfelPosing& posing, const SkinWeights& weights,
                       const Surfels& surfels) {
        const Status status = poseSurfels(params, posing, weights, surfels, posed);
        EXPECT_FALSE(status.ok());
        if (status.ok()) return std::string();
        EXPECT_EQ(status.error().code, ErrorCode::InvalidArgument);
        return status.error().describe();
    };
    SkinWeights strange = scene.weights;
    strange.joints[9] = 77;
    EXPECT_NE(message({}, scene.posing(), strange, scene.surfels).find("joint 77, but there are only 6"),
              std::string::npos);
    SkinWeights few = scene.weights;
    few.weights.resize(8);
    EXPECT_NE(message({}, scene.posing(), few, scene.surfels).find("1 points, but there are 3"), std::string::npos);
    Surfels torn = scene.surfels;
    torn.rotations.pop_back();
    EXPECT_NE(message({}, scene.posing(), scene.weights, torn).find("11 numbers, expected 12"), std::string::npos);
    SurfelPosing posing = scene.posing();
    posing.jointPositions = posing.jointPositions.subspan(1);
    message({}, posing, scene.weights, scene.surfels);
    posing = scene.posing();
    posing.radii[0] = -1.0f;
    EXPECT_NE(message({}, posing, scene.weights, scene.surfels).find("radius of the torso is -1 m"), std::string::npos);
    PoseSurfelsParams params;
    params.importanceFalloffM = 0.0f;
    message(params, scene.posing(), scene.weights, scene.surfels);

    ASSERT_TRUE(poseSurfels({}, scene.posing(), SkinWeights{}, Surfels{}, posed).ok()) << "no surfels is no failure";
    EXPECT_EQ(posed.count(), 0u);
    EXPECT_EQ(poseSurfelsOnDevice({}, {}, PoseSurfelsArrays{.count = 1}).error().code, ErrorCode::InvalidArgument);
}

} // namespace
} // namespace ars
