#include "ui/viewport/comparison.h"

#include "engine/core/parallel.h"
#include "engine/metrics/flip.h"
#include "engine/metrics/image_metrics.h"
#include "engine/scene/export.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

ImageView<const float> viewOfImage(const Image& image) {
    return {image.pixels.data(), image.width, image.height, image.channels};
}

/// Shown as light, as encoded colours or as the data of the buffer that is looked at.
BufferId lookOfFile(const Image& image, BufferId buffer) {
    if (image.space == ColorSpace::Srgb) return BufferId::Radiance;
    if (image.space == ColorSpace::Linear && image.channels >= 3) return BufferId::Beauty;
    return buffer;
}

std::string fileName(const std::string& path) { return std::filesystem::path(path).filename().string(); }

/// One of the two pictures of a measurement, as the window shows it, and its mask.
struct Shown {
    Image picture; ///< RGB, sRGB-encoded
    Image opacity; ///< one channel; empty: opaque
};

} // namespace

struct Comparison::Fitted {
    std::shared_ptr<const PictureAsset> asset;
    PixelRect rect;
    int width = 0, height = 0;
    std::shared_ptr<const Image> picture, opacity;
    bool same(const std::shared_ptr<const PictureAsset>& a, const PixelRect& r, int w, int h) const {
        return asset == a && width == w && height == h && rect.x == r.x && rect.y == r.y && rect.width == r.width &&
               rect.height == r.height;
    }
};

/// A pair and what is known of it. The thread that measures writes `numbers` before the window reads them.
struct Comparison::Measured {
    std::shared_ptr<const Frame> frame, otherFrame;
    std::shared_ptr<const Image> first, second, firstOpacity, secondOpacity;
    std::shared_ptr<const Environment> environment;
    Document document;
    BufferId buffer = BufferId::Beauty, otherBuffer = BufferId::Beauty;
    ComparisonNumbers numbers;

    bool same(const Measured& o) const {
        const ViewSection& a = document.view;
        const ViewSection& b = o.document.view;
        return first == o.first && second == o.second && buffer == o.buffer && otherBuffer == o.otherBuffer &&
               a.tone == b.tone && a.buffers == b.buffers && document.light == o.document.light;
    }
    Result<Shown> shown(bool other) const;
    void measure();
};

Result<Shown> Comparison::Measured::shown(bool other) const {
    const std::shared_ptr<const Image>& picture = other ? second : first;
    const std::shared_ptr<const Image>& opacity = other ? secondOpacity : firstOpacity;
    Image covered = opacity ? *opacity : Image{};
    if (!opacity) {
        covered.width = picture->width;
        covered.height = picture->height;
        covered.channels = 1;
        covered.space = ColorSpace::Data;
        covered.pixels.assign(static_cast<std::size_t>(picture->width) * static_cast<std::size_t>(picture->height),
                              1.0f);
    }
    // Both sides over the same plain background: a difference there would be nobody's.
    Document plain = document;
    plain.light.backdrop = BackdropKind::Color;
    ARS_TRY(Image display, shownPicture(plain, other ? otherBuffer : buffer, *picture, covered, frame->inputs.camera,
                                        frame->inputs.placement, environment.get(), false));
    return Shown{std::move(display), std::move(covered)};
}

void Comparison::Measured::measure() {
    const Result<Shown> a = shown(false), b = shown(true);
    if (!a || !b) {
        numbers.problem = (a ? b : a).error().describe();
        return;
    }
    if (a->picture.width != b->picture.width || a->picture.height != b->picture.height) {
        numbers.problem = fmt::format("sizes differ: {}x{} and {}x{}", a->picture.width, a->picture.height,
                                      b->picture.width, b->picture.height);
        return;
    }
    auto keep = [](Result<double> value) { return value ? std::optional(*value) : std::nullopt; };
    const Picture here = viewOfImage(a->picture), there = viewOfImage(b->picture), mask = viewOfImage(a->opacity);
    numbers.whole.psnr = keep(peakSignalToNoise(here, there));
    numbers.mask.psnr = keep(peakSignalToNoise(here, there, mask));
    numbers.whole.ssim = keep(structuralSimilarity(here, there));
    numbers.mask.ssim = keep(structuralSimilarity(here, there, mask));
    auto map = std::make_shared<Image>();
    map->width = a->picture.width;
    map->height = a->picture.height;
    map->channels = 1;
    map->space = ColorSpace::Data;
    map->pixels.resize(here.pixelCount());
    const Status done = flipMap(here, there, {map->pixels.data(), map->width, map->height, 1});
    if (!done.ok()) {
        numbers.problem = done.error().describe();
        return;
    }
    double sum = 0.0, masked = 0.0, count = 0.0;
    for (std::size_t p = 0; p < map->pixels.size(); ++p) {
        sum += map->pixels[p];
        if (!(mask[p] > 0.5f)) continue;
        masked += map->pixels[p];
        count += 1.0;
    }
    numbers.whole.flip = sum / static_cast<double>(map->pixels.size());
    if (count > 0) numbers.mask.flip = masked / count;
    numbers.flipMap = std::move(map);
}

