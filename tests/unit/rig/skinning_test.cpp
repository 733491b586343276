#include "engine/rig/body_parts.h"
#include "engine/rig/joint_names.h"
#include "engine/rig/pose.h"
#include "engine/rig/skinning.h"
#include "engine/rig/skinning_math.h"
#include "tests/support/test_data.h"

#include <Eigen/Dense>
#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace ars {
namespace {

using Matrix3 = Eigen::Matrix3d;

glm::mat4 rigidMatrix(const glm::vec3& axisAngle, const glm::vec3& translation) {
    glm::mat4 matrix = glm::mat4_cast(quatFromAxisAngle(axisAngle));
    matrix[3] = glm::vec4(translation, 1.0f);
    return matrix;
}

/// N points, each with `influences` random joints.
SkinWeights randomWeights(std::size_t points, std::size_t joints, int influences, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> weight(0.1f, 1.0f);
    std::uniform_int_distribution<std::size_t> joint(0, joints - 1);
    std::vector<float> dense(points * joints, 0.0f);
    for (std::size_t i = 0; i < points; ++i) {
        for (int k = 0; k < influences; ++k) dense[i * joints + joint(random)] = weight(random);
    }
    return *sparseWeights(dense, points, joints);
}

std::vector<glm::vec3> randomPoints(std::size_t count, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<float> normal;
    std::vector<glm::vec3> points(count);
    for (glm::vec3& p : points) p = {normal(random), normal(random), normal(random)};
    return points;
}

std::vector<glm::mat4> randomRigids(std::size_t count, float angle, unsigned seed) {
    const std::vector<glm::vec3> turns = randomPoints(count, seed), moves = randomPoints(count, seed + 1);
    std::vector<glm::mat4> matrices;
    for (std::size_t j = 0; j < count; ++j) matrices.push_back(rigidMatrix(angle * turns[j], moves[j]));
    return matrices;
}

template <typename T>
Affine<T> affineOf(const Matrix3& m) {
    Affine<T> a;
    for (int r = 0; r < 3; ++r) a.row[r] = glm::vec<4, T>(T(m(r, 0)), T(m(r, 1)), T(m(r, 2)), T(0));
    return a;
}

template <typename T>
Matrix3 matrixOf(const glm::qua<T>& q) {
    return Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
}

Matrix3 randomMatrix(std::mt19937& random) {
    std::normal_distribution<double> normal;
    Matrix3 m;
    for (int i = 0; i < 9; ++i) m(i / 3, i % 3) = normal(random);
    return m;
}

/// The nearest rotation by singular values: U diag(1, 1, det(U V^T)) V^T.
Matrix3 nearestRotation(const Matrix3& m) {
    const Eigen::JacobiSVD<Matrix3> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Matrix3 d = Matrix3::Identity();
    d(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
    return svd.matrixU() * d * svd.matrixV().transpose();
}

// ---------------------------------------------------------------------------------------------- polar rotation

TEST(PolarRotation, IsTheNearestRotationByEigensSvd) {
    std::mt19937 random(1);
    double worstDouble = 0.0, worstFloat = 0.0;
    int tried = 0;
    while (tried < 20000) {
        const Matrix3 m = randomMatrix(random);
        const Eigen::Vector3d s = m.jacobiSvd().singularValues();
        const double smallest = m.determinant() < 0.0 ? -s[2] : s[2];
        // The nearest rotation is unique only while s2 + s3 > 0; near that edge it is ill-conditioned for everyone.
        if (s[1] + smallest < 0.05 * s[0]) continue;
        ++tried;
        const Matrix3 expected = nearestRotation(m);
        worstDouble = std::max(worstDouble, (matrixOf(polarRotation(affineOf<double>(m))) - expected).norm());
        worstFloat = std::max(worstFloat, (matrixOf(polarRotation(affineOf<float>(m))) - expected).norm());
    }
    EXPECT_LT(worstDouble, 1e-10);
    // Conditioning 1/(s2+s3) of up to 20 times the rounding of the input, 6e-8 a number.
    EXPECT_LT(worstFloat, 2e-4);
}

TEST(PolarRotation, GivesBackRotationsWhateverTheirScale) {
    std::mt19937 random(2);
    std::uniform_real_distribution<double> exponent(-4.0, 4.0);
    for (int i = 0; i < 5000; ++i) {
        const Matrix3 rotation = nearestRotation(randomMatrix(random));
        const glm::quat q = polarRotation(affineOf<float>(rotation * std::pow(10.0, exponent(random))));
        EXPECT_LT((matrixOf(q) - rotation).norm(), 2e-6);
        EXPECT_NEAR(glm::length(q), 1.0f, 1e-6f);
        EXPECT_GE(q.w, 0.0f);
    }
}

TEST(PolarRotation, ReflectionsAndSingularMatricesReachTheBestTrace) {
    std::mt19937 random(3);
    for (int i = 0; i < 2000; ++i) {
        Matrix3 m = randomMatrix(random);
        const Eigen::JacobiSVD<Matrix3> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
        const std::array<Eigen::Vector3d, 5> cases = {Eigen::Vector3d(1, 1, -1), Eigen::Vector3d(1, 0.5, -0.5),
                                                      Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(1, 1e-4, 0),
                                                      Eigen::Vector3d(1, 1, 0)};
        const Eigen::Vector3d s = cases[static_cast<std::size_t>(i) % cases.size()];
        m = nearestRotation(svd.matrixU()) * s.asDiagonal() * nearestRotation(svd.matrixV()).transpose();
        const Matrix3 found = matrixOf(polarRotation(affineOf<float>(m)));
        EXPECT_NEAR((found.transpose() * found - Matrix3::Identity()).norm(), 0.0, 1e-5);
        EXPECT_NEAR((found.transpose() * m).trace(), (nearestRotation(m).transpose() * m).trace(), 1e-5);
    }
}

TEST(PolarRotation, OppositeHalfTurnsStillGiveARotation) {
    // Half of one turn by +90 degrees, half of its opposite: rank one, the case in which Gram-Schmidt breaks down.
    const glm::mat4 a = rigidMatrix({0, 0, glm::half_pi<float>()}, {}),
                    b = rigidMatrix({0, 0, -glm::half_pi<float>()}, {});
    const glm::quat q = polarRotation(affineFrom<float>(0.5f * a + 0.5f * b));
    EXPECT_NEAR(glm::length(q), 1.0f, 1e-6f);
    EXPECT_NEAR(std::fabs((q * glm::vec3(0, 0, 1)).z), 1.0f, 1e-5f);
}

TEST(PolarRotation, ZeroAndNonFiniteMatricesGiveTheIdentity) {
    Affine<float> zero{};
    EXPECT_EQ(polarRotation(zero), glm::quat(1, 0, 0, 0));
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        Affine<float> broken = affineFrom<float>(glm::mat4(1.0f));
        broken.row[1].z = bad;
        EXPECT_EQ(polarRotation(broken), glm::quat(1, 0, 0, 0));
    }
}

// ---------------------------------------------------------------------------------------------- weights

TEST(SparseWeights, KeepTheEightLargestLargestFirstAndSumToOne) {
    std::vector<float> dense(12);
    for (std::size_t j = 0; j < 12; ++j) dense[j] = static_cast<float>(j + 1);
    dense[11] = -3.0f; // clipped
    const auto weights = sparseWeights(dense, 1, 12);
    ASSERT_TRUE(weights.ok());
    const float sum = 4 + 5 + 6 + 7 + 8 + 9 + 10 + 11;
    for (std::size_t k = 0; k < 8; ++k) {
        EXPECT_EQ(weights->joints[k], 10 - k);
        EXPECT_FLOAT_EQ(weights->weights[k], static_cast<float>(11 - k) / sum);
    }
}

TEST(SparseWeights, DenseAndBackIsTheSame) {
    const SkinWeights weights = randomWeights(500, 55, 6, 7);
    const std::vector<float> dense = denseWeights(weights, 55);
    for (std::size_t i = 0; i < 500; ++i) {
        double sum = 0.0;
        for (std::size_t j = 0; j < 55; ++j) sum += dense[i * 55 + j];
        EXPECT_NEAR(sum, 1.0, 1e-6);
    }
    const auto again = sparseWeights(dense, 500, 55);
    ASSERT_TRUE(again.ok());
    for (std::size_t i = 0; i < weights.weights.size(); ++i) EXPECT_NEAR(again->weights[i], weights.weights[i], 1e-6f);
    EXPECT_EQ(again->joints, weights.joints);
}

TEST(SparseWeights, RowsWithoutWeightOrWithNanAreRefusedByNumber) {
    std::vector<float> dense(3 * 55, 0.0f);
    dense[3] = dense[2 * 55] = 1.0f;
    const auto zero = sparseWeights(dense, 3, 55);
    ASSERT_FALSE(zero.ok());
    EXPECT_EQ(zero.error().code, ErrorCode::BadFile);
    EXPECT_NE(zero.error().describe().find("row 1"), std::string::npos) << zero.error().describe();
    dense[55 + 4] = 1.0f;
    dense[2 * 55 + 9] = std::numeric_limits<float>::quiet_NaN();
    const auto nan = sparseWeights(dense, 3, 55);
    ASSERT_FALSE(nan.ok());
    EXPECT_NE(nan.error().describe().find("row 2: a weight is not a finite number"), std::string::npos)
        << nan.error().describe();
    EXPECT_FALSE(sparseWeights(dense, 4, 55).ok());
    EXPECT_FALSE(sparseWeights(dense, 0, 0).ok());
}

// ---------------------------------------------------------------------------------------------- skinning

TEST(Skinning, EqualsTheFormulaInDoubleByEigen) {
    constexpr std::size_t kPoints = 5000, kJoints = 55;
    const SkinWeights weights = randomWeights(kPoints, kJoints, 8, 11);
    const std::vector<glm::mat4> matrices = randomRigids(kJoints, 1.0f, 12);
    const std::vector<glm::vec3> rest = randomPoints(kPoints, 14);
    std::vector<glm::vec3> points(kPoints);
    ASSERT_TRUE(skinPoints(matrices, weights, rest, points).ok());
    const std::vector<float> dense = denseWeights(weights, kJoints);
    double worst = 0.0;
    for (std::size_t i = 0; i < kPoints; ++i) {
        Eigen::Matrix4d blend = Eigen::Matrix4d::Zero();
        for (std::size_t j = 0; j < kJoints; ++j) {
            blend +=
                double(dense[i * kJoints + j]) * Eigen::Map<const Eigen::Matrix4f>(&matrices[j][0][0]).cast<double>();
        }
        const Eigen::Vector4d expected = blend * Eigen::Vector4d(rest[i].x, rest[i].y, rest[i].z, 1.0);
        for (int c = 0; c < 3; ++c) worst = std::max(worst, std::fabs(expected[c] - double(points[i][c])));
    }
    EXPECT_LT(worst, 2e-6); // eight rounded sums of numbers of size one
}

TEST(Skinning, OneRigidMotionOfAllJointsMovesEverythingRigidly) {
    const SkinWeights weights = randomWeights(300, 10, 5, 21);
    const glm::mat4 motion = rigidMatrix({0.3f, -1.2f, 0.7f}, {0.1f, 2.0f, -3.0f});
    const std::vector<glm::mat4> matrices(10, motion);
    const std::vector<glm::vec3> rest = randomPoints(300, 22);
    std::vector<glm::vec3> normals = randomPoints(300, 23);
    for (glm::vec3& n : normals) n = glm::normalize(n);
    std::vector<glm::vec3> points(300), turned(300);
    ASSERT_TRUE(skinPointsAndNormals(matrices, weights, rest, normals, points, turned).ok());
    std::vector<glm::quat> rotations(300);
    ASSERT_TRUE(skinRotations(matrices, weights, rotations).ok());
    for (std::size_t i = 0; i < 300; ++i) {
        EXPECT_LT(glm::distance(points[i], glm::vec3(motion * glm::vec4(rest[i], 1.0f))), 3e-6f);
        EXPECT_LT(glm::distance(turned[i], glm::mat3(motion) * normals[i]), 3e-6f);
        EXPECT_LT(glm::distance(rotations[i] * normals[i], turned[i]), 1e-6f);
    }
}

TEST(Skinning, NormalsStayUnitAndAreNotShearedByABlend) {
    // Half still, half turned by 120 degrees about z: the blend shrinks the plane to a half and turns it by 60.
    std::vector<glm::mat4> matrices = {glm::mat4(1.0f), rigidMatrix({0, 0, glm::radians(120.0f)}, {})};
    const std::vector<float> dense(2 * 200, 0.5f);
    const SkinWeights weights = *sparseWeights(dense, 200, 2);
    std::vector<glm::vec3> normals = randomPoints(200, 31), rest = randomPoints(200, 32);
    for (glm::vec3& n : normals) n = glm::normalize(n);
    std::vector<glm::vec3> points(200), turned(200);
    ASSERT_TRUE(skinPointsAndNormals(matrices, weights, rest, normals, points, turned).ok());
    const glm::mat3 expected(rigidMatrix({0, 0, glm::radians(60.0f)}, {}));
    for (std::size_t i = 0; i < 200; ++i) {
        EXPECT_NEAR(glm::length(turned[i]), 1.0f, 1e-6f);
        EXPECT_LT(glm::distance(turned[i], expected * normals[i]), 2e-6f);
    }
}

TEST(Skinning, FloatAndDoubleOfTheSameMathsAgree) {
    const SkinWeights weights = randomWeights(2000, 20, 8, 41);
    const std::vector<glm::mat4> matrices = randomRigids(20, 0.5f, 42);
    std::vector<Affine<float>> single;
    std::vector<Affine<double>> twice;
    for (const glm::mat4& m : matrices) {
        single.push_back(affineFrom<float>(m));
        twice.push_back(affineFrom<double>(m));
    }
    for (std::size_t i = 0; i < 2000; ++i) {
        const std::vector<double> w(&weights.weights[i * 8], &weights.weights[i * 8] + 8);
        const Affine<float> a = blendAffine(single.data(), &weights.joints[i * 8], &weights.weights[i * 8], 8);
        const Affine<double> b = blendAffine(twice.data(), &weights.joints[i * 8], w.data(), 8);
        EXPECT_LT(glm::distance(glm::dvec3(transformPoint(a, glm::vec3(0.3f, 0.4f, 0.5f))),
                                transformPoint(b, glm::dvec3(glm::vec3(0.3f, 0.4f, 0.5f)))),
                  3e-6);
        // Turns of up to a radian or so keep the blends well away from singular ones.
        EXPECT_LT(glm::length(glm::dquat(polarRotation(a)) - polarRotation(b)), 2e-6);
    }
}

TEST(Skinning, InPlaceIsAllowed) {
    const SkinWeights weights = randomWeights(5000, 20, 8, 51);
    const std::vector<glm::mat4> matrices = randomRigids(20, 1.0f, 52);
    std::vector<glm::vec3> points = randomPoints(5000, 53), apart(5000);
    ASSERT_TRUE(skinPoints(matrices, weights, points, apart).ok());
    ASSERT_TRUE(skinPoints(matrices, weights, points, points).ok());
    EXPECT_EQ(points, apart);
}

TEST(Skinning, WrongSizesAndJointsAreRefused) {
    const SkinWeights weights = randomWeights(10, 5, 3, 61);
    const std::vector<glm::mat4> matrices(5, glm::mat4(1.0f));
    std::vector<glm::vec3> rest(10), points(9);
    const Status small = skinPoints(matrices, weights, rest, points);
    ASSERT_FALSE(small.ok());
    EXPECT_EQ(small.error().describe(), "skinning: 9 points to fill, expected 10 (one for each point)");
    points.resize(10);
    SkinWeights beyond = weights;
    beyond.joints[13] = 5;
    const Status outside = skinPoints(matrices, beyond, rest, points);
    ASSERT_FALSE(outside.ok());
    EXPECT_EQ(outside.error().describe(), "skinning: a point follows joint 5, but there are only 5 joint matrices");
    beyond = weights;
    beyond.joints.pop_back();
    EXPECT_FALSE(skinPoints(matrices, beyond, rest, points).ok());
    EXPECT_TRUE(skinPoints({}, SkinWeights{}, {}, {}).ok());
}

template <typename T>
Buffer uploaded(const Device& device, const std::vector<T>& values) {
    auto buffer = Buffer::allocate(device, values.size() * sizeof(T), "skinning test");
    EXPECT_TRUE(buffer.ok());
    EXPECT_TRUE(uploadBuffer(*buffer, std::as_bytes(std::span(values))).ok());
    return std::move(buffer).value();
}

TEST(Skinning, EveryDeviceGivesTheHostsAnswer) {
    constexpr std::size_t kPoints = 20000;
    const SkinWeights weights = randomWeights(kPoints, 55, 8, 71);
    const std::vector<glm::mat4> matrices = randomRigids(55, 0.4f, 72);
    const std::vector<glm::vec3> rest = randomPoints(kPoints, 73), directions = randomPoints(kPoints, 74);
    std::vector<glm::vec3> normals;
    for (const glm::vec3& n : directions) normals.push_back(glm::normalize(n));
    std::vector<glm::vec3> points(kPoints), turned(kPoints);
    ASSERT_TRUE(skinPointsAndNormals(matrices, weights, rest, normals, points, turned).ok());
    for (const Device& device : availableDevices()) {
        std::printf("device %s\n", deviceName(device).c_str());
        const Buffer m = uploaded(device, matrices), j = uploaded(device, weights.joints);
        const Buffer w = uploaded(device, weights.weights), p = uploaded(device, rest), n = uploaded(device, normals);
        Buffer outPoints = uploaded(device, std::vector<glm::vec3>(kPoints));
        Buffer outNormals = uploaded(device, std::vector<glm::vec3>(kPoints));
        ASSERT_TRUE(skinOnDevice(m, j, w, p, &n, outPoints, &outNormals, kPoints).ok());
        std::vector<glm::vec3> gotPoints(kPoints), gotNormals(kPoints);
        ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(gotPoints)), outPoints).ok());
        ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(gotNormals)), outNormals).ok());
        for (std::size_t i = 0; i < kPoints; ++i) {
            ASSERT_LT(glm::distance(gotPoints[i], points[i]), 2e-6f);
            // Blends of random turns come near to singular; there the rotation magnifies the rounding.
            ASSERT_LT(glm::distance(gotNormals[i], turned[i]), 1e-4f);
        }
        EXPECT_TRUE(skinOnDevice(m, j, w, p, nullptr, outPoints, nullptr, kPoints).ok());
        EXPECT_FALSE(skinOnDevice(m, j, w, p, &n, outPoints, nullptr, kPoints).ok());
        EXPECT_FALSE(skinOnDevice(m, j, w, p, nullptr, outPoints, nullptr, kPoints + 1).ok());
    }
}

