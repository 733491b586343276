#include "model/network/filters.h"

#include "model/network/filter_chains.h"
#include "model/network/filter_kernels.h"

#include <ATen/ATen.h>
#include <ATen/Dispatch.h>
#include <ATen/OpMathType.h>
#include <ATen/Parallel.h>
#include <torch/csrc/autograd/custom_function.h>

#include <optional>
#include <vector>

namespace ars {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::Function;
using torch::autograd::tensor_list;

/// Autograd takes an argument that may be missing in this form only.
using MaybeTensor = std::optional<at::Tensor>;
MaybeTensor maybe(const at::Tensor& tensor) { return tensor.defined() ? MaybeTensor(tensor) : std::nullopt; }

constexpr auto kLast = at::MemoryFormat::ChannelsLast;

at::Tensor lastFormat(const at::Tensor& x) { return x.contiguous(kLast); }

at::Tensor emptyLast(std::int64_t channels, std::int64_t height, std::int64_t width, const at::Tensor& like) {
    return at::empty({1, channels, height, width}, like.options().memory_format(kLast));
}

/// Rows that one task takes: about 16 k numbers, enough to hide what starting it costs.
std::int64_t rowGrain(std::int64_t rowNumbers) {
    return std::max<std::int64_t>(1, 16384 / std::max<std::int64_t>(1, rowNumbers));
}

/// Runs a body that was inlined here, compiled for wider vectors than the program's own. Without contraction of
/// products and sums the numbers are the same on each.
template <typename Body>
__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl"))) void run512(const Body& body, std::int64_t b,
                                                                          std::int64_t e) {
    body(b, e);
}
template <typename Body>
__attribute__((target("avx2"))) void run256(const Body& body, std::int64_t b, std::int64_t e) {
    body(b, e);
}

/// body(begin, end) over pieces of [0, count) on all threads; the body must be always_inline (ARS_ROWS).
template <typename Body>
void forRows(std::int64_t count, std::int64_t grain, const Body& body) {
    static const bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                             __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
    static const bool middle = __builtin_cpu_supports("avx2");
    at::parallel_for(0, count, grain, [&](std::int64_t begin, std::int64_t end) {
        if (wide) {
            run512(body, begin, end);
        } else if (middle) {
            run256(body, begin, end);
        } else {
            body(begin, end);
        }
    });
}
#define ARS_ROWS [&](std::int64_t begin, std::int64_t end) __attribute__((always_inline))

template <typename S>
void blurInto(const at::Tensor& x, int before, at::Tensor& y, double gain) {
    using T = at::opmath_type<S>;
    const kernels::BlurShape shape{x.size(2), x.size(3), x.size(1), y.size(2), y.size(3), before};
    const S* source = x.const_data_ptr<S>();
    S* target = y.mutable_data_ptr<S>();
    forRows(
        shape.outHeight, rowGrain(shape.outWidth * shape.channels), ARS_ROWS {
            std::vector<T> scratch(kernels::blurScratch(shape));
            for (auto row = begin; row < end; ++row) {
                kernels::blurRow(shape, source, row, static_cast<T>(gain), scratch.data(),
                                 target + row * shape.outWidth * shape.channels);
            }
        });
}

at::Tensor blurTensor(const at::Tensor& input, int before, int after, double gain) {
    const at::Tensor x = lastFormat(input);
    TORCH_CHECK(x.dim() == 4 && x.size(0) == 1, "blur: expected (1, C, H, W), found ", x.sizes());
    at::Tensor y = emptyLast(x.size(1), x.size(2) + before + after - 3, x.size(3) + before + after - 3, x);
    AT_DISPATCH_FLOATING_TYPES_AND(at::kBFloat16, x.scalar_type(), "blur",
                                   [&] { blurInto<scalar_t>(x, before, y, gain); });
    return y;
}

