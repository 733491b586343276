#include "ui/viewport/probe.h"

#include "ui/viewport/probe_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

/// One window, one thread.
ProbeState& state() {
    static ProbeState value;
    return value;
}

std::string numberText(float value) {
    if (std::isnan(value)) return "NaN";
    const float size = std::abs(value);
    if (size >= 1e4f || (size > 0.0f && size < 5e-4f)) return fmt::format("{:.2e}", value);
    return fmt::format("{:.{}f}", value, size >= 100.0f ? 1 : size >= 10.0f ? 2 : 3);
}

} // namespace

ProbeState& probeState() { return state(); }

const ViewportProbe& viewportProbe() { return state().probe; }

void wantProbe() { state().wantedFrames = 2; }

bool probePinned() { return state().pinned; }

void pinProbe(bool pinned) { state().pinned = pinned; }

std::string probeText(const ProbeValue& value) {
    std::string text;
    for (int c = 0; c < value.channels; ++c) {
        const std::string number = numberText(value.values[static_cast<std::size_t>(c)]);
        text += fmt::format("{}{:>{}}", c > 0 ? "  " : "", number, value.channels > 1 ? 6 : 0);
    }
    return text;
}

ViewportProbe probeFrame(const Frame& frame, int column, int row) {
    ViewportProbe probe;
    const Camera& camera = frame.inputs.camera;
    probe.width = camera.width;
    probe.height = camera.height;
    probe.column = column;
    probe.row = row;
    if (column < 0 || row < 0 || column >= camera.width || row >= camera.height) return probe;
    probe.inside = true;
    // The map is sorted by BufferId, which is the catalogue's order.
    for (const auto& [id, picture] : frame.pictures) {
        if (!picture || column >= picture->width || row >= picture->height) continue;
        ProbeValue value;
        value.buffer = id;
        value.channels = std::min(picture->channels, 4);
        for (int c = 0; c < value.channels; ++c)
            value.values[static_cast<std::size_t>(c)] = picture->at(row, column, c);
        if (id == BufferId::Opacity) probe.covered = value.values[0] >= 0.05f;
        probe.values.push_back(value);
    }
    if (const Image* depth = frame.picture(BufferId::Depth); depth && probe.covered) {
        const double z = depth->at(row, column, 0);
        probe.world = glm::vec3(camera.toWorld(z * camera.ray(column + 0.5, row + 0.5)));
    }
    return probe;
}

} // namespace ars::ui
