// What documents name, loaded: keys, forerunners, shapes, pictures, lights. Expected values come from the files.
#include "engine/scene/assets.h"

#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/npz.h"
#include "engine/io/png.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

namespace ars {
namespace {

AvatarSection fewSurfels(int count = 3000) {
    AvatarSection avatar;
    avatar.rest.maxSurfels = count;
    return avatar;
}

const RestAvatar& restOf(const AvatarAsset& asset) { return dynamic_cast<const RestAvatar&>(*asset.evaluator); }

bool sameBits(const std::vector<float>& a, const std::vector<float>& b) { return a == b; }

TEST(AssetKeys, ChangeWithWhatTheAssetIsMadeOfAndWithNothingElse) {
    Document document = newDocument();
    const std::string avatar = avatarKey(document.avatar), light = lightKey(document.light);
    document.avatar.betas = {0.0f, 0.0f};
    document.light.rotationDeg = 40.0f;
    document.light.exposureEv = 2.0f;
    document.light.backdrop = BackdropKind::Environment;
    document.light.file = "/kept/while/the/studio/shines.exr";
    EXPECT_EQ(avatarKey(document.avatar), avatar) << "coefficients of 0 are none";
    EXPECT_EQ(lightKey(document.light), light);
    document.avatar.betas = {0.0f, 0.5f};
    EXPECT_NE(avatarKey(document.avatar), avatar);
    document.light.studio.lamps[0].intensity *= 2.0f;
    EXPECT_NE(lightKey(document.light), light);
    document.light.kind = LightKind::File;
    const std::string file = lightKey(document.light);
    document.light.studio.lamps.clear();
    EXPECT_EQ(lightKey(document.light), file) << "the studio plays no part in a file's light";
    AvatarSection opaque = document.avatar, glassy = document.avatar;
    glassy.rest.opacity = 0.5f;
    EXPECT_NE(avatarKey(opaque), avatarKey(glassy));
}

TEST(AssetKeys, PicturesAreNeededForComparisonsWithPicturesOnly) {
    Document document = newDocument();
    document.view.compare.file = "/a.png";
    EXPECT_EQ(pictureKey(document), "");
    document.view.compare.kind = CompareKind::Picture;
    const std::string picture = pictureKey(document);
    EXPECT_NE(picture, "");
    document.view.compare.layer = "albedo";
    EXPECT_NE(pictureKey(document), picture);
    document.view.compare.kind = CompareKind::Photograph;
    EXPECT_EQ(pictureKey(document), "") << "no capture";
    document.camera.capture = "/c.json";
    document.camera.datasetCamera = "left";
    const std::string first = pictureKey(document);
    document.camera.photograph = 1;
    EXPECT_NE(pictureKey(document), first);
}

TEST(OtherDocument, IsTheHeldLookOrTheOtherAvatarUnderTheSameViewAndTime) {
    Document document = newDocument();
    EXPECT_FALSE(otherDocument(document).has_value());
    document.view.compare.kind = CompareKind::Held;
    EXPECT_FALSE(otherDocument(document).has_value()) << "nothing is held";
    document.view.compare.held =
        std::make_shared<const HeldLook>(HeldLook{document.avatar, document.pose, document.light, document.occlusion});
    document.light.exposureEv = 3.0f;
    document.camera.camera.verticalFieldDeg = 20.0;
    const auto held = otherDocument(document);
    ASSERT_TRUE(held.has_value());
    EXPECT_EQ(held->light.exposureEv, 0.0f);
    EXPECT_EQ(held->camera, document.camera);
    document.view.compare.kind = CompareKind::Avatar;
    document.view.compare.file = "rest:/other.glb";
    document.avatar.betas = {1.0f};
    EXPECT_EQ(otherDocument(document)->avatar.source, "rest:/other.glb");
    EXPECT_TRUE(otherDocument(document)->avatar.betas.empty());
    EXPECT_EQ(otherDocument(document)->light, document.light);
}

TEST(AvatarAsset, KnowsItsSolesNamesAndBounds) {
    const auto asset = loadAvatarAsset(fewSurfels());
    ASSERT_TRUE(asset.ok()) << asset.error().describe();
    // resources/bodies/README.md: 1.748 m tall, 10 shape and 10 expression coefficients, "jaw open" the first of these.
    EXPECT_NEAR((*asset)->restBounds.size().y, 1.748f, 0.002f);
    EXPECT_EQ((*asset)->soleHeightM, (*asset)->restBounds.low.y);
    EXPECT_EQ((*asset)->shapeNames.size(), 10u);
    ASSERT_EQ((*asset)->expressionNames.size(), 10u);
    EXPECT_NE((*asset)->expressionNames[0].find("jaw"), std::string::npos) << (*asset)->expressionNames[0];
    EXPECT_FALSE((*asset)->coarse);
    EXPECT_EQ((*asset)->key, avatarKey(fewSurfels()));
}

TEST(AvatarAsset, AForerunnerComesFirstWithTheSameSkeletonAndFewSurfels) {
    std::shared_ptr<const AvatarAsset> early;
    const AvatarSection avatar = fewSurfels(20000);
    const auto whole = loadAvatarAsset(avatar, nullptr,
                                       [&](std::shared_ptr<const AvatarAsset> asset) { early = std::move(asset); }, {});
    ASSERT_TRUE(whole.ok()) << whole.error().describe();
    ASSERT_TRUE(early);
    EXPECT_TRUE(early->coarse);
    EXPECT_EQ(early->key, (*whole)->key);
    EXPECT_LE(restOf(*early).surfels().count(), 6000u);
    EXPECT_GT(restOf(**whole).surfels().count(), 15000u);
    EXPECT_EQ(early->evaluator->rig().skeleton.restPositions, (*whole)->evaluator->rig().skeleton.restPositions);
}

TEST(AvatarAsset, AnotherShapeMadeOfARelativeEqualsOneMadeAnew) {
    AvatarSection avatar = fewSurfels();
    const auto plain = loadAvatarAsset(avatar);
    ASSERT_TRUE(plain.ok());
    avatar.betas = {1.0f, -0.5f};
    ASSERT_TRUE(sameButShape(avatar, **plain));
    const auto quick = loadAvatarAsset(avatar, *plain, nullptr, {});
    const auto anew = loadAvatarAsset(avatar);
    ASSERT_TRUE(quick.ok() && anew.ok());
    EXPECT_EQ((*quick)->key, (*anew)->key);
    EXPECT_EQ(restOf(**quick).surfels().means, restOf(**anew).surfels().means);
    EXPECT_TRUE(sameBits(restOf(**quick).surfels().rotations, restOf(**anew).surfels().rotations));
    EXPECT_NE(restOf(**quick).surfels().means, restOf(**plain).surfels().means);
    AvatarSection denser = avatar;
    denser.rest.maxSurfels += 1;
    EXPECT_FALSE(sameButShape(denser, **plain));
}

TEST(AvatarAsset, WhatIsNoAvatarIsRefusedWithASentence) {
    const test::TemporaryFolder folder;
    for (const std::string& source : {std::string(""), std::string("rest:"), std::string("open"),
                                      folder.path().string(), "rest:" + (folder / "none.glb").string()}) {
        AvatarSection avatar = fewSurfels();
        avatar.source = source;
        const auto asset = loadAvatarAsset(avatar);
        ASSERT_FALSE(asset.ok()) << source;
        EXPECT_FALSE(asset.error().message.empty());
        EXPECT_NE(asset.error().code, ErrorCode::Internal) << asset.error().describe();
    }
}

TEST(AvatarAsset, CanBeStopped) {
    int calls = 0;
    const auto asset = loadAvatarAsset(fewSurfels(), [&](double, std::string_view) { return ++calls < 2; });
    ASSERT_FALSE(asset.ok());
    EXPECT_EQ(asset.error().code, ErrorCode::Cancelled);
}

TEST(LightAsset, DraftsAreSmallerAndExactOnesFollowThem) {
    LightSection light;
    light.kind = LightKind::Sky;
    std::shared_ptr<const LightAsset> early;
    const auto exact =
        loadLightAsset(light, Device{}, [&](std::shared_ptr<const LightAsset> asset) { early = std::move(asset); }, {});
    ASSERT_TRUE(exact.ok()) << exact.error().describe();
    ASSERT_TRUE(early);
    EXPECT_EQ(early->quality, LightQuality::Draft);
    EXPECT_EQ((*exact)->quality, LightQuality::Exact);
    EXPECT_EQ(early->key, (*exact)->key);
    EXPECT_EQ((*exact)->source->environment.picture.width, light.sky.width);
    EXPECT_LT(early->source->environment.picture.width, light.sky.width);
    EXPECT_LT(early->source->base.size, (*exact)->source->base.size);
    // The same light: average radiance of both pictures, weighed by solid angle.
    const auto average = [](const Image& image) {
        double sum = 0.0, weight = 0.0;
        for (int row = 0; row < image.height; ++row) {
            const double sine = std::sin(3.14159265358979 * (row + 0.5) / image.height);
            for (int column = 0; column < image.width; ++column) sum += sine * image.at(row, column, 1);
            weight += sine * image.width;
        }
        return sum / weight;
    };
    const double a = average(early->source->environment.picture), b = average((*exact)->source->environment.picture);
    EXPECT_NEAR(a / b, 1.0, 0.03); // the sun's disc covers few texels of either
}

TEST(LightAsset, OfAFileIsItsPictureAndAMissingOneIsNamed) {
    LightSection light;
    light.kind = LightKind::File;
    light.file = "/nowhere/forest.exr";
    const auto missing = loadLightAsset(light, Device{}, LightQuality::Draft);
    ASSERT_FALSE(missing.ok());
    EXPECT_EQ(missing.error().code, ErrorCode::NotFound);
    EXPECT_NE(missing.error().describe().find("/nowhere/forest.exr"), std::string::npos);
    ARS_TEST_DATA_FILE(file, "hdri/courtyard.exr");
    light.file = file.string();
    const auto read = loadLightAsset(light, Device{}, LightQuality::Draft);
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_EQ((*read)->source->environment.picture.width, 1024);
}

TEST(LightAsset, IsTheSameBitForBitEveryTime) {
    LightSection light;
    const auto first = loadLightAsset(light, Device{}, LightQuality::Draft);
    const auto second = loadLightAsset(light, Device{}, LightQuality::Draft);
    ASSERT_TRUE(first.ok() && second.ok());
    EXPECT_EQ((*first)->source->base.texels, (*second)->source->base.texels);
}

TEST(PictureAsset, IsTheLayerThatWasAskedFor) {
    const test::TemporaryFolder folder;
    ExrImage exr;
    Image albedo, depth;
    albedo.width = depth.width = 2;
    albedo.height = depth.height = 1;
    albedo.channels = 3;
    depth.channels = 1;
    albedo.pixels = {0.25f, 0.5f, 0.75f, 0, 0, 0};
    depth.pixels = {3.0f, 4.0f};
    ASSERT_TRUE(addExrLayer(exr, "albedo", albedo, "RGB", ExrPixelType::Float).ok());
    ASSERT_TRUE(addExrLayer(exr, "depth", depth, "Z", ExrPixelType::Float).ok());
    ASSERT_TRUE(addExrLayer(exr, "radiance", albedo, "RGB", ExrPixelType::Float).ok());
    const std::string file = (folder / "buffers.exr").string();
    ASSERT_TRUE(writeExr(file, exr).ok());

    const auto found = loadPictureAsset(file, "depth");
    ASSERT_TRUE(found.ok()) << found.error().describe();
    EXPECT_EQ((*found)->image.pixels, depth.pixels);
    EXPECT_EQ((*found)->layers, (std::vector<std::string>{"albedo", "depth", "radiance"}));
    EXPECT_EQ((*loadPictureAsset(file, "radiance"))->image.space, ColorSpace::Srgb);
    EXPECT_EQ((*loadPictureAsset(file, ""))->image.pixels, albedo.pixels) << "no nameless layer: the first";
    const auto missing = loadPictureAsset(file, "normal");
    ASSERT_FALSE(missing.ok());
    EXPECT_NE(missing.error().describe().find("depth"), std::string::npos) << missing.error().describe();
}

TEST(PictureAsset, PngsHaveNoLayers) {
    const test::TemporaryFolder folder;
    Image image;
    image.width = image.height = 1;
    image.channels = 3;
    image.space = ColorSpace::Srgb;
    image.pixels = {1.0f, 0.0f, 0.0f};
    const std::string file = (folder / "red.png").string();
    ASSERT_TRUE(writePng(file, image).ok());
    EXPECT_EQ((*loadPictureAsset(file, ""))->image.pixels, image.pixels);
    EXPECT_FALSE(loadPictureAsset(file, "albedo").ok());
}

TEST(CaptureAsset, OfOneCameraIsNamedByItsFile) {
    const test::TemporaryFolder folder;
    const std::string file = (folder / "front.json").string();
    ASSERT_TRUE(
        writeFileAtomic(file, std::string_view(R"({"width": 64, "height": 48, "K": [[60,0,32],[0,60,24],[0,0,1]],
        "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0,0,3]})"))
            .ok());
    const auto capture = loadCaptureAsset(file);
    ASSERT_TRUE(capture.ok()) << capture.error().describe();
    ASSERT_EQ((*capture)->cameras.size(), 1u);
    EXPECT_EQ((*capture)->cameras[0].name, "front");
    EXPECT_EQ((*capture)->photographs.size(), 1u);
}

TEST(LoadAssets, LoadsEverythingThatADocumentNames) {
    ARS_TEST_DATA_FILE(calibration, "capture/casual/calibration_full.json");
    ARS_TEST_DATA_FILE(motion, "capture/casual/smpl_params.npz");
    Document document = newDocument();
    document.avatar = fewSurfels();
    document.timeline.clip = motion.string();
    document.camera.capture = calibration.string();
    document.camera.datasetCamera = "24110003";
    document.camera.photograph = 2;
    document.view.compare.kind = CompareKind::Photograph;
    const auto assets = loadAssets(document, Device{}, LightQuality::Draft);
    ASSERT_TRUE(assets.ok()) << assets.error().describe();
    EXPECT_EQ(assets->clip->key, motion.string());
    EXPECT_GT(assets->clip->motion->frames.size(), 1u);
    ASSERT_TRUE(assets->picture);
    EXPECT_EQ(assets->picture->key, pictureKey(document));
    EXPECT_EQ(assets->picture->image.width, 384); // INDEX: 384x512
    EXPECT_EQ(assets->picture->image.height, 512);
    EXPECT_FALSE(assets->otherAvatar);
    document.camera.photograph = 400;
    EXPECT_FALSE(loadAssets(document, Device{}, LightQuality::Draft).ok());
}

TEST(LoadAssets, SharesWhatBothSidesOfAComparisonHaveInCommon) {
    Document document = newDocument();
    document.avatar = fewSurfels();
    document.view.compare.kind = CompareKind::Held;
    document.view.compare.held =
        std::make_shared<const HeldLook>(HeldLook{document.avatar, document.pose, document.light, document.occlusion});
    document.light.kind = LightKind::Uniform;
    const auto assets = loadAssets(document, Device{}, LightQuality::Draft);
    ASSERT_TRUE(assets.ok()) << assets.error().describe();
    EXPECT_EQ(assets->otherAvatar, assets->avatar);
    EXPECT_NE(assets->otherLight, assets->light);
}

} // namespace
} // namespace ars
