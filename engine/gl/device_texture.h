#pragma once

#include "engine/core/image_view.h"
#include "engine/gl/context.h"
#include "engine/gl/texture.h"

#include <memory>
#include <vector>

namespace ars {

/// A texture that shows a picture of any device: on the card that the context draws with it is written there, without
/// a way through host memory (CUDA's OpenGL interop); everywhere else it is copied. All calls need the context current
/// in which it was made.
class DeviceTexture {
public:
    enum class Path { None, Interop, Copy }; ///< how the last picture came

    /// @param allowInterop  false: always copies
    explicit DeviceTexture(const GlContextInfo& context, bool allowInterop = true);
    ~DeviceTexture();
    DeviceTexture(const DeviceTexture&) = delete;
    DeviceTexture& operator=(const DeviceTexture&) = delete;

    /// Shows a picture with 1, 3 or 4 channels that lies on `device`; three channels become four, the fourth 1. Work
    /// queued on the device before is waited for by the device (interop) or here (copy). Where interop fails once, the
    /// picture is copied and interop is not tried again; note() says why.
    /// @return InvalidArgument for other channels; errors of the device
    Status show(ImageView<const float> picture, const Device& device);

    const Texture& texture() const { return texture_; }
    Path path() const { return path_; }
    /// One sentence on why pictures are copied; empty where they are not.
    const std::string& note() const { return note_; }

private:
    Status copy(ImageView<const float> picture, const Device& device);
    Status share(ImageView<const float> picture, const Device& device);
    void unregister();

    std::optional<int> cudaDevice_; ///< that shares the context's card
    bool interop_ = false;
    Texture texture_;
    void* resource_ = nullptr;      ///< cudaGraphicsResource of `registered_`
    unsigned registered_ = 0;       ///< name of the texture that is
    bool registeredSingle_ = false; ///< it has one channel
    std::vector<float> host_, expanded_;
    Path path_ = Path::None;
    std::string note_;
};

} // namespace ars
