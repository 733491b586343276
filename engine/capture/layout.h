#pragma once

#include "engine/capture/capture.h"

#include <filesystem>
#include <string>
#include <vector>

namespace ars {

/// What the reader of one layout says about a folder before any picture is looked for.
struct CaptureLayout {
    CaptureKind kind = CaptureKind::AvatarRex;
    std::filesystem::path calibration; ///< the file
    std::filesystem::path poses;       ///< smpl_params.npz
    std::filesystem::path missingList; ///< missing_img_files.txt, which need not exist
    std::vector<CalibratedCamera> cameras;
    std::vector<CameraFiles> files; ///< folders and prefixes; digits and extensions are found by listing
    bool camerasMayLack = false;    ///< cameras whose folder is absent are left out rather than refused
    bool posesMayEndEarly = false;  ///< frames after the last pose are left out rather than refused
    std::vector<std::string> notes;
};

/// Which layout a folder has, by the names in it, and its reader's answer. NotFound for no folder, InvalidArgument for
/// a file, Io for what cannot be opened, Unsupported for a folder without a calibration (naming captures inside it).
Result<CaptureLayout> readCaptureLayout(const std::filesystem::path& folder, const ReadLimits& limits);

/// Whether a folder has the calibration of a layout; nothing is read.
bool looksLikeCapture(const std::filesystem::path& folder);

/// rgbs/CAMERA/CAMERA_rgb%06d.jpg, masks/CAMERA/CAMERA_mask%06d.png, calibration.csv (avatar reference 5.3). `folder`
/// may be the one of a scale ("4x"), of a sequence or of an actor; of several scales the smallest pictures are taken.
Result<CaptureLayout> readActorsHqLayout(const std::filesystem::path& folder, const ReadLimits& limits);
/// The folder of ActorsHQ's calibration.csv under one of the three; empty where there is none.
std::filesystem::path findActorsHqScale(const std::filesystem::path& folder);

} // namespace ars
