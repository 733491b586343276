#include "engine/surfel/knn.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace ars {
namespace {

// On a grid of step h every inner point has four neighbours at h, so the three nearest lie at h.
TEST(NearestNeighbors, OnAGridTheDistanceIsItsStep) {
    std::vector<glm::vec3> points;
    for (int y = 0; y < 20; ++y) {
        for (int x = 0; x < 20; ++x)
            points.emplace_back(0.25f * static_cast<float>(x), 0.25f * static_cast<float>(y), 1);
    }
    const auto distances = neighborDistances(points);
    ASSERT_TRUE(distances.ok());
    for (int y = 1; y < 19; ++y) {
        for (int x = 1; x < 19; ++x) EXPECT_NEAR((*distances)[static_cast<std::size_t>(20 * y + x)], 0.25f, 1e-6f);
    }
    // In a corner two lie at h and one at h sqrt(2): the mean square is 4/3 h^2.
    EXPECT_NEAR((*distances)[0], 0.25f * std::sqrt(4.0f / 3.0f), 1e-6f);
}

TEST(NearestNeighbors, AgreeWithComparingAllPairs) {
    std::mt19937 random(4);
    std::normal_distribution<float> number;
    std::vector<glm::vec3> points;
    for (int i = 0; i < 400; ++i) points.emplace_back(number(random), number(random), number(random));
    points[17] = points[18]; // at one place
    const int k = 5;
    const auto found = nearestNeighbors(points, k);
    const auto distances = neighborDistances(points, k);
    ASSERT_TRUE(found.ok());
    ASSERT_TRUE(distances.ok());
    for (std::size_t i = 0; i < points.size(); ++i) {
        std::vector<std::pair<float, std::uint32_t>> all;
        for (std::size_t j = 0; j < points.size(); ++j) {
            const glm::vec3 away = points[j] - points[i];
            if (j != i) all.emplace_back(glm::dot(away, away), static_cast<std::uint32_t>(j));
        }
        std::sort(all.begin(), all.end());
        double sum = 0.0;
        for (std::size_t n = 0; n < k; ++n) {
            EXPECT_EQ((*found)[i * k + n], all[n].second) << i;
            sum += all[n].first;
        }
        EXPECT_NEAR((*distances)[i], std::sqrt(sum / k), 1e-6);
    }
}

TEST(NearestNeighbors, FewPointsAndEqualPointsHaveDefinedResults) {
    EXPECT_TRUE(neighborDistances({})->empty());
    EXPECT_EQ(neighborDistances(std::vector<glm::vec3>{{1, 2, 3}})->at(0), kMinNeighborDistanceM);
    EXPECT_EQ(nearestNeighbors(std::vector<glm::vec3>{{1, 2, 3}}, 2).value(), (std::vector<std::uint32_t>{0, 0}));
    const std::vector<glm::vec3> two{{0, 0, 0}, {0, 3, 0}};
    EXPECT_FLOAT_EQ(neighborDistances(two)->at(1), 3.0f);
    const std::vector<glm::vec3> same(50, glm::vec3(1.0f));
    const auto none = neighborDistances(same);
    for (const float d : *none) EXPECT_EQ(d, kMinNeighborDistanceM);
}

TEST(NearestNeighbors, NumbersThatAreNotFiniteAreNamed) {
    std::vector<glm::vec3> points(10, glm::vec3(0.0f));
    points[7].y = std::numeric_limits<float>::infinity();
    const auto failed = neighborDistances(points);
    ASSERT_FALSE(failed.ok());
    EXPECT_EQ(failed.error().code, ErrorCode::InvalidArgument);
    EXPECT_NE(failed.error().describe().find("point 7"), std::string::npos);
    EXPECT_EQ(neighborDistances({}, 0).error().code, ErrorCode::InvalidArgument);
}

} // namespace
} // namespace ars
