#include "engine/surfel/pose_surfels_check.h"
#include "engine/surfel/pose_surfels_gradient.h"
#include "model/operators/operator_support.h"
#include "model/operators/skin_tensors.h"

#include <ATen/ATen.h>

#include <algorithm>
#include <optional>

namespace ars {

using operators::checked;
using operators::require;

namespace {

constexpr const char* kPlace = "posing surfels";

template <typename T>
void copyTo(const at::Tensor& tensor, std::vector<T>& values) {
    if (!tensor.defined()) return;
    const at::Tensor host = tensor.detach().to(at::kCPU, at::kFloat).contiguous();
    const auto* data = reinterpret_cast<const T*>(host.const_data_ptr<float>());
    values.assign(data, data + static_cast<std::size_t>(host.numel()) * sizeof(float) / sizeof(T));
}

/// Numbers of host memory where a device reads them; on the host themselves, not copied.
at::Tensor bytesOn(const c10::Device& device, const void* data, std::size_t bytes) {
    return at::from_blob(const_cast<void*>(data), {static_cast<std::int64_t>(bytes)}, at::kByte).to(device);
}
template <typename T>
at::Tensor bytesOn(const c10::Device& device, const std::vector<T>& values) {
    return bytesOn(device, values.data(), values.size() * sizeof(T));
}

template <typename T>
const T* read(const at::Tensor& tensor) {
    return tensor.defined() ? static_cast<const T*>(tensor.const_data_ptr()) : nullptr;
}
template <typename T>
T* written(const at::Tensor& tensor) {
    return tensor.defined() ? static_cast<T*>(tensor.mutable_data_ptr()) : nullptr;
}

/// What kernels read of a pose, on the surfels' device; on the host over the memory of the context.
struct PoseTensors {
    at::Tensor matrices, positions, parts;
    SkinTensors skin;

    PoseTensors(const PosingContext& context, SkinTensors skinning, const c10::Device& device)
        : matrices(bytesOn(device, context.matrices)), positions(bytesOn(device, context.jointPositions)),
          parts(bytesOn(device, context.parts)), skin(std::move(skinning)) {}
};

/// Inputs and outputs: means, rotations, radii. Keeps the rotations.
struct PoseNode : operators::Node {
    std::shared_ptr<const PosingContext> context;
    std::optional<PoseTensors> pose;

    std::string name() const override { return "PoseSurfelsBackward"; }
    void release_variables() override {
        Node::release_variables();
        pose.reset();
        context.reset();
    }

