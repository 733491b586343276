#include "engine/core/parallel.h"
#include "engine/shade/shading_kernels.h"

namespace ars::cpu {

void shade(const ShadingArguments& arguments) {
    const ShadingArguments a = arguments;
    // Rows, not pixels: what is seen fills the middle of the picture, and small pieces share it out.
    parallelFor(
        static_cast<std::size_t>(a.height),
        [&a](std::size_t row) {
            for (int column = 0; column < a.width; ++column) shadePixel(a, static_cast<int>(row), column);
        },
        4);
}

} // namespace ars::cpu
