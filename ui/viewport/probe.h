#pragma once

#include "engine/frame/buffer_catalogue.h"
#include "engine/scene/frame_worker.h"

#include <glm/glm.hpp>

#include <array>
#include <string>
#include <vector>

namespace ars::ui {

/// One buffer's numbers at a pixel.
struct ProbeValue {
    BufferId buffer = BufferId::Beauty;
    int channels = 0;
    std::array<float, 4> values{};
};

/// What lies under the cursor in the viewport's picture.
struct ViewportProbe {
    bool inside = false;  ///< the cursor is over the picture, and there is a frame
    bool covered = false; ///< something of the avatar is there
    int column = 0;       ///< pixel of the frame, from the upper left
    int row = 0;
    int width = 0; ///< of the frame, pixels
    int height = 0;
    std::vector<ProbeValue> values; ///< every buffer that the frame has, in the catalogue's order
    glm::vec3 world{0.0f};          ///< point that is seen, metres; where covered
    int joint = -1;                 ///< whose skin it is; -1: unknown
    std::string jointName;          ///< "" where unknown
    std::string partName;           ///< of the nine; "" where unknown
};

/// The probe of this window frame; of the last one for panels that are drawn before the viewport.
const ViewportProbe& viewportProbe();

/// Panels that show the probe's numbers call this in every frame in which they do: while nothing moves, the frame then
/// holds all buffers and not only those that are looked at.
void wantProbe();
/// The table of numbers beside the cursor stays without its key being held.
bool probePinned();
void pinProbe(bool pinned);

/// "0.812", "0.102  -0.331  0.938": as many digits as a float means to a person.
std::string probeText(const ProbeValue& value);

/// All buffers of a frame at one of its pixels; joint and part are left out. Outside the frame `inside` is false.
ViewportProbe probeFrame(const Frame& frame, int column, int row);

} // namespace ars::ui
