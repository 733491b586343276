// Surfels as discs against an analytic picture: every pixel's ray is cut with every disc's plane.
#include "engine/gl/context.h"
#include "engine/gl/opengl.h"
#include "engine/gl/presenter.h"
#include "engine/gl/surfel_discs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

namespace ars {
namespace {

constexpr int kWidth = 160;
constexpr int kHeight = 120;

class SurfelDiscsTest : public ::testing::Test {
protected:
    void SetUp() override {
        auto context = HeadlessContext::create();
        ASSERT_TRUE(context.ok()) << context.error().describe();
        context_ = std::move(*context);
        auto discs = SurfelDiscs::create();
        ASSERT_TRUE(discs.ok()) << discs.error().describe();
        discs_ = std::move(*discs);
        auto target = RenderTarget::create(kWidth, kHeight, true);
        ASSERT_TRUE(target.ok()) << target.error().describe();
        target_ = std::make_unique<RenderTarget>(std::move(*target));
        camera_ = lookAtCamera({0.4, 1.2, 2.4}, {0, 1, 0}, 40, kWidth, kHeight);
        camera_.cx += 7.0; // the principal point may lie anywhere
    }
    void TearDown() override {
        discs_.reset();
        target_.reset();
        context_.reset();
    }

    void add(const glm::vec3& mean, const glm::quat& rotation, const glm::vec2& scale, const glm::vec3& albedo) {
        surfels_.means.push_back(mean);
        for (const float q : {rotation.w, rotation.x, rotation.y, rotation.z}) surfels_.rotations.push_back(q);
        surfels_.scales.push_back(scale);
        surfels_.opacities.push_back(1.0f);
        surfels_.albedos.push_back(albedo);
    }

    std::vector<std::uint8_t> draw() {
        target_->bind();
        glClearColor(0, 0, 0, 1);
        glClear(GL_COLOR_BUFFER_BIT);
        discs_->draw(camera_, settings_, 0, 0, kWidth, kHeight);
        return target_->read();
    }

    /// sRGB-encoded colour in [0, 255], or nothing where an edge is so near that either answer is right.
    bool expected(int row, int column, glm::dvec3& color) const {
        const glm::dvec3 eye = camera_.centerWorld();
        const glm::dvec3 ray = glm::transpose(camera_.rotation) * camera_.ray(column + 0.5, row + 0.5);
        double nearest = 1e9;
        color = glm::dvec3(0.0);
        for (std::size_t i = 0; i < surfels_.count(); ++i) {
            const float* q = &surfels_.rotations[4 * i];
            const glm::dmat3 axes = glm::mat3_cast(glm::dquat(q[0], q[1], q[2], q[3]));
            const glm::dvec3 mean(surfels_.means[i]);
            if (glm::dot(axes[2], mean - eye) >= 0) continue; // seen from behind
            const double t = glm::dot(mean - eye, axes[2]) / glm::dot(ray, axes[2]);
            const glm::dvec3 on = eye + t * ray - mean;
            const glm::dvec2 rim = glm::dvec2(surfels_.scales[i]) * static_cast<double>(settings_.reach);
            const glm::dvec2 place(glm::dot(on, axes[0]) / rim.x, glm::dot(on, axes[1]) / rim.y);
            const double r = glm::dot(place, place);
            if (t <= 0) continue;
            if (std::abs(r - 1.0) < 0.08 || (r < 1.0 && std::abs(t - nearest) < 1e-3)) return false;
            if (r > 1.0 || t > nearest) continue;
            nearest = t;
            const glm::dvec3 normal = camera_.rotation * axes[2];
            const double lit = settings_.ambient +
                               (1.0 - settings_.ambient) *
                                   std::max(glm::dot(normal, glm::normalize(glm::dvec3(settings_.lightView))), 0.0);
            const double s = std::clamp((r - 0.72) / 0.28, 0.0, 1.0);
            const double edge = 1.0 - 0.35 * s * s * (3.0 - 2.0 * s);
            for (int c = 0; c < 3; ++c) {
                const double linear = std::clamp(surfels_.albedos[i][c] * lit * edge, 0.0, 1.0);
                color[c] = 255.0 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055);
            }
        }
        return true;
    }

