#include "engine/light/prefilter_lanes_impl.h"

namespace ars::lanes {

void specularSumPortable(const Planes& planes, const Span* spans, int count, float alphaSquared, float cosine,
                         float* result) {
    specularSum<4>(planes, spans, count, alphaSquared, cosine, result);
}

void diffuseSumPortable(const Planes& planes, const Span* spans, int count, float limit, float* result) {
    diffuseSum<4>(planes, spans, count, limit, result);
}

} // namespace ars::lanes
