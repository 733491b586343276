#include "engine/surfel/splat_gradient.h"

#include "engine/core/parallel.h"
#include "engine/surfel/splat_gradient_math.h"
#include "engine/surfel/splat_kernels.h"

#include <algorithm>
#include <cstring>

namespace ars {

namespace {

using Row = ProjectedSurfel<float>;
using Entry = SplatGradientWorkspace::Entry;

/// Four numbers at once; features are padded to a multiple of that. The compilers' own vectors: any processor.
using Four = float __attribute__((vector_size(16)));
constexpr std::size_t kFour = 4;

Four loadFour(const float* from) {
    Four four;
    std::memcpy(&four, from, sizeof four);
    return four;
}

/// Everything of one call.
struct Job {
    SplatView<float> view;
    SurfelView surfels;
    FeatureLayout layout;
    bool detached[cpu::kMaxFeatureChannels] = {};
    bool anyUnit = false; ///< a channel of unit length is among them
    glm::mat3 rotation;   ///< world to camera
    PointMap points;
    const GBuffer* forward = nullptr;
    const GBufferGradients* gradients = nullptr;
    const std::uint64_t* starts = nullptr;
    const std::uint32_t* listed = nullptr;
    const float* weights = nullptr;
    std::size_t pixels = 0, entries = 0;
    Row* rows = nullptr;
    SplatGradientWorkspace* memory = nullptr;
    SurfelGradients* out = nullptr;

