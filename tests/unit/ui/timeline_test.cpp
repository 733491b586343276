#include "engine/scene/evaluate.h"
#include "tests/unit/ui/look_support.h"
#include "ui/timeline/time_scale.h"
#include "ui/timeline/track_rows.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

namespace ars::ui {
namespace {

std::vector<std::string> smplxNames() {
    std::vector<std::string> names;
    for (int joint = 0; joint < kSmplxJointCount; ++joint) names.emplace_back(smplxJointName(joint));
    return names;
}

TimelineSection someKeys() {
    TimelineSection timeline;
    const auto turn = [](double time, KeyInterpolation kind = KeyInterpolation::Smooth) {
        return Key<glm::quat>{time, glm::quat(1, 0, 0, 0), kind};
    };
    timeline.joints.push_back({smplxJointIndex("left_elbow"), JointLayer::Absolute, {turn(0.0), turn(1.0)}});
    timeline.joints.push_back({smplxJointIndex("left_wrist"), JointLayer::OnClip, {turn(1.0), turn(2.0)}});
    timeline.root.push_back({3.0, glm::vec3(0.0f), KeyInterpolation::Linear});
    timeline.lightRotationDeg = {{0.5, 10.0f, KeyInterpolation::Step}, {1.5, 50.0f, KeyInterpolation::Linear}};
    timeline.radii[static_cast<std::size_t>(BodyPart::Hand)] = {{4.0, 0.1f, KeyInterpolation::Smooth}};
    return timeline;
}

const TrackRow* find(const std::vector<TrackRow>& rows, const std::string& track) {
    for (const TrackRow& row : rows) {
        if (row.track == track) return &row;
    }
    return nullptr;
}

TEST(TimeScale, ZoomKeepsTheMomentUnderTheMouse) {
    TimeScale scale;
    scale.left = 150.0f;
    scale.width = 800.0f;
    scale.fit(0.0, 4.0);
    EXPECT_GT(scale.x(0.0), 150.0f);
    EXPECT_LT(scale.x(4.0), 950.0f);
    const double before = scale.time(400.0f);
    scale.zoom(7.0, 400.0f);
    EXPECT_NEAR(scale.time(400.0f), before, 1e-9);
    EXPECT_NEAR(scale.time(scale.x(1.25)), 1.25, 1e-4);
    for (int i = 0; i < 300; ++i) scale.zoom(1.5, 400.0f);
    EXPECT_TRUE(std::isfinite(scale.lastS()));
    EXPECT_GT(scale.lastS(), scale.firstS);
    for (int i = 0; i < 600; ++i) scale.zoom(1.0 / 1.5, 400.0f);
    EXPECT_LE(scale.lastS() - scale.firstS, 36001.0);
}

TEST(RulerTicks, StandOnWholeFramesWithRoomForTheirLabels) {
    for (const double fps : {24.0, 25.0, 29.97, 30.0, 60.0, 120.0}) {
        for (const double length : {0.2, 1.0, 4.0, 37.0, 600.0, 7200.0}) {
            TimeScale scale;
            scale.width = 700.0f;
            scale.fit(0.0, length);
            const std::vector<RulerTick> ticks = rulerTicks(scale, fps, 60.0f);
            float last = -1e9f;
            int labels = 0;
            for (const RulerTick& tick : ticks) {
                EXPECT_NEAR(tick.timeS * fps, static_cast<double>(tick.frame), 1e-6);
                if (!tick.labelled) continue;
                ++labels;
                EXPECT_GE(scale.x(tick.timeS) - last, 60.0f - 0.01f) << fps << " fps, " << length << " s";
                last = scale.x(tick.timeS);
            }
            EXPECT_GE(labels, 1) << fps << " fps, " << length << " s";
            EXPECT_LE(ticks.size(), 1000u);
        }
    }
}

TEST(RulerTicks, NothingForARateThatIsNone) { EXPECT_TRUE(rulerTicks(TimeScale{}, 0.0, 60.0f).empty()); }

TEST(Frames, TimesSnapToTheNearestOne) {
    EXPECT_DOUBLE_EQ(snapToFrame(1.01, 30.0), 1.0);
    EXPECT_DOUBLE_EQ(snapToFrame(1.02, 30.0), 31.0 / 30.0);
    EXPECT_EQ(frameAt(2.0, 24.0), 48);
    EXPECT_DOUBLE_EQ(snapToFrame(1.234, 0.0), 1.234);
}

TEST(TrackRows, FoldedRowsShowEveryTimeOfTheirTracksOnce) {
    const auto rows = trackRows(someKeys(), smplxNames(), {});
    const TrackRow* pose = find(rows, "pose");
    ASSERT_NE(pose, nullptr);
    std::vector<double> times;
    for (const KeyMark& key : pose->keys) times.push_back(key.timeS);
    EXPECT_EQ(times, (std::vector<double>{0.0, 1.0, 2.0, 3.0}));
    EXPECT_EQ(find(rows, "joint:left_elbow"), nullptr);
    const TrackRow* radii = find(rows, "radii");
    ASSERT_NE(radii, nullptr);
    EXPECT_EQ(radii->keys.size(), 1u);
    for (const char* track : {"expression", "camera", "light_rotation", "light_exposure"}) {
        EXPECT_NE(find(rows, track), nullptr) << track;
    }
}

TEST(TrackRows, UnfoldedRowsShowRootAndKeyedJoints) {
    const auto rows = trackRows(someKeys(), smplxNames(), {"pose", "radii", "light_rotation"});
    const TrackRow* wrist = find(rows, "joint:left_wrist");
    ASSERT_NE(wrist, nullptr);
    EXPECT_EQ(wrist->label, "Left wrist");
    EXPECT_TRUE(wrist->onClip);
    EXPECT_FALSE(find(rows, "joint:left_elbow")->onClip);
    EXPECT_EQ(find(rows, "joint:right_wrist"), nullptr);
    EXPECT_EQ(find(rows, "root")->keys.size(), 1u);
    EXPECT_EQ(find(rows, "radius:hand")->keys.size(), 1u);
    EXPECT_NE(find(rows, "radius:torso"), nullptr);
    EXPECT_TRUE(find(rows, "light_rotation")->curve);
    EXPECT_EQ(find(rows, "light_rotation")->keys[0].interpolation, KeyInterpolation::Step);
}

TEST(TrackRows, AKeyOfAFoldedRowStandsForTheKeysBehindIt) {
    const TimelineSection timeline = someKeys();
    const auto rows = trackRows(timeline, smplxNames(), {});
    const std::vector<KeyRef> both = keysBehind(timeline, smplxNames(), *find(rows, "pose"), 1.0);
    EXPECT_EQ(both, (std::vector<KeyRef>{{"joint:left_elbow", 1.0}, {"joint:left_wrist", 1.0}}));
    const std::vector<KeyRef> root = keysBehind(timeline, smplxNames(), *find(rows, "pose"), 3.0);
    EXPECT_EQ(root, (std::vector<KeyRef>{{"root", 3.0}}));
    EXPECT_EQ(keysBehind(timeline, smplxNames(), *find(rows, "camera"), 1.0), (std::vector<KeyRef>{{"camera", 1.0}}));
}

TEST(KeyTimes, AreThoseOfAllTracksInOrder) {
    const std::vector<double> times = allKeyTimes(someKeys());
    EXPECT_EQ(times, (std::vector<double>{0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0}));
    double found = -1.0;
    EXPECT_TRUE(previousKeyTime(times, 1.0, found));
    EXPECT_EQ(found, 0.5);
    EXPECT_TRUE(nextKeyTime(times, 1.0, found));
    EXPECT_EQ(found, 1.5);
    EXPECT_FALSE(previousKeyTime(times, 0.0, found));
    EXPECT_FALSE(nextKeyTime(times, 4.0, found));
}

TEST(TrackRows, UnknownTracksHaveNoKeys) {
    EXPECT_TRUE(trackKeys(someKeys(), smplxNames(), "joint:tail").empty());
    EXPECT_TRUE(trackKeys(someKeys(), smplxNames(), "radius:tail").empty());
    EXPECT_EQ(scalarTrack(someKeys(), "camera"), nullptr);
}

// ---- the panel, driven through its widgets

class TimelinePanelTest : public test::PanelTest {
protected:
    void SetUp() override {
        open("timeline", "Timeline");
        act([](ImGuiTestContext* context) { context->ItemClick("Fit"); });
    }
    const TimelineSection& timeline() { return document().timeline; }
    void run(const char* command, const Arguments& arguments) {
        const Status status = session().run(command, arguments);
        ASSERT_TRUE(status.ok()) << status.error().describe();
    }
    void keyLight(double time, float degrees) {
        run("timeline.seek", {{"time", time}});
        run("light.rotate", {{"degrees", degrees}});
        run("timeline.key", {{"track", "light_rotation"}});
    }
    /// In the list of tracks.
    void actOnTracks(const std::function<void(ImGuiTestContext*)>& person) {
        studio_.window().step();
        act([&](ImGuiTestContext* context) {
            context->SetRef(context->WindowInfo("//Timeline/tracks").ID);
            person(context);
        });
    }
    std::vector<double> lightTimes() {
        std::vector<double> times;
        for (const auto& key : timeline().lightRotationDeg) times.push_back(key.timeS);
        return times;
    }
    /// Pixels of a second, from two named keys of the light's rotation.
    static float pixelsPerSecond(ImGuiTestContext* context, double seconds) {
        const float first = context->ItemInfo("light_rotation 0").RectFull.GetCenter().x;
        const float second = context->ItemInfo("light_rotation 1").RectFull.GetCenter().x;
        return (second - first) / static_cast<float>(seconds);
    }
    static void press(ImGuiTestContext* context, const char* key, ImGuiMouseButton button = 0) {
        context->MouseMoveToPos(context->ItemInfo(key).RectFull.GetCenter());
        context->MouseClick(button);
    }
    static void drag(ImGuiTestContext* context, const char* key, float pixels) {
        const ImVec2 from = context->ItemInfo(key).RectFull.GetCenter();
        context->MouseMoveToPos(from);
        context->MouseDown();
        for (int i = 1; i <= 8; ++i) {
            context->MouseMoveToPos(ImVec2(from.x + pixels * static_cast<float>(i) / 8.0f, from.y));
        }
        context->MouseUp();
        context->Yield(2);
    }
};

void expectTimes(const std::vector<double>& found, const std::vector<double>& expected) {
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-3) << i;
}

TEST_F(TimelinePanelTest, TheDiamondOfARowSetsAKeyAndTakesItAway) {
    run("timeline.seek", {{"time", 1.0}});
    actOnTracks([](ImGuiTestContext* context) { context->ItemClick("camera/Key"); });
    ASSERT_EQ(timeline().camera.size(), 1u);
    EXPECT_DOUBLE_EQ(timeline().camera[0].timeS, 1.0);
    actOnTracks([](ImGuiTestContext* context) { context->ItemClick("camera/Key"); });
    EXPECT_TRUE(timeline().camera.empty());
}

TEST_F(TimelinePanelTest, ADraggedKeySnapsToFramesAndIsOneUndo) {
    keyLight(0.0, 0.0f);
    keyLight(2.0, 90.0f);
    const std::size_t before = entries();
    actOnTracks(
        [](ImGuiTestContext* context) { drag(context, "light_rotation 1", 1.003f * pixelsPerSecond(context, 2.0)); });
    expectTimes(lightTimes(), {0.0, 3.0});
    EXPECT_NEAR(timeline().lightRotationDeg[1].value, 90.0f, 1e-4f);
    EXPECT_EQ(entries(), before + 1);
    session().undo();
    expectTimes(lightTimes(), {0.0, 2.0});
}

TEST_F(TimelinePanelTest, KeysThatADragPassesOverSurvive) {
    keyLight(0.0, 0.0f);
    keyLight(1.0, 10.0f);
    keyLight(2.0, 20.0f);
    actOnTracks([](ImGuiTestContext* context) {
        const float second = pixelsPerSecond(context, 1.0);
        const ImVec2 from = context->ItemInfo("light_rotation 0").RectFull.GetCenter();
        context->MouseMoveToPos(from);
        context->MouseDown();
        context->MouseMoveToPos(ImVec2(from.x + second, from.y)); // onto the second one
        context->Yield(2);
        context->MouseMoveToPos(ImVec2(from.x + 1.5f * second, from.y));
        context->Yield(2);
        context->MouseUp();
    });
    expectTimes(lightTimes(), {1.0, 1.5, 2.0});
    EXPECT_NEAR(timeline().lightRotationDeg[0].value, 10.0f, 1e-4f);
    EXPECT_NEAR(timeline().lightRotationDeg[1].value, 0.0f, 1e-4f);
}

TEST_F(TimelinePanelTest, AltDraggingCopies) {
    keyLight(0.0, 0.0f);
    keyLight(2.0, 90.0f);
    actOnTracks([](ImGuiTestContext* context) {
        const float second = pixelsPerSecond(context, 2.0);
        context->KeyDown(ImGuiMod_Alt);
        drag(context, "light_rotation 1", second);
        context->KeyUp(ImGuiMod_Alt);
    });
    expectTimes(lightTimes(), {0.0, 2.0, 3.0});
    EXPECT_NEAR(timeline().lightRotationDeg[2].value, 90.0f, 1e-4f);
}

TEST_F(TimelinePanelTest, ChosenKeysAreDeleted) {
    keyLight(0.0, 0.0f);
    keyLight(2.0, 90.0f);
    actOnTracks([](ImGuiTestContext* context) {
        press(context, "light_rotation 0");
        context->KeyPress(ImGuiKey_Delete);
    });
    expectTimes(lightTimes(), {2.0});
}

TEST_F(TimelinePanelTest, ABoxChoosesTheKeysOfSeveralRows) {
    keyLight(1.0, 0.0f);
    keyLight(2.0, 0.0f);
    run("timeline.key", {{"track", "camera"}});
    keyLight(3.0, 0.0f);
    const std::size_t before = entries();
    actOnTracks([](ImGuiTestContext* context) {
        const float second = pixelsPerSecond(context, 1.0);
        const ImVec2 camera = context->ItemInfo("camera 0").RectFull.GetCenter();
        const ImVec2 light = context->ItemInfo("light_rotation 1").RectFull.GetCenter();
        context->MouseMoveToPos(ImVec2(camera.x - 0.5f * second, camera.y - 6.0f));
        context->MouseDown();
        context->MouseMoveToPos(ImVec2(light.x + 0.5f * second, light.y + 6.0f));
        context->MouseUp();
        context->Yield(2);
        context->KeyPress(ImGuiKey_Delete);
    });
    expectTimes(lightTimes(), {1.0, 3.0});
    EXPECT_TRUE(timeline().camera.empty());
    EXPECT_EQ(entries(), before + 1);
}

TEST_F(TimelinePanelTest, InterpolationIsChosenByARightClick) {
    keyLight(0.0, 0.0f);
    keyLight(2.0, 90.0f);
    actOnTracks([](ImGuiTestContext* context) {
        press(context, "light_rotation 0", ImGuiMouseButton_Right);
        context->ItemClick("//$FOCUSED/Step");
    });
    EXPECT_EQ(timeline().lightRotationDeg[0].interpolation, KeyInterpolation::Step);
    EXPECT_EQ(timeline().lightRotationDeg[1].interpolation, KeyInterpolation::Smooth);
}

TEST_F(TimelinePanelTest, TheSummaryMovesTheKeysOfAllJoints) {
    run("pose.rotate_joint", {{"joint", "left_elbow"}, {"x", 0}, {"y", -30}, {"z", 0}});
    run("timeline.seek", {{"time", 1.0}});
    run("timeline.key", {{"track", "pose"}});
    keyLight(0.0, 0.0f);
    keyLight(1.0, 0.0f);
    ASSERT_FALSE(timeline().joints.empty());
    actOnTracks([](ImGuiTestContext* context) { drag(context, "pose 0", pixelsPerSecond(context, 1.0)); });
    for (const JointTrack& track : timeline().joints) {
        ASSERT_EQ(track.keys.size(), 1u);
        EXPECT_NEAR(track.keys[0].timeS, 2.0, 1e-3);
    }
    ASSERT_EQ(timeline().root.size(), 1u);
    EXPECT_NEAR(timeline().root[0].timeS, 2.0, 1e-3);
}

TEST_F(TimelinePanelTest, TheRulerGoesThroughTimeFrameByFrame) {
    keyLight(0.0, 0.0f);
    keyLight(2.0, 90.0f);
    float second = 0.0f;
    float zero = 0.0f;
    actOnTracks([&](ImGuiTestContext* context) {
        second = pixelsPerSecond(context, 2.0);
        zero = context->ItemInfo("light_rotation 0").RectFull.GetCenter().x;
    });
    act([&](ImGuiTestContext* context) {
        const ImRect ruler = context->ItemInfo("Ruler").RectFull;
        const float y = ruler.Max.y - 4.0f;
        context->MouseMoveToPos(ImVec2(zero + 0.3f * second, y));
        context->MouseDown();
        context->MouseMoveToPos(ImVec2(zero + 1.51f * second, y));
        context->Yield(2);
        context->MouseUp();
    });
    EXPECT_NEAR(timeline().timeS, 45.0 / 30.0, 1e-6);
    EXPECT_NEAR(timeline().timeS * 30.0, std::round(timeline().timeS * 30.0), 1e-6);
}

TEST_F(TimelinePanelTest, ButtonsPlayLoopAndRecord) {
    click("Play");
    EXPECT_TRUE(session().transport().playing);
    click("Pause");
    EXPECT_FALSE(session().transport().playing);
    const bool loop = timeline().loop;
    click("Loop");
    EXPECT_NE(timeline().loop, loop);
    click("Auto key");
    EXPECT_TRUE(timeline().autoKey);
}

TEST_F(TimelinePanelTest, KeysAreReachedOneAfterTheOther) {
    keyLight(0.5, 0.0f);
    keyLight(2.0, 90.0f);
    run("timeline.seek", {{"time", 0.0}});
    click("Next key");
    EXPECT_NEAR(timeline().timeS, 0.5, 1e-6);
    click("Next key");
    EXPECT_NEAR(timeline().timeS, 2.0, 1e-6);
    click("Previous key");
    EXPECT_NEAR(timeline().timeS, 0.5, 1e-6);
}

TEST_F(TimelinePanelTest, OnlyKeysThatAreSeenAreDrawn) {
    for (int i = 0; i < 400; ++i) {
        run("timeline.seek", {{"time", i}});
        run("timeline.key", {{"track", "light_exposure"}});
    }
    run("timeline.range", {{"start", 0}, {"end", 4}});
    actOnTracks([](ImGuiTestContext* context) {
        EXPECT_NE(context->ItemInfo("light_exposure 2", ImGuiTestOpFlags_NoError).ID, 0u);
        EXPECT_EQ(context->ItemInfo("light_exposure 300", ImGuiTestOpFlags_NoError).ID, 0u);
    });
}

TEST_F(TimelinePanelTest, TheClipIsMovedInTime) {
    ARS_TEST_DATA_FILE(motion, "motion/smplx/apose_to_handsFront_smplx.npz");
    session().openAs(motion, FileRole::Clip);
    ASSERT_TRUE(studio_.waitFor([&] { return !timeline().clip.empty() && session().assets().clip != nullptr; }));
    run("timeline.clip_offset", {{"time", 0.0}});
    const std::size_t before = entries();
    act([](ImGuiTestContext* context) {
        const ImVec2 from = context->ItemInfo("Clip").RectFull.GetCenter();
        context->MouseMoveToPos(from);
        context->MouseDown();
        for (int i = 1; i <= 5; ++i) context->MouseMoveToPos(ImVec2(from.x + 20.0f * static_cast<float>(i), from.y));
        context->MouseUp();
    });
    EXPECT_GT(timeline().clipOffsetS, 0.0);
    const double frames = timeline().clipOffsetS * timeline().framesPerSecond;
    EXPECT_NEAR(frames, std::round(frames), 1e-6);
    EXPECT_EQ(entries(), before + 1);
}

} // namespace
} // namespace ars::ui
