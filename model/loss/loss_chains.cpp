#include "model/loss/loss_chains.h"

#include <ATen/ATen.h>

#include <vector>

namespace ars::chains {

at::Tensor normalsOfRotations(const at::Tensor& rotations) {
    const std::vector<at::Tensor> q = rotations.unbind(1);
    const at::Tensor &w = q[0], &x = q[1], &y = q[2], &z = q[3];
    return at::stack({2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)}, 1);
}

at::Tensor featureDistance(const at::Tensor& ours, const at::Tensor& theirs, const at::Tensor& weights) {
    const auto unit = [](const at::Tensor& f) { return f / (f.norm(2, {1}, true) + kLengthGuard); };
    const at::Tensor difference = unit(ours) - unit(theirs);
    return (difference.square() * weights.view({1, -1, 1, 1})).sum(1).mean();
}

} // namespace ars::chains
