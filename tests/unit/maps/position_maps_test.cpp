// Position maps, deformation priors and the PCA of poses.
#include "engine/maps/pose_pca.h"
#include "engine/maps/position_maps.h"
#include "engine/maps/position_maps_math.h"

#include "engine/core/file.h"
#include "engine/io/safetensors.h"
#include "tests/support/test_data.h"
#include "tests/unit/maps/map_meshes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

namespace ars {
namespace {

/// The open body's maps, made once.
struct BodyMaps {
    BodyModel body;
    CanonicalMaps maps;
    Skeleton skeleton;
};

const BodyMaps& bodyMaps() {
    static const BodyMaps instance = [] {
        BodyMaps made;
        made.body = *readOpenBody();
        CanonicalMapOptions options;
        options.size = 64;
        made.maps = *canonicalMaps(templateFromBody(made.body), options);
        made.skeleton = bodySkeleton(made.body, {});
        return made;
    }();
    return instance;
}

Pose somePose() {
    Pose pose = restPose(kSmplxJointCount);
    pose.rotations[0] = quatFromAxisAngle({0.2f, 1.0f, 0.1f});
    pose.rotations[4] = quatFromAxisAngle({0.9f, 0.0f, 0.0f});
    pose.rotations[16] = quatFromAxisAngle({0.0f, 0.3f, -0.8f});
    pose.rotations[22] = quatFromAxisAngle({0.2f, 0.0f, 0.0f});
    pose.rotations[30] = quatFromAxisAngle({0.0f, 0.0f, 0.7f});
    pose.translation = {1.0f, 2.0f, 3.0f};
    pose.expression = {1.0f};
    return pose;
}

TEST(PositionMaps, TheRootTheFingersAndTheExpressionAreLeftOut) {
    const BodyMaps& b = bodyMaps();
    const Pose pose = somePose();
    const auto points = posedMapPoints(b.skeleton, b.maps, pose);
    ASSERT_TRUE(points.ok());
    Pose other = pose;
    other.rotations[0] = glm::quat(1, 0, 0, 0);
    other.rotations[30] = glm::quat(1, 0, 0, 0);
    other.rotations[54] = quatFromAxisAngle({0.5f, 0.5f, 0.5f});
    other.translation = glm::vec3(0.0f);
    other.expression.clear();
    EXPECT_EQ(*posedMapPoints(b.skeleton, b.maps, other), *points);
    other.rotations[22] = glm::quat(1, 0, 0, 0);
    EXPECT_NE(*posedMapPoints(b.skeleton, b.maps, other), *points) << "the jaw stays";
}

TEST(PositionMaps, TheCanonicalPoseGivesTheCanonicalMap) {
    const BodyMaps& b = bodyMaps();
    const auto points = posedMapPoints(b.skeleton, b.maps, canonicalPose());
    ASSERT_TRUE(points.ok());
    for (std::size_t i = 0; i < points->size(); ++i) EXPECT_LT(glm::distance((*points)[i], b.maps.positions[i]), 1e-6f);
}

// A point of one joint alone moves as that joint: x = G_knee G_knee,canonical^-1 x_c.
TEST(PositionMaps, APointOfOneJointMovesWithIt) {
    const BodyMaps& b = bodyMaps();
    const Pose pose = somePose();
    const auto points = posedMapPoints(b.skeleton, b.maps, pose);
    ASSERT_TRUE(points.ok());
    const std::vector<glm::mat4> now = jointWorldMatrices(b.skeleton, mapPose(pose));
    const std::vector<glm::mat4> then = jointWorldMatrices(b.skeleton, canonicalPose());
    int tested = 0;
    for (std::size_t i = 0; i < points->size(); ++i) {
        if (b.maps.weights.weights[i * kMaxInfluences] < 0.99999f) continue;
        const std::uint16_t joint = b.maps.weights.joints[i * kMaxInfluences];
        const glm::vec3 expected(now[joint] * glm::inverse(then[joint]) * glm::vec4(b.maps.positions[i], 1.0f));
        EXPECT_LT(glm::distance((*points)[i], expected), 2e-5f);
        ++tested;
    }
    EXPECT_GT(tested, 20);
}

TEST(DeformationPriors, AreLengthDirectionAndDistanceToTheNearestVertex) {
    const BodyMaps& b = bodyMaps();
    const Pose pose = somePose();
    const auto points = posedMapPoints(b.skeleton, b.maps, pose);
    ASSERT_TRUE(points.ok());
    std::mt19937 random(3);
    std::uniform_real_distribution<float> number(-1.0f, 1.0f);
    std::vector<glm::vec3> vertices;
    for (int i = 0; i < 300; ++i) vertices.emplace_back(number(random), number(random), number(random));
    std::vector<float> priors(points->size() * kPriorWidth);
    ASSERT_TRUE(deformationPriors(b.maps, *points, vertices, priors).ok());
    for (std::size_t i = 0; i < points->size(); ++i) {
        const glm::dvec3 d = glm::dvec3((*points)[i]) - glm::dvec3(b.maps.positions[i]);
        const float* prior = &priors[i * kPriorWidth];
        EXPECT_NEAR(prior[0], glm::length(d), 1e-6);
        if (glm::length(d) > 1e-4) {
            EXPECT_LT(glm::distance(glm::dvec3(prior[1], prior[2], prior[3]), glm::normalize(d)), 2e-3);
        }
        float nearest = 10.0f;
        for (const glm::vec3& v : vertices) nearest = std::min(nearest, glm::distance(v, (*points)[i]));
        EXPECT_NEAR(prior[4], nearest, 1e-5f);
    }
}

TEST(DeformationPriors, WithoutAMoveThereIsNoDirection) {
    const BodyMaps& b = bodyMaps();
    std::vector<float> priors(b.maps.pointCount() * kPriorWidth, -7.0f);
    ASSERT_TRUE(deformationPriors(b.maps, b.maps.positions, {}, priors).ok());
    EXPECT_TRUE(std::all_of(priors.begin(), priors.end(), [](float p) { return p == 0.0f; }));
    double prior[5];
    deformationPrior(glm::dvec3(0.0), glm::dvec3(0.0, 3.0, 4.0), 0.25, 1e-6, prior);
    EXPECT_DOUBLE_EQ(prior[0], 5.0);
    EXPECT_DOUBLE_EQ(prior[2], 0.6);
    EXPECT_DOUBLE_EQ(prior[3], 0.8);
    EXPECT_DOUBLE_EQ(prior[4], 0.25);
}

// The template is the body itself, whose blend shapes are zero: no point is farther from a vertex than from the nearest
// corner of its own triangle, and some lie almost on one.
TEST(DeformationPriors, TheBodyItselfLiesBetweenItsOwnVertices) {
    const BodyMaps& b = bodyMaps();
    const Pose pose = somePose();
    const auto points = posedMapPoints(b.skeleton, b.maps, pose);
    ASSERT_TRUE(points.ok());
    std::vector<float> priors(points->size() * kPriorWidth);
    const std::vector<glm::vec3> vertices = mapBodyVertices(b.body, {}, pose);
    ASSERT_TRUE(deformationPriors(b.maps, *points, vertices, priors).ok());
    float least = 1.0f;
    for (std::size_t i = 0; i < points->size(); ++i) {
        const glm::uvec3& t = b.body.triangles[b.maps.triangles[i]];
        float corner = 1.0f;
        for (int c = 0; c < 3; ++c) corner = std::min(corner, glm::distance((*points)[i], vertices[t[c]]));
        EXPECT_LE(priors[i * kPriorWidth + 4], corner + 1e-5f);
        least = std::min(least, priors[i * kPriorWidth + 4]);
    }
    EXPECT_LT(least, 0.002f);
}

TEST(PositionMaps, SpreadAndGatherKnowTheirPlaces) {
    const CanonicalMaps maps = *canonicalMaps(test::sphereTemplate(0.7f, 12), {.size = 16, .centerM = {}});
    std::vector<float> values;
    for (std::size_t i = 0; i < maps.pointCount() * 2; ++i) values.push_back(static_cast<float>(i + 1));
    std::vector<float> planes(4 * 16 * 16, -1.0f), back(values.size());
    ASSERT_TRUE(spreadPlanes(maps, values, 2, planes).ok());
    ASSERT_TRUE(gatherPlanes(maps, planes, 2, back).ok());
    EXPECT_EQ(back, values);
    PixelBuffer picture = *PixelBuffer::allocate({}, 32, 16, 2, "test");
    ASSERT_TRUE(spreadPicture(maps, values, picture.view()).ok());
    const std::vector<std::uint8_t> mask = mapMask(maps);
    for (int row = 0; row < 16; ++row) {
        for (int column = 0; column < 32; ++column) {
            for (int c = 0; c < 2; ++c) {
                const float value = picture.view().at(row, column)[c];
                const int plane = column / 16 * 2 + c;
                EXPECT_EQ(value, planes[static_cast<std::size_t>((plane * 16 + row) * 16 + column % 16)]);
                EXPECT_EQ(value != 0.0f, mask[static_cast<std::size_t>(row * 32 + column)] == 1);
            }
        }
    }
    EXPECT_EQ(spreadPlanes(maps, values, 3, planes).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(spreadPlanes(maps, values, 0, planes).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(gatherPlanes(maps, std::span(planes).subspan(1), 2, back).error().code, ErrorCode::InvalidArgument);
    PixelBuffer small = *PixelBuffer::allocate({}, 16, 16, 2, "test");
    EXPECT_EQ(spreadPicture(maps, values, small.view()).error().code, ErrorCode::InvalidArgument);
    std::vector<float> priors(3);
    EXPECT_EQ(deformationPriors(maps, maps.positions, {}, priors).error().code, ErrorCode::InvalidArgument);
    std::vector<glm::vec3> bad = maps.positions;
    bad[2].x = std::numeric_limits<float>::quiet_NaN();
    priors.resize(maps.pointCount() * kPriorWidth);
    EXPECT_EQ(deformationPriors(maps, bad, {}, priors).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(mapMatrices(Skeleton{}, maps, Pose{}).error().code, ErrorCode::InvalidArgument);
}

constexpr std::size_t kDimension = 3 * 900;

/// n poses: a mean and three known orthonormal directions (cosines) with standard deviations 0.5, 0.2, 0.1.
struct KnownPoses {
    std::vector<std::vector<float>> directions, samples;
    std::vector<float> mean;
    std::vector<std::vector<double>> coefficients;

    explicit KnownPoses(std::size_t count) {
        std::mt19937 random(9);
        std::normal_distribution<double> normal;
        for (int k = 0; k < 3; ++k) {
            std::vector<float> direction;
            for (std::size_t d = 0; d < kDimension; ++d) {
                direction.push_back(static_cast<float>(
                    std::sqrt(2.0 / kDimension) *
                    std::cos(std::numbers::pi * (k + 1) * (static_cast<double>(d) + 0.5) / kDimension)));
            }
            directions.push_back(direction);
        }
        for (std::size_t d = 0; d < kDimension; ++d) mean.push_back(static_cast<float>(std::sin(0.01 * double(d))));
        const double deviations[3] = {0.5, 0.2, 0.1};
        for (std::size_t i = 0; i < count; ++i) {
            coefficients.push_back(
                {deviations[0] * normal(random), deviations[1] * normal(random), deviations[2] * normal(random)});
            samples.push_back(pose(coefficients.back()));
        }
    }
    std::vector<float> pose(const std::vector<double>& c) const {
        std::vector<float> values(kDimension);
        for (std::size_t d = 0; d < kDimension; ++d) {
            values[d] = static_cast<float>(mean[d] + c[0] * directions[0][d] + c[1] * directions[1][d] +
                                           c[2] * directions[2][d]);
        }
        return values;
    }
};

double distanceBetween(const std::vector<float>& a, const std::vector<float>& b) {
    double sum = 0.0;
    for (std::size_t d = 0; d < a.size(); ++d) sum += std::pow(double(a[d]) - b[d], 2);
    return std::sqrt(3.0 * sum / static_cast<double>(a.size()));
}

TEST(PosePca, FindsTheDirectionsThatMadeThePoses) {
    const KnownPoses known(200);
    const auto pca = fitPosePca(known.samples, 20);
    ASSERT_TRUE(pca.ok()) << pca.error().describe();
    ASSERT_EQ(pca->componentCount(), 3) << "the rest is rounding";
    for (int k = 0; k < 3; ++k) {
        double along = 0.0;
        for (std::size_t d = 0; d < kDimension; ++d) {
            along += double(pca->components[static_cast<std::size_t>(k) * kDimension + d]) *
                     known.directions[static_cast<std::size_t>(k)][d];
        }
        EXPECT_GT(std::abs(along), 0.98) << k;
    }
    // The total variance does not depend on how the sample's directions are turned.
    double expected = 0.0, found = 0.0;
    for (int k = 0; k < 3; ++k) {
        double mean = 0.0, square = 0.0;
        for (const auto& c : known.coefficients) mean += c[static_cast<std::size_t>(k)] / 200.0;
        for (const auto& c : known.coefficients) square += std::pow(c[static_cast<std::size_t>(k)] - mean, 2) / 199.0;
        expected += square;
        found += std::pow(pca->deviations[static_cast<std::size_t>(k)], 2);
    }
    EXPECT_NEAR(found, expected, 1e-5 * expected);
    EXPECT_TRUE(std::is_sorted(pca->deviations.rbegin(), pca->deviations.rend()));
}

TEST(PosePca, RowsAreOrthonormalAndTrainingPosesComeBack) {
    std::mt19937 random(1);
    std::normal_distribution<float> normal;
    std::vector<std::vector<float>> samples(12, std::vector<float>(300));
    for (auto& sample : samples) {
        for (float& value : sample) value = normal(random);
    }
    const auto pca = fitPosePca(samples, 50);
    ASSERT_TRUE(pca.ok());
    ASSERT_EQ(pca->componentCount(), 11) << "n - 1";
    for (std::size_t a = 0; a < 11; ++a) {
        for (std::size_t b = 0; b <= a; ++b) {
            double dot = 0.0;
            for (std::size_t d = 0; d < 300; ++d)
                dot += double(pca->components[a * 300 + d]) * pca->components[b * 300 + d];
            EXPECT_NEAR(dot, a == b ? 1.0 : 0.0, 1e-5);
        }
    }
    for (const auto& sample : samples) {
        std::vector<float> values = sample;
        const auto projection = projectPose(*pca, values, 100.0f);
        ASSERT_TRUE(projection.ok());
        EXPECT_LT(distanceBetween(values, sample), 1e-5);
        EXPECT_EQ(projection->clamped, 0);
    }
}

TEST(PosePca, CoefficientsAreHeldWithinTwoDeviations) {
    const KnownPoses known(300);
    const auto pca = fitPosePca(known.samples, 20);
    ASSERT_TRUE(pca.ok());
    std::vector<float> far(pca->mean);
    for (std::size_t d = 0; d < kDimension; ++d) far[d] += 5.0f * pca->deviations[0] * pca->components[d];
    std::vector<float> values = far;
    const auto projection = projectPose(*pca, values);
    ASSERT_TRUE(projection.ok());
    EXPECT_EQ(projection->clamped, 1);
    EXPECT_NEAR(projection->largestDeviation, 5.0f, 1e-3f);
    EXPECT_NEAR(projection->coefficients[0], 2.0f * pca->deviations[0], 1e-5f);
    for (std::size_t d = 0; d < kDimension; ++d) {
        EXPECT_NEAR(values[d], pca->mean[d] + 2.0f * pca->deviations[0] * pca->components[d], 1e-5f);
    }
    // Three deviations were cut off: 3 sigma sqrt(3 / D) for each point.
    EXPECT_NEAR(projection->distance, 3.0 * pca->deviations[0] * std::sqrt(3.0 / kDimension), 1e-5);
    EXPECT_NEAR(projection->distance, distanceBetween(values, far), 1e-6);
    std::vector<float> again = values;
    ASSERT_TRUE(projectPose(*pca, again).ok());
    EXPECT_LT(distanceBetween(again, values), 1e-6) << "a projection is its own projection";
}

TEST(PosePca, TheOutOfRangeMeasureIsZeroForTrainingPosesAndGrows) {
    const KnownPoses known(300);
    const auto pca = fitPosePca(known.samples, 20);
    ASSERT_TRUE(pca.ok());
    for (const auto& sample : known.samples) {
        std::vector<float> values = sample;
        EXPECT_EQ(projectPose(*pca, values)->outOfRange, 0.0f);
    }
    float before = 0.0f;
    for (const double factor : {4.0, 6.0, 8.0, 12.0}) {
        std::vector<float> values = known.pose({0.5 * factor, 0.0, 0.0});
        const float measure = projectPose(*pca, values)->outOfRange;
        EXPECT_GT(measure, before) << factor;
        before = measure;
    }
    // Off the training poses' directions altogether: every point 0.1 m away along z.
    std::vector<float> moved = known.samples[0];
    std::mt19937 random(4);
    for (std::size_t d = 2; d < kDimension; d += 3) moved[d] += random() % 2 ? 0.1f : -0.1f;
    const auto projection = projectPose(*pca, moved);
    EXPECT_NEAR(projection->distance, 0.1f, 0.01f);
}

TEST(PosePca, OnePoseIsItsOwnMean) {
    const std::vector<std::vector<float>> one{{1.0f, 2.0f, 3.0f}};
    const auto pca = fitPosePca(one);
    ASSERT_TRUE(pca.ok());
    EXPECT_EQ(pca->componentCount(), 0);
    std::vector<float> values{1.0f, 2.0f, 4.0f};
    const auto projection = projectPose(*pca, values);
    ASSERT_TRUE(projection.ok());
    EXPECT_EQ(values, one[0]);
    EXPECT_NEAR(projection->outOfRange, 1.0f, 1e-6f);
    const std::vector<std::vector<float>> same(5, one[0]);
    EXPECT_EQ(fitPosePca(same)->componentCount(), 0);
}

TEST(PosePca, FilesKeepEveryNumber) {
    const KnownPoses known(30);
    const auto pca = fitPosePca(known.samples, 2);
    ASSERT_TRUE(pca.ok());
    test::TemporaryFolder folder;
    ASSERT_TRUE(writePosePca(folder / "pca.safetensors", *pca).ok());
    const auto read = readPosePca(folder / "pca.safetensors");
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_EQ(read->mean, pca->mean);
    EXPECT_EQ(read->components, pca->components);
    EXPECT_EQ(read->deviations, pca->deviations);
    EXPECT_EQ(read->poses, 30);
    EXPECT_EQ(read->trainingDistance, pca->trainingDistance);

    auto spoiled = [&](const std::function<void(SafetensorsFile&)>& change) {
        SafetensorsFile file = *readSafetensors(folder / "pca.safetensors");
        change(file);
        EXPECT_TRUE(writeSafetensors(folder / "bad.safetensors", file).ok());
        const auto bad = readPosePca(folder / "bad.safetensors");
        EXPECT_FALSE(bad.ok());
        if (bad.ok()) return;
        EXPECT_NE(bad.error().describe().find("bad.safetensors"), std::string::npos);
        EXPECT_TRUE(bad.error().code == ErrorCode::BadFile || bad.error().code == ErrorCode::NotFound);
    };
    spoiled([](SafetensorsFile& file) { file.tensors.erase("mean"); });
    spoiled([](SafetensorsFile& file) { file.tensors["components"] = file.tensors["mean"]; });
    spoiled([](SafetensorsFile& file) { file.tensors["deviations"].as<float>()[1] = -1.0f; });
    spoiled([](SafetensorsFile& file) { file.tensors["mean"].as<float>()[7] = std::nanf(""); });
    spoiled([](SafetensorsFile& file) { file.tensors["poses"].as<std::int64_t>()[0] = 0; });
    EXPECT_EQ(readPosePca(folder / "absent").error().code, ErrorCode::NotFound);
}

TEST(PosePca, BadPosesAreNamed) {
    std::vector<std::vector<float>> samples{{1, 2, 3}, {1, 2}};
    EXPECT_NE(fitPosePca(samples).error().describe().find("pose 1 has 2 numbers, pose 0 has 3"), std::string::npos);
    samples[1] = {1, 2, std::numeric_limits<float>::infinity()};
    EXPECT_NE(fitPosePca(samples).error().describe().find("pose 1"), std::string::npos);
    EXPECT_EQ(fitPosePca({}).error().code, ErrorCode::InvalidArgument);
    samples[1][2] = 5;
    EXPECT_EQ(fitPosePca(samples, 0).error().code, ErrorCode::InvalidArgument);
    const auto pca = fitPosePca(samples);
    ASSERT_TRUE(pca.ok());
    std::vector<float> few(2), right(3);
    EXPECT_EQ(projectPose(*pca, few).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(projectPose(*pca, right, 0.0f).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(projectPose(PosePca{}, {}).error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(fitPosePca(samples, 3, [](double, std::string_view) { return false; }).error().code,
              ErrorCode::Cancelled);
}

} // namespace
} // namespace ars