// ---------------------------------------------------------------------------------------------- skeletons and poses

/// A chain along x with bones of one metre.
Skeleton chain(int joints) {
    Skeleton skeleton;
    for (int j = 0; j < joints; ++j) {
        skeleton.names.push_back("joint" + std::to_string(j));
        skeleton.parents.push_back(j - 1);
        skeleton.restPositions.emplace_back(static_cast<float>(j), 0.0f, 0.0f);
        skeleton.restOrientations.emplace_back(1.0f, 0.0f, 0.0f, 0.0f);
    }
    return skeleton;
}

TEST(Skeleton, BrokenTreesAreNamed) {
    EXPECT_TRUE(validateSkeleton(chain(5)).ok());
    Skeleton cyclic = chain(5);
    cyclic.parents = {-1, 3, 1, 2, 3};
    EXPECT_EQ(validateSkeleton(cyclic).error().describe(),
              "joint 1 (\"joint1\"): its parents form a cycle through joint 3 (\"joint3\"), expected a tree");
    cyclic.parents[1] = 1;
    EXPECT_NE(validateSkeleton(cyclic).error().describe().find("a cycle through itself"), std::string::npos);
    Skeleton forward = chain(5);
    forward.parents = {-1, 2, 0, 2, 3};
    EXPECT_NE(validateSkeleton(forward).error().describe().find("comes after it"), std::string::npos);
    Skeleton outside = chain(5);
    outside.parents[3] = 99;
    EXPECT_NE(validateSkeleton(outside).error().describe().find("its parent is 99"), std::string::npos);
    Skeleton uneven = chain(5);
    uneven.names.pop_back();
    EXPECT_FALSE(validateSkeleton(uneven).ok());
    Skeleton broken = chain(5);
    broken.restPositions[2].y = std::numeric_limits<float>::quiet_NaN();
    EXPECT_NE(validateSkeleton(broken).error().describe().find("joint2"), std::string::npos);
    EXPECT_FALSE(validateSkeleton(Skeleton{}).ok());
}

