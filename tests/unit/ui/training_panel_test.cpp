// The training panel on run folders that the test writes; a shell script stands for `ars train`.
#include "engine/core/file.h"
#include "engine/frame/rest_avatar.h"
#include "engine/io/png.h"
#include "engine/scene/run_monitor.h"
#include "engine/scene/trained_avatar.h"

#include "tests/unit/ui/look_support.h"

#include <nlohmann/json.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

namespace ars::ui {
namespace {

namespace fs = std::filesystem;

class TrainingPanelTest : public test::PanelTest {
protected:
    void SetUp() override {
        useRestAvatars();
        open("training", "Training");
        run_ = folder_ / "casual-tiny";
    }
    void TearDown() override {
        release();
        if (!studio_.window().settings().folders["training run"].empty()) click("**/Leave run");
        setTrainingProgram({});
        setTrainedAvatarOpener({});
    }

    /// A run that is followed also opens: a rest: avatar stands for what its checkpoint holds.
    static void useRestAvatars() {
        setTrainedAvatarOpener([](const fs::path& folder, bool) -> Result<OpenedTrainedAvatar> {
            RestAvatarOptions options;
            options.maxSurfels = 1500;
            OpenedTrainedAvatar avatar;
            ARS_TRY(avatar.evaluator, restAvatarFromFile("open", options));
            avatar.light = CubeMap(16);
            std::fill(avatar.light->texels.begin(), avatar.light->texels.end(), 0.5f);
            avatar.origin = folder.filename().string();
            return avatar;
        });
    }

    void write(const fs::path& path, const std::string& text) {
        fs::create_directories(path.parent_path());
        ASSERT_TRUE(writeFileAtomic(path, text).ok()) << path;
    }
    void tell(RunState state, std::int64_t step) {
        RunStatus status;
        status.state = state;
        status.stage = "radiance";
        status.step = step;
        status.totalSteps = 100;
        status.stepMs = 250;
        status.etaS = 4000;
        status.memoryBytes = status.peakMemoryBytes = 1u << 30;
        status.losses = {{"total", 0.25}, {"l1", 0.2}};
        status.updatedUnixS = ++time_;
        write(run_ / kRunStatusFile, runStatusToJson(status).dump());
    }
    /// Holds the run's lock as a process that trains does.
    void own() {
        lock_ = ::open((run_ / kRunLockFile).c_str(), O_RDWR | O_CREAT, 0666);
        struct flock lock{};
        lock.l_type = F_WRLCK;
        lock.l_whence = SEEK_SET;
        ASSERT_EQ(::fcntl(lock_, F_OFD_SETLK, &lock), 0);
    }
    void release() {
        if (lock_ >= 0) ::close(lock_);
        lock_ = -1;
    }
    void makeRun(RunState state) {
        write(run_ / kRunConfigFile, R"({"sources": {"capture": "/data/casual"}, "training": {"preset": "tiny"}})");
        for (int step = 1; step <= 30; ++step) {
            const MetricsRow row{step, "radiance", {{"loss.total", 1.0 / step}, {"loss.l1", 0.5 / step}}};
            std::ofstream(run_ / kRunMetricsFile, std::ios::app) << metricsRowToJson(row).dump() << "\n";
        }
        write(run_ / kRunCheckpointFolder / "00000030" / "complete.json", R"({"step": 30})");
        write(run_ / kRunCheckpointFolder / "00000030" / "avatar.json", "{}");
        Image picture;
        picture.width = 40;
        picture.height = 20;
        picture.channels = 3;
        picture.space = ColorSpace::Srgb;
        picture.pixels.assign(3 * 40 * 20, 0.5f);
        fs::create_directories(run_ / kRunPreviewFolder);
        ASSERT_TRUE(writePng(run_ / kRunPreviewFolder / "00000030.png", picture).ok());
        tell(state, 30);
    }
    bool shows(const std::string& item) {
        bool there = false;
        act([&](ImGuiTestContext* context) { there = context->ItemExists(item.c_str()); });
        return there;
    }
    /// A widget that can be clicked, at last.
    bool becomesUsable(const std::string& item) {
        for (int i = 0; i < 40; ++i) {
            bool usable = false;
            act([&](ImGuiTestContext* context) {
                const ImGuiTestItemInfo info = context->ItemInfo(item.c_str(), ImGuiTestOpFlags_NoError);
                usable = info.ID != 0 && (info.ItemFlags & ImGuiItemFlags_Disabled) == 0;
            });
            if (usable) return true;
            studio_.waitFor([] { return false; }, 0.1);
        }
        return false;
    }
    void follow() {
        session().openAs(run_, FileRole::Run);
        ASSERT_TRUE(studio_.waitFor([&] { return document().avatar.source == run_.string(); }));
        ASSERT_TRUE(becomesUsable("**/Leave run"));
    }
    std::string requested() {
        std::string word;
        studio_.waitFor(
            [&] {
                std::ifstream file(run_ / kRunControlFile);
                const auto json = nlohmann::json::parse(file, nullptr, false);
                if (json.is_object()) word = json.value("request", "");
                return !word.empty();
            },
            10.0);
        fs::remove(run_ / kRunControlFile);
        return word;
    }
    /// What the script that stands for the program was called with, line by line.
    std::vector<std::string> called() {
        std::vector<std::string> words;
        studio_.waitFor([&] { return fs::exists(folder_ / "called"); }, 20.0);
        std::ifstream file(folder_ / "called");
        for (std::string line; std::getline(file, line);) words.push_back(line);
        return words;
    }
    void useScript(const std::string& end) {
        const fs::path script = folder_ / "ars.sh";
        std::ofstream(script) << "#!/bin/sh\nfor word in \"$@\"; do echo \"$word\"; done > '"
                              << (folder_ / "part").string() << "'\nmv '" << (folder_ / "part").string() << "' '"
                              << (folder_ / "called").string() << "'\n"
                              << end << "\n";
        fs::permissions(script, fs::perms::owner_all);
        setTrainingProgram(script);
    }

