#include "model/network/style_unet.h"

#include "model/network/filters.h"
#include "model/network/network_layers.h"

#include <ATen/ATen.h>
#include <ATen/CPUGeneratorImpl.h>

#include <bit>
#include <cmath>

namespace ars {
namespace {

constexpr auto kLast = at::MemoryFormat::ChannelsLast;
/// The coarsest features have this side.
constexpr int kBottleneck = 8;

/// Draws initial values in the order in which they are asked for.
class Initializer {
public:
    explicit Initializer(std::uint64_t seed) : generator_(at::detail::createCPUGenerator(seed)) {}
    at::Tensor normal(at::IntArrayRef shape, double deviation = 1) {
        return at::empty(shape, at::kFloat).normal_(0, deviation, generator_);
    }
    at::Tensor uniform(at::IntArrayRef shape, double bound) {
        return at::empty(shape, at::kFloat).uniform_(-bound, bound, generator_);
    }

private:
    at::Generator generator_;
};

at::Tensor zeros(at::IntArrayRef shape) { return at::zeros(shape, at::kFloat); }
at::Tensor ones(at::IntArrayRef shape) { return at::ones(shape, at::kFloat); }

/// What a learned tensor draws its first values from and where it is kept.
struct Builder {
    const StyleUnetConfig& config;
    NetworkTensors& tensors;
    Initializer& random;

    int width(int side) const { return levelWidth(config, side); }
    ConvolutionLayer convolution(const std::string& weight, const std::string& bias, int in, int out, int size) const {
        ConvolutionLayer layer;
        layer.weight = tensors.parameter(weight, random.normal({out, in, size, size}));
        if (!bias.empty()) layer.bias = tensors.parameter(bias, zeros({out}));
        return layer;
    }
    ModulatedLayer modulated(const std::string& name, int in, int out, int size, bool zero) const {
        ModulatedLayer layer;
        at::Tensor weight = random.normal({1, out, in, size, size});
        layer.weight = tensors.parameter(name + ".conv.weight", zero ? at::zeros_like(weight) : weight);
        layer.styleWeight = tensors.parameter(name + ".conv.modulation.weight", random.normal({in, config.styleSize}));
        layer.styleBias = tensors.parameter(name + ".conv.modulation.bias", ones({in}));
        return layer;
    }
    StyledLayer styled(const std::string& name, int in, int out) const {
        StyledLayer layer;
        layer.modulated = modulated(name, in, out, 3, false);
        layer.strength = tensors.parameter(name + ".noise.weight", zeros({1}));
        layer.bias = tensors.parameter(name + ".activate.bias", zeros({out}));
        return layer;
    }
    ColorLayer color(const std::string& name, int in, int channels) const {
        ColorLayer layer;
        layer.modulated = modulated(name, in, 4 * channels, 1, config.zeroOutputs);
        layer.bias = tensors.parameter(name + ".bias", zeros({1, 4 * channels, 1, 1}));
        return layer;
    }
};

Error badConfig(std::string_view name, std::string expected, double found) {
    return makeError(ErrorCode::InvalidArgument, std::string("network ") + std::string(name),
                     fmt::format("expected {}, found {}", expected, found));
}

Status checkConfig(const StyleUnetConfig& config) {
    if (config.inputSize < 64 || config.inputSize > 4096 || !std::has_single_bit(unsigned(config.inputSize))) {
        return badConfig("input size", "a power of two from 64 to 4096", config.inputSize);
    }
    if (config.inputChannels < 1 || config.inputChannels > 64) {
        return badConfig("input channels", "1 to 64", config.inputChannels);
    }
    if (config.outputChannels < 1 || config.outputChannels > 256) {
        return badConfig("output channels", "1 to 256", config.outputChannels);
    }
    const bool copy = config.view == ViewInjection::ColorCopy;
    if (copy && (config.colorChannels < 1 || config.colorChannels >= config.outputChannels)) {
        return badConfig("color channels", fmt::format("1 to {}", config.outputChannels - 1), config.colorChannels);
    }
    if (!copy && config.colorChannels != 0) {
        return badConfig("color channels", "0 without a colour copy", config.colorChannels);
    }
    if (!(config.channelMultiplier > 0 && config.channelMultiplier <= 16)) {
        return badConfig("channel multiplier", "above 0, at most 16", config.channelMultiplier);
    }
    if (config.maxChannels < 1 || config.maxChannels > 1024) {
        return badConfig("max channels", "1 to 1024", config.maxChannels);
    }
    if (config.styleSize < 1 || config.styleSize > 4096) return badConfig("style size", "1 to 4096", config.styleSize);
    if (config.mappingLayers < 0 || config.mappingLayers > 16) {
        return badConfig("mapping layers", "0 to 16", config.mappingLayers);
    }
    if (levelWidth(config, config.inputSize) < 1) {
        return badConfig("channel multiplier", "at least one channel at the input size", config.channelMultiplier);
    }
    return {};
}

at::Tensor leakyRelu(const at::Tensor& x) { return at::leaky_relu(x, 0.2); }

} // namespace

int levelWidth(const StyleUnetConfig& config, int side) {
    const double full = side <= 32 ? 512 : 16384.0 / side * config.channelMultiplier;
    return std::min({512, config.maxChannels, static_cast<int>(full)});
}

int levelCount(const StyleUnetConfig& config) {
    return std::countr_zero(unsigned(config.inputSize)) - std::countr_zero(unsigned(kBottleneck));
}

/// One decoder; the colour copy's last level has its own.
struct DecoderLayers {
    std::vector<StyledLayer> styled; ///< two a level: doubling, same size
    std::vector<ColorLayer> colors;  ///< one a level
};

struct StyleUnet::Layers {
    std::vector<ConvolutionLayer> mapping;
    ConvolutionLayer input;
    std::vector<ConvolutionLayer> fromMaps;    ///< of the encoder's stages, finest first
    std::vector<ConvolutionLayer> same, halve; ///< likewise
    std::vector<ConvolutionLayer> combine;     ///< finest first; the last has no second half
    std::array<DecoderLayers, 2> decoders;
    std::vector<at::Tensor> noises;
    ConvolutionLayer copyCombine;
    std::array<DecoderLayers, 2> copies; ///< one level each
    at::Tensor priorProjection, viewProjection;
    at::Tensor style; ///< what the mapping starts from, normalised

