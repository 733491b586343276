#include "engine/surfel/splat_cpu_tile.h"

// Compiled with its instruction set switched on where the compiler and processor family have it (CMakeLists.txt).
namespace ars::cpu {

TileFunctions avx2TileFunctions() {
#if ARS_SIMD_AVX2
    return tileFunctions<NativeFloat>();
#else
    return {};
#endif
}

} // namespace ars::cpu
