// The studio without its window: files of every kind, jobs, frames, playing, undo. Pictures are compared bit for bit.
#include "engine/scene/session.h"

#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/hdr.h"
#include "engine/io/npz.h"
#include "engine/io/png.h"
#include "engine/rig/motion.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>

namespace ars {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr auto kLong = 120s; ///< never waited for, unless something hangs
constexpr int kWidth = 48, kHeight = 64;

/// A session with few surfels and a small picture, in a state folder of its own.
class SessionTest : public ::testing::Test {
protected:
    void SetUp() override {
        SessionOptions options;
        options.stateFolder = folder_ / "state";
        options.autosave = false;
        options.document = smallDocument();
        options.lightBase = kSmallestLightBase;
        options.wake = [this] { ++wakes_; };
        session_ = std::make_unique<Session>(std::move(options));
        session_->setViewport(kWidth, kHeight);
    }

    static Document smallDocument() {
        Document document = newDocument();
        document.avatar.rest.maxSurfels = 1500;
        document.light.kind = LightKind::Uniform;
        document.occlusion.settings.method = OcclusionMethod::Off;
        return document;
    }

    Session& session() { return *session_; }
    const Document& document() { return session_->document(); }
    void settle() { ASSERT_TRUE(session_->settle(kLong)) << firstNotice(); }
    void run(std::string_view id, const Arguments& arguments) {
        const Status status = session_->run(id, arguments);
        ASSERT_TRUE(status.ok()) << id << ": " << status.error().describe();
    }
    std::string firstNotice() {
        for (const Notice& notice : session_->takeNotices()) return notice.title + ": " + notice.text;
        return {};
    }
    std::vector<Notice> errors() {
        std::vector<Notice> found = session_->takeNotices();
        std::erase_if(found, [](const Notice& notice) { return notice.kind != Notice::Kind::Error; });
        return found;
    }
    std::vector<float> picture() {
        settle();
        const auto frame = session_->frame();
        const Image* image = frame ? frame->picture(BufferId::Beauty) : nullptr;
        EXPECT_TRUE(image) << "no picture; " << firstNotice();
        if (!image) return {};
        EXPECT_EQ(frame->quality, FrameQuality::Full);
        return image->pixels;
    }
    /// Opens a file; the document must be as it was, and one error must say why.
    void expectRefused(const fs::path& path, std::string_view part) {
        settle();
        (void)session_->takeNotices();
        const Document before = document();
        const std::uint64_t version = session_->editor().version();
        session_->open(path);
        settle();
        EXPECT_TRUE(document() == before) << path;
        EXPECT_EQ(session_->editor().version(), version) << path;
        const std::vector<Notice> found = errors();
        ASSERT_EQ(found.size(), 1u) << path;
        EXPECT_NE(found[0].title.find(path.filename().string()), std::string::npos) << found[0].title;
        EXPECT_NE(found[0].text.find(part), std::string::npos) << found[0].text;
        EXPECT_FALSE(found[0].hint.empty()) << found[0].text;
    }

    fs::path writeLight(const std::string& name, float red) {
        Image image;
        image.width = 32;
        image.height = 16;
        image.channels = 3;
        for (int i = 0; i < 32 * 16; ++i) image.pixels.insert(image.pixels.end(), {red, 0.5f, 0.25f});
        const fs::path path = folder_ / name;
        EXPECT_TRUE(writeHdr(path, image).ok());
        return path;
    }
    fs::path writePicture(const std::string& name) {
        Image image;
        image.width = 4;
        image.height = 6;
        image.channels = 3;
        image.space = ColorSpace::Srgb;
        image.pixels.assign(4 * 6 * 3, 0.5f);
        EXPECT_TRUE(writePng(folder_ / name, image).ok());
        return folder_ / name;
    }
    fs::path writeText(const std::string& name, std::string_view text) {
        EXPECT_TRUE(writeFileAtomic(folder_ / name, text).ok());
        return folder_ / name;
    }
    fs::path writeMotion(const std::string& name, int frames) {
        Motion motion;
        motion.framesPerSecond = 10.0;
        for (int f = 0; f < frames; ++f) {
            motion.frames.push_back(restPose(kSmplxJointCount));
            motion.frames.back().rotations[18] = quatFromAxisAngle({0.0f, 0.1f * static_cast<float>(f), 0.0f});
        }
        EXPECT_TRUE(writeSmplParams(folder_ / name, motion).ok());
        return folder_ / name;
    }

