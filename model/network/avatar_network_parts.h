#pragma once

#include "model/network/avatar_network.h"

#include <optional>
#include <string>
#include <vector>

namespace ars {

/// What AvatarNetwork and InferenceNetwork share: which networks there are, what each makes, what each gets.

/// One StyleUNet of an avatar.
struct AvatarPart {
    enum class Role { Geometry, Appearance, Position, Other, Color, Material };
    Role role = Role::Geometry;
    std::string name;
    StyleUnetConfig config;

    bool isWanted(WantedAttributes wanted) const;
    /// Puts the columns of the network's rows (P, C) where they belong, as far as they are wanted.
    void take(const at::Tensor& rows, WantedAttributes wanted, RawAttributes& result) const;
};
/// In the order of the weights file.
std::vector<AvatarPart> avatarParts(const AvatarNetworkConfig& config);

/// What every network of one evaluation gets, before the view. Throws c10::Error where a map's shape does not fit.
StyleUnetInputs sharedInputs(const AvatarNetworkConfig& config, const std::optional<SideEncoder>& priorEncoder,
                             const AvatarNetworkInputs& inputs);

/// (2, c, h, w) as front and back, (1, c, h, w) each.
std::array<at::Tensor, 2> sidesOf(const at::Tensor& maps);

} // namespace ars