    std::size_t stride() const { return static_cast<std::size_t>(layout.stride); }
    std::size_t pixelStride() const { return stride() + 2; }
    int width() const { return view.camera.width; }
    bool has(Channel channel) const { return !(*gradients)[channel].empty(); }
    const float* gradient(Channel channel, std::size_t pixel) const { return (*gradients)[channel].pixel(pixel); }
    const float* picture(Channel channel, std::size_t pixel) const { return (*forward)[channel].view().pixel(pixel); }
};

Error wrong(std::string message) { return makeError(ErrorCode::InvalidArgument, "splat gradient", std::move(message)); }

Status checkInput(const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                  const ContributorLists& contributors, const GBufferGradients& gradients) {
    ARS_TRY_STATUS(validateCamera(camera, "splat gradient: camera"));
    if (surfels.device.kind != DeviceKind::Host) {
        return makeError(ErrorCode::Unsupported, "splat gradient",
                         "expected surfels in host memory, found them on a device");
    }
    if (forward.width() != camera.width || forward.height() != camera.height) {
        return wrong(fmt::format("the pictures are {}x{}, expected the camera's {}x{}", forward.width(),
                                 forward.height(), camera.width, camera.height));
    }
    if (!contributors.starts.data() ||
        contributors.starts.bytes() < (forward[Channel::Opacity].view().pixelCount() + 1) * sizeof(std::uint64_t)) {
        return wrong("the contributor lists are not those of these pictures");
    }
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        const ImageView<const float>& g = gradients[channel];
        if (g.empty()) continue;
        if (!forward.channels.has(channel)) {
            return wrong(fmt::format("a gradient of {} was given, which was not splatted", channelName(channel)));
        }
        if (g.width != camera.width || g.height != camera.height || g.channels != channelWidth(channel)) {
            return wrong(fmt::format("the gradient of {} is {}x{}x{}, expected {}x{}x{}", channelName(channel), g.width,
                                     g.height, g.channels, camera.width, camera.height, channelWidth(channel)));
        }
    }
    return {};
}

void projectAll(const Job& job) {
    parallelFor(job.surfels.count, [&](std::size_t i) {
        glm::vec3 normal(0.0f);
        PixelRect rect;
        const SurfelFate fate =
            projectSurfel(job.view, job.surfels.means[i], job.surfels.rotations + 4 * i, job.surfels.scales[i],
                          job.surfels.opacities[i], job.rows[i], normal, rect);
        if (fate != SurfelFate::Visible) return; // no list holds it
        packFeatures(job.layout, i, normal, job.rotation, job.memory->features.data() + i * job.stride());
    });
}

/// The pixel's gradients of its sums (features, depth, opacity), before they meet the surfels.
/// @param lengths  |sum| of the unit channels, by source
void pixelSums(const Job& job, std::size_t pixel, float opacity, const float* lengths, float* g) {
    std::fill(g, g + job.pixelStride(), 0.0f);
    float& gDepth = g[job.stride()];
    float& gOpacity = g[job.stride() + 1];
    if (job.has(Channel::Opacity)) gOpacity += *job.gradient(Channel::Opacity, pixel);
    if (!(opacity > kMinOpacity)) return;
    for (int i = 0; i < job.layout.count; ++i) {
        const FeatureSource& source = job.layout.sources[i];
        if (!job.has(source.channel)) continue;
        const float toOpacity =
            normaliseBackward(source.width, source.unit, opacity, lengths[i], job.picture(source.channel, pixel),
                              job.gradient(source.channel, pixel), g + source.offset);
        if (!job.detached[i]) gOpacity += toOpacity;
    }
    float atDepth = job.has(Channel::Depth) ? *job.gradient(Channel::Depth, pixel) : 0.0f;
    if (job.has(Channel::Position)) {
        const float x = static_cast<float>(pixel % static_cast<std::size_t>(job.width())) + 0.5f;
        const float y = static_cast<float>(pixel / static_cast<std::size_t>(job.width())) + 0.5f;
        const glm::vec3 ray = job.points.perX * x + job.points.perY * y + job.points.atZero;
        const float* gp = job.gradient(Channel::Position, pixel);
        atDepth += ray.x * gp[0] + ray.y * gp[1] + ray.z * gp[2];
    }
    if (job.has(Channel::Depth) || job.has(Channel::Position)) {
        const float* depth = job.forward->channels.has(Channel::Depth) ? job.picture(Channel::Depth, pixel) : nullptr;
        float value = 0.0f;
        if (depth) value = *depth;
        gDepth = atDepth / opacity;
        gOpacity -= atDepth * value / opacity;
    }
}

/// |sum| of the unit channels of a pixel, by source; the others stay as they are.
void unitLengths(const Job& job, std::size_t begin, std::size_t end, float* lengths) {
    if (!job.anyUnit) return;
    float sums[cpu::kMaxFeatureChannels][3] = {};
    for (std::size_t e = begin; e < end; ++e) {
        const float* features = job.memory->features.data() + job.listed[e] * job.stride();
        for (int i = 0; i < job.layout.count; ++i) {
            if (!job.layout.sources[i].unit) continue;
            for (int c = 0; c < 3; ++c) sums[i][c] += job.weights[e] * features[job.layout.sources[i].offset + c];
        }
    }
    for (int i = 0; i < job.layout.count; ++i) {
        lengths[i] = std::sqrt(sums[i][0] * sums[i][0] + sums[i][1] * sums[i][1] + sums[i][2] * sums[i][2]);
    }
}

float dotOf(const float* a, const float* b, std::size_t count) {
    Four sum = {};
    for (std::size_t c = 0; c < count; c += kFour) sum += loadFour(a + c) * loadFour(b + c);
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

template <SurfelKernel Kernel, DepthMode Depth>
void backwardPixel(const Job& job, std::size_t pixel, std::vector<float>& transmittances) {
    const std::size_t begin = job.starts[pixel], end = job.starts[pixel + 1], count = end - begin;
    float* g = job.memory->pixelGradients.data() + pixel * job.pixelStride();
    if (count == 0) return;
    float lengths[cpu::kMaxFeatureChannels] = {};
    unitLengths(job, begin, end, lengths);
    pixelSums(job, pixel, *job.picture(Channel::Opacity, pixel), lengths, g);

    // What reaches geometry: a copy without the detached channels.
    float attached[cpu::kMaxFeatures];
    std::memcpy(attached, g, job.stride() * sizeof(float));
    for (int i = 0; i < job.layout.count; ++i) {
        const FeatureSource& source = job.layout.sources[i];
        if (job.detached[i]) std::fill(attached + source.offset, attached + source.offset + source.width, 0.0f);
    }
    const auto width = static_cast<std::size_t>(job.width());
    const float x = static_cast<float>(pixel % width) + 0.5f, y = static_cast<float>(pixel / width) + 0.5f;
    const float gDepth = g[job.stride()], gOpacity = g[job.stride() + 1];
    const float* weights = job.weights + begin;
    if (transmittances.size() < count) transmittances.resize(count);
    float transmittance = 1.0f;
    for (std::size_t k = 0; k < count; ++k) {
        transmittances[k] = transmittance;
        transmittance -= weights[k];
    }
    float suffix = 0.0f;
    for (std::size_t k = count; k-- > 0;) {
        const std::uint32_t surfel = job.listed[begin + k];
        float h = gOpacity;
        h += dotOf(attached, job.memory->features.data() + surfel * job.stride(), job.stride());
        if (gDepth != 0.0f) {
            const Row& row = job.rows[surfel];
            h += gDepth * depthAt<Kernel, Depth>(row, x - row.u, y - row.v);
        }
        // The forward pass took the same product and the same differences: alpha is the quotient up to its rounding,
        // and a clamped one is met exactly.
        const bool clamped = weights[k] >= transmittances[k] * static_cast<float>(kMaxAlpha);
        const float alpha = weights[k] / transmittances[k];
        job.memory->alphaGradients[begin + k] = clamped ? 0.0f : alphaBackward(alpha, weights[k], h, suffix);
        suffix += weights[k] * h;
    }
}

template <SurfelKernel Kernel, DepthMode Depth>
void backwardPixels(const Job& job) {
    parallelRanges(job.pixels, 512, [&](std::size_t begin, std::size_t end) {
        std::vector<float> transmittances;
        for (std::size_t pixel = begin; pixel < end; ++pixel) backwardPixel<Kernel, Depth>(job, pixel, transmittances);
    });
}

/// Entries by surfel, those of a surfel in the order of pixels: what makes the sums below independent of threads.
void transpose(const Job& job) {
    SplatGradientWorkspace& m = *job.memory;
    const std::size_t n = job.surfels.count;
    const std::size_t chunks = std::clamp<std::size_t>(job.entries / 65536, 1, 16);
    const std::size_t size = (job.pixels + chunks - 1) / chunks;
    m.counts.assign(chunks * n, 0);
    const auto range = [&](std::size_t c, auto&& visit) {
        for (std::size_t p = c * size; p < std::min(job.pixels, (c + 1) * size); ++p) {
            for (std::size_t e = job.starts[p]; e < job.starts[p + 1]; ++e) visit(p, e);
        }
    };
    parallelFor(
        chunks,
        [&](std::size_t c) { range(c, [&](std::size_t, std::size_t e) { ++m.counts[c * n + job.listed[e]]; }); }, 1);
    m.surfelStarts.resize(n + 1);
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < n; ++i) {
        m.surfelStarts[i] = sum;
        std::uint32_t before = 0;
        for (std::size_t c = 0; c < chunks; ++c) {
            const std::uint32_t count = m.counts[c * n + i];
            m.counts[c * n + i] = before;
            before += count;
        }
        sum += before;
    }
    m.surfelStarts[n] = sum;
    m.surfelEntries.resize(job.entries);
    parallelFor(
        chunks,
        [&](std::size_t c) {
            const auto width = static_cast<std::uint32_t>(job.width());
            range(c, [&](std::size_t p, std::size_t e) {
                const std::uint32_t surfel = job.listed[e], pixel = static_cast<std::uint32_t>(p);
                m.surfelEntries[m.surfelStarts[surfel] + m.counts[c * n + surfel]++] = {
                    static_cast<std::uint16_t>(pixel % width), static_cast<std::uint16_t>(pixel / width),
                    m.alphaGradients[e], job.weights[e]};
            });
        },
        1);
}

/// Where a feature's gradient goes, or null.
float* target(SurfelGradients& out, Channel channel) {
    const auto floats = [](auto& values) { return values.empty() ? nullptr : reinterpret_cast<float*>(values.data()); };
    switch (channel) {
    case Channel::Radiance:
        return floats(out.colors);
    case Channel::Albedo:
        return floats(out.albedos);
    case Channel::Roughness:
        return floats(out.roughnesses);
    case Channel::Radius:
        return floats(out.radii);
    case Channel::RadiusPlus:
        return floats(out.radiiPlus);
    case Channel::RadiusMinus:
        return floats(out.radiiMinus);
    case Channel::Importance:
        return floats(out.importances);
    case Channel::Bone:
        return floats(out.bones);
    default:
        return nullptr;
    }
}

/// sum over a surfel's pixels of w dL/dSum, for Groups times four features: the sums stay in registers.
template <std::size_t Groups>
void sumFeatures(const Job& job, const Entry* begin, const Entry* end, float* features) {
    const auto width = static_cast<std::size_t>(job.width());
    Four sums[Groups] = {};
    for (const Entry* e = begin; e != end; ++e) {
        const float* g = job.memory->pixelGradients.data() + (e->y * width + e->x) * job.pixelStride();
        for (std::size_t k = 0; k < Groups; ++k) sums[k] += e->weight * loadFour(g + kFour * k);
    }
    std::memcpy(features, sums, sizeof sums);
}

using FeatureSum = void (*)(const Job&, const Entry*, const Entry*, float*);
constexpr FeatureSum kFeatureSums[] = {sumFeatures<1>, sumFeatures<2>, sumFeatures<3>, sumFeatures<4>, sumFeatures<5>};
static_assert(cpu::kMaxFeatures == 5 * kFour);

template <SurfelKernel Kernel, DepthMode Depth>
void backwardSurfel(const Job& job, std::size_t surfel) {
    const SplatGradientWorkspace& m = *job.memory;
    const Entry* begin = m.surfelEntries.data() + m.surfelStarts[surfel];
    const Entry* end = m.surfelEntries.data() + m.surfelStarts[surfel + 1];
    if (begin == end) return;
    const Row row = job.rows[surfel];
    const auto width = static_cast<std::size_t>(job.width());
    const bool depth = job.has(Channel::Depth) || job.has(Channel::Position);
    ProjectedGradient<float> g;
    for (const Entry* e = begin; e != end; ++e) {
        const float dx = static_cast<float>(e->x) + 0.5f - row.u, dy = static_cast<float>(e->y) + 0.5f - row.v;
        log2AlphaBackward<Kernel>(row, dx, dy, e->alphaGradient, g);
        if (!depth) continue;
        const float gDepth = m.pixelGradients[(e->y * width + e->x) * job.pixelStride() + job.stride()];
        depthBackward<Kernel, Depth>(row, dx, dy, e->weight * gDepth, g);
    }
    float features[cpu::kMaxFeatures] = {};
    if (job.stride() > 0) kFeatureSums[job.stride() / kFour - 1](job, begin, end, features);
    glm::vec3 normal(0.0f);
    for (int i = 0; i < job.layout.count; ++i) {
        const FeatureSource& source = job.layout.sources[i];
        const float* value = features + source.offset;
        if (source.channel == Channel::Normal) {
            normal = {value[0], value[1], value[2]};
            continue;
        }
        float* to = target(*job.out, source.channel);
        if (!to) continue;
        if (source.width == 1) {
            to[surfel] = value[0];
            continue;
        }
        glm::vec3 turned(value[0], value[1], value[2]);
        if (source.turned) turned = glm::transpose(job.rotation) * turned;
        for (int c = 0; c < 3; ++c) to[3 * surfel + static_cast<std::size_t>(c)] = turned[c];
    }
    SurfelGeometryGradient<float> geometry;
    projectSurfelBackward(job.view, job.surfels.means[surfel], job.surfels.rotations + 4 * surfel,
                          job.surfels.scales[surfel], job.surfels.opacities[surfel], row, g, normal, geometry);
    job.out->means[surfel] = geometry.mean;
    std::copy(geometry.rotation, geometry.rotation + 4,
              job.out->rotations.begin() + static_cast<std::ptrdiff_t>(4 * surfel));
    job.out->scales[surfel] = geometry.scale;
    job.out->opacities[surfel] = geometry.opacity;
}

template <SurfelKernel Kernel, DepthMode Depth>
void run(const Job& job) {
    backwardPixels<Kernel, Depth>(job);
    transpose(job);
    parallelFor(job.surfels.count, [&](std::size_t i) { backwardSurfel<Kernel, Depth>(job, i); }, 64);
}

void resizeOutputs(const Job& job, SurfelGradients& out) {
    const std::size_t n = job.surfels.count;
    out.means.assign(n, glm::vec3(0.0f));
    out.rotations.assign(4 * n, 0.0f);
    out.scales.assign(n, glm::vec2(0.0f));
    out.opacities.assign(n, 0.0f);
    const auto sized = [&](Channel channel) { return job.has(channel) ? n : std::size_t{0}; };
    out.colors.assign(sized(Channel::Radiance), glm::vec3(0.0f));
    out.albedos.assign(sized(Channel::Albedo), glm::vec3(0.0f));
    out.roughnesses.assign(sized(Channel::Roughness), 0.0f);
    out.radii.assign(sized(Channel::Radius), 0.0f);
    out.radiiPlus.assign(sized(Channel::RadiusPlus), 0.0f);
    out.radiiMinus.assign(sized(Channel::RadiusMinus), 0.0f);
    out.importances.assign(sized(Channel::Importance), 0.0f);
    out.bones.assign(sized(Channel::Bone), glm::vec3(0.0f));
}

} // namespace

