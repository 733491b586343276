#include "engine/rig/inverse_kinematics.h"

#include "engine/rig/pose.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace ars {
namespace {

/// A person of 1.7 m with round numbers: hips at (+-0.1, 0.9, 0), legs straight down, arms along x.
Skeleton person() {
    std::vector<glm::vec3> p(kSmplxJointCount, glm::vec3(0.0f));
    const auto set = [&](const char* name, glm::vec3 place) {
        p[static_cast<std::size_t>(smplxJointIndex(std::string("left_") + name))] = place;
        p[static_cast<std::size_t>(smplxJointIndex(std::string("right_") + name))] = {-place.x, place.y, place.z};
    };
    const auto middle = [&](const char* name, glm::vec3 place) {
        p[static_cast<std::size_t>(smplxJointIndex(name))] = place;
    };
    middle("pelvis", {0, 1.0f, 0});
    middle("spine1", {0, 1.1f, 0});
    middle("spine2", {0, 1.2f, 0});
    middle("spine3", {0, 1.3f, 0});
    middle("neck", {0, 1.5f, 0});
    middle("head", {0, 1.6f, 0});
    middle("jaw", {0, 1.62f, 0.03f});
    set("eye_smplhf", {0.03f, 1.65f, 0.08f});
    set("hip", {0.1f, 0.9f, 0});
    set("knee", {0.1f, 0.5f, 0});
    set("ankle", {0.1f, 0.1f, 0});
    set("foot", {0.1f, 0.05f, 0.13f});
    set("collar", {0.02f, 1.45f, 0});
    set("shoulder", {0.2f, 1.45f, 0});
    set("elbow", {0.5f, 1.45f, 0});
    set("wrist", {0.75f, 1.45f, 0});
    float z = 0.03f;
    for (const char* finger : {"index", "middle", "ring", "pinky", "thumb"}) {
        for (int i = 1; i <= 3; ++i)
            set((finger + std::to_string(i)).c_str(), {0.82f + 0.03f * static_cast<float>(i), 1.45f, z});
        z -= 0.02f;
    }
    return smplxSkeleton(std::move(p));
}

int joint(const char* name) { return smplxJointIndex(name); }

glm::vec3 worldPosition(const Skeleton& skeleton, const Pose& pose, int j) {
    return glm::vec3(jointWorldMatrices(skeleton, pose)[static_cast<std::size_t>(j)][3]);
}

glm::quat worldRotation(const Skeleton& skeleton, const Pose& pose, int j) {
    return glm::quat_cast(glm::mat3(jointWorldMatrices(skeleton, pose)[static_cast<std::size_t>(j)]));
}

float angle(const glm::quat& a, const glm::quat& b) {
    return 4.0f * std::asin(std::min(1.0f, 0.5f * std::min(glm::length(a - b), glm::length(a + b))));
}

/// Largest excess over the limits in any coordinate, radians.
float excess(const Pose& pose) {
    float worst = 0.0f;
    for (std::size_t j = 0; j < pose.rotations.size(); ++j) {
        const JointLimit& limit = smplxJointLimits()[j];
        const glm::vec3 q = limitCoordinates(limit, pose.rotations[j]);
        for (int a = 0; a < 3; ++a) worst = std::max({worst, q[a] - limit.maximum[a], limit.minimum[a] - q[a]});
    }
    return worst;
}

/// A pose within the limits, by chance; `share` of each range.
Pose randomPose(std::mt19937& random, float share) {
    Pose pose = restPose(kSmplxJointCount);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    for (std::size_t j = 1; j < pose.rotations.size(); ++j) {
        const JointLimit& limit = smplxJointLimits()[j];
        glm::vec3 q;
        for (int a = 0; a < 3; ++a) q[a] = share * glm::mix(limit.minimum[a], limit.maximum[a], unit(random));
        pose.rotations[j] = rotationFromCoordinates(limit, q);
    }
    pose.translation = {unit(random), unit(random), unit(random)};
    return pose;
}

TEST(InverseKinematics, CoordinatesAreSwingAfterTwist) {
    // Twist 30 degrees about x, then a swing of 90 degrees about y: written with plain axis rotations.
    JointLimit limit;
    limit.twistAxis = 0;
    const glm::quat r = glm::angleAxis(glm::radians(90.0f), glm::vec3(0, 1, 0)) *
                        glm::angleAxis(glm::radians(30.0f), glm::vec3(1, 0, 0));
    const glm::vec3 q = limitCoordinates(limit, r);
    EXPECT_NEAR(q.x, glm::radians(30.0f), 1e-5f);
    EXPECT_NEAR(q.y, glm::radians(90.0f), 1e-5f);
    EXPECT_NEAR(q.z, 0.0f, 1e-5f);
    EXPECT_LT(angle(rotationFromCoordinates(limit, q), r), 1e-3f);
}

TEST(InverseKinematics, RightLimitsMirrorLeftOnes) {
    const auto limits = smplxJointLimits();
    const JointLimit& left = limits[18];
    const JointLimit& right = limits[19];
    EXPECT_FLOAT_EQ(left.minimum.y, -right.maximum.y);
    EXPECT_FLOAT_EQ(left.minimum.x, right.minimum.x);
    EXPECT_LT(left.minimum.y, glm::radians(-140.0f)) << "a left elbow bends forward, about -y";
    EXPECT_GT(limits[4].maximum.x, glm::radians(140.0f)) << "a knee bends back, about +x";
    EXPECT_GT(limits[4].minimum.x, glm::radians(-5.0f)) << "and not forward";
    for (const JointLimit& limit : limits) {
        for (int a = 0; a < 3; ++a) {
            EXPECT_LE(limit.minimum[a], 0.0f);
            EXPECT_GE(limit.maximum[a], 0.0f);
        }
    }
}

TEST(InverseKinematics, ReachableTargetsAreReached) {
    // A target is reachable when a pose within the limits puts the joint there.
    const Skeleton skeleton = person();
    std::mt19937 random(7);
    int worst = 0;
    float worstResidual = 0.0f;
    const int joints[] = {joint("left_wrist"), joint("right_wrist"), joint("left_ankle"), joint("right_elbow"),
                          joint("head")};
    for (int trial = 0; trial < 1000; ++trial) {
        const int j = joints[trial % 5];
        const Pose goal = randomPose(random, 0.8f);
        Pose pose = goal;
        const int root = defaultChainRoot(skeleton, j);
        for (int above = skeleton.parents[static_cast<std::size_t>(j)]; above >= root && above >= 0;
             above = skeleton.parents[static_cast<std::size_t>(above)]) {
            const JointLimit& limit = smplxJointLimits()[static_cast<std::size_t>(above)];
            const glm::vec3 q = limitCoordinates(limit, goal.rotations[static_cast<std::size_t>(above)]);
            pose.rotations[static_cast<std::size_t>(above)] = rotationFromCoordinates(limit, 0.3f * q);
        }
        const glm::vec3 target = worldPosition(skeleton, goal, j);
        const auto result = solveIk(skeleton, pose, j, target);
        ASSERT_TRUE(result.ok());
        const float residual = glm::distance(worldPosition(skeleton, pose, j), target);
        EXPECT_NEAR(residual, result->residualM, 1e-5f);
        worstResidual = std::max(worstResidual, residual);
        worst += residual > 1e-3f;
        EXPECT_LT(excess(pose), 1e-4f);
    }
    EXPECT_EQ(worst, 0) << "drags that ended more than 1 mm away; worst " << worstResidual;
}

TEST(InverseKinematics, UnreachableTargetsGiveAStraightLimbThatPointsAtThem) {
    const Skeleton skeleton = person();
    for (const glm::vec3 direction : {glm::vec3(1, 0.3f, 0.5f), glm::vec3(0.3f, -0.8f, 0.6f),
                                      glm::vec3(0.1f, 0.2f, 1.0f), glm::vec3(0.5f, 0.8f, 0.1f)}) {
        Pose pose = restPose(kSmplxJointCount);
        pose.rotations[18] = quatFromAxisAngle({0, -1.2f, 0}); // a bent left elbow
        const glm::vec3 shoulder = worldPosition(skeleton, pose, 16);
        const glm::vec3 target = shoulder + 3.0f * glm::normalize(direction);
        const auto result = solveIk(skeleton, pose, joint("left_wrist"), target);
        ASSERT_TRUE(result.ok());
        EXPECT_FALSE(result->reached);
        const glm::vec3 wrist = worldPosition(skeleton, pose, 20);
        EXPECT_NEAR(glm::distance(wrist, shoulder), 0.55f, 1e-3f) << "upper arm 0.3 m and forearm 0.25 m";
        EXPECT_NEAR(glm::dot(glm::normalize(wrist - shoulder), glm::normalize(direction)), 1.0f, 1e-5f);
        EXPECT_NEAR(result->residualM, 3.0f - 0.55f, 2e-3f);
    }
}

TEST(InverseKinematics, StraightArmBendsForwardWhenPulledIn) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    const glm::vec3 target(0.6f, 1.45f, 0.0f); // on the arm's own line, 15 cm nearer
    ASSERT_TRUE(solveIk(skeleton, pose, joint("left_wrist"), target).ok());
    EXPECT_LT(glm::distance(worldPosition(skeleton, pose, 20), target), 1e-3f);
    // Law of cosines: sides 0.3, 0.25 and 0.4.
    const float inner = std::acos((0.3f * 0.3f + 0.25f * 0.25f - 0.4f * 0.4f) / (2 * 0.3f * 0.25f));
    EXPECT_NEAR(limitCoordinates(smplxJointLimits()[18], pose.rotations[18]).y, -(3.14159265f - inner), 2e-2f);
    EXPECT_LT(excess(pose), 1e-4f);
}

