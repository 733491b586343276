// Opening captures of the three layouts, and choosing cameras and frames.
#include "engine/capture/capture.h"

#include "engine/capture/actorshq_calibration.h"
#include "engine/capture/published_settings.h"
#include "tests/support/test_data.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <gtest/gtest.h>

#include <numeric>

namespace ars::test {
namespace {
namespace fs = std::filesystem;

Capture openedOr(const fs::path& folder) {
    auto capture = openCapture(folder);
    EXPECT_TRUE(capture.ok()) << capture.error().describe();
    return capture ? *std::move(capture) : Capture{};
}

class EveryLayout : public ::testing::TestWithParam<CaptureKind> {};

TEST_P(EveryLayout, KeepsCamerasFramesPosesAndPictures) {
    SyntheticCapture what;
    what.kind = GetParam();
    const TemporaryFolder folder;
    writeCapture(what, folder.path());
    const Capture capture = openedOr(folder.path());
    EXPECT_EQ(capture.kind, what.kind);
    ASSERT_EQ(capture.cameras.size(), 3u);
    EXPECT_EQ(capture.frames, (std::vector<int>{0, 1, 2, 3}));
    EXPECT_TRUE(capture.missing.empty());
    EXPECT_EQ(capture.betas, std::vector<float>(10, 0.25f));
    EXPECT_FLOAT_EQ(capture.pose(2).translation.x, 0.02f);
    for (int i = 0; i < 3; ++i) {
        const Camera expected = what.camera(i);
        const Camera& camera = capture.cameras[static_cast<std::size_t>(i)].camera;
        EXPECT_EQ(capture.cameras[static_cast<std::size_t>(i)].name, what.cameraName(i));
        const glm::dvec3 point(0.3, 0.4, -0.2);
        EXPECT_LT(glm::distance(camera.toCamera(point), expected.toCamera(point)), 1e-12);
        EXPECT_NEAR(camera.cx, expected.cx, 1e-12);
        EXPECT_NEAR(camera.cy, expected.cy, 1e-12);
        EXPECT_NEAR(camera.fx, expected.fx, 1e-12);
        EXPECT_EQ(capture.imagePath({i, 2}), folder.path() / what.picture(i, 2));
        EXPECT_EQ(capture.maskPath({i, 2}), folder.path() / what.mask(i, 2));
        const auto view = readView(capture, {i, 2}, {.cropMargin = -1});
        ASSERT_TRUE(view.ok()) << view.error().describe();
        EXPECT_NEAR(view->color.at(0, 0, 1) * 255.0f, what.background(i, 2), 1.0f);
        EXPECT_NEAR(view->color.at(20, 20, 1) * 255.0f, 200.0f, 1.0f);
        EXPECT_EQ(view->mask.at(20, 20, 0), 1.0f);
        EXPECT_EQ(view->mask.at(0, 0, 0), 0.0f);
    }
}

INSTANTIATE_TEST_SUITE_P(Capture, EveryLayout,
                         ::testing::Values(CaptureKind::AvatarRex, CaptureKind::THuman4, CaptureKind::ActorsHq),
                         [](const auto& test) { return std::string(captureKindName(test.param)); });

TEST(Capture, MissingPicturesAreLeftOutHoweverSlashesLean) {
    SyntheticCapture what;
    const TemporaryFolder folder;
    writeCapture(what, folder.path());
    writeBytes(
        folder / "missing_img_files.txt",
        "D:\\data\\zzr\\22010716\\00000001.jpg\r\n/data/zzr/22010714/00000002.jpg\n\n22010712/mask/pha/00000000.jpg"
        "\r\nno_camera/00000000.jpg\n");
    fs::remove(folder.path() / what.picture(0, 1)); // listed and gone
    fs::remove(folder.path() / what.picture(2, 3)); // gone
    fs::remove(folder.path() / what.mask(1, 0));    // a picture without its mask
    const Capture capture = openedOr(folder.path());
    EXPECT_EQ(capture.missing, (std::set<ViewId>{{0, 1}, {1, 0}, {1, 2}, {2, 0}, {2, 3}}));
    EXPECT_EQ(capture.listedMissing, 3u);
    ASSERT_EQ(capture.notes.size(), 3u);
    EXPECT_EQ(capture.notes[0], "no picture of this capture is named by 1 line of missing_img_files.txt");
    EXPECT_EQ(capture.notes[1], "1 picture is not there, the first is 22010712/00000003.jpg");
    EXPECT_EQ(capture.notes[2], "1 mask is not there, the first is 22010714/mask/pha/00000000.jpg");
    const auto view = readView(capture, {0, 1});
    ASSERT_FALSE(view.ok());
    EXPECT_EQ(view.error().code, ErrorCode::InvalidArgument);
}

TEST(Capture, FramesAreTheNumbersInTheNamesWhateverIsNotThere) {
    SyntheticCapture what;
    what.frames = 7;
    const TemporaryFolder folder;
    writeCapture(what, folder.path());
    for (int camera = 0; camera < 3; ++camera) {
        for (const int frame : {0, 1, 4}) {
            fs::remove(folder.path() / what.picture(camera, frame));
            fs::remove(folder.path() / what.mask(camera, frame));
        }
    }
    const Capture capture = openedOr(folder.path());
    EXPECT_EQ(capture.frames, (std::vector<int>{2, 3, 5, 6}));
    EXPECT_FLOAT_EQ(capture.pose(2).translation.x, 0.05f) << "the pose of number 5";
    EXPECT_TRUE(capture.missing.empty());
}

TEST(Capture, PicturesWithAlphaNeedNoMasks) {
    SyntheticCapture what;
    what.cameras = 1;
    const TemporaryFolder folder;
    writeCapture(what, folder.path());
    const std::string name = what.cameraName(0);
    fs::remove_all(folder.path() / name);
    Image picture = filledImage(what.width, what.height, 4, 0.5f, ColorSpace::Srgb);
    for (int row = 0; row < what.height; ++row) {
        for (int column = 0; column < what.width; ++column) picture.at(row, column, 3) = column < 20 ? 1.0f : 0.0f;
    }
    for (int frame = 0; frame < 4; ++frame)
        writePicture(folder.path() / name / fmt::format("{:04d}.png", frame), picture);
    const Capture capture = openedOr(folder.path());
    EXPECT_TRUE(capture.maskPath({0, 0}).empty());
    EXPECT_EQ(capture.imagePath({0, 3}).filename(), "0003.png");
    const auto view = readView(capture, {0, 0}, {.cropMargin = 0});
    ASSERT_TRUE(view.ok()) << view.error().describe();
    EXPECT_EQ(view->mask.width, 20);
    EXPECT_EQ(view->color.channels, 3);
}

TEST(Capture, MasksOfZeroAndOneAreMasks) {
    SyntheticCapture what;
    what.kind = CaptureKind::ActorsHq;
    const TemporaryFolder folder;
    writeCapture(what, folder.path());
    Image mask = filledImage(what.width, what.height, 1, 0.0f, ColorSpace::Data);
    for (int column = 5; column < 9; ++column) mask.at(30, column, 0) = 1.0f / 255.0f;
    writePicture(folder.path() / what.mask(0, 0), mask);
    const Capture capture = openedOr(folder.path());
    const auto view = readView(capture, {0, 0}, {.cropMargin = 0});
    ASSERT_TRUE(view.ok()) << view.error().describe();
    EXPECT_EQ(view->mask.width, 4);
    EXPECT_EQ(view->mask.height, 1);
}

// The published values by hand: the camera stands at (1, 2, 3) and is turned by a quarter about y, so it looks along
// +x; its x axis (right) is then -z and its y axis (down) +y.
TEST(ActorsHqCalibration, InvertsCameraToWorldAndScalesIntrinsics) {
    const std::string text = "\xEF\xBB\xBFname,w,h,rx,ry,rz,tx,ty,tz,fx,fy,px,py\r\n"
                             "Cam002,747,1021,0,1.5707963267948966,0,1,2,3,2.0,1.5,0.51,0.47\r\n"
                             "Cam001,100,200,0,0,0,0,0,-4,1,1,0.5,0.5\n\n";
    const auto cameras = parseActorsHqCalibration(text);
    ASSERT_TRUE(cameras.ok()) << cameras.error().describe();
    ASSERT_EQ(cameras->size(), 2u);
    EXPECT_EQ((*cameras)[0].name, "Cam002");
    const Camera& camera = (*cameras)[0].camera;
    EXPECT_LT(glm::distance(camera.toCamera({5.0, 2.0, 3.0}), glm::dvec3(0, 0, 4)), 1e-12);
    EXPECT_LT(glm::distance(camera.toCamera({1.0, 2.0, 2.0}), glm::dvec3(1, 0, 0)), 1e-12);
    EXPECT_LT(glm::distance(camera.toCamera({1.0, 3.0, 3.0}), glm::dvec3(0, 1, 0)), 1e-12);
    EXPECT_DOUBLE_EQ(camera.fx, 2.0 * 747);
    EXPECT_DOUBLE_EQ(camera.fy, 1.5 * 1021);
    EXPECT_DOUBLE_EQ(camera.cx, 0.51 * 747);
    EXPECT_DOUBLE_EQ(camera.cy, 0.47 * 1021);
    EXPECT_LT(glm::distance((*cameras)[1].camera.toCamera({0, 0, 0}), glm::dvec3(0, 0, 4)), 1e-12);
    EXPECT_FALSE((*cameras)[0].distorted());
}

TEST(ActorsHqCalibration, TakesColumnsInAnyOrderAndLensCoefficients) {
    const auto cameras = parseActorsHqCalibration("k2,py,px,fy,fx,tz,ty,tx,rz,ry,rx,h,w,name,k1,k3\n"
                                                  "0.2,0.5,0.25,2,1,4,0,0,0,0,0,50,40,A,0.1,0.3\n");
    ASSERT_TRUE(cameras.ok()) << cameras.error().describe();
    EXPECT_EQ((*cameras)[0].distortion, (std::vector<double>{0.1, 0.2, 0.0, 0.0, 0.3}));
    EXPECT_DOUBLE_EQ((*cameras)[0].camera.cx, 10.0);
    EXPECT_DOUBLE_EQ((*cameras)[0].camera.fy, 100.0);
}

TEST(ActorsHqCalibration, NamesTheLineOfWhatIsWrong) {
    const std::string head = "name,w,h,rx,ry,rz,tx,ty,tz,fx,fy,px,py\n";
    const std::string sound = "A,4,4,0,0,0,0,0,0,1,1,0.5,0.5\n";
    const struct {
        std::string text, message;
    } cases[] = {
        {"", "the calibration has no camera"},
        {head, "the calibration has no camera"},
        {"name,w,h,rx,ry,rz,tx,ty,tz,fx,px,py\n" + sound, "line 1: the column fy is missing"},
        {head + sound + "B,4,4,0,0,0,0,zero,0,1,1,0.5,0.5\n", "line 3: ty is no number: \"zero\""},
        {head + "B,4,4,0,0,0,0,0\n", "line 2: tz is no number"},
        {head + "B,4.5,4,0,0,0,0,0,0,1,1,0.5,0.5\n", "line 2: w and h must be positive whole numbers"},
        {head + "B,4,4,0,0,0,0,0,0,1,-1,0.5,0.5\n", "line 2: focal lengths must be positive, found fx 1 and fy -1"},
        {head + "B,4,4,0,0,nan,0,0,0,1,1,0.5,0.5\n", "line 2: rz is no number: \"nan\""},
        {head + "../B,4,4,0,0,0,0,0,0,1,1,0.5,0.5\n", "line 2: \"../B\" is no camera name"},
        {head + sound + sound, "line 3: the camera \"A\" comes twice"},
    };
    for (const auto& wrong : cases) {
        const auto cameras = parseActorsHqCalibration(wrong.text);
        ASSERT_FALSE(cameras.ok()) << wrong.message;
        EXPECT_EQ(cameras.error().describe().substr(0, wrong.message.size()), wrong.message);
    }
}

TEST(Capture, ActorsHqOpensFromActorSequenceAndScale) {
    SyntheticCapture what;
    what.kind = CaptureKind::ActorsHq;
    const TemporaryFolder folder;
    const fs::path actor = folder / "Actor01";
    writeCapture(what, actor / "Sequence1");
    for (const fs::path& opened : {actor, actor / "Sequence1", actor / "Sequence1/4x", actor / "Sequence1/4x/"}) {
        const Capture capture = openedOr(opened);
        EXPECT_EQ(capture.cameras.size(), 3u) << opened;
        EXPECT_EQ(capture.frames.size(), 4u) << opened;
        EXPECT_NE(capture.subject, "actor01") << "three cameras are not the recording of 160";
    }
}

TEST(Capture, ActorsHqMayLackCamerasAndLatePoses) {
    SyntheticCapture what;
    what.kind = CaptureKind::ActorsHq;
    const TemporaryFolder folder;
    writeCapture(what, folder.path());
    fs::remove_all(folder.path() / "4x/rgbs/Cam002");
    fs::remove_all(folder.path() / "4x/masks/Cam002");
    ASSERT_TRUE(writeSmplParams(folder / "smpl_params.npz", syntheticMotion(3)).ok());
    const Capture capture = openedOr(folder.path());
    EXPECT_EQ(capture.frames, (std::vector<int>{0, 1, 2}));
    EXPECT_EQ(capture.notes,
              (std::vector<std::string>{"pictures are taken from 4x", "no pose for 1 frame from number 3 on, left out",
                                        "1 of 3 cameras have no pictures here and are left out"}));
    const auto split = trainingSplit(capture);
    ASSERT_TRUE(split.ok()) << split.error().describe();
    EXPECT_EQ(split->cameras, (std::vector<int>{0, 2}));
    const auto asked = trainingSplit(capture, "0-2");
    ASSERT_FALSE(asked.ok());
    EXPECT_NE(asked.error().message.find("camera \"Cam002\" (index 1) has no pictures in"), std::string::npos);
}

TEST(Capture, TheCapturesHereOpen) {
    ARS_TEST_DATA_FILE(folder, "capture/casual");
    const Capture capture = openedOr(folder);
    EXPECT_EQ(capture.kind, CaptureKind::AvatarRex);
    EXPECT_EQ(capture.subject, "casual");
    EXPECT_EQ(capture.cameras.size(), 12u);
    EXPECT_EQ(capture.frames.size(), 26u);
    EXPECT_EQ(capture.motion.frames.size(), 26u);
    EXPECT_TRUE(capture.missing.empty());
    EXPECT_TRUE(capture.notes.empty());
    for (const char* name : {"capture/casual_val/heldout_views", "capture/casual_val/novel_poses"}) {
        ARS_TEST_DATA_FILE(held, name);
        const Capture validation = openedOr(held);
        EXPECT_EQ(validation.cameras.size(), 2u);
        EXPECT_EQ(validation.frames, (std::vector<int>{0, 1, 2, 3}));
        for (int camera = 0; camera < 2; ++camera) {
            const auto view = readView(validation, {camera, 0});
            ASSERT_TRUE(view.ok()) << view.error().describe();
            const double persons = std::accumulate(view->mask.pixels.begin(), view->mask.pixels.end(), 0.0);
            EXPECT_GT(persons, 0.05 * 384 * 512) << "the person covers 5 to 11 % of every picture";
            EXPECT_LT(persons, 0.11 * 384 * 512);
        }
    }
}

} // namespace
} // namespace ars::test