PresentSettings presentSettings(const Document& document, BufferId buffer, double timeS) {
    const ViewSection& view = document.view;
    PresentSettings settings = defaultPresentSettings(buffer);
    const BufferDisplay& display = view.buffers[static_cast<std::size_t>(buffer)];
    if (display.range) {
        settings.minimum = display.range->first;
        settings.maximum = display.range->second;
    }
    if (display.colorMap) settings.colorMap = *display.colorMap;
    settings.tone = view.tone;
    settings.tone.transparent = false;
    settings.backdrop = static_cast<Backdrop>(document.light.backdrop);
    settings.placement = placementAt(document, timeS);
    settings.backdropBlur = document.light.backdropBlur;
    return settings;
}

Image fittedPicture(const Image& picture, const PixelRect& rect, int width, int height) {
    Image result;
    result.width = width;
    result.height = height;
    result.channels = 4;
    result.space = picture.space;
    result.pixels.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 4, 0.0f);
    if (picture.pixels.empty() || !(rect.width > 0) || !(rect.height > 0)) return result;
    const double sx = picture.width / rect.width, sy = picture.height / rect.height; // source pixels per pixel
    const int colors = picture.channels >= 3 ? 3 : 1;
    // Pixels that are enlarged are interpolated, those that shrink are averaged over what they cover.
    auto taps = [](double step) { return std::clamp(static_cast<int>(std::ceil(step)), 1, 16); };
    const int nx = taps(sx), ny = taps(sy);
    auto sample = [&](double x, double y, float* sum, float weight) {
        const double u = std::clamp(x - 0.5, 0.0, picture.width - 1.0),
                     v = std::clamp(y - 0.5, 0.0, picture.height - 1.0);
        const int x0 = static_cast<int>(u), y0 = static_cast<int>(v);
        const int x1 = std::min(x0 + 1, picture.width - 1), y1 = std::min(y0 + 1, picture.height - 1);
        const auto fu = static_cast<float>(u - x0), fv = static_cast<float>(v - y0);
        const float w[4] = {(1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv};
        const int xs[4] = {x0, x1, x0, x1}, ys[4] = {y0, y0, y1, y1};
        for (int k = 0; k < 4; ++k) {
            const float alpha = picture.hasAlpha() ? picture.at(ys[k], xs[k], picture.channels - 1) : 1.0f;
            const float factor = weight * w[k];
            for (int c = 0; c < 3; ++c) {
                const float value = picture.at(ys[k], xs[k], std::min(c, colors - 1));
                sum[c] += factor * (picture.premultiplied ? value : value * alpha);
            }
            sum[3] += factor * alpha;
        }
    };
    parallelFor(
        static_cast<std::size_t>(height),
        [&](std::size_t row) {
            for (int column = 0; column < width; ++column) {
                const double cx = column + 0.5 - rect.x, cy = static_cast<double>(row) + 0.5 - rect.y;
                if (cx < 0 || cy < 0 || cx >= rect.width || cy >= rect.height) continue;
                float sum[4] = {0, 0, 0, 0};
                for (int j = 0; j < ny; ++j) {
                    for (int i = 0; i < nx; ++i) {
                        sample((cx - 0.5 + (i + 0.5) / nx) * sx, (cy - 0.5 + (j + 0.5) / ny) * sy, sum,
                               1.0f / static_cast<float>(nx * ny));
                    }
                }
                float* out =
                    &result.pixels[(row * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)) * 4];
                for (int c = 0; c < 3; ++c) out[c] = sum[3] > 1e-6f ? sum[c] / sum[3] : 0.0f;
                out[3] = sum[3];
            }
        },
        16);
    return result;
}

