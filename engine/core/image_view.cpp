#include "engine/core/image_view.h"

#include <fmt/format.h>

namespace ars {

namespace {
constexpr int kMaxSide = 32768;
}

Result<PixelBuffer> PixelBuffer::allocate(const Device& device, int width, int height, int channels,
                                          std::string_view owner) {
    if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide || channels < 1) {
        return makeError(ErrorCode::InvalidArgument, std::string(owner),
                         fmt::format("a picture of {}x{} pixels with {} channels; sides must be 1 to {}", width, height,
                                     channels, kMaxSide));
    }
    PixelBuffer result;
    const std::size_t values =
        static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * static_cast<std::size_t>(channels);
    ARS_TRY(result.memory_, Buffer::allocate(device, values * sizeof(float), owner));
    result.width_ = width;
    result.height_ = height;
    result.channels_ = channels;
    return result;
}

Status PixelBuffer::reshape(const Device& device, int width, int height, int channels, std::string_view owner) {
    if (!empty() && memory_.device() == device && width_ == width && height_ == height && channels_ == channels) {
        return {};
    }
    *this = PixelBuffer(); // the old memory goes first: both need not fit at once
    ARS_TRY(*this, allocate(device, width, height, channels, owner));
    return {};
}

} // namespace ars
