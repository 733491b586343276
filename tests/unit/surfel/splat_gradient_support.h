#pragma once

#include "engine/surfel/splat_gradient.h"
#include "engine/surfel/splat_gradient_entries.h"
#include "tests/unit/surfel/splat_support.h"

#include <functional>
#include <numeric>
#include <string>
#include <vector>

namespace ars::test {

/// A splat and dL/d of its pictures, in host memory.
struct BackwardCase {
    SplatParams params;
    const Surfels& surfels;
    Camera camera;
    ChannelSet channels;        ///< that are splatted
    GBufferGradients gradients; ///< host memory
    SplatBackwardParams options;
};

// --- CUDA's pass in plain loops --------------------------------------------------------------------------------------

/// What one warp does: its lanes' sums meet as __shfl_xor_sync lets them meet.
template <SurfelKernel Kernel, DepthMode Depth, int Stride>
void emulateWarp(const EntryPass& p, std::size_t surfel) {
    const std::uint64_t begin = firstEntryOf(p, surfel), end = firstEntryOf(p, surfel + 1);
    if (begin == end) return;
    std::array<EntrySums<Stride>, kEntryLanes> lanes;
    for (std::size_t lane = 0; lane < lanes.size(); ++lane) {
        lanes[lane] = sumEntries<Kernel, Depth, Stride>(p, p.rows[surfel], begin + lane, end, kEntryLanes);
    }
    for (std::size_t offset = kEntryLanes / 2; offset > 0; offset /= 2) {
        const auto before = lanes;
        for (std::size_t lane = 0; lane < lanes.size(); ++lane) {
            for (int c = 0; c < EntrySums<Stride>::kCount; ++c) {
                lanes[lane].values[c] += before[lane ^ offset].values[c];
            }
        }
    }
    finishEntries(p, surfel, lanes[0]);
}

template <SurfelKernel Kernel, DepthMode Depth>
void emulateWarps(const EntryPass& p) {
    for (std::size_t surfel = 0; surfel < p.surfels.count; ++surfel) {
        switch (p.pictures.stride()) {
        case 0:
            emulateWarp<Kernel, Depth, 0>(p, surfel);
            break;
        case 4:
            emulateWarp<Kernel, Depth, 4>(p, surfel);
            break;
        case 12:
            emulateWarp<Kernel, Depth, 12>(p, surfel);
            break;
        case 20:
            emulateWarp<Kernel, Depth, 20>(p, surfel);
            break;
        default:
            FAIL() << "no test has " << p.pictures.stride() << " features";
        }
    }
}

/// The pass of splat_gradient_cuda.cu with every thread's part run one after another.
template <SurfelKernel Kernel, DepthMode Depth>
void emulateCuda(EntryPass p) {
    const auto entries = static_cast<std::size_t>(p.entryCount);
    const auto stride = static_cast<std::size_t>(p.pictures.stride());
    std::vector<ProjectedSurfel<float>> rows(p.surfels.count);
    std::vector<float> features(p.surfels.count * stride), pixels(p.pixels * (stride + 2)), alphas(entries);
    std::vector<std::uint32_t> entryPixels(entries), numbers(entries), sortedSurfels(entries);
    p.rows = rows.data();
    p.features = features.data();
    p.pixelGradients = pixels.data();
    p.alphaGradients = alphas.data();
    p.entryPixels = entryPixels.data();
    p.entries = numbers.data();
    for (std::size_t i = 0; i < p.surfels.count; ++i) projectForEntries(p, i);
    for (std::size_t i = 0; i < p.pixels; ++i) backwardPixel<Kernel, Depth>(p, i);
    std::vector<std::uint32_t> sorted = numbers;
    std::stable_sort(sorted.begin(), sorted.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return p.listed[a] < p.listed[b]; });
    for (std::size_t k = 0; k < entries; ++k) sortedSurfels[k] = p.listed[sorted[k]];
    p.sortedEntries = sorted.data();
    p.sortedSurfels = sortedSurfels.data();
    emulateWarps<Kernel, Depth>(p);
}

inline Status emulatedBackward(const BackwardCase& c, SurfelGradients& out) {
    GBuffer gbuffer;
    SplatWorkspace workspace;
    ContributorLists lists;
    ARS_TRY_STATUS(splat(c.params, viewOf(c.surfels), c.camera, c.channels, gbuffer, workspace, &lists));
    SplatGradientWorkspace memory;
    ARS_TRY(const SplatBackwardArguments arguments, backwardArguments(c.params, viewOf(c.surfels), c.camera, gbuffer,
                                                                      &lists, c.gradients, memory, out, c.options));
    EntryPass pass = entryPass(arguments);
    pass.out = arguments.out;
    if (c.params.kernel == SurfelKernel::RaySplat) {
        emulateCuda<SurfelKernel::RaySplat, DepthMode::Exact>(pass);
    } else if (c.params.depth == DepthMode::Exact) {
        emulateCuda<SurfelKernel::GaussianSurfel, DepthMode::Exact>(pass);
    } else {
        emulateCuda<SurfelKernel::GaussianSurfel, DepthMode::Linear>(pass);
    }
    return {};
}

// --- everything that can pass back -----------------------------------------------------------------------------------

/// Forward and backward on one device, with copies of the gradients there.
inline Status backwardOn(const Device& device, CpuPath path, const BackwardCase& c, SurfelGradients& out) {
    const DeviceSurfels there(c.surfels, device);
    GBuffer gbuffer;
    SplatWorkspace workspace;
    workspace.setCpuPath(path);
    ContributorLists lists;
    const bool listed = device.kind == DeviceKind::Cuda;
    ARS_TRY_STATUS(splat(c.params, there.view(), c.camera, c.channels, gbuffer, workspace, listed ? &lists : nullptr));
    std::vector<Buffer> copies;
    GBufferGradients gradients = c.gradients;
    for (ImageView<const float>& picture : gradients.pictures) {
        if (picture.empty() || device.kind == DeviceKind::Host) continue;
        ARS_TRY(Buffer copy, Buffer::allocate(device, picture.valueCount() * sizeof(float), "test: gradients"));
        ARS_TRY_STATUS(uploadBuffer(copy, std::as_bytes(std::span(picture.data, picture.valueCount()))));
        copies.push_back(std::move(copy));
        picture.data = static_cast<const float*>(copies.back().data());
    }
    SplatGradientWorkspace memory;
    memory.tiles.setCpuPath(path);
    return splatBackward(c.params, there.view(), c.camera, gbuffer, listed ? &lists : nullptr, gradients, memory, out,
                         c.options);
}

struct Backward {
    std::string name;
    std::function<Status(const BackwardCase&, SurfelGradients&)> run;
};

/// Every device, every instruction set, and CUDA's pass in plain loops.
inline std::vector<Backward> backwards() {
    std::vector<Backward> result{{"CUDA in plain loops", emulatedBackward}};
    for (const Device& device : devicesUnderTest()) {
        if (device.kind == DeviceKind::Host) {
            for (const CpuPath path : availableCpuPaths()) {
                result.push_back({pathName(path), [=](const BackwardCase& c, SurfelGradients& out) {
                                      return backwardOn(device, path, c, out);
                                  }});
            }
        } else {
            result.push_back({deviceName(device), [=](const BackwardCase& c, SurfelGradients& out) {
                                  return backwardOn(device, CpuPath::Best, c, out);
                              }});
        }
    }
    return result;
}

} // namespace ars::test
