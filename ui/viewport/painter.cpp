#include "ui/viewport/painter.h"

#include "engine/core/parallel.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>

namespace ars::ui {

namespace {

constexpr std::uint64_t kFramesKept = 120; ///< a tile that nobody looks at any more

ImageView<const float> viewOfImage(const std::shared_ptr<const Image>& image) {
    if (!image || image->pixels.empty()) return {};
    return {image->pixels.data(), image->width, image->height, image->channels};
}

bool equal(const std::vector<OverlayLine>& a, const std::vector<OverlayLine>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const OverlayLine& x, const OverlayLine& y) {
        return x.begin == y.begin && x.end == y.end && x.color == y.color && x.widthPixels == y.widthPixels;
    });
}

bool equal(const PresentSettings& a, const PresentSettings& b) {
    return a.buffer == b.buffer && a.minimum == b.minimum && a.maximum == b.maximum && a.colorMap == b.colorMap &&
           a.tone == b.tone && a.backdrop == b.backdrop && a.placement == b.placement &&
           a.backdropBlur == b.backdropBlur && a.smooth == b.smooth && a.grid == b.grid && a.gridColor == b.gridColor;
}

bool samePictures(const TileContent& a, const TileContent& b) {
    return a.picture == b.picture && a.opacity == b.opacity && a.depth == b.depth && a.thumbnail == b.thumbnail;
}

bool sameLook(const TileContent& a, const TileContent& b) {
    return samePictures(a, b) && a.parts == b.parts && a.discs == b.discs && a.mask == b.mask &&
           a.environment == b.environment && a.maskColor == b.maskColor && a.partsStrength == b.partsStrength &&
           a.camera == b.camera && equal(a.settings, b.settings) && equal(a.lines, b.lines);
}

/// Where the picture lies in a target of another shape: as high as it, in the middle. A camera keeps its vertical
/// field when the window changes, so that this is where its pixels belong.
glm::ivec4 fittedArea(const Camera& camera, int width, int height) {
    const double aspect = static_cast<double>(camera.width) / camera.height;
    const int fitted = static_cast<int>(std::lround(aspect * height));
    if (std::abs(fitted - width) <= 2) return {0, 0, width, height};
    return {(width - fitted) / 2, 0, fitted, height};
}

} // namespace

Image sparserPicture(const Image& picture, int width, int height) {
    const int step = std::max(1, std::min(picture.width / std::max(width, 1), picture.height / std::max(height, 1)));
    if (step == 1) return picture;
    Image result;
    result.width = picture.width / step;
    result.height = picture.height / step;
    result.channels = picture.channels;
    result.space = picture.space;
    result.premultiplied = picture.premultiplied;
    const auto channels = static_cast<std::size_t>(picture.channels);
    result.pixels.resize(static_cast<std::size_t>(result.width) * static_cast<std::size_t>(result.height) * channels);
    const int near = step / 4, far = step - 1 - step / 4;
    for (int row = 0; row < result.height; ++row) {
        float* out =
            result.pixels.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(result.width) * channels;
        for (int column = 0; column < result.width; ++column) {
            for (int channel = 0; channel < picture.channels; ++channel) {
                const int y = row * step, x = column * step;
                *out++ = 0.25f * (picture.at(y + near, x + near, channel) + picture.at(y + near, x + far, channel) +
                                  picture.at(y + far, x + near, channel) + picture.at(y + far, x + far, channel));
            }
        }
    }
    return result;
}

struct Painter::Tile {
    std::optional<RenderTarget> target, maskTarget;
    bool depth = false;
    ShownPicture picture, parts;
    TileContent content; ///< as it was drawn last
    bool drawn = false;
    std::shared_ptr<const Image> partsIn;
    std::shared_ptr<const std::vector<OverlayLine>> maskIn;
    std::shared_ptr<const Image> maskDepth;
    std::uint64_t usedIn = 0;
    std::uint64_t version = 0;           ///< of what is in the target
    std::uint64_t first = 0, second = 0; ///< versions that a difference was made of
    float maximum = 0.0f;
    int measure = -1;
};

Painter::Painter() {
    auto presenter = Presenter::create();
    if (!presenter) {
        failure_ = presenter.error();
        return;
    }
    presenter_ = std::move(*presenter);
}

Painter::~Painter() = default;

