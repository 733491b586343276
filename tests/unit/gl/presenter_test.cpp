// Stage 8 without a display: what the window shows against what files hold, pixel by pixel.
#include "engine/frame/display.h"
#include "engine/frame/framing.h"
#include "engine/gl/context.h"
#include "engine/gl/opengl.h"
#include "engine/gl/presenter.h"
#include "engine/gl/window.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace ars {
namespace {

constexpr int kSide = 64;

class PresenterTest : public ::testing::Test {
protected:
    void SetUp() override {
        auto context = HeadlessContext::create();
        ASSERT_TRUE(context.ok()) << context.error().describe();
        context_ = std::move(*context);
        std::printf("OpenGL: %s\n", context_->info().chosen.c_str());
        auto presenter = Presenter::create();
        ASSERT_TRUE(presenter.ok()) << presenter.error().describe();
        presenter_ = std::move(*presenter);
        auto target = RenderTarget::create(kSide, kSide);
        ASSERT_TRUE(target.ok());
        target_ = std::make_unique<RenderTarget>(std::move(*target));
        camera_ = lookAtCamera({0, 1, 3}, {0, 1, 0}, 40, kSide, kSide);
    }
    void TearDown() override {
        presenter_.reset();
        target_.reset();
        context_.reset();
    }

    std::vector<std::uint8_t> draw(const PresentSettings& settings, std::span<const OverlayLine> lines = {}) {
        target_->bind();
        const Status drawn = presenter_->draw(settings, camera_, lines, 0, 0, kSide, kSide);
        EXPECT_TRUE(drawn.ok()) << drawn.error().describe();
        return target_->read();
    }

    /// Random numbers of the buffer's kind, opacity from 0 to 1 across the picture.
    void makePicture(BufferId id, Image& picture, Image& opacity) {
        const BufferInfo& info = bufferInfo(id);
        std::mt19937 random(7);
        std::uniform_real_distribution<float> number(0.0f, 1.0f);
        picture = opacity = Image{};
        picture.width = opacity.width = picture.height = opacity.height = kSide;
        picture.channels = info.channels();
        opacity.channels = 1;
        for (int i = 0; i < kSide * kSide; ++i) {
            const float alpha = std::clamp(1.4f * static_cast<float>(i % kSide) / kSide - 0.2f, 0.0f, 1.0f);
            opacity.pixels.push_back(alpha);
            for (int c = 0; c < picture.channels; ++c) {
                float value = info.minimum + (info.maximum - info.minimum) * number(random);
                if (info.kind == BufferKind::LinearColor) value = std::exp2(10.0f * number(random) - 6.0f) * alpha;
                if (id == BufferId::Beauty && c == 3) value = alpha;
                picture.pixels.push_back(value);
            }
        }
    }

