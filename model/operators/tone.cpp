#include "engine/shade/tone_gradient.h"
#include "model/operators/operator_support.h"

#include <ATen/ATen.h>

namespace ars {

using operators::pictureOf;
using operators::pictureToFill;
using operators::require;

namespace {

struct ToneNode : operators::Node {
    ToneParams params;

    std::string name() const override { return "ToneBackward"; }

    torch::autograd::variable_list apply(torch::autograd::variable_list&& grads) override {
        begin("tone gradient");
        if (!grads[0].defined()) return {at::Tensor()};
        const at::Tensor linear = kept(0), grad = grads[0].contiguous();
        at::Tensor result = at::empty_like(linear);
        require(toneMapBackward(deviceOf(linear), params, pictureOf(linear), pictureOf(grad), pictureToFill(result)));
        return {result};
    }
};

} // namespace

at::Tensor toneTensor(const ToneParams& params, const at::Tensor& linear) {
    const at::Tensor from = operators::checked(linear, "tone curve", "the linear picture", {-1, -1, 4});
    at::Tensor display = at::empty_like(from);
    require(toneMap(deviceOf(from), params, pictureOf(from), pictureToFill(display)));
    if (operators::wantsGradient({from})) {
        const auto node = operators::makeNode<ToneNode>(from);
        node->params = params;
        node->keep(from);
        torch::autograd::set_history(display, node);
    }
    return display;
}

} // namespace ars
