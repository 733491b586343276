#include "engine/surfel/splat_gradient.h"

#include "engine/surfel/splat_gradient_kernels.h"

#include <fmt/format.h>

#include <type_traits>

namespace ars {

namespace {

Error wrong(std::string message) { return makeError(ErrorCode::InvalidArgument, "splat gradient", std::move(message)); }

#ifndef ARS_HAVE_CUDA
Error noKernels() { return makeError(ErrorCode::Unavailable, "splat gradient", "this build has no CUDA kernels"); }
#endif

Status checkDevice(const Device& expected, std::string_view what, const Device& found) {
    if (found == expected) return {};
    return wrong(fmt::format("{} lie on {}, expected the surfels' {}", what, deviceName(found), deviceName(expected)));
}

Status checkLists(const SurfelView& surfels, const GBuffer& forward, const ContributorLists* lists) {
    if (!lists) {
        if (surfels.device.kind == DeviceKind::Host) return {};
        return wrong("there are no contributor lists, which CUDA needs");
    }
    if (!lists->starts.data() ||
        lists->starts.bytes() < (forward[Channel::Opacity].view().pixelCount() + 1) * sizeof(std::uint64_t)) {
        return wrong("the contributor lists are not those of these pictures");
    }
    return checkDevice(surfels.device, "the contributor lists", lists->starts.device());
}

Status checkGradients(const Camera& camera, const GBuffer& forward, const GBufferGradients& gradients) {
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
    if (!gradients[Channel::Position].empty() && !forward.channels.has(Channel::Depth)) {
        return wrong("a gradient of position needs the depth picture");
    }
    return {};
}

Status checkInput(const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                  const ContributorLists* contributors, const GBufferGradients& gradients) {
    ARS_TRY_STATUS(validateCamera(camera, "splat gradient: camera"));
    if (forward.width() != camera.width || forward.height() != camera.height) {
        return wrong(fmt::format("the pictures are {}x{}, expected the camera's {}x{}", forward.width(),
                                 forward.height(), camera.width, camera.height));
    }
    ARS_TRY_STATUS(checkDevice(surfels.device, "the pictures", forward[Channel::Opacity].device()));
    ARS_TRY_STATUS(checkLists(surfels, forward, contributors));
    return checkGradients(camera, forward, gradients);
}

GradientPictures gradientPictures(const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                                  const GBufferGradients& gradients, const SplatBackwardParams& options) {
    GradientPictures pictures;
    ChannelSet wanted;
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        if (forward.channels.has(channel)) pictures.values[i] = forward[channel].view();
        pictures.gradients[i] = gradients[channel];
        if (!gradients[channel].empty()) wanted.add(channel);
    }
    pictures.layout = featureLayout(surfels, wanted);
    pictures.columns = pictures.layout.stride;
    for (int i = 0; i < pictures.layout.count; ++i) {
        pictures.detached[i] = options.detached.has(pictures.layout.sources[i].channel);
        pictures.anyUnit = pictures.anyUnit || pictures.layout.sources[i].unit;
    }
    pictures.depth = wanted.has(Channel::Depth) || wanted.has(Channel::Position);
    pictures.points = pointMap(camera);
    pictures.width = camera.width;
    pictures.height = camera.height;
    return pictures;
}

} // namespace

SurfelGradientArrays prepareOutputs(std::size_t n, const GBufferGradients& gradients, SurfelGradients& out) {
    const auto floats = [](auto& values) { return values.empty() ? nullptr : reinterpret_cast<float*>(values.data()); };
    out.means.assign(n, glm::vec3(0.0f));
    out.rotations.assign(4 * n, 0.0f);
    out.scales.assign(n, glm::vec2(0.0f));
    out.opacities.assign(n, 0.0f);
    SurfelGradientArrays arrays{
        floats(out.means), floats(out.rotations), floats(out.scales), floats(out.opacities), {}};
    const auto add = [&](Channel channel, auto& values) {
        using Value = typename std::remove_reference_t<decltype(values)>::value_type;
        values.assign(gradients[channel].empty() ? std::size_t{0} : n, Value(0.0f));
        arrays.attributes[static_cast<int>(channel)] = floats(values);
    };
    add(Channel::Radiance, out.colors);
    add(Channel::Albedo, out.albedos);
    add(Channel::Roughness, out.roughnesses);
    add(Channel::Radius, out.radii);
    add(Channel::RadiusPlus, out.radiiPlus);
    add(Channel::RadiusMinus, out.radiiMinus);
    add(Channel::Importance, out.importances);
    add(Channel::Bone, out.bones);
    return arrays;
}

Result<SplatBackwardArguments> backwardArguments(const SplatParams& params, const SurfelView& surfels,
                                                 const Camera& camera, const GBuffer& forward,
                                                 const ContributorLists* contributors,
                                                 const GBufferGradients& gradients, SplatGradientWorkspace& workspace,
                                                 const SurfelGradientArrays& out, const SplatBackwardParams& options) {
    ARS_TRY_STATUS(checkInput(surfels, camera, forward, contributors, gradients));
    SplatBackwardArguments arguments;
    arguments.params = params;
    arguments.surfels = surfels;
    arguments.view = splatView(camera.as<float>(), params.kernel, params.twoSided, params.depth);
    arguments.pictures = gradientPictures(surfels, camera, forward, gradients, options);
    arguments.splatted = forward.channels;
    arguments.contributors = contributors;
    arguments.workspace = &workspace;
    arguments.out = out;
    return arguments;
}

Status splatBackward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                     const ContributorLists* contributors, const GBufferGradients& gradients,
                     SplatGradientWorkspace& workspace, SurfelGradients& out, const SplatBackwardParams& options) {
    // Checked before `out` is touched.
    ARS_TRY(SplatBackwardArguments arguments,
            backwardArguments(params, surfels, camera, forward, contributors, gradients, workspace, {}, options));
    arguments.out = prepareOutputs(surfels.count, gradients, out);
    if (surfels.device.kind == DeviceKind::Host) return cpu::splatBackward(arguments);
#ifdef ARS_HAVE_CUDA
    return cuda::splatBackwardToHost(arguments, arguments.out);
#else
    return noKernels();
#endif
}

Status splatBackward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, const GBuffer& forward,
                     const ContributorLists* contributors, const GBufferGradients& gradients,
                     SplatGradientWorkspace& workspace, const SurfelGradientArrays& out,
                     const SplatBackwardParams& options) {
    if (surfels.count > 0 && (!out.means || !out.rotations || !out.scales || !out.opacities)) {
        return wrong("the gradients of means, rotations, scales and opacities need an array each");
    }
    ARS_TRY(const SplatBackwardArguments arguments,
            backwardArguments(params, surfels, camera, forward, contributors, gradients, workspace, out, options));
    if (surfels.device.kind == DeviceKind::Host) return cpu::splatBackward(arguments);
#ifdef ARS_HAVE_CUDA
    return cuda::splatBackward(arguments);
#else
    return noKernels();
#endif
}

} // namespace ars
