#pragma once

#include "engine/core/progress.h"
#include "engine/light/environment.h"
#include "engine/light/prefilter.h"
#include "engine/light/sky.h"
#include "engine/light/studio.h"

#include <memory>
#include <string>

namespace ars {

/// A light as a frame uses it: the picture for the backdrop, and what shading looks up.
struct LightSource {
    std::string name; ///< what readLightSource was given
    Environment environment;
    CubeMap base;
    std::shared_ptr<PrefilteredLight> filtered;
};

/// The words that stand for generated lights, with an optional variant: "sky", "sky:12,40" (sun elevation and azimuth
/// in degrees), "studio", "studio:rim" (three_point, rim, beauty, overcast), "uniform". Anything else is a file or a
/// folder of six faces. InvalidArgument for a variant that does not exist; errors of readEnvironment with the path.
Result<Environment> readLight(const std::string& source);

/// The same with cube and split-sum levels on `device`.
/// @param baseSize  side of the cube, a power of two in [64, 4096]
Result<LightSource> readLightSource(const std::string& source, const Device& device,
                                    LightQuality quality = LightQuality::Exact, int baseSize = kDefaultLightBase,
                                    const ProgressFunction& progress = {});

/// Filters an environment that is already in memory.
Result<LightSource> filterLight(std::string name, Environment environment, const Device& device, LightQuality quality,
                                int baseSize = kDefaultLightBase, const ProgressFunction& progress = {});

} // namespace ars
