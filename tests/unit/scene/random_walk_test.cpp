#include "engine/core/file.h"
#include "engine/scene/pose_library.h"
#include "engine/scene/project.h"
#include "engine/scene/setting_groups.h"
#include "tests/unit/scene/command_fixture.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <map>
#include <random>
#include <set>

namespace ars::test {
namespace {

/// Numbers of a document that must be finite whatever was done; the first that is not is named.
class FiniteCheck {
public:
    std::string of(const Document& d) {
        pose("pose", d.pose.pose);
        const TimelineSection& t = d.timeline;
        for (const double v : {t.clipOffsetS, t.startS, t.endS, t.framesPerSecond, t.timeS, t.speed})
            one("timeline", v);
        for (const JointTrack& track : t.joints) {
            keys("joint keys", track.keys, [this](const glm::quat& q) { rotation("joint key", q); });
        }
        keys("root keys", t.root, [this](const glm::vec3& v) { three("root key", v); });
        keys("expression keys", t.expression, [this](const std::vector<float>& v) {
            for (const float x : v) one("expression key", x);
        });
        keys("camera keys", t.camera, [this](const SceneCamera& c) { camera("camera key", c); });
        keys("light keys", t.lightRotationDeg, [this](float v) { one("light key", v); });
        keys("exposure keys", t.lightExposureEv, [this](float v) { one("exposure key", v); });
        for (const auto& track : t.radii) {
            keys("radius keys", track, [this](float v) { one("radius key", v); });
        }
        camera("camera", d.camera.camera);
        one("light rotation", d.light.rotationDeg);
        one("light exposure", d.light.exposureEv);
        for (const float radius : d.occlusion.radii) one("radius", radius);
        for (const SettingGroup& group : settingGroups()) {
            for (const ParameterValue& value : group.values(d)) {
                if (const double* number = std::get_if<double>(&value)) one(group.name.c_str(), *number);
            }
        }
        return found_;
    }

private:
    void fail(const char* what) {
        if (found_.empty()) found_ = what;
    }
    void one(const char* what, double v) {
        if (!std::isfinite(v)) fail(what);
    }
    void three(const char* what, const glm::dvec3& v) {
        for (int c = 0; c < 3; ++c) one(what, v[c]);
    }
    void rotation(const char* what, const glm::quat& q) {
        if (!(std::abs(glm::length(q) - 1.0f) < 1e-3f)) fail(what);
    }
    void pose(const char* what, const Pose& p) {
        for (const glm::quat& q : p.rotations) rotation(what, q);
        three(what, p.translation);
        for (const float v : p.expression) one(what, v);
    }
    void camera(const char* what, const SceneCamera& c) {
        three(what, c.eye);
        three(what, c.target);
        one(what, c.rollDeg);
        one(what, c.verticalFieldDeg);
        if (!(glm::distance(c.eye, c.target) > 1e-4)) fail(what);
    }
    template <typename Value, typename Each>
    void keys(const char* what, const Track<Value>& track, const Each& each) {
        for (std::size_t i = 0; i < track.size(); ++i) {
            one(what, track[i].timeS);
            if (i > 0 && !(track[i].timeS - track[i - 1].timeS > kKeyTimeTolerance)) fail(what);
            each(track[i].value);
        }
    }
    std::string found_;
};

/// Draws commands and arguments from the registry's own words.
class Walker {
public:
    Walker(unsigned seed, const SceneAssets& assets, Clipboard& clipboard, std::string clip, std::string capture)
        : random_(seed), context_{assets, clipboard, 0.0}, clip_(std::move(clip)), capture_(std::move(capture)) {}

    const Command& command() { return commands()[below(commands().size())]; }

    Arguments arguments(const Command& command, const Document& document) {
        Arguments arguments = Arguments::object();
        for (const CommandArgument& argument : command.arguments) {
            if (!argument.required && chance(0.4)) continue;
            arguments[argument.info.name] = value(command, argument, document, arguments);
        }
        if (command.id.rfind("timeline.", 0) == 0 && arguments.contains("track")) aimAtKey(document, arguments);
        return arguments;
    }

    bool chance(double p) { return std::uniform_real_distribution<double>(0.0, 1.0)(random_) < p; }
    std::size_t below(std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_); }
    double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }

private:
    nlohmann::json value(const Command& command, const CommandArgument& argument, const Document& document,
                         const Arguments& soFar) {
        if (chance(0.02)) return wrongValue();
        if (argument.anyType) return settingValue(command, soFar);
        if (command.id == "settings.set" && argument.info.name == "name") {
            if (const SettingGroup* group = findSettingGroup(textIn(soFar, "group"))) {
                return group->infos[below(group->infos.size())].name;
            }
        }
        if (argument.choices) {
            const std::vector<std::string> words = argument.choices(document, context_);
            return words.empty() ? nlohmann::json("nobody") : nlohmann::json(words[below(words.size())]);
        }
        return sample(argument.info);
    }