Status splatBackward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                     const ContributorLists& contributors, const GBufferGradients& gradients,
                     SplatGradientWorkspace& workspace, SurfelGradients& out, const SplatBackwardParams& options) {
    ARS_TRY_STATUS(checkInput(surfels, camera, forward, contributors, gradients));
    if (!gradients[Channel::Position].empty() && !forward.channels.has(Channel::Depth)) {
        return wrong("a gradient of position needs the depth picture");
    }
    ChannelSet wanted;
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        if (!gradients[channel].empty()) wanted.add(channel);
    }
    Job job;
    job.view = splatView(camera.as<float>(), params.kernel, params.twoSided, params.depth);
    job.surfels = surfels;
    job.layout = featureLayout(surfels, wanted);
    for (int i = 0; i < job.layout.count; ++i) {
        job.detached[i] = options.detached.has(job.layout.sources[i].channel);
        job.anyUnit = job.anyUnit || job.layout.sources[i].unit;
    }
    job.rotation = job.view.camera.rotation;
    job.points = pointMap(camera);
    job.forward = &forward;
    job.gradients = &gradients;
    job.starts = static_cast<const std::uint64_t*>(contributors.starts.data());
    job.listed = static_cast<const std::uint32_t*>(contributors.surfels.data());
    job.weights = static_cast<const float*>(contributors.weights.data());
    job.pixels = forward[Channel::Opacity].view().pixelCount();
    job.entries = contributors.entries;
    job.memory = &workspace;
    job.out = &out;
    if (job.entries > 0xffffffffu) {
        return makeError(ErrorCode::LimitExceeded, "splat gradient",
                         fmt::format("{} pairs of surfel and pixel, at most 2^32 - 1 are possible", job.entries));
    }
    workspace.rows.resize(surfels.count * sizeof(Row));
    workspace.features.resize(surfels.count * job.stride());
    workspace.pixelGradients.resize(job.pixels * job.pixelStride());
    workspace.alphaGradients.resize(job.entries);
    job.rows = reinterpret_cast<Row*>(workspace.rows.data());
    resizeOutputs(job, out);
    projectAll(job);
    if (params.kernel == SurfelKernel::RaySplat) {
        run<SurfelKernel::RaySplat, DepthMode::Exact>(job);
    } else if (params.depth == DepthMode::Exact) {
        run<SurfelKernel::GaussianSurfel, DepthMode::Exact>(job);
    } else {
        run<SurfelKernel::GaussianSurfel, DepthMode::Linear>(job);
    }
    return {};
}

} // namespace ars