TEST(Skeleton, AMillionJointsAreRefused) {
    const Status status = validateSkeleton(chain(1000000));
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, ErrorCode::LimitExceeded);
    EXPECT_EQ(status.error().describe(), "the skeleton has 1000000 joints, the limit is 4096");
}

TEST(Skeleton, SmplxTableIsATreeWithEveryNameOnce) {
    const Skeleton skeleton = smplxSkeleton(std::vector<glm::vec3>(55));
    EXPECT_TRUE(validateSkeleton(skeleton).ok());
    for (int j = 0; j < 55; ++j) {
        EXPECT_EQ(smplxJointIndex(smplxJointName(j)), j);
        EXPECT_EQ(skeleton.find(smplxJointName(j)), j);
        EXPECT_EQ(skeleton.parents[static_cast<std::size_t>(j)], smplxJointParent(j));
    }
    EXPECT_EQ(smplxJointIndex("tail"), -1);
    EXPECT_EQ(skeleton.children(9), (std::vector<int>{12, 13, 14}));
    EXPECT_EQ(smplxJointName(smplxJointParent(smplxJointIndex("right_thumb1"))), "right_wrist");
}

TEST(Pose, RestPoseMovesNothing) {
    const Skeleton skeleton = chain(6);
    for (const glm::mat4& matrix : skinningMatrices(skeleton, restPose(6))) EXPECT_EQ(matrix, glm::mat4(1.0f));
    const std::vector<glm::mat4> world = jointWorldMatrices(skeleton, restPose(6));
    for (std::size_t j = 0; j < 6; ++j) EXPECT_EQ(glm::vec3(world[j][3]), skeleton.restPositions[j]);
}

