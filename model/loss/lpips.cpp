#include "model/loss/known_gradient.h"
#include "model/loss/loss_chains.h"
#include "model/loss/perceptual.h"
#include "model/loss/torch_file.h"

#include <ATen/Dispatch.h>
#include <fmt/format.h>

#include <array>
#include <cmath>

/// LPIPS v0.1 (Zhang et al. 2018): features of a classifier, unit length at every pixel, squared differences weighted
/// by learned numbers, mean over pixels, sum over five layers.
namespace ars {
namespace {

/// A convolution with its ReLU, and what comes around it.
struct Layer {
    const char* name; ///< torchvision's
    int inputs, outputs, kernel, stride, padding;
    int poolBefore; ///< side of a max pooling with stride 2; 0: none
    bool tap;       ///< compared after its ReLU
};

struct Backbone {
    const char* name; ///< in reports
    std::span<const Layer> layers;
};

constexpr Layer kVgg16[] = {{"features.0", 3, 64, 3, 1, 1, 0, false},     {"features.2", 64, 64, 3, 1, 1, 0, true},
                            {"features.5", 64, 128, 3, 1, 1, 2, false},   {"features.7", 128, 128, 3, 1, 1, 0, true},
                            {"features.10", 128, 256, 3, 1, 1, 2, false}, {"features.12", 256, 256, 3, 1, 1, 0, false},
                            {"features.14", 256, 256, 3, 1, 1, 0, true},  {"features.17", 256, 512, 3, 1, 1, 2, false},
                            {"features.19", 512, 512, 3, 1, 1, 0, false}, {"features.21", 512, 512, 3, 1, 1, 0, true},
                            {"features.24", 512, 512, 3, 1, 1, 2, false}, {"features.26", 512, 512, 3, 1, 1, 0, false},
                            {"features.28", 512, 512, 3, 1, 1, 0, true}};
constexpr Layer kAlexNet[] = {{"features.0", 3, 64, 11, 4, 2, 0, true},
                              {"features.3", 64, 192, 5, 1, 2, 3, true},
                              {"features.6", 192, 384, 3, 1, 1, 3, true},
                              {"features.8", 384, 256, 3, 1, 1, 0, true},
                              {"features.10", 256, 256, 3, 1, 1, 0, true}};
constexpr double kShift[3] = {-0.030, -0.088, -0.188}, kScale[3] = {0.458, 0.448, 0.450};

/// One layer's term, 1/P sum_p sum_c w_c (f_c / (|f| + e) - g_c / (|g| + e))^2, with its gradient by f.
/// Both are (P, C), pixels outside, so that a pixel's channels lie together.
template <typename T>
double layerDistance(const T* f, const T* g, const T* weights, std::size_t pixels, std::size_t channels, T* gradient) {
    const T guard = static_cast<T>(chains::kLengthGuard);
    const double sum = detail::sumOverRows(pixels, 64, [&](std::size_t p) {
        const T *fp = f + p * channels, *gp = g + p * channels;
        T squareF = 0, squareG = 0;
#pragma omp simd reduction(+ : squareF, squareG)
        for (std::size_t c = 0; c < channels; ++c) {
            squareF += fp[c] * fp[c];
            squareG += gp[c] * gp[c];
        }
        const T length = std::sqrt(squareF), inverseF = T(1) / (length + guard),
                inverseG = T(1) / (std::sqrt(squareG) + guard);
        T distance = 0, along = 0;
#pragma omp simd reduction(+ : distance, along)
        for (std::size_t c = 0; c < channels; ++c) {
            const T difference = fp[c] * inverseF - gp[c] * inverseG;
            distance += weights[c] * difference * difference;
            along += T(2) * weights[c] * difference * fp[c];
        }
        if (gradient) {
            T* out = gradient + p * channels;
            // Where nothing fires the ReLU passes nothing on, whatever stands here.
            const T back = length > T(0) ? along * inverseF * inverseF / length : T(0);
            const T forth = length > T(0) ? inverseF : T(0);
#pragma omp simd
            for (std::size_t c = 0; c < channels; ++c) {
                const T difference = fp[c] * inverseF - gp[c] * inverseG;
                out[c] = T(2) * weights[c] * difference * forth - back * fp[c];
            }
        }
        return static_cast<double>(distance);
    });
    return sum / static_cast<double>(pixels);
}

class Lpips final : public PerceptualLoss {
public:
    struct Convolution {
        Layer layer;
        at::Tensor weight, bias;
    };
    Lpips(const char* name, std::vector<Convolution> convolutions, std::vector<at::Tensor> heads)
        : name_(name), convolutions_(std::move(convolutions)), heads_(std::move(heads)) {
        at::Tensor shift = at::empty({1, 3, 1, 1}), scale = at::empty({1, 3, 1, 1});
        // (2 x - 1 - shift) / scale
        for (int c = 0; c < 3; ++c) {
            scale.data_ptr<float>()[c] = static_cast<float>(2 / kScale[c]);
            shift.data_ptr<float>()[c] = static_cast<float>((-1 - kShift[c]) / kScale[c]);
        }
        scale_ = scale;
        shift_ = shift;
    }

