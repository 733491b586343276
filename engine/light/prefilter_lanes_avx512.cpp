#include "engine/light/prefilter_lanes_impl.h"

namespace ars::lanes {

void specularSumAvx512(const Planes& planes, const Span* spans, int count, float alphaSquared, float cosine,
                       float* result) {
    specularSum<16>(planes, spans, count, alphaSquared, cosine, result);
}

void diffuseSumAvx512(const Planes& planes, const Span* spans, int count, float limit, float* result) {
    diffuseSum<16>(planes, spans, count, limit, result);
}

} // namespace ars::lanes