    std::unique_ptr<HeadlessContext> context_;
    std::unique_ptr<Presenter> presenter_;
    std::unique_ptr<RenderTarget> target_;
    Camera camera_;
};

ImageView<const float> viewOf(const Image& image) {
    return {image.pixels.data(), image.width, image.height, image.channels};
}

TEST_F(PresenterTest, TheWindowShowsWhatFilesHold) {
    for (const BufferInfo& info : bufferCatalogue()) {
        for (const ToneCurve curve : {ToneCurve::None, ToneCurve::Aces, ToneCurve::Agx}) {
            if (info.kind != BufferKind::LinearColor && curve != ToneCurve::None) continue;
            Image picture, opacity;
            makePicture(info.id, picture, opacity);
            if (info.id == BufferId::Opacity) opacity.pixels.assign(opacity.pixels.size(), 1.0f);
            PresentSettings settings = defaultPresentSettings(info.id);
            settings.tone.curve = curve;
            settings.tone.exposureEv = info.kind == BufferKind::LinearColor ? 0.7f : 0.0f;
            settings.tone.backgroundRed = 0.1f;
            settings.tone.backgroundBlue = 0.6f;
            ASSERT_TRUE(presenter_->setPicture(viewOf(picture), viewOf(opacity), {}).ok());
            const std::vector<std::uint8_t> shown = draw(settings);
            DisplaySettings display;
            display.tone = settings.tone;
            const auto expected = displayPicture(info.id, picture, opacity, display);
            ASSERT_TRUE(expected.ok());
            const std::vector<std::uint8_t> bytes = displayBytes(*expected);
            int worst = 0;
            for (std::size_t p = 0; p < bytes.size() / 3; ++p) {
                // An almost transparent colour divided by its alpha has no digits left on either side.
                if (opacity.pixels[p] > 0.0f && opacity.pixels[p] < 0.02f) continue;
                for (std::size_t c = 0; c < 3; ++c) {
                    worst = std::max(worst, std::abs(int(shown[4 * p + c]) - int(bytes[3 * p + c])));
                }
            }
            // Half a step of rounding on both sides, and the curve between two entries of its table.
            EXPECT_LE(worst, curve == ToneCurve::None ? 1 : 3)
                << info.name << ", curve " << EnumWords<ToneCurve>::words[static_cast<std::size_t>(curve)];
        }
    }
}

TEST_F(PresenterTest, TheEnvironmentHangsWhereFilesPutIt) {
    Environment environment;
    environment.picture.width = 128;
    environment.picture.height = 64;
    environment.picture.channels = 3;
    for (int row = 0; row < 64; ++row) {
        for (int column = 0; column < 128; ++column) {
            // Smooth, so that the two ways of interpolating agree.
            const double u = 2 * 3.14159265 * (column + 0.5) / 128, v = 3.14159265 * (row + 0.5) / 64;
            environment.picture.pixels.push_back(static_cast<float>(0.4 + 0.3 * std::cos(u) * std::sin(v)));
            environment.picture.pixels.push_back(static_cast<float>(0.4 + 0.3 * std::sin(u) * std::sin(v)));
            environment.picture.pixels.push_back(static_cast<float>(0.4 + 0.3 * std::cos(v)));
        }
    }
    Image beauty, opacity;
    makePicture(BufferId::Beauty, beauty, opacity);
    presenter_->setEnvironment(environment);
    ASSERT_TRUE(presenter_->setPicture(viewOf(beauty), viewOf(opacity), {}).ok());
    PresentSettings settings = defaultPresentSettings(BufferId::Beauty);
    settings.backdrop = Backdrop::Environment;
    settings.placement = {70.0f, 1.3f};
    const std::vector<std::uint8_t> shown = draw(settings);
    ASSERT_TRUE(addBackdrop(beauty, camera_, environment, settings.placement).ok());
    opacity.pixels.assign(opacity.pixels.size(), 1.0f);
    const std::vector<std::uint8_t> bytes = displayBytes(*displayPicture(BufferId::Beauty, beauty, opacity, {}));
    int worst = 0;
    for (std::size_t p = 0; p < bytes.size() / 3; ++p) {
        for (std::size_t c = 0; c < 3; ++c)
            worst = std::max(worst, std::abs(int(shown[4 * p + c]) - int(bytes[3 * p + c])));
    }
    EXPECT_LE(worst, 2);
}

TEST_F(PresenterTest, LinesLandWhereTheCameraProjectsAndHideBehindTheAvatar) {
    Image beauty, opacity, depth;
    makePicture(BufferId::Beauty, beauty, opacity);
    beauty.pixels.assign(beauty.pixels.size(), 0.0f);
    depth = opacity;
    depth.pixels.assign(depth.pixels.size(), 0.0f);
    // The avatar fills the left half, 2 m away.
    for (int row = 0; row < kSide; ++row) {
        for (int column = 0; column < kSide / 2; ++column) depth.at(row, column, 0) = 2.0f;
    }
    ASSERT_TRUE(presenter_->setPicture(viewOf(beauty), viewOf(opacity), viewOf(depth)).ok());
    const OverlayLine line{{-0.6f, 1.2f, 0.0f}, {0.6f, 1.2f, 0.0f}, {1, 0, 0, 1}, 3.0f};
    const std::vector<std::uint8_t> shown = draw(defaultPresentSettings(BufferId::Beauty), std::span(&line, 1));
    const int row = static_cast<int>(camera_.project(camera_.toCamera({0.0, 1.2, 0.0})).y);
    const auto red = [&](int y, int x) { return int(shown[static_cast<std::size_t>(4 * (y * kSide + x))]); };
    EXPECT_GT(red(row, 3 * kSide / 4 - 8), 240);
    EXPECT_NEAR(red(row, kSide / 4 + 8), 0.45 * 255, 12) << "behind the avatar it shows through faintly";
    EXPECT_EQ(red(row - 8, 3 * kSide / 4 - 8), 0);
    EXPECT_EQ(red(row, kSide - 1), 0) << "lines end";
}

TEST_F(PresenterTest, TheGridIsTheFloorAndLiesBehindTheAvatar) {
    Image beauty, opacity, depth;
    makePicture(BufferId::Beauty, beauty, opacity);
    beauty.pixels.assign(beauty.pixels.size(), 0.0f);
    opacity.pixels.assign(opacity.pixels.size(), 0.0f);
    depth = opacity;
    PresentSettings settings = defaultPresentSettings(BufferId::Beauty);
    settings.grid = true;
    const auto brightness = [&](int firstRow, int lastRow) {
        const auto shown = draw(settings);
        double sum = 0;
        for (int row = firstRow; row < lastRow; ++row) {
            for (int column = 0; column < kSide; ++column)
                sum += shown[static_cast<std::size_t>(4 * (row * kSide + column))];
        }
        return sum;
    };
    ASSERT_TRUE(presenter_->setPicture(viewOf(beauty), viewOf(opacity), viewOf(depth)).ok());
    EXPECT_EQ(brightness(0, kSide / 2), 0.0) << "nothing above the horizon";
    EXPECT_GT(brightness(kSide / 2, kSide), 1000.0);
    depth.pixels.assign(depth.pixels.size(), 0.5f);
    ASSERT_TRUE(presenter_->setPicture(viewOf(beauty), viewOf(opacity), viewOf(depth)).ok());
    EXPECT_EQ(brightness(0, kSide), 0.0) << "an avatar right before the camera hides all of it";
}

TEST_F(PresenterTest, SkeletonsBecomeBonesAndDots) {
    Skeleton skeleton;
    skeleton.names = {"root", "arm", "hand"};
    skeleton.parents = {-1, 0, 1};
    skeleton.restPositions = {{0, 1, 0}, {0.4f, 1, 0}, {0.43f, 1, 0}};
    skeleton.restOrientations.assign(3, glm::quat(1, 0, 0, 0));
    const auto lines = skeletonLines(skeleton, jointWorldMatrices(skeleton, restPose(3)), {1, 1, 1, 1});
    ASSERT_EQ(lines.size(), 5u) << "two bones and three dots";
    EXPECT_GT(lines[1].widthPixels, lines[3].widthPixels) << "short bones are thinner";
}

TEST_F(PresenterTest, OnlyWhatIsCoveredIsDrawnAndNothingOfItIsCut) {
    // Specks anywhere, enlarged and reduced: the box around them must hold their interpolated rims.
    for (const int side : {kSide, 3 * kSide, kSide / 2}) {
        auto target = RenderTarget::create(side, side);
        ASSERT_TRUE(target.ok());
        for (const int at : {0, 1, 17, kSide / 2, kSide - 1}) {
            Image picture, opacity;
            makePicture(BufferId::Albedo, picture, opacity);
            picture.pixels.assign(picture.pixels.size(), 1.0f);
            opacity.pixels.assign(opacity.pixels.size(), 0.0f);
            opacity.at(at, kSide - 1 - at, 0) = 1.0f;
            ASSERT_TRUE(presenter_->setPicture(viewOf(picture), viewOf(opacity), {}).ok());
            target->bind();
            const PresentSettings settings = defaultPresentSettings(BufferId::Albedo);
            ASSERT_TRUE(presenter_->draw(settings, camera_, {}, 0, 0, side, side).ok());
            const std::vector<std::uint8_t> boxed = target->read();
            // Opacity that is nowhere quite 0 makes the box the whole picture.
            for (float& value : opacity.pixels) value = std::max(value, 1e-7f);
            ASSERT_TRUE(presenter_->setPicture(viewOf(picture), viewOf(opacity), {}).ok());
            target->bind();
            ASSERT_TRUE(presenter_->draw(settings, camera_, {}, 0, 0, side, side).ok());
            EXPECT_EQ(boxed, target->read()) << "speck in row " << at << " shown " << side << " pixels wide";
        }
    }
}

TEST_F(PresenterTest, DotsOfAMaskDoNotAddUpAndHideBehindTheAvatar) {
    Image picture, opacity, depth;
    makePicture(BufferId::Beauty, picture, opacity);
    depth = opacity;
    depth.pixels.assign(depth.pixels.size(), 0.0f);
    for (int row = 0; row < kSide; ++row) {
        for (int column = 0; column < kSide / 2; ++column) depth.at(row, column, 0) = 2.0f;
    }
    ShownPicture shown;
    ASSERT_TRUE(shown.set(viewOf(picture), viewOf(opacity), viewOf(depth)).ok());
    const OverlayLine left{{-0.4f, 1, 0}, {-0.4f, 1, 0}, {1, 1, 1, 1}, 6.0f};
    const OverlayLine right{{0.4f, 1, 0}, {0.4f, 1, 0}, {0.5f, 0.5f, 0.5f, 1}, 6.0f};
    const std::vector<OverlayLine> dots{left, right, right, right};
    auto mask = RenderTarget::create(kSide, kSide);
    ASSERT_TRUE(mask.ok());
    mask->bind();
    presenter_->drawMask(shown, camera_, dots, 0.03f, kSide, kSide);
    const std::vector<std::uint8_t> pixels = mask->read();
    const auto red = [&](double x) {
        const glm::dvec2 at = camera_.project(camera_.toCamera({x, 1.0, 0.0}));
        return int(pixels[static_cast<std::size_t>(4 * (static_cast<int>(at.y) * kSide + static_cast<int>(at.x)))]);
    };
    EXPECT_EQ(red(-0.4), 0) << "a metre behind the avatar";
    EXPECT_NEAR(red(0.4), 128, 2) << "three times in the same place";

    // The mask's colour over black: half of a quarter of white.
    target_->bind();
    glClearColor(0, 0, 0, 1);
    glClear(GL_COLOR_BUFFER_BIT);
    ASSERT_TRUE(presenter_->tintMask({}, *mask, {1, 1, 1, 0.5f}, 0, 0, kSide, kSide).ok());
    const std::vector<std::uint8_t> tinted = target_->read();
    const glm::dvec2 at = camera_.project(camera_.toCamera({0.4, 1.0, 0.0}));
    EXPECT_NEAR(int(tinted[static_cast<std::size_t>(4 * (static_cast<int>(at.y) * kSide + static_cast<int>(at.x)))]),
                64, 2)
        << "in the same place and not upside down";
}

TEST_F(PresenterTest, DifferencesOfTwoTargetsAreMeansOverChannels) {
    auto a = RenderTarget::create(kSide, kSide), b = RenderTarget::create(kSide, kSide);
    ASSERT_TRUE(a.ok() && b.ok());
    const struct {
        const RenderTarget* target;
        float red, green, blue;
    } fills[] = {{&*a, 0.8f, 0.2f, 0.4f}, {&*b, 0.6f, 0.2f, 0.0f}};
    for (const auto& fill : fills) {
        fill.target->bind();
        glClearColor(fill.red, fill.green, fill.blue, 1);
        glClear(GL_COLOR_BUFFER_BIT);
    }
    const double absolute = (0.2 + 0.0 + 0.4) / 3, squared = (0.04 + 0.0 + 0.16) / 3;
    for (const bool square : {false, true}) {
        target_->bind();
        ASSERT_TRUE(presenter_->drawDifference(*a, *b, square, 0.5f, ColorMap::Gray, 0, 0, kSide, kSide).ok());
        const glm::vec3 expected = mapColor(ColorMap::Gray, static_cast<float>((square ? squared : absolute) / 0.5));
        EXPECT_NEAR(int(target_->read()[0]), 255 * expected.r, 2.5) << (square ? "squared" : "absolute");
    }
}

TEST_F(PresenterTest, WhatDoesNotFitIsRefused) {
    EXPECT_FALSE(presenter_->draw({}, camera_, {}, 0, 0, 8, 8).ok()) << "no picture yet";
    Image picture, opacity;
    makePicture(BufferId::Beauty, picture, opacity);
    opacity.width = 32;
    EXPECT_FALSE(presenter_->setPicture(viewOf(picture), viewOf(opacity), {}).ok());
}

TEST(Window, HasTheSameFaceAsAContextWithoutOne) {
    WindowOptions options;
    options.width = 200;
    options.height = 120;
    auto window = WindowContext::create(options);
    if (!window) {
        EXPECT_EQ(window.error().code, ErrorCode::Unavailable);
        EXPECT_NE(window.error().message.find("no display"), std::string::npos) << window.error().message;
        test::notRun("opening a window needs a display");
        return;
    }
    GlContext& context = **window;
    ASSERT_TRUE(context.makeCurrent().ok());
    EXPECT_NE(context.info().version.find("4.5"), std::string::npos) << context.info().version;
    auto presenter = Presenter::create();
    ASSERT_TRUE(presenter.ok()) << presenter.error().describe();
    const float red[4] = {1, 0, 0, 1}, covered = 1;
    ASSERT_TRUE((*presenter)->setPicture({red, 1, 1, 4}, {&covered, 1, 1, 1}, {}).ok());
    int width = 0, height = 0;
    (*window)->framebufferSize(width, height);
    const Camera camera = lookAtCamera({0, 1, 3}, {0, 1, 0}, 40, width, height);
    ASSERT_TRUE((*presenter)->draw(defaultPresentSettings(BufferId::Beauty), camera, {}, 0, 0, width, height).ok());
    unsigned char pixel[4] = {};
    glReadPixels(width / 2, height / 2, 1, 1, GL_RGBA, GL_UNSIGNED_BYTE, pixel);
    EXPECT_EQ(pixel[0], 255);
    EXPECT_EQ(pixel[1], 0);
    (*window)->swapBuffers();
    EXPECT_FALSE((*window)->closing());
}

TEST(HeadlessContext, SaysWhatItChose) {
    const auto context = HeadlessContext::create(Device{DeviceKind::Cuda, 0});
    ASSERT_TRUE(context.ok()) << context.error().describe();
    const GlContextInfo& info = (*context)->info();
    EXPECT_NE(info.chosen.find(info.platform), std::string::npos);
    EXPECT_NE(info.chosen.find(info.renderer), std::string::npos);
    EXPECT_EQ(info.cudaDevice.value_or(0), 0) << "the card that the CUDA device is";
}

} // namespace
} // namespace ars
