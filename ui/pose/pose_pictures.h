#pragma once

#include "engine/core/progress.h"
#include "engine/io/image.h"
#include "engine/rig/pose.h"
#include "engine/rig/template_mesh.h"

#include <functional>
#include <string>
#include <vector>

namespace ars::ui {

inline constexpr int kThumbnailWidth = 96;
inline constexpr int kThumbnailHeight = 128;

/// A pose that wants a picture.
struct ThumbnailWish {
    std::string key; ///< names body and pose: equal keys, equal picture (thumbnailKey)
    Pose pose;
};

/// A word for a body's source and a pose that file names can hold.
std::string thumbnailKey(const std::string& avatarSource, const Pose& pose);

/// Pictures of poses, sRGB with straight alpha, in the order of the wishes: a coarse body without texture in the light
/// of three lamps. InvalidArgument for a mesh that gives no surfels; Cancelled.
/// @param made  called after each one
Status renderThumbnails(const TemplateMesh& mesh, const std::vector<ThumbnailWish>& wishes,
                        const std::function<void(const std::string& key, Image)>& made,
                        const ProgressFunction& progress = {});

} // namespace ars::ui
