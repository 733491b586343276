#pragma once

#include "engine/core/buffer.h"
#include "engine/frame/avatar_evaluator.h"
#include "engine/frame/frame_pipeline.h"

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace ars::parity {

/// Gradients by operator and input ("shade: dL/dnormal"), in host memory.
using Gradients = std::map<std::string, std::vector<float>>;

/// A frame, random dL/d of everything that it shows, and what the processor made of it: all devices take the backward
/// of the same numbers.
class GradientScene {
public:
    /// @param inputs  pose, camera, splatting and posing of the frame; training radii are switched on
    static Result<std::unique_ptr<GradientScene>> create(AvatarEvaluator& avatar, FrameInputs inputs);
    ~GradientScene();

    /// Every backward function on a device. Those that are not there are printed as NOT RUN with their sentence.
    Gradients backward(const Device& device) const;

private:
    struct Data;
    explicit GradientScene(std::unique_ptr<Data> data);
    std::unique_ptr<Data> data_;
};

/// Prints, for each buffer, the largest and the mean difference and how many numbers differ by more than 1e-4, all of
/// the buffer's largest number.
void reportGradients(const std::string& what, const Gradients& expected, const Gradients& found);

} // namespace ars::parity
