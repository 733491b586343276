#include "engine/surfel/splat_gradient_cpu_tile.h"

// Compiled with its instruction set switched on where the compiler and processor family have it (CMakeLists.txt).
namespace ars::cpu {

GradientTileFunction avx2GradientTile() {
#if ARS_SIMD_AVX2
    return gradientTileFunction<NativeFloat>();
#else
    return nullptr;
#endif
}

} // namespace ars::cpu
