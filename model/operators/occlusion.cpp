#include "engine/occlusion/radius_gradient.h"
#include "model/operators/operator_support.h"

#include <ATen/ATen.h>

namespace ars {

using operators::checked;
using operators::pictureOf;
using operators::pictureToFill;
using operators::require;

namespace {

constexpr const char* kPlace = "occlusion";

/// Input: R. No other picture is known to the graph: N, D, Q and I receive nothing.
struct OcclusionNode : operators::Node {
    at::Tensor occlusionPlus, occlusionMinus;

    std::string name() const override { return "OcclusionBackward"; }
    void release_variables() override {
        Node::release_variables();
        occlusionPlus = occlusionMinus = at::Tensor();
    }

    torch::autograd::variable_list apply(torch::autograd::variable_list&& grads) override {
        begin("occlusion gradient");
        if (!grads[0].defined()) return {at::Tensor()};
        const at::Tensor grad = grads[0].contiguous(), plus = kept(0), minus = kept(1), opacity = kept(2);
        at::Tensor result = at::empty_like(grad);
        require(backwardRadius(deviceOf(grad), {}, pictureOf(grad), pictureOf(occlusionPlus), pictureOf(occlusionMinus),
                               pictureOf(plus), pictureOf(minus), pictureOf(opacity), pictureToFill(result)));
        return {result};
    }
};

/// A picture of the camera's size without its history; undefined where it is absent and may be.
at::Tensor picture(const GBufferTensors& gbuffer, Channel channel, const Camera& camera, bool optional) {
    if (optional && !gbuffer[channel].defined()) return {};
    return checked(gbuffer[channel].defined() ? gbuffer[channel].detach() : gbuffer[channel], kPlace,
                   channelName(channel), {camera.height, camera.width, channelWidth(channel)}, gbuffer[Channel::Depth]);
}

} // namespace

at::Tensor occlusionTensor(const OcclusionParams& params, const GBufferTensors& gbuffer, const Camera& camera,
                           OcclusionWorkspace& workspace, int pass) {
    const at::Tensor depth = picture(gbuffer, Channel::Depth, camera, false);
    const at::Tensor normal = picture(gbuffer, Channel::Normal, camera, false);
    const at::Tensor radius = picture(gbuffer, Channel::Radius, camera, false);
    const at::Tensor importance = picture(gbuffer, Channel::Importance, camera, true);
    const at::Tensor bone = picture(gbuffer, Channel::Bone, camera, true);
    const at::Tensor opacity = picture(gbuffer, Channel::Opacity, camera, false);
    const at::Tensor plus = picture(gbuffer, Channel::RadiusPlus, camera, true);
    const at::Tensor minus = picture(gbuffer, Channel::RadiusMinus, camera, true);
    const OcclusionInputs inputs{
        deviceOf(depth),       camera,          pictureOf(depth),  pictureOf(normal), pictureOf(radius),
        pictureOf(importance), pictureOf(bone), pictureOf(opacity)};
    at::Tensor occlusion = at::empty({camera.height, camera.width, 1}, depth.options());
    if (!plus.defined() || !minus.defined() || !operators::wantsGradient({gbuffer[Channel::Radius]})) {
        require(ambientOcclusion(params, inputs, workspace, pictureToFill(occlusion), pass));
        return occlusion;
    }
    const auto node = operators::makeNode<OcclusionNode>(gbuffer[Channel::Radius]);
    node->occlusionPlus = at::empty_like(occlusion);
    node->occlusionMinus = at::empty_like(occlusion);
    require(ambientOcclusionTriple(params, inputs, pictureOf(plus), pictureOf(minus), workspace,
                                   pictureToFill(occlusion), pictureToFill(node->occlusionPlus),
                                   pictureToFill(node->occlusionMinus), pass));
    node->keep(plus);
    node->keep(minus);
    node->keep(opacity);
    torch::autograd::set_history(occlusion, node);
    return occlusion;
}

} // namespace ars
