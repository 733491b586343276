#include "model/evaluation/evaluated_view.h"

#include <algorithm>
#include <cmath>

namespace ars::detail {
namespace {

constexpr int kMargin = 8; ///< pixels around the person
constexpr int kGap = 4;
constexpr float kErrorGain = 4.0f;

/// The part of the pictures that is shown; both ends belong to it.
struct Crop {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    int width() const { return x1 - x0 + 1; }
    int height() const { return y1 - y0 + 1; }
};

Crop cropOf(const Image& mask) {
    Crop crop{mask.width - 1, mask.height - 1, 0, 0};
    for (int y = 0; y < mask.height; ++y) {
        for (int x = 0; x < mask.width; ++x) {
            if (mask.at(y, x, 0) < 0.5f) continue;
            crop = {std::min(crop.x0, x), std::min(crop.y0, y), std::max(crop.x1, x), std::max(crop.y1, y)};
        }
    }
    return {std::max(crop.x0 - kMargin, 0), std::max(crop.y0 - kMargin, 0), std::min(crop.x1 + kMargin, mask.width - 1),
            std::min(crop.y1 + kMargin, mask.height - 1)};
}

/// Every pixel of `source` through `map` to three sRGB numbers.
template <typename Map>
Image mapped(const Image& source, Map&& map) {
    Image image;
    image.width = source.width;
    image.height = source.height;
    image.channels = 3;
    image.space = ColorSpace::Srgb;
    const auto channels = static_cast<std::size_t>(source.channels);
    image.pixels.resize(source.pixels.size() / channels * 3);
    for (std::size_t p = 0; p < image.pixels.size() / 3; ++p)
        map(&source.pixels[p * channels], p, &image.pixels[3 * p]);
    return image;
}

Image grey(const Image& source) {
    return mapped(source,
                  [](const float* in, std::size_t, float* out) { std::fill_n(out, 3, std::clamp(in[0], 0.0f, 1.0f)); });
}

Image albedoPicture(const Image& source, const glm::dvec3& scale) {
    return mapped(source, [&](const float* in, std::size_t, float* out) {
        for (int c = 0; c < 3; ++c) out[c] = linearToSrgb(std::clamp(static_cast<float>(in[c] * scale[c]), 0.0f, 1.0f));
    });
}

Image normalPicture(const Image& source) {
    return mapped(source, [](const float* in, std::size_t, float* out) {
        const bool empty = in[0] == 0.0f && in[1] == 0.0f && in[2] == 0.0f;
        out[0] = empty ? 0.0f : 0.5f + 0.5f * in[0];
        out[1] = empty ? 0.0f : 0.5f - 0.5f * in[1];
        out[2] = empty ? 0.0f : 0.5f - 0.5f * in[2];
    });
}

/// |a - b| times four inside the mask.
Image errorPicture(const Image& a, const Image& b, const Image& mask) {
    return mapped(a, [&](const float* in, std::size_t p, float* out) {
        for (std::size_t c = 0; c < 3; ++c)
            out[c] = std::min(1.0f, kErrorGain * std::abs(in[c] - b.pixels[3 * p + c])) * mask.pixels[p];
    });
}

void paste(const Image& source, const Crop& crop, int left, int top, Image& page) {
    for (int y = 0; y < crop.height(); ++y) {
        const float* from =
            &source.pixels[(static_cast<std::size_t>(crop.y0 + y) * static_cast<std::size_t>(source.width) +
                            static_cast<std::size_t>(crop.x0)) *
                           3];
        std::copy_n(from, 3 * static_cast<std::size_t>(crop.width()),
                    &page.pixels[(static_cast<std::size_t>(top + y) * static_cast<std::size_t>(page.width) +
                                  static_cast<std::size_t>(left)) *
                                 3]);
    }
}

Image pageOf(const std::vector<std::vector<Image>>& rows, const Crop& crop) {
    std::size_t columns = 0;
    for (const auto& row : rows) columns = std::max(columns, row.size());
    Image page;
    page.width = static_cast<int>(columns) * (crop.width() + kGap) - kGap;
    page.height = static_cast<int>(rows.size()) * (crop.height() + kGap) - kGap;
    page.channels = 3;
    page.space = ColorSpace::Srgb;
    page.pixels.assign(static_cast<std::size_t>(page.width) * static_cast<std::size_t>(page.height) * 3, 1.0f);
    for (std::size_t r = 0; r < rows.size(); ++r) {
        for (std::size_t c = 0; c < rows[r].size(); ++c) {
            paste(rows[r][c], crop, static_cast<int>(c) * (crop.width() + kGap),
                  static_cast<int>(r) * (crop.height() + kGap), page);
        }
    }
    return page;
}

} // namespace

Image comparisonPage(const Photograph& photograph, const RenderedView& ours, const TrueBuffers& truth,
                     const std::vector<Image>& pictures, const glm::dvec3& albedoScale) {
    std::vector<std::vector<Image>> rows(1);
    rows[0].push_back(photograph.view.color);
    for (const Image& picture : pictures) rows[0].push_back(picture);
    for (const Image& picture : pictures)
        rows[0].push_back(errorPicture(picture, photograph.view.color, photograph.mask));
    std::vector<Image> buffers;
    if (truth.albedo) {
        buffers.push_back(albedoPicture(*truth.albedo, glm::dvec3(1.0)));
        buffers.push_back(albedoPicture(ours.albedo, albedoScale));
    }
    if (truth.normal) {
        buffers.push_back(normalPicture(*truth.normal));
        buffers.push_back(normalPicture(ours.normal));
    }
    if (truth.occlusion) {
        buffers.push_back(grey(*truth.occlusion));
        buffers.push_back(grey(ours.occlusion));
    }
    if (truth.roughness) {
        buffers.push_back(grey(*truth.roughness));
        buffers.push_back(grey(ours.roughness));
    }
    if (!buffers.empty()) rows.push_back(std::move(buffers));
    return pageOf(rows, cropOf(photograph.mask));
}

} // namespace ars::detail
