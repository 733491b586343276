#if defined(__GNUC__) && !defined(__clang__)
// GCC 12's own header passes on a register that it left undefined on purpose (GCC bug 105593).
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#pragma GCC diagnostic ignored "-Wuninitialized"
#endif

#include "engine/surfel/splat_cpu_tile.h"

// Compiled with its instruction set switched on where the compiler and processor family have it (CMakeLists.txt).
namespace ars::cpu {

TileFunctions avx512TileFunctions() {
#if ARS_SIMD_AVX512
    return tileFunctions<NativeFloat>();
#else
    return {};
#endif
}

} // namespace ars::cpu