void Comparison::fitFile(StudioContext& context, int width, int height, OtherSide& side) {
    const Document& document = context.document();
    const std::shared_ptr<const PictureAsset> asset = context.session.assets().picture;
    if (!asset) {
        side.missing = document.view.compare.kind == CompareKind::Photograph ? "no photograph for this camera"
                                                                             : "the picture is being opened";
        return;
    }
    PixelRect rect;
    (void)frameCamera(document, context.session.assets(), context.session.timeS(), width, height, &rect);
    if (document.camera.datasetCamera.empty()) {
        // The free camera keeps its vertical field: a picture of the same view is as high as the frame.
        rect.height = height;
        rect.width = static_cast<double>(asset->image.width) / asset->image.height * height;
        rect.x = 0.5 * (width - rect.width);
        rect.y = 0.0;
    }
    const BufferId look = lookOfFile(asset->image, side.buffer);
    if (!(fitted_ && fitted_->same(asset, rect, width, height)) &&
        !(fitting_ && fitting_->same(asset, rect, width, height))) {
        auto work = std::make_shared<Fitted>(Fitted{asset, rect, width, height, nullptr, nullptr});
        fitting_ = work;
        context.session.start(
            "Fitting the picture",
            [work, look](const ProgressFunction&) -> Status {
                Image picture = fittedPicture(work->asset->image, work->rect, work->width, work->height);
                auto opacity = std::make_shared<Image>();
                opacity->width = picture.width;
                opacity->height = picture.height;
                opacity->channels = 1;
                opacity->space = ColorSpace::Data;
                for (std::size_t p = 3; p < picture.pixels.size(); p += 4) opacity->pixels.push_back(picture.pixels[p]);
                const bool data = bufferInfo(look).channels() == 1;
                const int channels = data ? 1 : look == BufferId::Beauty ? 4 : 3;
                Image kept = picture;
                kept.channels = channels;
                kept.premultiplied = channels == 4;
                kept.pixels.clear();
                for (std::size_t p = 0; p < picture.pixels.size(); p += 4) {
                    const float alpha = channels == 4 ? picture.pixels[p + 3] : 1.0f;
                    for (int c = 0; c < std::min(channels, 3); ++c) {
                        kept.pixels.push_back(picture.pixels[p + static_cast<std::size_t>(c)] * alpha);
                    }
                    if (channels == 4) kept.pixels.push_back(alpha);
                }
                work->picture = std::make_shared<const Image>(std::move(kept));
                work->opacity = std::move(opacity);
                return {};
            },
            [this, work, alive = std::weak_ptr<int>(alive_)](const Status& status) {
                if (alive.expired() || fitting_ != work) return;
                fitting_.reset();
                if (status.ok()) fitted_ = work;
            },
            true);
    }
    side.buffer = look;
    side.label = document.view.compare.kind == CompareKind::Photograph ? "Photograph " + document.camera.datasetCamera
                                                                       : fileName(document.view.compare.file);
    if (!fitted_ || fitted_->asset != asset || !fitted_->picture) {
        side.missing = "the picture is being fitted";
        return;
    }
    side.content.picture = fitted_->picture;
    side.content.opacity = fitted_->opacity;
}

OtherSide Comparison::otherSide(StudioContext& context, const std::shared_ptr<const Frame>& frame, int width,
                                int height) {
    const Document& document = context.document();
    const CompareSection& compare = document.view.compare;
    OtherSide side;
    side.buffer = document.view.buffer;
    auto take = [&](const std::shared_ptr<const Frame>& from, const char* missing) {
        side.frame = from;
        if (!from) {
            side.missing = missing;
            return;
        }
        const auto picture = from->pictures.find(side.buffer);
        const auto opacity = from->pictures.find(BufferId::Opacity);
        if (picture == from->pictures.end() || opacity == from->pictures.end()) {
            side.missing = "being rendered";
            return;
        }
        side.content.picture = picture->second;
        side.content.opacity = opacity->second;
        side.content.camera = from->inputs.camera;
    };
    switch (compare.kind) {
    case CompareKind::Buffer:
        side.buffer = compare.buffer;
        side.label = bufferInfo(compare.buffer).label;
        take(frame, "no picture yet");
        break;
    case CompareKind::Held:
        side.label = "Held";
        take(context.session.otherFrame(), compare.held ? "being rendered" : "nothing is held: Compare, Hold");
        break;
    case CompareKind::Avatar:
        side.label = compare.file.empty() ? "Other avatar" : fileName(compare.file);
        take(context.session.otherFrame(), "the other avatar is being opened");
        break;
    case CompareKind::Picture:
    case CompareKind::Photograph:
        fitFile(context, width, height, side);
        if (frame) side.content.camera = resizedCamera(frame->inputs.camera, width, height);
        break;
    }
    side.content.settings = presentSettings(document, side.buffer, context.session.timeS());
    return side;
}

const ComparisonNumbers* Comparison::numbers(StudioContext& context, const std::shared_ptr<const Frame>& frame,
                                             const OtherSide& other) {
    const Document& document = context.document();
    const auto measured = [&] { return measured_ ? &measured_->numbers : nullptr; };
    const bool ready = frame && frame->quality == FrameQuality::Full && other.missing.empty() &&
                       other.content.picture && (!other.frame || other.frame->quality == FrameQuality::Full);
    if (!ready || measuring_) return measured();
    const auto picture = frame->pictures.find(document.view.buffer);
    const auto opacity = frame->pictures.find(BufferId::Opacity);
    if (picture == frame->pictures.end() || opacity == frame->pictures.end()) return measured();
    auto work = std::make_shared<Measured>();
    work->frame = frame;
    work->otherFrame = other.frame;
    work->first = picture->second;
    work->firstOpacity = opacity->second;
    work->second = other.content.picture;
    work->secondOpacity = other.content.opacity;
    work->buffer = document.view.buffer;
    work->otherBuffer = other.buffer;
    work->document.view = document.view;
    work->document.light = document.light;
    if (measured_ && measured_->same(*work)) return measured();
    measuring_ = work;
    context.session.start(
        "Measuring the difference",
        [work](const ProgressFunction&) -> Status {
            work->measure();
            return {};
        },
        [this, work, alive = std::weak_ptr<int>(alive_)](const Status&) {
            if (alive.expired() || measuring_ != work) return;
            measuring_.reset();
            measured_ = work;
        },
        true);
    return measured();
}

} // namespace ars::ui