void Painter::newFrame() {
    work_ = running_;
    running_ = {};
    ++frame_;
    std::erase_if(tiles_, [&](const auto& entry) { return entry.second->usedIn + kFramesKept < frame_; });
}

void Painter::warmUp(const PresentSettings& shaded, const PresentSettings& data) {
    constexpr int kSize = 16;
    constexpr int kFirst = -1, kSecond = -2, kNumbers = -3;
    auto flat = [](int channels) {
        auto image = std::make_shared<Image>();
        image->width = image->height = kSize;
        image->channels = channels;
        image->pixels.assign(static_cast<std::size_t>(kSize * kSize * channels), 0.5f);
        return image;
    };
    TileContent content;
    content.camera.width = content.camera.height = kSize;
    content.camera.fx = content.camera.fy = kSize;
    content.camera.cx = content.camera.cy = 0.5 * kSize;
    content.picture = flat(4);
    content.opacity = flat(1);
    content.depth = flat(1);
    content.parts = flat(3);
    content.lines = {{glm::vec3(-0.1f, 0.0f, 1.0f), glm::vec3(0.1f, 0.0f, 1.0f), glm::vec4(1.0f), 2.0f}};
    content.mask = std::make_shared<const std::vector<OverlayLine>>(content.lines);
    content.maskColor = glm::vec4(1.0f);
    content.settings = shaded;
    content.settings.grid = true;
    (void)paint(kFirst, content, kSize, kSize);
    TileContent plain = content;
    plain.parts = nullptr;
    plain.mask = nullptr;
    plain.lines.clear();
    plain.settings.grid = false;
    (void)paint(kSecond, plain, kSize, kSize);
    (void)paintDifference(kNumbers, kFirst, kSecond, false, 1.0f, ColorMap::Magma, kSize, kSize);
    plain.picture = content.opacity;
    plain.settings = data;
    (void)paint(kSecond, plain, kSize, kSize);
    for (int tile : {kFirst, kSecond, kNumbers}) tiles_.erase(tile);
}

Painter::Tile& Painter::tileOf(int number, int width, int height) {
    std::unique_ptr<Tile>& tile = tiles_[number];
    if (!tile) tile = std::make_unique<Tile>();
    if (tile->target && (tile->target->width() != width || tile->target->height() != height)) {
        tile->target.reset();
        tile->maskTarget.reset();
        tile->maskIn.reset();
        tile->drawn = false;
    }
    tile->usedIn = frame_;
    return *tile;
}

Status Painter::upload(Tile& tile, const TileContent& content, int width, int height) {
    ++running_.uploads;
    if (!content.thumbnail) {
        return tile.picture.set(viewOfImage(content.picture), viewOfImage(content.opacity), viewOfImage(content.depth));
    }
    const Image picture = sparserPicture(*content.picture, width, height);
    const Image opacity = content.opacity ? sparserPicture(*content.opacity, width, height) : Image{};
    auto view = [](const Image& image) {
        return image.pixels.empty()
                   ? ImageView<const float>{}
                   : ImageView<const float>{image.pixels.data(), image.width, image.height, image.channels};
    };
    return tile.picture.set(view(picture), view(opacity), {});
}

void Painter::bringEnvironment(const TileContent& content) {
    if (content.settings.backdrop != Backdrop::Environment || !content.environment) return;
    if (environmentIn_ == content.environment) return;
    environmentIn_ = content.environment;
    presenter_->setEnvironment(*environmentIn_);
}