struct BlurFunction : Function<BlurFunction> {
    static at::Tensor forward(AutogradContext* context, const at::Tensor& x, std::int64_t before, std::int64_t after) {
        context->saved_data["before"] = before;
        context->saved_data["after"] = after;
        return blurTensor(x, static_cast<int>(before), static_cast<int>(after), 1);
    }
    static tensor_list backward(AutogradContext* context, tensor_list gradients) {
        // The kernel is symmetric: its adjoint is itself, with what it had cut off put back around.
        const int before = 3 - static_cast<int>(context->saved_data["before"].toInt());
        const int after = 3 - static_cast<int>(context->saved_data["after"].toInt());
        return {blurTensor(gradients[0], before, after, 1), {}, {}};
    }
};

/// Sums of the gradient before the activation, from one row of partial sums for each picture row.
struct ActivationGradient {
    at::Tensor input, bias, strength;
};

template <typename S>
void activationForward(const at::Tensor& x, const ActivationTerms& terms, bool blurred, bool withGain, at::Tensor& y) {
    using T = at::opmath_type<S>;
    const kernels::BlurShape shape{x.size(2), x.size(3), x.size(1), y.size(2), y.size(3), 1};
    const kernels::Slopes<T> slopes{T(withGain ? kernels::kGain : 1),
                                    T(withGain ? kernels::kSlope * kernels::kGain : kernels::kSlope)};
    const std::int64_t rowNumbers = shape.outWidth * shape.channels;
    const S* source = x.const_data_ptr<S>();
    const S* other = terms.other.defined() ? terms.other.const_data_ptr<S>() : nullptr;
    const T* noise = terms.noise.defined() ? terms.noise.const_data_ptr<T>() : nullptr;
    const T* bias = terms.bias.const_data_ptr<T>();
    const T strength = terms.strength.defined() ? *terms.strength.const_data_ptr<T>() : T(1);
    S* target = y.mutable_data_ptr<S>();
    forRows(
        shape.outHeight, rowGrain(rowNumbers), ARS_ROWS {
            std::vector<T> scratch(blurred ? kernels::blurScratch(shape) + static_cast<std::size_t>(rowNumbers) : 0);
            T* line = scratch.data() + (blurred ? kernels::blurScratch(shape) : 0);
            for (auto row = begin; row < end; ++row) {
                const S* otherRow = other ? other + row * rowNumbers : nullptr;
                const T* noiseRow = noise ? noise + row * shape.outWidth : nullptr;
                S* out = target + row * rowNumbers;
                if (blurred) {
                    kernels::blurRow(shape, source, row, T(4), scratch.data(), line);
                    kernels::activateRow(line, otherRow, noiseRow, strength, bias, shape.outWidth, shape.channels,
                                         slopes, out);
                } else {
                    kernels::activateRow(source + row * rowNumbers, otherRow, noiseRow, strength, bias, shape.outWidth,
                                         shape.channels, slopes, out);
                }
            }
        });
}

void checkTerms(const at::Tensor& y, const ActivationTerms& terms) {
    TORCH_CHECK(terms.bias.numel() == y.size(1), "activate: ", y.size(1), " channels, ", terms.bias.numel(), " biases");
    TORCH_CHECK(!terms.noise.defined() || terms.noise.numel() == y.size(2) * y.size(3),
                "activate: noise of another size");
    TORCH_CHECK(!terms.other.defined() || terms.other.sizes() == y.sizes(), "activate: halves of different sizes");
}

template <typename T>
ActivationGradient activationBackward(const at::Tensor& y, const at::Tensor& gradient, const at::Tensor& noise) {
    const std::int64_t channels = y.size(1), height = y.size(2), width = y.size(3);
    ActivationGradient result;
    result.input = at::empty_like(y);
    at::Tensor biasRows = at::zeros({height, channels}, y.options().memory_format(at::MemoryFormat::Contiguous));
    at::Tensor noiseRows = at::zeros({height, channels}, y.options().memory_format(at::MemoryFormat::Contiguous));
    const T* output = y.const_data_ptr<T>();
    const T* upper = gradient.const_data_ptr<T>();
    const T* noisePointer = noise.defined() ? noise.const_data_ptr<T>() : nullptr;
    T* lower = result.input.mutable_data_ptr<T>();
    T* biasSums = biasRows.mutable_data_ptr<T>();
    T* noiseSums = noiseRows.mutable_data_ptr<T>();
    forRows(
        height, rowGrain(width * channels), ARS_ROWS {
            for (auto row = begin; row < end; ++row) {
                const auto at = row * width * channels;
                kernels::activateRowBackward(output + at, upper + at,
                                             noisePointer ? noisePointer + row * width : nullptr, width, channels,
                                             lower + at, biasSums + row * channels, noiseSums + row * channels);
            }
        });
    result.bias = biasRows.sum(0);
    if (noise.defined()) result.strength = noiseRows.sum().reshape({1});
    return result;
}

