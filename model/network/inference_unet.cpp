#include "model/network/inference_unet.h"

#include "model/network/filters.h"
#include "model/network/network_layers.h"

#include <ATen/ATen.h>

#include <cmath>

namespace ars {
namespace {

constexpr auto kLast = at::MemoryFormat::ChannelsLast;
const double kRootTwo = std::sqrt(2.0);

} // namespace

InferenceUnet::InferenceUnet(const StyleUnetConfig& config, const NetworkTensors& tensors, const std::string& prefix,
                             at::ScalarType type)
    : config_(config), type_(type) {
    const at::NoGradGuard noGradients;
    for (const NetworkTensor& entry : tensors.all()) {
        if (entry.name.rfind(prefix, 0) == 0) tensors_[entry.name.substr(prefix.size())] = entry.tensor.detach();
    }
    style_ = styleVector();
    const int levels = levelCount(config);
    input_ = convolution("conv_in.1.weight", "conv_in.2.bias");
    for (int i = 0; i + 1 < levels; ++i) {
        const std::string map = fmt::format("from_rgbs.{}.conv.", i), block = fmt::format("cond_convs.{}.", i);
        fromMaps_.push_back(convolution(map + "0.weight", map + "1.bias"));
        same_.push_back(convolution(block + "conv1.0.weight", block + "conv1.1.bias"));
        halve_.push_back(convolution(block + "conv2.1.weight", block + "conv2.2.bias"));
    }
    for (int i = 0; i < levels; ++i) {
        combine_.push_back(
            convolution(fmt::format("comb_convs.{}.0.weight", i), fmt::format("comb_convs.{}.1.bias", i)));
    }
    const bool copy = config.view == ViewInjection::ColorCopy;
    if (copy) copyCombine_ = convolution("color_comb.0.weight", "color_comb.1.bias");
    for (int side = 0; side < 2; ++side) {
        const auto at = static_cast<std::size_t>(side);
        for (int k = 0; k < levels; ++k) {
            decoders_[at].push_back(
                level(fmt::format("convs{}", side + 1), 2 * k, fmt::format("to_rgbs{}.{}", side + 1, k), k));
        }
        if (copy) {
            copies_[at].push_back(level(fmt::format("color_convs{}", side + 1), 0,
                                        fmt::format("color_to_rgbs{}.0", side + 1), levels - 1));
        }
    }
    const auto projection = [&](const std::string& name) {
        const auto found = tensors_.find(name);
        return found == tensors_.end() ? at::Tensor() : scaledWeight(found->second, 0, kSideFeatureWidth);
    };
    priorProjection_ = projection("prior_projection.weight");
    viewProjection_ = projection("view_projection.weight");
    tensors_.clear();
}

at::Tensor InferenceUnet::styleVector() const {
    at::Tensor x = at::full({config_.styleSize}, 1 / std::sqrt(static_cast<double>(config_.styleSize)), at::kFloat);
    x = x / (x.square().mean() + 1e-8).sqrt();
    for (int i = 1; i <= config_.mappingLayers; ++i) {
        const at::Tensor& weight = tensors_.at(fmt::format("style.{}.weight", i));
        const double scale = kMappingRate / std::sqrt(static_cast<double>(config_.styleSize));
        x = at::leaky_relu(at::mv(weight, x) * scale + tensors_.at(fmt::format("style.{}.bias", i)) * kMappingRate,
                           0.2) *
            kRootTwo;
    }
    return x;
}

InferenceUnet::Convolution InferenceUnet::convolution(const std::string& weight, const std::string& bias) const {
    const at::Tensor& w = tensors_.at(weight);
    return {(scaledWeight(w, 0, w.size(1)) * kRootTwo).to(type_).contiguous(kLast), tensors_.at(bias) * kRootTwo};
}

at::Tensor InferenceUnet::modulatedOf(const std::string& name, bool demodulate, bool transposed) const {
    const ModulatedLayer layer{tensors_.at(name + ".conv.weight"), tensors_.at(name + ".conv.modulation.weight"),
                               tensors_.at(name + ".conv.modulation.bias")};
    return modulate(layer, style_, demodulate, transposed);
}

InferenceUnet::Styled InferenceUnet::styled(const std::string& name, const at::Tensor& noise, bool transposed) const {
    return {(modulatedOf(name, true, transposed) * kRootTwo).to(type_).contiguous(kLast),
            tensors_.at(name + ".activate.bias") * kRootTwo,
            (noise * tensors_.at(name + ".noise.weight") * kRootTwo).contiguous()};
}

InferenceUnet::Level InferenceUnet::level(const std::string& styledName, int first, const std::string& colorName,
                                          int noiseLevel) const {
    const auto noise = [&](int n) { return tensors_.at(fmt::format("noises.noise_{}", 2 * noiseLevel + n)); };
    Level result;
    result.up = styled(fmt::format("{}.{}", styledName, first), noise(0), true);
    result.same = styled(fmt::format("{}.{}", styledName, first + 1), noise(1), false);
    result.color.weight = modulatedOf(colorName, false, false).to(type_).contiguous(kLast);
    // A copy even where the type is the same: training goes on beside it.
    result.color.bias = tensors_.at(colorName + ".bias").reshape({-1}).to(type_, false, true);
    return result;
}

at::Tensor InferenceUnet::apply(const Convolution& layer, const at::Tensor& x, int stride, int padding) const {
    return activateFolded(
        at::conv2d(x, layer.weight, {}, at::IntArrayRef{stride}, at::IntArrayRef{padding}).contiguous(kLast),
        {.bias = layer.bias}, false);
}

at::Tensor InferenceUnet::skipHalf(const Convolution& layer, const at::Tensor& skip) const {
    const std::int64_t first = layer.weight.size(1) - skip.size(1);
    return at::conv2d(skip, layer.weight.slice(1, first).contiguous(kLast), {}, 1, at::IntArrayRef{1})
        .contiguous(kLast);
}

at::Tensor InferenceUnet::raise(const Level& at, const at::Tensor& x) const {
    const at::Tensor raised = at::conv_transpose2d(x, at.up.weight, {}, 2).contiguous(kLast);
    const at::Tensor doubled = activateFolded(raised, {.bias = at.up.bias, .noise = at.up.noise}, true);
    return activateFolded(at::conv2d(doubled, at.same.weight, {}, 1, at::IntArrayRef{1}).contiguous(kLast),
                          {.bias = at.same.bias, .noise = at.same.noise}, false);
}

at::Tensor InferenceUnet::addColors(const Level& at, const at::Tensor& x, const at::Tensor& image) const {
    return addSubbands(at::conv2d(x, at.color.weight, at.color.bias).to(at::kFloat), image);
}

at::Tensor InferenceUnet::atLevel(const at::Tensor& features, const at::Tensor& projection) const {
    at::Tensor x = features.to(at::kFloat).contiguous(kLast);
    if (projection.defined()) x = at::conv2d(x, projection);
    return at::upsample_bilinear2d(x, at::IntArrayRef{2 * x.size(2), 2 * x.size(3)}, false).to(type_);
}

std::array<at::Tensor, 2> InferenceUnet::evaluate(const StyleUnetInputs& inputs, bool trunkWanted) {
    const at::NoGradGuard noGradients;
    const std::size_t levels = combine_.size();
    at::Tensor picture = inputs.maps.contiguous(kLast);
    std::vector<at::Tensor> skips{apply(input_, blur(picture, 2, 2).to(type_), 2, 0)};
    for (std::size_t i = 0; i < same_.size(); ++i) {
        picture = blurDownsample(picture);
        const at::Tensor seen = skips.back() + apply(fromMaps_[i], picture.to(type_), 1, 0);
        skips.push_back(apply(halve_[i], blur(apply(same_[i], seen, 1, 1), 2, 2), 2, 0));
    }
    std::array<at::Tensor, 2> x, image;
    x.fill(apply(combine_.back(), skips.back(), 1, 1));
    const auto combined = [&](const Convolution& layer, const at::Tensor& features, const at::Tensor& half) {
        const at::Tensor weight = layer.weight.slice(1, 0, features.size(1)).contiguous(kLast);
        return activateFolded(at::conv2d(features, weight, {}, 1, at::IntArrayRef{1}).contiguous(kLast),
                              {.bias = layer.bias, .other = half}, false);
    };
    for (std::size_t k = 0; k + 1 < levels; ++k) {
        const Convolution& layer = combine_[levels - 1 - k];
        const at::Tensor half = k > 0 ? skipHalf(layer, skips[levels - 1 - k]) : at::Tensor();
        for (std::size_t side = 0; side < 2; ++side) {
            if (k > 0) x[side] = combined(layer, x[side], half);
            x[side] = raise(decoders_[side][k], x[side]);
            image[side] = addColors(decoders_[side][k], x[side], image[side]);
        }
    }
    for (std::size_t side = 0; side < 2; ++side) {
        if (config_.priors && inputs.priors[side].defined()) {
            x[side] = x[side] + atLevel(inputs.priors[side], priorProjection_);
        }
    }
    features_ = x;
    images_ = image;
    const bool copy = config_.view == ViewInjection::ColorCopy;
    if (config_.view != ViewInjection::None) colorHalf_ = skipHalf(copy ? copyCombine_ : combine_[0], skips[0]);
    std::array<at::Tensor, 2> result;
    if (!trunkWanted) return result;
    const at::Tensor half = skipHalf(combine_[0], skips[0]);
    for (std::size_t side = 0; side < 2; ++side) {
        const Level& last = decoders_[side][levels - 1];
        at::Tensor seen = x[side];
        if (!copy && inputs.views[side].defined()) seen = seen + atLevel(inputs.views[side], viewProjection_);
        const at::Tensor before = image[side].slice(1, 0, config_.outputChannels - config_.colorChannels);
        result[side] = addColors(last, raise(last, combined(combine_[0], seen, half)), before);
    }
    return result;
}

std::array<at::Tensor, 2> InferenceUnet::evaluateColors(const std::array<at::Tensor, 2>& views) const {
    const at::NoGradGuard noGradients;
    const bool copy = config_.view == ViewInjection::ColorCopy;
    const Convolution& layer = copy ? copyCombine_ : combine_[0];
    std::array<at::Tensor, 2> result;
    for (std::size_t side = 0; side < 2; ++side) {
        const Level& last = copy ? copies_[side].front() : decoders_[side].back();
        at::Tensor seen = features_[side];
        if (views[side].defined()) seen = seen + atLevel(views[side], viewProjection_);
        const at::Tensor weight = layer.weight.slice(1, 0, seen.size(1)).contiguous(kLast);
        const at::Tensor x = activateFolded(at::conv2d(seen, weight, {}, 1, at::IntArrayRef{1}).contiguous(kLast),
                                            {.bias = layer.bias, .other = colorHalf_}, false);
        const std::int64_t first = copy ? config_.outputChannels - config_.colorChannels : 0;
        result[side] = addColors(last, raise(last, x), images_[side].slice(1, first));
    }
    return result;
}

} // namespace ars
