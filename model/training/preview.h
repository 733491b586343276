#pragma once

#include "engine/capture/capture.h"
#include "engine/core/error.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "model/avatar/avatar_model.h"

namespace ars {

struct PreviewOptions {
    SplatParams splat;
    OcclusionParams occlusion;
    bool occlude = true;
    bool shaded = true; ///< also the PBR picture, albedo, roughness, occlusion
};

/// One row for people: photograph, radiance, normal, and where shaded PBR, albedo, roughness and occlusion, all of the
/// photograph's size over grey.
Result<Image> previewPicture(const AvatarModel& model, const Pose& pose, const CapturedView& photograph,
                             const PreviewOptions& options);

} // namespace ars
