#pragma once

#include "engine/capture/capture.h"

namespace ars {

/// Whether the cameras can have taken these pictures of this person: focal lengths between 1/20 and 100 times the
/// longer side, the principal point within one picture of the picture, the person (the pelvis, in up to 64 poses)
/// within 100 m and not always behind the camera, lens coefficients that can be undone. BadFile with the camera and the
/// number; `place` is the calibration file.
Status checkCaptureCameras(const Capture& capture, const std::filesystem::path& place);

/// Sizes and ends of pictures and masks without decoding them: the first of every camera, and the others as long as
/// there are no more than 4,096 files, else that many evenly spread. The first failure in the order of files is the
/// answer: BadFile for a broken or truncated one and for a picture whose size the calibration does not have,
/// InvalidArgument for a mask of another size than the picture's.
Status checkCapturePictures(const Capture& capture, const ProgressFunction& progress);

} // namespace ars