struct ActivationFunction : Function<ActivationFunction> {
    static at::Tensor forward(AutogradContext* context, const at::Tensor& input, const at::Tensor& bias,
                              const MaybeTensor& maybeNoise, const MaybeTensor& maybeStrength,
                              const MaybeTensor& maybeOther, bool blurred) {
        const at::Tensor noise = maybeNoise.value_or(at::Tensor()), other = maybeOther.value_or(at::Tensor());
        const at::Tensor strength = maybeStrength.value_or(at::Tensor());
        const at::Tensor x = lastFormat(input);
        const std::int64_t shrink = blurred ? 1 : 0;
        at::Tensor y = emptyLast(x.size(1), x.size(2) - shrink, x.size(3) - shrink, x);
        const at::Tensor noisePlain = noise.defined() ? noise.contiguous() : noise;
        const ActivationTerms terms{bias.contiguous(), noisePlain, strength,
                                    other.defined() ? lastFormat(other) : other};
        checkTerms(y, terms);
        AT_DISPATCH_FLOATING_TYPES(x.scalar_type(), "activate",
                                   [&] { activationForward<scalar_t>(x, terms, blurred, true, y); });
        context->save_for_backward({y, noisePlain});
        context->saved_data["blurred"] = blurred;
        context->saved_data["other"] = other.defined();
        return y;
    }
    static tensor_list backward(AutogradContext* context, tensor_list gradients) {
        const auto saved = context->get_saved_variables();
        const at::Tensor gradient = lastFormat(gradients[0]);
        ActivationGradient result;
        AT_DISPATCH_FLOATING_TYPES(gradient.scalar_type(), "activate",
                                   [&] { result = activationBackward<scalar_t>(saved[0], gradient, saved[1]); });
        const at::Tensor other = context->saved_data["other"].toBool() ? result.input : at::Tensor();
        if (context->saved_data["blurred"].toBool()) result.input = blurTensor(result.input, 2, 2, 4);
        return {result.input, result.bias, {}, result.strength, other, {}};
    }
};

template <typename T>
void addSubbandsInto(const at::Tensor& subbands, const at::Tensor& previous, at::Tensor& image) {
    const std::int64_t channels = image.size(1), height = subbands.size(2), width = subbands.size(3);
    const T* bands = subbands.const_data_ptr<T>();
    const T* old = previous.defined() ? previous.const_data_ptr<T>() : nullptr;
    T* out = image.mutable_data_ptr<T>();
    forRows(
        height, rowGrain(width * channels * 4), ARS_ROWS {
            std::vector<T> scratch(static_cast<std::size_t>(2 * (width + 2) * channels));
            for (auto row = begin; row < end; ++row) {
                kernels::subbandRows(bands, old, height, width, channels, row, scratch.data(), out);
            }
        });
}

template <typename T>
void subbandGradients(const at::Tensor& gradient, at::Tensor& bands, at::Tensor& previous) {
    const std::int64_t channels = gradient.size(1), height = bands.size(2), width = bands.size(3);
    const T* upper = gradient.const_data_ptr<T>();
    T* bandGradient = bands.mutable_data_ptr<T>();
    T* oldGradient = previous.defined() ? previous.mutable_data_ptr<T>() : nullptr;
    forRows(
        height, rowGrain(width * channels * 4), ARS_ROWS {
            std::vector<T> scratch(static_cast<std::size_t>((2 * width + 2) * channels));
            for (auto row = begin; row < end; ++row) {
                kernels::subbandRowsBackward(upper, height, width, channels, row, bandGradient);
                if (oldGradient)
                    kernels::upsampleRowBackward(upper, height, width, channels, row, scratch.data(), oldGradient);
            }
        });
}

