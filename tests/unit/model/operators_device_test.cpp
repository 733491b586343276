// The chain of operators and whole trainings on every device: on the host against itself, which shows that nothing
// depends on where the skinning weights were made; on CUDA, where there is one, against the host.
#include "model/device.h"
#include "model/operators/skin_tensors.h"
#include "model/training/placement.h"
#include "tests/unit/model/operators_support.h"

#include <cstdio>

namespace ars {
namespace {

using test::NineParts;

/// Devices on which operators can be run here; says NOT RUN for CUDA where it cannot.
std::vector<c10::Device> torchDevicesUnderTest() {
    std::vector<c10::Device> devices{c10::kCPU};
    if (const auto device = trainingDevice(RunDevice::Cuda)) {
        devices.push_back(torchDevice(*device));
    } else {
        const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
        std::printf("NOT RUN: %s.%s on CUDA: %s\n", info->test_suite_name(), info->name(),
                    device.error().describe().c_str());
        std::fflush(stdout);
    }
    return devices;
}

/// The picture and the gradients of everything that it is differentiable in, in host memory.
std::vector<at::Tensor> pass(const c10::Device& device, bool keepSkin) {
    NineParts scene(0.3f);
    SurfelTensors& s = scene.canonical;
    std::vector<at::Tensor> leaves;
    for (at::Tensor* tensor : {&s.means, &s.rotations, &s.scales, &s.opacities, &s.albedos, &s.roughnesses}) {
        leaves.push_back(*tensor = tensor->to(device).detach().clone().requires_grad_(true));
    }
    scene.initialRadii = scene.initialRadii.to(device);
    const at::Tensor texels = scene.texels.to(device).detach().clone().requires_grad_(true);
    const at::Tensor offsets = at::zeros({9}, texels.options()).requires_grad_(true);
    leaves.push_back(texels);
    leaves.push_back(offsets);
    const at::Tensor radii = scene.initialRadii * (1.0f + offsets);
    const SurfelTensors live =
        keepSkin ? poseSurfelTensors(scene.context, skinTensors(*scene.context->weights, device), s, radii)
                 : poseSurfelTensors(scene.context, s, radii);
    GBufferTensors gbuffer = splatTensors({}, live, scene.camera, NineParts::channels(), scene.pool);
    const at::Tensor open = occlusionTensor(scene.occlusion, gbuffer, scene.camera, scene.workspace, 3);
    const at::Tensor picture =
        toneTensor(scene.tone, shadeTensors({}, gbuffer, open, scene.camera, lightTensors(texels)));
    EXPECT_EQ(picture.device(), device);
    (picture * test::randomNumbers(picture.sizes(), 71, -1.0f, 1.0f).to(device)).sum().backward();
    std::vector<at::Tensor> results{picture.detach().cpu()};
    for (const at::Tensor& one : leaves) {
        EXPECT_EQ(one.grad().device(), device);
        results.push_back(one.grad().cpu());
    }
    return results;
}

TEST(OperatorDevices, TheWholeChainPassesTheSameThereAndBack) {
    const std::vector<at::Tensor> expected = pass(c10::kCPU, false);
    for (const c10::Device& device : torchDevicesUnderTest()) {
        SCOPED_TRACE(device.str());
        for (const bool keepSkin : {false, true}) {
            const std::vector<at::Tensor> found = pass(device, keepSkin);
            ASSERT_EQ(found.size(), expected.size());
            for (std::size_t i = 0; i < found.size(); ++i) {
                const double size = expected[i].norm().item<double>();
                EXPECT_GT(size, 0.0) << i;
                // Occlusion's directions and the cut-offs of splatting round otherwise on CUDA.
                const double bound = device.is_cpu() ? 0.0 : 5e-3;
                EXPECT_LE((found[i] - expected[i]).norm().item<double>(), bound * size) << i;
            }
        }
    }
}

} // namespace
} // namespace ars
