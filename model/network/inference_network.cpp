#include "model/network/inference_network.h"

#include "model/network/avatar_network_parts.h"
#include "model/network/filters.h"
#include "model/network/inference_unet.h"

#include <ATen/ATen.h>

#include <optional>

namespace ars {

bool hasNativeBFloat16() { return __builtin_cpu_supports("avx512bf16"); }

struct InferenceNetwork::Parts {
    std::vector<InferenceUnet> unets; ///< in the order of avatarParts
    std::vector<AvatarPart> parts;
    std::optional<SideEncoder> priorEncoder, viewEncoder; ///< share the training form's tensors until the copy

    /// The network that makes the colours.
    InferenceUnet* colors() {
        for (std::size_t i = 0; i < parts.size(); ++i) {
            if (parts[i].role == AvatarPart::Role::Appearance || parts[i].role == AvatarPart::Role::Color)
                return &unets[i];
        }
        return nullptr;
    }
};

namespace {

SideEncoder copyOf(const AvatarNetwork& network, const std::string& prefix, int channels) {
    SideEncoder encoder = SideEncoder::create(channels, 0);
    const at::NoGradGuard noGradients;
    for (NetworkTensor& entry : encoder.tensors().all()) {
        for (const NetworkTensor& other : network.tensors().all()) {
            if (other.name == prefix + entry.name) entry.tensor.copy_(other.tensor);
        }
        entry.tensor.requires_grad_(false);
    }
    return encoder;
}

} // namespace

InferenceNetwork InferenceNetwork::create(const AvatarNetwork& network, NetworkPrecision precision) {
    const at::NoGradGuard noGradients;
    InferenceNetwork result;
    result.config_ = network.config();
    result.parts_ = std::make_shared<Parts>();
    Parts& parts = *result.parts_;
    parts.parts = avatarParts(network.config());
    const at::ScalarType type = precision == NetworkPrecision::BFloat16 ? at::kBFloat16 : at::kFloat;
    for (const AvatarPart& part : parts.parts) {
        parts.unets.emplace_back(part.config, network.tensors(), part.name + ".", type);
    }
    if (network.config().priors == PriorMode::Encoder) parts.priorEncoder = copyOf(network, "prior_encoder.", 5);
    if (network.config().viewDependent)
        parts.viewEncoder = copyOf(network, "view_encoder.", viewMapChannels(network.config()));
    return result;
}

at::Tensor InferenceNetwork::colorsOfLastPose(const at::Tensor& pixels, const at::Tensor& view) {
    const at::NoGradGuard noGradients;
    InferenceUnet* unet = parts_->colors();
    if (!unet->hasPose() || !config_.viewDependent) return {};
    const std::int64_t size = config_.inputSize;
    const at::Tensor maps = view.defined() ? view : at::zeros({2, viewMapChannels(config_), size, size}, at::kFloat);
    const auto sides = unet->evaluateColors(sidesOf(parts_->viewEncoder->evaluate(maps)));
    return gatherSides(sides[0], sides[1], pixels);
}

RawAttributes InferenceNetwork::evaluate(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                                         WantedAttributes wanted) {
    const at::NoGradGuard noGradients;
    const StyleUnetInputs shared = sharedInputs(config_, parts_->priorEncoder, inputs);
    RawAttributes result;
    for (std::size_t i = 0; i < parts_->parts.size(); ++i) {
        const AvatarPart& part = parts_->parts[i];
        if (!part.isWanted(wanted)) continue;
        const bool colorsApart = part.config.view != ViewInjection::None;
        const bool trunkWanted = !colorsApart || (part.role == AvatarPart::Role::Appearance && wanted.materials);
        const auto sides = parts_->unets[i].evaluate(shared, trunkWanted);
        if (trunkWanted) part.take(gatherSides(sides[0], sides[1], pixels), wanted, result);
        if (colorsApart && wanted.colors) result.colors = colorsOfLastPose(pixels, inputs.view);
    }
    return result;
}

std::vector<at::Tensor> InferenceNetwork::evaluateColors(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                                                         const std::vector<at::Tensor>& views) {
    std::vector<at::Tensor> colors;
    if (views.empty()) return colors;
    AvatarNetworkInputs first = inputs;
    first.view = views.front();
    colors.push_back(evaluate(first, pixels, {.geometry = false, .materials = false, .colors = true}).colors);
    for (std::size_t i = 1; i < views.size(); ++i) {
        colors.push_back(config_.viewDependent ? colorsOfLastPose(pixels, views[i]) : colors.front());
    }
    return colors;
}

} // namespace ars
