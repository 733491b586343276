#include "model/loss/losses.h"

#include "model/loss/known_gradient.h"

#include <ATen/Dispatch.h>

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

using detail::signOf;

void checkPicture(const char* what, const at::Tensor& picture, std::int64_t channels = -1) {
    TORCH_CHECK(picture.defined() && picture.dim() == 3 && (channels < 0 || picture.size(2) == channels), what,
                ": expected (height, width, ", channels < 0 ? std::string("channels") : std::to_string(channels), ")");
}

/// What of the pairs in one picture: sum of |differences| and how many there are; adds signs to `gradient` where given.
template <typename T>
struct VariationRow {
    const T* values;
    const T* opacity; ///< null: everything counts
    T* gradient;
    std::int64_t width, channels;

    bool inside(std::int64_t pixel) const {
        return !opacity || opacity[pixel] > static_cast<T>(detail::kForegroundOpacity);
    }
    double pair(std::int64_t a, std::int64_t b) const {
        T sum = 0;
        for (std::int64_t c = 0; c < channels; ++c) {
            const T difference = values[b * channels + c] - values[a * channels + c];
            sum += std::abs(difference);
            if (!gradient) continue;
            gradient[b * channels + c] += signOf(difference);
            gradient[a * channels + c] -= signOf(difference);
        }
        return sum;
    }
    /// Pairs of a row among themselves and with the row below.
    double row(std::int64_t row, bool last, std::int64_t& pairs) const {
        double sum = 0;
        for (std::int64_t x = 0; x < width; ++x) {
            const std::int64_t p = row * width + x;
            if (!inside(p)) continue;
            if (x + 1 < width && inside(p + 1)) {
                sum += pair(p, p + 1);
                ++pairs;
            }
            if (!last && inside(p + width)) {
                sum += pair(p, p + width);
                ++pairs;
            }
        }
        return sum;
    }
};

/// Mean |difference| of neighbours in pictures (faces, height, width, channels) that lie one after another.
at::Tensor meanVariation(const at::Tensor& input, std::int64_t faces, std::int64_t height, std::int64_t width,
                         std::int64_t channels, const at::Tensor& opacity) {
    const at::Tensor values = detail::onHost(input);
    at::Tensor gradient;
    if (detail::wantsGradient(input)) gradient = at::zeros_like(values);
    const auto rows = static_cast<std::size_t>(faces * height);
    std::vector<double> sums(rows);
    std::vector<std::int64_t> pairs(rows, 0);
    AT_DISPATCH_FLOATING_TYPES(values.scalar_type(), "totalVariation", [&] {
        const at::Tensor mask = opacity.defined() ? detail::onHost(opacity).to(values.scalar_type()) : opacity;
        const VariationRow<scalar_t> variation{
            values.const_data_ptr<scalar_t>(), mask.defined() ? mask.const_data_ptr<scalar_t>() : nullptr,
            gradient.defined() ? gradient.data_ptr<scalar_t>() : nullptr, width, channels};
        detail::scatterOverRows(rows, [&](std::size_t row) {
            const bool last = static_cast<std::int64_t>(row) % height == height - 1;
            sums[row] = variation.row(static_cast<std::int64_t>(row), last, pairs[row]);
        });
    });
    double sum = 0;
    std::int64_t count = 0;
    for (std::size_t row = 0; row < rows; ++row) {
        sum += sums[row];
        count += pairs[row];
    }
    const double scale = count > 0 ? 1.0 / static_cast<double>(count * channels) : 0.0;
    return detail::lossOf(sum * scale, scale, {input, gradient});
}

} // namespace

at::Tensor l1Loss(const at::Tensor& picture, const at::Tensor& target, const at::Tensor& mask) {
    TORCH_CHECK(picture.sizes() == target.sizes(), "l1Loss: expected a target of size ", picture.sizes(), ", found ",
                target.sizes());
    const at::Tensor a = detail::onHost(picture);
    const at::Tensor b = detail::onHost(target).to(a.scalar_type());
    const std::int64_t channels = a.dim() > 0 ? a.size(-1) : 1;
    const std::int64_t width = a.dim() > 1 ? a.size(-2) : 1;
    const std::int64_t rowValues = width * channels;
    const auto rows = static_cast<std::size_t>(rowValues > 0 ? a.numel() / rowValues : 0);
    TORCH_CHECK(!mask.defined() || mask.numel() * channels == a.numel(),
                "l1Loss: expected a mask with one value for each pixel, found ", mask.sizes());
    at::Tensor gradient;
    if (detail::wantsGradient(picture) || detail::wantsGradient(target)) gradient = at::empty_like(a);
    std::vector<std::int64_t> counted(rows, 0);
    double sum = 0;
    AT_DISPATCH_FLOATING_TYPES(a.scalar_type(), "l1Loss", [&] {
        const at::Tensor weights = mask.defined() ? detail::onHost(mask).to(a.scalar_type()) : mask;
        const auto* pa = a.const_data_ptr<scalar_t>();
        const auto* pb = b.const_data_ptr<scalar_t>();
        const auto* pm = weights.defined() ? weights.const_data_ptr<scalar_t>() : nullptr;
        auto* pg = gradient.defined() ? gradient.data_ptr<scalar_t>() : nullptr;
        sum = detail::sumOverRows(rows, detail::kRowGrain, [&](std::size_t row) {
            double rowSum = 0;
            for (std::int64_t x = 0; x < width; ++x) {
                const std::int64_t pixel = static_cast<std::int64_t>(row) * width + x;
                const bool counts = !pm || pm[pixel] > scalar_t(0.5);
                counted[row] += counts;
                for (std::int64_t i = pixel * channels; i < (pixel + 1) * channels; ++i) {
                    const scalar_t difference = counts ? pa[i] - pb[i] : scalar_t(0);
                    rowSum += std::abs(difference);
                    if (pg) pg[i] = signOf(difference);
                }
            }
            return rowSum;
        });
    });
    std::int64_t pixels = 0;
    for (const std::int64_t n : counted) pixels += n;
    const double scale = pixels > 0 ? 1.0 / static_cast<double>(pixels * channels) : 0.0;
    return detail::lossOf(sum * scale, scale, {picture, detail::wantsGradient(picture) ? gradient : at::Tensor()},
                          {target, detail::wantsGradient(target) ? -gradient : at::Tensor()});
}