TEST(InverseKinematics, KneeBendsBackWhenTheFootIsLifted) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    const glm::vec3 target(0.1f, 0.4f, 0.1f);
    ASSERT_TRUE(solveIk(skeleton, pose, joint("left_ankle"), target).ok());
    EXPECT_LT(glm::distance(worldPosition(skeleton, pose, 7), target), 1e-3f);
    const glm::vec3 hip = worldPosition(skeleton, pose, 1), knee = worldPosition(skeleton, pose, 4);
    const glm::vec3 line = glm::normalize(target - hip);
    const glm::vec3 out = (knee - hip) - glm::dot(knee - hip, line) * line;
    EXPECT_GT(out.z, 0.1f) << "the knee points forward of the line from hip to ankle";
}

TEST(InverseKinematics, AStraightLegIsLiftedInItsOwnPlane) {
    const Skeleton skeleton = person();
    // Straight up, and up and forward, where the first small turn would bend the knee over its back.
    for (const glm::vec3 target :
         {glm::vec3(0.1f, 0.11f, 0.0f), glm::vec3(0.1f, 0.15f, 0.1f), glm::vec3(0.1f, 0.3f, 0.2f)}) {
        Pose pose = restPose(kSmplxJointCount);
        const auto result = solveIk(skeleton, pose, joint("left_ankle"), target);
        ASSERT_TRUE(result.ok());
        EXPECT_TRUE(result->reached);
        // Law of cosines: two sides of 0.4; half of the bend turns the hip forward, besides the target's direction.
        const glm::vec3 way = target - glm::vec3(0.1f, 0.9f, 0.0f);
        const float bend = 3.14159265f - 2.0f * std::asin(0.5f * glm::length(way) / 0.4f);
        const glm::vec3 hip = limitCoordinates(smplxJointLimits()[1], pose.rotations[1]);
        const glm::vec3 knee = limitCoordinates(smplxJointLimits()[4], pose.rotations[4]);
        EXPECT_NEAR(knee.x, bend, 0.02f);
        EXPECT_NEAR(hip.x, -0.5f * bend - std::atan2(way.z, -way.y), 0.02f);
        for (float sideways : {hip.y, hip.z, knee.y, knee.z}) EXPECT_NEAR(sideways, 0.0f, 0.01f);
    }
}

