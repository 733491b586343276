#include "engine/gl/device_texture.h"

#ifdef ARS_HAVE_CUDA
#include "engine/gl/device_texture_cuda.h"
#endif

namespace ars {

DeviceTexture::DeviceTexture(const GlContextInfo& context, bool allowInterop)
    : cudaDevice_(context.cudaDevice), interop_(allowInterop) {
    if (!allowInterop) note_ = "sharing pictures with OpenGL is switched off";
}

DeviceTexture::~DeviceTexture() { unregister(); }

void DeviceTexture::unregister() {
#ifdef ARS_HAVE_CUDA
    if (resource_) cuda::unregisterTexture(resource_);
#endif
    resource_ = nullptr;
    registered_ = 0;
}

Status DeviceTexture::show(ImageView<const float> picture, const Device& device) {
    if (picture.empty() || (picture.channels != 1 && picture.channels != 3 && picture.channels != 4)) {
        return makeError(ErrorCode::InvalidArgument, "texture",
                         fmt::format("a picture of {} channels, expected 1, 3 or 4", picture.channels));
    }
    if (device.kind == DeviceKind::Cuda && interop_) {
        // Windows do not say which card they are on; registering a texture of another card fails and says so.
        const bool same = !cudaDevice_ || *cudaDevice_ == device.index;
        const Status shared = same ? share(picture, device)
                                   : makeError(ErrorCode::Unavailable, "CUDA with OpenGL",
                                               fmt::format("the window is drawn by cuda:{}, the picture lies on {}",
                                                           *cudaDevice_, deviceName(device)));
        if (shared.ok()) return {};
        interop_ = false;
        note_ = shared.error().describe();
        unregister();
    }
    return copy(picture, device);
}

Status DeviceTexture::share(ImageView<const float> picture, const Device& device) {
#ifdef ARS_HAVE_CUDA
    // The storage may be replaced: a texture must not be registered while that happens.
    const bool single = picture.channels == 1;
    if (texture_.width() != picture.width || texture_.height() != picture.height || single != registeredSingle_) {
        unregister();
    }
    texture_.reserve(picture.width, picture.height, picture.channels);
    if (registered_ != texture_.name()) {
        unregister();
        ARS_TRY(resource_, cuda::registerTexture(device.index, texture_.name()));
        registered_ = texture_.name();
        registeredSingle_ = single;
    }
    ARS_TRY_STATUS(cuda::writeTexture(device.index, resource_, picture));
    path_ = Path::Interop;
    return {};
#else
    (void)picture;
    return makeError(ErrorCode::Unavailable, "CUDA with OpenGL",
                     fmt::format("this build has no CUDA, the picture lies on {}", deviceName(device)));
#endif
}

Status DeviceTexture::copy(ImageView<const float> picture, const Device& device) {
    if (device.kind == DeviceKind::Cuda) {
#ifdef ARS_HAVE_CUDA
        host_.resize(picture.valueCount());
        ARS_TRY_STATUS(cuda::download(device.index, host_.data(), picture.data, host_.size() * sizeof(float)));
        picture.data = host_.data();
#else
        return makeError(ErrorCode::Unavailable, "texture",
                         fmt::format("this build has no CUDA, the picture lies on {}", deviceName(device)));
#endif
    }
    if (picture.channels == 3) {
        // The same format as the shared way has, so that whoever samples it need not ask how it came.
        expanded_.resize(4 * picture.pixelCount());
        for (std::size_t p = 0; p < picture.pixelCount(); ++p) {
            for (std::size_t c = 0; c < 3; ++c) expanded_[4 * p + c] = picture.data[3 * p + c];
            expanded_[4 * p + 3] = 1.0f;
        }
        picture = {expanded_.data(), picture.width, picture.height, 4};
    }
    texture_.upload(picture, true);
    path_ = Path::Copy;
    return {};
}

} // namespace ars
