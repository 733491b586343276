#include "engine/capture/calibration.h"
#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/png.h"
#include "engine/io/video.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/project.h"
#include "tests/support/test_data.h"
#include "tests/unit/scene/changed_document.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <random>

namespace ars {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

void writeText(const fs::path& path, std::string_view text) {
    fs::create_directories(path.parent_path());
    std::ofstream(path, std::ios::binary) << text;
}

/// Sets a variable of the environment, or takes it away, while it lives.
class Variable {
public:
    Variable(const char* name, const char* value) : name_(name) {
        if (const char* was = std::getenv(name)) was_ = was;
        set(value);
    }
    ~Variable() { set(was_ ? was_->c_str() : nullptr); }

private:
    void set(const char* value) {
        if (value) {
            ::setenv(name_, value, 1);
        } else {
            ::unsetenv(name_);
        }
    }
    const char* name_;
    std::optional<std::string> was_;
};

TEST(Project, ReadsBackTheSame) {
    const test::TemporaryFolder folder;
    const Document document = test::changedDocument();
    ASSERT_TRUE(saveProject(folder / "a.ars", document).ok());
    std::vector<std::string> notes;
    const Result<Document> read = readProject(folder / "a.ars", &notes);
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_TRUE(*read == document);
    EXPECT_TRUE(notes.empty());
}

TEST(Project, PathsMoveWithTheFolder) {
    const test::TemporaryFolder folder;
    const fs::path before = folder / "before", after = folder / "after";
    Document document;
    document.avatar.source = "rest:" + (before / "project/bodies/me.npz").string();
    document.timeline.clip = (before / "motions/walk.bvh").string();
    document.camera.capture = (before / "project/capture/calibration_full.json").string();
    document.light.file = (before / "project/city.exr").string();
    document.view.compare.file = (before / "project/NAME.avatar").string();
    auto held = std::make_shared<HeldLook>();
    held->light.file = document.light.file;
    document.view.compare.held = std::move(held);
    ASSERT_TRUE(saveProject(before / "project/a.ars", document).ok());
    const std::string text = *readTextFile(before / "project/a.ars");
    EXPECT_EQ(text.find(folder.path().string()), std::string::npos) << text;
    EXPECT_NE(text.find("\"rest:bodies/me.npz\""), std::string::npos) << text;
    EXPECT_NE(text.find("\"../motions/walk.bvh\""), std::string::npos) << text;

    fs::rename(before, after);
    const Result<Document> read = readProject(after / "project/a.ars");
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_EQ(read->avatar.source, "rest:" + (after / "project/bodies/me.npz").string());
    EXPECT_EQ(read->timeline.clip, (after / "motions/walk.bvh").string());
    EXPECT_EQ(read->camera.capture, (after / "project/capture/calibration_full.json").string());
    EXPECT_EQ(read->light.file, (after / "project/city.exr").string());
    EXPECT_EQ(read->view.compare.file, (after / "project/NAME.avatar").string());
    EXPECT_EQ(read->view.compare.held->light.file, (after / "project/city.exr").string());
}

TEST(Project, WordsAreNoPathsAndOtherVolumesStayAbsolute) {
    const test::TemporaryFolder folder;
    Document document;
    for (const std::string& source : {std::string("rest:open"), "rest:" + (folder / "open").string(),
                                      std::string("rest:/proc/some/body.npz"), (folder / "open").string()}) {
        document.avatar.source = source;
        ASSERT_TRUE(saveProject(folder / "a.ars", document).ok());
        const Result<Document> read = readProject(folder / "a.ars");
        ASSERT_TRUE(read.ok());
        EXPECT_EQ(read->avatar.source, source);
    }
    const Json json = documentToJson(document, folder.path());
    EXPECT_EQ(json["avatar"]["source"], "./open");
    document.avatar.source = "rest:/proc/some/body.npz";
    EXPECT_EQ(documentToJson(document, folder.path())["avatar"]["source"], "rest:/proc/some/body.npz");
}

TEST(Project, ARelativeProjectPathIsMeantFromHere) {
    const test::TemporaryFolder folder;
    const fs::path here = fs::current_path();
    fs::current_path(folder.path());
    Document document;
    document.light.file = (fs::current_path() / "city.exr").string();
    EXPECT_TRUE(saveProject("a.ars", document).ok());
    const Result<Document> read = readProject("a.ars");
    fs::current_path(here);
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_EQ(read->light.file, document.light.file);
    EXPECT_NE(readTextFile(folder / "a.ars")->find("\"city.exr\""), std::string::npos);
}

TEST(Project, ALinkToTheFolderStillFindsItsFiles) {
    const test::TemporaryFolder folder;
    writeText(folder / "real/city.exr", "light");
    fs::create_directories(folder / "real/deep");
    fs::create_directories(folder / "elsewhere");
    Document document;
    document.light.file = (folder / "real/city.exr").string();
    ASSERT_TRUE(saveProject(folder / "real/deep/a.ars", document).ok());
    fs::create_directory_symlink(folder / "real/deep", folder / "elsewhere/link");
    const Result<Document> read = readProject(folder / "elsewhere/link/a.ars");
    ASSERT_TRUE(read.ok());
    EXPECT_TRUE(fs::exists(read->light.file)) << read->light.file;
}

TEST(Project, ErrorsNameFileKeyAndWhatWasFound) {
    const test::TemporaryFolder folder;
    const fs::path path = folder / "a.ars";
    const auto said = [&](std::string_view text) {
        writeText(path, text);
        const Result<Document> read = readProject(path);
        return read ? std::string("read") : read.error().describe();
    };
    EXPECT_EQ(said(R"({"format": 1, "light": {"exposure": "bright"}})"),
              path.string() + ": light.exposure: expected a number, found \"bright\"");
    EXPECT_NE(said("{\"format\": 1,\n \"light\": }").find("a.ars: is no sound JSON: parse error at line 2, column 11"),
              std::string::npos);
    EXPECT_NE(said("{\"format\": 1, \"light\": {\"exposure\": 1e999}}").find("is no sound JSON: number overflow"),
              std::string::npos);
    EXPECT_NE(said("{\"format\": 1, \"light\": {\"exposure\": NaN}}").find("is no sound JSON"), std::string::npos);
    EXPECT_NE(said("").find("is no sound JSON"), std::string::npos);
    EXPECT_NE(said("\xff\xfe").find("is no sound JSON"), std::string::npos);
    const Result<Document> missing = readProject(folder / "none.ars");
    ASSERT_FALSE(missing.ok());
    EXPECT_EQ(missing.error().code, ErrorCode::NotFound);
    const Result<Document> newer = (writeText(path, R"({"format": 7})"), readProject(path));
    ASSERT_FALSE(newer.ok());
    EXPECT_EQ(newer.error().code, ErrorCode::Unsupported);
    const Result<Document> aFolder = readProject(folder.path());
    ASSERT_FALSE(aFolder.ok());
}

TEST(Project, BombsAreRefusedBeforeTheyGrow) {
    const test::TemporaryFolder folder;
    const fs::path path = folder / "a.ars";
    const auto code = [&](const std::string& text) {
        writeText(path, text);
        const Result<Document> read = readProject(path);
        return read ? std::string("read") : std::string(errorCodeName(read.error().code));
    };
    EXPECT_EQ(code(std::string(1'000'000, '[')), "limit_exceeded");
    std::string nested;
    for (int i = 0; i < 100'000; ++i) nested += "{\"a\":";
    EXPECT_EQ(code(nested), "limit_exceeded");
    std::string wide = "{\"format\": 1";
    for (int i = 0; i < 200'000; ++i) wide += fmt::format(",\"{}\":1", i);
    EXPECT_EQ(code(wide + "}"), "limit_exceeded");
    EXPECT_EQ(code("{\"format\": 1, \"light\": {\"studio\": {\"lamps\": [" + std::string(9'000, ' ') + "1" +
                   [] {
                       std::string ones;
                       for (int i = 0; i < 100'000; ++i) ones += ",1";
                       return ones;
                   }() +
                   "]}}}"),
              "limit_exceeded");
    // What only looks deep, inside of text.
    EXPECT_EQ(code("{\"format\": 1, \"program\": \"" + std::string(1000, '[') + "\\\"{{{{\"}"), "read");
}

TEST(Project, EveryTruncationIsRefused) {
    const test::TemporaryFolder folder;
    const fs::path path = folder / "a.ars";
    const std::string text = documentToJson(test::changedDocument()).dump();
    for (std::size_t length = 0; length < text.size(); length += 97) {
        writeText(path, std::string_view(text).substr(0, length));
        const Result<Document> read = readProject(path);
        ASSERT_FALSE(read.ok()) << length;
        ASSERT_NE(read.error().describe().find(path.string()), std::string::npos);
    }
}

// Whatever stands in the file, reading gives a document or one sentence; and a document that was read can be written
// and read again.
TEST(Project, ChangedBytesNeverCrash) {
    const std::string sound = documentToJson(test::changedDocument()).dump();
    std::mt19937 random(11);
    const auto below = [&](std::size_t count) {
        return std::uniform_int_distribution<std::size_t>(0, count - 1)(random);
    };
    const std::string alphabet = "0123456789-+.eE\"{}[],:tfn\\ \xff\x01";
    const test::TemporaryFolder folder;
    int read = 0, refused = 0;
    for (int round = 0; round < 3000; ++round) {
        std::string text = sound;
        for (std::size_t change = 0, count = 1 + below(4); change < count; ++change) {
            const std::size_t at = below(text.size());
            switch (below(4)) {
            case 0:
                text[at] = alphabet[below(alphabet.size())];
                break;
            case 1:
                text.erase(at, 1 + below(20));
                break;
            case 2:
                text.insert(at, 1 + below(3), alphabet[below(alphabet.size())]);
                break;
            default:
                text.insert(at, text.substr(below(text.size()), below(200)));
                break;
            }
        }
        Json json = Json::parse(text, nullptr, false);
        if (round % 10 == 0) { // through the file, too
            writeText(folder / "a.ars", text);
            const Result<Document> whole = readProject(folder / "a.ars");
            ASSERT_TRUE(whole.ok() || !whole.error().describe().empty());
        }
        if (json.is_discarded()) {
            ++refused;
            continue;
        }
        const Result<Document> document = documentFromJson(json);
        if (!document) {
            ++refused;
            ASSERT_EQ(document.error().describe().find('\n'), std::string::npos);
            continue;
        }
        ++read;
        const Result<Document> again = documentFromJson(Json::parse(documentToJson(*document).dump()));
        ASSERT_TRUE(again.ok()) << again.error().describe();
        ASSERT_TRUE(*again == *document);
    }
    EXPECT_GT(read, 100) << refused;
    EXPECT_GT(refused, 100) << read;
}

TEST(Project, WhatStoodThereStaysWhenSavingFails) {
    const test::TemporaryFolder folder;
    writeText(folder / "file", "x");
    const Status saved = saveProject(folder / "file/a.ars", Document{});
    ASSERT_FALSE(saved.ok());
    EXPECT_NE(saved.error().describe().find("a.ars"), std::string::npos);
    EXPECT_EQ(*readTextFile(folder / "file"), "x");
}

Image smallPicture() {
    Image image;
    image.width = 16;
    image.height = 16;
    image.channels = 3;
    image.space = ColorSpace::Srgb;
    image.pixels.assign(16 * 16 * 3, 0.5f);
    return image;
}

TEST(PictureDocument, PngExrAndFilmBringTheDocumentBack) {
    const test::TemporaryFolder folder;
    Document document = test::changedDocument();
    document.light.file = (folder / "lights/city.exr").string();
    const std::string text = documentToJson(document, folder.path()).dump();

    PngWriteOptions png;
    png.text["ars"] = text;
    ASSERT_TRUE(writePng(folder / "a.png", smallPicture(), png).ok());
    ExrImage exr;
    exr.textAttributes["ars"] = text;
    ASSERT_TRUE(addExrLayer(exr, "", smallPicture(), "RGB").ok());
    ASSERT_TRUE(writeExr(folder / "a.exr", exr).ok());
    std::vector<std::string> names{"a.png", "a.exr"};
    VideoFormat film;
    film.width = film.height = 16;
    film.metadata["comment"] = text;
    if (auto writer = VideoWriter::open(folder / "a.mp4", film)) {
        ASSERT_TRUE(writer->add(std::vector<std::uint8_t>(16 * 16 * 3, 128)).ok());
        ASSERT_TRUE(writer->finish().ok());
        names.push_back("a.mp4");
    } else {
        test::notRun("films need ffmpeg: " + writer.error().describe());
    }
    for (const std::string& name : names) {
        const Result<Document> read = documentFromPicture(folder / name);
        ASSERT_TRUE(read.ok()) << read.error().describe();
        EXPECT_TRUE(*read == document) << name;
    }
}

TEST(PictureDocument, PicturesWithoutOneSaySo) {
    const test::TemporaryFolder folder;
    ASSERT_TRUE(writePng(folder / "a.png", smallPicture()).ok());
    ExrImage exr;
    ASSERT_TRUE(addExrLayer(exr, "", smallPicture(), "RGB").ok());
    ASSERT_TRUE(writeExr(folder / "a.exr", exr).ok());
    writeText(folder / "a.txt", "no picture at all\n");
    for (const char* name : {"a.png", "a.exr", "a.txt", "none.png"}) {
        const Result<Document> read = documentFromPicture(folder / name);
        ASSERT_FALSE(read.ok());
        EXPECT_EQ(read.error().code, ErrorCode::NotFound) << name;
        EXPECT_NE(read.error().describe().find(name), std::string::npos);
    }
    PngWriteOptions png;
    png.text["ars"] = "{\"format\": 1, \"view\": 3}";
    ASSERT_TRUE(writePng(folder / "b.png", smallPicture(), png).ok());
    const Result<Document> broken = documentFromPicture(folder / "b.png");
    ASSERT_FALSE(broken.ok());
    EXPECT_EQ(broken.error().describe(),
              (folder / "b.png").string() + ": document in the picture: view: expected an object, found 3");
}

/// What `ars render --avatar` writes into its pictures.
Json frameJson(const Camera& camera) {
    Json json{{"program", "ars 0.1.0"}, {"format", 1}, {"avatar", "rest:open"}, {"surfels", 60000}, {"device", "cpu"}};
    json["settings_given"] = {"rest.surfels=2000", "occlusion.strength=0.5"};
    Json angles = Json::array();
    for (int i = 0; i < 165; ++i) angles.push_back(i == 3 * 18 + 1 ? -0.22 : 0.0);
    json["pose"] = Json{{"axis_angle", angles}, {"translation", {0.1, 0.8, 0.0}}, {"expression", {0.25}}};
    json["camera"] = cameraToJson(camera);
    json["environment"] = Json{{"source", "studio:rim"}, {"scale", 2.0}, {"rotation_deg", 30.0}, {"filter", "exact"}};
    json["settings"] = Json{{"occlusion_method", "mesh_rays"},
                            {"splat", {{"two_sided", true}}},
                            {"pose", {{"importance_falloff", 0.25}}},
                            {"occlusion", {{"strength", 0.5}}},
                            {"radii", {{"head", 0.2}}},
                            {"shading", {{"occlude", true}, {"occlude_specular", false}, {"f0", 0.05}}}};
    json["display"] = Json{{"exposure", 1.5}, {"curve", "aces"}};
    return json;
}

TEST(PictureDocument, PicturesOfTheCommandLineAreRestored) {
    const test::TemporaryFolder folder;
    const Camera camera = lookAtCamera({1.0, 1.2, 3.0}, {0.1, 0.8, 0.0}, 40.0, 320, 240);
    PngWriteOptions png;
    png.text["ars"] = frameJson(camera).dump();
    ASSERT_TRUE(writePng(folder / "a.png", smallPicture(), png).ok());
    std::vector<std::string> notes;
    const Result<Document> read = documentFromPicture(folder / "a.png", &notes);
    ASSERT_TRUE(read.ok()) << read.error().describe();
    EXPECT_TRUE(notes.empty()) << notes.front();
    EXPECT_EQ(read->avatar.source, "rest:open");
    EXPECT_EQ(read->avatar.rest.maxSurfels, 2000);
    EXPECT_NEAR(axisAngleFromQuat(read->pose.pose.rotations[18]).y, -0.22f, 1e-6f);
    EXPECT_EQ(read->pose.pose.translation, glm::vec3(0.1f, 0.8f, 0.0f));
    EXPECT_EQ(read->pose.pose.expression, std::vector<float>{0.25f});
    EXPECT_TRUE(read->light.kind == LightKind::Studio);
    EXPECT_TRUE(read->light.studio == studioPreset(StudioPreset::Rim));
    EXPECT_EQ(read->light.exposureEv, 1.0f);
    EXPECT_EQ(read->light.rotationDeg, 30.0f);
    EXPECT_TRUE(read->occlusion.settings.method == OcclusionMethod::MeshRays);
    EXPECT_EQ(read->occlusion.settings.screenSpace.strength, 0.5f);
    EXPECT_TRUE(read->occlusion.splat.twoSided);
    EXPECT_EQ(read->occlusion.posing.importanceFalloffM, 0.25f);
    EXPECT_EQ(read->occlusion.radii[static_cast<std::size_t>(BodyPart::Head)], 0.2f);
    EXPECT_EQ(read->occlusion.shading.f0, 0.05f);
    EXPECT_EQ(read->view.tone.exposureEv, 1.5f);
    EXPECT_TRUE(read->view.tone.curve == ToneCurve::Aces);
    // The camera sees what it saw.
    const Camera restored = cameraOf(read->camera.camera, 320, 240);
    EXPECT_NEAR(restored.fy, camera.fy, 1e-6);
    for (const glm::dvec3& point : {glm::dvec3(0, 0, 0), glm::dvec3(0.5, 1.5, -0.3)}) {
        const glm::dvec2 a = camera.project(camera.toCamera(point)), b = restored.project(restored.toCamera(point));
        EXPECT_NEAR(a.x, b.x, 1e-6);
        EXPECT_NEAR(a.y, b.y, 1e-6);
    }
    EXPECT_NEAR(glm::distance(read->camera.camera.target, glm::dvec3(0.1, 0.8, 0.0)), 0.0, 1e-6);
}

TEST(PictureDocument, BrokenFramesOfTheCommandLineAreNamed) {
    const test::TemporaryFolder folder;
    const auto said = [&](const char* pointer, const Json& value) {
        Json json = frameJson(lookAtCamera({1, 1, 3}, {0, 1, 0}, 40, 320, 240));
        json[Json::json_pointer(pointer)] = value;
        PngWriteOptions png;
        png.text["ars"] = json.dump();
        EXPECT_TRUE(writePng(folder / "a.png", smallPicture(), png).ok());
        const Result<Document> read = documentFromPicture(folder / "a.png");
        return read ? std::string("read") : read.error().describe();
    };
    EXPECT_NE(said("/pose/axis_angle/7", "x").find("pose.axis_angle[7]: expected a number"), std::string::npos);
    EXPECT_NE(said("/camera/K", 3).find("camera"), std::string::npos);
    EXPECT_NE(said("/camera/t", Json::array({0, 0, "far"})).find("camera"), std::string::npos);
    EXPECT_NE(said("/settings", 3).find("settings: expected an object, found 3"), std::string::npos);
    EXPECT_NE(said("/environment/scale", -2).find("environment.scale"), std::string::npos);
    EXPECT_EQ(said("/environment/scale", 0), "read");
    EXPECT_EQ(said("/pose/axis_angle", Json::array({1, 2})), "read");
}

TEST(StateFolder, FollowsTheEnvironment) {
    const Variable own("ARS_STATE", "/tmp/own"), state("XDG_STATE_HOME", "/tmp/xdg"), home("HOME", "/home/me");
    EXPECT_EQ(stateFolder(), "/tmp/own");
    const Variable noOwn("ARS_STATE", nullptr);
    EXPECT_EQ(stateFolder(), "/tmp/xdg/ars");
    const Variable relative("XDG_STATE_HOME", "xdg");
    EXPECT_EQ(stateFolder(), "/home/me/.local/state/ars") << "a path that is not absolute does not count";
    const Variable noHome("HOME", nullptr);
    EXPECT_TRUE(stateFolder().is_absolute());
}

TEST(RecentFiles, NewestFirstEachOnceAtMostTwenty) {
    const test::TemporaryFolder folder;
    RecentFiles recent(folder.path());
    EXPECT_TRUE(recent.files().empty());
    for (int i = 0; i < 25; ++i) recent.add(fmt::format("/data/{}.ars", i));
    ASSERT_EQ(recent.files().size(), 20u);
    EXPECT_EQ(recent.files().front(), "/data/24.ars");
    EXPECT_EQ(recent.files().back(), "/data/5.ars");
    recent.add("/data/somewhere/../7.ars");
    ASSERT_EQ(recent.files().size(), 20u);
    EXPECT_EQ(recent.files().front(), "/data/7.ars");
    EXPECT_EQ(recent.files()[1], "/data/24.ars");
    recent.add("here.ars");
    EXPECT_EQ(recent.files().front(), fs::current_path() / "here.ars");
}

TEST(RecentFiles, SurviveAndAreSharedByWindows) {
    const test::TemporaryFolder folder;
    RecentFiles first(folder / "new"), second(folder / "new");
    first.add("/data/a.ars");
    second.add("/data/caf\xe9.ars");
    first.add("/data/c.ars");
    const RecentFiles third(folder / "new");
    EXPECT_EQ(third.files(), (std::vector<fs::path>{"/data/c.ars", "/data/caf\xe9.ars", "/data/a.ars"}));
    EXPECT_EQ(first.files(), third.files());
    first.clear();
    EXPECT_TRUE(RecentFiles(folder / "new").files().empty());
}

TEST(RecentFiles, ABrokenListBeginsAnew) {
    const test::TemporaryFolder folder;
    for (const char* text : {"", "{", "[1, null, {\"bytes\": \"zz\"}]", "{\"a\": 1}", "\"text\""}) {
        writeText(folder / "recent_files.json", text);
        RecentFiles recent(folder.path());
        EXPECT_TRUE(recent.files().empty()) << text;
        recent.add("/data/a.ars");
        EXPECT_EQ(RecentFiles(folder.path()).files().size(), 1u) << text;
    }
}

} // namespace
} // namespace ars
