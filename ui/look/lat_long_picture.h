#pragma once

#include "engine/io/image.h"

namespace ars::ui {

/// Small pictures of environments, for previews and thumbnails. Lat-long as docs/conventions.md says.

/// The same picture with `width` x `width` / 2 pixels, each the mean of those that it covers (smaller pictures are
/// enlarged). Linear RGB in and out; an empty picture stays empty.
Image smallLatLong(const Image& environment, int width);

/// Stops that bring the picture's middle brightness to a middle grey, in [-10, 10]; 0 for a black one. The sun does not
/// count: the median decides.
float previewExposure(const Image& environment);

/// Linear RGB to sRGB-encoded opaque RGBA in [0, 1]: exposure, then the AgX curve.
Image displayLatLong(const Image& environment, float exposureEv);

} // namespace ars::ui
