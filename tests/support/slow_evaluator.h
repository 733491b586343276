#pragma once

#include "engine/frame/rest_avatar.h"

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

namespace ars::test {

/// Stands for a trained avatar: canonical surfels that follow the pose, and take their time. They rise by a centimetre
/// for every radian that the root is turned.
class SlowEvaluator : public AvatarEvaluator {
public:
    SlowEvaluator(std::shared_ptr<AvatarEvaluator> rest, std::chrono::milliseconds time)
        : rest_(std::move(rest)), time_(time) {}

    const AvatarRig& rig() const override { return rest_->rig(); }
    const TemplateMesh& mesh() const override { return rest_->mesh(); }
    std::string description() const override { return "slow avatar"; }
    bool dependsOnPose() const override { return true; }
    bool colorsDependOnView() const override { return false; }
    Status evaluate(const Pose& pose, const Camera* view, Surfels& surfels) override {
        ++evaluations;
        std::this_thread::sleep_for(time_);
        ARS_TRY_STATUS(rest_->evaluate(pose, view, surfels));
        for (glm::vec3& mean : surfels.means) mean.y += lift(pose);
        return {};
    }
    static float lift(const Pose& pose) { return 0.01f * glm::length(axisAngleFromQuat(pose.rotations[0])); }

    std::atomic<int> evaluations{0};

private:
    std::shared_ptr<AvatarEvaluator> rest_;
    std::chrono::milliseconds time_;
};

} // namespace ars::test
