#include "engine/occlusion/ambient_occlusion.h"

#include "engine/occlusion/ambient_occlusion_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

namespace ars {
namespace {

constexpr std::string_view kPlace = "occlusion";
constexpr float kFinestDelta = 1.0f / 64.0f;

Error invalid(std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::string(kPlace), std::move(message));
}

Status checkRange(std::string_view name, double value, double least, double most) {
    if (value >= least && value <= most) return {}; // false for NaN
    return invalid(fmt::format("{} is {}, expected {} to {}", name, value, least, most));
}

Status checkPicture(std::string_view name, const ImageView<const float>& picture, int channels, const Camera& camera) {
    if (picture.empty()) return invalid(fmt::format("there is no {} picture", name));
    if (picture.width == camera.width && picture.height == camera.height && picture.channels == channels) return {};
    return invalid(fmt::format("the {} picture is {}x{} with {} channels, expected {}x{} with {} (the camera's size)",
                               name, picture.width, picture.height, picture.channels, camera.width, camera.height,
                               channels));
}

Status checkInputs(const OcclusionParams& params, const OcclusionInputs& inputs) {
    ARS_TRY_STATUS(validateOcclusionParams(params));
    ARS_TRY_STATUS(validateCamera(inputs.camera, "occlusion: camera"));
    ARS_TRY_STATUS(checkPicture("depth", inputs.depth, 1, inputs.camera));
    ARS_TRY_STATUS(checkPicture("normal", inputs.normal, 3, inputs.camera));
    ARS_TRY_STATUS(checkPicture("radius", inputs.radius, 1, inputs.camera));
    if (!inputs.importance.empty()) ARS_TRY_STATUS(checkPicture("importance", inputs.importance, 1, inputs.camera));
    if (!inputs.bone.empty()) ARS_TRY_STATUS(checkPicture("bone", inputs.bone, 3, inputs.camera));
    if (!inputs.opacity.empty()) ARS_TRY_STATUS(checkPicture("opacity", inputs.opacity, 1, inputs.camera));
    return {};
}

/// The largest grid that the parameters allow; the smallest is that of importance 0.
OcclusionGrid gridOf(const OcclusionParams& params, float importance) {
    return occlusionGrid(params.delta, params.alpha, params.adaptive == OcclusionAdaptive::Off ? 0.0f : importance,
                         params.adaptive == OcclusionAdaptive::Azimuth);
}

void appendAzimuths(int count, std::vector<float>& values) {
    const int padded = roundedToLanes(count);
    const std::size_t at = values.size();
    values.resize(at + 4 * static_cast<std::size_t>(padded), 0.0f);
    float* out = values.data() + at;
    for (int i = 0; i < count; ++i) {
        const double phi = azimuthAngle<double>(i, count);
        const int stride = padded / kOcclusionLanes;
        const int ordered = i % stride * kOcclusionLanes + i / stride;
        out[i] = static_cast<float>(std::cos(phi));
        out[padded + i] = static_cast<float>(std::sin(phi));
        out[2 * padded + ordered] = out[i];
        out[3 * padded + ordered] = out[padded + i];
    }
}

void appendPolarAngles(int count, std::vector<float>& values) {
    const std::size_t at = values.size();
    values.resize(at + 3 * static_cast<std::size_t>(count));
    float* out = values.data() + at;
    for (int t = 0; t < count; ++t) {
        const double theta = polarAngle<double>(t, count);
        out[t] = static_cast<float>(std::sin(theta));
        out[count + t] = static_cast<float>(std::cos(theta));
        out[2 * count + t] = static_cast<float>(std::cos(theta) * std::sin(theta));
    }
}

/// A buffer of at least `bytes` on `device`; what it held is lost when it is made anew.
Status reserve(Buffer& buffer, const Device& device, std::size_t bytes, std::string_view owner) {
    if (buffer.data() && buffer.device() == device && buffer.bytes() >= bytes) return {};
    buffer = Buffer();
    ARS_TRY(buffer, Buffer::allocate(device, bytes, owner));
    return {};
}

bool sameTables(const OcclusionParams& a, const OcclusionParams& b) {
    return a.delta == b.delta && a.alpha == b.alpha && a.adaptive == b.adaptive;
}

/// Makes the tables when the parameters are new and points `arguments` to them.
Status prepareTables(const OcclusionParams& params, const Device& device, OcclusionWorkspace& workspace,
                     OcclusionTables& tables) {
    const OcclusionGrid least = gridOf(params, 0.0f), most = gridOf(params, 1.0f);
    const int azimuthCounts = most.azimuths - least.azimuths + 1;
    const int polarCounts = most.polarAngles - least.polarAngles + 1;
    const bool kept =
        workspace.tables.data() && workspace.tables.device() == device && sameTables(workspace.tableParams, params);
    if (!kept) {
        std::vector<int> offsets;
        std::vector<float> values;
        for (int n = least.azimuths; n <= most.azimuths; ++n) {
            offsets.push_back(static_cast<int>(values.size()));
            appendAzimuths(n, values);
        }
        for (int n = least.polarAngles; n <= most.polarAngles; ++n) {
            offsets.push_back(static_cast<int>(values.size()));
            appendPolarAngles(n, values);
        }
        std::vector<std::byte> bytes(offsets.size() * sizeof(int) + values.size() * sizeof(float));
        std::memcpy(bytes.data(), offsets.data(), offsets.size() * sizeof(int));
        std::memcpy(bytes.data() + offsets.size() * sizeof(int), values.data(), values.size() * sizeof(float));
        workspace.tables = Buffer();
        ARS_TRY(workspace.tables, Buffer::allocate(device, bytes.size(), "occlusion: directions"));
        if (Status uploaded = uploadBuffer(workspace.tables, bytes); !uploaded) {
            workspace.tables = Buffer();
            return uploaded;
        }
        workspace.tableParams = params;
    }
    tables.azimuthOffsets = static_cast<const int*>(workspace.tables.data());
    tables.polarOffsets = tables.azimuthOffsets + azimuthCounts;
    tables.values = static_cast<const float*>(workspace.tables.data()) + azimuthCounts + polarCounts;
    tables.firstAzimuths = least.azimuths;
    tables.firstPolarAngles = least.polarAngles;
    return {};
}

OcclusionMarch<float> marchOf(const OcclusionParams& params, const Camera& camera) {
    OcclusionMarch<float> march;
    march.width = camera.width;
    march.height = camera.height;
    march.stride = camera.width + 2 * kOcclusionBorder;
    march.fx = static_cast<float>(camera.fx);
    march.fy = static_cast<float>(camera.fy);
    march.cx = static_cast<float>(camera.cx + kOcclusionBorder);
    march.cy = static_cast<float>(camera.cy + kOcclusionBorder);
    march.steps = params.steps;
    march.firstStep = params.firstStep;
    march.lastStep = params.lastStep;
    march.biasM = params.biasM;
    march.biasPerRadius = params.biasPerRadius;
    march.thicknessM = params.thicknessM;
    march.depthFactor = params.depthFactor;
    return march;
}

Status prepareScratch(const OcclusionInputs& inputs, OcclusionWorkspace& workspace, OcclusionArguments& a) {
    const std::size_t width = static_cast<std::size_t>(inputs.camera.width);
    const std::size_t height = static_cast<std::size_t>(inputs.camera.height);
    const std::size_t padded = static_cast<std::size_t>(a.march.stride) * (height + 2 * kOcclusionBorder);
    ARS_TRY_STATUS(reserve(workspace.depth, inputs.device, padded * sizeof(float), "occlusion: depth"));
    a.paddedDepth = static_cast<float*>(workspace.depth.data());
    if (inputs.device.kind == DeviceKind::Cuda) {
        const std::size_t entries = width * height + 2;
        ARS_TRY_STATUS(reserve(workspace.pixels, inputs.device, entries * sizeof(unsigned int), "occlusion: pixels"));
        a.pixels = static_cast<unsigned int*>(workspace.pixels.data());
        return {};
    }
    a.tileCapacity =
        ((width + kSmallestTile - 1) / kSmallestTile + kTileMargins) * ((height + kSmallestTile - 1) / kSmallestTile);
    ARS_TRY_STATUS(reserve(workspace.tiles, inputs.device, 3 * a.tileCapacity * sizeof(float), "occlusion: tiles"));
    a.tiles = static_cast<float*>(workspace.tiles.data());
    return {};
}

/// Everything but the radii and outputs.
Result<OcclusionArguments> prepare(const OcclusionParams& params, const OcclusionInputs& inputs,
                                   OcclusionWorkspace& workspace) {
    ARS_TRY_STATUS(checkInputs(params, inputs));
    OcclusionArguments a;
    a.params = params;
    a.march = marchOf(params, inputs.camera);
    a.depth = inputs.depth.data;
    a.normal = inputs.normal.data;
    a.importance = inputs.importance.data;
    a.bone = inputs.bone.data;
    a.opacity = inputs.opacity.data;
    a.radius[0] = inputs.radius.data;
    a.subset = params.quality == OcclusionQuality::Interactive;
    a.endRow = inputs.camera.height;
    ARS_TRY_STATUS(prepareTables(params, inputs.device, workspace, a.tables));
    ARS_TRY_STATUS(prepareScratch(inputs, workspace, a));
    return a;
}

Status run(const OcclusionArguments& arguments, const Device& device) {
    if (device.kind == DeviceKind::Host) {
        cpu::ambientOcclusion(arguments);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::ambientOcclusion(arguments, device.index);
#else
    return makeError(ErrorCode::Unavailable, std::string(kPlace), "this build has no CUDA kernels");
#endif
}

/// A pass that any caller may count on for ever, brought into [0, 2^20).
int wrappedPass(int pass) { return static_cast<int>(static_cast<unsigned int>(pass) & 0xfffffu); }

} // namespace

const ParameterTable<OcclusionParams>& occlusionParameters() {
    using P = OcclusionParams;
    using enum ParameterTier;
    static const ParameterTable<P> table{
        {"quality", &P::quality, {}, "", Basic, "All directions, or one subset of them while something moves."},
        {"adaptive",
         &P::adaptive,
         {},
         "",
         Advanced,
         "What the importance map makes finer: nothing, both angles, the azimuth."},
        {"strength", &P::strength, {0, 1}, "", Basic, "How much of the occlusion is applied; 1 is all of it."},
        {"delta", &P::delta, {kFinestDelta, 0.5}, "", Advanced, "Angular step in units of pi and pi/2 [delta]."},
        {"alpha", &P::alpha, {0, 7}, "", Advanced, "How much the importance divides the angular step [alpha]."},
        {"steps", &P::steps, {1, 64}, "", Advanced, "Samples lie at multiples of the radius over this many."},
        {"first_step", &P::firstStep, {1, 64}, "", Expert, "First sample that is looked at."},
        {"last_step", &P::lastStep, {1, 64}, "", Expert, "Last sample that is looked at."},
        {"bias", &P::biasM, {-1, 1}, "m", Expert, "A sample this far in front of the surface still counts as hidden."},
        {"bias_per_radius", &P::biasPerRadius, {-1, 1}, "", Expert, "Added to the bias for every metre of radius."},
        {"thickness", &P::thicknessM, {0.001, 1000}, "m", Advanced, "How deep a surface is taken to be."},
        {"depth_factor", &P::depthFactor, {}, "", Expert, "Rays grow by (1 + z/100)^2 with the depth, as in GI-GS."},
        {"median", &P::median, {}, "", Expert, "3x3 median of the positions first, as in GI-GS."},
        {"interactive_directions",
         &P::interactiveDirections,
         {16, 1024},
         "",
         Advanced,
         "Most directions that a pixel takes at interactive quality."},
    };
    return table;
}

OcclusionParams bodyOcclusion() { return {}; }

OcclusionParams referenceOcclusion() {
    OcclusionParams params;
    params.firstStep = 8;
    params.lastStep = 15;
    params.biasM = 0.01f;
    params.biasPerRadius = 0.0f;
    params.thicknessM = 0.05f;
    params.depthFactor = true;
    params.median = true;
    return params;
}

Result<OcclusionParams> occlusionPreset(std::string_view word) {
    if (word == "body") return bodyOcclusion();
    if (word == "reference") return referenceOcclusion();
    return makeError(ErrorCode::NotFound, std::string(kPlace),
                     fmt::format("no preset \"{}\", expected body or reference", word));
}

Status validateOcclusionParams(const OcclusionParams& p) {
    ARS_TRY_STATUS(checkRange("strength", p.strength, 0.0, 1.0));
    ARS_TRY_STATUS(checkRange("delta", p.delta, kFinestDelta, 0.5));
    ARS_TRY_STATUS(checkRange("alpha", p.alpha, 0.0, 7.0));
    ARS_TRY_STATUS(checkRange("steps", p.steps, 1, cpu::kMaxSteps));
    ARS_TRY_STATUS(checkRange("last_step", p.lastStep, 1, p.steps));
    ARS_TRY_STATUS(checkRange("first_step", p.firstStep, 1, p.lastStep));
    ARS_TRY_STATUS(checkRange("bias", p.biasM, -1.0, 1.0));
    ARS_TRY_STATUS(checkRange("bias_per_radius", p.biasPerRadius, -1.0, 1.0));
    ARS_TRY_STATUS(checkRange("interactive_directions", p.interactiveDirections, kOcclusionLanes, 1024));
    if (!(p.thicknessM > 0.0f)) return invalid(fmt::format("thickness is {}, expected more than 0", p.thicknessM));
    if (p.adaptive < OcclusionAdaptive::Off || p.adaptive > OcclusionAdaptive::Azimuth) {
        return invalid(fmt::format("adaptive is {}, expected 0 to 2", static_cast<int>(p.adaptive)));
    }
    return {};
}

Result<OcclusionInputs> occlusionInputs(const GBuffer& gbuffer, const Camera& camera) {
    for (const Channel channel : {Channel::Depth, Channel::Normal, Channel::Radius}) {
        if (!gbuffer[channel].empty()) continue;
        return makeError(ErrorCode::NotFound, std::string(kPlace),
                         fmt::format("the G-buffer has no {}", channelName(channel)));
    }
    OcclusionInputs inputs;
    inputs.device = gbuffer[Channel::Depth].device();
    inputs.camera = camera;
    inputs.depth = gbuffer[Channel::Depth].view();
    inputs.normal = gbuffer[Channel::Normal].view();
    inputs.radius = gbuffer[Channel::Radius].view();
    inputs.importance = gbuffer[Channel::Importance].view();
    inputs.bone = gbuffer[Channel::Bone].view();
    inputs.opacity = gbuffer[Channel::Opacity].view();
    return inputs;
}

Status ambientOcclusion(const OcclusionParams& params, const OcclusionInputs& inputs, OcclusionWorkspace& workspace,
                        ImageView<float> occlusion, int pass) {
    ARS_TRY(OcclusionArguments a, prepare(params, inputs, workspace));
    ARS_TRY_STATUS(checkPicture("occlusion", occlusion, 1, inputs.camera));
    a.occlusion[0] = occlusion.data;
    a.pass = wrappedPass(pass);
    return run(a, inputs.device);
}

Status ambientOcclusionTriple(const OcclusionParams& params, const OcclusionInputs& inputs,
                              ImageView<const float> radiusPlus, ImageView<const float> radiusMinus,
                              OcclusionWorkspace& workspace, ImageView<float> occlusion, ImageView<float> occlusionPlus,
                              ImageView<float> occlusionMinus, int pass) {
    ARS_TRY(OcclusionArguments a, prepare(params, inputs, workspace));
    ARS_TRY_STATUS(checkPicture("radius_plus", radiusPlus, 1, inputs.camera));
    ARS_TRY_STATUS(checkPicture("radius_minus", radiusMinus, 1, inputs.camera));
    ARS_TRY_STATUS(checkPicture("occlusion", occlusion, 1, inputs.camera));
    ARS_TRY_STATUS(checkPicture("occlusion at radius_plus", occlusionPlus, 1, inputs.camera));
    ARS_TRY_STATUS(checkPicture("occlusion at radius_minus", occlusionMinus, 1, inputs.camera));
    a.radii = 3;
    a.radius[1] = radiusPlus.data;
    a.radius[2] = radiusMinus.data;
    a.occlusion[0] = occlusion.data;
    a.occlusion[1] = occlusionPlus.data;
    a.occlusion[2] = occlusionMinus.data;
    a.pass = wrappedPass(pass);
    return run(a, inputs.device);
}

OcclusionDirections occlusionDirections(const OcclusionParams& params, float importance) {
    const OcclusionGrid grid = gridOf(params, importance);
    return {grid.azimuths, grid.polarAngles};
}

int occlusionPasses(const OcclusionParams& params, bool importance) {
    return occlusionSubsets(gridOf(params, importance ? 1.0f : 0.0f), params.interactiveDirections).count();
}

bool OcclusionRefinement::sameInputs(const OcclusionParams& params, const OcclusionInputs& inputs,
                                     std::uint64_t version) const {
    OcclusionParams last = params_;
    last.quality = params.quality;
    last.strength = params.strength; // it is applied to the sums
    return last == params && version == version_ && device_ == inputs.device &&
           importance_ != inputs.importance.empty() && inputs.camera == camera_;
}

Status OcclusionRefinement::refine(const OcclusionParams& params, const OcclusionInputs& inputs, std::uint64_t version,
                                   OcclusionWorkspace& workspace, ImageView<float> occlusion) {
    ARS_TRY(OcclusionArguments a, prepare(params, inputs, workspace));
    ARS_TRY_STATUS(checkPicture("occlusion", occlusion, 1, inputs.camera));
    if (!sameInputs(params, inputs, version)) reset();
    ARS_TRY_STATUS(sums_.reshape(inputs.device, inputs.camera.width, inputs.camera.height, 2, "occlusion: refinement"));
    params_ = params;
    camera_ = inputs.camera;
    device_ = inputs.device;
    importance_ = !inputs.importance.empty();
    version_ = version;
    // A pass has a cost of its own for each pixel: many passes of few directions would take several times as long.
    OcclusionParams larger = params;
    larger.interactiveDirections = std::max(params.interactiveDirections, directions_);
    passes_ = 1 + occlusionPasses(larger, importance_);
    a.subset = true;
    a.occlusion[0] = occlusion.data;
    if (done_ > 0) {
        a.params = larger;
        a.sums = sums_.view().data;
        a.pass = done_ - 1;
    }
    rows_ = inputs.camera.height;
    const bool whole = done_ == 0 || done_ >= passes_ || inputs.device.kind != DeviceKind::Host;
    a.firstRow = whole ? 0 : nextRow_;
    a.endRow = whole ? rows_ : std::min(rows_, nextRow_ + (rows_ + bands_ - 1) / bands_);
    ARS_TRY_STATUS(run(a, inputs.device));
    nextRow_ = a.endRow < rows_ ? a.endRow : 0;
    if (nextRow_ == 0 && done_ < passes_) ++done_;
    return {};
}

void OcclusionRefinement::setSlices(int bands, int directions) {
    bands_ = std::max(1, bands);
    directions = std::clamp(directions, kOcclusionLanes, 1024);
    if (directions != std::exchange(directions_, directions)) reset();
}

Result<OcclusionCost> occlusionCost(const OcclusionParams& params, const OcclusionInputs& inputs) {
    if (inputs.device.kind != DeviceKind::Host) {
        return makeError(ErrorCode::Unsupported, std::string(kPlace), "taps are counted on the host alone");
    }
    OcclusionWorkspace workspace;
    ARS_TRY(const OcclusionArguments a, prepare(params, inputs, workspace));
    return cpu::countTaps(a);
}

} // namespace ars