    std::unique_ptr<HeadlessContext> context_;
    std::unique_ptr<SurfelDiscs> discs_;
    std::unique_ptr<RenderTarget> target_;
    Camera camera_;
    Surfels surfels_;
    DiscSettings settings_;
};

TEST_F(SurfelDiscsTest, APictureOfDiscsIsWhereRaysMeetThem) {
    std::mt19937 random(3);
    std::normal_distribution<float> normal(0.0f, 1.0f);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    for (int i = 0; i < 40; ++i) {
        const glm::quat q = glm::normalize(glm::quat(normal(random), normal(random), normal(random), normal(random)));
        add({1.2f * unit(random) - 0.6f, 0.6f + 0.8f * unit(random), 0.6f * unit(random) - 0.3f}, q,
            {0.06f + 0.12f * unit(random), 0.06f + 0.12f * unit(random)}, {unit(random), unit(random), unit(random)});
    }
    ASSERT_TRUE(discs_->set(surfels_).ok());
    const std::vector<std::uint8_t> shown = draw();
    int compared = 0, covered = 0, worst = 0;
    for (int row = 0; row < kHeight; ++row) {
        for (int column = 0; column < kWidth; ++column) {
            glm::dvec3 color;
            if (!expected(row, column, color)) continue;
            ++compared;
            covered += color != glm::dvec3(0.0);
            for (int c = 0; c < 3; ++c) {
                const int value = shown[static_cast<std::size_t>(4 * (row * kWidth + column) + c)];
                worst = std::max(worst, static_cast<int>(std::lround(std::abs(value - color[c]))));
            }
        }
    }
    EXPECT_GT(compared, kWidth * kHeight * 7 / 10);
    EXPECT_GT(covered, 1500);
    EXPECT_LE(worst, 3) << "the power function is the driver's";
}

TEST_F(SurfelDiscsTest, NearerDiscsHideFartherOnesInAnyOrder) {
    const glm::quat towards = glm::quat(1, 0, 0, 0); // +z, where the camera is
    for (const bool nearFirst : {true, false}) {
        surfels_ = {};
        const glm::vec3 red(0.8f, 0, 0), blue(0, 0, 0.8f);
        for (const bool near : {nearFirst, !nearFirst}) {
            add({0, 1, near ? 0.2f : -0.2f}, towards, {0.2f, 0.2f}, near ? red : blue);
        }
        ASSERT_TRUE(discs_->set(surfels_).ok());
        const std::vector<std::uint8_t> shown = draw();
        const glm::dvec2 at = camera_.project(camera_.toCamera({0, 1, 0.2}));
        const auto pixel = static_cast<std::size_t>(4 * (static_cast<int>(at.y) * kWidth + static_cast<int>(at.x)));
        EXPECT_GT(shown[pixel], 100);
        EXPECT_EQ(shown[pixel + 2], 0);
    }
}

TEST_F(SurfelDiscsTest, DiscsThatTurnAwayAreNotDrawn) {
    add({0, 1, 0}, glm::angleAxis(3.14159265f, glm::vec3(0, 1, 0)), {0.3f, 0.3f}, glm::vec3(1));
    ASSERT_TRUE(discs_->set(surfels_).ok());
    const std::vector<std::uint8_t> shown = draw();
    for (std::size_t i = 0; i < shown.size(); i += 4) ASSERT_EQ(shown[i], 0);
}

TEST_F(SurfelDiscsTest, ArraysThatDoNotFitAreRefused) {
    add({0, 1, 0}, glm::quat(1, 0, 0, 0), {0.1f, 0.1f}, glm::vec3(1));
    surfels_.scales.clear();
    const Status set = discs_->set(surfels_);
    ASSERT_FALSE(set.ok());
    EXPECT_EQ(set.error().code, ErrorCode::InvalidArgument);
}

} // namespace
} // namespace ars
