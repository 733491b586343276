#pragma once

#include "model/network/avatar_network.h"

#include <memory>
#include <vector>

namespace ars {

/// Number type of weights and activations in convolutions; images are put together in float either way.
enum class NetworkPrecision { Float32, BFloat16 };

/// Whether this CPU multiplies bfloat16 natively; without it that precision works and is slow.
bool hasNativeBFloat16();

/// An AvatarNetwork's networks in the form that only evaluates: style, modulation, demodulation and every constant
/// factor are folded into plain weights once, noise and its strength into one map, nothing is kept for gradients. The
/// weights are copies: training goes on beside it without changing it.
///
/// Equal to AvatarNetwork within rounding: about 1e-5 of the largest output in float, 2e-2 in bfloat16. Not for two
/// threads at once: it keeps what a new camera needs of the last pose.
class InferenceNetwork {
public:
    static InferenceNetwork create(const AvatarNetwork& network, NetworkPrecision precision);

    const AvatarNetworkConfig& config() const { return config_; }

    /// As AvatarNetwork's.
    RawAttributes evaluate(const AvatarNetworkInputs& inputs, const at::Tensor& pixels, WantedAttributes wanted = {});
    std::vector<at::Tensor> evaluateColors(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                                           const std::vector<at::Tensor>& views);

    /// Colours (P, 3) of the last evaluated pose for another view map (2, V, S, S) (undefined: zeros): only the last
    /// level that sees the view runs. An undefined tensor where colours were not evaluated since `create`.
    at::Tensor colorsOfLastPose(const at::Tensor& pixels, const at::Tensor& view);

private:
    InferenceNetwork() = default;
    AvatarNetworkConfig config_;
    struct Parts;
    std::shared_ptr<Parts> parts_;
};

} // namespace ars