TEST(Pose, ChildrenFollowTheirParents) {
    // Elbow of 90 degrees at each of two joints of a chain: corners of a square, by hand.
    Pose pose = restPose(4);
    pose.rotations[1] = pose.rotations[2] = quatFromAxisAngle({0, 0, glm::half_pi<float>()});
    pose.translation = {10.0f, 20.0f, 30.0f};
    const std::vector<glm::mat4> world = jointWorldMatrices(chain(4), pose);
    const std::vector<glm::vec3> expected = {{10, 20, 30}, {11, 20, 30}, {11, 21, 30}, {10, 21, 30}};
    for (std::size_t j = 0; j < 4; ++j) EXPECT_LT(glm::distance(glm::vec3(world[j][3]), expected[j]), 3e-6f);
}

TEST(Pose, RootTurnsAboutItsOwnRestPosition) {
    Skeleton skeleton = chain(2);
    for (glm::vec3& p : skeleton.restPositions) p += glm::vec3(5.0f, 0.0f, 0.0f);
    Pose pose = restPose(2);
    pose.rotations[0] = quatFromAxisAngle({0, glm::pi<float>(), 0});
    pose.translation = {0.0f, 1.0f, 0.0f};
    const glm::vec3 moved(skinningMatrices(skeleton, pose)[1] * glm::vec4(6.0f, 0.0f, 0.0f, 1.0f));
    EXPECT_LT(glm::distance(moved, glm::vec3(4.0f, 1.0f, 0.0f)), 1e-5f);
}

