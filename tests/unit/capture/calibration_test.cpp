// Camera files: AvatarReX calibrations and single cameras.
#include "engine/capture/calibration.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>

namespace ars {
namespace {

using Json = nlohmann::ordered_json;

/// A camera 2 m in front of the origin that looks at it, turned by 90 degrees about its axis.
Json soundCamera() {
    Json json;
    json["K"] = {500.0, 0.0, 200.0, 0.0, 510.0, 250.0, 0.0, 0.0, 1.0};
    json["R"] = {0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0};
    json["T"] = {0.5, 0.25, 2.0};
    json["imgSize"] = {384, 512};
    json["distCoeff"] = {0.0, 0.0, 0.0, 0.0, 0.0};
    return json;
}

std::string failure(const Json& json) {
    const auto cameras = camerasFromJson(json);
    EXPECT_FALSE(cameras.ok());
    return cameras.ok() ? "" : cameras.error().describe();
}

TEST(Calibration, CamerasKeepTheirOrderAndMeaning) {
    Json json;
    json["zeta"] = soundCamera();
    json["alpha"] = soundCamera();
    json["alpha"]["K"] = Json::parse("[[600, 0, 1], [0, 600, 2], [0, 0, 1]]"); // nested lists are as good
    json["alpha"]["distCoeff"] = {0.1, 0.0};
    json["alpha"]["rectifyAlpha"] = 0;
    EXPECT_TRUE(looksLikeCalibration(json));
    const auto cameras = camerasFromJson(json);
    ASSERT_TRUE(cameras.ok()) << cameras.error().describe();
    ASSERT_EQ(cameras->size(), 2u);
    EXPECT_EQ((*cameras)[0].name, "zeta");
    const Camera& camera = (*cameras)[0].camera;
    EXPECT_TRUE(validateCamera(camera).ok());
    EXPECT_EQ(camera.width, 384);
    EXPECT_EQ(camera.height, 512);
    EXPECT_EQ(camera.fx, 500.0);
    EXPECT_EQ(camera.fy, 510.0);
    EXPECT_EQ(camera.cx, 200.0);
    EXPECT_EQ(camera.cy, 250.0);
    // x_cam = R x + T with R's rows as they stand: world x goes to camera y.
    EXPECT_LT(glm::distance(camera.toCamera({1.0, 0.0, 0.0}), glm::dvec3(0.5, 1.25, 2.0)), 1e-12);
    EXPECT_FALSE((*cameras)[0].distorted());
    EXPECT_TRUE((*cameras)[1].distorted());
    EXPECT_NEAR((*cameras)[0].verticalFieldDeg(),
                (std::atan(250.0 / 510.0) + std::atan(262.0 / 510.0)) * 180.0 / 3.14159265358979, 1e-9);
    EXPECT_EQ(findCamera(*cameras, "alpha")->camera.cx, 1.0);
    const auto absent = findCamera(*cameras, "beta");
    EXPECT_EQ(absent.error().code, ErrorCode::NotFound);
    EXPECT_EQ(absent.error().describe(),
              "camera \"beta\": there is no camera of this name; there are \"zeta\", \"alpha\"");
}

TEST(Calibration, EveryFaultIsNamed) {
    struct Case {
        const char* key;
        Json value;
        const char* message;
    };
    const std::vector<Case> cases{
        {"K", {1, 2, 3, 4, 5, 6, 7, 8}, "camera \"c\": K has 8 numbers, expected 9 (row-major 3x3)"},
        {"K", "none", "camera \"c\": K is no list of numbers"},
        {"K", {0.0, 0, 1, 0, 5, 1, 0, 0, 1}, "camera \"c\": focal lengths in K must be positive, found 0 and 5"},
        {"K", {5, 0, 1, 0, 5, 1, 0, 0, 2}, "camera \"c\": K must have the form [fx s cx; 0 fy cy; 0 0 1]"},
        {"K",
         {500, 0.01, 1, 0, 5, 1, 0, 0, 1},
         "camera \"c\": K has a skew of 0.01 pixels; only cameras without skew are read"},
        {"R", {1, 0, 0, 0, 1, 0, 0, 0, 1.1}, "camera \"c\": R is no rotation: R^T R is off the identity by 0.21"},
        {"R", {1, 0, 0, 0, 1, 0, 0, 0, -1}, "camera \"c\": R mirrors, expected a rotation"},
        {"T", {1, 2}, "camera \"c\": T has 2 numbers, expected 3 (x y z in metres)"},
        {"T", {1}, "camera \"c\": T has 1 number, expected 3 (x y z in metres)"},
        {"imgSize", {0, 5}, "camera \"c\": imgSize must be positive whole numbers up to 32768, found 0 x 5"},
        {"imgSize", {1e9, 5}, "camera \"c\": imgSize must be positive whole numbers up to 32768, found 1e+09 x 5"},
        {"imgSize", {5.5, 5}, "camera \"c\": imgSize must be positive whole numbers up to 32768, found 5.5 x 5"},
        {"distCoeff", {"a"}, "camera \"c\": distCoeff is no list of numbers"},
    };
    for (const Case& c : cases) {
        Json json;
        json["c"] = soundCamera();
        json["c"][c.key] = c.value;
        EXPECT_EQ(failure(json), c.message);
    }
    for (const char* key : {"K", "R", "T", "imgSize"}) {
        Json json;
        json["c"] = soundCamera();
        json["c"].erase(key);
        EXPECT_EQ(failure(json), fmt::format("camera \"c\": {} is missing", key));
    }
    Json skewed;
    skewed["c"] = soundCamera();
    skewed["c"]["K"][1] = 1.0;
    EXPECT_EQ(camerasFromJson(skewed).error().code, ErrorCode::Unsupported);
    skewed["c"]["K"][1] = 4e-4; // within 1e-6 fx
    EXPECT_TRUE(camerasFromJson(skewed).ok());
    EXPECT_EQ(failure(Json::object()), "the calibration has no camera");
    EXPECT_EQ(failure(Json::array()), "the calibration has no camera");
    EXPECT_EQ(failure(Json{{"c", 5}}), "camera \"c\": expected an object with K, R, T and imgSize");
    EXPECT_FALSE(looksLikeCalibration(Json{{"joints", Json::object()}}));
}

TEST(Calibration, OneCameraReadsBackExactly) {
    Camera camera = lookAtCamera({1.0, 1.7, 3.1}, {0.0, 0.9, 0.0}, 33.3, 640, 480);
    camera.cx += 0.1;
    camera.fy *= 1.01;
    const auto back = cameraFromJson(Json::parse(cameraToJson(camera).dump()));
    ASSERT_TRUE(back.ok()) << back.error().describe();
    EXPECT_EQ(back->width, 640);
    EXPECT_EQ(back->height, 480);
    EXPECT_EQ(back->fx, camera.fx);
    EXPECT_EQ(back->fy, camera.fy);
    EXPECT_EQ(back->cx, camera.cx);
    EXPECT_EQ(back->cy, camera.cy);
    EXPECT_EQ(back->rotation, camera.rotation);
    EXPECT_EQ(back->translation, camera.translation);
    EXPECT_FALSE(looksLikeCalibration(cameraToJson(camera)));

    Json json = cameraToJson(camera);
    json["K"] = {500.0, 0.0, 200.0, 0.0, 510.0, 250.0, 0.0, 0.0, 1.0};
    EXPECT_EQ(cameraFromJson(json)->fy, 510.0) << "a flat list is taken too";
    json.erase("t");
    EXPECT_EQ(cameraFromJson(json).error().describe(), "camera: t is missing");
    json = cameraToJson(camera);
    json["width"] = "wide";
    EXPECT_EQ(cameraFromJson(json).error().describe(), "camera: width is no list of numbers");
    json["width"] = -4;
    EXPECT_EQ(cameraFromJson(json).error().code, ErrorCode::BadFile);
    EXPECT_EQ(cameraFromJson(Json(3)).error().code, ErrorCode::BadFile);
}

TEST(Calibration, FilesAndArgumentsOfTheCommandLine) {
    test::TemporaryFolder folder;
    Json two;
    two["left"] = soundCamera();
    two["right:1"] = soundCamera();
    two["right:1"]["imgSize"] = {100, 50};
    const std::string both = (folder / "two.json").string(), single = (folder / "one.json").string();
    ASSERT_TRUE(writeFileAtomic(both, two.dump()).ok());
    ASSERT_TRUE(writeFileAtomic(single, cameraToJson(lookAtCamera({0, 0, 2}, {0, 0, 0}, 40, 64, 32)).dump()).ok());

    EXPECT_EQ(readCalibration(both)->size(), 2u);
    EXPECT_EQ(readCameraJson(single)->width, 64);
    EXPECT_EQ(readCameraArgument(single)->camera.height, 32);
    EXPECT_EQ(readCameraArgument(both + ":left")->name, "left");
    const auto several = readCameraArgument(both);
    EXPECT_EQ(several.error().code, ErrorCode::InvalidArgument);
    EXPECT_NE(several.error().describe().find("holds 2 cameras; add one's name after a colon: \"left\""),
              std::string::npos);
    EXPECT_EQ(readCameraArgument(both + ":middle").error().code, ErrorCode::NotFound);
    EXPECT_NE(readCameraArgument(both + ":middle").error().describe().find(both), std::string::npos);
    EXPECT_EQ(readCameraArgument((folder / "absent.json").string()).error().code, ErrorCode::NotFound);

    ASSERT_TRUE(writeFileAtomic(folder / "bad.json", std::string_view("{\"K\": [1,")).ok());
    for (const Error& error :
         {readCalibration(folder / "bad.json").error(), readCameraJson(folder / "bad.json").error()}) {
        EXPECT_EQ(error.code, ErrorCode::BadFile);
        EXPECT_NE(error.describe().find("bad.json: is no sound JSON: parse error at line 1"), std::string::npos)
            << error.describe();
    }
    ASSERT_TRUE(writeFileAtomic(folder / "deep.json", std::string(200000, '[')).ok());
    EXPECT_EQ(readCameraJson(folder / "deep.json").error().code, ErrorCode::BadFile);
}

TEST(Calibration, TheCaptureHasTwelveCamerasThatSeeTheOrigin) {
    ARS_TEST_DATA_FILE(path, "capture/casual/calibration_full.json");
    const auto cameras = readCalibration(path);
    ASSERT_TRUE(cameras.ok()) << cameras.error().describe();
    ASSERT_EQ(cameras->size(), 12u);
    EXPECT_EQ(cameras->front().name, "24110001");
    EXPECT_EQ(cameras->back().name, "24110012");
    for (const CalibratedCamera& camera : *cameras) {
        EXPECT_TRUE(validateCamera(camera.camera, camera.name).ok());
        const glm::dvec3 middle = camera.camera.toCamera({0.0, 0.9, 0.0}); // of the person
        const glm::dvec2 pixel = camera.camera.project(middle);
        EXPECT_GT(middle.z, 1.0);
        EXPECT_TRUE(pixel.x > 0 && pixel.x < camera.camera.width && pixel.y > 0 && pixel.y < camera.camera.height);
    }
}

} // namespace
} // namespace ars
