#pragma once

#include "engine/core/image_view.h"
#include "engine/io/image.h"

#include <cstdint>
#include <span>
#include <vector>

namespace ars {

/// An OpenGL texture that owns its name. A context must be current whenever one is used or destroyed.
class Texture {
public:
    Texture() = default;
    Texture(Texture&& other) noexcept;
    Texture& operator=(Texture&& other) noexcept;
    ~Texture();

    /// A float picture in host memory with 1, 3 or 4 channels, without mip levels; memory is reused where size and
    /// channels stay. `linear`: interpolates between texels, else shows them as squares.
    void upload(ImageView<const float> picture, bool linear);
    /// Storage for a float picture that somebody else fills in: 1 channel, or 4 for everything else.
    void reserve(int width, int height, int channels);
    /// The same with mip levels, wrapping around horizontally: an environment.
    void uploadEnvironment(ImageView<const float> picture);
    /// A table over [0, 1] of `channels` floats per entry.
    void uploadTable(std::span<const float> values, int channels);
    /// A cube of size^3 RGB entries, red fastest.
    void uploadCubeTable(std::span<const float> values, int size);
    /// Empty target to draw into, RGBA with 8 bits.
    void makeTarget(int width, int height);
    /// The same for depth, 32 bits.
    void makeDepthTarget(int width, int height);

    void bind(int unit) const;
    unsigned name() const { return name_; }
    bool empty() const { return name_ == 0; }
    int width() const { return width_; }
    int height() const { return height_; }

private:
    void storage(unsigned target, int levels, unsigned format, int width, int height, int depth);

    unsigned name_ = 0;
    unsigned target_ = 0;
    unsigned format_ = 0;
    int width_ = 0;
    int height_ = 0;
    int depth_ = 0;
};

/// Somewhere to draw that is no window.
class RenderTarget {
public:
    /// Unavailable when the driver refuses.
    /// @param depth  whether it can be drawn into with a depth test
    static Result<RenderTarget> create(int width, int height, bool depth = false);
    RenderTarget(RenderTarget&& other) noexcept;
    RenderTarget& operator=(RenderTarget&& other) noexcept;
    ~RenderTarget();

    /// What is drawn from now on goes here; the viewport is set to all of it.
    void bind() const;
    int width() const { return color_.width(); }
    int height() const { return color_.height(); }
    unsigned texture() const { return color_.name(); }
    /// (height, width, 4) bytes, row 0 on top; waits until all is drawn.
    std::vector<std::uint8_t> read() const;

private:
    RenderTarget() = default;
    unsigned framebuffer_ = 0;
    Texture color_, depth_;
};

/// Remembers which frame buffer and viewport are in use and brings them back at the end of its life: for drawing into a
/// target in the middle of somebody else's frame.
class TargetScope {
public:
    TargetScope();
    ~TargetScope();
    TargetScope(const TargetScope&) = delete;
    TargetScope& operator=(const TargetScope&) = delete;

private:
    int framebuffer_ = 0;
    int viewport_[4] = {};
};

} // namespace ars
