#include "engine/core/camera.h"
#include "engine/frame/framing.h"
#include "engine/rig/body_model.h"
#include "engine/scene/document.h"
#include "engine/scene/project.h"
#include "tests/unit/scene/changed_document.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <random>
#include <set>

namespace ars {
namespace {

using Json = nlohmann::ordered_json;

/// What reading says, whichever way it ends.
std::string outcome(const Json& json, Document* document = nullptr, std::vector<std::string>* notes = nullptr) {
    auto read = documentFromJson(json, {}, notes);
    if (!read) return read.error().describe();
    if (document) *document = std::move(*read);
    return "read";
}

std::string outcomeOf(const char* pointer, const Json& value) {
    Json json = documentToJson(test::changedDocument());
    json[Json::json_pointer(pointer)] = value;
    return outcome(json);
}

// The bodies are compared vertex by vertex, so that the number in the code is held against the file itself.
TEST(NewDocument, StandsOnItsSolesAndIsSeenWhole) {
    const Result<BodyModel> body = readOpenBody();
    ASSERT_TRUE(body.ok());
    const Document document = newDocument();
    const std::vector<glm::vec3> vertices = posedVertices(*body, {}, document.pose.pose);
    const Bounds bounds = boundsOf(vertices);
    EXPECT_NEAR(bounds.low.y, 0.0f, 1e-4f);
    const SceneCamera& view = document.camera.camera;
    const Camera camera = lookAtCamera(view.eye, view.target, view.verticalFieldDeg, 960, 720);
    for (const glm::vec3& vertex : vertices) {
        const glm::dvec3 seen = camera.toCamera(vertex);
        ASSERT_GT(seen.z, 0.0);
        const glm::dvec2 pixel = camera.project(seen);
        ASSERT_TRUE(pixel.x > 20 && pixel.x < 940 && pixel.y > 20 && pixel.y < 700) << pixel.x << " " << pixel.y;
    }
    EXPECT_GT(bounds.high.y, 1.7f);
    EXPECT_LT(bounds.size().x, 1.1f) << "the arms hang";
}

TEST(DocumentEquality, SeesEveryPartOfAPose) {
    const PoseSection pose = test::changedDocument().pose;
    const auto differs = [&](auto&& change) {
        PoseSection other = pose;
        change(other);
        return !(other == pose);
    };
    EXPECT_FALSE(differs([](PoseSection&) {}));
    EXPECT_TRUE(differs([](PoseSection& p) { p.pose.rotations[7].y += 1e-6f; }));
    EXPECT_TRUE(differs([](PoseSection& p) { p.pose.rotations.pop_back(); }));
    EXPECT_TRUE(differs([](PoseSection& p) { p.pose.translation.z = 0.0f; }));
    EXPECT_TRUE(differs([](PoseSection& p) { p.pose.expression[1] = 0.0f; }));
    EXPECT_TRUE(differs([](PoseSection& p) { p.useLimits = true; }));
    EXPECT_TRUE(differs([](PoseSection& p) { p.keepOrientation = true; }));
}

TEST(DocumentEquality, ComparesWhatIsHeldAndNotWhereItLies) {
    const CompareSection compare = test::changedDocument().view.compare;
    CompareSection copy = compare;
    copy.held = std::make_shared<HeldLook>(*compare.held);
    EXPECT_EQ(copy, compare);
    auto changed = std::make_shared<HeldLook>(*compare.held);
    changed->light.exposureEv += 1.0f;
    copy.held = changed;
    EXPECT_FALSE(copy == compare);
    copy.held = nullptr;
    EXPECT_FALSE(copy == compare);
    EXPECT_FALSE(compare == copy);
}

TEST(DocumentJson, EveryFieldComesBackExactly) {
    for (const Document& document : {Document{}, newDocument(), test::changedDocument()}) {
        const std::string text = documentToJson(document).dump(1);
        std::vector<std::string> notes;
        const Result<Document> read = documentFromJson(Json::parse(text), {}, &notes);
        ASSERT_TRUE(read.ok()) << read.error().describe();
        EXPECT_TRUE(notes.empty()) << notes.front();
        EXPECT_TRUE(*read == document);
        EXPECT_EQ(documentToJson(*read).dump(1), text);
    }
}

/// The leaves of a JSON value, by pointer.
void leavesOf(const Json& json, const Json::json_pointer& at, std::vector<Json::json_pointer>& leaves) {
    if (json.is_object()) {
        for (const auto& member : json.items()) leavesOf(member.value(), at / member.key(), leaves);
    } else if (json.is_array()) {
        for (std::size_t i = 0; i < json.size(); ++i) leavesOf(json[i], at / i, leaves);
    } else {
        leaves.push_back(at);
    }
}

// A leaf that is written but not read would leave the document equal when its value is exchanged for the default's.
TEST(DocumentJson, EveryLeafOfTheFileMatters) {
    const Document document = test::changedDocument();
    const Json json = documentToJson(document);
    std::vector<Json::json_pointer> leaves;
    leavesOf(json, Json::json_pointer(), leaves);
    ASSERT_GT(leaves.size(), 500u);
    int tried = 0;
    for (const Json::json_pointer& leaf : leaves) {
        if (leaf.to_string() == "/program" || leaf.to_string() == "/format") continue;
        Json changed = json;
        changed[leaf] = Json::object({{"wrong", 1}});
        const std::string said = outcome(changed);
        ASSERT_NE(said, "read") << leaf.to_string() << " is not read";
        ASSERT_NE(said.find("found an object"), std::string::npos) << leaf.to_string() << ": " << said;
        ++tried;
    }
    EXPECT_GT(tried, 500);
}

// What a change of every field in memory must be able to do; the other direction of the test above.
TEST(DocumentJson, NoFieldIsLeftAtItsDefault) {
    const Json changed = documentToJson(test::changedDocument()), plain = documentToJson(Document{});
    std::vector<Json::json_pointer> leaves;
    leavesOf(plain, Json::json_pointer(), leaves);
    for (const Json::json_pointer& leaf : leaves) {
        if (leaf.to_string() == "/program" || leaf.to_string() == "/format" || !changed.contains(leaf)) continue;
        EXPECT_NE(changed[leaf], plain[leaf]) << leaf.to_string();
    }
}

TEST(DocumentJson, AwkwardNumbersComeBackExactly) {
    std::mt19937 random(7);
    Document document;
    std::vector<float> values{0.0f, -0.0f, 1e-45f, 1.17549435e-38f, 0.1f, 16777217.0f, 999999.94f, -1e6f, 1.0f / 3.0f};
    std::uniform_int_distribution<std::uint32_t> bits;
    while (values.size() < 1000) {
        const std::uint32_t pattern = bits(random);
        float value = 0.0f;
        std::memcpy(&value, &pattern, sizeof(value));
        if (std::isfinite(value) && std::abs(value) <= 1e6f) values.push_back(value);
    }
    std::erase_if(values, [](float v) { return std::abs(v) > 1e6f; });
    document.avatar.betas = values;
    document.camera.camera.eye = {0.1 + 0.2, 5e-324, -123456.78901234567};
    const Result<Document> read = documentFromJson(Json::parse(documentToJson(document).dump()));
    ASSERT_TRUE(read.ok()) << read.error().describe();
    ASSERT_EQ(read->avatar.betas.size(), values.size());
    EXPECT_EQ(std::memcmp(read->avatar.betas.data(), values.data(), values.size() * sizeof(float)), 0);
    EXPECT_TRUE(read->camera == document.camera);
}

TEST(DocumentJson, MissingKeysKeepTheirDefault) {
    Document document;
    EXPECT_EQ(outcome(Json{{"format", 1}}, &document), "read");
    EXPECT_TRUE(document == Document{});
    EXPECT_EQ(outcome(Json{{"format", 1}, {"light", {{"exposure", 2}}}}, &document), "read");
    EXPECT_EQ(document.light.exposureEv, 2.0f);
    document.light.exposureEv = 0.0f;
    EXPECT_TRUE(document == Document{});
}

TEST(DocumentJson, UnknownKeysAreNoted) {
    Json json = documentToJson(newDocument());
    json["hair"] = {{"colour", "red"}};
    json["timeline"]["tempo"] = 3;
    json["light"]["studio"]["lamps"][0]["gobo"] = "tree";
    Document document;
    std::vector<std::string> notes;
    ASSERT_EQ(outcome(json, &document, &notes), "read");
    EXPECT_TRUE(document == newDocument());
    ASSERT_EQ(notes.size(), 3u);
    const std::set<std::string> sorted(notes.begin(), notes.end());
    EXPECT_TRUE(sorted.count("the key \"hair\" is not known and was left out"));
    EXPECT_TRUE(sorted.count("timeline: the key \"tempo\" is not known and was left out"));
    EXPECT_TRUE(sorted.count("light.studio.lamps[0]: the key \"gobo\" is not known and was left out"));
}

TEST(DocumentJson, WrongValuesAreNamedWithTheirKey) {
    EXPECT_EQ(outcomeOf("/timeline/joints/1/keys/0/time", "x"),
              "timeline.joints[1].keys[0].time: expected a number, found \"x\"");
    EXPECT_EQ(outcomeOf("/timeline/joints/0/keys/1/interpolation", "wobbly"),
              "timeline.joints[0].keys[1].interpolation: expected one of step, linear, smooth, found \"wobbly\"");
    EXPECT_EQ(outcomeOf("/timeline/joints/0/joint", 1.5),
              "timeline.joints[0].joint: expected a whole number, found 1.5");
    EXPECT_EQ(outcomeOf("/timeline/joints/0/joint", 1e300),
              "timeline.joints[0].joint: expected a number in [0, 4095], found 1e+300");
    EXPECT_EQ(outcomeOf("/timeline/rate", 0), "timeline.rate: expected a number in [0.01, 10000], found 0");
    EXPECT_EQ(outcomeOf("/pose/rotations/3", {1, 0, 0}), "pose.rotations[3]: expected a list of 4, found a list of 3");
    EXPECT_EQ(outcomeOf("/pose/rotations/3", {0, 0, 0, 0}),
              "pose.rotations[3]: expected a rotation w, x, y, z that is not zero, found a list of 4");
    EXPECT_EQ(outcomeOf("/pose/translation", {1, 2, "three"}),
              "pose.translation[2]: expected a number, found \"three\"");
    EXPECT_EQ(outcomeOf("/pose/translation", {1, 2, 1e30}),
              "pose.translation[2]: expected a number in [-1e+09, 1e+09], found 1e+30");
    EXPECT_EQ(outcomeOf("/light/studio/lamps/1/softness", 7),
              "light.studio.lamps[1].softness: expected a number in [0, 1], found 7");
    EXPECT_EQ(outcomeOf("/light/studio/lamps", Json(std::vector<Json>(65, Json::object()))),
              "light.studio.lamps: expected a list of at most 64, found 65");
    EXPECT_EQ(outcomeOf("/light/sky/normalise", 1), "light.sky.normalise: expected true or false, found 1");
    EXPECT_EQ(outcomeOf("/light/sky/width", 1000.5), "light.sky.width: expected a whole number, found 1000.5");
    EXPECT_EQ(outcomeOf("/light/file", 12), "light.file: expected text, found 12");
    EXPECT_EQ(outcomeOf("/light/file", std::string("/a\0b", 4)),
              "light.file: expected a path without zero bytes, found \"/a\\u0000b\"");
    EXPECT_EQ(outcomeOf("/occlusion/radii/knee", -1), "occlusion.radii.knee: expected a number in [0, 10], found -1");
    EXPECT_EQ(outcomeOf("/occlusion/settings/method", "magic"),
              "occlusion.settings.method: expected one of screen_space, mesh_rays, rasterised, baked, off, found "
              "\"magic\"");
    EXPECT_EQ(outcomeOf("/view/selected_part", 9), "view.selected_part: expected a number in [-1, 8], found 9");
    EXPECT_EQ(outcomeOf("/view/compare/held/pose", false), "view.compare.held.pose: expected an object, found false");
    EXPECT_EQ(outcomeOf("/view", Json::array()), "view: expected an object, found a list of 0");
    EXPECT_EQ(outcomeOf("/format", 2).substr(0, 61), "format: the project was written by a newer version of the pro");
    EXPECT_EQ(outcomeOf("/format", "one"), "format: expected 1 (a project of this program), found \"one\"");
    EXPECT_EQ(outcome(Json::object()), "format: expected 1 (a project of this program), found nothing");
    EXPECT_EQ(outcome(Json::array()), "expected a project (a JSON object), found a list of 0");
}

// A number that is none is written as null; the rest of such a document must not be lost.
TEST(DocumentJson, NumbersThatAreNoneBecomeTheDefaultWithANote) {
    Document document = newDocument();
    document.camera.camera.eye.y = std::numeric_limits<double>::quiet_NaN();
    document.light.exposureEv = std::numeric_limits<float>::infinity();
    document.avatar.betas = {1.0f, std::numeric_limits<float>::quiet_NaN()};
    std::vector<std::string> notes;
    Document read;
    ASSERT_EQ(outcome(Json::parse(documentToJson(document).dump()), &read, &notes), "read");
    EXPECT_EQ(notes.size(), 3u);
    EXPECT_EQ(read.camera.camera.eye.y, SceneCamera{}.eye.y);
    EXPECT_EQ(read.light.exposureEv, 0.0f);
    EXPECT_EQ(read.avatar.betas, (std::vector<float>{1.0f, 0.0f}));
    EXPECT_TRUE(read.pose == document.pose);
}

TEST(DocumentJson, KeysAreBroughtIntoOrder) {
    Json json = documentToJson(Document{});
    const auto key = [](double time, double value) { return Json{{"time", time}, {"value", value}}; };
    json["timeline"]["light_exposure"] = {key(2, 20), key(1, 10), key(2.00001, 21), key(0, 0)};
    const Json turned{{"time", 1}, {"value", {1, 0, 0, 0}}}, later{{"time", 0.5}, {"value", {0, 1, 0, 0}}};
    json["timeline"]["joints"] = {Json{{"joint", 5}, {"keys", {turned}}}, Json{{"joint", 2}, {"keys", {turned}}},
                                  Json{{"joint", 5}, {"keys", {later}}},
                                  Json{{"joint", 5}, {"layer", "on_clip"}, {"keys", {later}}}};
    json["timeline"]["start"] = 3;
    json["timeline"]["end"] = 1;
    Document document;
    std::vector<std::string> notes;
    ASSERT_EQ(outcome(json, &document, &notes), "read");
    const Track<float>& track = document.timeline.lightExposureEv;
    ASSERT_EQ(track.size(), 3u);
    EXPECT_EQ(track[0].value, 0.0f);
    EXPECT_EQ(track[1].value, 10.0f);
    EXPECT_EQ(track[2].value, 21.0f) << "the later of two keys at one time counts";
    const std::vector<JointTrack>& joints = document.timeline.joints;
    ASSERT_EQ(joints.size(), 3u);
    EXPECT_EQ(joints[0].joint, 2);
    EXPECT_EQ(joints[1].joint, 5);
    ASSERT_EQ(joints[1].keys.size(), 2u);
    EXPECT_EQ(joints[1].keys[0].timeS, 0.5);
    EXPECT_EQ(joints[2].layer, JointLayer::OnClip);
    EXPECT_EQ(document.timeline.startS, 1.0);
    EXPECT_EQ(document.timeline.endS, 3.0);
    EXPECT_GE(notes.size(), 3u);
}

TEST(DocumentJson, RotationsOfAnotherLengthAreMadeUnit) {
    Json json = documentToJson(Document{});
    json["pose"]["rotations"][4] = {2, 0, 0, 0};
    Document document;
    std::vector<std::string> notes;
    ASSERT_EQ(outcome(json, &document, &notes), "read");
    EXPECT_EQ(document.pose.pose.rotations[4], glm::quat(1, 0, 0, 0));
    EXPECT_EQ(notes.size(), 1u);
}

// File names are bytes; those that are no UTF-8 must survive in a format that is.
TEST(DocumentJson, NamesOfAnyBytesComeBack) {
    Document document;
    document.light.file = "/tmp/caf\xe9.exr";
    document.view.compare.layer = "\xff\xfe";
    document.light.studio.lamps[0].name = "l\xe4mp";
    Document read;
    ASSERT_EQ(outcome(Json::parse(documentToJson(document).dump()), &read), "read");
    EXPECT_TRUE(read == document);
}

} // namespace
} // namespace ars
