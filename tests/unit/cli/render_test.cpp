// `ars render`, `ars stage` and `ars light` as people run them.
#include "engine/io/exr.h"
#include "engine/io/image_file.h"
#include "engine/io/png.h"
#include "engine/rig/motion.h"
#include "engine/scene/project.h"

#include "tests/unit/cli/run_ars.h"

#include <cmath>

namespace ars::test {
namespace {

using Words = std::vector<std::string>;

/// Small and quick: few surfels, few pixels, a coarse light.
Words quick(Words more) {
    Words words{"render",
                "--avatar",
                "rest:open",
                "--surfels",
                "8000",
                "--size",
                "96x128",
                "--light-size",
                "64",
                "--set",
                "occlusion.adaptive=off",
                "--device",
                "cpu"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
}

void writeWave(const std::filesystem::path& path, int frames) {
    Motion motion;
    motion.framesPerSecond = 25;
    for (int i = 0; i < frames; ++i) {
        Pose pose = restPose(kSmplxJointCount);
        pose.rotations[16] = quatFromAxisAngle({0, 0, -0.1f * static_cast<float>(i)});
        motion.frames.push_back(pose);
    }
    ASSERT_TRUE(writeSmplParams(path, motion).ok());
}

TEST(Render, APictureCarriesWhatMadeIt) {
    const TemporaryFolder folder;
    const auto result = runArs(quick(
        {"--env", "studio:rim", "--env-rotation", "40", "--radius", "0.1", "--out", folder.path().string(), "--json"}));
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_EQ(namesIn(folder.path()), Words{"0000.png"});
    const auto png = readPng(folder / "0000.png");
    ASSERT_TRUE(png.ok());
    EXPECT_EQ(png->image.width, 96);
    EXPECT_EQ(png->image.height, 128);
    const auto document = nlohmann::json::parse(png->text.at("ars"));
    EXPECT_EQ(document["picture"]["camera"]["width"], 96);
    EXPECT_EQ(document["picture"]["device"], "cpu");
    EXPECT_GT(document["picture"]["surfels"].get<int>(), 4000);
    // It is the document of a session that shows the same.
    std::vector<std::string> notes;
    const auto restored = documentFromPicture(folder / "0000.png", &notes);
    ASSERT_TRUE(restored.ok()) << restored.error().describe();
    EXPECT_TRUE(notes.empty()) << notes.front();
    EXPECT_EQ(restored->avatar.source, "rest:open");
    EXPECT_EQ(restored->avatar.rest.maxSurfels, 8000);
    EXPECT_EQ(restored->light.kind, LightKind::Studio);
    EXPECT_EQ(studioToJson(restored->light.studio), studioToJson(studioPreset(StudioPreset::Rim)));
    EXPECT_EQ(restored->light.rotationDeg, 40.0f);
    EXPECT_EQ(restored->occlusion.radii, uniformPartRadii(0.1f));
    EXPECT_EQ(restored->occlusion.settings.screenSpace.adaptive, OcclusionAdaptive::Off);
    EXPECT_EQ(restored->pose.pose.rotations.size(), 55u);
    const auto again = runArs({"render", "--project", (folder / "0000.png").string(), "--size", "96x128", "--device",
                               "cpu", "--out", (folder / "again.png").string()});
    ASSERT_EQ(again.exitCode, 0) << again.errors;
    const auto second = readPng(folder / "again.png");
    ASSERT_TRUE(second.ok());
    ASSERT_EQ(second->image.pixels.size(), png->image.pixels.size());
    for (std::size_t i = 0; i < png->image.pixels.size(); ++i) {
        // The session filters its light from the full base, not from --light-size 64.
        ASSERT_NEAR(second->image.pixels[i], png->image.pixels[i], 4.0f / 255.0f);
    }
    EXPECT_TRUE(*documentFromPicture(folder / "again.png") == *restored);
    const auto json = parsed(result);
    EXPECT_EQ(json["frames"], 1);
    EXPECT_EQ(json["files"].size(), 1u);
    EXPECT_GT(json["stages_ms"]["splat"].get<double>(), 0.0);
    bool splatMemory = false;
    for (const auto& use : json["memory"]) {
        splatMemory = splatMemory || (use["owner"].get<std::string>().starts_with("splat") && use["peak_bytes"] > 0);
    }
    EXPECT_TRUE(splatMemory) << json["memory"];
    // There is a body in the middle and background in the corner.
    const glm::vec3 corner(png->image.at(0, 0, 0), png->image.at(0, 0, 1), png->image.at(0, 0, 2));
    EXPECT_NEAR(corner.x, 0.5f, 0.003f);
    EXPECT_GT(std::abs(png->image.at(50, 48, 0) - 0.5f) + std::abs(png->image.at(64, 48, 0) - 0.5f), 0.01f);
}

TEST(Render, EveryBufferIsALayerOfTheExr) {
    const TemporaryFolder folder;
    const auto result = runArs(quick({"--aov", "all", "--write", "exr,buffers", "--out", folder.path().string()}));
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    const auto exr = readExr(folder / "0000.exr");
    ASSERT_TRUE(exr.ok()) << exr.error().describe();
    for (const char* name :
         {"R", "G", "B", "A", "radiance.R", "albedo.G", "roughness.Y", "normal.X", "depth.Z", "position.Y", "ao.Y",
          "radius.Y", "importance.Y", "bone.Z", "opacity.Y", "diffuse.B", "specular.R"}) {
        EXPECT_NE(exr->find(name), nullptr) << name;
    }
    EXPECT_EQ(exr->find("radius_plus.Y"), nullptr) << "R+ is training's";
    EXPECT_EQ(nlohmann::json::parse(exr->textAttributes.at("ars"))["avatar"]["source"], "rest:open");
    EXPECT_EQ(namesIn(folder.path()).size(), 15u) << "an EXR and a PNG for each of fourteen buffers";
    // Empty pixels are 0 in every layer, and normals face the camera.
    const std::vector<float>& opacity = exr->find("opacity.Y")->pixels;
    for (const ExrChannel& channel : exr->channels) {
        for (std::size_t p = 0; p < opacity.size(); ++p) {
            ASSERT_TRUE(std::isfinite(channel.pixels[p])) << channel.name;
            ASSERT_TRUE(opacity[p] != 0.0f || channel.pixels[p] == 0.0f) << channel.name;
        }
    }
    for (std::size_t p = 0; p < opacity.size(); ++p) {
        ASSERT_TRUE(opacity[p] < 0.5f || exr->find("normal.Z")->pixels[p] < 0.05f);
    }
}

TEST(Render, AMotionUnderATurningCameraAndLightBecomesAFilm) {
    const TemporaryFolder folder;
    writeWave(folder / "wave.npz", 6);
    const auto out = folder / "film";
    const auto result = runArs(quick({"--motion", (folder / "wave.npz").string(), "--frames", "1:5", "--orbit", "8",
                                      "--env-orbit", "4", "--write", "png,mp4", "--out", out.string()}));
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_EQ(namesIn(out), (Words{"0001.png", "0002.png", "0003.png", "0004.png", "beauty.mp4"}));
    const auto probe = runProcess({"ffprobe", "-v", "error", "-count_frames", "-show_entries",
                                   "stream=nb_read_frames,r_frame_rate:format_tags=comment", "-of", "json",
                                   (out / "beauty.mp4").string()});
    ASSERT_TRUE(probe.ok());
    const auto json = nlohmann::json::parse(probe->output);
    EXPECT_EQ(json["streams"][0]["nb_read_frames"], "4");
    EXPECT_EQ(json["streams"][0]["r_frame_rate"], "25/1");
    const auto film = nlohmann::json::parse(json["format"]["tags"]["comment"].get<std::string>());
    EXPECT_EQ(film["avatar"]["source"], "rest:open");
    const auto second = documentFromPicture(out / "0002.png");
    ASSERT_TRUE(second.ok()) << second.error().describe();
    EXPECT_EQ(second->light.rotationDeg, 90.0f);
    EXPECT_EQ(second->timeline.clip, (folder / "wave.npz").string()) << "the motion comes along";
    EXPECT_NEAR(second->timeline.timeS, 2.0 / 25.0, 1e-9);
    EXPECT_NE(readPng(out / "0001.png")->image.pixels, readPng(out / "0002.png")->image.pixels);
}

TEST(Render, AProjectBecomesPicturesOrAFilm) {
    const TemporaryFolder folder;
    Document document = newDocument();
    document.avatar.rest.maxSurfels = 6000;
    document.occlusion.settings.screenSpace.adaptive = OcclusionAdaptive::Off;
    document.view.buffer = BufferId::Normal;
    JointTrack track;
    track.joint = smplxJointIndex("left_elbow");
    track.keys = {{0.0, glm::quat(1, 0, 0, 0)}, {1.0, quatFromAxisAngle({0, -1.2f, 0})}};
    document.timeline.joints = {track};
    document.timeline.endS = 1.0;
    document.timeline.framesPerSecond = 4.0;
    const auto project = folder / "wave.ars";
    ASSERT_TRUE(saveProject(project, document).ok());
    const Words common{"--size", "60x80", "--device", "cpu"};
    const auto render = [&](Words words) {
        words.insert(words.begin(), "render");
        words.insert(words.end(), common.begin(), common.end());
        return runArs(words);
    };
    auto result = render({"--project", project.string(), "--out", (folder / "still").string(), "--aov", "depth"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_EQ(namesIn(folder / "still"), (Words{"0000.exr", "0000.png"}));
    const Image still = readPng(folder / "still" / "0000.png")->image;
    EXPECT_EQ(still.width, 60);
    EXPECT_TRUE(*documentFromPicture(folder / "still" / "0000.png") == document);
    EXPECT_EQ(readExr(folder / "still" / "0000.exr")->channels.size(), 1u);

    // --avatar takes a project, too.
    result = render({"--avatar", project.string(), "--film", "--out", (folder / "film").string()});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_EQ(namesIn(folder / "film"), (Words{"0000.png", "0001.png", "0002.png", "0003.png", "beauty.mp4"}));
    EXPECT_EQ(readPng(folder / "film" / "0000.png")->image.pixels, still.pixels) << "time 0 is the document's";
    EXPECT_NE(readPng(folder / "film" / "0003.png")->image.pixels, still.pixels);

    result = render({"--project", project.string(), "--film", "--range", "0.5:1", "--fps", "8", "--out",
                     (folder / "short.mp4").string(), "--json"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_EQ(parsed(result)["frames"], 4);
    EXPECT_TRUE(*documentFromPicture(folder / "short.mp4") == document);

    const struct {
        Words words;
        std::string expected;
    } wrong[] = {
        {{"--project", project.string(), "--pose", "rest", "--out", "x"}, "--pose"},
        {{"--project", project.string(), "--range", "0:1", "--out", "x"}, "--film"},
        {{"--project", project.string(), "--film", "--range", "1:0", "--out", "x"}, "--range"},
        {{"--project", project.string(), "--film", "--out", "x.png"}, "--out"},
        {{"--film", "--avatar", "rest:open", "--out", "x"}, "--project"},
        {{"--out", "x"}, "--avatar"},
    };
    for (const auto& row : wrong) {
        result = render(row.words);
        EXPECT_EQ(result.exitCode, 2) << row.expected << result.errors;
        EXPECT_NE(result.errors.find(row.expected), std::string::npos) << row.expected << " not in: " << result.errors;
    }
    writeText(folder / "broken.ars", "{\"format\": 1, \"avatar\": 3}");
    expectOneError(render({"--project", (folder / "broken.ars").string(), "--out", "x"}), {"broken.ars", "avatar"});
}

TEST(Render, WithoutWindowTheProgramRendersATurntable) {
    const TemporaryFolder folder;
    ProcessOptions options;
    options.workingFolder = folder.path();
    options.environment = {{"DISPLAY", ""}, {"WAYLAND_DISPLAY", ""}};
    const auto result = runArs({}, options);
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_NE(result.output.find("ars-turntable"), std::string::npos);
    EXPECT_TRUE(std::filesystem::exists(folder / "ars-turntable" / "beauty.mp4"));
    EXPECT_TRUE(std::filesystem::exists(folder / "ars-turntable" / "0047.png"));
}

TEST(Render, WrongUsageIsSaidInOneSentence) {
    const TemporaryFolder folder;
    const struct {
        Words words;
        std::string expected;
    } rows[] = {
        {{"--size", "0x10"}, "--size: expected WIDTHxHEIGHT"},
        {{"--size", "10x99999"}, "--size: expected WIDTHxHEIGHT"},
        {{"--aov", "albedo,colour"}, "no buffer \"colour\""},
        {{"--occlusion", "ssao"}, "no method \"ssao\""},
        {{"--radius", "-1"}, "--radius: expected metres"},
        {{"--radius", "tail=0.1"}, "no part \"tail\""},
        {{"--set", "occlusion.thick=1"}, "occlusion.thick"},
        {{"--set", "occlusion.steps=1000"}, "steps"},
        {{"--set", "rest.scale=1"}, "rest.scale"},
        {{"--set", "nothing.x=1"}, "no group \"nothing\""},
        {{"--curve", "film"}, "--curve"},
        {{"--background", "2"}, "--background"},
        {{"--env", "studio:dark"}, "studio:three_point"},
        {{"--env-scale", "-1"}, "--env-scale"},
        {{"--device", "gpu"}, "gpu"},
        {{"--write", "gif"}, "found \"gif\""},
        {{"--frames", "0:3"}, "needs --motion"},
        {{"--transparent", "--backdrop"}, "--transparent"},
    };
    for (const auto& row : rows) {
        Words words{"render", "--avatar", "rest:open", "--surfels", "500"};
        words.insert(words.end(), row.words.begin(), row.words.end());
        words.insert(words.end(), {"--out", (folder / "out").string()});
        const auto result = runArs(words);
        EXPECT_EQ(result.exitCode, 2) << row.expected << result.errors;
        EXPECT_NE(result.errors.find(row.expected), std::string::npos) << row.expected << " not in: " << result.errors;
        EXPECT_FALSE(std::filesystem::exists(folder / "out"));
    }
    EXPECT_EQ(runArs({"render", "--avatar", "trained.avatar", "--out", "x"}).exitCode, 2);
}

TEST(Render, BadFilesAreNamed) {
    const TemporaryFolder folder;
    writeText(folder / "camera.json", R"({"width":64,"height":64,"K":[[100,0,32],[0,100,32],[0,0,1]],)"
                                      R"("R":[[1,0,0],[0,1,0],[0,0,0]],"t":[0,0,2]})");
    expectOneError(runArs(quick({"--camera", (folder / "camera.json").string(), "--out", (folder / "o").string()})),
                   {"camera.json", "R"});
    writeText(folder / "camera.json", R"({"width":64,"height":64,"K":[[NaN,0,32],[0,100,32],[0,0,1]]})");
    expectOneError(runArs(quick({"--camera", (folder / "camera.json").string(), "--out", (folder / "o").string()})),
                   {"camera.json"});
    writeText(folder / "light.exr", "no picture");
    expectOneError(runArs(quick({"--env", (folder / "light.exr").string(), "--out", (folder / "o").string()})),
                   {"light.exr"});
    expectOneError(runArs({"render", "--avatar", "rest:" + (folder / "none.glb").string(), "--out", "x"}),
                   {"none.glb"});
    EXPECT_FALSE(std::filesystem::exists(folder / "o"));
}

/// The stages alone, one after the other, give what the pipeline gives.
TEST(Stage, SplatOccludeAndShadeWorkOnFiles) {
    const TemporaryFolder folder;
    const std::string camera = (folder / "camera.json").string();
    writeText(camera, R"({"width":64,"height":48,"K":[[80,0,32],[0,80,24],[0,0,1]],)"
                      R"("R":[[1,0,0],[0,1,0],[0,0,1]],"t":[0,0,0]})");
    // A sheet of surfels two metres away that faces the camera: normal -z is a half turn about x.
    std::string ply = "ply\nformat ascii 1.0\nelement vertex 100\n";
    for (const char* name : {"x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "opacity",
                             "f_dc_0", "f_dc_1", "f_dc_2", "albedo_0", "albedo_1", "albedo_2", "roughness", "radius"}) {
        ply += std::string("property float ") + name + "\n";
    }
    ply += "end_header\n";
    for (int i = 0; i < 100; ++i) {
        ply += std::to_string(0.05 * (i % 10) - 0.225) + " " + std::to_string(0.05 * (i / 10) - 0.225) +
               " 2 0 1 0 0 -3.2 -3.2 4 0 0 0 0.5 0.25 0.125 0.6 0.2\n";
    }
    writeText(folder / "sheet.ply", ply);
    const std::string buffers = (folder / "buffers.exr").string();
    auto result =
        runArs({"stage", "splat", (folder / "sheet.ply").string(), "--camera", camera, "--out", buffers, "--json"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_EQ(parsed(result)["fates"]["visible"], 100);
    const auto exr = readExr(buffers);
    ASSERT_TRUE(exr.ok());
    const std::size_t middle = 24 * 64 + 32;
    EXPECT_NEAR(exr->find("depth.Z")->pixels[middle], 2.0f, 1e-4);
    EXPECT_NEAR(exr->find("normal.Z")->pixels[middle], -1.0f, 1e-3);
    EXPECT_NEAR(exr->find("albedo.G")->pixels[middle], 0.25f, 1e-3);
    EXPECT_NEAR(exr->find("radiance.R")->pixels[middle], 0.5f, 1e-3);

    const std::string occluded = (folder / "ao.exr").string();
    result = runArs({"stage", "occlude", buffers, "--camera", camera, "--out", occluded, "--json"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_NEAR(parsed(result)["mean"].get<double>(), 1.0, 1e-3) << "a flat sheet is open";

    const std::string shaded = (folder / "shaded.exr").string();
    result = runArs(
        {"stage", "shade", buffers, "--camera", camera, "--env", "uniform", "--light-size", "64", "--out", shaded});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    const auto picture = readExr(shaded);
    ASSERT_TRUE(picture.ok());
    // White furnace: diffuse light is the albedo.
    EXPECT_NEAR(picture->find("diffuse.R")->pixels[middle], 0.5f, 2e-3);
    EXPECT_NEAR(picture->find("diffuse.B")->pixels[middle], 0.125f, 2e-3);
    EXPECT_GT(picture->find("specular.R")->pixels[middle], 0.01f);

    // What is missing is named.
    expectOneError(runArs({"stage", "occlude", shaded, "--camera", camera, "--out", occluded}),
                   {"shaded.exr", "depth"});
    expectOneError(runArs({"stage", "shade", occluded, "--camera", camera, "--out", shaded}), {"ao.exr", "albedo"});
    writeText(folder / "other.json", R"({"width":32,"height":48,"K":[[80,0,32],[0,80,24],[0,0,1]],)"
                                     R"("R":[[1,0,0],[0,1,0],[0,0,1]],"t":[0,0,0]})");
    expectOneError(
        runArs({"stage", "occlude", buffers, "--camera", (folder / "other.json").string(), "--out", occluded}),
        {"64x48", "32x48"});
    EXPECT_EQ(runArs({"stage", "splat", (folder / "sheet.ply").string(), "--out", buffers}).exitCode, 2);
}

TEST(Stage, AnEmptySetOfSurfelsIsAnEmptyPicture) {
    const TemporaryFolder folder;
    writeText(folder / "camera.json", R"({"width":8,"height":8,"K":[[8,0,4],[0,8,4],[0,0,1]],)"
                                      R"("R":[[1,0,0],[0,1,0],[0,0,1]],"t":[0,0,0]})");
    std::string ply = "ply\nformat ascii 1.0\nelement vertex 0\n";
    for (const char* name : {"x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "opacity"}) {
        ply += std::string("property float ") + name + "\n";
    }
    writeText(folder / "none.ply", ply + "end_header\n");
    const auto result = runArs({"stage", "splat", (folder / "none.ply").string(), "--camera",
                                (folder / "camera.json").string(), "--out", (folder / "none.exr").string()});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    const auto exr = readExr(folder / "none.exr");
    ASSERT_TRUE(exr.ok());
    for (const ExrChannel& channel : exr->channels) {
        for (const float value : channel.pixels) EXPECT_EQ(value, 0.0f) << channel.name;
    }
}

TEST(Stage, MapsOfTheOpenBodyHaveTwoEqualSilhouettes) {
    const TemporaryFolder folder;
    const std::string out = (folder / "maps.exr").string();
    const auto result = runArs({"stage", "maps", "open", "--size", "64", "--out", out, "--json"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    const auto exr = readExr(out);
    ASSERT_TRUE(exr.ok());
    const std::vector<float>& mask = exr->find("mask.Y")->pixels;
    std::size_t points = 0;
    for (std::size_t row = 0; row < 64; ++row) {
        for (std::size_t column = 0; column < 64; ++column) {
            EXPECT_EQ(mask[row * 128 + column], mask[row * 128 + 64 + column]);
            points += mask[row * 128 + column] > 0 ? 2u : 0u;
        }
    }
    EXPECT_EQ(parsed(result)["points"], points);
    EXPECT_GT(points, 500u);
    for (const char* name : {"canonical.X", "canonical_normal.Z", "posed.Y", "deformation.Y", "deformation_direction.X",
                             "body_distance.Y"}) {
        EXPECT_NE(exr->find(name), nullptr) << name;
    }
}

TEST(Light, GeneratesConvertsTurnsAndPrefilters) {
    const TemporaryFolder folder;
    const std::string sky = (folder / "sky.exr").string();
    auto result = runArs({"light", "sky", "--set", "sun_elevation=30", "--out", sky, "--json"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    const auto facts = parsed(result);
    const double y = facts["brightest_direction"][1];
    EXPECT_NEAR(std::asin(y) * 180 / 3.14159265, 30.0, 0.5) << "the sun stands where it was put";
    // Turned by 90 degrees, what shone from azimuth a shines from a + 90.
    result = runArs({"light", sky, "--rotation", "90", "--out", (folder / "turned.exr").string(), "--json"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    const auto turned = parsed(runArs({"light", (folder / "turned.exr").string(), "--json"}));
    const auto azimuth = [](const nlohmann::json& json) {
        return std::atan2(json["brightest_direction"][0].get<double>(), json["brightest_direction"][2].get<double>()) *
               180 / 3.14159265;
    };
    EXPECT_NEAR(std::remainder(azimuth(turned) - azimuth(facts) - 90.0, 360.0), 0.0, 0.6);
    const auto levels = folder / "levels";
    result = runArs({"light", sky, "--prefilter", levels.string(), "--light-size", "64", "--device", "cpu"});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    EXPECT_EQ(namesIn(levels),
              (Words{"irradiance.exr", "specular_0.exr", "specular_1.exr", "specular_2.exr", "split_sum.exr"}));
    const auto cube = folder / "cube.exr";
    result = runArs({"light", sky, "--cube", "32", "--out", cube.string()});
    ASSERT_EQ(result.exitCode, 0) << result.errors;
    const auto strip = readImageFile(cube);
    ASSERT_TRUE(strip.ok());
    EXPECT_EQ(strip->width, 6 * 32);
    const auto back = parsed(runArs({"light", cube.string(), "--json"}));
    EXPECT_NEAR(back["mean_radiance"][1].get<double>(), facts["mean_radiance"][1].get<double>(),
                0.02 * facts["mean_radiance"][1].get<double>())
        << "a cube read again holds the same light";
    EXPECT_EQ(runArs({"light", "sky", "--out", (folder / "sky.gif").string()}).exitCode, 2);
    EXPECT_EQ(runArs({"light", "sky", "--set", "sunny=1"}).exitCode, 2);
}

} // namespace
} // namespace ars::test
