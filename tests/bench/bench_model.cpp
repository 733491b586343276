// Speed of LibTorch's own operators: proves that its fast kernels and all cores are in use. Floor: the processor's
// fused multiply-adds (two Zen 4 cores: about 224 GFLOP/s).
#include "model/runtime.h"

#include <benchmark/benchmark.h>

namespace {

void torchOperators(benchmark::State& state) {
    ars::TorchSpeed best;
    for (auto _ : state) {
        const ars::TorchSpeed speed = ars::measureTorchSpeed(20);
        best.convolution = std::max(best.convolution, speed.convolution);
        best.matrixProduct = std::max(best.matrixProduct, speed.matrixProduct);
    }
    state.counters["conv3x3_64ch_128_GFLOPs"] = best.convolution;
    state.counters["mm1024_GFLOPs"] = best.matrixProduct;
}
BENCHMARK(torchOperators)->Unit(benchmark::kMillisecond)->Iterations(5);

} // namespace