TEST(Pose, RestOrientationsTurnInTheJointsOwnAxes) {
    // The second joint's z axis points along the model's x: a turn about its z is a turn about the model's x.
    Skeleton skeleton = chain(3);
    skeleton.restOrientations[1] = quatFromAxisAngle({0, glm::half_pi<float>(), 0});
    Pose pose = restPose(3);
    for (const glm::mat4& matrix : skinningMatrices(skeleton, pose)) {
        for (int c = 0; c < 4; ++c) EXPECT_LT(glm::distance(matrix[c], glm::mat4(1.0f)[c]), 1e-6f);
    }
    pose.rotations[1] = quatFromAxisAngle({0, 0, glm::half_pi<float>()});
    const glm::vec3 moved(skinningMatrices(skeleton, pose)[1] * glm::vec4(1.0f, 1.0f, 0.0f, 1.0f));
    EXPECT_LT(glm::distance(moved, glm::vec3(1.0f, 0.0f, 1.0f)), 1e-6f);
}

TEST(Pose, AxisAngleThereAndBack) {
    for (const glm::vec3 r : {glm::vec3(0.0f), glm::vec3(1e-9f, 0, 0), glm::vec3(1e-4f, -2e-4f, 0),
                              glm::vec3(0.5f, 1, -2), glm::vec3(3.14f, 0, 0), glm::vec3(0, 0, -3.1415f)}) {
        EXPECT_LT(glm::distance(axisAngleFromQuat(quatFromAxisAngle(r)), r), 1e-6f + 1e-6f * glm::length(r));
    }
    // More than half a turn comes back as the shorter way.
    EXPECT_LT(
        glm::distance(axisAngleFromQuat(quatFromAxisAngle({4.0f, 0, 0})), glm::vec3(4.0f - glm::two_pi<float>(), 0, 0)),
        2e-6f);
    EXPECT_LT(glm::distance(axisAngleFromQuat(glm::quat(-1, 0, 0, 0)), glm::vec3(0.0f)), 1e-7f);
}