at::Tensor offsetLoss(const at::Tensor& offsets, bool squared) {
    TORCH_CHECK(offsets.dim() == 2 && offsets.size(1) == 3, "offsetLoss: expected (surfels, 3), found ",
                offsets.sizes());
    const at::Tensor values = detail::onHost(offsets);
    at::Tensor gradient;
    if (detail::wantsGradient(offsets)) gradient = at::empty_like(values);
    constexpr std::size_t kBlock = 256;
    const auto count = static_cast<std::size_t>(values.size(0));
    double sum = 0;
    AT_DISPATCH_FLOATING_TYPES(values.scalar_type(), "offsetLoss", [&] {
        const auto* v = values.const_data_ptr<scalar_t>();
        auto* g = gradient.defined() ? gradient.data_ptr<scalar_t>() : nullptr;
        sum = detail::sumOverRows((count + kBlock - 1) / kBlock, 8, [&](std::size_t block) {
            double blockSum = 0;
            for (std::size_t i = block * kBlock; i < std::min(count, (block + 1) * kBlock); ++i) {
                const scalar_t* o = v + 3 * i;
                const scalar_t square = o[0] * o[0] + o[1] * o[1] + o[2] * o[2];
                const scalar_t length = std::sqrt(square);
                blockSum += squared ? square : length;
                if (!g) continue;
                const scalar_t slope = squared                ? scalar_t(2)
                                       : length > scalar_t(0) ? scalar_t(1) / length
                                                              : scalar_t(0);
                for (int c = 0; c < 3; ++c) g[3 * i + static_cast<std::size_t>(c)] = slope * o[c];
            }
            return blockSum;
        });
    });
    const double scale = count > 0 ? 1.0 / static_cast<double>(count) : 0.0;
    return detail::lossOf(sum * scale, scale, {offsets, gradient});
}

at::Tensor totalVariation(const at::Tensor& picture, const at::Tensor& opacity) {
    checkPicture("totalVariation", picture);
    TORCH_CHECK(!opacity.defined() || opacity.numel() == picture.size(0) * picture.size(1),
                "totalVariation: expected an opacity of the picture's size, found ", opacity.sizes());
    return meanVariation(picture, 1, picture.size(0), picture.size(1), picture.size(2), opacity);
}

at::Tensor lightTotalVariation(const at::Tensor& texels) {
    TORCH_CHECK(texels.dim() == 4 && texels.size(3) == 3, "lightTotalVariation: expected (6, side, side, 3), found ",
                texels.sizes());
    return meanVariation(texels, texels.size(0), texels.size(1), texels.size(2), 3, {});
}

at::Tensor whiteLightLoss(const at::Tensor& texels) {
    TORCH_CHECK(texels.dim() >= 1 && texels.size(-1) == 3, "whiteLightLoss: expected three channels, found ",
                texels.sizes());
    const at::Tensor values = detail::onHost(texels);
    at::Tensor gradient;
    if (detail::wantsGradient(texels)) gradient = at::empty_like(values);
    const auto count = static_cast<std::size_t>(values.numel() / 3);
    constexpr std::size_t kBlock = 1024;
    double sum = 0;
    AT_DISPATCH_FLOATING_TYPES(values.scalar_type(), "whiteLightLoss", [&] {
        const auto* v = values.const_data_ptr<scalar_t>();
        auto* g = gradient.defined() ? gradient.data_ptr<scalar_t>() : nullptr;
        sum = detail::sumOverRows((count + kBlock - 1) / kBlock, 4, [&](std::size_t block) {
            double blockSum = 0;
            for (std::size_t i = block * kBlock; i < std::min(count, (block + 1) * kBlock); ++i) {
                const scalar_t* l = v + 3 * i;
                const scalar_t mean = (l[0] + l[1] + l[2]) / scalar_t(3);
                scalar_t signs[3];
                for (int c = 0; c < 3; ++c) {
                    blockSum += std::abs(l[c] - mean);
                    signs[c] = signOf(l[c] - mean);
                }
                if (!g) continue;
                const scalar_t signMean = (signs[0] + signs[1] + signs[2]) / scalar_t(3);
                for (int c = 0; c < 3; ++c) g[3 * i + static_cast<std::size_t>(c)] = signs[c] - signMean;
            }
            return blockSum;
        });
    });
    const double scale = count > 0 ? 1.0 / static_cast<double>(3 * count) : 0.0;
    return detail::lossOf(sum * scale, scale, {texels, gradient});
}

double consistencyWeight(double start, double end, double progress) {
    return start + (end - start) * std::clamp(2.0 * progress, 0.0, 1.0);
}

} // namespace ars
