#include "engine/capture/actorshq_calibration.h"

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <set>
#include <string>

/// Any text through the table's reader; a camera that it accepts has a sound name, a picture, and a rotation.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto cameras = ars::parseActorsHqCalibration({reinterpret_cast<const char*>(data), size});
    if (!cameras) return 0;
    if (cameras->empty()) std::abort();
    std::set<std::string> names;
    for (const ars::CalibratedCamera& calibrated : *cameras) {
        const ars::Camera& camera = calibrated.camera;
        if (calibrated.name.empty() || calibrated.name.find_first_of("/\\") != std::string::npos) std::abort();
        if (!names.insert(calibrated.name).second) std::abort();
        if (camera.width < 1 || camera.height < 1 || !(camera.fx > 0.0) || !(camera.fy > 0.0)) std::abort();
        for (int column = 0; column < 3; ++column) {
            for (int other = 0; other < 3; ++other) {
                const double product = glm::dot(camera.rotation[column], camera.rotation[other]);
                if (!(std::abs(product - (column == other ? 1.0 : 0.0)) < 1e-6)) std::abort();
            }
        }
    }
    return 0;
}