    std::string name() const override { return name_; }

    void moveTo(const c10::Device& device) override {
        for (Convolution& c : convolutions_) {
            c.weight = c.weight.to(device);
            c.bias = c.bias.to(device);
        }
        for (at::Tensor& head : heads_) head = head.to(device);
        scale_ = scale_.to(device);
        shift_ = shift_.to(device);
    }

    at::Tensor evaluate(const at::Tensor& picture, const at::Tensor& target) const override {
        TORCH_CHECK(picture.dim() == 3 && picture.size(2) == 3 && picture.sizes() == target.sizes(), name_,
                    ": expected two pictures (height, width, 3), found ", picture.sizes(), " and ", target.sizes());
        TORCH_CHECK(picture.size(0) >= kLeastSide && picture.size(1) >= kLeastSide, name_,
                    ": expected pictures of at least ", kLeastSide, " pixels a side, found ", picture.size(1), " x ",
                    picture.size(0));
        std::vector<at::Tensor> theirs;
        {
            const at::NoGradGuard off;
            theirs = features(target.detach().to(picture.scalar_type()));
        }
        const std::vector<at::Tensor> ours = features(picture);
        at::Tensor total;
        for (std::size_t k = 0; k < ours.size(); ++k) {
            const at::Tensor term = distance(ours[k], theirs[k], heads_[k].to(picture.scalar_type()));
            total = total.defined() ? total + term : term;
        }
        return total;
    }

private:
    /// The smallest picture of which AlexNet's last layers have something left.
    static constexpr std::int64_t kLeastSide = 32;

    std::vector<at::Tensor> features(const at::Tensor& picture) const {
        const auto type = picture.scalar_type();
        // (H, W, 3) is what channels-last memory looks like: no copy.
        at::Tensor x = picture.permute({2, 0, 1}).unsqueeze(0) * scale_.to(type) + shift_.to(type);
        std::vector<at::Tensor> taps;
        for (const Convolution& c : convolutions_) {
            if (c.layer.poolBefore > 0) x = at::max_pool2d(x, {c.layer.poolBefore, c.layer.poolBefore}, {2, 2});
            x = at::conv2d(x, c.weight.to(type), c.bias.to(type), {c.layer.stride, c.layer.stride},
                           {c.layer.padding, c.layer.padding});
            x = at::relu(x);
            if (c.layer.tap) taps.push_back(x);
        }
        return taps;
    }

    static at::Tensor distance(const at::Tensor& ours, const at::Tensor& theirs, const at::Tensor& weights) {
        // Features are too large to be brought to the host.
        if (!ours.is_cpu()) return chains::featureDistance(ours, theirs, weights);
        const at::Tensor f = ours.detach().contiguous(at::MemoryFormat::ChannelsLast);
        const at::Tensor g = theirs.contiguous(at::MemoryFormat::ChannelsLast);
        at::Tensor gradient;
        if (detail::wantsGradient(ours)) gradient = at::empty_like(f);
        const auto channels = static_cast<std::size_t>(f.size(1));
        const auto pixels = static_cast<std::size_t>(f.size(2) * f.size(3));
        double value = 0;
        AT_DISPATCH_FLOATING_TYPES(f.scalar_type(), "lpips", [&] {
            value = layerDistance(f.const_data_ptr<scalar_t>(), g.const_data_ptr<scalar_t>(),
                                  weights.const_data_ptr<scalar_t>(), pixels, channels,
                                  gradient.defined() ? gradient.data_ptr<scalar_t>() : nullptr);
        });
        return detail::lossOf(value, 1.0 / static_cast<double>(pixels), {ours, gradient});
    }