Status Painter::draw(Tile& tile, const TileContent& content, int width, int height) {
    const glm::ivec4 area = fittedArea(content.camera, width, height);
    PresentSettings settings = content.settings;
    if (settings.backdrop == Backdrop::Environment && !content.environment) settings.backdrop = Backdrop::Color;
    bringEnvironment(content);
    if (content.mask && (tile.maskIn != content.mask || tile.maskDepth != content.depth)) {
        if (!tile.maskTarget) {
            ARS_TRY(RenderTarget target, RenderTarget::create((width + 1) / 2, (height + 1) / 2));
            tile.maskTarget.emplace(std::move(target));
        }
        tile.maskTarget->bind();
        presenter_->drawMask(tile.picture, content.camera, *content.mask, 0.03f, tile.maskTarget->width(),
                             tile.maskTarget->height());
        tile.maskIn = content.mask;
        tile.maskDepth = content.depth;
    }
    tile.target->bind();
    const bool whole = area.z == width;
    if (!whole || content.discs)
        ARS_TRY_STATUS(presenter_->drawBackground(settings, content.camera, 0, 0, width, height));
    if (content.discs) {
        if (!discs_) {
            ARS_TRY(discs_, SurfelDiscs::create());
        }
        if (discsIn_ != content.discs) {
            ARS_TRY_STATUS(discs_->set(*content.discs));
            discsIn_ = content.discs;
        }
        discs_->draw(content.camera, {}, area.x, area.y, area.z, area.w);
        presenter_->drawOverlays(tile.picture, settings, content.camera, content.lines, area.x, area.y, area.z, area.w);
    } else {
        ARS_TRY_STATUS(
            presenter_->draw(tile.picture, settings, content.camera, content.lines, area.x, area.y, area.z, area.w));
    }
    if (content.parts) {
        if (tile.partsIn != content.parts) {
            ARS_TRY_STATUS(tile.parts.set(viewOfImage(content.parts), viewOfImage(content.opacity), {}));
            tile.partsIn = content.parts;
        }
        ARS_TRY_STATUS(presenter_->tint(tile.parts, content.partsStrength, area.x, area.y, area.z, area.w));
    }
    if (content.mask) {
        ARS_TRY_STATUS(
            presenter_->tintMask(tile.picture, *tile.maskTarget, content.maskColor, area.x, area.y, area.z, area.w));
    }
    ++running_.tilesDrawn;
    ++tile.version;
    return {};
}

ImTextureRef Painter::paint(int number, const TileContent& content, int width, int height) {
    if (failure_ || !content.picture || width < 1 || height < 1) return {};
    const auto begin = std::chrono::steady_clock::now();
    Tile& tile = tileOf(number, width, height);
    if (!tile.drawn || !sameLook(tile.content, content)) {
        const TargetScope scope;
        if (!tile.target || (content.discs && !tile.depth)) {
            auto target = RenderTarget::create(width, height, content.discs != nullptr);
            if (!target) {
                failure_ = target.error();
                return {};
            }
            tile.depth = content.discs != nullptr;
            tile.target.emplace(std::move(*target));
        }
        const bool fresh = tile.picture.empty() || !samePictures(tile.content, content);
        Status done = fresh ? upload(tile, content, width, height) : Status{};
        if (done.ok()) done = draw(tile, content, width, height);
        if (!done.ok()) {
            failure_ = done.error();
            return {};
        }
        tile.content = content;
        tile.drawn = true;
    }
    running_.milliseconds +=
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    return ImTextureRef(static_cast<ImTextureID>(tile.target->texture()));
}

ImTextureRef Painter::last(int number) {
    const auto found = tiles_.find(number);
    if (found == tiles_.end() || !found->second->drawn) return {};
    found->second->usedIn = frame_;
    return ImTextureRef(static_cast<ImTextureID>(found->second->target->texture()));
}

ImTextureRef Painter::paintDifference(int number, int first, int second, bool squared, float maximum, ColorMap map,
                                      int width, int height) {
    const auto a = tiles_.find(first), b = tiles_.find(second);
    if (failure_ || a == tiles_.end() || b == tiles_.end() || !a->second->drawn || !b->second->drawn) return {};
    Tile& tile = tileOf(number, width, height);
    const int measure = 2 * static_cast<int>(map) + (squared ? 1 : 0);
    const bool same = tile.drawn && tile.first == a->second->version && tile.second == b->second->version &&
                      tile.maximum == maximum && tile.measure == measure;
    if (!same) {
        const TargetScope scope;
        if (!tile.target) {
            auto target = RenderTarget::create(width, height);
            if (!target) {
                failure_ = target.error();
                return {};
            }
            tile.target.emplace(std::move(*target));
        }
        tile.target->bind();
        const Status done = presenter_->drawDifference(*a->second->target, *b->second->target, squared, maximum, map, 0,
                                                       0, width, height);
        if (!done.ok()) {
            failure_ = done.error();
            return {};
        }
        tile.first = a->second->version;
        tile.second = b->second->version;
        tile.maximum = maximum;
        tile.measure = measure;
        tile.drawn = true;
        ++running_.tilesDrawn;
    }
    return ImTextureRef(static_cast<ImTextureID>(tile.target->texture()));
}

} // namespace ars::ui
