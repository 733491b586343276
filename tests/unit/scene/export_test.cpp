#include "engine/scene/export.h"

#include "engine/core/process.h"
#include "engine/frame/light_source.h"
#include "engine/io/exr.h"
#include "engine/io/png.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/frame_worker.h"
#include "engine/scene/project.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>

namespace ars {
namespace {

/// A document with little to compute, and what it needs.
struct Scene {
    Document document;
    SceneAssets assets;
};

Scene makeScene() {
    Scene scene;
    scene.document = newDocument();
    scene.document.avatar.rest.maxSurfels = 6000;
    scene.document.occlusion.settings.screenSpace.adaptive = OcclusionAdaptive::Off;
    scene.document.light.rotationDeg = 30.0f;
    static const auto light = std::make_shared<LightSource>(
        filterLight("studio", readLight("studio").value(), {}, LightQuality::Draft, 64).value());
    static const std::shared_ptr<const AvatarAsset> avatar =
        loadAvatarAsset(scene.document.avatar).value(); // of every scene: none changes it
    auto lightAsset = std::make_shared<LightAsset>();
    lightAsset->source = light;
    scene.assets.light = lightAsset;
    scene.assets.avatar = avatar;
    return scene;
}

void waveOverTime(Document& document) {
    JointTrack track;
    track.joint = smplxJointIndex("left_elbow");
    track.keys = {{0.0, glm::quat(1, 0, 0, 0)}, {1.0, quatFromAxisAngle({0, -1.2f, 0})}};
    document.timeline.joints = {track};
    document.timeline.startS = 0.0;
    document.timeline.endS = 1.0;
    document.timeline.framesPerSecond = 4.0;
}

ScreenshotOptions screenshotTo(std::filesystem::path file) {
    ScreenshotOptions options;
    options.file = std::move(file);
    options.width = 90;
    options.height = 120;
    return options;
}

TEST(Export, AScreenshotIsWhatTheWindowShowsAndRestoresItsDocument) {
    const test::TemporaryFolder folder;
    const Scene scene = makeScene();
    const ScreenshotOptions options = screenshotTo(folder / "shot.png");
    const Status written = writeScreenshot(scene.document, scene.assets, {}, options);
    ASSERT_TRUE(written.ok()) << written.error().describe();
    // The window's frames come from the worker.
    FrameWorker worker{{}};
    FrameRequest request;
    request.avatar = scene.assets.avatar;
    request.light = scene.assets.light;
    request.inputs = frameInputs(scene.document, scene.assets, scene.document.timeline.timeS, 90, 120);
    request.buffers = {BufferId::Beauty};
    worker.submit(request);
    ASSERT_TRUE(worker.waitUntilIdle(std::chrono::seconds(60)));
    const auto frame = worker.latest();
    ASSERT_TRUE(frame);
    ASSERT_EQ(frame->quality, FrameQuality::Full);
    const Image window = shownPicture(scene.document, BufferId::Beauty, *frame->picture(BufferId::Beauty),
                                      *frame->picture(BufferId::Opacity), frame->inputs.camera, frame->inputs.placement,
                                      &scene.assets.light->source->environment)
                             .value();
    const PngFile file = readPng(options.file).value();
    ASSERT_EQ(file.image.pixels.size(), window.pixels.size());
    float spread = 0.0f;
    for (std::size_t i = 0; i < window.pixels.size(); ++i) {
        ASSERT_NEAR(file.image.pixels[i], window.pixels[i], 1.01f / 255.0f);
        spread = std::max(spread, std::abs(window.pixels[i] - window.pixels[0]));
    }
    EXPECT_GT(spread, 0.1f) << "there is a body to see";
    std::vector<std::string> notes;
    const auto restored = documentFromPicture(options.file, &notes);
    ASSERT_TRUE(restored.ok()) << restored.error().describe();
    EXPECT_TRUE(*restored == scene.document);
    EXPECT_TRUE(notes.empty()) << notes.front();
    const auto json = nlohmann::json::parse(file.text.at("ars"));
    EXPECT_EQ(json["picture"]["device"], "cpu");
    EXPECT_GT(json["picture"]["surfels"].get<int>(), 1000);
}

TEST(Export, LargePicturesAreRefinedToTheSameNumbers) {
    const Scene scene = makeScene();
    auto whole = DocumentRenderer::create(scene.assets, {}).value();
    auto refined = DocumentRenderer::create(scene.assets, {}).value();
    Document open = scene.document;
    open.occlusion.settings.screenSpace.steps = open.occlusion.settings.screenSpace.lastStep = 4;
    int reports = 0;
    const ProgressFunction count = [&reports](double, std::string_view) { return ++reports > 0; };
    ASSERT_TRUE(refined.render(open, 0.0, 1200, 900, {BufferId::AmbientOcclusion}, count).ok());
    EXPECT_GT(reports, 1);
    FrameInputs inputs = frameInputs(open, scene.assets, 0.0, 1200, 900);
    auto pipeline = FramePipeline::create(scene.assets.avatar->evaluator).value();
    ASSERT_TRUE(pipeline->render(inputs, {BufferId::AmbientOcclusion}).ok());
    const Image a = refined.picture(BufferId::AmbientOcclusion).value(),
                b = pipeline->picture(BufferId::AmbientOcclusion).value();
    for (std::size_t i = 0; i < a.pixels.size(); ++i) ASSERT_NEAR(a.pixels[i], b.pixels[i], 1e-4f);
    const ProgressFunction stop = [](double, std::string_view) { return false; };
    EXPECT_EQ(refined.render(open, 0.5, 1200, 900, {BufferId::Beauty}, stop).error().code, ErrorCode::Cancelled);
}

TEST(Export, AnExrHoldsTheBuffersAsLayers) {
    const test::TemporaryFolder folder;
    const Scene scene = makeScene();
    ScreenshotOptions options = screenshotTo(folder / "all.exr");
    ASSERT_TRUE(writeScreenshot(scene.document, scene.assets, {}, options).ok());
    const ExrImage all = readExr(options.file).value();
    EXPECT_EQ(exrLayers(all).size(), allViewedBuffers().size());
    EXPECT_EQ(all.find("radius_plus.Y"), nullptr);
    EXPECT_TRUE(*documentFromPicture(options.file) == scene.document);
    options.buffers = {BufferId::Depth, BufferId::RadiusPlus};
    options.file = folder / "two.exr";
    ASSERT_TRUE(writeScreenshot(scene.document, scene.assets, {}, options).ok());
    const ExrImage two = readExr(options.file).value();
    EXPECT_EQ(exrLayers(two), (std::vector<std::string>{"depth", "radius_plus"}));
}

TEST(Export, TransparentPicturesHaveAnAlpha) {
    const test::TemporaryFolder folder;
    Scene scene = makeScene();
    scene.document.light.backdrop = BackdropKind::Environment;
    ScreenshotOptions options = screenshotTo(folder / "alpha.png");
    options.transparent = true;
    ASSERT_TRUE(writeScreenshot(scene.document, scene.assets, {}, options).ok());
    const Image image = readPng(options.file).value().image;
    ASSERT_EQ(image.channels, 4);
    EXPECT_EQ(image.at(0, 0, 3), 0.0f);
    float most = 0.0f;
    for (std::size_t p = 3; p < image.pixels.size(); p += 4) most = std::max(most, image.pixels[p]);
    EXPECT_GT(most, 0.98f);
}

/// A grey square that covers the left half of a picture of 24x24 wholly.
struct HalfCovered {
    Image picture, opacity;
    explicit HalfCovered(int channels, float value) {
        opacity.width = picture.width = opacity.height = picture.height = 24;
        opacity.channels = 1;
        picture.channels = channels;
        picture.premultiplied = channels == 4;
        opacity.pixels.resize(24 * 24);
        picture.pixels.resize(24 * 24 * static_cast<std::size_t>(channels));
        for (int row = 0; row < 24; ++row) {
            for (int column = 0; column < 12; ++column) {
                opacity.at(row, column, 0) = 1.0f;
                for (int c = 0; c < channels; ++c) picture.at(row, column, c) = c == 3 ? 1.0f : value;
            }
        }
    }
};

TEST(ShownPicture, BackdropsLieBehindLightAndData) {
    Document document;
    document.view.tone = ToneParams{};
    document.view.tone.backgroundRed = 1.0f;
    const Camera camera = lookAtCamera({0, 0, 0}, {0, 0, -1}, 60, 24, 24);
    const Environment environment = uniformEnvironment(0.25f);
    const EnvironmentPlacement placement{0.0f, 2.0f};
    const HalfCovered light(4, 0.5f), depth(1, 2.0f);
    const auto shown = [&](BufferId id, const HalfCovered& half, bool transparent = false) {
        return shownPicture(document, id, half.picture, half.opacity, camera, placement, &environment, transparent)
            .value();
    };
    Image image = shown(BufferId::Beauty, light);
    EXPECT_NEAR(image.at(5, 20, 0), 1.0f, 1e-5) << "the chosen colour";
    EXPECT_NEAR(image.at(5, 20, 1), 0.0f, 1e-5);
    EXPECT_NEAR(image.at(5, 3, 1), linearToSrgb(0.5f), 1e-5);

    document.light.backdrop = BackdropKind::Environment;
    document.view.tone.exposureEv = 1.0f;
    image = shown(BufferId::Beauty, light);
    EXPECT_NEAR(image.at(5, 20, 0), linearToSrgb(1.0f), 1e-3) << "0.25 x 2, a stop brighter";
    document.view.tone.exposureEv = 0.0f;
    image = shown(BufferId::Depth, depth);
    EXPECT_NEAR(image.at(5, 20, 2), linearToSrgb(0.5f), 1e-3) << "light behind data";
    const Image alone = displayPicture(BufferId::Depth, depth.picture, depth.opacity, DisplaySettings{}).value();
    EXPECT_NEAR(image.at(5, 3, 0), alone.at(5, 3, 0), 1e-5) << "data keep their colours";

    document.light.backdrop = BackdropKind::Checkerboard;
    for (const auto& [id, half] : {std::pair{BufferId::Beauty, light}, {BufferId::Depth, depth}}) {
        image = shown(id, half);
        EXPECT_NEAR(image.at(13, 13, 0), linearToSrgb(0.030f), 1e-5);
        EXPECT_NEAR(image.at(3, 13, 0), linearToSrgb(0.016f), 1e-5);
    }
    image = shown(BufferId::Beauty, light, true);
    ASSERT_EQ(image.channels, 4);
    EXPECT_EQ(image.at(5, 20, 3), 0.0f);
}

TEST(ShownPicture, RangeAndColourMapAreTheViews) {
    Document document;
    BufferDisplay& display = document.view.buffers[static_cast<std::size_t>(BufferId::Depth)];
    display.range = std::pair{1.0f, 3.0f};
    display.colorMap = ColorMap::Gray;
    const HalfCovered depth(1, 2.0f);
    const Camera camera = lookAtCamera({0, 0, 0}, {0, 0, -1}, 60, 24, 24);
    const Image image =
        shownPicture(document, BufferId::Depth, depth.picture, depth.opacity, camera, {}, nullptr).value();
    EXPECT_NEAR(image.at(5, 3, 0), 0.5f, 0.01f);
}

TEST(Backdrop, BlurGoesFromThePictureToItsMean) {
    Environment environment = uniformEnvironment(0.0f, 64);
    Image& picture = environment.picture;
    for (int row = 0; row < picture.height; ++row) {
        for (int column = 0; column < picture.width; ++column) {
            for (int c = 0; c < 3; ++c) picture.at(row, column, c) = column % 2 == 0 ? 1.0f : 0.0f;
        }
    }
    const Camera camera = lookAtCamera({0, 0, 0}, {0, 0, 1}, 60, 48, 48);
    const auto contrast = [&](float blur) {
        Image image;
        image.width = image.height = 48;
        image.channels = 4;
        image.pixels.assign(48 * 48 * 4, 0.0f);
        EXPECT_TRUE(addBackdrop(image, camera, environment, {}, blur).ok());
        const auto [low, high] = std::minmax_element(&image.pixels[24 * 48 * 4], &image.pixels[25 * 48 * 4]);
        float least = 1, most = 0;
        for (std::size_t p = 24 * 48 * 4; p < 25 * 48 * 4; p += 4) {
            least = std::min(least, image.pixels[p]);
            most = std::max(most, image.pixels[p]);
        }
        (void)low;
        (void)high;
        return std::pair{least, most};
    };
    EXPECT_GT(contrast(0.0f).second - contrast(0.0f).first, 0.8f);
    EXPECT_LT(contrast(0.1f).second - contrast(0.1f).first, contrast(0.0f).second - contrast(0.0f).first);
    EXPECT_NEAR(contrast(1.0f / 6.0f).first, 0.5f, 1e-5) << "one of six halvings: neighbours are mixed";
    EXPECT_NEAR(contrast(1.0f).second, 0.5f, 1e-5);
}

TEST(Export, AFilmShowsTheRangeOfTheTimeline) {
    const test::TemporaryFolder folder;
    Scene scene = makeScene();
    waveOverTime(scene.document);
    VideoOptions options;
    options.file = folder / "frames";
    options.width = 60;
    options.height = 81; // pictures may have odd sides
    ASSERT_EQ(filmTimes(scene.document, options), (std::vector<double>{0.0, 0.25, 0.5, 0.75}));
    const Status written = writeVideo(scene.document, scene.assets, {}, options);
    ASSERT_TRUE(written.ok()) << written.error().describe();
    const Image first = readPng(options.file / "0000.png").value().image;
    const Image last = readPng(options.file / "0003.png").value().image;
    EXPECT_FALSE(std::filesystem::exists(options.file / "0004.png"));
    EXPECT_NE(first.pixels, last.pixels) << "the elbow bends";
    const Document third = documentFromPicture(options.file / "0002.png").value();
    EXPECT_EQ(third.timeline.timeS, 0.5);

    options.file = folder / "film.mp4";
    EXPECT_EQ(writeVideo(scene.document, scene.assets, {}, options).error().code, ErrorCode::InvalidArgument)
        << "films have even sides";
    options.height = 80;
    options.startS = 0.5;
    options.endS = 1.0;
    options.framesPerSecond = 8.0;
    const Status film = writeVideo(scene.document, scene.assets, {}, options);
    ASSERT_TRUE(film.ok()) << film.error().describe();
    const auto probe = runProcess({"ffprobe", "-v", "error", "-count_frames", "-show_entries",
                                   "stream=nb_read_frames,r_frame_rate", "-of", "csv=p=0", options.file.string()});
    ASSERT_TRUE(probe.ok());
    EXPECT_NE(probe->output.find("8/1,4"), std::string::npos) << probe->output;
    const auto restored = documentFromPicture(options.file);
    ASSERT_TRUE(restored.ok()) << restored.error().describe();
    EXPECT_TRUE(*restored == scene.document);
}

TEST(Export, WhatCannotBeWrittenIsSaidAndLeavesNothing) {
    const test::TemporaryFolder folder;
    Scene scene = makeScene();
    const auto code = [&](const ScreenshotOptions& options) {
        const Status status = writeScreenshot(scene.document, scene.assets, {}, options);
        EXPECT_FALSE(std::filesystem::exists(options.file));
        return status.ok() ? ErrorCode::Internal : status.error().code;
    };
    EXPECT_EQ(code(screenshotTo(folder / "shot.gif")), ErrorCode::InvalidArgument);
    ScreenshotOptions options = screenshotTo(folder / "shot.png");
    options.width = 0;
    EXPECT_EQ(code(options), ErrorCode::InvalidArgument);
    options = screenshotTo(folder / "shot.png");
    EXPECT_EQ(writeScreenshot(scene.document, scene.assets, {}, options, [](double, std::string_view) { return false; })
                  .error()
                  .code,
              ErrorCode::Cancelled);
    EXPECT_FALSE(std::filesystem::exists(options.file));
    SceneAssets dark = scene.assets;
    dark.light = nullptr;
    EXPECT_EQ(writeScreenshot(scene.document, dark, {}, options).error().code, ErrorCode::NotFound);
    scene.document.view.buffer = BufferId::Normal;
    EXPECT_TRUE(writeScreenshot(scene.document, dark, {}, options).ok()) << "normals need no light";
    EXPECT_FALSE(writeScreenshot(scene.document, {}, {}, options).ok()) << "but an avatar";
    VideoOptions film;
    film.file = folder / "film.avi";
    EXPECT_EQ(writeVideo(scene.document, scene.assets, {}, film).error().code, ErrorCode::InvalidArgument);
}

} // namespace
} // namespace ars