    std::string name_;
    std::vector<Convolution> convolutions_;
    std::vector<at::Tensor> heads_;
    at::Tensor scale_, shift_;
};

using Tensors = std::map<std::string, Array>;

/// A tensor of the exact shape, as float.
Result<at::Tensor> namedTensor(const Tensors& tensors, const std::string& name, const std::vector<std::size_t>& shape) {
    const auto found = tensors.find(name);
    if (found == tensors.end()) {
        return makeError(
            ErrorCode::BadFile, fmt::format("tensor \"{}\"", name),
            fmt::format("expected {}, found none among the file's {} tensors", formatShape(shape), tensors.size()));
    }
    if (found->second.shape != shape) {
        return makeError(ErrorCode::BadFile, fmt::format("tensor \"{}\"", name),
                         fmt::format("expected {}, found {}", formatShape(shape), formatShape(found->second.shape)));
    }
    const Array& array = found->second;
    std::vector<std::int64_t> sizes(shape.begin(), shape.end());
    const auto type = array.dtype == DType::F16    ? at::kHalf
                      : array.dtype == DType::BF16 ? at::kBFloat16
                      : array.dtype == DType::F64  ? at::kDouble
                                                   : at::kFloat;
    if (type == at::kFloat && array.dtype != DType::F32) {
        return makeError(ErrorCode::BadFile, fmt::format("tensor \"{}\"", name),
                         fmt::format("expected floating-point numbers, found {}", array.describe()));
    }
    at::Tensor tensor = at::from_blob(const_cast<std::byte*>(array.bytes.data()), sizes, type).to(at::kFloat).clone();
    if (!at::isfinite(tensor).all().item<bool>()) {
        return makeError(ErrorCode::BadFile, fmt::format("tensor \"{}\"", name),
                         "expected finite numbers, found NaN or infinity");
    }
    return tensor;
}

/// VGG16 and AlexNet differ in their first tensor already.
Result<Backbone> backboneOf(const Tensors& tensors) {
    const auto first = tensors.find("features.0.weight");
    if (first != tensors.end() && first->second.shape == std::vector<std::size_t>{64, 3, 3, 3})
        return Backbone{"lpips_vgg", kVgg16};
    if (first != tensors.end() && first->second.shape == std::vector<std::size_t>{64, 3, 11, 11})
        return Backbone{"lpips_alex", kAlexNet};
    return makeError(ErrorCode::BadFile, "tensor \"features.0.weight\"",
                     fmt::format("expected (64, 3, 3, 3) of torchvision's vgg16 or (64, 3, 11, 11) of its alexnet, "
                                 "found {}",
                                 first == tensors.end() ? "none" : formatShape(first->second.shape)));
}

Result<std::vector<Lpips::Convolution>> convolutionsOf(const Tensors& tensors, const Backbone& backbone) {
    std::vector<Lpips::Convolution> result;
    for (const Layer& layer : backbone.layers) {
        const auto inputs = static_cast<std::size_t>(layer.inputs), outputs = static_cast<std::size_t>(layer.outputs),
                   side = static_cast<std::size_t>(layer.kernel);
        ARS_TRY(const at::Tensor weight,
                namedTensor(tensors, std::string(layer.name) + ".weight", {outputs, inputs, side, side}));
        ARS_TRY(const at::Tensor bias, namedTensor(tensors, std::string(layer.name) + ".bias", {outputs}));
        result.push_back({layer, weight.contiguous(at::MemoryFormat::ChannelsLast), bias});
    }
    return result;
}

Result<std::vector<at::Tensor>> headsOf(const Tensors& tensors, const Backbone& backbone) {
    std::vector<at::Tensor> result;
    for (const Layer& layer : backbone.layers) {
        if (!layer.tap) continue;
        ARS_TRY(const at::Tensor weight, namedTensor(tensors, fmt::format("lin{}.model.1.weight", result.size()),
                                                     {1, static_cast<std::size_t>(layer.outputs), 1, 1}));
        result.push_back(weight.flatten());
    }
    return result;
}

} // namespace

Result<std::unique_ptr<PerceptualLoss>> readLpips(const std::filesystem::path& backboneFile,
                                                  const std::filesystem::path& headsFile) {
    ARS_TRY(const Tensors backboneTensors, readTensorFile(backboneFile));
    ARS_TRY(const Tensors headTensors, readTensorFile(headsFile));
    const auto backbone = backboneOf(backboneTensors);
    if (!backbone) return atPlace(backbone.error(), backboneFile.string());
    auto convolutions = convolutionsOf(backboneTensors, *backbone);
    if (!convolutions) return atPlace(std::move(convolutions).error(), backboneFile.string());
    auto heads = headsOf(headTensors, *backbone);
    if (!heads) return atPlace(std::move(heads).error(), headsFile.string());
    return std::unique_ptr<PerceptualLoss>(
        std::make_unique<Lpips>(backbone->name, std::move(*convolutions), std::move(*heads)));
}

} // namespace ars
