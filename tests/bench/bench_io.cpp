#include "engine/io/npz.h"
#include "engine/io/safetensors.h"

#include <benchmark/benchmark.h>

#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>

namespace ars {
namespace {

constexpr std::size_t kFloats = 5'000'000; // 20 MB

/// Normal deviates: mantissas that deflate cannot shorten much, as in real meshes and weights.
Array noise() {
    std::mt19937 random(7);
    std::normal_distribution<float> normal;
    std::vector<float> values(kFloats);
    for (float& value : values) value = normal(random);
    return Array::fromFloats({kFloats / 5, 5}, values);
}

/// Numbers with few digits, which deflate to about a third.
Array rounded() {
    Array array = noise();
    for (float& value : array.as<float>()) value = std::round(value * 100.0f) / 100.0f;
    return array;
}

/// A file for the length of one benchmark.
class BenchFile {
public:
    explicit BenchFile(const std::string& name)
        : path_(std::filesystem::temp_directory_path() / (std::to_string(::getpid()) + name)) {}
    ~BenchFile() {
        std::error_code ignored;
        std::filesystem::remove(path_, ignored);
    }
    const std::filesystem::path& path() const { return path_; }

private:
    std::filesystem::path path_;
};

void report(benchmark::State& state, const std::filesystem::path& path) {
    state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * kFloats * sizeof(float));
    state.counters["file_MB"] = static_cast<double>(std::filesystem::file_size(path)) / 1e6;
}

void openNpz(benchmark::State& state, const NamedArrays& arrays, bool compress) {
    const BenchFile file("bench.npz");
    if (!writeNpz(file.path(), arrays, compress)) return state.SkipWithError("cannot write");
    for (auto _ : state) {
        const auto read = readNpz(file.path());
        if (!read) return state.SkipWithError(read.error().describe().c_str());
        benchmark::DoNotOptimize(read->arrays.begin()->second.bytes.data());
    }
    report(state, file.path());
}

void BM_OpenNpz20MBStored(benchmark::State& state) { openNpz(state, {{"a", noise()}}, false); }
void BM_OpenNpz20MBDeflatedNoise(benchmark::State& state) { openNpz(state, {{"a", noise()}}, true); }
void BM_OpenNpz20MBDeflatedRounded(benchmark::State& state) { openNpz(state, {{"a", rounded()}}, true); }
BENCHMARK(BM_OpenNpz20MBStored)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();
BENCHMARK(BM_OpenNpz20MBDeflatedNoise)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();
BENCHMARK(BM_OpenNpz20MBDeflatedRounded)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();

void BM_OpenNpz20MBDeflatedFourMembers(benchmark::State& state) {
    Array quarter = noise();
    quarter.shape = {kFloats / 4};
    quarter.bytes.resize(quarter.bytes.size() / 4);
    openNpz(state, {{"a", quarter}, {"b", quarter}, {"c", quarter}, {"d", quarter}}, true);
}
BENCHMARK(BM_OpenNpz20MBDeflatedFourMembers)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();

void BM_ListNpz20MB(benchmark::State& state) {
    const BenchFile file("bench.npz");
    if (!writeNpz(file.path(), {{"a", noise()}}, false)) return state.SkipWithError("cannot write");
    for (auto _ : state) {
        const auto entries = listNpz(file.path());
        if (!entries) return state.SkipWithError(entries.error().describe().c_str());
        benchmark::DoNotOptimize(entries->data());
    }
}
BENCHMARK(BM_ListNpz20MB)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();

void BM_OpenFortranNpy20MB(benchmark::State& state) {
    std::vector<std::byte> bytes = *encodeNpy(noise());
    // The same bytes said to be in Fortran order; one letter fewer is one space more.
    std::string text(reinterpret_cast<const char*>(bytes.data()), 128);
    text.replace(text.find("False"), 5, "True ");
    for (std::size_t i = 0; i < text.size(); ++i) bytes[i] = static_cast<std::byte>(text[i]);
    for (auto _ : state) {
        const auto array = parseNpy(bytes);
        if (!array) return state.SkipWithError(array.error().describe().c_str());
        benchmark::DoNotOptimize(array->bytes.data());
    }
}
BENCHMARK(BM_OpenFortranNpy20MB)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();

void BM_OpenSafetensors20MB(benchmark::State& state) {
    const BenchFile path("bench.safetensors");
    SafetensorsFile file;
    file.tensors.emplace("a", noise());
    if (!writeSafetensors(path.path(), file)) return state.SkipWithError("cannot write");
    for (auto _ : state) {
        const auto read = readSafetensors(path.path());
        if (!read) return state.SkipWithError(read.error().describe().c_str());
        benchmark::DoNotOptimize(read->tensors.begin()->second.bytes.data());
    }
    report(state, path.path());
}
BENCHMARK(BM_OpenSafetensors20MB)->Unit(benchmark::kMillisecond)->UseRealTime()->MeasureProcessCPUTime();

void BM_WriteNpz20MB(benchmark::State& state) {
    const BenchFile file("bench.npz");
    const NamedArrays arrays = {{"a", noise()}};
    for (auto _ : state) {
        if (!writeNpz(file.path(), arrays, state.range(0) != 0)) return state.SkipWithError("cannot write");
    }
    report(state, file.path());
}
BENCHMARK(BM_WriteNpz20MB)
    ->ArgName("deflate")
    ->Arg(0)
    ->Arg(1)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime()
    ->MeasureProcessCPUTime();

} // namespace
} // namespace ars
