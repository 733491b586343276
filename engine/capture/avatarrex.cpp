#include "engine/capture/layout.h"

namespace ars {

Result<CaptureLayout> readAvatarRexLayout(const std::filesystem::path& folder, const ReadLimits& limits) {
    CaptureLayout layout;
    layout.kind = CaptureKind::AvatarRex;
    layout.calibration = folder / "calibration_full.json";
    layout.poses = folder / "smpl_params.npz";
    layout.missingList = folder / "missing_img_files.txt";
    ARS_TRY(layout.cameras, readCalibration(layout.calibration, limits));
    for (const CalibratedCamera& camera : layout.cameras) {
        CameraFiles files;
        files.pictures.folder = folder / camera.name;
        files.masks.folder = folder / camera.name / "mask" / "pha";
        layout.files.push_back(std::move(files));
    }
    return layout;
}

} // namespace ars
