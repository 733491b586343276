#include "engine/gl/texture.h"

#include "engine/gl/opengl.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <utility>

namespace ars {

namespace {

struct Format {
    GLenum inside;
    GLenum outside;
};

Format floatFormat(int channels) {
    switch (channels) {
    case 1:
        return {GL_R32F, GL_RED};
    case 3:
        return {GL_RGB32F, GL_RGB};
    default:
        assert(channels == 4);
        return {GL_RGBA32F, GL_RGBA};
    }
}

} // namespace

Texture::Texture(Texture&& other) noexcept { *this = std::move(other); }

Texture& Texture::operator=(Texture&& other) noexcept {
    std::swap(name_, other.name_);
    std::swap(target_, other.target_);
    std::swap(format_, other.format_);
    std::swap(width_, other.width_);
    std::swap(height_, other.height_);
    std::swap(depth_, other.depth_);
    return *this;
}

Texture::~Texture() {
    if (name_) glDeleteTextures(1, &name_);
}

/// Immutable storage; a new texture only where anything differs.
void Texture::storage(unsigned target, int levels, unsigned format, int width, int height, int depth) {
    if (name_ && target_ == target && format_ == format && width_ == width && height_ == height && depth_ == depth)
        return;
    if (name_) glDeleteTextures(1, &name_);
    glCreateTextures(target, 1, &name_);
    if (target == GL_TEXTURE_1D) glTextureStorage1D(name_, levels, format, width);
    if (target == GL_TEXTURE_2D) glTextureStorage2D(name_, levels, format, width, height);
    if (target == GL_TEXTURE_3D) glTextureStorage3D(name_, levels, format, width, height, depth);
    for (const GLenum side : {GL_TEXTURE_WRAP_S, GL_TEXTURE_WRAP_T, GL_TEXTURE_WRAP_R}) {
        glTextureParameteri(name_, side, GL_CLAMP_TO_EDGE);
    }
    glTextureParameteri(name_, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTextureParameteri(name_, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    target_ = target;
    format_ = format;
    width_ = width;
    height_ = height;
    depth_ = depth;
}

void Texture::upload(ImageView<const float> picture, bool linear) {
    const Format format = floatFormat(picture.channels);
    storage(GL_TEXTURE_2D, 1, format.inside, picture.width, picture.height, 1);
    const GLint filter = linear ? GL_LINEAR : GL_NEAREST;
    glTextureParameteri(name_, GL_TEXTURE_MIN_FILTER, filter);
    glTextureParameteri(name_, GL_TEXTURE_MAG_FILTER, filter);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTextureSubImage2D(name_, 0, 0, 0, picture.width, picture.height, format.outside, GL_FLOAT, picture.data);
}

void Texture::reserve(int width, int height, int channels) {
    storage(GL_TEXTURE_2D, 1, channels == 1 ? GL_R32F : GL_RGBA32F, width, height, 1);
}

void Texture::uploadEnvironment(ImageView<const float> picture) {
    const auto longer = static_cast<unsigned>(std::max(picture.width, picture.height));
    storage(GL_TEXTURE_2D, std::bit_width(longer), GL_RGB16F, picture.width, picture.height, 1);
    glTextureParameteri(name_, GL_TEXTURE_WRAP_S, GL_REPEAT);
    glTextureParameteri(name_, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    // Half floats end at 65,504; a sun beyond that is as white as one at it.
    std::vector<float> values(picture.data, picture.data + picture.valueCount());
    for (float& value : values) value = std::min(value, 65000.0f);
    glTextureSubImage2D(name_, 0, 0, 0, picture.width, picture.height, GL_RGB, GL_FLOAT, values.data());
    glGenerateTextureMipmap(name_);
}

void Texture::uploadTable(std::span<const float> values, int channels) {
    const Format format = floatFormat(channels);
    const int size = static_cast<int>(values.size()) / channels;
    storage(GL_TEXTURE_1D, 1, format.inside, size, 1, 1);
    glTextureSubImage1D(name_, 0, 0, size, format.outside, GL_FLOAT, values.data());
}

void Texture::uploadCubeTable(std::span<const float> values, int size) {
    assert(values.size() == static_cast<std::size_t>(size) * size * size * 3);
    storage(GL_TEXTURE_3D, 1, GL_RGB32F, size, size, size);
    glTextureSubImage3D(name_, 0, 0, 0, 0, size, size, size, GL_RGB, GL_FLOAT, values.data());
}

void Texture::makeTarget(int width, int height) { storage(GL_TEXTURE_2D, 1, GL_RGBA8, width, height, 1); }

void Texture::makeDepthTarget(int width, int height) {
    storage(GL_TEXTURE_2D, 1, GL_DEPTH_COMPONENT32F, width, height, 1);
}

void Texture::bind(int unit) const { glBindTextureUnit(static_cast<GLuint>(unit), name_); }

Result<RenderTarget> RenderTarget::create(int width, int height, bool depth) {
    RenderTarget target;
    target.color_.makeTarget(width, height);
    glCreateFramebuffers(1, &target.framebuffer_);
    glNamedFramebufferTexture(target.framebuffer_, GL_COLOR_ATTACHMENT0, target.color_.name(), 0);
    if (depth) {
        target.depth_.makeDepthTarget(width, height);
        glNamedFramebufferTexture(target.framebuffer_, GL_DEPTH_ATTACHMENT, target.depth_.name(), 0);
    }
    if (glCheckNamedFramebufferStatus(target.framebuffer_, GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
        return makeError(ErrorCode::Unavailable, "OpenGL",
                         fmt::format("no picture of {}x{} to draw into", width, height));
    }
    return target;
}

RenderTarget::RenderTarget(RenderTarget&& other) noexcept { *this = std::move(other); }

RenderTarget& RenderTarget::operator=(RenderTarget&& other) noexcept {
    std::swap(framebuffer_, other.framebuffer_);
    std::swap(color_, other.color_);
    std::swap(depth_, other.depth_);
    return *this;
}

RenderTarget::~RenderTarget() {
    if (framebuffer_) glDeleteFramebuffers(1, &framebuffer_);
}

void RenderTarget::bind() const {
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
    glViewport(0, 0, width(), height());
}

std::vector<std::uint8_t> RenderTarget::read() const {
    const std::size_t row = static_cast<std::size_t>(width()) * 4;
    std::vector<std::uint8_t> upwards(row * static_cast<std::size_t>(height())), pixels(upwards.size());
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, width(), height(), GL_RGBA, GL_UNSIGNED_BYTE, upwards.data());
    for (int y = 0; y < height(); ++y) {
        const auto source = upwards.begin() + static_cast<std::ptrdiff_t>(row) * (height() - 1 - y);
        std::copy(source, source + static_cast<std::ptrdiff_t>(row),
                  pixels.begin() + static_cast<std::ptrdiff_t>(row) * y);
    }
    return pixels;
}

TargetScope::TargetScope() {
    glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &framebuffer_);
    glGetIntegerv(GL_VIEWPORT, viewport_);
}

TargetScope::~TargetScope() {
    glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(framebuffer_));
    glViewport(viewport_[0], viewport_[1], viewport_[2], viewport_[3]);
}

} // namespace ars
