// Speed of LibTorch's own operators: proves that its fast kernels and all cores are in use. Floor: the processor's
// fused multiply-adds (two Zen 4 cores: about 224 GFLOP/s). Then the networks of preset compact in each of their forms;
// beside them: `tests/parity/network/reference_network.py --time`, the same networks in eager PyTorch.
#include "model/network/inference_network.h"
#include "model/runtime.h"

#include <benchmark/benchmark.h>
#include <torch/torch.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <utility>

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

/// The networks of preset compact and what they see; random numbers take as long as a body.
struct Compact {
    ars::AvatarNetwork network;
    ars::AvatarNetworkInputs inputs;
    at::Tensor pixels; ///< every seventh: about as many as a body has surfels

    static Compact make() {
        (void)ars::initializeTorch();
        ars::AvatarNetworkConfig config; // its defaults are those of the preset
        config.zeroOutputs = false;
        ars::Result<ars::AvatarNetwork> network = ars::AvatarNetwork::create(config, 1);
        torch::manual_seed(1);
        const std::int64_t s = config.inputSize;
        return {std::move(network).value(),
                {torch::randn({2, 3, s, s}), torch::randn({2, 5, s, s}), torch::randn({2, 1, s, s})},
                torch::arange(0, 8 * s * s, 7)};
    }
};

/// Times one call and keeps the best of all iterations: what a loaded machine disturbs least.
template <typename Function>
void measure(benchmark::State& state, Function&& function) {
    function(); // what is made once
    double best = 1e9;
    for (auto _ : state) {
        const auto start = std::chrono::steady_clock::now();
        function();
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    state.counters["threads"] = at::get_num_threads();
    state.counters["best_ms"] = 1e3 * best;
}

void compactForward(benchmark::State& state) {
    const Compact c = Compact::make();
    const at::NoGradGuard noGradients;
    measure(state, [&] { benchmark::DoNotOptimize(c.network.evaluate(c.inputs, c.pixels)); });
}

void compactForwardAndBackward(benchmark::State& state) {
    Compact c = Compact::make();
    measure(state, [&] {
        for (ars::NetworkTensor& entry : c.network.tensors().all()) entry.tensor.mutable_grad() = at::Tensor();
        const ars::RawAttributes raw = c.network.evaluate(c.inputs, c.pixels);
        (raw.offsets.mean() + raw.opacities.mean() + raw.scales.mean() + raw.rotations.mean() + raw.albedos.mean() +
         raw.roughnesses.mean() + raw.colors.mean())
            .backward();
    });
}

void folded(benchmark::State& state, ars::NetworkPrecision precision) {
    const Compact c = Compact::make();
    const at::NoGradGuard noGradients;
    ars::InferenceNetwork network = ars::InferenceNetwork::create(c.network, precision);
    measure(state, [&] { benchmark::DoNotOptimize(network.evaluate(c.inputs, c.pixels)); });
}

void newCamera(benchmark::State& state, ars::NetworkPrecision precision) {
    const Compact c = Compact::make();
    const at::NoGradGuard noGradients;
    ars::InferenceNetwork network = ars::InferenceNetwork::create(c.network, precision);
    (void)network.evaluate(c.inputs, c.pixels);
    measure(state, [&] { benchmark::DoNotOptimize(network.colorsOfLastPose(c.pixels, c.inputs.view)); });
}

void compactFolded(benchmark::State& state) { folded(state, ars::NetworkPrecision::Float32); }
void compactFoldedBFloat16(benchmark::State& state) { folded(state, ars::NetworkPrecision::BFloat16); }
void compactNewCamera(benchmark::State& state) { newCamera(state, ars::NetworkPrecision::Float32); }
void compactNewCameraBFloat16(benchmark::State& state) { newCamera(state, ars::NetworkPrecision::BFloat16); }

#define ARS_NETWORK_BENCH(name) BENCHMARK(name)->Unit(benchmark::kMillisecond)->Iterations(8)->UseRealTime()
ARS_NETWORK_BENCH(compactForward);
ARS_NETWORK_BENCH(compactForwardAndBackward);
ARS_NETWORK_BENCH(compactFolded);
ARS_NETWORK_BENCH(compactFoldedBFloat16);
ARS_NETWORK_BENCH(compactNewCamera);
ARS_NETWORK_BENCH(compactNewCameraBFloat16);

} // namespace