    nlohmann::json sample(const ParameterInfo& info) {
        if (!info.choices.empty()) return info.choices[below(info.choices.size())];
        const auto [low, high] = info.range;
        if (std::holds_alternative<bool>(info.defaultValue)) return chance(0.5);
        if (std::holds_alternative<std::int64_t>(info.defaultValue)) {
            // Most lists are short: indices near the lower end are the ones that exist.
            const double span = chance(0.7) ? std::min(high - low, 8.0) : high - low;
            return static_cast<std::int64_t>(std::floor(between(low, low + span)));
        }
        if (std::holds_alternative<double>(info.defaultValue)) {
            if (low == high) return between(-2.0, 2.0);
            // Everyday numbers, and the whole range up to its ends.
            if (chance(0.6)) return between(std::max(low, -2.0), std::min(high, std::max(low, -2.0) + 4.0));
            return chance(0.2) ? (chance(0.5) ? low : high) : between(low, high);
        }
        return textFor(info.name);
    }

    nlohmann::json textFor(const std::string& name) {
        if (name == "source") return chance(0.7) ? "rest:open" : "rest:/avatars/person.glb";
        if (name == "file") return chance(0.5) ? clip_ : capture_;
        if (name == "buffers") return chance(0.5) ? "all" : "albedo,ao,depth";
        if (name == "pose") {
            return R"({"rotations": {"left_elbow": [0, -60, 0], "head": [5, 10, 0]}, "translation": [0, 0.8, 0]})";
        }
        return chance(0.5) ? "" : "one";
    }

    nlohmann::json settingValue(const Command& command, const Arguments& soFar) {
        const std::string name = textIn(soFar, "name");
        std::vector<ParameterInfo> infos = studioLampParameters().infos();
        if (command.id == "settings.set") {
            const SettingGroup* group = findSettingGroup(textIn(soFar, "group"));
            if (!group) return 1;
            infos = group->infos;
        }
        for (const ParameterInfo& info : infos) {
            if (info.name == name) return sample(info);
        }
        return 1;
    }

    static std::string textIn(const Arguments& arguments, const char* name) {
        const auto found = arguments.find(name);
        return found != arguments.end() && found->is_string() ? found->get<std::string>() : std::string();
    }

    nlohmann::json wrongValue() {
        const std::vector<nlohmann::json> values{
            "nonsense", -1e30, 1e30, true, nlohmann::json(), nlohmann::json::array(), std::nan(""), "", 7};
        return values[below(values.size())];
    }

    /// Commands about keys mostly speak of keys that there are.
    void aimAtKey(const Document& document, Arguments& arguments) {
        const std::vector<std::string> keyed = keyedTracks(document, context_);
        if (keyed.empty() || chance(0.3)) return;
        const std::string track = keyed[below(keyed.size())];
        std::vector<double> times;
        const TimelineSection& t = document.timeline;
        const auto take = [&times](const auto& keys) {
            for (const auto& key : keys) times.push_back(key.timeS);
        };
        if (track == "root") take(t.root);
        if (track == "expression") take(t.expression);
        if (track == "camera") take(t.camera);
        if (track == "light_rotation") take(t.lightRotationDeg);
        if (track == "light_exposure") take(t.lightExposureEv);
        for (std::size_t p = 0; p < t.radii.size(); ++p) {
            if (track == "radius:" + std::string(bodyPartName(static_cast<BodyPart>(p)))) take(t.radii[p]);
        }
        for (const JointTrack& joint : t.joints) {
            if (track == "joint:" + std::string(smplxJointName(joint.joint))) take(joint.keys);
        }
        arguments["track"] = track;
        for (const char* name : {"time", "from"}) {
            if (arguments.contains(name) && !times.empty()) arguments[name] = times[below(times.size())];
        }
    }

    std::mt19937 random_;
    CommandContext context_;
    std::string clip_, capture_;
};

/// Files as a person has them: a clip and a calibration.
struct Files {
    TemporaryFolder folder;
    std::string clip, capture;

