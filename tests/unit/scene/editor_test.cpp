#include "engine/scene/editor.h"
#include "engine/scene/project.h"
#include "tests/unit/scene/changed_document.h"

#include <gtest/gtest.h>

#include <random>

namespace ars {
namespace {

/// An editor with nothing loaded beside it.
struct Desk {
    SceneAssets assets;
    Clipboard clipboard;
    Editor editor;

    Status run(std::string_view id, const Arguments& arguments = Arguments::object(), std::string_view gesture = {}) {
        CommandContext context{assets, clipboard, editor.document().timeline.timeS};
        return editor.run(id, arguments, context, gesture);
    }
    void ok(std::string_view id, const Arguments& arguments = Arguments::object(), std::string_view gesture = {}) {
        const Status status = run(id, arguments, gesture);
        EXPECT_TRUE(status.ok()) << status.error().describe();
    }
    void exposure(double ev, std::string_view gesture = {}) { ok("view.exposure", {{"ev", ev}}, gesture); }
    void orbit(double yaw, std::string_view gesture = {}) {
        ok("camera.orbit", {{"yaw", yaw}, {"pitch", 0.0}}, gesture);
    }
    float shownExposure() const { return editor.document().view.tone.exposureEv; }
    std::size_t entries() const { return editor.history().size(); }
};

TEST(Editor, UndoAndRedoReturnToTheIdenticalDocument) {
    Desk desk;
    std::vector<Document> states{desk.editor.document()};
    const auto step = [&](std::string_view id, const Arguments& arguments = Arguments::object()) {
        desk.ok(id, arguments);
        states.push_back(desk.editor.document());
    };
    step("view.exposure", {{"ev", 1.5}});
    step("light.exposure", {{"ev", -0.7}});
    step("light.add_lamp");
    step("compare.hold");
    step("camera.orbit", {{"yaw", 20.0}, {"pitch", 5.0}});
    step("view.grid", {{"enabled", false}});
    step("occlusion.radius", {{"part", "knee"}, {"metres", 0.1}});
    step("pose.limits", {{"enabled", false}});
    step("timeline.seek", {{"time", 1.5}});
    ASSERT_EQ(desk.entries(), states.size() - 1);
    for (int round = 0; round < 2; ++round) {
        for (std::size_t i = states.size() - 1; i > 0; --i) {
            ASSERT_TRUE(desk.editor.document() == states[i]);
            ASSERT_EQ(documentToJson(desk.editor.document()), documentToJson(states[i])) << "to the last bit";
            ASSERT_TRUE(desk.editor.undo());
        }
        EXPECT_FALSE(desk.editor.undo());
        EXPECT_FALSE(desk.editor.canUndo());
        EXPECT_TRUE(desk.editor.document() == states[0]);
        for (std::size_t i = 1; i < states.size(); ++i) {
            ASSERT_TRUE(desk.editor.redo());
            ASSERT_TRUE(desk.editor.document() == states[i]);
        }
        EXPECT_FALSE(desk.editor.redo());
    }
}

TEST(Editor, EveryChangeHasAVersionOfItsOwn) {
    Desk desk;
    std::vector<std::uint64_t> versions{desk.editor.version()};
    const auto changed = [&] {
        versions.push_back(desk.editor.version());
        return versions.back() != versions[versions.size() - 2];
    };
    desk.exposure(1);
    EXPECT_TRUE(changed());
    desk.exposure(1);
    EXPECT_FALSE(changed()) << "nothing changed";
    desk.editor.undo();
    EXPECT_TRUE(changed());
    desk.editor.redo();
    EXPECT_TRUE(changed());
    desk.editor.replace(newDocument());
    EXPECT_TRUE(changed());
}

TEST(Editor, ErrorsChangeNothingAndSayWhat) {
    Desk desk;
    desk.exposure(1);
    const Document before = desk.editor.document();
    const std::uint64_t version = desk.editor.version();
    const auto said = [&](std::string_view id, const Arguments& arguments) {
        const Status status = desk.run(id, arguments);
        return status ? std::string("done") : status.error().describe();
    };
    EXPECT_EQ(said("view.grids", {{"enabled", true}}).substr(0, 11), "view.grids:");
    EXPECT_NE(said("view.exposure", {{"ev", 1000}}).find("view.exposure: ev"), std::string::npos);
    EXPECT_NE(said("view.exposure", {{"ev", "bright"}}).find("view.exposure: ev"), std::string::npos);
    EXPECT_NE(said("view.exposure", {{"stops", 1}}).find("view.exposure: stops"), std::string::npos);
    EXPECT_NE(said("light.remove_lamp", {{"index", 50}}), "done");
    EXPECT_TRUE(desk.editor.document() == before);
    EXPECT_EQ(desk.editor.version(), version);
    EXPECT_EQ(desk.entries(), 1u);
}

TEST(Editor, ACommandThatChangesNothingLeavesNoEntry) {
    Desk desk;
    desk.ok("view.grid", {{"enabled", true}});
    EXPECT_EQ(desk.entries(), 0u);
    desk.exposure(2);
    desk.editor.undo();
    desk.ok("view.grid", {{"enabled", true}});
    EXPECT_TRUE(desk.editor.canRedo()) << "what could be redone still can";
}

TEST(Editor, ANewEditDropsWhatCouldBeRedone) {
    Desk desk;
    desk.exposure(1);
    desk.exposure(2);
    desk.editor.undo();
    desk.exposure(3);
    EXPECT_FALSE(desk.editor.canRedo());
    EXPECT_EQ(desk.entries(), 2u);
    desk.editor.undo();
    EXPECT_EQ(desk.shownExposure(), 1.0f);
}

TEST(Editor, ADragIsOneEntry) {
    Desk desk;
    for (int i = 1; i <= 100; ++i) desk.exposure(0.1 * i, "exposure");
    EXPECT_EQ(desk.entries(), 1u);
    desk.editor.undo();
    EXPECT_EQ(desk.shownExposure(), 0.0f);
    desk.editor.redo();
    EXPECT_FLOAT_EQ(desk.shownExposure(), 10.0f);
}

TEST(Editor, GesturesEndWhenTheyAreEndedOrAnotherCallComes) {
    Desk desk;
    desk.exposure(1, "drag");
    desk.editor.endGesture();
    desk.exposure(2, "drag");
    EXPECT_EQ(desk.entries(), 2u) << "ended";
    desk.exposure(3, "other");
    EXPECT_EQ(desk.entries(), 3u) << "another gesture";
    desk.exposure(4);
    desk.exposure(5);
    EXPECT_EQ(desk.entries(), 5u) << "no gesture";
    desk.exposure(6, "drag");
    desk.editor.undo();
    desk.editor.redo();
    desk.exposure(7, "drag");
    EXPECT_EQ(desk.entries(), 7u) << "undo lies between";
}

TEST(Editor, ADragAcrossSectionsKeepsTheFirstBeforeAndTheLastAfter) {
    Desk desk;
    const Document before = desk.editor.document();
    desk.exposure(1, "drag");
    desk.ok("light.exposure", {{"ev", 1}}, "drag");
    desk.exposure(2, "drag");
    desk.ok("light.exposure", {{"ev", 2}}, "drag");
    const Document after = desk.editor.document();
    EXPECT_EQ(desk.entries(), 1u);
    desk.editor.undo();
    EXPECT_TRUE(desk.editor.document() == before);
    desk.editor.redo();
    EXPECT_TRUE(desk.editor.document() == after);
}

TEST(Editor, ADragThatComesBackLeavesNothing) {
    Desk desk;
    desk.exposure(1);
    desk.exposure(2);
    desk.editor.undo();
    desk.exposure(5, "drag");
    EXPECT_FALSE(desk.editor.canRedo());
    desk.exposure(1, "drag");
    desk.editor.endGesture();
    EXPECT_EQ(desk.editor.undoLabel(), desk.editor.redoLabel());
    ASSERT_TRUE(desk.editor.redo()) << "what could be redone can be again";
    EXPECT_EQ(desk.shownExposure(), 2.0f);
    EXPECT_EQ(desk.entries(), 2u);
}

TEST(Editor, CancellingADragTakesItBack) {
    Desk desk;
    EXPECT_FALSE(desk.editor.cancelGesture());
    desk.exposure(1);
    EXPECT_FALSE(desk.editor.cancelGesture()) << "no gesture runs";
    desk.exposure(2);
    desk.editor.undo();
    const Document before = desk.editor.document();
    for (int i = 3; i < 9; ++i) desk.exposure(i, "drag");
    desk.ok("light.exposure", {{"ev", 1}}, "drag");
    EXPECT_TRUE(desk.editor.cancelGesture());
    EXPECT_TRUE(desk.editor.document() == before);
    EXPECT_FALSE(desk.editor.cancelGesture());
    ASSERT_TRUE(desk.editor.redo());
    EXPECT_EQ(desk.shownExposure(), 2.0f);
    desk.exposure(3, "drag");
    desk.editor.endGesture();
    EXPECT_FALSE(desk.editor.cancelGesture()) << "it has ended";
    EXPECT_EQ(desk.shownExposure(), 3.0f);
}

TEST(Editor, MovingAboutWithTheCameraIsOneEntry) {
    Desk desk;
    desk.exposure(1);
    const Document before = desk.editor.document();
    for (int drag = 0; drag < 5; ++drag) {
        for (int i = 0; i < 4; ++i) desk.orbit(3.0, "orbit");
        desk.editor.endGesture();
    }
    desk.ok("camera.pan", {{"x", 0.1}, {"y", 0.0}});
    desk.ok("camera.dolly", {{"factor", 0.9}});
    const Document after = desk.editor.document();
    ASSERT_EQ(desk.entries(), 2u);
    EXPECT_EQ(desk.editor.undoLabel(), "Move camera");
    desk.editor.undo();
    EXPECT_TRUE(desk.editor.document() == before);
    desk.editor.redo();
    EXPECT_TRUE(desk.editor.document() == after);
    desk.exposure(2);
    desk.orbit(10.0);
    EXPECT_EQ(desk.entries(), 4u) << "an edit between divides them";
    desk.ok("camera.field", {{"degrees", 40}});
    desk.orbit(10.0);
    EXPECT_EQ(desk.entries(), 6u) << "a chosen field of view is an edit";
}

TEST(Editor, CancellingACameraDragKeepsTheMovesBefore) {
    Desk desk;
    desk.orbit(10.0, "orbit");
    desk.editor.endGesture();
    const Document before = desk.editor.document();
    desk.orbit(30.0, "orbit");
    EXPECT_TRUE(desk.editor.cancelGesture());
    EXPECT_TRUE(desk.editor.document() == before);
    EXPECT_EQ(desk.entries(), 1u);
}

TEST(Editor, CameraKeysAreNoMovingAbout) {
    Desk desk;
    desk.ok("timeline.auto_key", {{"enabled", true}});
    const std::size_t before = desk.entries();
    desk.orbit(10.0);
    desk.orbit(10.0);
    EXPECT_EQ(desk.entries(), before + 2) << "they changed the timeline";
}

TEST(Editor, HistoryTellsWhatIsDoneAndTravels) {
    Desk desk;
    std::vector<Document> states{desk.editor.document()};
    for (int i = 1; i <= 6; ++i) {
        desk.exposure(i);
        states.push_back(desk.editor.document());
    }
    for (const std::size_t count : {3u, 0u, 5u, 6u, 2u}) {
        desk.editor.travel(count);
        EXPECT_TRUE(desk.editor.document() == states[count]);
        const std::vector<Editor::HistoryLine> lines = desk.editor.history();
        ASSERT_EQ(lines.size(), 6u);
        for (std::size_t i = 0; i < lines.size(); ++i) {
            EXPECT_EQ(lines[i].done, i < count);
            EXPECT_EQ(lines[i].commandId, "view.exposure");
            EXPECT_FALSE(lines[i].label.empty());
        }
    }
    desk.editor.travel(99);
    EXPECT_TRUE(desk.editor.document() == states[6]);
}

TEST(Editor, ModifiedComparesWithWhatWasSaved) {
    Desk desk;
    EXPECT_FALSE(desk.editor.modified());
    desk.exposure(1);
    EXPECT_TRUE(desk.editor.modified());
    desk.editor.undo();
    EXPECT_FALSE(desk.editor.modified()) << "back at what was saved";
    desk.editor.redo();
    desk.editor.markSaved();
    EXPECT_FALSE(desk.editor.modified());
    desk.editor.undo();
    EXPECT_TRUE(desk.editor.modified());
    desk.exposure(1);
    EXPECT_FALSE(desk.editor.modified()) << "the same by another way";
}

TEST(Editor, ASaveThatRanBesideCountsForWhatItWrote) {
    Desk desk;
    desk.exposure(1);
    const Document written = desk.editor.document();
    const std::uint64_t version = desk.editor.version();
    desk.exposure(2);
    desk.editor.markSaved(written, version);
    EXPECT_TRUE(desk.editor.modified());
    desk.editor.undo();
    EXPECT_FALSE(desk.editor.modified());
}

TEST(Editor, ReplacingBeginsANewHistory) {
    Desk desk;
    desk.exposure(1, "drag");
    desk.editor.replace(test::changedDocument());
    EXPECT_TRUE(desk.editor.document() == test::changedDocument());
    EXPECT_FALSE(desk.editor.canUndo());
    EXPECT_FALSE(desk.editor.cancelGesture());
    EXPECT_FALSE(desk.editor.modified());
    desk.editor.replace(newDocument(), false);
    EXPECT_TRUE(desk.editor.modified()) << "a recovered document stands in no file";
    desk.editor.markSaved();
    EXPECT_FALSE(desk.editor.modified());
}

TEST(Editor, TheHistoryHasALimitAndKeepsTheNewest) {
    Desk desk;
    Document large;
    for (int i = 0; i < 20'000; ++i)
        large.timeline.root.push_back({0.01 * i, glm::vec3(0.0f), KeyInterpolation::Linear});
    desk.editor.replace(large);
    // Every entry holds the timeline twice, some 1 MB.
    desk.editor.setHistoryLimit(8u << 20);
    for (int i = 1; i <= 60; ++i) desk.ok("timeline.seek", {{"time", 0.01 * i}});
    EXPECT_LT(desk.entries(), 20u);
    EXPECT_GT(desk.entries(), 3u);
    std::size_t undone = 0;
    while (desk.editor.undo()) ++undone;
    EXPECT_EQ(undone, desk.entries());
    EXPECT_GT(desk.editor.document().timeline.timeS, 0.3) << "the oldest are gone";
    desk.editor.travel(undone);
    EXPECT_NEAR(desk.editor.document().timeline.timeS, 0.6, 1e-9);
    desk.editor.setHistoryLimit(1);
    EXPECT_EQ(desk.entries(), 1u);
    ASSERT_TRUE(desk.editor.undo());
    EXPECT_NEAR(desk.editor.document().timeline.timeS, 0.59, 1e-9);
}

// Any mixture of edits, drags, cancelled drags, undo and redo: every state that was left is found again.
TEST(Editor, RandomMixturesUndoToTheBeginning) {
    std::mt19937 random(5);
    const auto below = [&](int count) { return std::uniform_int_distribution<int>(0, count - 1)(random); };
    for (int walk = 0; walk < 20; ++walk) {
        Desk desk;
        const Document begin = desk.editor.document();
        for (int step = 0; step < 200; ++step) {
            const std::string gesture = below(2) == 0 ? "" : (below(2) == 0 ? "a" : "b");
            switch (below(8)) {
            case 0:
                desk.exposure(below(4), gesture);
                break;
            case 1:
                desk.ok("light.exposure", {{"ev", below(3)}}, gesture);
                break;
            case 2:
                desk.orbit(below(3) - 1.0, gesture);
                break;
            case 3:
                desk.ok("view.grid", {{"enabled", below(2) == 0}}, gesture);
                break;
            case 4:
                desk.editor.endGesture();
                break;
            case 5: {
                const Document before = desk.editor.document();
                const bool ran = desk.editor.cancelGesture();
                EXPECT_TRUE(ran || desk.editor.document() == before);
                break;
            }
            case 6:
                desk.editor.undo();
                break;
            default:
                desk.editor.redo();
                break;
            }
        }
        desk.editor.endGesture();
        desk.editor.travel(desk.entries());
        const Document end = desk.editor.document();
        const std::size_t count = desk.entries();
        desk.editor.travel(0);
        ASSERT_TRUE(desk.editor.document() == begin);
        desk.editor.travel(count);
        ASSERT_TRUE(desk.editor.document() == end);
    }
}

} // namespace
} // namespace ars
