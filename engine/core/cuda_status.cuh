#pragma once

#include "engine/core/error.h"

#include <cuda_runtime.h>

#include <string>
#include <string_view>

/// What calls of the CUDA runtime answer, in the program's words; for .cu files alone.
namespace ars::cuda {

/// A failed call also leaves its error behind, for whoever asks cudaGetLastError() next: the launch after it, which did
/// nothing wrong. It is taken away here.
/// @return OutOfMemory where memory ran out, otherwise Unavailable: "PLACE: WHAT: what CUDA says"
inline Status statusOf(cudaError_t code, std::string_view place, std::string_view what = "the CUDA device refused") {
    if (code == cudaSuccess) return {};
    (void)cudaGetLastError();
    const ErrorCode kind = code == cudaErrorMemoryAllocation ? ErrorCode::OutOfMemory : ErrorCode::Unavailable;
    return makeError(kind, std::string(place), fmt::format("{}: {}", what, cudaGetErrorString(code)));
}

/// Whether the device has come past the event. "Not yet" counts as an error to the runtime, and is taken away, too.
inline bool isFinished(cudaEvent_t event) {
    if (cudaEventQuery(event) == cudaSuccess) return true;
    (void)cudaGetLastError();
    return false;
}

} // namespace ars::cuda
