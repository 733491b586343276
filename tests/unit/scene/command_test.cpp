#include "engine/scene/command.h"

#include "engine/scene/setting_groups.h"
#include "tests/unit/scene/command_fixture.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>

namespace ars::test {
namespace {

TEST(CommandRegistry, HasEveryCommandThatPanelsAndScriptsCall) {
    std::istringstream ids(R"(
        avatar.open avatar.shape avatar.reset_shape settings.set
        pose.rotate_joint pose.turn_joint pose.drag_joint pose.move_root pose.mirror pose.mirror_side pose.copy
        pose.paste pose.reset pose.apply pose.preset pose.expression pose.reset_expression pose.limits
        pose.keep_orientation pose.place_on_floor
        timeline.open_clip timeline.close_clip timeline.seek timeline.range timeline.rate timeline.speed timeline.loop
        timeline.auto_key timeline.key timeline.delete_key timeline.move_key timeline.copy_key timeline.clear_track
        timeline.interpolation timeline.clip_offset
        camera.set camera.orbit camera.pan camera.dolly camera.fly camera.look camera.roll camera.field camera.preset
        camera.focus camera.reset camera.open_capture camera.close_capture camera.dataset camera.next_dataset
        camera.previous_dataset camera.leave_dataset camera.photograph
        light.open light.kind light.uniform light.rotate light.exposure light.backdrop light.backdrop_blur
        light.studio_preset light.add_lamp light.remove_lamp light.lamp light.turntable light.reset
        occlusion.radius occlusion.lock occlusion.reset occlusion.scale occlusion.method occlusion.preset
        view.buffer view.layout view.strip view.range view.reset_range view.color_map view.exposure view.tone_curve
        view.background view.grid view.skeleton view.parts view.radius_spheres view.surfel_discs view.legend
        view.select_joint view.select_part
        compare.kind compare.buffer compare.picture compare.avatar compare.hold compare.measure compare.split)");
    std::string id;
    while (ids >> id) EXPECT_NE(findCommand(id), nullptr) << id;
    EXPECT_EQ(findCommand("pose.fly"), nullptr);
}

TEST(CommandRegistry, EveryCommandIsDescribedForPeople) {
    std::set<std::string> ids;
    for (const Command& command : commands()) {
        EXPECT_TRUE(ids.insert(command.id).second) << command.id << " stands twice";
        EXPECT_FALSE(command.label.empty()) << command.id;
        EXPECT_TRUE(command.help.size() > 10 && command.help.back() == '.') << command.id << ": " << command.help;
        EXPECT_TRUE(command.apply) << command.id;
        for (const CommandArgument& argument : command.arguments) {
            EXPECT_TRUE(argument.info.help.size() > 3 && argument.info.help.back() == '.')
                << command.id << " " << argument.info.name;
            EXPECT_FALSE(argument.required && argument.optional) << command.id << " " << argument.info.name;
        }
    }
}

TEST(CommandRegistry, NoChordIsGivenTwice) {
    std::map<std::string, std::string> chords;
    const auto take = [&chords](const std::string& chord, const std::string& whose) {
        if (chord.empty()) return;
        const auto [place, fresh] = chords.insert({chord, whose});
        EXPECT_TRUE(fresh) << chord << " runs " << place->second << " and " << whose;
    };
    for (const Command& command : commands()) {
        take(command.shortcut, command.id);
        EXPECT_TRUE(command.shortcut.empty() || command.runsWithDefaults()) << command.id;
        for (const CommandVariant& variant : command.variants) take(variant.shortcut, variant.label);
    }
    EXPECT_GE(chords.size(), 25u);
}

class CheckArguments : public Commands {
protected:
    Result<Arguments> check(const char* id, const Arguments& arguments) {
        return checkArguments(*findCommand(id), arguments, document(), context);
    }
    std::string sentence(const char* id, const Arguments& arguments) {
        const auto checked = check(id, arguments);
        return checked ? "" : checked.error().describe();
    }
};

TEST_F(CheckArguments, FillsDefaultsAndLeavesOptionalOnesOut) {
    const auto paste = check("pose.paste", Arguments::object());
    ASSERT_TRUE(paste);
    EXPECT_EQ(paste.value(), (Arguments{{"flipped", false}, {"blend", 1.0}}));
    const auto grid = check("view.grid", Arguments::object());
    ASSERT_TRUE(grid);
    EXPECT_FALSE(grid.value().contains("enabled"));
}

TEST_F(CheckArguments, EveryVariantIsSound) {
    context.clipboard.pose = pose();
    for (const Command& command : commands()) {
        for (const CommandVariant& variant : command.variants) {
            const auto checked = checkArguments(command, variant.arguments, document(), context);
            EXPECT_TRUE(checked) << variant.label << ": " << (checked ? "" : checked.error().describe());
        }
    }
}

TEST_F(CheckArguments, NamesWhatIsWrong) {
    EXPECT_EQ(sentence("light.rotate", {{"degree", 5}}),
              "light.rotate: degree: there is no such argument; did you mean degrees?");
    EXPECT_EQ(sentence("light.rotate", Arguments::object()),
              "light.rotate: degrees: is missing, expected float in [-360 .. 360] deg");
    EXPECT_EQ(sentence("light.rotate", {{"degrees", 361}}),
              "light.rotate: degrees: expected float in [-360 .. 360] deg, found 361");
    EXPECT_EQ(sentence("light.rotate", {{"degrees", "much"}}),
              "light.rotate: degrees: expected float in [-360 .. 360] deg, found \"much\"");
    EXPECT_EQ(sentence("light.rotate", {{"degrees", std::nan("")}}),
              "light.rotate: degrees: expected float in [-360 .. 360] deg, found nan");
    EXPECT_EQ(sentence("view.select_joint", {{"joint", "left_elbw"}}),
              "view.select_joint: joint: there is no \"left_elbw\"; did you mean left_elbow?");
    EXPECT_EQ(sentence("camera.reset", {{"fast", true}}),
              "camera.reset: fast: there is no such argument; this command takes none");
    EXPECT_EQ(sentence("camera.reset", Arguments::array({1})),
              "camera.reset: expected arguments as a JSON object, found array");
}

TEST_F(CheckArguments, WholeNumbersMayBeWrittenAsFloats) {
    const auto checked = check("light.remove_lamp", {{"index", 2.0}});
    ASSERT_TRUE(checked);
    EXPECT_EQ(checked.value()["index"], 2);
    EXPECT_FALSE(check("light.remove_lamp", {{"index", 2.5}}));
}

class Settings : public Commands {};

TEST_F(Settings, ReachEveryRowOfEveryTable) {
    for (const SettingGroup& group : settingGroups()) {
        for (std::size_t row = 0; row < group.infos.size(); ++row) {
            const ParameterInfo& info = group.infos[row];
            // Another value that is surely sound: the other bool or word, or the middle of the range.
            Arguments value;
            const ParameterValue now = group.values(document())[row];
            if (!info.choices.empty())
                value = info.choices.back();
            else if (const bool* flag = std::get_if<bool>(&now))
                value = !*flag;
            else if (const auto* number = std::get_if<std::int64_t>(&now))
                value = *number + 1;
            else
                value = std::clamp(std::get<double>(now) * 0.9 + 0.01, info.range.minimum, info.range.maximum);
            if (group.name == "occlusion" && (info.name == "first_step" || info.name == "last_step")) continue;
            must("settings.set", {{"group", group.name}, {"name", info.name}, {"value", value}});
            const ParameterValue after = group.values(document())[row];
            if (const double* number = std::get_if<double>(&after)) {
                EXPECT_NEAR(*number, value.get<double>(), 1e-6 * std::max(1.0, std::abs(*number))) << info.name;
            } else {
                EXPECT_EQ(formatParameter(after), value.is_string() ? value.get<std::string>() : value.dump())
                    << group.name << "." << info.name;
            }
        }
    }
}

TEST_F(Settings, RulesBetweenRowsHold) {
    EXPECT_NE(refusal("settings.set", {{"group", "occlusion"}, {"name", "first_step"}, {"value", 17}}), "");
    must("settings.set", {{"group", "occlusion"}, {"name", "first_step"}, {"value", 8}});
    EXPECT_NE(refusal("settings.set", {{"group", "occlusion"}, {"name", "last_step"}, {"value", 4}}), "");
    EXPECT_NE(refusal("settings.set", {{"group", "sky"}, {"name", "turbidity"}, {"value", 99.0}}), "");
    EXPECT_NE(refusal("settings.set", {{"group", "sky"}, {"name", "delta"}, {"value", 0.1}}), "");
    EXPECT_NE(refusal("settings.set", {{"group", "sky"}, {"name", "turbidity"}, {"value", "thick"}}), "");
}

class Avatars : public Commands {};

TEST_F(Avatars, OpeningAnotherDropsTheShapeOfTheLast) {
    if (!assets.avatar->shapeNames.empty()) must("avatar.shape", {{"index", 0}, {"value", 1.5}});
    must("view.select_joint", {{"joint", "head"}});
    must("avatar.open", {{"source", "rest:/somewhere/person.glb"}});
    EXPECT_EQ(document().avatar.source, "rest:/somewhere/person.glb");
    EXPECT_TRUE(document().avatar.betas.empty());
    EXPECT_EQ(document().view.selectedJoint, -1);
    EXPECT_EQ(refusal("avatar.open", {{"source", "person.glb"}}),
              "source: expected rest:open, rest:/FILE or the absolute path of an avatar, found \"person.glb\"");
}

TEST_F(Avatars, OneThatIsOpenedStandsOnTheFloor) {
    must("pose.move_root", {{"x", 0.3}, {"y", 2.5}, {"z", 0.0}});
    auto other = std::make_shared<AvatarAsset>(*openBody());
    AvatarSection section = document().avatar;
    section.source = "rest:/somewhere/person.glb";
    other->key = avatarKey(section);
    assets.avatar = other; // the session has it before it runs the command
    must("avatar.open", {{"source", section.source}});
    float lowest = 1e9f;
    const auto vertices = posedTemplate(other->evaluator->mesh(), pose());
    for (const glm::vec3& vertex : vertices.value()) lowest = std::min(lowest, vertex.y);
    EXPECT_NEAR(lowest, 0.0f, 1e-4f);
    EXPECT_FLOAT_EQ(pose().translation.x, 0.3f);
    EXPECT_EQ(document().pose.pose.rotations, newDocument().pose.pose.rotations);
}

TEST_F(Avatars, ShapeIsRefusedWhereThereIsNone) {
    auto plain = std::make_shared<AvatarAsset>(*openBody());
    plain->shapeNames.clear();
    assets.avatar = plain;
    EXPECT_EQ(refusal("avatar.shape", {{"index", 0}, {"value", 1.0}}), "this avatar has no shape coefficients");
    plain = std::make_shared<AvatarAsset>(*openBody());
    plain->shapeNames = {"tall", "heavy"};
    assets.avatar = plain;
    must("avatar.shape", {{"index", 1}, {"value", -2.0}});
    EXPECT_EQ(document().avatar.betas, (std::vector<float>{0.0f, -2.0f}));
    EXPECT_EQ(refusal("avatar.shape", {{"index", 2}, {"value", 1.0}}), "index: expected 0 to 1, found 2");
    must("avatar.reset_shape");
    EXPECT_TRUE(document().avatar.betas.empty());
}

class Lights : public Commands {};

TEST_F(Lights, TurntableGoesEvenlyAround) {
    must("light.rotate", {{"degrees", 30.0}});
    must("timeline.range", {{"start", 1.0}, {"end", 2.0}});
    must("light.turntable", {{"seconds", 8.0}, {"turns", -0.5}});
    EXPECT_DOUBLE_EQ(document().timeline.endS, 9.0);
    for (const double t : {1.0, 3.0, 5.0, 9.0}) {
        EXPECT_NEAR(placementAt(document(), t).rotationDeg, 30.0 - 180.0 * (t - 1.0) / 8.0, 1e-3) << t;
    }
}

TEST_F(Lights, LampsAreAddedChangedAndRemoved) {
    const std::size_t before = document().light.studio.lamps.size();
    must("light.kind", {{"kind", "uniform"}});
    must("light.add_lamp", {{"name", "candle"}});
    ASSERT_EQ(document().light.studio.lamps.size(), before + 1);
    EXPECT_EQ(document().light.kind, LightKind::Studio) << "a lamp that does not shine would be a lost edit";
    const auto index = static_cast<int>(before);
    must("light.lamp", {{"index", index}, {"name", "temperature"}, {"value", 1900}});
    must("light.lamp", {{"index", index}, {"name", "shape"}, {"value", "round"}});
    EXPECT_FLOAT_EQ(document().light.studio.lamps.back().temperatureK, 1900.0f);
    EXPECT_EQ(document().light.studio.lamps.back().shape, LampShape::Round);
    EXPECT_NE(refusal("light.lamp", {{"index", index}, {"name", "temperature"}, {"value", 3.0}}), "");
    EXPECT_NE(refusal("light.lamp", {{"index", index + 1}, {"name", "roll"}, {"value", 3.0}}), "");
    must("light.remove_lamp", {{"index", 0}});
    EXPECT_EQ(document().light.studio.lamps.size(), before);
    EXPECT_EQ(document().light.studio.lamps.back().name, "candle");
}

TEST_F(Lights, FileIsNeededForItsKind) {
    EXPECT_EQ(refusal("light.kind", {{"kind", "file"}}), "no environment file has been opened yet");
    EXPECT_NE(refusal("light.open", {{"file", "sky.exr"}}), "");
    must("light.open", {{"file", "/lights/sky.exr"}});
    must("light.kind", {{"kind", "sky"}});
    must("light.kind", {{"kind", "file"}});
    EXPECT_EQ(document().light.file, "/lights/sky.exr");
}

class Radii : public Commands {};

TEST_F(Radii, LockedOnesStay) {
    must("occlusion.lock", {{"part", "knee"}});
    EXPECT_EQ(refusal("occlusion.radius", {{"part", "knee"}, {"metres", 0.2}}), "the radius of the knee is locked");
    EXPECT_NE(refusal("occlusion.reset", {{"part", "knee"}}), "");
    const PartRadii before = document().occlusion.radii;
    must("occlusion.scale", {{"factor", 1.5}});
    for (std::size_t p = 0; p < before.size(); ++p) {
        const bool knee = p == static_cast<std::size_t>(BodyPart::Knee);
        EXPECT_NEAR(document().occlusion.radii[p], before[p] * (knee ? 1.0f : 1.5f), 1e-6f);
    }
    must("occlusion.reset");
    EXPECT_EQ(document().occlusion.radii, initialPartRadii());
    must("occlusion.lock", {{"part", "knee"}});
    must("occlusion.radius", {{"part", "knee"}, {"metres", 0.2}});
    EXPECT_FLOAT_EQ(document().occlusion.radii[static_cast<std::size_t>(BodyPart::Knee)], 0.2f);
}

TEST_F(Radii, StayWithinTheirBounds) {
    must("occlusion.radius", {{"part", "hand"}, {"metres", 0.7}});
    EXPECT_FLOAT_EQ(document().occlusion.radii[static_cast<std::size_t>(BodyPart::Hand)], 0.12f); // 3 x 0.04
    must("occlusion.scale", {{"factor", 0.05}});
    EXPECT_FLOAT_EQ(document().occlusion.radii[static_cast<std::size_t>(BodyPart::Torso)], 0.05f); // 0.2 x 0.25
}

class Views : public Commands {};

TEST_F(Views, SwitchesTurnTheOtherWayWithoutAnArgument) {
    const bool before = document().view.grid;
    must("view.grid");
    EXPECT_EQ(document().view.grid, !before);
    must("view.grid", {{"enabled", !before}});
    EXPECT_EQ(document().view.grid, !before);
    must("timeline.loop");
    EXPECT_FALSE(document().timeline.loop);
}

TEST_F(Views, BackgroundIsGivenAsScreensShowIt) {
    must("view.background", {{"red", 0.5}, {"green", 0.0}, {"blue", 1.0}});
    EXPECT_NEAR(document().view.tone.backgroundRed, 0.21404114, 1e-6); // IEC 61966-2-1
    EXPECT_FLOAT_EQ(document().view.tone.backgroundGreen, 0.0f);
    EXPECT_FLOAT_EQ(document().view.tone.backgroundBlue, 1.0f);
}

TEST_F(Views, RangesAndStripsAreChecked) {
    must("view.range", {{"buffer", "depth"}, {"minimum", 1.0}, {"maximum", 4.0}});
    EXPECT_EQ(document().view.buffers[static_cast<std::size_t>(BufferId::Depth)].range, (std::pair{1.0f, 4.0f}));
    EXPECT_EQ(refusal("view.range", {{"buffer", "depth"}, {"minimum", 4.0}, {"maximum", 1.0}}),
              "minimum: expected less than the maximum 1, found 4");
    must("view.reset_range", {{"buffer", "depth"}});
    EXPECT_FALSE(document().view.buffers[static_cast<std::size_t>(BufferId::Depth)].range);
    must("view.strip", {{"buffers", "ao,normal"}});
    EXPECT_EQ(document().view.strip, (std::vector{BufferId::AmbientOcclusion, BufferId::Normal}));
    EXPECT_NE(refusal("view.strip", {{"buffers", "ao,colour"}}), "");
}

TEST_F(Views, ComparingNeedsSomethingToCompareWith) {
    EXPECT_EQ(refusal("compare.kind", {{"kind", "held"}}), "nothing is held yet (compare.hold)");
    EXPECT_NE(refusal("compare.kind", {{"kind", "picture"}}), "");
    EXPECT_NE(refusal("compare.kind", {{"kind", "photograph"}}), "");
    must("light.rotate", {{"degrees", 20.0}});
    must("compare.hold");
    must("light.rotate", {{"degrees", 90.0}});
    ASSERT_TRUE(document().view.compare.held);
    EXPECT_FLOAT_EQ(document().view.compare.held->light.rotationDeg, 20.0f);
    must("compare.avatar", {{"source", "rest:open"}});
    EXPECT_NE(refusal("compare.kind", {{"kind", "picture"}}), "") << "the file is an avatar";
    must("compare.kind", {{"kind", "held"}});
    must("compare.kind", {{"kind", "avatar"}});
}

} // namespace
} // namespace ars::test
