#include "engine/surfel/splat_gradient_cpu_tile.h"

namespace ars::cpu {

GradientTileFunction portableGradientTile() { return gradientTileFunction<NativeFloat>(); }

} // namespace ars::cpu
