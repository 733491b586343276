#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/core/parameters.h"

#include <array>
#include <cstdint>

namespace ars {

/// How linear radiance becomes display light.
enum class ToneCurve {
    None, ///< clamp to [0, 1]; the one in which pictures are compared
    Aces, ///< Hill's fit of the ACES reference and output transforms
    Agx,  ///< Wrensch's polynomial fit of Sobotka's AgX
};
template <>
struct EnumWords<ToneCurve> {
    static constexpr std::array<std::string_view, 3> words{"none", "aces", "agx"};
};

struct ToneParams {
    float exposureEv = 0.0f; ///< stops before the curve
    ToneCurve curve = ToneCurve::None;
    bool transparent = false; ///< keep alpha (straight) instead of composing over the background
    float backgroundRed = 0.0f, backgroundGreen = 0.0f, backgroundBlue = 0.0f; ///< display-linear, [0, 1]

    bool operator==(const ToneParams&) const = default;
};
const ParameterTable<ToneParams>& toneParameters();

/// Linear premultiplied RGBA to display RGBA, sRGB-encoded.
///
/// Exposure and curve act on the colour of the surface (divided by alpha); the result is composed over the background
/// in display-linear light and encoded, so the background keeps the colour it was given whatever the exposure. Without
/// curve and exposure that equals composing first. Opaque output has alpha 1; transparent output is straight. Numbers
/// that are not finite count as 0 (infinite radiance as the largest).
/// @param linear   4 channels, or 3 (taken as opaque)
/// @param display  4 channels of the same size, [0, 1]
/// @return InvalidArgument naming what differs.
Status toneMap(const Device& device, const ToneParams& params, ImageView<const float> linear, ImageView<float> display);
/// 8-bit: round(255 x).
Status toneMap(const Device& device, const ToneParams& params, ImageView<const float> linear,
               ImageView<std::uint8_t> display);

} // namespace ars
