#pragma once

#include "engine/core/error.h"
#include "engine/core/parameters.h"
#include "model/network/style_unet.h"

#include <vector>

namespace ars {

/// How the networks see the deformation priors (design section 4).
enum class PriorMode {
    Encoder, ///< encoder F, added inside every network
    Concat,  ///< the raw channels beside the position maps
    Off,
};
template <>
struct EnumWords<PriorMode> {
    static constexpr std::array words{"encoder", "concat", "off"};
};

/// Which networks there are.
enum class NetworkSplit {
    Four, ///< preset paper: position 3, other 8, colour 3 (with the view), material 4
    Two,  ///< geometry 11, appearance 7 (albedo 3, roughness 1, colour 3 by a copy of the last level)
};
template <>
struct EnumWords<NetworkSplit> {
    static constexpr std::array words{"four", "two"};
};

struct AvatarNetworkConfig {
    NetworkSplit split = NetworkSplit::Two;
    int inputSize = 128; ///< S; maps of the surfels have 2 S
    double channelMultiplier = 0.5;
    int maxChannels = 64;
    int styleSize = 512;
    PriorMode priors = PriorMode::Encoder;
    bool frontOnly = false;     ///< only the front position map, as Animatable Gaussians does
    bool viewDependent = true;  ///< radiance colour sees the view map
    bool viewNormals = false;   ///< which then also holds the normal in the world
    bool canonicalOnly = false; ///< ablation: the networks always see the canonical maps
    bool zeroOutputs = true;    ///< networks start at 0: the template itself

    bool operator==(const AvatarNetworkConfig&) const = default;
};
const ParameterTable<AvatarNetworkConfig>& avatarNetworkParameters();
/// Channels V of the view map: the cosine between normal and direction to the camera; with `viewNormals` also the
/// normal.
int viewMapChannels(const AvatarNetworkConfig& config);

/// Raw outputs of the networks at the maps' P points, before decoding (float).
struct RawAttributes {
    at::Tensor offsets;     ///< (P, 3)
    at::Tensor opacities;   ///< (P, 1)
    at::Tensor scales;      ///< (P, 3), the third is not used
    at::Tensor rotations;   ///< (P, 4)
    at::Tensor albedos;     ///< (P, 3)
    at::Tensor roughnesses; ///< (P, 1)
    at::Tensor colors;      ///< (P, 3)
};

/// Which groups of them are wanted; the others stay undefined and cost nothing where they have networks of their own.
struct WantedAttributes {
    bool geometry = true;
    bool materials = true;
    bool colors = true;
};

struct AvatarNetworkInputs {
    at::Tensor positions; ///< (2, 3, S, S): front and back position map
    at::Tensor priors;    ///< (2, 5, S, S), or undefined with PriorMode::Off
    at::Tensor view;      ///< (2, V, S, S), or undefined: colours as seen with a view map of zeros
};

/// Everything that stage 3 of a frame learns: StyleUNets, prior encoder, view encoder.
class AvatarNetwork {
public:
    static Result<AvatarNetwork> create(const AvatarNetworkConfig& config, std::uint64_t seed);

    const AvatarNetworkConfig& config() const { return config_; }
    /// Names as in a weights file: "geometry.", "appearance." | "position.", "other.", "color.", "material.", then
    /// "prior_encoder.", "view_encoder.".
    const NetworkTensors& tensors() const { return tensors_; }
    NetworkTensors& tensors() { return tensors_; }

    /// @param pixels (P) int64: places of the points in the (2 S, 4 S) picture (CanonicalMaps::pixels, size 2 S)
    RawAttributes evaluate(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                           WantedAttributes wanted = {}) const;

    /// The colours of several views of one pose: (P, 3) for each view map (2, V, S, S); the trunk is evaluated once.
    /// Where there is no view map in use all entries are the same tensor.
    std::vector<at::Tensor> evaluateColors(const AvatarNetworkInputs& inputs, const at::Tensor& pixels,
                                           const std::vector<at::Tensor>& views) const;
    /// Both at once, sharing the trunk: `colors` of RawAttributes stays undefined.
    RawAttributes evaluate(const AvatarNetworkInputs& inputs, const at::Tensor& pixels, WantedAttributes wanted,
                           const std::vector<at::Tensor>& views, std::vector<at::Tensor>& colors) const;

private:
    AvatarNetwork() = default;
    AvatarNetworkConfig config_;
    NetworkTensors tensors_;
    struct Parts;
    std::shared_ptr<const Parts> parts_;
};

} // namespace ars
