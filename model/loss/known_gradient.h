#pragma once

#include "engine/core/parallel.h"

#include <ATen/ATen.h>
#include <torch/csrc/autograd/custom_function.h>

#include <cstddef>
#include <vector>

/// What the losses share: a loss is one number, so its gradient is found in the same pass as its value and kept until
/// backward multiplies it by what comes from above. Both are found in host memory, whatever device the inputs lie on:
/// pictures of one step are brought there, gradients back.
namespace ars::detail {

/// An input of a loss with dL/d input up to the common factor; undefined: it receives none.
struct KnownGradient {
    at::Tensor input;
    at::Tensor gradient;
};

/// What backward multiplies: kept apart from the inputs, which autograd wants defined.
struct KnownGradientPair {
    at::Tensor first, second;
    double scale = 1;
};

class KnownGradientFunction : public torch::autograd::Function<KnownGradientFunction> {
public:
    static at::Tensor forward(torch::autograd::AutogradContext* context, const at::Tensor& first, const at::Tensor&,
                              const KnownGradientPair& gradients, double value) {
        context->save_for_backward({gradients.first, gradients.second});
        context->saved_data["scale"] = gradients.scale;
        return at::full({}, value, first.options());
    }
    static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                   torch::autograd::variable_list above) {
        torch::autograd::variable_list result(4);
        if (!above[0].defined()) return result;
        const double factor = above[0].item<double>() * context->saved_data["scale"].toDouble();
        const torch::autograd::variable_list saved = context->get_saved_variables();
        for (std::size_t i = 0; i < 2; ++i) {
            if (saved[i].defined()) result[i] = saved[i] * factor;
        }
        return result;
    }
};

/// Whether a gradient is asked for at all: without, none is computed.
inline bool wantsGradient(const at::Tensor& tensor) {
    return at::GradMode::is_enabled() && tensor.defined() && tensor.requires_grad();
}

/// The numbers of a tensor in host memory, contiguous and without history; those there already are not copied.
inline at::Tensor onHost(const at::Tensor& tensor) { return tensor.detach().cpu().contiguous(); }

/// The scalar `value`, on the inputs' device, whose derivatives are scale x gradient.
inline at::Tensor lossOf(double value, double scale, const KnownGradient& first, const KnownGradient& second = {}) {
    const auto beside = [](const KnownGradient& known) {
        return known.gradient.defined() ? known.gradient.to(known.input.device()) : known.gradient;
    };
    return KnownGradientFunction::apply(first.input, second.input.defined() ? second.input : first.input,
                                        KnownGradientPair{beside(first), beside(second), scale}, value);
}

/// Sum over rows of rowSum(row): in double, one row after another, so that threads do not change it.
template <typename RowSum>
double sumOverRows(std::size_t rows, std::size_t grain, RowSum&& rowSum) {
    std::vector<double> sums(rows);
    parallelFor(rows, [&](std::size_t row) { sums[row] = rowSum(row); }, grain);
    double total = 0;
    for (const double sum : sums) total += sum;
    return total;
}

/// scatter(row) for every row, where it writes to its own row and both neighbours: every third row at a time, so that
/// no two threads meet and every sum has one order.
template <typename Scatter>
void scatterOverRows(std::size_t rows, Scatter&& scatter) {
    for (std::size_t phase = 0; phase < 3; ++phase) {
        const std::size_t count = rows > phase ? (rows - phase + 2) / 3 : 0;
        parallelFor(count, [&](std::size_t i) { scatter(3 * i + phase); }, 8);
    }
}

/// Rows of a picture that one thread takes at least.
inline constexpr std::size_t kRowGrain = 16;

template <typename T>
T signOf(T value) {
    return static_cast<T>(value > T(0)) - static_cast<T>(value < T(0));
}

/// What losses over the person count as foreground.
inline constexpr double kForegroundOpacity = 0.5;

} // namespace ars::detail