    torch::autograd::variable_list apply(torch::autograd::variable_list&& grads) override {
        begin("posing gradient");
        const at::Tensor rotations = kept(0);
        at::Tensor given[3];
        torch::autograd::variable_list result(3);
        for (std::size_t k = 0; k < 3; ++k) {
            if (!grads[k].defined() || !task_should_compute_output(k)) continue;
            given[k] = grads[k].contiguous();
            result[k] = k < 2 ? at::empty_like(given[k]) : at::zeros({kBodyPartCount}, rotations.options());
        }
        PoseSurfelsGradientArrays arrays;
        arrays.count = static_cast<std::size_t>(rotations.size(0));
        arrays.jointCount = context->matrices.size();
        arrays.matrices = read<glm::mat4>(pose->matrices);
        arrays.parts = read<BodyPart>(pose->parts);
        arrays.joints = read<std::uint16_t>(pose->skin.joints);
        arrays.weights = read<float>(pose->skin.weights);
        arrays.rotations = read<float>(rotations);
        arrays.posedMeans = read<glm::vec3>(given[0]);
        arrays.posedRotations = read<float>(given[1]);
        arrays.posedRadii = read<float>(given[2]);
        arrays.means = written<glm::vec3>(result[0]);
        arrays.gradRotations = written<float>(result[1]);
        arrays.partRadii = written<float>(result[2]);
        PoseGradientWorkspace workspace;
        require(poseSurfelsBackwardOnDevice(deviceOf(rotations), arrays, workspace));
        return result;
    }
};

/// Runs stage 4 over tensors; those of `posed` are written, undefined ones are not.
void poseInto(const PosingContext& context, const PoseTensors& pose, const at::Tensor& means,
              const at::Tensor& rotations, const JointRadii& radii, const SurfelTensors& posed) {
    const c10::Device device = means.device();
    const at::Tensor now = bytesOn(device, radii.now), initial = bytesOn(device, radii.initial);
    PoseSurfelsArrays arrays;
    arrays.count = static_cast<std::size_t>(means.size(0));
    arrays.jointCount = context.matrices.size();
    arrays.matrices = read<glm::mat4>(pose.matrices);
    arrays.jointPositions = read<glm::vec3>(pose.positions);
    arrays.jointRadii = read<float>(now);
    arrays.jointInitialRadii = read<float>(initial);
    arrays.joints = read<std::uint16_t>(pose.skin.joints);
    arrays.weights = read<float>(pose.skin.weights);
    arrays.means = read<glm::vec3>(means);
    arrays.rotations = read<float>(rotations);
    arrays.posedMeans = written<glm::vec3>(posed.means);
    arrays.posedRotations = written<float>(posed.rotations);
    arrays.radii = written<float>(posed.radii);
    arrays.radiiPlus = written<float>(posed.radiiPlus);
    arrays.radiiMinus = written<float>(posed.radiiMinus);
    arrays.importances = written<float>(posed.importances);
    arrays.bones = written<glm::vec3>(posed.bones);
    require(poseSurfelsOnDevice(context.params, deviceOf(means), arrays));
}

} // namespace

SkinTensors skinTensors(const SkinWeights& weights, const c10::Device& device) {
    return {bytesOn(device, weights.joints), bytesOn(device, weights.weights)};
}

Surfels surfelsFromTensors(const SurfelTensors& tensors) {
    Surfels surfels;
    copyTo(tensors.means, surfels.means);
    copyTo(tensors.rotations, surfels.rotations);
    copyTo(tensors.scales, surfels.scales);
    copyTo(tensors.opacities, surfels.opacities);
    copyTo(tensors.colors, surfels.colors);
    copyTo(tensors.albedos, surfels.albedos);
    copyTo(tensors.roughnesses, surfels.roughnesses);
    copyTo(tensors.radii, surfels.radii);
    copyTo(tensors.radiiPlus, surfels.radiiPlus);
    copyTo(tensors.radiiMinus, surfels.radiiMinus);
    copyTo(tensors.importances, surfels.importances);
    copyTo(tensors.bones, surfels.bones);
    return surfels;
}

SurfelTensors poseSurfelTensors(const std::shared_ptr<const PosingContext>& context, const SurfelTensors& canonical,
                                const at::Tensor& radii) {
    if (!context || !context->weights) operators::fail(kPlace, "there is no pose, expected one with skinning weights");
    const at::Tensor means = checked(canonical.means, kPlace, "means", {-1, 3});
    return poseSurfelTensors(context, skinTensors(*context->weights, means.device()), canonical, radii);
}

SurfelTensors poseSurfelTensors(const std::shared_ptr<const PosingContext>& context, const SkinTensors& skin,
                                const SurfelTensors& canonical, const at::Tensor& radii) {
    if (!context || !context->weights) operators::fail(kPlace, "there is no pose, expected one with skinning weights");
    const at::Tensor means = checked(canonical.means, kPlace, "means", {-1, 3});
    const std::int64_t n = means.size(0);
    const at::Tensor rotations = checked(canonical.rotations, kPlace, "rotations", {n, 4}, means);
    const at::Tensor partRadii = checked(radii, kPlace, "radii", {static_cast<std::int64_t>(kBodyPartCount)}, means);

    if (skin.joints.device() != means.device()) {
        operators::fail(kPlace, fmt::format("the skinning weights lie on {}, expected {} as the means",
                                            skin.joints.device().str(), means.device().str()));
    }
    SurfelPosing posing{context->matrices, context->jointPositions, context->parts};
    std::copy_n(partRadii.detach().cpu().const_data_ptr<float>(), posing.radii.size(), posing.radii.begin());
    const JointRadii jointRadii =
        require(checkPosing(context->params, posing, *context->weights, static_cast<std::size_t>(n)));
    const PoseTensors pose(*context, skin, means.device());
    const at::TensorOptions options = means.options();
    SurfelTensors result = canonical;
    result.means = at::empty({n, 3}, options);
    result.rotations = at::empty({n, 4}, options);
    result.radii = at::empty({n}, options);
    result.radiiPlus = context->params.trainingRadii ? at::empty({n}, options) : at::Tensor();
    result.radiiMinus = context->params.trainingRadii ? at::empty({n}, options) : at::Tensor();
    result.importances = at::empty({n}, options);
    result.bones = at::empty({n, 3}, options);
    poseInto(*context, pose, means, rotations, jointRadii, result);
    if (operators::wantsGradient({means, rotations, partRadii})) {
        const auto node = operators::makeNode<PoseNode>(means, rotations, partRadii);
        node->context = context;
        node->pose = pose;
        node->keep(rotations);
        for (const at::Tensor& output : {result.means, result.rotations, result.radii}) {
            torch::autograd::set_history(output, node);
        }
    }
    return result;
}

} // namespace ars
