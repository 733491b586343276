#include "engine/surfel/splat_cpu_tile.h"

namespace ars::cpu {

TileFunctions portableTileFunctions() { return tileFunctions<NativeFloat>(); }

} // namespace ars::cpu
