#pragma once

#include "engine/core/camera.h"
#include "engine/frame/buffer_catalogue.h"
#include "engine/io/exr.h"
#include "engine/io/image.h"
#include "engine/light/environment.h"
#include "engine/shade/tone.h"

#include <optional>
#include <vector>

namespace ars {

/// How buffers become pictures that files and people take.
struct DisplaySettings {
    ToneParams tone;                              ///< of light; its background lies behind data, too
    std::optional<std::pair<float, float>> range; ///< of scalars and places; unset: the catalogue's
    std::optional<ColorMap> colorMap;             ///< of scalars; unset: the catalogue's
};

/// An sRGB-encoded picture of a buffer: light through exposure and tone curve, data through its colour map, over the
/// background (or with straight alpha where tone.transparent).
/// @param picture  of this buffer, as FramePipeline::picture gives it
/// @param opacity  (1 channel) of the same size
/// @return RGB, or RGBA where transparent; InvalidArgument when sizes differ.
Result<Image> displayPicture(BufferId id, const Image& picture, const Image& opacity, const DisplaySettings& settings);

/// Puts the environment behind a premultiplied linear RGBA picture, which becomes opaque. Bilinear; the camera has the
/// picture's size.
/// @param blur  [0, 1]: which of the halved pictures is looked up, between neighbours linearly; 1 is the mean of all
Status addBackdrop(Image& beauty, const Camera& camera, const Environment& environment,
                   const EnvironmentPlacement& placement, float blur = 0.0f);

/// Bytes (height, width, 3) of an sRGB picture, rounded to nearest; what a video takes.
std::vector<std::uint8_t> displayBytes(const Image& image);

/// Adds a buffer as the layer that docs/conventions.md names. Depth and position are stored as float, the rest as half.
Status addBufferLayer(ExrImage& exr, BufferId id, const Image& picture);

} // namespace ars