struct SubbandFunction : Function<SubbandFunction> {
    static at::Tensor forward(AutogradContext* context, const at::Tensor& subbands, const MaybeTensor& maybePrevious) {
        const at::Tensor previous = maybePrevious.value_or(at::Tensor());
        const at::Tensor bands = lastFormat(subbands);
        const at::Tensor old = previous.defined() ? lastFormat(previous) : previous;
        TORCH_CHECK(bands.dim() == 4 && bands.size(0) == 1 && bands.size(1) % 4 == 0,
                    "subbands: expected (1, 4 C, H, W), found ", bands.sizes());
        const std::int64_t channels = bands.size(1) / 4;
        TORCH_CHECK(!old.defined() ||
                        (old.size(1) == channels && old.size(2) == bands.size(2) && old.size(3) == bands.size(3)),
                    "subbands: the image before is of another size");
        at::Tensor image = emptyLast(channels, 2 * bands.size(2), 2 * bands.size(3), bands);
        AT_DISPATCH_FLOATING_TYPES(bands.scalar_type(), "subbands",
                                   [&] { addSubbandsInto<scalar_t>(bands, old, image); });
        context->saved_data["previous"] = old.defined();
        return image;
    }
    static tensor_list backward(AutogradContext* context, tensor_list gradients) {
        const at::Tensor gradient = lastFormat(gradients[0]);
        const std::int64_t channels = gradient.size(1), height = gradient.size(2) / 2, width = gradient.size(3) / 2;
        at::Tensor bands = emptyLast(4 * channels, height, width, gradient);
        at::Tensor previous;
        if (context->saved_data["previous"].toBool()) previous = emptyLast(channels, height, width, gradient);
        AT_DISPATCH_FLOATING_TYPES(gradient.scalar_type(), "subbands",
                                   [&] { subbandGradients<scalar_t>(gradient, bands, previous); });
        return {bands, previous};
    }
};

template <typename T>
void modulateInto(const at::Tensor& weight, const at::Tensor& style, bool demodulate, at::Tensor& result,
                  at::Tensor& norms) {
    const std::int64_t outputs = weight.size(1), inputs = weight.size(2), taps = weight.size(3) * weight.size(4);
    const T* w = weight.const_data_ptr<T>();
    const T* s = style.const_data_ptr<T>();
    T* to = result.mutable_data_ptr<T>();
    T* norm = norms.mutable_data_ptr<T>();
    forRows(
        outputs, rowGrain(inputs * taps), ARS_ROWS {
            for (auto o = begin; o < end; ++o) {
                norm[o] =
                    kernels::modulateFilter(w + o * inputs * taps, s, inputs, taps, demodulate, to + o * inputs * taps);
            }
        });
}

template <typename T>
void modulateBackwardInto(const at::Tensor& modulated, const at::Tensor& style, const at::Tensor& norms,
                          bool demodulate, const at::Tensor& weight, const at::Tensor& gradient,
                          at::Tensor& weightGradient, at::Tensor& styleRows) {
    const std::int64_t outputs = weight.size(1), inputs = weight.size(2), taps = weight.size(3) * weight.size(4);
    const T* w = weight.const_data_ptr<T>();
    const T* m = modulated.const_data_ptr<T>();
    const T* g = gradient.const_data_ptr<T>();
    const T* s = style.const_data_ptr<T>();
    const T* norm = norms.const_data_ptr<T>();
    T* gw = weightGradient.mutable_data_ptr<T>();
    T* gs = styleRows.mutable_data_ptr<T>();
    forRows(
        outputs, rowGrain(inputs * taps), ARS_ROWS {
            for (auto o = begin; o < end; ++o) {
                const auto at = o * inputs * taps;
                kernels::modulateFilterBackward(w + at, m + at, g + at, s, norm[o], inputs, taps, demodulate, gw + at,
                                                gs + o * inputs);
            }
        });
}

