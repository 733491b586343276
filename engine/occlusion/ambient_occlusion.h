#pragma once

#include "engine/core/buffer.h"
#include "engine/core/camera.h"
#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/core/parameters.h"
#include "engine/surfel/gbuffer.h"

#include <array>
#include <cstdint>
#include <string_view>

namespace ars {

/// What the importance map I makes finer: nothing, both angles as printed (16 times the directions at I = 1), or the
/// azimuth alone (the "four times" of the paper's text).
enum class OcclusionAdaptive { Off, Both, Azimuth };

/// Full: every direction of the grid. Interactive: one subset of at most `interactiveDirections` of them.
enum class OcclusionQuality { Full, Interactive };

template <>
struct EnumWords<OcclusionAdaptive> {
    static constexpr std::array<std::string_view, 3> words{"off", "both", "azimuth"};
};
template <>
struct EnumWords<OcclusionQuality> {
    static constexpr std::array<std::string_view, 2> words{"full", "interactive"};
};

/// Screen-space ambient occlusion (paper Sec. 3.4 and its supplement; docs/math/occlusion.md). The defaults are the
/// preset `body`.
struct OcclusionParams {
    OcclusionQuality quality = OcclusionQuality::Full;
    OcclusionAdaptive adaptive = OcclusionAdaptive::Both;
    float strength = 1.0f;          ///< O becomes 1 - strength (1 - O), [0, 1]
    float delta = 0.0625f;          ///< angular step in units of pi (azimuth) and pi/2 (polar angle), [1/64, 1/2]
    float alpha = 3.0f;             ///< how much the importance divides the step, [0, 7]
    int steps = 16;                 ///< samples lie at j R / steps along a ray, [1, 64]
    int firstStep = 1;              ///< first j, [1, lastStep]
    int lastStep = 16;              ///< last j, [firstStep, steps]
    float biasM = 0.0f;             ///< a sample may lie this far in front of the depth map and still be hidden, metres
    float biasPerRadius = -0.01f;   ///< added to biasM for every metre of radius; negative: it must lie behind
    float thicknessM = 0.10f;       ///< a surface hides what lies at most this far behind it, metres; may be infinite
    bool depthFactor = false;       ///< rays are R (1 + z/100)^2 long, as in GI-GS
    bool median = false;            ///< 3x3 median of the camera-space positions first, as in GI-GS
    int interactiveDirections = 64; ///< of quality `interactive`: a pass takes at most this many, [16, 1024]

