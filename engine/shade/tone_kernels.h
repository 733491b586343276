#pragma once

#include "engine/core/error.h"
#include "engine/shade/tone_math.h"

#include <cstddef>
#include <cstdint>

namespace ars {

/// What both devices are given, checked; exactly one of the outputs is there.
struct ToneArguments {
    const float* linear = nullptr; ///< (pixels, channels)
    int channels = 4;              ///< 3 or 4
    float* display = nullptr;      ///< (pixels, 4)
    std::uint8_t* bytes = nullptr; ///< (pixels, 4)
    std::size_t pixels = 0;
    ToneSettings<float> tone;
};

ARS_HD inline glm::vec4 readPixel(const ToneArguments& a, std::size_t i) {
    const float* p = a.linear + i * static_cast<std::size_t>(a.channels);
    return {p[0], p[1], p[2], a.channels == 4 ? p[3] : 1.0f};
}

ARS_HD inline void writePixel(const ToneArguments& a, std::size_t i, const glm::vec4& display) {
    for (int c = 0; c < 4; ++c) {
        const std::size_t at = 4 * i + static_cast<std::size_t>(c);
        if (a.display) a.display[at] = display[c];
        if (a.bytes) a.bytes[at] = static_cast<std::uint8_t>(display[c] * 255.0f + 0.5f);
    }
}

namespace cpu {
void toneMap(const ToneArguments& arguments);
} // namespace cpu

namespace cuda {
/// Queued on the default stream of device `index`; does not wait.
Status toneMap(const ToneArguments& arguments, int index);
} // namespace cuda

} // namespace ars
