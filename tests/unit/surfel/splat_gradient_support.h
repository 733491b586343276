#pragma once

#include "engine/surfel/splat_gradient.h"
#include "engine/surfel/splat_gradient_entries.h"
#include "tests/unit/surfel/splat_support.h"

#include <functional>
#include <limits>
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
    // What nothing is written to holds no numbers, and neither does the row behind the last surfel's.
    std::vector<ProjectedSurfel<float>> rows(p.surfels.count + 1);
    std::vector<float> features((p.surfels.count + 1) * stride, std::numeric_limits<float>::quiet_NaN());
    std::vector<float> pixels(p.pixels * (stride + 2)), alphas(entries);
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

/// @param change  what becomes of the lists between the passes
inline Status emulatedBackward(const BackwardCase& c, SurfelGradients& out,
                               const std::function<void(ContributorLists&)>& change = {}) {
    GBuffer gbuffer;
    SplatWorkspace workspace;
    ContributorLists lists;
    ARS_TRY_STATUS(splat(c.params, viewOf(c.surfels), c.camera, c.channels, gbuffer, workspace, &lists));
    if (change) change(lists);
    SplatGradientWorkspace memory;
    ARS_TRY(const SplatBackwardArguments arguments, backwardArguments(c.params, viewOf(c.surfels), c.camera, gbuffer,
                                                                      &lists, c.gradients, memory, {}, c.options));
    EntryPass pass = entryPass(arguments);
    pass.out = prepareOutputs(c.surfels.count(), c.gradients, out);
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

/// Forward and backward on one device, with copies of the gradients there; results to vectors or to arrays there.
template <typename Out>
Status backwardOn(const Device& device, CpuPath path, const BackwardCase& c, Out& out) {
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

/// Backward to arrays on the device, brought to the host.
inline Status backwardToArrays(const Device& device, const BackwardCase& c, SurfelGradients& out) {
    const SurfelGradientArrays host = prepareOutputs(c.surfels.count(), c.gradients, out);
    SurfelGradientArrays there;
    struct Copy {
        Buffer buffer;
        float* to;
        std::size_t floats;
    };
    std::vector<Copy> copies;
    const auto add = [&](float* to, std::size_t width, float*& array) -> Status {
        if (!to) return {};
        const std::vector<float> zeros(c.surfels.count() * width, 0.0f);
        ARS_TRY(Buffer buffer, Buffer::allocate(device, zeros.size() * sizeof(float), "test: results"));
        ARS_TRY_STATUS(uploadBuffer(buffer, std::as_bytes(std::span(zeros))));
        array = static_cast<float*>(buffer.data());
        copies.push_back({std::move(buffer), to, zeros.size()});
        return {};
    };
    ARS_TRY_STATUS(add(host.means, 3, there.means));
    ARS_TRY_STATUS(add(host.rotations, 4, there.rotations));
    ARS_TRY_STATUS(add(host.scales, 2, there.scales));
    ARS_TRY_STATUS(add(host.opacities, 1, there.opacities));
    for (int i = 0; i < kChannelCount; ++i) {
        const auto width = static_cast<std::size_t>(channelWidth(static_cast<Channel>(i)));
        ARS_TRY_STATUS(add(host.attributes[i], width, there.attributes[i]));
    }
    ARS_TRY_STATUS(backwardOn(device, CpuPath::Best, c, there));
    for (Copy& copy : copies) {
        ARS_TRY_STATUS(downloadBuffer(std::as_writable_bytes(std::span(copy.to, copy.floats)), copy.buffer));
    }
    return {};
}

struct Backward {
    std::string name;
    std::function<Status(const BackwardCase&, SurfelGradients&)> run;
};

/// Every device, every instruction set, and CUDA's pass in plain loops.
inline std::vector<Backward> backwards() {
    std::vector<Backward> result{
        {"CUDA in plain loops", [](const BackwardCase& c, SurfelGradients& out) { return emulatedBackward(c, out); }}};
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
