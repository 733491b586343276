// A rest: avatar splatted into the cameras of the path-traced capture: geometry against Blender Cycles.
#include "engine/capture/calibration.h"
#include "engine/frame/rest_avatar.h"
#include "engine/io/image_file.h"
#include "engine/rig/motion.h"
#include "engine/surfel/pose_surfels.h"
#include "engine/surfel/splat.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

namespace ars {
namespace {

/// Differences over all pictures that were added.
struct Comparison {
    std::size_t both = 0, either = 0;
    std::vector<float> depthErrorsM, normalErrorsDeg;

    double maskIoU() const { return static_cast<double>(both) / static_cast<double>(either); }
    float medianDepthErrorM() {
        const auto middle = depthErrorsM.begin() + static_cast<std::ptrdiff_t>(depthErrorsM.size() / 2);
        std::nth_element(depthErrorsM.begin(), middle, depthErrorsM.end());
        return *middle;
    }
    double meanNormalErrorDeg() const {
        return std::accumulate(normalErrorsDeg.begin(), normalErrorsDeg.end(), 0.0) /
               static_cast<double>(normalErrorsDeg.size());
    }
};

/// The ground truth of one picture.
struct Truth {
    Image color, depth, normal;
};

Result<Truth> readTruth(const std::filesystem::path& camera, const std::string& name) {
    Truth truth;
    ARS_TRY(truth.color, readImageFile(camera / "gt" / "color" / name));
    ARS_TRY(truth.depth, readImageFile(camera / "gt" / "depth" / name));
    ARS_TRY(truth.normal, readImageFile(camera / "gt" / "normal" / name));
    return truth;
}

void compare(const GBuffer& gbuffer, const Truth& truth, const Camera& camera, Comparison& comparison) {
    const glm::mat3 rotation(camera.rotation);
    for (int row = 0; row < camera.height; ++row) {
        for (int column = 0; column < camera.width; ++column) {
            const bool ours = *gbuffer[Channel::Opacity].view().at(row, column) > 0.5f;
            const bool theirs = truth.color.at(row, column, 3) > 0.5f;
            comparison.both += ours && theirs ? 1 : 0;
            comparison.either += ours || theirs ? 1 : 0;
            const float depth = truth.depth.at(row, column, 0);
            if (!ours || !theirs || !(depth > 0.1f && depth < 50.0f)) continue;
            comparison.depthErrorsM.push_back(std::abs(*gbuffer[Channel::Depth].view().at(row, column) - depth));
            const float* n = gbuffer[Channel::Normal].view().at(row, column);
            const glm::vec3 expected =
                rotation * glm::vec3(truth.normal.at(row, column, 0), truth.normal.at(row, column, 1),
                                     truth.normal.at(row, column, 2));
            const float cosine = glm::dot(glm::vec3(n[0], n[1], n[2]), glm::normalize(expected));
            comparison.normalErrorsDeg.push_back(glm::degrees(std::acos(std::clamp(cosine, -1.0f, 1.0f))));
        }
    }
}

Status addPicture(const RestAvatar& avatar, const Pose& pose, const Camera& camera, const Truth& truth,
                  Comparison& comparison) {
    const AvatarRig& rig = avatar.rig();
    ARS_TRY(const std::vector<glm::mat4> matrices,
            canonicalToPosed(skinningMatrices(rig.skeleton, pose), rig.canonical));
    const std::vector<glm::vec3> joints = posedJointPositions(rig.skeleton, pose);
    PosedSurfels posed;
    ARS_TRY_STATUS(poseSurfels({}, {matrices, joints, rig.parts}, rig.weights, avatar.surfels(), posed));
    GBuffer gbuffer;
    SplatWorkspace workspace;
    ARS_TRY_STATUS(splat({.depth = DepthMode::Filtered}, liveView(avatar.surfels(), posed), camera,
                         {Channel::Opacity, Channel::Depth, Channel::Normal}, gbuffer, workspace));
    compare(gbuffer, truth, camera, comparison);
    return {};
}

// The bounds are those that the project promises against path tracing. Garment wrinkles that the capture's cloth model
// adds to the template (up to 17 mm) are part of the differences.
TEST(RestAvatarPictures, MaskDepthAndNormalsAgreeWithPathTracing) {
    ARS_TEST_DATA_FILE(templatePath, "capture/casual/template.glb");
    ARS_TEST_DATA_FILE(root, "capture/casual_val");
    const auto avatar = restAvatarFromFile(templatePath.string());
    ASSERT_TRUE(avatar.ok()) << avatar.error().describe();
    Comparison comparison;
    for (const std::string set : {"heldout_views", "novel_poses"}) {
        const auto cameras = readCalibration(root / set / "calibration_full.json");
        const auto motion = readMotionNpz(root / set / "smpl_params.npz");
        ASSERT_TRUE(cameras.ok()) << cameras.error().describe();
        ASSERT_TRUE(motion.ok()) << motion.error().describe();
        for (std::size_t frame = 0; frame < motion->frames.size(); frame += 2) {
            const CalibratedCamera& camera = (*cameras)[frame / 2 % cameras->size()];
            const auto truth = readTruth(root / set / camera.name, fmt::format("{:08d}.exr", frame));
            ASSERT_TRUE(truth.ok()) << truth.error().describe();
            const Status added = addPicture(**avatar, motion->frames[frame], camera.camera, *truth, comparison);
            ASSERT_TRUE(added.ok()) << added.error().describe();
        }
    }
    std::printf("mask IoU %.4f, median depth error %.2f mm, mean normal error %.2f degrees\n", comparison.maskIoU(),
                1e3f * comparison.medianDepthErrorM(), comparison.meanNormalErrorDeg());
    EXPECT_GE(comparison.maskIoU(), 0.97);
    EXPECT_LT(comparison.medianDepthErrorM(), 0.006f);
    EXPECT_LT(comparison.meanNormalErrorDeg(), 15.0);
}

} // namespace
} // namespace ars
