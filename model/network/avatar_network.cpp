#include "model/network/avatar_network.h"

#include "model/network/avatar_network_parts.h"
#include "model/network/filters.h"

#include <ATen/ATen.h>

#include <optional>

namespace ars {
namespace {

/// Seeds of the parts lie this far apart, so that the networks of neighbouring seeds share none.
constexpr std::uint64_t kSeedStep = 0x9E3779B97F4A7C15ull;

at::Tensor gather(const std::array<at::Tensor, 2>& sides, const at::Tensor& pixels) {
    return gatherSides(sides[0], sides[1], pixels);
}

} // namespace

const ParameterTable<AvatarNetworkConfig>& avatarNetworkParameters() {
    using P = AvatarNetworkConfig;
    using enum ParameterTier;
    static const ParameterTable<P> table{
        {"split", &P::split, {}, "", Advanced, "One network for each of four groups of attributes, or two in all."},
        {"input_size",
         &P::inputSize,
         {64, 1024},
         "px",
         Basic,
         "Side of the networks' input maps [S]; surfels lie in maps of twice it."},
        {"channel_multiplier",
         &P::channelMultiplier,
         {0.03125, 4},
         "",
         Advanced,
         "Width of the levels above 32 pixels."},
        {"max_channels", &P::maxChannels, {1, 512}, "", Advanced, "No level is wider."},
        {"style_size", &P::styleSize, {1, 1024}, "", Expert, "Numbers of the constant style."},
        {"priors",
         &P::priors,
         {},
         "",
         Basic,
         "How the networks see the deformation priors: encoder F, beside the inputs, not at all."},
        {"front_only",
         &P::frontOnly,
         {},
         "",
         Expert,
         "The networks see the front position map alone, as Animatable Gaussians'."},
        {"view_dependent", &P::viewDependent, {}, "", Advanced, "The radiance colour sees the view map [V]."},
        {"view_normals",
         &P::viewNormals,
         {},
         "",
         Advanced,
         "The view map also holds the normal in the world, so that the colour follows a fixed light as the person "
         "turns."},
        {"canonical_only",
         &P::canonicalOnly,
         {},
         "",
         Expert,
         "Ablation: the networks see the canonical maps whatever the pose."},
        {"zero_outputs", &P::zeroOutputs, {}, "", Expert, "The networks' outputs start at 0, which is the template."},
    };
    return table;
}

int viewMapChannels(const AvatarNetworkConfig& config) { return config.viewNormals ? 4 : 1; }

struct AvatarNetwork::Parts {
    std::vector<AvatarPart> parts;
    std::vector<StyleUnet> unets; ///< one a part
    std::optional<SideEncoder> priorEncoder, viewEncoder;
};

Result<AvatarNetwork> AvatarNetwork::create(const AvatarNetworkConfig& config, std::uint64_t seed) {
    AvatarNetwork network;
    network.config_ = config;
    auto parts = std::make_shared<Parts>();
    parts->parts = avatarParts(config);
    std::uint64_t partSeed = seed * kSeedStep;
    for (const AvatarPart& part : parts->parts) {
        ARS_TRY(StyleUnet unet, StyleUnet::create(part.config, partSeed += kSeedStep));
        network.tensors_.append(part.name + ".", unet.tensors());
        parts->unets.push_back(std::move(unet));
    }
    const auto addEncoder = [&](std::optional<SideEncoder>& encoder, const std::string& name, int channels) {
        encoder = SideEncoder::create(channels, partSeed += kSeedStep);
        network.tensors_.append(name + ".", encoder->tensors());
    };
    if (config.priors == PriorMode::Encoder) addEncoder(parts->priorEncoder, "prior_encoder", 5);
    if (config.viewDependent) addEncoder(parts->viewEncoder, "view_encoder", viewMapChannels(config));
    network.parts_ = parts;
    return network;
}

RawAttributes AvatarNetwork::evaluate(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                                      WantedAttributes wanted, const std::vector<at::Tensor>& views,
                                      std::vector<at::Tensor>& colors) const {
    const StyleUnetInputs shared = sharedInputs(config_, parts_->priorEncoder, inputs);
    wanted.colors = wanted.colors && !views.empty();
    RawAttributes result;
    colors.clear();
    for (std::size_t i = 0; i < parts_->parts.size(); ++i) {
        const AvatarPart& part = parts_->parts[i];
        const StyleUnet& unet = parts_->unets[i];
        if (!part.isWanted(wanted)) continue;
        if (part.config.view == ViewInjection::None) {
            part.take(gather(unet.evaluateSides(shared).trunk, pixels), wanted, result);
            continue;
        }
        const bool trunkWanted = part.role == AvatarPart::Role::Appearance && wanted.materials;
        StyleUnetTrunk trunk;
        const StyleUnetSides sides = unet.evaluateSides(shared, {.trunk = trunkWanted, .colors = false}, &trunk);
        if (trunkWanted) part.take(gather(sides.trunk, pixels), wanted, result);
        for (std::size_t v = 0; wanted.colors && v < views.size(); ++v) {
            const std::int64_t size = config_.inputSize;
            const at::Tensor maps =
                views[v].defined() ? views[v]
                                   : at::zeros({2, viewMapChannels(config_), size, size}, inputs.positions.options());
            const auto features = sidesOf(parts_->viewEncoder->evaluate(maps));
            colors.push_back(gather(unet.evaluateColorSides(trunk, features), pixels));
        }
    }
    if (result.colors.defined()) colors.assign(views.size(), result.colors);
    result.colors = at::Tensor();
    return result;
}

RawAttributes AvatarNetwork::evaluate(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                                      WantedAttributes wanted) const {
    std::vector<at::Tensor> colors;
    RawAttributes result = evaluate(inputs, pixels, wanted, {inputs.view}, colors);
    if (!colors.empty()) result.colors = colors.front();
    return result;
}

std::vector<at::Tensor> AvatarNetwork::evaluateColors(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                                                      const std::vector<at::Tensor>& views) const {
    std::vector<at::Tensor> colors;
    evaluate(inputs, pixels, {.geometry = false, .materials = false, .colors = true}, views, colors);
    return colors;
}

} // namespace ars