struct ModulationFunction : Function<ModulationFunction> {
    static at::Tensor forward(AutogradContext* context, const at::Tensor& weight, const at::Tensor& style,
                              bool demodulate, bool transposed) {
        const at::Tensor w = weight.contiguous();
        const at::Tensor s = style.contiguous();
        TORCH_CHECK(w.dim() == 5 && w.size(0) == 1 && s.numel() == w.size(2), "modulation: ", w.sizes(), " with ",
                    s.numel(), " styles");
        at::Tensor result = at::empty({w.size(1), w.size(2), w.size(3), w.size(4)}, w.options());
        at::Tensor norms = at::empty({w.size(1)}, w.options());
        AT_DISPATCH_FLOATING_TYPES(w.scalar_type(), "modulation",
                                   [&] { modulateInto<scalar_t>(w, s, demodulate, result, norms); });
        context->save_for_backward({w, s, result, norms});
        context->saved_data["demodulate"] = demodulate;
        context->saved_data["transposed"] = transposed;
        return transposed ? result.transpose(0, 1).contiguous() : result.contiguous(kLast);
    }
    static tensor_list backward(AutogradContext* context, tensor_list gradients) {
        const auto saved = context->get_saved_variables();
        const at::Tensor& w = saved[0];
        const bool transposed = context->saved_data["transposed"].toBool();
        const at::Tensor gradient = (transposed ? gradients[0].transpose(0, 1) : gradients[0]).contiguous();
        at::Tensor weightGradient = at::empty_like(w);
        at::Tensor styleRows = at::empty({w.size(1), w.size(2)}, w.options());
        AT_DISPATCH_FLOATING_TYPES(w.scalar_type(), "modulation", [&] {
            modulateBackwardInto<scalar_t>(saved[2], saved[1], saved[3], context->saved_data["demodulate"].toBool(), w,
                                           gradient, weightGradient, styleRows);
        });
        return {weightGradient, styleRows.sum(0), {}, {}};
    }
};

template <typename T>
void gatherInto(const at::Tensor& front, const at::Tensor& back, const at::Tensor& pixels, at::Tensor& rows) {
    const std::int64_t channels = front.size(1), width = front.size(3);
    const T* sides[] = {front.const_data_ptr<T>(), back.const_data_ptr<T>()};
    const std::int64_t* pixel = pixels.const_data_ptr<std::int64_t>();
    T* out = rows.mutable_data_ptr<T>();
    for (std::int64_t p = 0; p < pixels.numel(); ++p) {
        const std::int64_t column = pixel[p] % (2 * width), row = pixel[p] / (2 * width);
        const T* from = sides[column >= width] + (row * width + column % width) * channels;
        std::copy(from, from + channels, out + p * channels);
    }
}

template <typename T>
void scatterInto(const at::Tensor& rows, const at::Tensor& pixels, at::Tensor& front, at::Tensor& back) {
    const std::int64_t channels = front.size(1), width = front.size(3);
    T* sides[] = {front.mutable_data_ptr<T>(), back.mutable_data_ptr<T>()};
    const std::int64_t* pixel = pixels.const_data_ptr<std::int64_t>();
    const T* in = rows.const_data_ptr<T>();
    for (std::int64_t p = 0; p < pixels.numel(); ++p) {
        const std::int64_t column = pixel[p] % (2 * width), row = pixel[p] / (2 * width);
        T* to = sides[column >= width] + (row * width + column % width) * channels;
        for (std::int64_t c = 0; c < channels; ++c) to[c] += in[p * channels + c];
    }
}

