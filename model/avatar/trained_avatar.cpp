#include "engine/maps/position_maps.h"
#include "model/avatar/avatar_model.h"
#include "model/run/run_failure.h"

#include <ATen/ATen.h>

#include <mutex>

namespace ars {
namespace {

/// Which of its results still hold is the frame pipeline's business; what this keeps is the work that a new camera
/// alone does not need again.
class TrainedAvatar final : public AvatarEvaluator {
public:
    TrainedAvatar(AvatarModel model, bool project, NetworkPrecision precision)
        : model_(std::move(model)), project_(project), precision_(precision),
          networks_(InferenceNetwork::create(*model_.network, precision)) {
        rig_.skeleton = model_.mesh.skeleton();
        rig_.parts = jointParts(rig_.skeleton);
        rig_.canonical = model_.maps.canonical;
        rig_.weights = model_.maps.weights;
    }

    const AvatarRig& rig() const override { return rig_; }
    const TemplateMesh& mesh() const override { return model_.mesh; }
    std::string description() const override {
        return fmt::format("{} avatar, {} surfels, maps {} to {}{}", model_.spec.preset, model_.maps.pointCount(),
                           model_.spec.network.inputSize, 2 * model_.spec.network.inputSize,
                           precision_ == NetworkPrecision::BFloat16 ? ", networks in bfloat16" : "");
    }
    bool dependsOnPose() const override { return !model_.spec.network.canonicalOnly; }
    bool colorsDependOnView() const override { return model_.spec.network.viewDependent; }
    bool sameSurfels(const Pose& a, const Pose& b) const override {
        if (colorsDependOnView() && (a.rotations != b.rotations || a.translation != b.translation)) return false;
        return sameMaps(a, b);
    }

    Status evaluate(const Pose& pose, const Camera* view, Surfels& surfels) override {
        const std::lock_guard lock(mutex_);
        return withoutExceptions<Status>("avatar", [&] {
            const at::NoGradGuard noGradient;
            return evaluateLocked(pose, view, surfels);
        });
    }

private:
    bool sameMaps(const Pose& a, const Pose& b) const {
        if (!dependsOnPose()) return true;
        const Pose seenA = mapPose(a), seenB = mapPose(b);
        return seenA.rotations == seenB.rotations;
    }

    Status evaluateLocked(const Pose& pose, const Camera* view, Surfels& surfels) {
        at::Tensor seen; // none: as a view map of zeros sees it
        if (view && colorsDependOnView()) {
            ARS_TRY(seen, viewMap(model_, pose, *view));
        }
        if (!mapsPose_ || !sameMaps(*mapsPose_, pose)) {
            mapsPose_.reset();
            ARS_TRY(const PoseMaps maps, poseMaps(model_, pose, project_));
            ARS_TRY(AvatarNetworkInputs inputs, networkInputs(model_, maps));
            inputs.view = seen;
            const RawAttributes raw = networks_.evaluate(inputs, model_.pixels);
            canonical_ = surfelsFromTensors(decodeSurfels(model_.spec.decoding, model_.base, raw).surfels);
            mapsPose_ = pose;
        } else if (seen.defined()) {
            SurfelTensors colors;
            colors.colors = decodeColors(model_.base, networks_.colorsOfLastPose(model_.pixels, seen));
            canonical_.colors = surfelsFromTensors(colors).colors;
        }
        surfels = canonical_;
        return {};
    }

    AvatarModel model_;
    bool project_;
    NetworkPrecision precision_;
    InferenceNetwork networks_;
    AvatarRig rig_;
    std::mutex mutex_;
    std::optional<Pose> mapsPose_; ///< that canonical_ belongs to
    Surfels canonical_;
};

} // namespace

std::shared_ptr<AvatarEvaluator> makeTrainedAvatar(AvatarModel model, bool project, NetworkPrecision precision) {
    return std::make_shared<TrainedAvatar>(std::move(model), project, precision);
}

} // namespace ars
