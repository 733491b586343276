#include "model/training/adam_chain.h"

#include <ATen/ATen.h>

namespace ars::chains {

void adamStep(at::Tensor x, const at::Tensor& g, at::Tensor m, at::Tensor v, const AdamCoefficients& c) {
    const at::NoGradGuard noGradient;
    m.mul_(c.beta1).add_(g, 1.0f - c.beta1);
    v.mul_(c.beta2).addcmul_(g, g, 1.0f - c.beta2);
    x.addcdiv_(m, (v * c.secondScale).sqrt_().add_(kAdamEpsilon), -c.rate);
}

} // namespace ars::chains
