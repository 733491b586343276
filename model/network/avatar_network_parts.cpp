#include "model/network/avatar_network_parts.h"

#include <ATen/ATen.h>

namespace ars {
namespace {

int inputChannels(const AvatarNetworkConfig& config) {
    const int perSide = 3 + (config.priors == PriorMode::Concat ? 5 : 0);
    return config.frontOnly ? perSide : 2 * perSide;
}

StyleUnetConfig partConfig(const AvatarNetworkConfig& config, int outputs) {
    StyleUnetConfig part;
    part.inputSize = config.inputSize;
    part.inputChannels = inputChannels(config);
    part.outputChannels = outputs;
    part.channelMultiplier = config.channelMultiplier;
    part.maxChannels = config.maxChannels;
    part.styleSize = config.styleSize;
    part.priors = config.priors == PriorMode::Encoder;
    part.zeroOutputs = config.zeroOutputs;
    return part;
}

at::Tensor sideOf(const at::Tensor& maps, std::int64_t side) { return maps.slice(0, side, side + 1); }

} // namespace

std::vector<AvatarPart> avatarParts(const AvatarNetworkConfig& config) {
    using enum AvatarPart::Role;
    if (config.split == NetworkSplit::Two) {
        StyleUnetConfig appearance = partConfig(config, 7);
        if (config.viewDependent) {
            appearance.view = ViewInjection::ColorCopy;
            appearance.colorChannels = 3;
        }
        return {{Geometry, "geometry", partConfig(config, 11)}, {Appearance, "appearance", appearance}};
    }
    StyleUnetConfig color = partConfig(config, 3);
    if (config.viewDependent) color.view = ViewInjection::LastLevel;
    return {{Position, "position", partConfig(config, 3)},
            {Other, "other", partConfig(config, 8)},
            {Color, "color", color},
            {Material, "material", partConfig(config, 4)}};
}

bool AvatarPart::isWanted(WantedAttributes wanted) const {
    switch (role) {
    case Role::Geometry:
    case Role::Position:
    case Role::Other:
        return wanted.geometry;
    case Role::Appearance:
        return wanted.materials || wanted.colors;
    case Role::Color:
        return wanted.colors;
    case Role::Material:
        return wanted.materials;
    }
    return false;
}

void AvatarPart::take(const at::Tensor& rows, WantedAttributes wanted, RawAttributes& result) const {
    std::int64_t first = 0;
    const auto next = [&](at::Tensor& target, std::int64_t count, bool isTaken) {
        if (isTaken && first + count <= rows.size(1)) target = rows.slice(1, first, first + count);
        first += count;
    };
    const bool geometry = role == Role::Geometry;
    if (geometry || role == Role::Position) next(result.offsets, 3, true);
    if (geometry || role == Role::Other) {
        next(result.opacities, 1, true);
        next(result.scales, 3, true);
        next(result.rotations, 4, true);
    }
    if (role == Role::Appearance || role == Role::Material) {
        next(result.albedos, 3, wanted.materials);
        next(result.roughnesses, 1, wanted.materials);
    }
    // Rows of a network with a colour copy end before the colours.
    if (role == Role::Appearance || role == Role::Color) next(result.colors, 3, wanted.colors);
}

std::array<at::Tensor, 2> sidesOf(const at::Tensor& maps) { return {sideOf(maps, 0), sideOf(maps, 1)}; }

StyleUnetInputs sharedInputs(const AvatarNetworkConfig& config, const std::optional<SideEncoder>& priorEncoder,
                             const AvatarNetworkInputs& inputs) {
    const std::int64_t size = config.inputSize;
    TORCH_CHECK(inputs.positions.sizes() == at::IntArrayRef({2, 3, size, size}),
                "network: expected position maps (2, 3, ", size, ", ", size, "), found ", inputs.positions.sizes());
    TORCH_CHECK(config.priors == PriorMode::Off ||
                    (inputs.priors.defined() && inputs.priors.sizes() == at::IntArrayRef({2, 5, size, size})),
                "network: expected prior maps (2, 5, ", size, ", ", size, ")");
    StyleUnetInputs result;
    std::vector<at::Tensor> maps;
    for (std::int64_t side = 0; side < (config.frontOnly ? 1 : 2); ++side)
        maps.push_back(sideOf(inputs.positions, side));
    if (config.priors == PriorMode::Concat) {
        for (std::int64_t side = 0; side < (config.frontOnly ? 1 : 2); ++side)
            maps.push_back(sideOf(inputs.priors, side));
    }
    result.maps = at::cat(maps, 1);
    if (priorEncoder) result.priors = sidesOf(priorEncoder->evaluate(inputs.priors));
    return result;
}

} // namespace ars