struct GatherFunction : Function<GatherFunction> {
    static at::Tensor forward(AutogradContext* context, const at::Tensor& front, const at::Tensor& back,
                              const at::Tensor& pixels) {
        const at::Tensor a = lastFormat(front), b = lastFormat(back), places = pixels.contiguous();
        TORCH_CHECK(a.sizes() == b.sizes() && a.size(0) == 1, "gather: sides of different sizes");
        if (places.numel() > 0) {
            TORCH_CHECK(places.min().item<std::int64_t>() >= 0 &&
                            places.max().item<std::int64_t>() < 2 * a.size(2) * a.size(3),
                        "gather: a pixel outside the maps");
        }
        at::Tensor rows =
            at::empty({places.numel(), a.size(1)}, a.options().memory_format(at::MemoryFormat::Contiguous));
        AT_DISPATCH_FLOATING_TYPES(a.scalar_type(), "gather", [&] { gatherInto<scalar_t>(a, b, places, rows); });
        context->save_for_backward({places});
        context->saved_data["height"] = a.size(2);
        context->saved_data["width"] = a.size(3);
        return rows;
    }
    static tensor_list backward(AutogradContext* context, tensor_list gradients) {
        const at::Tensor rows = gradients[0].contiguous();
        const std::int64_t height = context->saved_data["height"].toInt(), width = context->saved_data["width"].toInt();
        at::Tensor front = emptyLast(rows.size(1), height, width, rows).zero_();
        at::Tensor back = emptyLast(rows.size(1), height, width, rows).zero_();
        const auto saved = context->get_saved_variables();
        AT_DISPATCH_FLOATING_TYPES(rows.scalar_type(), "gather",
                                   [&] { scatterInto<scalar_t>(rows, saved[0], front, back); });
        return {front, back, {}};
    }
};

} // namespace

at::Tensor blur(const at::Tensor& x, int before, int after) {
    if (!x.is_cpu()) return chains::blur(x, before, after, 1);
    return BlurFunction::apply(x, static_cast<std::int64_t>(before), static_cast<std::int64_t>(after));
}

at::Tensor blurDownsample(const at::Tensor& x) {
    return blur(x, 1, 1).slice(2, 0, c10::nullopt, 2).slice(3, 0, c10::nullopt, 2).contiguous(kLast);
}

at::Tensor activate(const at::Tensor& x, const ActivationTerms& terms) {
    if (!x.is_cpu()) return chains::activate(x, terms);
    return ActivationFunction::apply(x, terms.bias, maybe(terms.noise), maybe(terms.strength), maybe(terms.other),
                                     false);
}

at::Tensor blurActivate(const at::Tensor& x, const ActivationTerms& terms) {
    if (!x.is_cpu()) return chains::blurActivate(x, terms);
    return ActivationFunction::apply(x, terms.bias, maybe(terms.noise), maybe(terms.strength), maybe(terms.other),
                                     true);
}

at::Tensor activateFolded(const at::Tensor& x, const ActivationTerms& terms, bool blurred) {
    TORCH_CHECK(x.is_cpu() && x.is_contiguous(kLast), "activate: expected channels last in host memory");
    at::Tensor y = blurred ? emptyLast(x.size(1), x.size(2) - 1, x.size(3) - 1, x) : x;
    checkTerms(y, terms);
    AT_DISPATCH_FLOATING_TYPES_AND(at::kBFloat16, x.scalar_type(), "activate",
                                   [&] { activationForward<scalar_t>(x, terms, blurred, false, y); });
    return y;
}

at::Tensor addSubbands(const at::Tensor& subbands, const at::Tensor& previous) {
    if (!subbands.is_cpu()) return chains::addSubbands(subbands, previous);
    return SubbandFunction::apply(subbands, maybe(previous));
}

at::Tensor modulatedWeight(const at::Tensor& weight, const at::Tensor& style, bool demodulate, bool transposed) {
    if (!weight.is_cpu()) return chains::modulatedWeight(weight, style, demodulate, transposed);
    return ModulationFunction::apply(weight, style, demodulate, transposed);
}

at::Tensor gatherSides(const at::Tensor& front, const at::Tensor& back, const at::Tensor& pixels) {
    if (!front.is_cpu()) return chains::gatherSides(front, back, pixels);
    return GatherFunction::apply(front, back, pixels);
}

} // namespace ars
