#include "ui/look/buffer_pictures.h"

#include "engine/surfel/gbuffer.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <tuple>

namespace ars::ui {

namespace {

constexpr int kThumbWidth = 72, kThumbHeight = 54;
constexpr double kPauseS = 0.04; ///< between two refreshed thumbnails

} // namespace

std::pair<float, float> shownRange(const Document& document, BufferId buffer) {
    const BufferInfo& info = bufferInfo(buffer);
    return document.view.buffers[static_cast<std::size_t>(buffer)].range.value_or(
        std::pair{info.minimum, info.maximum});
}

DisplaySettings displaySettings(const Document& document, BufferId buffer) {
    const BufferDisplay& display = document.view.buffers[static_cast<std::size_t>(buffer)];
    return {document.view.tone, display.range, display.colorMap};
}

PixelBox portraitBox(const Image& opacity) {
    const int step = std::max(1, std::max(opacity.width, opacity.height) / 200);
    int left = opacity.width, right = -1, top = opacity.height;
    for (int row = 0; row < opacity.height; row += step) {
        for (int column = 0; column < opacity.width; column += step) {
            if (!(opacity.at(row, column, 0) > 0.5f)) continue;
            left = std::min(left, column);
            right = std::max(right, column);
            top = std::min(top, row);
        }
    }
    if (right < left) return {0, 0, opacity.width, opacity.height};
    // Some air around it.
    const int margin = std::max(step, (right - left) / 12);
    const int width = std::max(8, right - left + 2 * margin), height = width * 3 / 4;
    return {left - margin, std::max(0, top - margin), width, height};
}

Image thinnedPicture(const Image& picture, int width, int height) {
    return thinnedPicture(picture, {0, 0, picture.width, picture.height}, width, height);
}

Image thinnedPicture(const Image& picture, const PixelBox& box, int width, int height) {
    const int left = std::clamp(box.left, 0, picture.width), top = std::clamp(box.top, 0, picture.height);
    const int right = std::clamp(box.left + box.width, left, picture.width);
    const int bottom = std::clamp(box.top + box.height, top, picture.height);
    const int step = std::max(
        {1, (right - left + width - 1) / std::max(width, 1), (bottom - top + height - 1) / std::max(height, 1)});
    Image thin;
    thin.channels = picture.channels;
    thin.space = picture.space;
    thin.premultiplied = picture.premultiplied;
    thin.sourceBits = picture.sourceBits;
    thin.width = (right - left + step - 1) / step;
    thin.height = (bottom - top + step - 1) / step;
    thin.pixels.clear();
    thin.pixels.reserve(static_cast<std::size_t>(thin.width) * static_cast<std::size_t>(thin.height) *
                        static_cast<std::size_t>(picture.channels));
    for (int row = top; row < bottom; row += step) {
        for (int column = left; column < right; column += step) {
            for (int c = 0; c < picture.channels; ++c) thin.pixels.push_back(picture.at(row, column, c));
        }
    }
    return thin;
}

BufferHistogram histogramOf(const Image& picture, const Image& opacity, std::pair<float, float> around, int bins) {
    BufferHistogram histogram;
    histogram.channels = std::min(picture.channels, 3);
    std::tie(histogram.low, histogram.high) = around;
    if (opacity.width != picture.width || opacity.height != picture.height || bins < 1) return histogram;
    std::vector<float> values;
    std::array<std::vector<float>, 3> channels;
    for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
        if (!(opacity.pixels[p] > kMinOpacity)) continue;
        ++histogram.counted;
        for (int c = 0; c < histogram.channels; ++c) {
            const float value =
                picture.pixels[p * static_cast<std::size_t>(picture.channels) + static_cast<std::size_t>(c)];
            if (!std::isfinite(value)) continue;
            channels[static_cast<std::size_t>(c)].push_back(value);
            values.push_back(value);
        }
    }
    if (values.empty()) return histogram;
    const auto percentile = [&](double share) {
        const auto place = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
        std::nth_element(values.begin(), place, values.end());
        return *place;
    };
    histogram.percentile1 = percentile(0.01);
    histogram.percentile99 = percentile(0.99);
    histogram.low = std::min(histogram.low, histogram.percentile1);
    histogram.high = std::max({histogram.high, histogram.percentile99, histogram.low + 1e-6f});
    const float width = (histogram.high - histogram.low) / static_cast<float>(bins);
    for (int c = 0; c < histogram.channels; ++c) {
        std::vector<float>& shares = histogram.shares[static_cast<std::size_t>(c)];
        shares.assign(static_cast<std::size_t>(bins), 0.0f);
        for (const float value : channels[static_cast<std::size_t>(c)]) {
            const float place = (value - histogram.low) / width;
            // What lies beyond the axis is counted at its end, so that nothing seems to be missing.
            const int bin = static_cast<int>(std::clamp(place, 0.0f, static_cast<float>(bins) - 0.5f));
            shares[static_cast<std::size_t>(bin)] += 1.0f / static_cast<float>(histogram.counted);
        }
    }
    return histogram;
}

void BufferThumbnails::update(const Document& document, const std::shared_ptr<const Frame>& frame) {
    if (!frame) return;
    for (int i = 0; i < kBufferCount; ++i) {
        const bool present = frame->picture(static_cast<BufferId>(i)) != nullptr;
        // A buffer that is not asked for any more keeps its last picture, unless the avatar is another.
        slots_[static_cast<std::size_t>(i)].present |= present;
    }
    const double now = ImGui::GetTime();
    if (lastTime_ >= 0.0 && now - lastTime_ < kPauseS) return;
    const Image* opacity = frame->picture(BufferId::Opacity);
    for (int tried = 0; opacity && tried < kBufferCount; ++tried) {
        const auto id = static_cast<BufferId>(next_);
        Slot& slot = slots_[static_cast<std::size_t>(next_)];
        next_ = (next_ + 1) % kBufferCount;
        const Image* picture = frame->picture(id);
        const BufferDisplay& display = document.view.buffers[static_cast<std::size_t>(id)];
        if (!picture || (slot.request == frame->request && slot.quality == frame->quality && slot.display &&
                         *slot.display == display && slot.tone == document.view.tone)) {
            continue;
        }
        DisplaySettings settings = displaySettings(document, id);
        settings.tone.transparent = false;
        const PixelBox box = portraitBox(*opacity);
        auto shown = displayPicture(id, thinnedPicture(*picture, box, kThumbWidth, kThumbHeight),
                                    thinnedPicture(*opacity, box, kThumbWidth, kThumbHeight), settings);
        slot.request = frame->request;
        slot.quality = frame->quality;
        slot.display = display;
        slot.tone = document.view.tone;
        if (!shown) continue;
        slot.texture.upload({shown->pixels.data(), shown->width, shown->height, shown->channels}, true);
        lastTime_ = now;
        return;
    }
}

const Texture* BufferThumbnails::find(BufferId buffer) const {
    const Slot& slot = slots_[static_cast<std::size_t>(buffer)];
    return slot.present && !slot.texture.empty() ? &slot.texture : nullptr;
}

} // namespace ars::ui
