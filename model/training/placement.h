#pragma once

#include "engine/core/buffer.h"
#include "model/training/learned_state.h"

namespace ars {

/// Which devices could train: the engine's kernels and LibTorch's each need one of their own.
struct TrainingDevices {
    bool engine = false; ///< a CUDA device answers this program's kernels
    bool torch = false;  ///< LibTorch has its CUDA kernels and finds a device
};
TrainingDevices trainingDevices();

/// Where a training runs: `auto` is the first CUDA device where both can use it, otherwise the processor.
/// @return Unavailable where CUDA is asked for and one of the two lacks it, saying which
Result<Device> trainingDevice(RunDevice wanted, const TrainingDevices& devices = trainingDevices());

/// Brings everything that steps read and change to the device: networks, base, pixels, light, offsets. Tensors that lie
/// there already stay as they are. To be called before there is an optimiser, whose moments lie beside its tensors.
void placeState(LearnedState& state, const c10::Device& device);

/// The avatar in host memory, for evaluators: itself where it lies there, otherwise with copies of what it learned.
Result<AvatarModel> modelOnHost(const AvatarModel& model);

} // namespace ars
