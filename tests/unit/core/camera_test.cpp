#include "engine/core/camera.h"

#include "engine/core/image_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace ars {
namespace {

Camera someCamera() {
    Camera camera = lookAtCamera({1.0, 1.5, 3.0}, {0.0, 0.9, 0.0}, 40.0, 320, 240);
    camera.cx += 12.25;
    camera.cy -= 3.5;
    return camera;
}

TEST(Camera, LookAtSeesTheTargetInTheMiddleAndUpIsUp) {
    const Camera camera = lookAtCamera({1.0, 1.5, 3.0}, {0.0, 0.9, 0.0}, 40.0, 320, 240);
    ASSERT_TRUE(validateCamera(camera).ok());
    const glm::dvec2 middle = camera.project(camera.toCamera({0.0, 0.9, 0.0}));
    EXPECT_NEAR(middle.x, 160.0, 1e-9);
    EXPECT_NEAR(middle.y, 120.0, 1e-9);
    EXPECT_LT(camera.project(camera.toCamera({0.0, 1.9, 0.0})).y, 120.0) << "rows grow downwards";
    EXPECT_NEAR(glm::length(camera.centerWorld() - glm::dvec3(1.0, 1.5, 3.0)), 0.0, 1e-12);
    // The upper edge is half the field away from the axis.
    EXPECT_NEAR(std::atan(camera.ray(160.0, 0.0).y) * 180.0 / 3.14159265358979, -20.0, 1e-9);
}

TEST(Camera, FromTheFrontTheBodysLeftIsOnTheRight) {
    const Camera camera = lookAtCamera({0.0, 1.0, 3.0}, {0.0, 1.0, 0.0}, 40.0, 320, 240);
    EXPECT_GT(camera.project(camera.toCamera({0.5, 1.0, 0.0})).x, 160.0);
}

TEST(Camera, StraightDownIsDefined) {
    EXPECT_TRUE(validateCamera(lookAtCamera({0, 3, 0}, {0, 0, 0}, 40.0, 320, 240)).ok());
    EXPECT_TRUE(validateCamera(lookAtCamera({0, 3, 0}, {0, 3, 0}, 40.0, 320, 240)).ok());
}

TEST(Camera, ProjectionAndRaysAreInverse) {
    const Camera camera = someCamera();
    const glm::dvec3 world(0.2, 1.1, -0.1);
    const glm::dvec3 seen = camera.toCamera(world);
    const glm::dvec2 pixel = camera.project(seen);
    EXPECT_NEAR(glm::length(camera.toWorld(camera.ray(pixel.x, pixel.y) * seen.z) - world), 0.0, 1e-12);
    const auto single = camera.as<float>();
    EXPECT_NEAR(single.project(single.toCamera(glm::vec3(world))).x, pixel.x, 1e-3);
}

TEST(Camera, AResizedPictureShowsTheSame) {
    const Camera camera = someCamera();
    const Camera small = resizedCamera(camera, 160, 60);
    const glm::dvec2 before = camera.project({0.1, 0.2, 2.0});
    const glm::dvec2 after = small.project({0.1, 0.2, 2.0});
    EXPECT_NEAR(after.x / 160, before.x / 320, 1e-12);
    EXPECT_NEAR(after.y / 60, before.y / 240, 1e-12);
}

TEST(Camera, SingularInfiniteAndMirroredCamerasAreRefused) {
    const auto message = [](auto change) {
        Camera camera = someCamera();
        change(camera);
        const Status status = validateCamera(camera, "camera \"7\"");
        EXPECT_FALSE(status.ok());
        return status.ok() ? std::string() : status.error().describe();
    };
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_NE(message([](Camera& c) { c.width = 0; }).find("0x240"), std::string::npos);
    EXPECT_NE(message([](Camera& c) { c.height = 1 << 20; }).find("32768"), std::string::npos);
    EXPECT_NE(message([](Camera& c) { c.fy = 0; }).find("focal"), std::string::npos);
    EXPECT_NE(message([&](Camera& c) { c.cx = nan; }).find("K holds"), std::string::npos);
    EXPECT_NE(message([&](Camera& c) { c.translation.y = nan; }).find("t holds"), std::string::npos);
    EXPECT_NE(message([](Camera& c) { c.rotation[1][1] = INFINITY; }).find("R holds"), std::string::npos);
    EXPECT_NE(message([](Camera& c) { c.rotation *= 0.0; }).find("no rotation"), std::string::npos);
    EXPECT_NE(message([](Camera& c) { c.rotation[0] *= -1.0; }).find("mirrors"), std::string::npos);
    EXPECT_TRUE(message([](Camera& c) { c.fx = -1; }).starts_with("camera \"7\": "));
}

TEST(PixelBuffer, KeepsItsMemoryWhileTheSizeStays) {
    PixelBuffer picture;
    ASSERT_TRUE(picture.reshape({}, 40, 30, 3, "test").ok());
    const float* before = picture.view().data;
    picture.view().at(29, 39)[2] = 7.0f;
    ASSERT_TRUE(picture.reshape({}, 40, 30, 3, "test").ok());
    EXPECT_EQ(picture.view().data, before);
    EXPECT_EQ(picture.view()[40 * 30 * 3 - 1], 7.0f);
    ASSERT_TRUE(picture.reshape({}, 30, 40, 3, "test").ok());
    EXPECT_EQ(picture.view().height, 40);
}

TEST(PixelBuffer, EmptyAndHugePicturesAreRefused) {
    EXPECT_EQ(PixelBuffer::allocate({}, 0, 10, 1, "test").error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(PixelBuffer::allocate({}, 10, 1 << 16, 1, "test").error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(PixelBuffer::allocate({}, 10, 10, 0, "test").error().code, ErrorCode::InvalidArgument);
    EXPECT_EQ(PixelBuffer::allocate({}, 32768, 32768, 400, "test").error().code, ErrorCode::OutOfMemory);
}

} // namespace
} // namespace ars
