// Trained avatars through the hook that the program sets, with an evaluator that stands for slow networks.
#include "engine/scene/trained_avatar.h"

#include "engine/core/file.h"
#include "engine/frame/rest_avatar.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/run_folder.h"
#include "engine/scene/session.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>

namespace ars {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr auto kLong = 120s; ///< never waited for, unless something hangs
constexpr int kWidth = 48, kHeight = 64;
constexpr auto kEvaluation = 25ms;

/// Surfels rise with the turn of the left elbow, and take their time; colours are those of the view's depth axis.
class FakeNetworks : public AvatarEvaluator {
public:
    explicit FakeNetworks(std::shared_ptr<AvatarEvaluator> body) : body_(std::move(body)) {}
    const AvatarRig& rig() const override { return body_->rig(); }
    const TemplateMesh& mesh() const override { return body_->mesh(); }
    std::string description() const override { return "fake networks"; }
    bool dependsOnPose() const override { return true; }
    bool colorsDependOnView() const override { return true; }
    Status evaluate(const Pose& pose, const Camera* view, Surfels& surfels) override {
        ++evaluations;
        if (view) ++views;
        if (inside.exchange(true)) ++collisions;
        std::this_thread::sleep_for(kEvaluation);
        ARS_TRY_STATUS(body_->evaluate(pose, nullptr, surfels));
        const float turn = glm::length(axisAngleFromQuat(pose.rotations[18]));
        for (glm::vec3& mean : surfels.means) mean.y += 0.01f * turn;
        if (view) {
            const glm::vec3 forward = 0.5f + 0.5f * glm::vec3(glm::transpose(view->rotation)[2]);
            for (glm::vec3& color : surfels.colors) color = forward;
        }
        inside = false;
        return {};
    }

    std::atomic<int> evaluations{0}, views{0}, collisions{0};
    std::atomic<bool> inside{false};

private:
    std::shared_ptr<AvatarEvaluator> body_;
};

std::shared_ptr<AvatarEvaluator> smallBody() {
    static const std::shared_ptr<AvatarEvaluator> body = [] {
        RestAvatarOptions options;
        options.maxSurfels = 1500;
        return std::shared_ptr<AvatarEvaluator>(restAvatarFromFile("open", options).value());
    }();
    return body;
}

PartRadii learnedRadii() {
    PartRadii radii = initialPartRadii();
    for (std::size_t p = 0; p < radii.size(); ++p) radii[p] *= 1.1f + 0.05f * static_cast<float>(p);
    return radii;
}

class TrainedAvatarTest : public ::testing::Test {
protected:
    void SetUp() override {
        setTrainedAvatarOpener([this](const fs::path& folder, bool project) -> Result<OpenedTrainedAvatar> {
            ++opened_;
            folder_opened_ = folder;
            EXPECT_TRUE(project);
            if (refusal_) return *refusal_;
            if (throws_) throw std::runtime_error("the networks fell over");
            OpenedTrainedAvatar avatar;
            avatar.evaluator = networks_;
            avatar.radii = learnedRadii();
            avatar.splat.kernel = SurfelKernel::RaySplat;
            avatar.occluded = occluded_;
            avatar.occlusion.thicknessM = 0.23f;
            avatar.posing.importanceFalloffM = 0.3f;
            avatar.preset = "tiny";
            avatar.origin = "step 10 of a training";
            if (light_) {
                avatar.light = CubeMap(16);
                for (std::size_t i = 0; i < avatar.light->texels.size(); ++i)
                    avatar.light->texels[i] = i % 3 == 0 ? 0.8f : 0.4f;
            }
            return avatar;
        });
        makeAvatar(avatar_);
        start(smallDocument());
    }
    void TearDown() override {
        session_.reset();
        setTrainedAvatarOpener({});
    }