TEST(InverseKinematics, ThousandsOfRandomDragsStayWithinLimits) {
    const Skeleton skeleton = person();
    std::mt19937 random(3);
    std::uniform_real_distribution<float> metres(-1.5f, 1.5f);
    std::uniform_int_distribution<int> any(1, kSmplxJointCount - 1);
    Pose pose = restPose(kSmplxJointCount);
    for (int drag = 0; drag < 5000; ++drag) {
        if (drag % 50 == 0) pose = randomPose(random, 0.9f);
        const int j = any(random);
        const float before = excess(pose);
        ASSERT_LT(before, 1e-3f);
        IkOptions options;
        options.keepEndOrientation = drag % 2 == 0;
        ASSERT_TRUE(
            solveIk(skeleton, pose, j, glm::vec3(metres(random), 1 + metres(random), metres(random)), options).ok());
        ASSERT_LT(excess(pose), std::max(before, 2e-4f) + 2e-5f) << "drag " << drag << " of " << smplxJointName(j);
        for (const glm::quat& q : pose.rotations) ASSERT_NEAR(glm::length(q), 1.0f, 1e-5f);
    }
}

TEST(InverseKinematics, OtherJointsStayBitForBit) {
    const Skeleton skeleton = person();
    std::mt19937 random(11);
    const Pose before = randomPose(random, 0.5f);
    Pose pose = before;
    ASSERT_TRUE(solveIk(skeleton, pose, joint("left_wrist"), {0.4f, 1.2f, 0.4f}).ok());
    EXPECT_NE(pose.rotations[16], before.rotations[16]);
    for (std::size_t j = 0; j < pose.rotations.size(); ++j) {
        if (j == 16 || j == 18) continue;
        EXPECT_EQ(pose.rotations[j], before.rotations[j]) << smplxJointName(static_cast<int>(j));
    }
    EXPECT_EQ(pose.translation, before.translation);
}