    bool operator==(const OcclusionParams&) const = default;
};

/// One row for each member.
const ParameterTable<OcclusionParams>& occlusionParameters();

/// Preset `body`, the default: steps 1 to 16 of 16, thickness 0.10 m (a limb's), hidden only R/100 or more
/// behind.
OcclusionParams bodyOcclusion();
/// Preset `reference`, the constants of GI-GS: steps 8 to 15 of 16, bias 0.01 m, thickness 0.05 m, (1 + z/100)^2,
/// median.
OcclusionParams referenceOcclusion();
/// By its word, "body" or "reference"; NotFound otherwise.
Result<OcclusionParams> occlusionPreset(std::string_view word);

/// InvalidArgument naming the member that is outside the range written beside it, or not a number.
Status validateOcclusionParams(const OcclusionParams& params);

/// The pictures that occlusion is computed from; all of one size, the camera's, on `device`.
///
/// A pixel is empty where the depth is not positive and finite or the opacity is below kMinOpacity: it hides nothing
/// and its occlusion is 1 (whoever writes files masks it to 0). Where the normal is zero or the radius not positive, or
/// either is not finite, the occlusion is 1 too. An importance that is not a number counts as 0.
struct OcclusionInputs {
    Device device;
    Camera camera;
    ImageView<const float> depth;      ///< 1: camera z, metres; 0 = empty
    ImageView<const float> normal;     ///< 3: camera space; normalised here
    ImageView<const float> radius;     ///< 1: R, metres
    ImageView<const float> importance; ///< 1: I, clamped to [0, 1]; an empty view counts as 0
    ImageView<const float> bone;       ///< 3: Q, camera space; an empty view or zero vector counts as up, (0, -1, 0)
    ImageView<const float> opacity;    ///< 1; an empty view counts as 1
};

/// Inputs from what splatting wrote. NotFound naming the channel when Depth, Normal or Radius is missing.
Result<OcclusionInputs> occlusionInputs(const GBuffer& gbuffer, const Camera& camera);

/// Scratch memory of a device, kept between frames: keep one for each pipeline; never use one from two threads at
/// once. Everything in it is recomputed by each call, but the direction tables, which depend on the parameters alone.
struct OcclusionWorkspace {
    Buffer depth;                ///< filtered, padded depth
    Buffer tables;               ///< azimuths and polar angles of every count
    Buffer tiles;                ///< host: bounds of the depth picture
    Buffer pixels;               ///< CUDA: the foreground pixels and how many they are
    OcclusionParams tableParams; ///< what `tables` was made for
};

/// O of every pixel, in [0, 1]: 1 = open. `occlusion` is a one-channel picture on the same device; every pixel is
/// written. On CUDA the work is queued on the default stream.
///
/// @param pass  quality `interactive` only: which subset of the directions; any number, passes repeat after
///              occlusionPasses(params) at the latest. Training gives its step here.
/// @return InvalidArgument when sizes or channels differ (naming both), a parameter is out of range or the camera is
///         none; OutOfMemory; Unavailable for CUDA in a build without it.
Status ambientOcclusion(const OcclusionParams& params, const OcclusionInputs& inputs, OcclusionWorkspace& workspace,
                        ImageView<float> occlusion, int pass = 0);

/// O, O+ and O- from R, R+ and R- (paper Eq. for the finite-difference path) in one go: directions and frames are
/// shared. All radii are one-channel pictures. Where R+ or R- is not positive its occlusion is 1.
Status ambientOcclusionTriple(const OcclusionParams& params, const OcclusionInputs& inputs,
                              ImageView<const float> radiusPlus, ImageView<const float> radiusMinus,
                              OcclusionWorkspace& workspace, ImageView<float> occlusion, ImageView<float> occlusionPlus,
                              ImageView<float> occlusionMinus, int pass = 0);

/// Directions (azimuths x polar angles) that a pixel of importance I gets at full quality.
struct OcclusionDirections {
    int azimuths = 0;
    int polarAngles = 0;
};
OcclusionDirections occlusionDirections(const OcclusionParams& params, float importance);

/// Interactive passes after which every direction of every pixel has been taken, whatever its importance.
/// @param importance  false: there is no importance map
int occlusionPasses(const OcclusionParams& params, bool importance = true);

/// Occlusion that starts at interactive quality and becomes the full quality while nothing changes. The first pass is
/// that of quality `interactive`; each further one takes kRefinementDirections of the directions, and the picture shows
/// the mean over those so far: after passes() of them all directions, which is the full result up to rounding.
inline constexpr int kRefinementDirections = 256;
class OcclusionRefinement {
public:
    /// Starts again with the next pass.
    void reset() { done_ = nextRow_ = 0; }
    /// How much a call takes after the first: of passes of `directions` (at least interactiveDirections; another number
    /// starts again), `bands` calls make one, each a part of the rows from the top. So calls stay short where the
    /// foreground fills a large picture. The picture given must then be the last call's. CUDA devices take whole
    /// passes.
    void setSlices(int bands, int directions = kRefinementDirections);
    /// Takes the next pass and writes the mean so far; when complete() it only writes the picture again.
    ///
    /// Starts again by itself when the parameters, the camera, the size or `version` differ from the last call's; the
    /// caller changes `version` when the pictures change (it cannot be seen from pointers). `params.quality` is not
    /// looked at. Errors as ambientOcclusion.
    Status refine(const OcclusionParams& params, const OcclusionInputs& inputs, std::uint64_t version,
                  OcclusionWorkspace& workspace, ImageView<float> occlusion);

    int passesDone() const { return done_; }
    int passes() const { return passes_; }
    bool complete() const { return passes_ > 0 && done_ >= passes_; }
    /// Share of the passes that are done, [0, 1]; pixels of low importance are ready long before.
    float share() const {
        const float band = rows_ > 0 ? static_cast<float>(nextRow_) / static_cast<float>(rows_) : 0.0f;
        return passes_ > 0 ? (static_cast<float>(done_) + band) / static_cast<float>(passes_) : 0.0f;
    }

private:
    bool sameInputs(const OcclusionParams& params, const OcclusionInputs& inputs, std::uint64_t version) const;

    PixelBuffer sums_; ///< 2: occluded weight, total weight
    OcclusionParams params_;
    Camera camera_;
    Device device_;
    bool importance_ = false;
    std::uint64_t version_ = 0;
    int done_ = 0;
    int passes_ = 0;
    int bands_ = 1;
    int directions_ = kRefinementDirections;
    int nextRow_ = 0; ///< of the pass under way
    int rows_ = 0;    ///< of the picture
};

/// What a picture costs; for benchmarks and the timing panel. Host pictures only (Unsupported otherwise); slow.
struct OcclusionCost {
    std::uint64_t pixels = 0;     ///< foreground
    std::uint64_t directions = 0; ///< all pixels together
    std::uint64_t tapsBound = 0;  ///< directions x steps
    std::uint64_t tapsTaken = 0;  ///< until each ray is hidden or leaves the picture, by the plain evaluation
};
Result<OcclusionCost> occlusionCost(const OcclusionParams& params, const OcclusionInputs& inputs);

} // namespace ars