    void addMapping(const Builder& build);
    void addEncoder(const Builder& build);
    void addDecoders(const Builder& build);
    void addColorCopy(const Builder& build);
    void addProjections(const Builder& build);

    at::Tensor styleOf() const;
    std::vector<at::Tensor> encode(const at::Tensor& maps) const;
    at::Tensor skipHalf(const ConvolutionLayer& combine, const at::Tensor& skip) const;
    at::Tensor lastLevel(const ConvolutionLayer& combine, const DecoderLayers& decoder, std::size_t level,
                         const at::Tensor& features, const at::Tensor& skipHalf, const at::Tensor& image,
                         const at::Tensor& style) const;
    at::Tensor raise(const DecoderLayers& decoder, std::size_t level, std::size_t noiseLevel, const at::Tensor& x,
                     const at::Tensor& style) const;
};

// The order in which layers are built is the order in which their first values are drawn.

void StyleUnet::Layers::addMapping(const Builder& build) {
    const StyleUnetConfig& config = build.config;
    style = at::full({config.styleSize}, 1 / std::sqrt(static_cast<double>(config.styleSize)), at::kFloat);
    style = style / (style.square().mean() + 1e-8).sqrt();
    for (int i = 1; i <= config.mappingLayers; ++i) {
        ConvolutionLayer layer;
        const std::string name = fmt::format("style.{}", i);
        layer.weight = build.tensors.parameter(
            name + ".weight", build.random.normal({config.styleSize, config.styleSize}, 1 / kMappingRate));
        layer.bias = build.tensors.parameter(name + ".bias", zeros({config.styleSize}));
        mapping.push_back(layer);
    }
}

void StyleUnet::Layers::addEncoder(const Builder& build) {
    const int levels = levelCount(build.config), size = build.config.inputSize, maps = build.config.inputChannels;
    input = build.convolution("conv_in.1.weight", "conv_in.2.bias", maps, build.width(size / 2), 3);
    for (int i = 0; i < levels - 1; ++i) {
        const int here = build.width(size >> (i + 1)), next = build.width(size >> (i + 2));
        const std::string map = fmt::format("from_rgbs.{}.conv.", i), block = fmt::format("cond_convs.{}.", i);
        fromMaps.push_back(build.convolution(map + "0.weight", map + "1.bias", maps, here, 1));
        same.push_back(build.convolution(block + "conv1.0.weight", block + "conv1.1.bias", here, here, 3));
        halve.push_back(build.convolution(block + "conv2.1.weight", block + "conv2.2.bias", here, next, 3));
    }
    for (int i = 0; i < levels; ++i) {
        const int here = build.width(size >> (i + 1));
        const std::string name = fmt::format("comb_convs.{}.", i);
        combine.push_back(
            build.convolution(name + "0.weight", name + "1.bias", i + 1 < levels ? 2 * here : here, here, 3));
    }
}

void StyleUnet::Layers::addDecoders(const Builder& build) {
    const StyleUnetConfig& config = build.config;
    const int levels = levelCount(config);
    for (int side = 0; side < 2; ++side) {
        DecoderLayers& decoder = decoders[static_cast<std::size_t>(side)];
        for (int k = 0; k < levels; ++k) {
            const int in = build.width(kBottleneck << k), out = build.width(kBottleneck << (k + 1));
            const int channels = config.outputChannels - (k + 1 == levels ? config.colorChannels : 0);
            decoder.styled.push_back(build.styled(fmt::format("convs{}.{}", side + 1, 2 * k), in, out));
            decoder.styled.push_back(build.styled(fmt::format("convs{}.{}", side + 1, 2 * k + 1), out, out));
            decoder.colors.push_back(build.color(fmt::format("to_rgbs{}.{}", side + 1, k), out, channels));
        }
    }
    for (int n = 0; n < 2 * levels; ++n) {
        const int side = kBottleneck << (n / 2 + 1);
        noises.push_back(
            build.tensors.constant(fmt::format("noises.noise_{}", n), build.random.normal({1, 1, side, side})));
    }
}

void StyleUnet::Layers::addColorCopy(const Builder& build) {
    const StyleUnetConfig& config = build.config;
    const int in = build.width(config.inputSize / 2), out = build.width(config.inputSize);
    copyCombine = build.convolution("color_comb.0.weight", "color_comb.1.bias", 2 * in, in, 3);
    for (int side = 0; side < 2; ++side) {
        DecoderLayers& copy = copies[static_cast<std::size_t>(side)];
        copy.styled.push_back(build.styled(fmt::format("color_convs{}.0", side + 1), in, out));
        copy.styled.push_back(build.styled(fmt::format("color_convs{}.1", side + 1), out, out));
        copy.colors.push_back(build.color(fmt::format("color_to_rgbs{}.0", side + 1), out, config.colorChannels));
    }
}

/// 1x1 projections of the side features, where the level that they join has another width.
void StyleUnet::Layers::addProjections(const Builder& build) {
    const int sideWidth = build.width(build.config.inputSize / 2);
    if (sideWidth == kSideFeatureWidth) return;
    if (build.config.priors) {
        priorProjection = build.convolution("prior_projection.weight", "", kSideFeatureWidth, sideWidth, 1).weight;
    }
    if (build.config.view != ViewInjection::None) {
        viewProjection = build.convolution("view_projection.weight", "", kSideFeatureWidth, sideWidth, 1).weight;
    }
}

Result<StyleUnet> StyleUnet::create(const StyleUnetConfig& config, std::uint64_t seed) {
    ARS_TRY_STATUS(checkConfig(config));
    StyleUnet network;
    network.config_ = config;
    Initializer random(seed);
    const Builder build{config, network.tensors_, random};
    auto layers = std::make_shared<Layers>();
    layers->addMapping(build);
    layers->addEncoder(build);
    layers->addDecoders(build);
    if (config.view == ViewInjection::ColorCopy) layers->addColorCopy(build);
    layers->addProjections(build);
    network.layers_ = layers;
    return network;
}

at::Tensor StyleUnet::Layers::styleOf() const {
    at::Tensor x = style.to(input.weight.device(), input.weight.scalar_type());
    for (const ConvolutionLayer& layer : mapping) {
        const double scale = kMappingRate / std::sqrt(static_cast<double>(x.numel()));
        x = leakyRelu(at::mv(layer.weight, x) * scale + layer.bias * kMappingRate) * std::sqrt(2.0);
    }
    return x;
}

std::vector<at::Tensor> StyleUnet::Layers::encode(const at::Tensor& maps) const {
    at::Tensor picture = maps.contiguous(kLast);
    at::Tensor x = activate(convolve(input, blur(picture, 2, 2), 2, 0), {.bias = input.bias});
    std::vector<at::Tensor> features{x};
    for (std::size_t i = 0; i < same.size(); ++i) {
        picture = blurDownsample(picture);
        x = x + activate(convolve(fromMaps[i], picture, 1, 0), {.bias = fromMaps[i].bias});
        x = activate(convolve(same[i], x, 1, 1), {.bias = same[i].bias});
        x = activate(convolve(halve[i], blur(x, 2, 2), 2, 0), {.bias = halve[i].bias});
        features.push_back(x);
    }
    return features;
}

at::Tensor StyleUnet::Layers::skipHalf(const ConvolutionLayer& layer, const at::Tensor& skip) const {
    const std::int64_t width = skip.size(1);
    return at::conv2d(skip, scaledWeight(layer.weight, layer.weight.size(1) - width, width), {}, 1, 1);
}

at::Tensor StyleUnet::Layers::raise(const DecoderLayers& decoder, std::size_t level, std::size_t noiseLevel,
                                    const at::Tensor& x, const at::Tensor& styleVector) const {
    const StyledLayer& up = decoder.styled[2 * level];
    const StyledLayer& flat = decoder.styled[2 * level + 1];
    const at::Tensor raised = at::conv_transpose2d(x, modulate(up.modulated, styleVector, true, true), {}, 2);
    const at::Tensor doubled =
        blurActivate(raised, {.bias = up.bias, .noise = noises[2 * noiseLevel], .strength = up.strength});
    return activate(at::conv2d(doubled, modulate(flat.modulated, styleVector, true, false), {}, 1, 1),
                    {.bias = flat.bias, .noise = noises[2 * noiseLevel + 1], .strength = flat.strength});
}

namespace {

at::Tensor combineHalves(const ConvolutionLayer& layer, const at::Tensor& x, const at::Tensor& skipHalf) {
    ActivationTerms terms;
    terms.bias = layer.bias;
    terms.other = skipHalf;
    return activate(at::conv2d(x, scaledWeight(layer.weight, 0, x.size(1)), {}, 1, 1), terms);
}

at::Tensor addColors(const ColorLayer& layer, const at::Tensor& x, const at::Tensor& image, const at::Tensor& style) {
    const at::Tensor weight = modulate(layer.modulated, style, false, false);
    return addSubbands(at::conv2d(x, weight, layer.bias.reshape({-1})), image);
}

/// Features of an encoder (1, 128, S/4, S/4) at the width and size of the level; projecting before enlarging is the
/// same and cheaper.
at::Tensor atLevel(const at::Tensor& features, const at::Tensor& projection) {
    at::Tensor x = features.contiguous(kLast);
    if (projection.defined()) x = at::conv2d(x, scaledWeight(projection, 0, projection.size(1)));
    return at::upsample_bilinear2d(x, at::IntArrayRef{2 * x.size(2), 2 * x.size(3)}, false);
}

at::Tensor channels(const at::Tensor& image, std::int64_t first, std::int64_t count) {
    return count == image.size(1) ? image : image.slice(1, first, first + count);
}

} // namespace

at::Tensor StyleUnet::Layers::lastLevel(const ConvolutionLayer& combineLayer, const DecoderLayers& decoder,
                                        std::size_t level, const at::Tensor& features, const at::Tensor& half,
                                        const at::Tensor& image, const at::Tensor& styleVector) const {
    const at::Tensor x =
        raise(decoder, level, noises.size() / 2 - 1, combineHalves(combineLayer, features, half), styleVector);
    return addColors(decoder.colors[level], x, image, styleVector);
}

StyleUnetSides StyleUnet::evaluateSides(const StyleUnetInputs& inputs, StyleUnetWanted wanted,
                                        StyleUnetTrunk* trunk) const {
    const Layers& layers = *layers_;
    const std::size_t levels = static_cast<std::size_t>(levelCount(config_));
    const bool copy = config_.view == ViewInjection::ColorCopy;
    TORCH_CHECK(inputs.maps.dim() == 4 && inputs.maps.size(0) == 1 && inputs.maps.size(1) == config_.inputChannels &&
                    inputs.maps.size(2) == config_.inputSize && inputs.maps.size(3) == config_.inputSize,
                "network: expected maps (1, ", config_.inputChannels, ", ", config_.inputSize, ", ", config_.inputSize,
                "), found ", inputs.maps.sizes());
    const at::Tensor style = layers.styleOf();
    const std::vector<at::Tensor> skips = layers.encode(inputs.maps);

    std::array<at::Tensor, 2> x, image;
    const ConvolutionLayer& bottom = layers.combine.back();
    x.fill(activate(convolve(bottom, skips.back(), 1, 1), {.bias = bottom.bias}));
    for (std::size_t k = 0; k + 1 < levels; ++k) {
        const ConvolutionLayer& combine = layers.combine[levels - 1 - k];
        const at::Tensor half = k > 0 ? layers.skipHalf(combine, skips[levels - 1 - k]) : at::Tensor();
        for (std::size_t side = 0; side < 2; ++side) {
            if (k > 0) x[side] = combineHalves(combine, x[side], half);
            x[side] = layers.raise(layers.decoders[side], k, k, x[side], style);
            image[side] = addColors(layers.decoders[side].colors[k], x[side], image[side], style);
        }
    }
    for (std::size_t side = 0; side < 2; ++side) {
        if (config_.priors && inputs.priors[side].defined()) {
            x[side] = x[side] + atLevel(inputs.priors[side], layers.priorProjection);
        }
    }
    if (trunk) *trunk = {x, image, skips[0]};

    StyleUnetSides result;
    if (wanted.trunk) {
        const at::Tensor half = layers.skipHalf(layers.combine[0], skips[0]);
        for (std::size_t side = 0; side < 2; ++side) {
            at::Tensor features = x[side];
            if (!copy && inputs.views[side].defined())
                features = features + atLevel(inputs.views[side], layers.viewProjection);
            const at::Tensor before = channels(image[side], 0, config_.outputChannels - config_.colorChannels);
            result.trunk[side] =
                layers.lastLevel(layers.combine[0], layers.decoders[side], levels - 1, features, half, before, style);
        }
    }
    if (copy && wanted.colors) result.colors = evaluateColorSides({x, image, skips[0]}, inputs.views);
    return result;
}

std::array<at::Tensor, 2> StyleUnet::evaluateColorSides(const StyleUnetTrunk& trunk,
                                                        const std::array<at::Tensor, 2>& views) const {
    TORCH_CHECK(config_.view != ViewInjection::None, "network: it has no view input");
    const Layers& layers = *layers_;
    const bool copy = config_.view == ViewInjection::ColorCopy;
    const std::size_t level = copy ? 0 : static_cast<std::size_t>(levelCount(config_)) - 1;
    const ConvolutionLayer& combine = copy ? layers.copyCombine : layers.combine[0];
    const at::Tensor style = layers.styleOf();
    const at::Tensor half = layers.skipHalf(combine, trunk.skip);
    std::array<at::Tensor, 2> result;
    for (std::size_t side = 0; side < 2; ++side) {
        at::Tensor features = trunk.features[side];
        if (views[side].defined()) features = features + atLevel(views[side], layers.viewProjection);
        const at::Tensor before =
            copy ? channels(trunk.images[side], config_.outputChannels - config_.colorChannels, config_.colorChannels)
                 : trunk.images[side];
        result[side] = layers.lastLevel(combine, copy ? layers.copies[side] : layers.decoders[side], level, features,
                                        half, before, style);
    }
    return result;
}

at::Tensor StyleUnet::evaluate(const StyleUnetInputs& inputs, StyleUnetWanted wanted, StyleUnetTrunk* trunk) const {
    const StyleUnetSides sides = evaluateSides(inputs, wanted, trunk);
    const std::int64_t size = 2 * config_.inputSize;
    const std::int64_t colorChannels = config_.colorChannels;
    std::vector<at::Tensor> parts;
    for (std::size_t side = 0; side < 2; ++side) {
        const at::Tensor& trunkPart = sides.trunk[side];
        const auto empty = [&](std::int64_t count) { return at::zeros({1, count, size, size}, inputs.maps.options()); };
        parts.push_back(trunkPart.defined() ? trunkPart : empty(config_.outputChannels - colorChannels));
        if (colorChannels > 0)
            parts.push_back(sides.colors[side].defined() ? sides.colors[side] : empty(colorChannels));
    }
    return at::cat(parts, 1);
}

at::Tensor StyleUnet::evaluateColors(const StyleUnetTrunk& trunk, const std::array<at::Tensor, 2>& views) const {
    const auto sides = evaluateColorSides(trunk, views);
    return at::cat({sides[0], sides[1]}, 1);
}

SideEncoder SideEncoder::create(int channels, std::uint64_t seed) {
    SideEncoder encoder;
    Initializer random(seed);
    const int widths[] = {channels, 64, kSideFeatureWidth};
    for (int i = 0; i < 2; ++i) {
        // 1 / sqrt(fan in), which is what PyTorch's own convolutions start with.
        const double bound = 1 / std::sqrt(16.0 * widths[i]);
        const std::string name = fmt::format("{}.", 2 * i);
        encoder.tensors_.parameter(name + "weight", random.uniform({widths[i + 1], widths[i], 4, 4}, bound));
        encoder.tensors_.parameter(name + "bias", random.uniform({widths[i + 1]}, bound));
    }
    return encoder;
}

at::Tensor SideEncoder::evaluate(const at::Tensor& maps) const {
    const auto& all = tensors_.all();
    const auto weight = [&](std::size_t i) { return all[i].tensor.contiguous(kLast); };
    const at::Tensor x = leakyRelu(at::conv2d(maps.contiguous(kLast), weight(0), all[1].tensor, 2, 1));
    return at::conv2d(x, weight(2), all[3].tensor, 2, 1);
}

} // namespace ars
