#pragma once

#include "engine/frame/frame_pipeline.h"
#include "engine/scene/assets.h"
#include "engine/scene/document.h"

#include <glm/glm.hpp>

namespace ars {

/// The document at a moment: one function for the window, films and rendering without a window, so that they show the
/// same.

/// Value of a track at a time; the first or last key's outside. `track` must not be empty.
float sampleTrack(const Track<float>& track, double timeS);
glm::vec3 sampleTrack(const Track<glm::vec3>& track, double timeS);
glm::quat sampleTrack(const Track<glm::quat>& track, double timeS);
SceneCamera sampleTrack(const Track<SceneCamera>& track,
                        double timeS); ///< eye in spherical coordinates about the target
std::vector<float> sampleTrack(const Track<std::vector<float>>& track, double timeS);

/// The pose without keys: the clip's at this time, or the document's.
Pose basePose(const Document& document, const SceneAssets& assets, double timeS);
/// The pose with keys.
Pose poseAt(const Document& document, const SceneAssets& assets, double timeS);
SceneCamera cameraAt(const Document& document, double timeS);
PartRadii radiiAt(const Document& document, double timeS);
EnvironmentPlacement placementAt(const Document& document, double timeS);

/// A pinhole camera of the given picture size.
Camera cameraOf(const SceneCamera& camera, int width, int height);
/// The free camera that sees what `camera` sees, as far as it can (centred principal point); its target lies as far
/// away as `distanceM`.
SceneCamera sceneCameraOf(const Camera& camera, double distanceM);

/// A part of a picture, pixels from the upper left.
struct PixelRect {
    double x = 0, y = 0, width = 0, height = 0;
};
/// The camera of a frame: the free one, or the dataset camera with its photograph fitted into the frame.
/// @param photographRect  receives where the photograph's frame lies (the whole frame for the free camera); may be null
Camera frameCamera(const Document& document, const SceneAssets& assets, double timeS, int width, int height,
                   PixelRect* photographRect = nullptr);

/// Everything that a picture depends on. Quality of occlusion is Full; whoever shows drafts changes it.
FrameInputs frameInputs(const Document& document, const SceneAssets& assets, double timeS, int width, int height);

} // namespace ars
