#pragma once

#include "engine/core/buffer.h"
#include "engine/core/error.h"
#include "engine/core/host_device.h"

#include <cstddef>
#include <string_view>
#include <type_traits>

namespace ars {

/// A picture somewhere in memory that is not owned: row-major, channels interleaved, row 0 on top, no padding.
/// It does not know its device; functions that take several views say that all lie on one.
template <typename T>
struct ImageView {
    T* data = nullptr;
    int width = 0;
    int height = 0;
    int channels = 1;

    ARS_HD std::size_t pixelCount() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
    ARS_HD std::size_t valueCount() const { return pixelCount() * static_cast<std::size_t>(channels); }
    ARS_HD bool empty() const { return data == nullptr; }
    /// Value by its place in memory; of one-channel pictures: the pixel.
    ARS_HD T& operator[](std::size_t index) const { return data[index]; }
    ARS_HD T* pixel(std::size_t index) const { return data + index * static_cast<std::size_t>(channels); }
    ARS_HD T* at(int row, int column) const {
        return data +
               (static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)) *
                   static_cast<std::size_t>(channels);
    }
    /// A view that only reads.
    ARS_HD operator ImageView<const T>() const
        requires(!std::is_const_v<T>)
    {
        return {data, width, height, channels};
    }
};

/// A float picture that owns its memory, on any device. Contents are uninitialised. Moves, never copies.
class PixelBuffer {
public:
    PixelBuffer() = default;
    /// InvalidArgument for sides or channels that are not positive or a side beyond 32,768; OutOfMemory as Buffer.
    static Result<PixelBuffer> allocate(const Device& device, int width, int height, int channels,
                                        std::string_view owner);
    /// Makes it this size; keeps the memory where the size and device are the same already. On failure it is empty.
    Status reshape(const Device& device, int width, int height, int channels, std::string_view owner);

    ImageView<float> view() { return {static_cast<float*>(memory_.data()), width_, height_, channels_}; }
    ImageView<const float> view() const {
        return {static_cast<const float*>(memory_.data()), width_, height_, channels_};
    }
    int width() const { return width_; }
    int height() const { return height_; }
    int channels() const { return channels_; }
    bool empty() const { return memory_.data() == nullptr; }
    const Device& device() const { return memory_.device(); }
    Buffer& memory() { return memory_; }
    const Buffer& memory() const { return memory_; }

private:
    Buffer memory_;
    int width_ = 0;
    int height_ = 0;
    int channels_ = 0;
};

} // namespace ars
