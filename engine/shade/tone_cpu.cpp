#include "engine/core/parallel.h"
#include "engine/shade/tone_kernels.h"

namespace ars::cpu {

void toneMap(const ToneArguments& arguments) {
    const ToneArguments a = arguments;
    // Most of a picture is empty, and all empty pixels become the same.
    const glm::vec4 empty = tonePixel(a.tone, glm::vec4(0.0f));
    parallelFor(
        a.pixels,
        [&a, &empty](std::size_t i) {
            const glm::vec4 pixel = readPixel(a, i);
            writePixel(a, i, pixel.w > 0.0f ? tonePixel(a.tone, pixel) : empty);
        },
        1024);
}

} // namespace ars::cpu