TEST(InverseKinematics, SmallDragsChangeThePoseLittle) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    pose.rotations[16] = quatFromAxisAngle({0, -0.4f, -0.9f});
    pose.rotations[18] = quatFromAxisAngle({0, -1.0f, 0});
    const glm::vec3 centre = worldPosition(skeleton, pose, 20);
    Pose before = pose;
    float largest = 0.0f;
    for (int step = 1; step <= 400; ++step) { // a circle of 10 cm: 1.6 mm a step
        const float a = 6.2831853f * static_cast<float>(step) / 400.0f;
        const glm::vec3 target = centre + 0.1f * glm::vec3(std::cos(a) - 1.0f, std::sin(a), 0.3f * std::sin(2 * a));
        const auto result = solveIk(skeleton, pose, joint("left_wrist"), target);
        ASSERT_TRUE(result.ok());
        EXPECT_TRUE(result->reached);
        for (std::size_t j : {16u, 18u}) largest = std::max(largest, angle(pose.rotations[j], before.rotations[j]));
        before = pose;
    }
    EXPECT_LT(largest, glm::radians(3.0f));
}

TEST(InverseKinematics, RepeatingADragThatCannotBeReachedDoesNotTremble) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    const glm::vec3 behind(0.1f, 1.5f, -0.8f); // behind the back: the limits stop the arm
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(solveIk(skeleton, pose, joint("left_wrist"), behind).ok());
    const Pose before = pose;
    for (int i = 0; i < 20; ++i) ASSERT_TRUE(solveIk(skeleton, pose, joint("left_wrist"), behind).ok());
    for (std::size_t j = 0; j < pose.rotations.size(); ++j)
        EXPECT_LT(angle(pose.rotations[j], before.rotations[j]), 0.02f);
}