    Files() : clip((folder / "swing.npz").string()), capture((folder / "calibration_full.json").string()) {
        EXPECT_TRUE(writeSmplParams(clip, swingingClip()));
        nlohmann::ordered_json cameras;
        for (const CalibratedCamera& camera : threeCameras()) {
            nlohmann::ordered_json one = cameraToJson(camera.camera);
            nlohmann::ordered_json entry;
            for (const char* key : {"K", "R"}) {
                entry[key] = nlohmann::ordered_json::array();
                for (const auto& row : one[key]) {
                    for (const auto& number : row) entry[key].push_back(number);
                }
            }
            entry["T"] = one["t"];
            entry["imgSize"] = {camera.camera.width, camera.camera.height};
            entry["distCoeff"] = {0.0, 0.0, 0.0, 0.0, 0.0};
            cameras[camera.name] = entry;
        }
        EXPECT_TRUE(writeFileAtomic(capture, cameras.dump()));
    }
};

std::string jsonText(const Document& document) { return documentToJson(document).dump(); }

class RandomWalk : public Commands {
protected:
    void SetUp() override {
        Commands::SetUp();
        editor.setHistoryLimit(std::size_t{8} << 30);
    }

    /// What the session does when files come and go.
    void bringAssets(const Document& d, const std::shared_ptr<const ClipAsset>& clip,
                     const std::shared_ptr<const CaptureAsset>& capture) {
        assets.clip = d.timeline.clip.empty() ? nullptr : clip;
        assets.capture = d.camera.capture.empty() ? nullptr : capture;
    }

    void step(Walker& walker) {
        const Command& command = walker.command();
        const bool drag = walker.chance(0.2);
        const int calls = drag ? 2 + static_cast<int>(walker.below(5)) : 1;
        for (int i = 0; i < calls; ++i) {
            context.timeS = walker.chance(0.9) ? document().timeline.timeS : walker.between(0.0, 4.0);
            const Arguments arguments = walker.arguments(command, document());
            const Status status = editor.run(command.id, arguments, context, drag ? "drag" : "");
            if (status)
                ++visits[command.id];
            else
                lastError[command.id] = status.error().describe();
        }
        if (drag && walker.chance(0.15)) editor.cancelGesture();
        if (drag) editor.endGesture();
        if (walker.chance(0.15)) {
            for (std::size_t i = walker.below(6); i > 0 && editor.undo(); --i) {
            }
            for (std::size_t i = walker.below(6); i > 0 && editor.redo(); --i) {
            }
        }
    }

    std::map<std::string, int> visits;
    std::map<std::string, std::string> lastError;
};

TEST_F(RandomWalk, TenThousandCommandsVisitThemAllAndUndoReturnsToTheStart) {
    const Files files;
    auto clip = loadClipAsset(files.clip, skeleton());
    ASSERT_TRUE(clip) << clip.error().describe();
    auto capture = loadCaptureAsset(files.capture);
    ASSERT_TRUE(capture) << capture.error().describe();
    const Document start = document();
    const std::string startText = jsonText(start);

    Walker walker(20260722, assets, clipboard, files.clip, files.capture);
    constexpr int kSteps = 10000;
    for (int i = 0; i < kSteps; ++i) {
        bringAssets(document(), clip.value(), capture.value());
        step(walker);
        const std::string broken = FiniteCheck().of(document());
        ASSERT_EQ(broken, "") << "after step " << i << ": " << editor.undoLabel();
        if (i % 250 == 0) {
            const std::string text = jsonText(document());
            const auto read = documentFromJson(nlohmann::ordered_json::parse(text));
            ASSERT_TRUE(read) << read.error().describe();
            ASSERT_EQ(jsonText(read.value()), text) << "the file does not read back after step " << i;
        }
    }

    std::string missing;
    for (const Command& command : commands()) {
        if (visits[command.id] == 0) missing += fmt::format("\n  {}: {}", command.id, lastError[command.id]);
    }
    EXPECT_EQ(missing, "") << "commands that never went well:" << missing;

    while (editor.redo()) {
    }
    const Document end = document();
    const std::string endText = jsonText(end);
    EXPECT_FALSE(end == start);
    while (editor.undo()) {
    }
    EXPECT_TRUE(document() == start);
    EXPECT_EQ(jsonText(document()), startText);
    while (editor.redo()) {
    }
    EXPECT_TRUE(document() == end);
    EXPECT_EQ(jsonText(document()), endText);
}

TEST_F(RandomWalk, WalksWithTheSameSeedAreTheSame) {
    std::string texts[2];
    for (std::string& text : texts) {
        editor.replace(newDocument());
        clipboard = {};
        Walker walker(7, assets, clipboard, "/clips/swing.npz", "/capture/calibration_full.json");
        for (int i = 0; i < 300; ++i) step(walker);
        text = jsonText(document());
    }
    EXPECT_EQ(texts[0], texts[1]);
}

} // namespace
} // namespace ars::test