TEST(Pose, CanonicalPoseTurnsTheHipsOut) {
    const Pose pose = canonicalPose();
    ASSERT_EQ(pose.rotations.size(), 55u);
    for (std::size_t j = 0; j < 55; ++j) {
        const float expected = j == 1 ? 25.0f : j == 2 ? -25.0f : 0.0f;
        EXPECT_LT(glm::distance(axisAngleFromQuat(pose.rotations[j]), glm::vec3(0, 0, glm::radians(expected))), 1e-6f);
    }
    // A leg that hangs down from the left hip moves to the body's left (+x).
    EXPECT_GT((pose.rotations[1] * glm::vec3(0, -1, 0)).x, 0.4f);
}

TEST(Pose, MirroringMovesTheReflectedBody) {
    // A skeleton that is its own mirror image: joints of the pose's mirror image are the mirror images of its joints.
    std::vector<glm::vec3> positions = randomPoints(55, 81);
    for (int j = 0; j < 55; ++j) {
        const std::string name(smplxJointName(j));
        glm::vec3& p = positions[static_cast<std::size_t>(j)];
        if (name.rfind("right_", 0) == 0) {
            const auto left = static_cast<std::size_t>(smplxJointIndex("left_" + name.substr(6)));
            p = positions[left] * glm::vec3(-1, 1, 1);
        } else if (name.rfind("left_", 0) != 0) {
            p.x = 0.0f;
        }
    }
    const Skeleton skeleton = smplxSkeleton(positions);
    Pose pose = restPose(55);
    const std::vector<glm::vec3> turns = randomPoints(55, 82);
    for (std::size_t j = 0; j < 55; ++j) pose.rotations[j] = quatFromAxisAngle(0.5f * turns[j]);
    pose.translation = {1, 2, 3};
    const std::vector<glm::mat4> world = jointWorldMatrices(skeleton, pose);
    const std::vector<glm::mat4> mirrored = jointWorldMatrices(skeleton, mirroredPose(pose));
    for (const auto& [left, right] : {std::pair{20, 21}, std::pair{39, 54}, std::pair{10, 11}, std::pair{15, 15}}) {
        const glm::vec3 expected = glm::vec3(-1, 1, 1) * glm::vec3(world[static_cast<std::size_t>(left)][3]);
        EXPECT_LT(glm::distance(glm::vec3(mirrored[static_cast<std::size_t>(right)][3]), expected), 1e-5f);
    }
    const Pose back = mirroredPose(mirroredPose(pose));
    EXPECT_EQ(back.rotations, pose.rotations);
}

TEST(Pose, InterpolationTakesTheShorterWayAtEvenSpeed) {
    Pose a = restPose(1), b = restPose(1);
    b.rotations[0] = -quatFromAxisAngle({0, 0.8f, 0}); // the same turn with the other sign
    b.translation = {4, 0, 0};
    b.expression = {1.0f, 2.0f};
    const Pose half = interpolatePoses(a, b, 0.25f);
    EXPECT_LT(glm::distance(axisAngleFromQuat(half.rotations[0]), glm::vec3(0, 0.2f, 0)), 1e-6f);
    EXPECT_EQ(half.translation, glm::vec3(1, 0, 0));
    EXPECT_EQ(half.expression, (std::vector<float>{0.25f, 0.5f}));
}

// ---------------------------------------------------------------------------------------------- parts and names

