#pragma once

#include <cstddef>

namespace ars::lanes {

// Inner sums of the prefilter, compiled once for each instruction set (prefilter_lanes_*.cpp). These files include
// nothing with inline functions of its own: such a function, compiled for AVX-512, might be the copy that the linker
// keeps for everybody.

/// A level as planes. Rows are padded to `stride` with texels of no solid angle, so that whole vectors can be read.
struct Planes {
    const float* red = nullptr; ///< (6, size, stride)
    const float* green = nullptr;
    const float* blue = nullptr;
    const float* inverseLength = nullptr; ///< (size, stride): 1 / |direction|
    const float* solidAngle = nullptr;    ///< (size, stride); 0 in the padding
    const float* coordinate = nullptr;    ///< (stride): u of a column, v of a row
    std::size_t size = 0;
    std::size_t stride = 0;
};

/// Floats beyond a row's end that may be read.
inline constexpr std::size_t kPadding = 16;

/// The part of a face that is summed, and the lobe's axis in its axes.
struct Span {
    std::size_t face, x0, x1, y0, y1;
    float right, down, major;
};

/// result = sum of weight times red, green, blue, and of the weights.
using SpecularSum = void (*)(const Planes& planes, const Span* spans, int count, float alphaSquared, float cosine,
                             float result[4]);
/// result = sum of clamp(n.w) dw / pi times red, green, blue over the spans.
using DiffuseSum = void (*)(const Planes& planes, const Span* spans, int count, float limit, float result[3]);

void specularSumPortable(const Planes&, const Span*, int, float, float, float*);
void diffuseSumPortable(const Planes&, const Span*, int, float, float*);
#if defined(__x86_64__)
void specularSumAvx2(const Planes&, const Span*, int, float, float, float*);
void diffuseSumAvx2(const Planes&, const Span*, int, float, float*);
void specularSumAvx512(const Planes&, const Span*, int, float, float, float*);
void diffuseSumAvx512(const Planes&, const Span*, int, float, float*);
#endif

} // namespace ars::lanes