    test::TemporaryFolder folder_;
    std::atomic<int> wakes_{0};
    std::unique_ptr<Session> session_;
};

// ---- starting

TEST_F(SessionTest, EndsInAWholePictureOfTheDocumentAndWakesItsWindow) {
    const std::vector<float> pixels = picture();
    ASSERT_FALSE(pixels.empty());
    EXPECT_GT(*std::max_element(pixels.begin(), pixels.end()), 0.0f) << "an empty picture";
    EXPECT_GT(wakes_.load(), 0);
    EXPECT_TRUE(session().jobs().empty());
    EXPECT_TRUE(errors().empty());
    EXPECT_FALSE(session().assets().avatar->coarse);
    EXPECT_EQ(session().assets().light->quality, LightQuality::Exact);
    EXPECT_FALSE(session().editor().modified());
}

TEST_F(SessionTest, TwoOfThemShowTheSameAndDoNotMeet) {
    SessionOptions options;
    options.stateFolder = folder_ / "other state";
    options.document = smallDocument();
    options.lightBase = kSmallestLightBase;
    Session other(options);
    other.setViewport(kWidth, kHeight);
    ASSERT_TRUE(other.run("light.exposure", {{"ev", 1.0}}).ok());
    const std::vector<float> ours = picture();
    ASSERT_TRUE(other.settle(kLong));
    EXPECT_EQ(document().light.exposureEv, 0.0f);
    EXPECT_NE(other.frame()->picture(BufferId::Beauty)->pixels, ours);
    ASSERT_TRUE(other.undo());
    ASSERT_TRUE(other.settle(kLong));
    EXPECT_EQ(other.frame()->picture(BufferId::Beauty)->pixels, ours);
}

TEST_F(SessionTest, CanEndInTheMiddleOfEverything) {
    session().open(writeLight("a.hdr", 1.0f));
    session().save(folder_ / "a.ars");
    session().play();
    session().update(0.01);
    session_.reset(); // must neither hang nor crash
}

// ---- opening

TEST_F(SessionTest, TellsFilesByTheirContent) {
    const auto role = [](const fs::path& path) {
        const auto found = Session::roleOf(path);
        EXPECT_TRUE(found.ok()) << found.error().describe();
        return found.ok() ? *found : FileRole::PictureOfOurs;
    };
    EXPECT_EQ(role(writeLight("sunset.png.hdr", 1.0f)), FileRole::Light);
    EXPECT_EQ(role(writePicture("photo.hdr")), FileRole::ComparePicture) << "the name plays no part";
    EXPECT_EQ(role(writeMotion("walk.npz", 3)), FileRole::Clip);
    EXPECT_EQ(role(writeText("arm.json", R"({"pose": 1, "rotations": {}})")), FileRole::PoseFile);
    EXPECT_EQ(role(writeText("project.json", documentToJson(newDocument()).dump())), FileRole::Project);
    EXPECT_EQ(role(writeText("cameras.json", R"({"left": {"K": [], "R": [], "T": []}})")), FileRole::Capture);
    EXPECT_EQ(role(writeText("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")), FileRole::Avatar);
    EXPECT_EQ(role(writeText("a.gltf", R"({"asset": {"version": "2.0"}, "meshes": [{}], "animations": [{}]})")),
              FileRole::Avatar);
    EXPECT_EQ(role(writeText("b.gltf", R"({"asset": {"version": "2.0"}, "animations": [{}]})")), FileRole::Clip);
    EXPECT_EQ(role(fs::path(*resourceFolder()) / "bodies" / "open_body.npz"), FileRole::Avatar);

    fs::create_directories(folder_ / "capture");
    writeText("capture/calibration_full.json", "{}");
    EXPECT_EQ(role(folder_ / "capture"), FileRole::Capture);
    fs::create_directories(folder_ / "faces");
    writePicture("faces/px.png");
    EXPECT_EQ(role(folder_ / "faces"), FileRole::Light);
}

TEST_F(SessionTest, TellsKindsOfExrByLayersShapeAndAttributes) {
    const auto write = [&](const std::string& name, int width, int height, const std::string& layer,
                           const std::string& attribute) {
        Image image;
        image.width = width;
        image.height = height;
        image.channels = 3;
        image.pixels.assign(static_cast<std::size_t>(3 * width * height), 0.5f);
        ExrImage exr;
        EXPECT_TRUE(addExrLayer(exr, layer, image, "RGB").ok());
        if (!attribute.empty()) exr.textAttributes["ars"] = attribute;
        EXPECT_TRUE(writeExr(folder_ / name, exr).ok());
        return *Session::roleOf(folder_ / name);
    };
    EXPECT_EQ(write("a.exr", 32, 16, "", ""), FileRole::Light);
    EXPECT_EQ(write("b.exr", 32, 24, "", ""), FileRole::ComparePicture);
    EXPECT_EQ(write("c.exr", 32, 16, "albedo", ""), FileRole::ComparePicture);
    EXPECT_EQ(write("d.exr", 32, 16, "", R"({"avatar": {}})"), FileRole::PictureOfOurs);
    EXPECT_EQ(write("e.exr", 32, 16, "", R"({"sky": {"sun_elevation": 4}})"), FileRole::Light) << "a generated light";
}

TEST_F(SessionTest, TellsTheSharedFiles) {
    const std::vector<std::pair<std::string, FileRole>> files{
        {"open_body.npz", FileRole::Avatar},
        {"capture/casual/template.glb", FileRole::Avatar},
        {"capture/casual/template.npz", FileRole::Avatar},
        {"capture/casual", FileRole::Capture},
        {"capture/casual/calibration_full.json", FileRole::Capture},
        {"capture/casual/smpl_params.npz", FileRole::Clip},
        {"capture/casual_val/heldout_views/24110013/gt/albedo/00000000.exr", FileRole::ComparePicture},
        {"capture/casual_val/heldout_views/24110013/00000000.jpg", FileRole::ComparePicture},
        {"bodies/smplx_topology/SMPLX-male.obj", FileRole::Avatar},
        {"hdri/forest.exr", FileRole::Light},
        {"motion/aitviewer_sample.bvh", FileRole::Clip},
        {"motion/smplx/example_smplx_poses.npy", FileRole::Clip},
        {"motion/smplx/apose_to_handsFront_smplx.npz", FileRole::Clip},
    };
    for (const auto& [name, role] : files) {
        ARS_TEST_DATA_FILE(path, name);
        const auto found = Session::roleOf(path);
        ASSERT_TRUE(found.ok()) << found.error().describe();
        EXPECT_EQ(*found, role) << name;
    }
    ARS_TEST_DATA_FILE(video, "multiview/pose2sim/cam01.mp4");
    const auto refused = Session::roleOf(video);
    ASSERT_FALSE(refused.ok());
    EXPECT_NE(refused.error().describe().find("MP4"), std::string::npos) << refused.error().describe();
}

TEST_F(SessionTest, OpensALightAndUndoShowsTheFirstBitForBit) {
    const std::vector<float> first = picture();
    const fs::path file = writeLight("red.hdr", 2.0f);
    session().open(file);
    EXPECT_FALSE(session().jobs().empty());
    const std::vector<float> second = picture();
    EXPECT_EQ(document().light.kind, LightKind::File);
    EXPECT_EQ(document().light.file, file.string());
    EXPECT_NE(second, first);
    EXPECT_EQ(session().recentFiles().files().front(), file);
    ASSERT_TRUE(session().undo());
    EXPECT_EQ(picture(), first);
    ASSERT_TRUE(session().redo());
    EXPECT_EQ(picture(), second);
}

TEST_F(SessionTest, ReadsAFileAnewThatIsOpenedAgain) {
    const fs::path file = writeLight("sky.hdr", 0.5f);
    session().open(file);
    const std::vector<float> first = picture();
    writeLight("sky.hdr", 4.0f);
    session().open(file);
    EXPECT_NE(picture(), first);
    EXPECT_EQ(session().assets().light->source->environment.picture.pixels[0], 4.0f);
}

TEST_F(SessionTest, OpensAnAvatarOfABodyFileAndOfAMesh) {
    const fs::path body = fs::path(*resourceFolder()) / "bodies" / "open_body.npz";
    settle();
    run("avatar.shape", {{"index", 0}, {"value", 1.0}});
    session().open(body);
    settle();
    EXPECT_TRUE(errors().empty());
    EXPECT_EQ(document().avatar.source, "rest:" + body.string());
    EXPECT_EQ(session().assets().avatar->key, avatarKey(document().avatar));
    EXPECT_EQ(session().frame()->avatar, session().assets().avatar);
    ARS_TEST_DATA_FILE(mesh, "capture/casual/template.glb");
    session().open(mesh);
    settle();
    EXPECT_EQ(document().avatar.source, "rest:" + mesh.string());
    EXPECT_TRUE(session().assets().avatar->shapeNames.empty()) << "a mesh has no shape";
    ASSERT_TRUE(session().undo());
    settle();
    EXPECT_EQ(document().avatar.source, "rest:" + body.string());
}

TEST_F(SessionTest, OpensAMotionAndPlaysItForTheAvatarThatIsThere) {
    settle();
    session().open(writeMotion("bend.npz", 21));
    settle();
    EXPECT_TRUE(errors().empty());
    EXPECT_EQ(document().timeline.clip, (folder_ / "bend.npz").string());
    EXPECT_NEAR(document().timeline.endS, 2.0, 1e-9); // 20 steps of a tenth of a second
    ASSERT_TRUE(session().assets().clip);
    run("timeline.seek", {{"time", 1.0}});
    settle();
    const Pose& shown = session().frame()->inputs.pose;
    EXPECT_NEAR(axisAngleFromQuat(shown.rotations[18]).y, 1.0f, 1e-4f);
    ASSERT_TRUE(session().undo());
    ASSERT_TRUE(session().undo());
    settle();
    EXPECT_FALSE(session().assets().clip);
}

TEST_F(SessionTest, AMotionOpenedBeforeTheAvatarIsThereWaitsForIt) {
    const fs::path file = writeMotion("early.npz", 5);
    session().openAs(file, FileRole::Clip);
    EXPECT_FALSE(session().assets().avatar);
    settle();
    EXPECT_TRUE(errors().empty());
    EXPECT_EQ(document().timeline.clip, file.string());
    EXPECT_TRUE(session().assets().clip);
}

TEST_F(SessionTest, OpensAPose) {
    settle();
    session().open(writeText("arm.json", R"({"pose": 1, "rotations": {"left_elbow": [0, -90, 0]}})"));
    settle();
    EXPECT_TRUE(errors().empty());
    const auto elbow = static_cast<std::size_t>(smplxJointIndex("left_elbow"));
    EXPECT_NEAR(axisAngleFromQuat(document().pose.pose.rotations[elbow]).y, -1.5708f, 1e-4f);
}

TEST_F(SessionTest, OpensACaptureThroughItsFirstCameraAsOneEntryOfTheHistory) {
    ARS_TEST_DATA_FILE(capture, "capture/casual");
    settle();
    session().open(capture);
    settle();
    EXPECT_TRUE(errors().empty());
    EXPECT_EQ(document().camera.capture, (capture / "calibration_full.json").string());
    EXPECT_EQ(document().camera.datasetCamera, "24110001");
    ASSERT_TRUE(session().assets().capture);
    run("compare.kind", {{"kind", "photograph"}});
    settle();
    ASSERT_TRUE(session().assets().picture);
    EXPECT_EQ(session().assets().picture->image.height, 512);
    ASSERT_TRUE(session().undo());
    ASSERT_TRUE(session().undo());
    settle();
    EXPECT_EQ(document().camera.capture, "");
    EXPECT_FALSE(session().assets().capture);
}

TEST_F(SessionTest, OpensAPictureToCompareWithAndShowsIt) {
    const fs::path file = writePicture("photo.png");
    session().open(file);
    settle();
    EXPECT_TRUE(errors().empty());
    EXPECT_EQ(document().view.compare.kind, CompareKind::Picture);
    EXPECT_NE(document().view.layout, ViewLayout::Single);
    ASSERT_TRUE(session().assets().picture);
    EXPECT_EQ(session().assets().picture->image.height, 6);
    EXPECT_EQ(session().editor().history().size(), 1u);
}

TEST_F(SessionTest, WrongFilesLeaveTheDocumentAloneAndSayWhy) {
    expectRefused(folder_ / "nothing.exr", "nothing.exr");
    expectRefused(writeText("empty.glb", ""), "empty");
    expectRefused(writeText("notes.txt", "dear diary"), "text");
    expectRefused(writeText("bad.ars", "{\"program\": \"ars\", \"format\": 1, \"light\": 3}"), "light");
    expectRefused(writeText("torn.ars", "{\"program\": \"ars\", "), "JSON");
    expectRefused(writeText("empty.json", "{}"), "JSON");
    expectRefused(writeText("cut.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 32\n"), "");
    expectRefused(writeText("no.gltf", R"({"asset": {"version": "2.0"}, "meshes": [{"primitives": []}]})"), "");
    expectRefused(writeText("cut.bvh", "HIERARCHY\nROOT Hips\n{\n"), "");
    expectRefused(writeText("pose.json", R"({"rotations": {"left_elbow": "bent"}})"), "left_elbow");
    expectRefused(writeText("cameras.json", R"({"left": {"K": [1], "R": [], "T": []}})"), "left");
    fs::create_directories(folder_ / "folder");
    expectRefused(folder_ / "folder", "folder");
    fs::create_directories(folder_ / "faces");
    writePicture("faces/px.png");
    expectRefused(folder_ / "faces", "");
    NamedArrays arrays;
    arrays.emplace_back("heights", Array::fromFloats({1}, std::vector<float>{1.0f}));
    ASSERT_TRUE(writeNpz(folder_ / "heights.npz", arrays).ok());
    expectRefused(folder_ / "heights.npz", "heights");
}

TEST_F(SessionTest, AStoppedOpeningChangesNothing) {
    settle();
    const Document before = document();
    session().open(writeLight("a.hdr", 1.0f));
    while (!session().jobs().empty()) {
        for (const JobStatus& job : session().jobs()) session().cancel(job.id);
        session().update(0.0);
    }
    settle();
    EXPECT_TRUE(document() == before);
    EXPECT_TRUE(errors().empty()) << "what was stopped on request is no error";
}

// ---- projects

TEST_F(SessionTest, ASavedProjectShowsTheSamePictureAfterwards) {
    session().open(writeLight("lights/red.hdr", 1.5f));
    session().open(writeMotion("bend.npz", 11));
    settle();
    run("timeline.seek", {{"time", 0.7}});
    run("light.rotate", {{"degrees", 30.0}});
    const std::vector<float> before = picture();
    const Document saved = document();
    EXPECT_TRUE(session().editor().modified());
    session().save(folder_ / "mine.ars");
    settle();
    EXPECT_FALSE(session().editor().modified());
    EXPECT_EQ(session().projectPath(), folder_ / "mine.ars");
    session().newProject();
    EXPECT_TRUE(session().projectPath().empty());
    session().open(folder_ / "mine.ars");
    EXPECT_EQ(picture(), before);
    EXPECT_TRUE(document() == saved);
    EXPECT_FALSE(session().editor().modified());
    EXPECT_EQ(session().projectPath(), folder_ / "mine.ars");
}

TEST_F(SessionTest, AProjectThatCannotBeSavedStaysUnsaved) {
    run("light.exposure", {{"ev", 1.0}});
    writeText("file", "in the way");
    session().save(folder_ / "file" / "mine.ars");
    settle();
    EXPECT_TRUE(session().editor().modified());
    EXPECT_TRUE(session().projectPath().empty());
    EXPECT_EQ(errors().size(), 1u);
}

TEST_F(SessionTest, AProjectWithMissingFilesOpensWithWhatThereIs) {
    Document document = smallDocument();
    document.avatar.source = "rest:/nowhere/body.npz";
    document.light.kind = LightKind::File;
    document.light.file = "/nowhere/forest.exr";
    document.timeline.clip = "/nowhere/walk.bvh";
    document.camera.capture = "/nowhere/calibration_full.json";
    document.camera.datasetCamera = "left";
    document.view.compare.kind = CompareKind::Picture;
    document.view.compare.file = "/nowhere/photo.png";
    ASSERT_TRUE(saveProject(folder_ / "moved.ars", document).ok());
    settle();
    (void)session().takeNotices();
    session().open(folder_ / "moved.ars");
    EXPECT_FALSE(picture().empty()) << "something stands in for what is missing";
    const std::vector<Notice> found = errors();
    EXPECT_EQ(found.size(), 5u) << "one for each missing thing";
    for (const Notice& notice : found) EXPECT_NE(notice.text.find("/nowhere/"), std::string::npos) << notice.text;
    EXPECT_TRUE(session().document() == document) << "saving it again loses nothing";
    session().update(0.1);
    settle();
    EXPECT_TRUE(errors().empty()) << "said once";
}

TEST_F(SessionTest, ALightThatVanishesLeavesThePictureWithANotice) {
    const fs::path file = writeLight("a.hdr", 1.0f);
    const std::vector<float> before = picture();
    fs::remove(file);
    run("light.open", {{"file", file.string()}});
    EXPECT_EQ(picture(), before);
    EXPECT_EQ(errors().size(), 1u);
}

// ---- jobs

TEST_F(SessionTest, WorkBesideTheWindowReportsItsEndAndItsFailure) {
    settle();
    (void)session().takeNotices();
    std::thread::id worker;
    bool done = false;
    session().start(
        "Thinking",
        [&](const ProgressFunction& progress) {
            worker = std::this_thread::get_id();
            return reportProgress(progress, 0.5, "about it");
        },
        [&](const Status& status) { done = status.ok(); });
    settle();
    EXPECT_TRUE(done);
    EXPECT_NE(worker, std::this_thread::get_id());
    const auto fail = [](const ProgressFunction&) -> Status { throw std::bad_alloc(); };
    session().start("Falling", fail);
    session().start("Falling quietly", fail, {}, true);
    settle();
    const std::vector<Notice> found = errors();
    ASSERT_EQ(found.size(), 1u);
    EXPECT_NE(found[0].title.find("Falling"), std::string::npos);
}

TEST_F(SessionTest, AJobCanBeStoppedAndListsWhatItDoes) {
    settle();
    ErrorCode code = ErrorCode::Internal;
    const std::uint64_t job = session().start(
        "Counting",
        [](const ProgressFunction& progress) -> Status {
            for (int i = 0;; ++i) {
                ARS_TRY_STATUS(reportProgress(progress, 0.25, "sheep"));
                std::this_thread::sleep_for(1ms);
            }
        },
        [&](const Status& status) { code = status.ok() ? ErrorCode::Internal : status.error().code; });
    while (session().jobs().empty() || session().jobs()[0].what != "sheep") std::this_thread::sleep_for(1ms);
    EXPECT_EQ(session().jobs()[0].fraction, 0.25);
    EXPECT_EQ(session().jobs()[0].title, "Counting");
    EXPECT_FALSE(session().settled());
    session().cancel(job);
    settle();
    EXPECT_EQ(code, ErrorCode::Cancelled);
    EXPECT_TRUE(errors().empty());
}

// ---- time

TEST_F(SessionTest, PlayingAdvancesLoopsAndPausingStoresTheTime) {
    settle();
    run("timeline.range", {{"start", 1.0}, {"end", 2.0}});
    run("timeline.speed", {{"factor", 2.0}});
    session().play();
    EXPECT_DOUBLE_EQ(session().timeS(), 1.0) << "begins with the range";
    session().update(0.1);
    EXPECT_DOUBLE_EQ(session().timeS(), 1.2);
    EXPECT_EQ(document().timeline.timeS, 0.0) << "playing is no edit";
    session().update(0.45);
    EXPECT_NEAR(session().timeS(), 1.1, 1e-9) << "begins again";
    EXPECT_FALSE(session().settled());
    session().pause();
    EXPECT_FALSE(session().transport().playing);
    EXPECT_NEAR(document().timeline.timeS, 1.1, 1e-9);
    settle();
    EXPECT_EQ(session().frame()->quality, FrameQuality::Full);
}

TEST_F(SessionTest, PlayingWithoutLoopStaysAtTheEnd) {
    settle();
    run("timeline.range", {{"start", 0.0}, {"end", 0.5}});
    run("timeline.loop", {{"enabled", false}});
    session().play();
    session().update(0.3);
    session().update(0.3);
    EXPECT_FALSE(session().transport().playing);
    EXPECT_DOUBLE_EQ(document().timeline.timeS, 0.5);
    session().play();
    EXPECT_DOUBLE_EQ(session().timeS(), 0.0) << "from the beginning again";
}

// ---- what is loaded while people drag

TEST_F(SessionTest, DraggingAtTheSkyShowsDraftsAndRestShowsTheExactLight) {
    run("light.kind", {{"kind", "sky"}});
    settle();
    EXPECT_EQ(session().assets().light->quality, LightQuality::Exact);
    session().setInteracting(true);
    const Arguments sun{{"group", "sky"}, {"name", "sun_azimuth"}, {"value", 90.0}};
    ASSERT_TRUE(session().run("settings.set", sun, "drag").ok());
    const auto begin = std::chrono::steady_clock::now();
    while (session().assets().light->key != lightKey(document().light)) {
        session().update(0.01);
        std::this_thread::sleep_for(1ms);
        ASSERT_LT(std::chrono::steady_clock::now() - begin, kLong);
    }
    EXPECT_EQ(session().assets().light->quality, LightQuality::Draft);
    EXPECT_FALSE(session().settled());
    session().endGesture();
    session().setInteracting(false);
    settle();
    EXPECT_EQ(session().assets().light->quality, LightQuality::Exact);
    EXPECT_EQ(session().assets().light->key, lightKey(document().light));
}

TEST_F(SessionTest, AShapeIsMadeOfTheAvatarThatIsThere) {
    settle();
    const auto before = session().assets().avatar;
    run("avatar.shape", {{"index", 1}, {"value", 1.5}});
    settle();
    const auto after = session().assets().avatar;
    ASSERT_NE(after, before);
    EXPECT_EQ(after->key, avatarKey(document().avatar));
    ASSERT_TRUE(session().undo());
    settle();
    EXPECT_EQ(session().assets().avatar, before) << "kept for undo";
}

TEST_F(SessionTest, TheHeldLookIsRenderedOnlyWhileItIsSeen) {
    const std::vector<float> before = picture();
    run("compare.hold", Arguments::object());
    run("light.uniform", {{"radiance", 2.0}});
    settle();
    EXPECT_FALSE(session().otherFrame());
    run("view.layout", {{"layout", "split"}});
    settle();
    ASSERT_TRUE(session().otherFrame());
    EXPECT_EQ(session().otherFrame()->picture(BufferId::Beauty)->pixels, before);
    EXPECT_NE(session().frame()->picture(BufferId::Beauty)->pixels, before);
    run("view.layout", {{"layout", "single"}});
    settle();
    EXPECT_FALSE(session().otherFrame());
}

TEST_F(SessionTest, BringsTheBuffersThatAreWantedAndThoseOfTheLayout) {
    session().setWantedBuffers({BufferId::Roughness});
    run("view.layout", {{"layout", "grid"}});
    run("view.strip", {{"buffers", "albedo,normal"}});
    settle();
    for (const BufferId id : {BufferId::Beauty, BufferId::Roughness, BufferId::Albedo, BufferId::Normal}) {
        EXPECT_TRUE(session().frame()->picture(id));
    }
    EXPECT_FALSE(session().frame()->picture(BufferId::Position));
}

TEST_F(SessionTest, AScreenshotRestoresItsSession) {
    run("light.exposure", {{"ev", 0.5}});
    settle();
    const Document before = document();
    ScreenshotOptions options;
    options.file = folder_ / "shot.png";
    options.width = kWidth;
    options.height = kHeight;
    session().screenshot(options);
    settle();
    EXPECT_TRUE(errors().empty());
    ASSERT_TRUE(fs::exists(options.file));
    session().newProject();
    session().replaceDocument(smallDocument(), {}, true);
    session().open(options.file);
    settle();
    EXPECT_TRUE(errors().empty());
    EXPECT_TRUE(document() == before);
    EXPECT_TRUE(session().projectPath().empty());
    EXPECT_TRUE(session().editor().modified()) << "it is saved nowhere";
}

} // namespace
} // namespace ars