TEST(BodyParts, TableEqualsTheDesign) {
    struct Row {
        const char* name;
        float radiusM;
        std::vector<int> joints;
    };
    // Design section 4: rows "radii r_init (m)" and "parts".
    std::vector<Row> rows = {{"torso", 0.25f, {0, 3, 6, 9}},
                             {"hip", 0.20f, {1, 2}},
                             {"knee", 0.12f, {4, 5}},
                             {"foot", 0.10f, {7, 8, 10, 11}},
                             {"head", 0.15f, {12, 15, 22, 23, 24}},
                             {"shoulder", 0.15f, {13, 14, 16, 17}},
                             {"elbow", 0.10f, {18, 19}},
                             {"wrist", 0.06f, {20, 21}},
                             {"hand", 0.04f, {}}};
    for (int j = 25; j <= 54; ++j) rows.back().joints.push_back(j);
    ASSERT_EQ(rows.size(), static_cast<std::size_t>(kBodyPartCount));
    int covered = 0;
    for (std::size_t p = 0; p < rows.size(); ++p) {
        const auto part = static_cast<BodyPart>(p);
        EXPECT_EQ(bodyPartName(part), rows[p].name);
        EXPECT_EQ(bodyPartInitialRadiusM(part), rows[p].radiusM);
        for (const int joint : rows[p].joints) EXPECT_EQ(smplxJointPart(joint), part) << joint;
        covered += static_cast<int>(rows[p].joints.size());
    }
    EXPECT_EQ(covered, kSmplxJointCount);
}

struct NamedJoint {
    const char* name;
    const char* joint;
};

void expectNames(const std::vector<NamedJoint>& rig) {
    std::vector<std::string> names;
    for (const NamedJoint& joint : rig) names.emplace_back(joint.name);
    const std::vector<int> found = smplxJointsForNames(names);
    for (std::size_t i = 0; i < rig.size(); ++i) {
        EXPECT_EQ(found[i] < 0 ? "" : std::string(smplxJointName(found[i])), rig[i].joint) << rig[i].name;
    }
}

TEST(JointNames, Mixamo) {
    expectNames({{"mixamorig:Hips", "pelvis"},
                 {"mixamorig:Spine", "spine1"},
                 {"mixamorig:Spine1", "spine2"},
                 {"mixamorig:Spine2", "spine3"},
                 {"mixamorig:Neck", "neck"},
                 {"mixamorig:Head", "head"},
                 {"mixamorig:HeadTop_End", ""},
                 {"mixamorig:LeftShoulder", "left_collar"},
                 {"mixamorig:LeftArm", "left_shoulder"},
                 {"mixamorig:LeftForeArm", "left_elbow"},
                 {"mixamorig:LeftHand", "left_wrist"},
                 {"mixamorig:LeftHandThumb1", "left_thumb1"},
                 {"mixamorig:LeftHandIndex3", "left_index3"},
                 {"mixamorig:LeftHandIndex4", ""},
                 {"mixamorig:RightHandPinky2", "right_pinky2"},
                 {"mixamorig:RightUpLeg", "right_hip"},
                 {"mixamorig:RightLeg", "right_knee"},
                 {"mixamorig:RightFoot", "right_ankle"},
                 {"mixamorig:RightToeBase", "right_foot"},
                 {"mixamorig:RightToe_End", ""}});
    EXPECT_EQ(smplxJointForName("mixamorig:LeftShoulder"), smplxJointIndex("left_collar"));
    EXPECT_EQ(smplxJointForName("mixamorig:Spine1"), smplxJointIndex("spine2"));
}

TEST(JointNames, MakeHuman) {
    expectNames({{"root", "pelvis"},
                 {"spine05", "pelvis"},
                 {"spine04", "spine1"},
                 {"spine03", "spine1"},
                 {"spine02", "spine2"},
                 {"spine01", "spine3"},
                 {"breast.L", ""},
                 {"neck01", "neck"},
                 {"head", "head"},
                 {"jaw", "jaw"},
                 {"eye.R", "right_eye_smplhf"},
                 {"clavicle.L", "left_collar"},
                 {"shoulder01.L", "left_collar"},
                 {"upperarm01.L", "left_shoulder"},
                 {"upperarm02.L", "left_shoulder"},
                 {"lowerarm01.R", "right_elbow"},
                 {"wrist.R", "right_wrist"},
                 {"metacarpal1.R", ""},
                 {"finger1-1.R", "right_thumb1"},
                 {"finger2-3.L", "left_index3"},
                 {"finger5-2.L", "left_pinky2"},
                 {"pelvis.L", ""},
                 {"upperleg01.L", "left_hip"},
                 {"lowerleg02.L", "left_knee"},
                 {"foot.L", "left_ankle"},
                 {"toe2-1.L", "left_foot"}});
}

