#if defined(__GNUC__) && !defined(__clang__)
// GCC 12's own header passes on a register that it left undefined on purpose (GCC bug 105593).
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"
#endif

#include "engine/surfel/splat_gradient_cpu_tile.h"

// Compiled with its instruction set switched on where the compiler and processor family have it (CMakeLists.txt).
namespace ars::cpu {

GradientTileFunction avx512GradientTile() {
#if ARS_SIMD_AVX512
    return gradientTileFunction<NativeFloat>();
#else
    return nullptr;
#endif
}

} // namespace ars::cpu
