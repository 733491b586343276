#include "engine/capture/layout.h"

namespace ars {

Result<CaptureLayout> readTHuman4Layout(const std::filesystem::path& folder, const ReadLimits& limits) {
    CaptureLayout layout;
    layout.kind = CaptureKind::THuman4;
    layout.calibration = folder / "calibration.json";
    layout.poses = folder / "smpl_params.npz";
    layout.missingList = folder / "missing_img_files.txt";
    ARS_TRY(layout.cameras, readCalibration(layout.calibration, limits));
    for (const CalibratedCamera& camera : layout.cameras) {
        CameraFiles files;
        files.pictures.folder = folder / "images" / camera.name;
        files.masks.folder = folder / "masks" / camera.name;
        layout.files.push_back(std::move(files));
    }
    return layout;
}

} // namespace ars