TEST(InverseKinematics, KeepsTheEndsOrientationInTheWorld) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    const glm::quat before = worldRotation(skeleton, pose, joint("left_ankle"));
    IkOptions options;
    options.keepEndOrientation = true;
    const glm::vec3 target(0.1f, 0.2f, 0.1f);
    ASSERT_TRUE(solveIk(skeleton, pose, joint("left_ankle"), target, options).ok());
    EXPECT_LT(glm::distance(worldPosition(skeleton, pose, joint("left_ankle")), target), 1e-3f);
    EXPECT_LT(angle(worldRotation(skeleton, pose, joint("left_ankle")), before), 0.05f);
}

TEST(InverseKinematics, AChosenRootMovesTheLongerChain) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    IkOptions options;
    options.chainRoot = joint("spine1");
    const glm::vec3 target(0.3f, 0.75f, 0.55f); // beyond the arm alone
    const auto result = solveIk(skeleton, pose, joint("left_wrist"), target, options);
    ASSERT_TRUE(result.ok());
    EXPECT_LT(result->residualM, 1e-3f);
    EXPECT_NE(pose.rotations[3], glm::quat(1, 0, 0, 0));
    EXPECT_LT(excess(pose), 1e-4f);
}

TEST(InverseKinematics, DraggingThePelvisMovesTheBody) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    const auto result = solveIk(skeleton, pose, 0, {1, 2, 3});
    ASSERT_TRUE(result.ok());
    EXPECT_TRUE(result->reached);
    EXPECT_LT(glm::distance(worldPosition(skeleton, pose, 0), glm::vec3(1, 2, 3)), 1e-5f);
}

TEST(InverseKinematics, RecordedPosesOutsideTheLimitsDoNotJump) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    pose.rotations[18] = quatFromAxisAngle({0, 0.5f, 0}); // an elbow bent 29 degrees the wrong way
    const Pose before = pose;
    const glm::vec3 wrist = worldPosition(skeleton, pose, 20);
    ASSERT_TRUE(solveIk(skeleton, pose, 20, wrist + glm::vec3(0.002f, 0, 0)).ok());
    EXPECT_LT(angle(pose.rotations[18], before.rotations[18]), 0.1f);
    EXPECT_LT(limitCoordinates(smplxJointLimits()[18], pose.rotations[18]).y, 0.5f + 1e-4f);
}

TEST(InverseKinematics, TurnedRestOrientationsChangeNothingInTheWorld) {
    // The same chain told with joints whose own axes are turned: the drag must end at the same place.
    Skeleton turned;
    turned.names = {"a", "b", "c", "d"};
    turned.parents = {-1, 0, 1, 2};
    turned.restPositions = {{0, 0, 0}, {0, 1, 0}, {0, 2, 0}, {0, 3, 0}};
    turned.restOrientations = {glm::quat(1, 0, 0, 0), quatFromAxisAngle({0.5f, 1, 0}), quatFromAxisAngle({0, 0, 2}),
                               quatFromAxisAngle({1, 1, 1})};
    Pose pose = restPose(4);
    const glm::vec3 target(1.0f, 1.2f, 0.7f);
    IkOptions options;
    options.chainRoot = 0;
    const auto result = solveIk(turned, pose, 3, target, options);
    ASSERT_TRUE(result.ok());
    EXPECT_LT(glm::distance(worldPosition(turned, pose, 3), target), 1e-3f);
}

TEST(InverseKinematics, WrongArgumentsAreNamed) {
    const Skeleton skeleton = person();
    Pose pose = restPose(kSmplxJointCount);
    EXPECT_EQ(solveIk(skeleton, pose, 55, {}).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(solveIk(skeleton, pose, 20, glm::vec3(NAN)).error().code, ErrorCode::InvalidArgument);
    IkOptions options;
    options.chainRoot = joint("right_shoulder"); // not above the left wrist
    EXPECT_EQ(solveIk(skeleton, pose, 20, {}, options).error().code, ErrorCode::InvalidArgument);
    Pose small = restPose(3);
    EXPECT_EQ(solveIk(skeleton, small, 20, {}).error().code, ErrorCode::InvalidArgument);
}

} // namespace
} // namespace ars
