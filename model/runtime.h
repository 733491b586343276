#pragma once

#include "engine/core/error.h"

#include <string>

namespace ars {

/// What LibTorch is and has, in words and numbers.
struct TorchInfo {
    std::string version;       ///< "2.11.0"
    std::string cpuCapability; ///< instruction set of its CPU kernels: "DEFAULT", "AVX2", "AVX512"
    int threads = 0;           ///< threads that one of its operators uses
    bool mkl = false;          ///< matrix products through MKL
    bool onednn = false;       ///< convolutions through oneDNN
    bool cuda = false;         ///< a CUDA device answers
};

/// Sets LibTorch up once: its operators use threadCount() threads of the pool that parallelFor uses (both run on the
/// same OpenMP), its second pool stays at one. Later calls only report. Throws std::system_error when the system
/// refuses these threads: LibTorch would wait for them for ever.
TorchInfo initializeTorch();

/// Speed of the two operators that everything in model/ stands on, in GFLOP/s, best of `repetitions`.
struct TorchSpeed {
    double convolution = 0;   ///< 3x3, 64 to 64 channels, 128x128, batch 1, float, channels last
    double matrixProduct = 0; ///< 1024 x 1024 x 1024, float
};
TorchSpeed measureTorchSpeed(int repetitions = 30);

} // namespace ars
