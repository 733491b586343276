#pragma once

#include "engine/core/buffer.h"
#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "engine/core/parameters.h"
#include "engine/surfel/gbuffer.h"
#include "engine/surfel/splat_types.h"
#include "engine/surfel/surfels.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

namespace ars {

template <>
struct EnumWords<SurfelKernel> {
    static constexpr std::array words{"gaussian_surfel", "ray_splat"};
};

template <>
struct EnumWords<DepthMode> {
    static constexpr std::array words{"linear", "exact", "filtered"};
};

struct SplatParams {
    SurfelKernel kernel = SurfelKernel::GaussianSurfel;
    DepthMode depth = DepthMode::Linear;
    bool twoSided = false; ///< Gaussian Surfel kernel: surfels seen from behind are turned instead of left out

    bool operator==(const SplatParams&) const = default;
};
const ParameterTable<SplatParams>& splatParameters();

/// "visible", "not_finite"...
std::string_view surfelFateName(SurfelFate fate);

struct SplatStats {
    std::uint64_t surfels = 0;                           ///< given
    std::array<std::uint64_t, kSurfelFateCount> fates{}; ///< how many met which fate; they sum to `surfels`
    std::uint64_t instances = 0;                         ///< pairs of a surfel and a 16x16 tile that it reaches
    std::uint64_t blended = 0;                           ///< pairs of a surfel and a pixel that it was blended into
    std::uint64_t foreground = 0;                        ///< pixels with an opacity above kMinOpacity

    std::uint64_t visible() const { return fates[static_cast<std::size_t>(SurfelFate::Visible)]; }
    std::uint64_t of(SurfelFate fate) const { return fates[static_cast<std::size_t>(fate)]; }
};

/// Surfels of each pixel: p (row-major) holds entries [starts[p], starts[p + 1]), front to back, w = alpha T; they sum
/// to its opacity. CUDA may end a pixel's with entries of weight 0, whose surfel is the count of surfels: to pass over.
struct ContributorLists {
    Buffer starts;             ///< (pixels + 1) u64
    Buffer surfels;            ///< (entries) u32, index into the surfels given
    Buffer weights;            ///< (entries) f32
    std::uint64_t entries = 0; ///< the buffers may be larger
};

/// Instruction sets of the CPU path, for tests and benchmarks.
enum class CpuPath { Best, Portable, Avx2, Avx512 };
/// Those that this build and this processor have; Portable always is.
std::vector<CpuPath> availableCpuPaths();

/// Memory that splatting keeps between frames. One frame at a time. Moves, never copies.
class SplatWorkspace {
public:
    SplatWorkspace();
    ~SplatWorkspace();
    SplatWorkspace(SplatWorkspace&&) noexcept;
    SplatWorkspace& operator=(SplatWorkspace&&) noexcept;

    /// Gives all memory back.
    void clear();
    /// A path that is not available falls back to the next simpler one.
    void setCpuPath(CpuPath path);
    /// CUDA without statistics or contributors never waits for the device, so the memory for surfel-tile pairs may turn
    /// out too small for a frame; that frame then lacks its farthest surfels. True once the device has finished a frame
    /// of which that holds; the next frame has room. Always false on the host.
    bool incomplete() const;

    struct Memory; // engine/surfel/splat_kernels.h
    Memory& memory() { return *memory_; }

private:
    std::unique_ptr<Memory> memory_;
};

/// Splats surfels front to back into every channel that is asked for (rendering reference 1.2 to 1.4, 1.9).
///
/// Pixel (row i, column j) is centred at (j + 0.5, i + 0.5). Surfels are blended in the order of the camera depth of
/// their means, equal depths in the order of their indices: alpha = min(0.99, opacity G), left out below 1/255, and a
/// pixel ends before its transmittance would fall below 1e-4. Opacity is 1 - T, summed as the weights; the other
/// channels are as described at Channel. Position is the camera ray at Depth, brought to world space: the same as
/// blending each surfel's own point on the pixel's ray, because all these points share that ray. Surfels that are not
/// finite, degenerate, transparent, too near, or (by kernel) seen from behind are left out and counted. The result does
/// not depend on the number of threads.
///
/// @param surfels  host or CUDA arrays; the pictures are made on the same device. None at all gives empty pictures.
/// @param camera   its width and height are the pictures'
/// @param channels Opacity is always written
/// @param gbuffer  pictures are reused where size and device fit; channels not asked for are released. After a failure
///                 it has no channels.
/// @param contributors optional, receives the lists
/// @param stats    optional. On CUDA, asking for either waits for the device; otherwise the work is only queued on the
///                 default stream.
/// @return InvalidArgument for an unsound camera, a missing required array, or a channel whose attribute is null
///         (named); LimitExceeded above 2^31 - 1 surfels; OutOfMemory naming the part; Unavailable without CUDA
///         kernels.
Status splat(const SplatParams& params, const SurfelView& surfels, const Camera& camera, ChannelSet channels,
             GBuffer& gbuffer, SplatWorkspace& workspace, ContributorLists* contributors = nullptr,
             SplatStats* stats = nullptr);

} // namespace ars
