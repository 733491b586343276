#include "engine/light/prefilter_lanes_impl.h"

namespace ars::lanes {

void specularSumAvx2(const Planes& planes, const Span* spans, int count, float alphaSquared, float cosine,
                     float* result) {
    specularSum<8>(planes, spans, count, alphaSquared, cosine, result);
}

void diffuseSumAvx2(const Planes& planes, const Span* spans, int count, float limit, float* result) {
    diffuseSum<8>(planes, spans, count, limit, result);
}

} // namespace ars::lanes