TEST(JointNames, CmuAndOtherMotionCaptures) {
    expectNames({{"hip", "pelvis"},
                 {"abdomen", "spine1"},
                 {"chest", "spine2"},
                 {"neck", "neck"},
                 {"leftEye", "left_eye_smplhf"},
                 {"rCollar", "right_collar"},
                 {"rShldr", "right_shoulder"},
                 {"rForeArm", "right_elbow"},
                 {"rHand", "right_wrist"},
                 {"rThumb2", "right_thumb2"},
                 {"lMid1", "left_middle1"},
                 {"lPinky2", "left_pinky2"},
                 {"lButtock", ""},
                 {"lThigh", "left_hip"},
                 {"lShin", "left_knee"},
                 {"lFoot", "left_ankle"}});
    expectNames({{"Hips", "pelvis"},
                 {"Chest", "spine2"},
                 {"Chest2", "spine3"},
                 {"RightCollar", "right_collar"},
                 {"RightShoulder", "right_shoulder"},
                 {"RightElbow", "right_elbow"},
                 {"RightWrist", "right_wrist"},
                 {"LeftHip", "left_hip"},
                 {"LeftKnee", "left_knee"},
                 {"LeftAnkle", "left_ankle"},
                 {"LeftToe", "left_foot"}});
    expectNames({{"Hips", "pelvis"},
                 {"LHipJoint", ""},
                 {"LeftHip", "left_hip"},
                 {"LeftAnkle", "left_ankle"},
                 {"lowerback", "spine1"},
                 {"lowerneck", "neck"},
                 {"LeftWrist", "left_wrist"},
                 {"lhand", "left_wrist"},
                 {"LFingers", "left_middle1"},
                 {"LThumb", "left_thumb1"}});
}

TEST(JointNames, BlenderAndEngines) {
    expectNames({{"spine", "pelvis"},
                 {"spine.001", "spine1"},
                 {"spine.003", "spine3"},
                 {"spine.006", "head"},
                 {"shoulder.L", "left_collar"},
                 {"upper_arm.L", "left_shoulder"},
                 {"forearm.L", "left_elbow"},
                 {"hand.L", "left_wrist"},
                 {"f_index.01.L", "left_index1"},
                 {"thumb.03.R", "right_thumb3"},
                 {"palm.01.L", ""},
                 {"thigh.R", "right_hip"},
                 {"shin.R", "right_knee"},
                 {"foot.R", "right_ankle"},
                 {"toe.R", "right_foot"},
                 {"heel.02.R", ""}});
    EXPECT_EQ(smplxJointForName("DEF-thigh.L.001"), smplxJointIndex("left_hip"));
    EXPECT_EQ(smplxJointForName("ORG-spine"), smplxJointIndex("pelvis"));
    expectNames({{"pelvis", "pelvis"},
                 {"spine_01", "spine1"},
                 {"spine_03", "spine3"},
                 {"clavicle_l", "left_collar"},
                 {"upperarm_l", "left_shoulder"},
                 {"lowerarm_l", "left_elbow"},
                 {"hand_l", "left_wrist"},
                 {"index_02_l", "left_index2"},
                 {"thigh_r", "right_hip"},
                 {"calf_r", "right_knee"},
                 {"ball_r", "right_foot"}});
    expectNames({{"J_Bip_C_Hips", "pelvis"},
                 {"J_Bip_L_UpperArm", "left_shoulder"},
                 {"leftLittleIntermediate", "left_pinky2"},
                 {"leftThumbProximal", "left_thumb2"},
                 {"leftIndexProximal", "left_index1"}});
}

TEST(JointNames, EverySmplxNameIsItself) {
    std::vector<std::string> names;
    for (int j = 0; j < 55; ++j) {
        names.emplace_back(smplxJointName(j));
        EXPECT_EQ(smplxJointForName(names.back()), j) << names.back();
    }
    const std::vector<int> all = smplxJointsForNames(names);
    for (int j = 0; j < 55; ++j) EXPECT_EQ(all[static_cast<std::size_t>(j)], j) << names[static_cast<std::size_t>(j)];
    for (const char* noise :
         {"", ".", "_", "L", "left", "::", "tail_01", "Armature", "camera", "lamp", "rig", "large"}) {
        EXPECT_EQ(smplxJointForName(noise), -1) << noise;
    }
}

TEST(BodyParts, UnknownJointsInheritFromTheirParent) {
    Skeleton skeleton;
    skeleton.names = {"Armature", "hips",           "LeftUpLeg",      "LeftLeg",    "kneecap",
                      "LeftHand", "LeftHandIndex3", "LeftHandIndex4", "LeftToeBase"};
    skeleton.parents = {-1, 0, 1, 2, 3, 1, 5, 6, 3};
    skeleton.restPositions.resize(9);
    const std::vector<BodyPart> expected = {BodyPart::Torso, BodyPart::Torso, BodyPart::Hip,
                                            BodyPart::Knee,  BodyPart::Knee,  BodyPart::Wrist,
                                            BodyPart::Hand,  BodyPart::Hand,  BodyPart::Foot};
    EXPECT_EQ(jointParts(skeleton), expected);
}

} // namespace
} // namespace ars
