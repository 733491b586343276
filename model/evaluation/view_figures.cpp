#include "model/evaluation/evaluated_view.h"

#include "engine/capture/view_preparation.h"
#include "engine/io/jpeg.h"
#include "engine/metrics/image_metrics.h"
#include "model/loss/perceptual_patch.h"
#include "model/run/run_failure.h"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include <algorithm>
#include <cmath>

namespace ars::detail {
namespace {

constexpr int kPublishedMargin = 50;         ///< pixels around the mask's box (avatar reference 7)
constexpr std::int64_t kPublishedSide = 512; ///< to which that is resized

ImageView<const float> viewOfImage(const Image& image) {
    return {image.pixels.data(), image.width, image.height, image.channels};
}

/// Where both are: the person of the photograph, and ours at least half opaque.
Image bothOf(const Image& mask, const Image& opacity) {
    Image both = mask;
    for (std::size_t p = 0; p < both.pixels.size(); ++p) {
        if (!(opacity.pixels[p] > 0.5f)) both.pixels[p] = 0.0f;
    }
    return both;
}

bool anyPixel(const Image& mask) {
    return std::any_of(mask.pixels.begin(), mask.pixels.end(), [](float value) { return value > 0.5f; });
}

/// The photograph with everything that is no person white.
Image overWhite(const Photograph& photograph) {
    Image white = photograph.view.color;
    for (std::size_t p = 0; p < photograph.mask.pixels.size(); ++p) {
        if (photograph.mask.pixels[p] > 0.5f) continue;
        std::fill_n(&white.pixels[3 * p], 3, 1.0f);
    }
    return white;
}

/// Through eight bits and JPEG, as the published evaluation reads its pictures.
Result<Image> throughJpeg(const Image& picture) {
    ARS_TRY(const auto bytes, encodeJpeg(picture, 95));
    ARS_TRY(JpegFile file, parseJpeg(bytes));
    return std::move(file.image);
}

/// Same pictures, same numbers: LPIPS of floats, as its authors compute it of pictures in [-1, 1]; `size` > 0: of
/// squares that are resized to it.
Result<double> lpipsOf(const PerceptualLoss& lpips, const Image& picture, const Image& target, std::int64_t size) {
    return withoutExceptions<Result<double>>("LPIPS", [&]() -> Result<double> {
        const at::NoGradGuard off;
        const auto sized = [&](const Image& image) {
            const at::Tensor whole = tensorOf(viewOfImage(image));
            return size == 0 ? whole : perceptualPatch(whole, {0, 0, whole.size(0)}, size, at::ones({3}));
        };
        return lpips.evaluate(sized(picture), sized(target)).item<double>();
    });
}

Status add(Figures& figures, std::string name, const Result<double>& value) {
    if (!value) return atPlace(value.error(), name);
    figures.emplace_back(std::move(name), *value);
    return {};
}

} // namespace

Image publishedCrop(const Image& picture, const Image& mask) {
    PixelBox box = maskBounds(mask, 128);
    const int right = std::min(box.x + box.width + kPublishedMargin, picture.width);
    const int bottom = std::min(box.y + box.height + kPublishedMargin, picture.height);
    box.x = std::max(box.x - kPublishedMargin, 0);
    box.y = std::max(box.y - kPublishedMargin, 0);
    box.width = right - box.x;
    box.height = bottom - box.y;
    const Image part = cropped(picture, box);
    const int side = std::max(part.width, part.height);
    Image square = part;
    square.width = square.height = side;
    square.pixels.assign(static_cast<std::size_t>(side) * static_cast<std::size_t>(side * part.channels), 1.0f);
    const int left = (side - part.width) / 2, top = (side - part.height) / 2;
    for (int row = 0; row < part.height; ++row) {
        for (int column = 0; column < part.width; ++column) {
            for (int c = 0; c < part.channels; ++c) square.at(top + row, left + column, c) = part.at(row, column, c);
        }
    }
    return square;
}

Result<double> uniformSsim(const Image& a, const Image& b) {
    constexpr int kSide = 7;
    constexpr double kC1 = 1e-4, kC2 = 9e-4, kCount = kSide * kSide;
    if (a.width < kSide || a.height < kSide || a.width != b.width || a.height != b.height || a.channels != b.channels)
        return makeError(ErrorCode::InvalidArgument, "", "expected two pictures of one size, at least 7 x 7 pixels");
    // Sums of a, b, a^2, b^2 and a b over columns of seven, kept while the window goes down.
    const std::size_t row = static_cast<std::size_t>(a.width) * static_cast<std::size_t>(a.channels);
    const auto channels = static_cast<std::size_t>(a.channels);
    std::vector<std::array<double, 5>> columns(row);
    double sum = 0;
    for (int y = 0; y + kSide <= a.height; ++y) {
        for (std::size_t i = 0; i < row; ++i) {
            columns[i] = {};
            for (int k = 0; k < kSide; ++k) {
                const std::size_t at = (static_cast<std::size_t>(y + k)) * row + i;
                const double u = a.pixels[at], v = b.pixels[at];
                const std::array<double, 5> terms{u, v, u * u, v * v, u * v};
                for (std::size_t t = 0; t < 5; ++t) columns[i][t] += terms[t];
            }
        }
        for (std::size_t i = 0; i + (kSide - 1) * channels < row; ++i) {
            std::array<double, 5> s{};
            for (std::size_t k = 0; k < kSide; ++k) {
                for (std::size_t t = 0; t < 5; ++t) s[t] += columns[i + k * channels][t];
            }
            const double ma = s[0] / kCount, mb = s[1] / kCount, sample = kCount / (kCount - 1);
            const double va = sample * (s[2] / kCount - ma * ma), vb = sample * (s[3] / kCount - mb * mb);
            const double cov = sample * (s[4] / kCount - ma * mb);
            sum += (2 * ma * mb + kC1) * (2 * cov + kC2) / ((ma * ma + mb * mb + kC1) * (va + vb + kC2));
        }
    }
    return sum / (static_cast<double>(a.height - kSide + 1) * static_cast<double>(row - (kSide - 1) * channels));
}

Status PictureJudge::judge(const std::string& name, const Image& masked, Image white, Figures& figures) const {
    const Image& photo = photograph.view.color;
    const auto mask = viewOfImage(photograph.mask);
    ARS_TRY_STATUS(add(figures, name + "_psnr_mask", peakSignalToNoise(viewOfImage(masked), viewOfImage(photo), mask)));
    ARS_TRY_STATUS(
        add(figures, name + "_ssim_mask", structuralSimilarity(viewOfImage(masked), viewOfImage(photo), mask)));
    const Image target = overWhite(photograph);
    const bool published = protocol != EvaluationProtocol::Masked;
    if (published) {
        ARS_TRY(white, throughJpeg(white));
    }
    ARS_TRY_STATUS(add(figures, name + "_psnr_full", peakSignalToNoise(viewOfImage(white), viewOfImage(target))));
    ARS_TRY_STATUS(
        add(figures, name + "_ssim_full",
            published ? uniformSsim(white, target) : structuralSimilarity(viewOfImage(white), viewOfImage(target))));
    if (!lpips) return {};
    if (!published) return add(figures, name + "_lpips", lpipsOf(*lpips, white, target, 0));
    return add(
        figures, name + "_lpips",
        lpipsOf(*lpips, publishedCrop(white, photograph.mask), publishedCrop(target, photograph.mask), kPublishedSide));
}

Status judgeGeometry(const RenderedView& ours, const TrueBuffers& truth, const Photograph& photograph,
                     Figures& figures) {
    Image both = bothOf(photograph.mask, ours.opacity);
    if (!anyPixel(both)) return {};
    const auto overlap = viewOfImage(both), mask = viewOfImage(photograph.mask);
    if (truth.depth) {
        Image known = both;
        for (std::size_t p = 0; p < known.pixels.size(); ++p) {
            const float depth = truth.depth->pixels[p];
            if (!(depth > 0.0f) || !std::isfinite(depth) || depth > 1e4f) known.pixels[p] = 0.0f;
        }
        if (anyPixel(known)) {
            const auto mean = meanAbsoluteError(viewOfImage(ours.depth), viewOfImage(*truth.depth), viewOfImage(known));
            if (!mean) return mean.error();
            figures.emplace_back("depth_mm", 1000 * *mean);
            const auto median =
                medianAbsoluteError(viewOfImage(ours.depth), viewOfImage(*truth.depth), viewOfImage(known));
            if (!median) return median.error();
            figures.emplace_back("depth_median_mm", 1000 * *median);
        }
    }
    if (truth.normal) {
        ARS_TRY(const AngularError angle, angularError(viewOfImage(ours.normal), viewOfImage(*truth.normal), overlap));
        figures.emplace_back("normal_deg", angle.meanDeg);
        figures.emplace_back("normal_median_deg", angle.medianDeg);
    }
    if (truth.roughness) {
        ARS_TRY_STATUS(add(figures, "roughness_mae",
                           meanAbsoluteError(viewOfImage(ours.roughness), viewOfImage(*truth.roughness), mask)));
        ARS_TRY_STATUS(add(figures, "roughness_psnr",
                           peakSignalToNoise(viewOfImage(ours.roughness), viewOfImage(*truth.roughness), mask)));
    }
    if (truth.occlusion) {
        ARS_TRY_STATUS(add(figures, "ao_mae",
                           meanAbsoluteError(viewOfImage(ours.occlusion), viewOfImage(*truth.occlusion), overlap)));
        ARS_TRY_STATUS(add(figures, "ao_psnr",
                           peakSignalToNoise(viewOfImage(ours.occlusion), viewOfImage(*truth.occlusion), overlap)));
    }
    return {};
}

Status judgeAlbedo(const std::string& name, const Image& albedo, const glm::dvec3& scale, const Image& truth,
                   const Image& mask, Figures& figures) {
    Image linear = albedo, encoded = albedo, encodedTruth = truth;
    for (std::size_t i = 0; i < linear.pixels.size(); ++i) {
        linear.pixels[i] = static_cast<float>(albedo.pixels[i] * scale[static_cast<int>(i % 3)]);
        encoded.pixels[i] = linearToSrgb(std::clamp(linear.pixels[i], 0.0f, 1.0f));
        encodedTruth.pixels[i] = linearToSrgb(std::clamp(truth.pixels[i], 0.0f, 1.0f));
    }
    const auto person = viewOfImage(mask);
    ARS_TRY_STATUS(
        add(figures, name + "_psnr", peakSignalToNoise(viewOfImage(encoded), viewOfImage(encodedTruth), person)));
    ARS_TRY_STATUS(
        add(figures, name + "_psnr_linear", peakSignalToNoise(viewOfImage(linear), viewOfImage(truth), person)));
    return add(figures, name + "_mae", meanAbsoluteError(viewOfImage(linear), viewOfImage(truth), person));
}

void AlbedoScale::add(const Image& picture, const Image& truth, const Image& mask) {
    for (std::size_t p = 0; p < mask.pixels.size(); ++p) {
        if (!(mask.pixels[p] > 0.5f)) continue;
        ++pixels;
        for (int c = 0; c < 3; ++c) {
            const double value = picture.pixels[3 * p + static_cast<std::size_t>(c)];
            products[c] += value * truth.pixels[3 * p + static_cast<std::size_t>(c)];
            squares[c] += value * value;
        }
    }
}

glm::dvec3 AlbedoScale::value() const {
    glm::dvec3 scale(1.0);
    for (int c = 0; c < 3; ++c) {
        if (squares[c] > 0.0 && products[c] > 0.0) scale[c] = products[c] / squares[c];
    }
    return scale;
}

} // namespace ars::detail
