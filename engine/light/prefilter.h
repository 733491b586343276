#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/light/cube_map.h"
#include "engine/light/environment.h"
#include "engine/light/light_math.h"

#include <array>
#include <memory>
#include <string_view>

namespace ars {

/// What a prefiltered light is good for; the studio says which one is shown.
enum class LightQuality {
    Draft, ///< every level at half its side (not below 16): a swap within a frame or two; a few percent off
           ///< (docs/math/light.md)
    Exact, ///< the paper's sides
};
/// "draft", "exact".
std::string_view lightQualityName(LightQuality quality);

struct PrefilterParams {
    LightQuality quality = LightQuality::Exact;
    TexelArea area = TexelArea::Exact;
};

/// Sides of the base that can be filtered: powers of two in [64, 4096]. The paper's is 512.
inline constexpr int kSmallestLightBase = 64;
inline constexpr int kDefaultLightBase = 512;

/// Levels of a base: 512 has 6 (512, 256, ... 16).
int lightLevelCount(int baseSize);

/// A light filtered for split-sum shading (nvdiffrec's scheme; docs/math/light.md): specular levels with roughness
/// levelRoughness(l), each filtered from the base averaged down to that level's side, and the irradiance / pi of 16x16.
/// All memory lies on one device. Moves, never copies.
struct PrefilteredLight {
    std::array<PixelBuffer, kMaxLightLevels> specular; ///< each N wide, 6 N high, 3 channels
    int levels = 0;
    PixelBuffer diffuse; ///< 16 wide, 96 high, 3 channels
    std::shared_ptr<const PixelBuffer> lut;
    LightQuality quality = LightQuality::Exact; ///< what it holds, whatever was asked for
    int baseSize = 0;

    /// Averages of the base, side baseSize >> k, kept to save their allocation; [0] is the copy of a base from host
    /// memory.
    std::array<PixelBuffer, kMaxLightLevels> pooled;

    bool empty() const { return levels == 0; }
    const Device& device() const { return diffuse.device(); }
    /// For kernels of device(); valid while this lives and is not filtered again.
    LightView<float> view(const EnvironmentPlacement& placement = {}) const;
};

/// Filters a base cube, linear in it. CUDA devices always give Exact (it takes them no longer than a draft).
///
/// @param device  where base lies and light will lie; work on CUDA is queued on the default stream
/// @param base    (6, N, N, 3) as a picture N wide and 6 N high; numbers must be finite
/// @param light   its memory is used again where the sizes fit; undefined contents after a failure
/// @return InvalidArgument naming the side; OutOfMemory; Unavailable.
Status prefilterLight(const Device& device, ImageView<const float> base, const PrefilterParams& params,
                      PrefilteredLight& light);

/// The same from a cube in host memory, copied to the device first.
Status prefilterLight(const Device& device, const CubeMap& base, const PrefilterParams& params,
                      PrefilteredLight& light);

/// Cosine of the half-angle of level `roughness`: 99 % of the distribution integrated over the angle lies inside it,
/// and only that is filtered.
double specularCutoffCosine(double roughness);

} // namespace ars