    ars::test::TemporaryFolder folder_;
    fs::path run_;
    int lock_ = -1;
    double time_ = 1000.0;
};

TEST_F(TrainingPanelTest, ARunThatIsOpenedIsFollowedAndRemembered) {
    makeRun(RunState::Finished);
    follow();
    EXPECT_EQ(studio_.window().settings().folders["training run"], run_.string());
    EXPECT_TRUE(becomesUsable("**/Open avatar"));
    EXPECT_TRUE(becomesUsable("**/Resume"));
    EXPECT_TRUE(shows("**/Terms"));
    click("**/Terms");
    click("**/Log");
    click("**/Leave run");
    EXPECT_EQ(studio_.window().settings().folders.count("training run"), 0u);
    EXPECT_TRUE(shows("**/Start"));
}

TEST_F(TrainingPanelTest, ButtonsOfALiveRunWriteItsControlFile) {
    makeRun(RunState::Running);
    own();
    follow();
    ASSERT_TRUE(becomesUsable("**/Pause"));
    click("**/Pause");
    EXPECT_EQ(requested(), "pause");
    click("**/Save");
    EXPECT_EQ(requested(), "save");
    tell(RunState::Paused, 31);
    ASSERT_TRUE(becomesUsable("**/Resume"));
    EXPECT_FALSE(shows("**/Pause"));
    click("**/Resume");
    EXPECT_EQ(requested(), "resume");
    tell(RunState::Running, 32);
    ASSERT_TRUE(becomesUsable("**/Pause"));
    click("**/Stop");
    EXPECT_EQ(requested(), "stop");
}

TEST_F(TrainingPanelTest, DiscardAsksFirst) {
    makeRun(RunState::Running);
    own();
    follow();
    ASSERT_TRUE(becomesUsable("**/Discard"));
    click("**/Discard");
    click("**/Keep it");
    EXPECT_FALSE(fs::exists(run_ / kRunControlFile));
    click("**/Discard");
    click("**/Delete run");
    EXPECT_EQ(requested(), "discard");
}

TEST_F(TrainingPanelTest, ARunThatWasDiscardedHereIsFollowedNoLonger) {
    const auto& folders = studio_.window().settings().folders;
    const auto remembered = [&] { return folders.contains("training run"); };
    makeRun(RunState::Running);
    own();
    follow();
    // Removed by somebody else: it may come back (a disk), and the panel says what is wrong.
    fs::rename(run_, folder_ / "away");
    studio_.waitFor([] { return false; }, 2.0);
    EXPECT_TRUE(remembered());
    fs::rename(folder_ / "away", run_);

    ASSERT_TRUE(becomesUsable("**/Discard"));
    click("**/Discard");
    click("**/Delete run");
    EXPECT_EQ(requested(), "discard");
    EXPECT_TRUE(remembered()) << "it is there yet";
    release();
    fs::remove_all(run_);
    EXPECT_TRUE(studio_.waitFor([&] { return !remembered(); }));
    EXPECT_TRUE(shows("**/Start"));
    EXPECT_FALSE(shows("**/Leave run"));
}

TEST_F(TrainingPanelTest, WhileATrainingOfThisWindowLivesAnotherRunGoesOnToo) {
    const std::string here = folder_.path().string();
    useScript("while [ -d '" + here + "' ] && [ ! -e '" + here + "/go' ]; do sleep 0.05; done");
    const fs::path capture = folder_ / "casual", first = folder_ / "first";
    fs::create_directories(capture);
    act([&](ImGuiTestContext* context) {
        context->ItemInputValue("**/Capture", capture.c_str());
        context->ItemInputValue("**/Run", first.c_str());
    });
    ASSERT_TRUE(becomesUsable("**/Start"));
    click("**/Start");
    EXPECT_EQ(called().at(2), first.string());
    ASSERT_TRUE(studio_.waitFor([&] { return studio_.window().settings().folders["training run"] == first.string(); }));
    fs::remove(folder_ / "called");

    makeRun(RunState::Running); // a second one, whose process is gone
    follow();
    ASSERT_TRUE(becomesUsable("**/Resume"));
    click("**/Resume");
    EXPECT_EQ(called(), (std::vector<std::string>{"train", "--run", run_.string(), "--resume"}));
    EXPECT_FALSE(becomesUsable("**/Resume")) << "its own process lives now";
    std::ofstream(folder_ / "go") << "\n";
    EXPECT_TRUE(becomesUsable("**/Resume")) << "it has ended";
}

TEST_F(TrainingPanelTest, ARunWhoseProcessIsGoneGoesOnInANewOne) {
    makeRun(RunState::Running); // and nobody holds its lock
    useScript("exit 0");
    follow();
    ASSERT_TRUE(becomesUsable("**/Resume"));
    click("**/Resume");
    EXPECT_EQ(called(), (std::vector<std::string>{"train", "--run", run_.string(), "--resume"}));
}

TEST_F(TrainingPanelTest, ANewRunIsStartedWithWhatWasTypedAndFollowed) {
    useScript("exit 0");
    const fs::path capture = folder_ / "casual";
    fs::create_directories(capture);
    act([&](ImGuiTestContext* context) {
        context->ItemInputValue("**/Capture", capture.c_str());
        context->ItemInputValue("**/Run", run_.c_str());
    });
    click("**/tiny");
    act([&](ImGuiTestContext* context) { context->ItemInputValue("**/Settings", "schedule.pbr_steps=7"); });
    ASSERT_TRUE(becomesUsable("**/Start"));
    click("**/Start");
    EXPECT_EQ(called(), (std::vector<std::string>{"train", "--run", run_.string(), "--capture", capture.string(),
                                                  "--preset", "tiny", "--set", "schedule.pbr_steps=7"}));
    EXPECT_TRUE(studio_.waitFor([&] { return studio_.window().settings().folders["training run"] == run_.string(); }));
}

TEST_F(TrainingPanelTest, TheNewestCheckpointOpensAsTheAvatar) {
    makeRun(RunState::Finished);
    follow(); // opens it as well
    ASSERT_TRUE(session().run("avatar.open", {{"source", "rest:open"}}).ok());
    ASSERT_TRUE(becomesUsable("**/Open avatar"));
    click("**/Open avatar");
    EXPECT_TRUE(studio_.waitFor([&] { return document().avatar.source == run_.string(); }));
}

} // namespace
} // namespace ars::ui