    static Document smallDocument() {
        Document document = newDocument();
        document.avatar.rest.maxSurfels = 1500;
        document.occlusion.settings.method = OcclusionMethod::Off;
        return document;
    }
    void start(const Document& document) {
        SessionOptions options;
        options.stateFolder = folder_ / "state";
        options.autosave = false;
        options.document = document;
        options.lightBase = kSmallestLightBase;
        session_ = std::make_unique<Session>(std::move(options));
        session_->setViewport(kWidth, kHeight);
    }
    static void write(const fs::path& path, const std::string& text) {
        fs::create_directories(path.parent_path());
        ASSERT_TRUE(writeFileAtomic(path, text).ok()) << path;
    }
    static void makeAvatar(const fs::path& folder) { write(folder / "avatar.json", "{}"); }
    void makeRun(const fs::path& run) {
        write(run / kRunConfigFile, "{}");
        write(run / kRunStatusFile, runStatusToJson({}).dump());
    }
    fs::path makeCheckpoint(const fs::path& run, int step) {
        const fs::path folder = run / kRunCheckpointFolder / fmt::format("{:08}", step);
        makeAvatar(folder);
        write(folder / "complete.json", fmt::format(R"({{"step": {}}})", step));
        return folder;
    }

    Session& session() { return *session_; }
    const Document& document() { return session_->document(); }
    void settle() { ASSERT_TRUE(session_->settle(kLong)); }
    void run(std::string_view id, const Arguments& arguments, std::string_view gesture = {}) {
        const Status status = session_->run(id, arguments, gesture);
        ASSERT_TRUE(status.ok()) << id << ": " << status.error().describe();
    }
    std::vector<Notice> notices(Notice::Kind kind) {
        std::vector<Notice> found = session_->takeNotices();
        std::erase_if(found, [kind](const Notice& notice) { return notice.kind != kind; });
        return found;
    }
    void openAndSettle(const fs::path& path) {
        settle();
        session_->open(path);
        settle();
    }
    void expectShown(const fs::path& source, const fs::path& folder) {
        settle();
        EXPECT_EQ(document().avatar.source, source.string());
        ASSERT_TRUE(session_->assets().avatar->trained);
        EXPECT_EQ(session_->assets().avatar->evaluator, networks_);
        EXPECT_EQ(folder_opened_, folder);
        EXPECT_EQ(document().occlusion.radii, learnedRadii());
        EXPECT_EQ(document().occlusion.splat.kernel, SurfelKernel::RaySplat);
        const auto frame = session_->frame();
        ASSERT_TRUE(frame);
        EXPECT_EQ(frame->quality, FrameQuality::Full);
        EXPECT_EQ(frame->avatar, session_->assets().avatar);
        EXPECT_TRUE(notices(Notice::Kind::Error).empty());
    }
    /// Steps of a drag until a frame of the last pose is there.
    void dragElbow(double degrees) {
        run("pose.rotate_joint", {{"joint", "left_elbow"}, {"x", degrees}, {"y", 0.0}, {"z", 0.0}}, "drag");
        const Pose pose = poseAt(document(), session_->assets(), session_->timeS());
        for (int i = 0; i < 20000; ++i) {
            session_->update(0.0);
            const auto frame = session_->frame();
            if (frame && frame->inputs.pose.rotations == pose.rotations) return;
            std::this_thread::sleep_for(1ms);
        }
        FAIL() << "no frame of the dragged pose";
    }

