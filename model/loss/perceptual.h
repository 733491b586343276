#pragma once

#include "engine/core/error.h"
#include "model/tensors.h"

#include <filesystem>
#include <memory>
#include <string>

namespace ars {

/// A loss between pictures (height, width, 3), sRGB-encoded RGB in [0, 1].
class PerceptualLoss {
public:
    virtual ~PerceptualLoss() = default;
    /// "lpips_vgg", "lpips_alex", "ms_ssim_gradient": the name under which a figure of it may be printed.
    virtual std::string name() const = 0;
    /// Puts its weights, where it has any, on the device on which pictures will lie; at first they are in host memory.
    virtual void moveTo(const c10::Device&) {}
    /// Scalar; differentiable in the first picture.
    virtual at::Tensor evaluate(const at::Tensor& picture, const at::Tensor& target) const = 0;
};

/// The documented stand-in for LPIPS: (1 - MS-SSIM) / 2 over as many scales as the picture has room for + mean
/// |gradient difference| (docs/math/losses.md). Needs no weights.
std::unique_ptr<PerceptualLoss> msSsimGradientLoss();

/// LPIPS v0.1 exactly: VGG16 or AlexNet features from the user's files.
/// @param backbone  safetensors or a .pth of torchvision's vgg16 / alexnet state dict (uncompressed zip, no pickled
/// code
///                  is run)
/// @param heads     the linear weights (lin0..lin4), same kinds of file
/// @return BadFile naming the tensor that is missing or has the wrong shape
Result<std::unique_ptr<PerceptualLoss>> readLpips(const std::filesystem::path& backbone,
                                                  const std::filesystem::path& heads);

} // namespace ars
