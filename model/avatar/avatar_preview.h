#pragma once

#include "engine/io/image.h"
#include "model/avatar/avatar_model.h"

namespace ars {

/// An avatar as its folder shows it: 512 x 512, the rest pose from the front under its own light, or its radiance where
/// it has no light, over grey. sRGB.
Result<Image> avatarPreview(const AvatarModel& model);

} // namespace ars
