#include "engine/metrics/flip.h"

#include <benchmark/benchmark.h>

#include <random>
#include <vector>

// 512x512, RGB, on two threads. Nothing waits for these: they run once per evaluated picture.

namespace {

using namespace ars;

struct Pictures {
    std::vector<float> a, b;
    Pictures() : a(512 * 512 * 3), b(a.size()) {
        std::mt19937 random(1);
        std::uniform_real_distribution<float> uniform;
        for (float& v : a) v = uniform(random);
        for (float& v : b) v = uniform(random);
    }
    Picture first() const { return {a.data(), 512, 512, 3}; }
    Picture second() const { return {b.data(), 512, 512, 3}; }
};

const Pictures& pictures() {
    static const Pictures instance;
    return instance;
}

void psnr512(benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(peakSignalToNoise(pictures().first(), pictures().second()));
}
BENCHMARK(psnr512)->Unit(benchmark::kMillisecond)->UseRealTime();

void ssim512(benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(structuralSimilarity(pictures().first(), pictures().second()));
}
BENCHMARK(ssim512)->Unit(benchmark::kMillisecond)->UseRealTime();

void flip512(benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(meanFlip(pictures().first(), pictures().second()));
}
BENCHMARK(flip512)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
