#pragma once

#include "engine/core/error.h"
#include "engine/core/parameters.h"
#include "engine/maps/canonical_maps.h"
#include "model/network/avatar_network.h"
#include "model/operators/surfel_operators.h"

namespace ars {

/// Where a surfel's scales begin.
enum class InitialScale {
    Footprint, ///< what its map pixel covers of the surface: stretched where the surface turns away from the map's axis
    Neighbours, ///< both the root mean square distance to the three nearest points (Animatable Gaussians)
};
template <>
struct EnumWords<InitialScale> {
    static constexpr std::array words{"footprint", "neighbours"};
};

/// From raw outputs of the networks to canonical surfels (avatar reference 1.7).
struct DecodingParams {
    double offsetScale = 0.05; ///< metres per unit of raw position
    InitialScale initialScale = InitialScale::Footprint;
    double scaleFactor = 0.7; ///< of the footprint's or the neighbours' size
    double maxStretch = 6.0;  ///< of a footprint
    double initialOpacity = 0.9;
    double insetM = 0.0; ///< base points lie this far inside the template's surface
    double initialAlbedo = 0.5;
    double initialRoughness = 0.6;
    bool learnBase = false; ///< every surfel has base values of its own that are learned beside the networks (an
                            ///< addition to the paper: details of the texture come in a few hundred steps)

    bool operator==(const DecodingParams&) const = default;
};
const ParameterTable<DecodingParams>& decodingParameters();

/// Constant (or, with learnBase, learned) values that the raw outputs are added to, P of each, and the template's
/// points.
struct SurfelBase {
    at::Tensor points;    ///< (P, 3) canonical, metres
    at::Tensor rotations; ///< (P, 4) unit: third axis is the template's normal
    at::Tensor logScales; ///< (P, 2)
    at::Tensor geometry;  ///< (P, 10) added to the raw outputs: offset 3, opacity 1, scales 2, rotation 4; 0 at the
                          ///< start; a leaf when learned, else undefined
    at::Tensor materials; ///< (P, 4): albedo 3, roughness 1; likewise
    at::Tensor colors;    ///< (P, 3); likewise
};
Result<SurfelBase> surfelBase(const CanonicalMaps& maps, const DecodingParams& params);

/// Canonical surfels and the offsets that L_reg looks at.
struct DecodedSurfels {
    SurfelTensors surfels; ///< means, rotations, scales, opacities, colors, albedos, roughnesses where given
    at::Tensor offsets;    ///< (P, 3) metres
};
/// mean = point + offsetScale raw; opacity = sigmoid(logit(initialOpacity) + raw); scale = exp(base + raw);
/// rotation = base (1 + raw_w, raw_xyz) normalised; albedo = sigmoid(logit(initialAlbedo) + raw), roughness likewise,
/// taken into [0.08, 1]; colour = raw + 0.5. Every raw number has that of the base added first. Groups that `raw` lacks
/// stay undefined.
DecodedSurfels decodeSurfels(const DecodingParams& params, const SurfelBase& base, const RawAttributes& raw);
/// The colours alone, (P, 3): of further views.
at::Tensor decodeColors(const SurfelBase& base, const at::Tensor& raw);

} // namespace ars
