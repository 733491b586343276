#include "engine/capture/actorshq_calibration.h"
#include "engine/capture/layout.h"

#include <array>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

bool isThere(const fs::path& path) {
    std::error_code ignored;
    return fs::exists(path, ignored);
}

constexpr const char* kCalibration = "calibration.csv";
/// Smallest pictures first: what the published avatars were trained on.
constexpr std::array<const char*, 3> kScales = {"4x", "2x", "1x"};

} // namespace

fs::path findActorsHqScale(const fs::path& folder) {
    if (isThere(folder / kCalibration)) return folder;
    for (const fs::path& sequence : {folder, folder / "Sequence1"}) {
        for (const char* scale : kScales) {
            if (isThere(sequence / scale / kCalibration)) return sequence / scale;
        }
    }
    return {};
}

Result<CaptureLayout> readActorsHqLayout(const fs::path& folder, const ReadLimits& limits) {
    CaptureLayout layout;
    layout.kind = CaptureKind::ActorsHq;
    const fs::path scale = findActorsHqScale(folder);
    layout.calibration = scale / kCalibration;
    ARS_TRY(layout.cameras, readActorsHqCalibration(layout.calibration, limits));
    // The poses come from elsewhere and are put beside the scales; people put them into the scale as well.
    fs::path sequence = fs::absolute(scale).lexically_normal();
    if (!sequence.has_filename()) sequence = sequence.parent_path(); // "4x/"
    sequence = sequence.parent_path();
    layout.poses = isThere(scale / "smpl_params.npz") ? scale / "smpl_params.npz" : sequence / "smpl_params.npz";
    layout.missingList = scale / "missing_img_files.txt";
    for (const CalibratedCamera& camera : layout.cameras) {
        CameraFiles files;
        files.pictures = {scale / "rgbs" / camera.name, camera.name + "_rgb", 6, ".jpg"};
        files.masks = {scale / "masks" / camera.name, camera.name + "_mask", 6, ".png"};
        layout.files.push_back(std::move(files));
    }
    // A training uses a third of the 160 cameras and few keep the rest; published poses end before the recording does.
    layout.camerasMayLack = true;
    layout.posesMayEndEarly = true;
    if (scale != folder) {
        layout.notes.push_back(fmt::format("pictures are taken from {}", scale.lexically_relative(folder).string()));
    }
    return layout;
}

} // namespace ars
