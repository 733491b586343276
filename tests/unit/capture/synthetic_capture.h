#pragma once

#include "engine/capture/capture.h"
#include "engine/io/jpeg.h"
#include "engine/io/png.h"
#include "engine/rig/pose.h"

#include <glm/gtc/quaternion.hpp>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace ars::test {

/// A small capture that a test writes, and may then break. The person is a box in the middle of every picture.
struct SyntheticCapture {
    CaptureKind kind = CaptureKind::AvatarRex;
    int cameras = 3;
    int frames = 4;
    int width = 40;
    int height = 56;
    int left = 14, right = 27, top = 10, bottom = 47; ///< of the person, ends not included

    /// Names out of order, so that nobody sorts them.
    std::string cameraName(int i) const {
        if (kind == CaptureKind::THuman4) return fmt::format("cam{:02d}", i);
        if (kind == CaptureKind::ActorsHq) return fmt::format("Cam{:03d}", i + 1);
        return fmt::format("{}", 22010716 - 2 * i);
    }
    Camera camera(int i) const {
        const double angle = 2.0 * i;
        Camera camera = lookAtCamera({3.0 * std::sin(angle), 0.2 * i, 3.0 * std::cos(angle)}, {0.0, -0.3, 0.0}, 45.0,
                                     width, height);
        camera.cx += 0.75 + i; // off the centre
        camera.cy -= 1.25;
        return camera;
    }
    /// The grey of a view's background (8 bits): every view has its own.
    int background(int camera, int frame) const { return 40 + 30 * camera + 5 * frame; }

    std::filesystem::path picture(int camera, int frame) const {
        const std::string name = cameraName(camera);
        if (kind == CaptureKind::THuman4)
            return std::filesystem::path("images") / name / fmt::format("{:08d}.jpg", frame);
        if (kind == CaptureKind::ActorsHq) {
            return std::filesystem::path("4x/rgbs") / name / fmt::format("{}_rgb{:06d}.jpg", name, frame);
        }
        return std::filesystem::path(name) / fmt::format("{:08d}.jpg", frame);
    }
    std::filesystem::path mask(int camera, int frame) const {
        const std::string name = cameraName(camera);
        if (kind == CaptureKind::THuman4)
            return std::filesystem::path("masks") / name / fmt::format("{:08d}.jpg", frame);
        if (kind == CaptureKind::ActorsHq) {
            return std::filesystem::path("4x/masks") / name / fmt::format("{}_mask{:06d}.png", name, frame);
        }
        return std::filesystem::path(name) / "mask" / "pha" / fmt::format("{:08d}.jpg", frame);
    }
    std::string calibrationFile() const {
        if (kind == CaptureKind::THuman4) return "calibration.json";
        return kind == CaptureKind::ActorsHq ? "4x/calibration.csv" : "calibration_full.json";
    }
};

inline Image filledImage(int width, int height, int channels, float value, ColorSpace space) {
    Image image;
    image.width = width;
    image.height = height;
    image.channels = channels;
    image.space = space;
    image.sourceBits = 8;
    image.pixels.assign(
        static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * static_cast<std::size_t>(channels), value);
    return image;
}

/// Without the sync of the program's own writers: tests write hundreds of files.
inline void writeBytes(const std::filesystem::path& path, std::string_view bytes) {
    std::filesystem::create_directories(path.parent_path());
    std::ofstream stream(path, std::ios::binary | std::ios::trunc);
    stream << bytes;
    ASSERT_TRUE(stream.flush().good()) << path;
}

inline void writePicture(const std::filesystem::path& path, const Image& image) {
    const auto bytes = path.extension() == ".png" ? encodePng(image) : encodeJpeg(image, 100);
    ASSERT_TRUE(bytes.ok()) << bytes.error().describe();
    writeBytes(path, {reinterpret_cast<const char*>(bytes->data()), bytes->size()});
}

inline void writeView(const SyntheticCapture& what, const std::filesystem::path& folder, int camera, int frame) {
    const float grey = static_cast<float>(what.background(camera, frame)) / 255.0f;
    Image picture = filledImage(what.width, what.height, 3, grey, ColorSpace::Srgb);
    Image mask = filledImage(what.width, what.height, 1, 0.0f, ColorSpace::Data);
    for (int row = what.top; row < what.bottom; ++row) {
        for (int column = what.left; column < what.right; ++column) {
            for (int c = 0; c < 3; ++c) picture.at(row, column, c) = 200.0f / 255.0f;
            mask.at(row, column, 0) = 1.0f;
        }
    }
    writePicture(folder / what.picture(camera, frame), picture);
    writePicture(folder / what.mask(camera, frame), mask);
}

inline nlohmann::ordered_json calibrationJson(const SyntheticCapture& what) {
    nlohmann::ordered_json json;
    for (int i = 0; i < what.cameras; ++i) {
        nlohmann::ordered_json camera = cameraToJson(what.camera(i)); // nested K and R
        camera["T"] = camera["t"];
        camera["imgSize"] = {what.width, what.height};
        camera["distCoeff"] = {0.0, 0.0, 0.0, 0.0, 0.0};
        json[what.cameraName(i)] = camera;
    }
    return json;
}

/// ActorsHQ's table: the camera's place in the world, intrinsics as fractions of the picture.
inline std::string calibrationCsv(const SyntheticCapture& what) {
    std::string text = "name,w,h,rx,ry,rz,tx,ty,tz,fx,fy,px,py\n";
    for (int i = 0; i < what.cameras; ++i) {
        const Camera camera = what.camera(i);
        const glm::dquat turn = glm::quat_cast(glm::transpose(camera.rotation));
        const glm::dvec3 r = glm::angle(turn) * glm::axis(turn);
        const glm::dvec3 t = camera.centerWorld();
        text += fmt::format(
            "{},{},{},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g}\n",
            what.cameraName(i), what.width, what.height, r.x, r.y, r.z, t.x, t.y, t.z, camera.fx / what.width,
            camera.fy / what.height, camera.cx / what.width, camera.cy / what.height);
    }
    return text;
}

inline Motion syntheticMotion(int frames) {
    Motion motion;
    motion.betas.assign(10, 0.25f);
    for (int i = 0; i < frames; ++i) {
        Pose pose = restPose(55);
        pose.translation = {0.01f * static_cast<float>(i), 0.0f, 0.0f};
        motion.frames.push_back(pose);
    }
    return motion;
}

/// Writes all of it. ActorsHQ's folder is that of the sequence.
inline void writeCapture(const SyntheticCapture& what, const std::filesystem::path& folder) {
    for (int camera = 0; camera < what.cameras; ++camera) {
        for (int frame = 0; frame < what.frames; ++frame) writeView(what, folder, camera, frame);
    }
    writeBytes(folder / what.calibrationFile(),
               what.kind == CaptureKind::ActorsHq ? calibrationCsv(what) : calibrationJson(what).dump(1));
    const Status status = writeSmplParams(folder / "smpl_params.npz", syntheticMotion(what.frames));
    ASSERT_TRUE(status.ok()) << status.error().describe();
}

} // namespace ars::test
