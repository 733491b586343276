#pragma once

#include "model/network/style_unet.h"

#include <map>
#include <string>
#include <vector>

namespace ars {

/// One StyleUNet with everything constant folded in (see inference_network.h). Weights carry the activation's sqrt(2):
/// it passes through a leaky ReLU.
class InferenceUnet {
public:
    InferenceUnet(const StyleUnetConfig& config, const NetworkTensors& tensors, const std::string& prefix,
                  at::ScalarType type);

    const StyleUnetConfig& config() const { return config_; }
    /// Everything up to the last level, kept; and the last level where `trunkWanted` (with ColorCopy: of what never
    /// sees the view).
    std::array<at::Tensor, 2> evaluate(const StyleUnetInputs& inputs, bool trunkWanted);
    /// The last level that sees the view, from what was kept.
    std::array<at::Tensor, 2> evaluateColors(const std::array<at::Tensor, 2>& views) const;
    bool hasPose() const { return features_[0].defined(); }

private:
    struct Convolution {
        at::Tensor weight, bias;
    };
    struct Styled {
        at::Tensor weight, bias, noise;
    };
    struct Level {
        Styled up, same;
        Convolution color;
    };
    Convolution convolution(const std::string& weight, const std::string& bias) const;
    Styled styled(const std::string& name, const at::Tensor& noise, bool transposed) const;
    Level level(const std::string& styledName, int first, const std::string& colorName, int noiseLevel) const;
    at::Tensor modulatedOf(const std::string& name, bool demodulate, bool transposed) const;
    at::Tensor styleVector() const;
    at::Tensor apply(const Convolution& layer, const at::Tensor& x, int stride, int padding) const;
    at::Tensor skipHalf(const Convolution& layer, const at::Tensor& skip) const;
    at::Tensor raise(const Level& level, const at::Tensor& x) const;
    at::Tensor addColors(const Level& level, const at::Tensor& x, const at::Tensor& image) const;
    at::Tensor atLevel(const at::Tensor& features, const at::Tensor& projection) const;

    StyleUnetConfig config_;
    at::ScalarType type_;
    std::map<std::string, at::Tensor> tensors_; ///< only while it is made
    at::Tensor style_;
    Convolution input_;
    std::vector<Convolution> fromMaps_, same_, halve_, combine_; ///< finest first
    Convolution copyCombine_;
    std::array<std::vector<Level>, 2> decoders_;
    std::array<std::vector<Level>, 2> copies_;
    at::Tensor priorProjection_, viewProjection_;
    std::array<at::Tensor, 2> features_, images_; ///< of the last pose, before the last level
    at::Tensor colorHalf_;                        ///< skip half of the level that sees the view, bias included
};

} // namespace ars
