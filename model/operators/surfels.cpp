#include "engine/surfel/pose_surfels_gradient.h"
#include "model/operators/operator_support.h"

#include <ATen/ATen.h>

#include <algorithm>
#include <span>

namespace ars {

using operators::adopt;
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

template <typename T>
std::span<const T> spanOf(const at::Tensor& tensor) {
    if (!tensor.defined()) return {};
    return {reinterpret_cast<const T*>(tensor.const_data_ptr<float>()),
            static_cast<std::size_t>(tensor.numel()) * sizeof(float) / sizeof(T)};
}

/// Inputs and outputs: means, rotations, radii.
struct PoseNode : operators::Node {
    std::shared_ptr<const PosingContext> context;
    Surfels canonical; ///< means and rotations

    std::string name() const override { return "PoseSurfelsBackward"; }
    void release_variables() override {
        Node::release_variables();
        canonical = {};
        context.reset();
    }

    torch::autograd::variable_list apply(torch::autograd::variable_list&& grads) override {
        begin("posing gradient");
        at::Tensor given[3];
        for (std::size_t k = 0; k < 3; ++k) {
            if (grads[k].defined() && task_should_compute_output(k)) given[k] = grads[k].contiguous();
        }
        const auto n = static_cast<std::int64_t>(canonical.count());
        std::vector<glm::vec3> means(given[0].defined() ? canonical.count() : 0);
        std::vector<float> rotations(given[1].defined() ? 4 * canonical.count() : 0);
        PartRadii radii{};
        SurfelPosing posing{context->matrices, context->jointPositions, context->parts};
        require(poseSurfelsBackward(posing, *context->weights, canonical,
                                    {spanOf<glm::vec3>(given[0]), spanOf<float>(given[1]), spanOf<float>(given[2])},
                                    means, rotations, radii));
        torch::autograd::variable_list result(3);
        if (given[0].defined()) result[0] = adopt(std::move(means), {n, 3});
        if (given[1].defined()) result[1] = adopt(std::move(rotations), {n, 4});
        if (given[2].defined()) result[2] = tensorOf(std::span<const float>(radii));
        return result;
    }
};

} // namespace

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
    const std::int64_t n = means.size(0);
    const at::Tensor rotations = checked(canonical.rotations, kPlace, "rotations", {n, 4});
    const at::Tensor partRadii = checked(radii, kPlace, "radii", {static_cast<std::int64_t>(kBodyPartCount)});

    Surfels host;
    copyTo(means, host.means);
    copyTo(rotations, host.rotations);
    SurfelPosing posing{context->matrices, context->jointPositions, context->parts};
    std::copy_n(partRadii.const_data_ptr<float>(), posing.radii.size(), posing.radii.begin());
    PosedSurfels posed;
    require(poseSurfels(context->params, posing, *context->weights, host, posed));

    SurfelTensors result = canonical;
    result.means = adopt(std::move(posed.means), {n, 3});
    result.rotations = adopt(std::move(posed.rotations), {n, 4});
    result.radii = adopt(std::move(posed.radii), {n});
    result.radiiPlus = context->params.trainingRadii ? adopt(std::move(posed.radiiPlus), {n}) : at::Tensor();
    result.radiiMinus = context->params.trainingRadii ? adopt(std::move(posed.radiiMinus), {n}) : at::Tensor();
    result.importances = adopt(std::move(posed.importances), {n});
    result.bones = adopt(std::move(posed.bones), {n, 3});
    if (operators::wantsGradient({means, rotations, partRadii})) {
        const auto node = operators::makeNode<PoseNode>(means, rotations, partRadii);
        node->context = context;
        node->canonical = std::move(host);
        for (const at::Tensor& output : {result.means, result.rotations, result.radii}) {
            torch::autograd::set_history(output, node);
        }
    }
    return result;
}

} // namespace ars
