#include "engine/surfel/splat.h"

#include "engine/surfel/splat_kernels.h"

#include <fmt/format.h>

#include <limits>

namespace ars {

const ParameterTable<SplatParams>& splatParameters() {
    static const ParameterTable<SplatParams> table{
        {"kernel",
         &SplatParams::kernel,
         {},
         "",
         ParameterTier::Advanced,
         "How a surfel spreads over the picture: as an affine Gaussian, or where each ray meets its disc (2DGS)."},
        {"depth",
         &SplatParams::depth,
         {},
         "",
         ParameterTier::Expert,
         "Depth of a Gaussian surfel at a pixel: the published first-order plane, or the exact one."},
        {"two_sided",
         &SplatParams::twoSided,
         {},
         "",
         ParameterTier::Advanced,
         "Shows Gaussian surfels from behind as well."},
    };
    return table;
}

std::string_view surfelFateName(SurfelFate fate) {
    static constexpr std::array<std::string_view, kSurfelFateCount> kNames{
        "visible", "not_finite", "degenerate", "transparent", "too_near", "back_facing", "grazing", "outside_picture"};
    return kNames[static_cast<std::size_t>(fate)];
}

SplatWorkspace::SplatWorkspace() : memory_(std::make_unique<Memory>()) {}
SplatWorkspace::~SplatWorkspace() = default;
SplatWorkspace::SplatWorkspace(SplatWorkspace&&) noexcept = default;
SplatWorkspace& SplatWorkspace::operator=(SplatWorkspace&&) noexcept = default;

void SplatWorkspace::clear() {
    const CpuPath path = memory_->path;
    memory_ = std::make_unique<Memory>();
    memory_->path = path;
}

void SplatWorkspace::setCpuPath(CpuPath path) { memory_->path = path; }

bool SplatWorkspace::incomplete() const {
#ifdef ARS_HAVE_CUDA
    return memory_->cuda && cuda::lastFrameIncomplete(*memory_->cuda);
#else
    return false;
#endif
}

#ifndef ARS_HAVE_CUDA
void CudaSplatStateDelete::operator()(CudaSplatState*) const {}
#endif

Status growBuffer(Buffer& buffer, const Device& device, std::size_t bytes, std::string_view owner) {
    if (buffer.data() && buffer.device() == device && buffer.bytes() >= bytes) return {};
    buffer = Buffer(); // the old memory goes first: both need not fit at once
    ARS_TRY(buffer, Buffer::allocate(device, bytes > 0 ? bytes : 1, owner));
    return {};
}

PointMap pointMap(const Camera& camera) {
    const glm::dmat3 toWorld = glm::transpose(camera.rotation);
    return {glm::vec3(camera.centerWorld()), glm::vec3(toWorld * glm::dvec3(1.0 / camera.fx, 0.0, 0.0)),
            glm::vec3(toWorld * glm::dvec3(0.0, 1.0 / camera.fy, 0.0)),
            glm::vec3(toWorld * glm::dvec3(-camera.cx / camera.fx, -camera.cy / camera.fy, 1.0))};
}

namespace cpu {
namespace {
bool processorHas(CpuPath path) {
#if defined(__x86_64__) || defined(__i386__)
    if (path == CpuPath::Avx512) {
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
               __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
    }
    if (path == CpuPath::Avx2) return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif
    return path == CpuPath::Portable;
}
} // namespace

TileFunctions tileFunctionsOf(CpuPath path) {
    const bool best = path == CpuPath::Best;
    if ((best || path == CpuPath::Avx512) && processorHas(CpuPath::Avx512) && avx512TileFunctions().blend) {
        return avx512TileFunctions();
    }
    if (path != CpuPath::Portable && processorHas(CpuPath::Avx2) && avx2TileFunctions().blend) {
        return avx2TileFunctions();
    }
    return portableTileFunctions();
}
} // namespace cpu

std::vector<CpuPath> availableCpuPaths() {
    std::vector<CpuPath> paths{CpuPath::Portable};
    if (cpu::processorHas(CpuPath::Avx2) && cpu::avx2TileFunctions().blend) paths.push_back(CpuPath::Avx2);
    if (cpu::processorHas(CpuPath::Avx512) && cpu::avx512TileFunctions().blend) paths.push_back(CpuPath::Avx512);
    return paths;
}

namespace {

/// Channels that blend an attribute of the surfels.
struct AttributeRow {
    Channel channel;
    std::string_view attribute;
    const float* data;
};

std::array<AttributeRow, 8> attributesOf(const SurfelView& s) {
    auto floats = [](const glm::vec3* values) { return reinterpret_cast<const float*>(values); };
    return {{{Channel::Radiance, "colors", floats(s.colors)},
             {Channel::Albedo, "albedos", floats(s.albedos)},
             {Channel::Roughness, "roughnesses", s.roughnesses},
             {Channel::Radius, "radii", s.radii},
             {Channel::RadiusPlus, "radiiPlus", s.radiiPlus},
             {Channel::RadiusMinus, "radiiMinus", s.radiiMinus},
             {Channel::Importance, "importances", s.importances},
             {Channel::Bone, "bones", floats(s.bones)}}};
}

Error wrong(std::string message) { return makeError(ErrorCode::InvalidArgument, "splat", std::move(message)); }

Status checkInput(const SurfelView& surfels, const Camera& camera, const ChannelSet& channels) {
    ARS_TRY_STATUS(validateCamera(camera, "splat: camera"));
    if (surfels.count > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
        return makeError(ErrorCode::LimitExceeded, "splat",
                         fmt::format("{} surfels, at most {} are possible", surfels.count,
                                     std::numeric_limits<std::int32_t>::max()));
    }
    if (surfels.count == 0) return {};
    auto required = [](std::string_view name, const void* data) -> Status {
        if (data) return {};
        return wrong(fmt::format("the surfels have no {}, expected an array (null pointer)", name));
    };
    ARS_TRY_STATUS(required("means", surfels.means));
    ARS_TRY_STATUS(required("rotations", surfels.rotations));
    ARS_TRY_STATUS(required("scales", surfels.scales));
    ARS_TRY_STATUS(required("opacities", surfels.opacities));
    for (const AttributeRow& row : attributesOf(surfels)) {
        if (!channels.has(row.channel) || row.data) continue;
        return wrong(fmt::format("the channel {} is asked for, but the surfels have no {}", channelName(row.channel),
                                 row.attribute));
    }
    return {};
}

} // namespace

FeatureLayout featureLayout(const SurfelView& surfels, const ChannelSet& channels) {
    FeatureLayout layout;
    auto add = [&](Channel channel, const float* data) {
        FeatureSource& source = layout.sources[layout.count++];
        source = {data, channelWidth(channel), layout.floats, channel == Channel::Bone, false, channel};
        source.unit = channel == Channel::Bone || channel == Channel::Normal;
        layout.floats += source.width;
    };
    if (channels.has(Channel::Normal)) add(Channel::Normal, nullptr);
    for (const AttributeRow& row : attributesOf(surfels)) {
        if (channels.has(row.channel)) add(row.channel, row.data);
    }
    layout.stride = (layout.floats + 3) / 4 * 4;
    return layout;
}

namespace {

Status reshapePictures(const Device& device, const Camera& camera, const ChannelSet& channels, GBuffer& gbuffer) {
    gbuffer.channels = {};
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        PixelBuffer& picture = gbuffer[channel];
        if (!channels.has(channel)) {
            picture = PixelBuffer();
            continue;
        }
        ARS_TRY_STATUS(picture.reshape(device, camera.width, camera.height, channelWidth(channel),
                                       fmt::format("splat: {} picture", channelName(channel))));
    }
    gbuffer.channels = channels;
    return {};
}

Status dispatch(const SplatArguments& arguments) {
    if (arguments.surfels.device.kind == DeviceKind::Host) return cpu::splat(arguments);
#ifdef ARS_HAVE_CUDA
    return cuda::splat(arguments);
#else
    return makeError(ErrorCode::Unavailable, "splat", "this build has no CUDA kernels");
#endif
}

} // namespace

Status splat(const SplatParams& params, const SurfelView& surfels, const Camera& camera, ChannelSet channels,
             GBuffer& gbuffer, SplatWorkspace& workspace, ContributorLists* contributors, SplatStats* stats) {
    gbuffer.channels = {};
    channels.add(Channel::Opacity);
    ARS_TRY_STATUS(checkInput(surfels, camera, channels));
    ARS_TRY_STATUS(reshapePictures(surfels.device, camera, channels, gbuffer));
    SplatArguments arguments;
    arguments.params = params;
    arguments.surfels = surfels;
    arguments.view = splatView(camera.as<float>(), params.kernel, params.twoSided, params.depth);
    arguments.points = pointMap(camera);
    arguments.features = featureLayout(surfels, channels);
    arguments.gbuffer = &gbuffer;
    arguments.memory = &workspace.memory();
    arguments.contributors = contributors;
    arguments.stats = stats;
    Status status = dispatch(arguments);
    if (!status) gbuffer.channels = {};
    return status;
}

} // namespace ars