    test::TemporaryFolder folder_;
    fs::path avatar_ = folder_ / "anna.avatar";
    std::shared_ptr<FakeNetworks> networks_ = std::make_shared<FakeNetworks>(smallBody());
    std::atomic<int> opened_{0};
    fs::path folder_opened_;
    std::optional<Error> refusal_;
    bool throws_ = false;
    bool light_ = true;
    bool occluded_ = true;
    std::unique_ptr<Session> session_;
};

// ---- opening

TEST_F(TrainedAvatarTest, OpensByDropCommandLineAndDialog) {
    openAndSettle(avatar_);
    expectShown(avatar_, avatar_);
}

TEST_F(TrainedAvatarTest, OpensByTheCommand) {
    settle();
    run("avatar.open", {{"source", avatar_.string()}});
    EXPECT_EQ(document().avatar.source, "rest:open") << "it enters the document when it is there";
    expectShown(avatar_, avatar_);
}

TEST_F(TrainedAvatarTest, OpensFromAProjectWithTheRadiiOfTheProject) {
    openAndSettle(avatar_);
    run("occlusion.radius", {{"part", "wrist"}, {"metres", 0.1}});
    const Document saved = document();
    session().save(folder_ / "a.ars");
    settle();
    session().newProject();
    settle();
    session().open(folder_ / "a.ars");
    settle();
    EXPECT_TRUE(document() == saved);
    EXPECT_EQ(session().assets().avatar->evaluator, networks_);
    EXPECT_EQ(document().occlusion.initial, learnedRadii());
}

TEST_F(TrainedAvatarTest, ARunOpensItsNewestCheckpointAndIsFollowed) {
    const fs::path run = folder_ / "run";
    makeRun(run);
    makeCheckpoint(run, 10);
    const fs::path newest = makeCheckpoint(run, 200);
    write(run / kRunCheckpointFolder / "00000300" / "avatar.json", "{}"); // half written
    openAndSettle(run);
    expectShown(run, newest);
    EXPECT_EQ(session().trainingRun(), run);
    EXPECT_EQ(session().trainingRunsOpened(), 1u);

    const fs::path later = makeCheckpoint(run, 400);
    session().openAs(run, FileRole::Avatar);
    settle();
    EXPECT_EQ(folder_opened_, later) << "opened again, it is read anew";
}

TEST_F(TrainedAvatarTest, ACheckpointOpensAsItIs) {
    makeRun(folder_ / "run");
    const fs::path first = makeCheckpoint(folder_ / "run", 10);
    makeCheckpoint(folder_ / "run", 20);
    openAndSettle(first);
    expectShown(first, first);
}

TEST_F(TrainedAvatarTest, ARunWithoutACheckpointIsFollowedAndSaidSo) {
    makeRun(folder_ / "run");
    openAndSettle(folder_ / "run");
    EXPECT_EQ(session().trainingRun(), folder_ / "run");
    EXPECT_EQ(document().avatar.source, "rest:open");
    const auto told = notices(Notice::Kind::Note);
    ASSERT_EQ(told.size(), 1u);
    EXPECT_NE(told[0].text.find("no complete checkpoint"), std::string::npos);
}

TEST_F(TrainedAvatarTest, FoldersAreToldByTheirContent) {
    makeRun(folder_ / "run");
    EXPECT_EQ(*Session::roleOf(avatar_), FileRole::Avatar);
    EXPECT_EQ(*Session::roleOf(folder_ / "run"), FileRole::Run);
    EXPECT_EQ(*Session::roleOf(makeCheckpoint(folder_ / "run", 10)), FileRole::Avatar);
    fs::create_directories(folder_ / "nothing");
    EXPECT_EQ(Session::roleOf(folder_ / "nothing").error().code, ErrorCode::Unsupported);
}

// ---- what it brings

TEST_F(TrainedAvatarTest, UndoReturnsToTheAvatarRadiiAndKernelBefore) {
    settle();
    run("light.exposure", {{"ev", 0.5}});
    const Document before = document();
    openAndSettle(avatar_);
    EXPECT_FALSE(document() == before);
    ASSERT_TRUE(session().undo());
    EXPECT_TRUE(document() == before);
    settle();
    EXPECT_FALSE(session().assets().avatar->trained);
    ASSERT_TRUE(session().redo());
    expectShown(avatar_, avatar_);
    EXPECT_EQ(opened_, 1) << "what was used lately is kept";
}

TEST_F(TrainedAvatarTest, ResetGoesToTheLearnedRadiiAndLockedOnesStay) {
    settle();
    run("occlusion.radius", {{"part", "knee"}, {"metres", 0.2}});
    run("occlusion.lock", {{"part", "knee"}});
    openAndSettle(avatar_);
    const auto knee = static_cast<std::size_t>(BodyPart::Knee), wrist = static_cast<std::size_t>(BodyPart::Wrist);
    EXPECT_EQ(document().occlusion.radii[knee], 0.2f);
    EXPECT_EQ(document().occlusion.initial, learnedRadii());
    run("occlusion.radius", {{"part", "wrist"}, {"metres", 0.1}});
    run("occlusion.reset", {});
    EXPECT_EQ(document().occlusion.radii[wrist], learnedRadii()[wrist]);
}

TEST_F(TrainedAvatarTest, ARestAvatarAfterItFindsTheTablesRadiiButWhatWasTunedByHand) {
    openAndSettle(avatar_);
    run("occlusion.radius", {{"part", "wrist"}, {"metres", 0.1}});
    run("avatar.open", {{"source", "rest:open"}});
    settle();
    PartRadii expected = initialPartRadii();
    EXPECT_EQ(document().occlusion.initial, expected);
    expected[static_cast<std::size_t>(BodyPart::Wrist)] = 0.1f;
    EXPECT_EQ(document().occlusion.radii, expected);
    EXPECT_EQ(document().occlusion.splat, OcclusionSection().splat);
    EXPECT_EQ(document().occlusion.posing, OcclusionSection().posing);
    EXPECT_EQ(document().occlusion.settings.screenSpace, OcclusionSection().settings.screenSpace);
}

TEST_F(TrainedAvatarTest, OcclusionIsThatOfTheTraining) {
    occluded_ = false;
    settle();
    run("occlusion.method", {{"name", "mesh_rays"}});
    openAndSettle(avatar_);
    EXPECT_EQ(document().occlusion.settings.method, OcclusionMethod::Off) << "it learned to do without";
    EXPECT_EQ(document().occlusion.settings.screenSpace.thicknessM, 0.23f);
    EXPECT_EQ(document().occlusion.posing.importanceFalloffM, 0.3f);
    run("avatar.open", {{"source", "rest:open"}});
    settle();
    EXPECT_EQ(document().occlusion.settings.method, OcclusionMethod::ScreenSpace);
}

TEST_F(TrainedAvatarTest, AFreshDocumentTakesItsLightAsOneUndoEntry) {
    openAndSettle(avatar_);
    EXPECT_EQ(document().light.kind, LightKind::File);
    EXPECT_EQ(document().light.file, avatar_.string());
    EXPECT_EQ(session().editor().history().size(), 1u);
    const Image& picture = session().assets().light->source->environment.picture;
    EXPECT_NEAR(picture.pixels[0], 0.8f, 1e-4f);
    EXPECT_NEAR(picture.pixels[1], 0.4f, 1e-4f);
    ASSERT_TRUE(session().undo());
    EXPECT_EQ(document().light, newDocument().light);
}

TEST_F(TrainedAvatarTest, APersonsLightStaysAndTheLearnedOneCanBeChosen) {
    settle();
    run("light.uniform", {{"radiance", 0.7}});
    const LightSection chosen = document().light;
    openAndSettle(avatar_);
    EXPECT_EQ(document().light, chosen);
    EXPECT_TRUE(session().assets().avatar->trained->hasLight);
    session().openAs(avatar_, FileRole::Light);
    settle();
    EXPECT_EQ(document().light.file, avatar_.string());
    EXPECT_TRUE(notices(Notice::Kind::Error).empty());
}

TEST_F(TrainedAvatarTest, WithoutALearnedLightTheLampsStay) {
    light_ = false;
    openAndSettle(avatar_);
    EXPECT_EQ(document().light, newDocument().light);
    session().openAs(avatar_, FileRole::Light);
    settle();
    ASSERT_EQ(notices(Notice::Kind::Error).size(), 1u);
}

TEST_F(TrainedAvatarTest, ItHasNoShapeToChange) {
    openAndSettle(avatar_);
    EXPECT_FALSE(session().commandEnabled(*findCommand("avatar.shape")).ok());
    const int before = opened_;
    run("settings.set", {{"group", "rest"}, {"name", "surfels"}, {"value", 900}});
    settle();
    EXPECT_EQ(opened_, before) << "how rest: avatars are sampled is nothing to it";
}

// ---- what is evaluated when

TEST_F(TrainedAvatarTest, ADragShowsDraftsWithoutTheNetworksAndRestRunsThemOnce) {
    openAndSettle(avatar_);
    const int before = networks_->evaluations;
    session().setInteracting(true);
    for (const double degrees : {5.0, 10.0, 15.0, 20.0}) {
        dragElbow(degrees);
        EXPECT_NE(session().frame()->quality, FrameQuality::Full);
        EXPECT_EQ(networks_->evaluations, before) << "at " << degrees;
    }
    session().setInteracting(false);
    session().endGesture();
    settle();
    EXPECT_EQ(networks_->evaluations, before + 1);
    EXPECT_EQ(session().frame()->quality, FrameQuality::Full);
    EXPECT_EQ(networks_->collisions, 0);
}

TEST_F(TrainedAvatarTest, LightAndRadiiAndKernelEvaluateNothing) {
    openAndSettle(avatar_);
    const int before = networks_->evaluations;
    run("light.rotate", {{"degrees", 70.0}});
    settle();
    run("light.uniform", {{"radiance", 0.7}});
    settle();
    run("occlusion.radius", {{"part", "elbow"}, {"metres", 0.2}});
    settle();
    run("occlusion.method", {{"name", "screen_space"}});
    settle();
    run("settings.set", {{"group", "splat"}, {"name", "kernel"}, {"value", "gaussian_surfel"}});
    settle();
    EXPECT_EQ(networks_->evaluations, before);
    EXPECT_EQ(session().frame()->quality, FrameQuality::Full);
}

TEST_F(TrainedAvatarTest, ACameraRunsTheNetworksOnlyWhereRadianceIsSeen) {
    openAndSettle(avatar_);
    EXPECT_EQ(networks_->views, 0) << "nobody looks at the colours of a view";
    const int before = networks_->evaluations;
    run("camera.orbit", {{"yaw", 20.0}, {"pitch", 0.0}});
    settle();
    EXPECT_EQ(networks_->evaluations, before);

    run("view.buffer", {{"name", "radiance"}});
    settle();
    EXPECT_EQ(networks_->evaluations, before + 1);
    EXPECT_EQ(networks_->views, 1);
    const std::vector<float> here = session().frame()->picture(BufferId::Radiance)->pixels;
    run("camera.orbit", {{"yaw", 40.0}, {"pitch", 0.0}});
    settle();
    EXPECT_EQ(networks_->views, 2);
    EXPECT_NE(session().frame()->picture(BufferId::Radiance)->pixels, here);

    session().setViewport(kWidth + 8, kHeight + 8);
    settle();
    EXPECT_EQ(networks_->views, 2) << "the window's size is not the view";
    run("view.buffer", {{"name", "albedo"}});
    settle();
    run("camera.orbit", {{"yaw", 40.0}, {"pitch", 0.0}});
    settle();
    EXPECT_EQ(networks_->views, 2);
    run("view.buffer", {{"name", "radiance"}});
    settle();
    EXPECT_EQ(networks_->views, 3) << "the colours were those of an older view";
    EXPECT_EQ(session().frame()->quality, FrameQuality::Full);
}

TEST_F(TrainedAvatarTest, ATurningCameraShowsTheColoursAtRestAlone) {
    openAndSettle(avatar_);
    run("view.buffer", {{"name", "radiance"}});
    settle();
    session().setInteracting(true);
    const int views = networks_->views;
    run("camera.orbit", {{"yaw", 20.0}, {"pitch", 0.0}}, "orbit");
    for (int i = 0; i < 50; ++i) {
        session().update(0.0);
        std::this_thread::sleep_for(1ms);
    }
    EXPECT_EQ(networks_->views, views) << "a draft keeps the colours";
    session().setInteracting(false);
    session().endGesture();
    settle();
    EXPECT_EQ(networks_->views, views + 1);
}

TEST_F(TrainedAvatarTest, APictureIsWrittenBesideTheWindow) {
    openAndSettle(avatar_);
    ScreenshotOptions options;
    options.file = folder_ / "shot.png";
    options.width = options.height = 40;
    session().screenshot(options);
    settle();
    EXPECT_TRUE(fs::exists(options.file));
    EXPECT_EQ(documentFromPicture(options.file).value().avatar.source, avatar_.string());
}

TEST_F(TrainedAvatarTest, ItStandsOnTheOtherSideOfAComparison) {
    settle();
    run("compare.avatar", {{"source", avatar_.string()}});
    run("view.layout", {{"layout", "side_by_side"}});
    settle();
    ASSERT_TRUE(session().otherFrame());
    EXPECT_EQ(session().assets().otherAvatar->evaluator, networks_);
}

// ---- what goes wrong

TEST_F(TrainedAvatarTest, AnErrorOfTheOpenerIsOneSentenceAndChangesNothing) {
    settle();
    const Document before = document();
    refusal_ =
        makeError(ErrorCode::BadFile, (avatar_ / "weights.safetensors").string(), "expected 12 tensors, found 3");
    for (const bool command : {false, true}) {
        if (command)
            run("avatar.open", {{"source", avatar_.string()}});
        else
            session().open(avatar_);
        settle();
        const auto found = notices(Notice::Kind::Error);
        ASSERT_EQ(found.size(), 1u);
        EXPECT_NE(found[0].title.find("anna.avatar"), std::string::npos);
        EXPECT_NE(found[0].text.find("expected 12 tensors"), std::string::npos);
        EXPECT_TRUE(document() == before);
        EXPECT_FALSE(session().editor().canUndo());
    }
    refusal_.reset();
    throws_ = true;
    session().open(avatar_);
    settle();
    auto found = notices(Notice::Kind::Error);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_NE(found[0].text.find("fell over"), std::string::npos);

    setTrainedAvatarOpener({});
    session().open(avatar_);
    settle();
    found = notices(Notice::Kind::Error);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_NE(found[0].text.find("LibTorch"), std::string::npos);
    EXPECT_TRUE(document() == before);
}

TEST_F(TrainedAvatarTest, AFolderThatIsGoneIsNamed) {
    settle();
    run("avatar.open", {{"source", (folder_ / "gone.avatar").string()}});
    settle();
    const auto found = notices(Notice::Kind::Error);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_NE(found[0].text.find("gone.avatar"), std::string::npos);
    EXPECT_EQ(openTrainedAvatar(folder_.path()).error().code, ErrorCode::Unsupported);
}

TEST_F(TrainedAvatarTest, AProjectWhoseAvatarIsGoneShowsTheOpenBody) {
    openAndSettle(avatar_);
    session().save(folder_ / "a.ars");
    settle();
    (void)session().takeNotices();
    fs::remove_all(avatar_);
    start(smallDocument());
    settle();
    session().open(folder_ / "a.ars");
    settle();
    EXPECT_EQ(document().avatar.source, avatar_.string()) << "it may come back";
    EXPECT_FALSE(session().assets().avatar->trained);
    EXPECT_FALSE(notices(Notice::Kind::Error).empty());
}

TEST_F(TrainedAvatarTest, ACheckpointThatIsPrunedWhileItIsReadGivesWayToTheNext) {
    const fs::path run = folder_ / "run";
    makeRun(run);
    const fs::path old = makeCheckpoint(run, 10);
    int calls = 0;
    setTrainedAvatarOpener([&](const fs::path& folder, bool) -> Result<OpenedTrainedAvatar> {
        if (++calls == 1) {
            makeCheckpoint(run, 20);
            fs::remove_all(old);
            return makeError(ErrorCode::NotFound, (folder / "weights.safetensors").string(), "no such file");
        }
        OpenedTrainedAvatar avatar;
        avatar.evaluator = networks_;
        avatar.origin = folder.filename().string();
        return avatar;
    });
    const auto opened = openTrainedAvatar(run);
    ASSERT_TRUE(opened.ok()) << opened.error().describe();
    EXPECT_EQ(opened->origin, "00000020");
}

} // namespace
} // namespace ars
