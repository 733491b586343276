#include "engine/rig/body_model.h"

#include <cstdlib>

/// A body file from any bytes: refused with a message, or a body that can be posed.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    ars::ReadLimits limits;
    limits.maxBytes = 64ull << 20;
    limits.maxFileBytes = 64ull << 20;
    const auto file = ars::parseNpz({reinterpret_cast<const std::byte*>(data), size}, limits);
    if (!file) return 0;
    const auto body = ars::bodyModelFromArrays(*file);
    if (!body) {
        if (body.error().message.empty()) std::abort();
        return 0;
    }
    ars::Pose pose = ars::canonicalPose();
    pose.expression = {1.0f, -1.0f};
    if (ars::posedVertices(*body, {{0.5f, 2.0f}, {}}, pose).size() != body->vertexCount()) std::abort();
    return 0;
}
