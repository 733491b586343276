#pragma once

#include "engine/occlusion/ambient_occlusion.h"
#include "tests/support/devices.h"
#include "tests/unit/occlusion/occlusion_scene.h"

#include <span>
#include <utility>
#include <vector>

namespace ars::test {

/// Pictures of a scene in the memory of a device.
class SceneOnDevice {
public:
    SceneOnDevice(const OcclusionScene& scene, const Device& device) : device_(device), camera_(scene.camera) {
        inputs_ = scene.inputs();
        inputs_.device = device;
        if (device.kind == DeviceKind::Host) return;
        for (ImageView<const float>* view :
             {&inputs_.depth, &inputs_.normal, &inputs_.radius, &inputs_.importance, &inputs_.bone, &inputs_.opacity}) {
            if (!view->empty()) *view = upload(*view);
        }
    }
    const OcclusionInputs& inputs() const { return inputs_; }
    ImageView<const float> upload(ImageView<const float> host) {
        if (device_.kind == DeviceKind::Host) return host;
        auto buffer = PixelBuffer::allocate(device_, host.width, host.height, host.channels, "test");
        EXPECT_TRUE(buffer.ok());
        EXPECT_TRUE(uploadBuffer(buffer->memory(), std::as_bytes(std::span(host.data, host.valueCount()))).ok());
        owned_.push_back(std::move(*buffer));
        return std::as_const(owned_.back()).view();
    }
    PixelBuffer output() const {
        auto buffer = PixelBuffer::allocate(device_, camera_.width, camera_.height, 1, "test");
        EXPECT_TRUE(buffer.ok());
        return std::move(*buffer);
    }

private:
    Device device_;
    Camera camera_;
    OcclusionInputs inputs_;
    std::vector<PixelBuffer> owned_;
};

inline std::vector<float> download(const PixelBuffer& picture) {
    std::vector<float> values(picture.view().valueCount());
    EXPECT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(values)), picture.memory()).ok());
    return values;
}

/// O of a scene on a device; fails the test on an error.
inline std::vector<float> occlusionOf(const OcclusionParams& params, const OcclusionScene& scene, const Device& device,
                                      int pass = 0) {
    const SceneOnDevice there(scene, device);
    PixelBuffer out = there.output();
    OcclusionWorkspace workspace;
    const Status status = ambientOcclusion(params, there.inputs(), workspace, out.view(), pass);
    EXPECT_TRUE(status.ok()) << status.error().describe();
    return download(out);
}

} // namespace ars::test
