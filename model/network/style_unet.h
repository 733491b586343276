#pragma once

#include "engine/core/error.h"
#include "model/tensors.h"

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

namespace ars {

/// What a network does with the view map (viewMapChannels).
enum class ViewInjection {
    None,
    LastLevel, ///< added to the features before the last level of both decoders (avatar reference 1.6)
    ColorCopy, ///< as LastLevel, but into a copy of the last level that makes `colorChannels` alone: the trunk and the
               ///< other outputs never see the view
};

/// Sizes of one dual StyleUNet (avatar reference 1).
struct StyleUnetConfig {
    int inputSize = 512;          ///< S: side of the input maps, a power of two >= 64; the output's is 2 S
    int inputChannels = 6;        ///< both position maps; 3 with the front one alone
    int outputChannels = 3;       ///< C a side, colorChannels included
    int colorChannels = 0;        ///< ColorCopy: the last ones of C, made by the copy
    double channelMultiplier = 2; ///< of the levels above 32
    int maxChannels = 512;        ///< no level is wider
    int styleSize = 512;
    int mappingLayers = 2;
    bool priors = true; ///< adds the prior encoder's features at the level of side S/2
    ViewInjection view = ViewInjection::None;
    bool zeroOutputs = false; ///< ToRGB weights start at 0 instead of N(0,1): the first output is 0 everywhere

    bool operator==(const StyleUnetConfig&) const = default;
};

/// Widths: min(512, maxChannels) up to side 32, then 256 m at 64, 128 m at 128, 64 m at 256, 32 m at 512, 16 m at 1024
/// (m the multiplier), each at most maxChannels.
int levelWidth(const StyleUnetConfig& config, int side);
/// Levels of a decoder: from side 8 to S.
int levelCount(const StyleUnetConfig& config);

/// Width of the features that prior and view encoders make, (1, 128, S/4, S/4).
inline constexpr int kSideFeatureWidth = 128;

/// Inputs of one evaluation, batch 1, float, channels last or not.
struct StyleUnetInputs {
    at::Tensor maps;                  ///< (1, inputChannels, S, S)
    std::array<at::Tensor, 2> priors; ///< (1, 128, S/4, S/4) of the prior encoder for front and back, or undefined
    std::array<at::Tensor, 2> views;  ///< (1, 128, S/4, S/4) of the view encoder, or undefined: none is added
};

/// Which last levels are wanted; channels of the others are 0 (undefined with the sides apart).
struct StyleUnetWanted {
    bool trunk = true;  ///< the first C - colorChannels outputs; without a copy all
    bool colors = true; ///< the last colorChannels, ColorCopy alone
};

/// What a new camera needs of the last evaluation: features and images before the last level.
struct StyleUnetTrunk {
    std::array<at::Tensor, 2> features; ///< of both decoders, before the last level
    std::array<at::Tensor, 2> images;   ///< accumulated so far, (1, C, S, S)
    at::Tensor skip;                    ///< encoder features of that level
};

/// Maps of front and back, (1, channels, 2 S, 2 S): what the trunk makes and what the colour copy makes.
struct StyleUnetSides {
    std::array<at::Tensor, 2> trunk;  ///< C - colorChannels of them with ColorCopy, else C
    std::array<at::Tensor, 2> colors; ///< ColorCopy alone
};

/// The dual StyleUNet of Animatable Gaussians: shared encoder, skip fusion and mapping, two decoders
/// (docs/math/network.md). The form that trains: every tensor is a leaf of autograd.
class StyleUnet {
public:
    /// Draws weights N(0,1) and noises from `seed` on the CPU. InvalidArgument naming the number that does not fit.
    static Result<StyleUnet> create(const StyleUnetConfig& config, std::uint64_t seed);

    const StyleUnetConfig& config() const { return config_; }
    const NetworkTensors& tensors() const { return tensors_; }
    NetworkTensors& tensors() { return tensors_; }

    /// Maps (1, 2 C, 2 S, 2 S): the front's C channels, then the back's. `trunk`, when given, receives what
    /// evaluateColors needs.
    at::Tensor evaluate(const StyleUnetInputs& inputs, StyleUnetWanted wanted = {},
                        StyleUnetTrunk* trunk = nullptr) const;
    /// The same with the sides apart and what is not wanted left undefined.
    StyleUnetSides evaluateSides(const StyleUnetInputs& inputs, StyleUnetWanted wanted = {},
                                 StyleUnetTrunk* trunk = nullptr) const;
    /// What sees the view, for other views of the same maps: (1, 2 colorChannels, 2 S, 2 S) with ColorCopy, all
    /// (1, 2 C, 2 S, 2 S) with LastLevel.
    at::Tensor evaluateColors(const StyleUnetTrunk& trunk, const std::array<at::Tensor, 2>& views) const;
    std::array<at::Tensor, 2> evaluateColorSides(const StyleUnetTrunk& trunk,
                                                 const std::array<at::Tensor, 2>& views) const;

private:
    StyleUnet() = default;
    StyleUnetConfig config_;
    NetworkTensors tensors_;
    struct Layers;
    std::shared_ptr<const Layers> layers_;
};

/// Two stride-2 convolutions 4x4, `channels` -> 64 -> 128, leaky ReLU between (and after none), shared by front and
/// back: the prior encoder F (5 channels) and the view encoder (1 channel).
class SideEncoder {
public:
    static SideEncoder create(int channels, std::uint64_t seed);
    const NetworkTensors& tensors() const { return tensors_; }
    NetworkTensors& tensors() { return tensors_; }
    /// (n, channels, S, S) -> (n, 128, S/4, S/4).
    at::Tensor evaluate(const at::Tensor& maps) const;

private:
    NetworkTensors tensors_;
};

} // namespace ars
