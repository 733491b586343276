#include "app/stage.h"

#include "app/progress_bar.h"
#include "app/rig_source.h"
#include "app/text.h"
#include "engine/capture/calibration.h"
#include "engine/frame/light_source.h"
#include "engine/maps/position_maps.h"
#include "engine/occlusion/ambient_occlusion.h"
#include "engine/rig/motion_import.h"
#include "engine/shade/shading.h"
#include "engine/surfel/splat.h"
#include "engine/surfel/surfel_ply.h"

#include <fmt/format.h>

#include <chrono>
#include <functional>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

using Clock = std::chrono::steady_clock;

double millisecondsSince(Clock::time_point begin) {
    return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

Error wrongUsage(std::string option, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(option), std::move(message));
}

Result<Camera> requiredCamera(const StageOptions& options) {
    if (options.camera.empty()) {
        return wrongUsage("--camera", "this stage needs a camera: CAMERA.json or CALIBRATION.json:NAME");
    }
    ARS_TRY(const CalibratedCamera read, readCameraArgument(options.camera));
    ARS_TRY_STATUS(validateCamera(read.camera, options.camera));
    return read.camera;
}

/// A picture on a device, or none.
struct DevicePicture {
    PixelBuffer memory;
    ImageView<const float> view() const { return memory.empty() ? ImageView<const float>{} : memory.view(); }
};

Result<DevicePicture> toDevice(const Image& image, const Device& device) {
    DevicePicture picture;
    ARS_TRY(picture.memory, PixelBuffer::allocate(device, image.width, image.height, image.channels, "stage"));
    ARS_TRY_STATUS(uploadBuffer(picture.memory.memory(), std::as_bytes(std::span(image.pixels))));
    return picture;
}

Result<Image> toHost(const PixelBuffer& buffer) {
    Image image;
    image.width = buffer.width();
    image.height = buffer.height();
    image.channels = buffer.channels();
    image.space = ColorSpace::Data;
    image.pixels.resize(buffer.view().valueCount());
    ARS_TRY_STATUS(downloadBuffer(std::as_writable_bytes(std::span(image.pixels)), buffer.memory()));
    return image;
}

/// The layers of a stage's input, checked against the camera and brought to the device.
class LayerReader {
public:
    LayerReader(fs::path path, ExrImage exr, const Camera& camera, const Device& device)
        : path_(std::move(path)), exr_(std::move(exr)), camera_(camera), device_(device) {}

    bool has(BufferId id) const {
        const std::string name(bufferInfo(id).name);
        const auto layers = exrLayers(exr_);
        return std::find(layers.begin(), layers.end(), name) != layers.end();
    }

    Result<Image> image(BufferId id) const {
        const BufferInfo& info = bufferInfo(id);
        auto layer = exrLayer(exr_, info.name);
        if (!layer) {
            return makeError(
                layer.error().code, path_.string(),
                fmt::format("no usable layer {}.{{{}}}: {}", info.name, info.letters, layer.error().message));
        }
        if (layer->channels != info.channels()) {
            return makeError(ErrorCode::BadFile, path_.string(),
                             fmt::format("layer {} has {}, expected {}", info.name,
                                         counted(static_cast<std::uint64_t>(layer->channels), "channel"),
                                         info.channels()));
        }
        if (layer->width != camera_.width || layer->height != camera_.height) {
            return makeError(ErrorCode::BadFile, path_.string(),
                             fmt::format("the picture is {}x{}, the camera {}x{}", layer->width, layer->height,
                                         camera_.width, camera_.height));
        }
        return layer;
    }

    Result<DevicePicture> picture(BufferId id) const {
        ARS_TRY(const Image host, image(id));
        return toDevice(host, device_);
    }
    Result<DevicePicture> optional(BufferId id) const {
        if (!has(id)) return DevicePicture{};
        return picture(id);
    }

private:
    fs::path path_;
    ExrImage exr_;
    Camera camera_;
    Device device_;
};

Result<LayerReader> openLayers(const StageOptions& options, const Camera& camera, const Device& device) {
    ARS_TRY(ExrImage exr, readExr(options.input));
    return LayerReader(options.input, std::move(exr), camera, device);
}

void report(const StageOptions& options, const Json& facts, const std::string& sentence) {
    if (options.output.json) {
        Json json{{"file", options.out}};
        json.update(facts);
        return printJson(json);
    }
    fmt::print("{}: {}\n", printable(options.out), sentence);
}

Json stageDocument(const StageOptions& options, std::string_view stage) {
    return Json{{"program", fmt::format("ars {}", ARS_VERSION)}, {"stage", stage}, {"input", options.input}};
}

int finish(const Status& status, const OutputOptions& output) {
    return status.ok() ? kSuccess : reportError(status.error(), output);
}

// --- maps ---

Result<Pose> readMapPose(const StageOptions& options, const Skeleton& skeleton) {
    if (options.pose.empty() || options.pose == "canonical") return canonicalPose();
    if (options.pose == "rest") return restPose(skeleton.jointCount());
    MotionImportOptions import;
    import.skipLeadIn = false;
    ARS_TRY(Motion motion, importMotion(options.pose, skeleton, import));
    if (const Status cut = cutFrames(motion, {options.poseFrame, options.poseFrame + 1}); !cut) {
        return atPlace(cut.error(), options.pose);
    }
    return motion.frames.front();
}

Status addMapLayer(ExrImage& exr, const CanonicalMaps& maps, std::string_view name, std::span<const float> values,
                   int channels, std::string_view letters) {
    Image picture;
    picture.width = 2 * maps.size;
    picture.height = maps.size;
    picture.channels = channels;
    picture.space = ColorSpace::Data;
    picture.pixels.resize(maps.pixelCount() * static_cast<std::size_t>(channels));
    ARS_TRY_STATUS(spreadPicture(maps, values, {picture.pixels.data(), picture.width, picture.height, channels}));
    return addExrLayer(exr, name, picture, letters, ExrPixelType::Float);
}

std::span<const float> numbers(const std::vector<glm::vec3>& vectors) { return {&vectors[0].x, 3 * vectors.size()}; }

/// |d|, the direction d/|d| and |s| out of the five numbers of a point.
Status addPriorLayers(ExrImage& exr, const CanonicalMaps& maps, const std::vector<float>& priors) {
    std::vector<float> length, direction, distance;
    for (std::size_t p = 0; p < maps.pointCount(); ++p) {
        length.push_back(priors[5 * p]);
        for (std::size_t c = 1; c < 4; ++c) direction.push_back(priors[5 * p + c]);
        distance.push_back(priors[5 * p + 4]);
    }
    ARS_TRY_STATUS(addMapLayer(exr, maps, "deformation", length, 1, "Y"));
    ARS_TRY_STATUS(addMapLayer(exr, maps, "deformation_direction", direction, 3, "XYZ"));
    return addMapLayer(exr, maps, "body_distance", distance, 1, "Y");
}

Status stageMaps(const StageOptions& options, ProgressBar& bar) {
    ARS_TRY(const BodyModel body, loadBody("open"));
    TemplateMesh mesh = templateFromBody(body);
    if (options.input != "open") {
        ARS_TRY(mesh, readTemplate(options.input, body, {}, {}, bar.part(0.0, 0.5)));
    }
    CanonicalMapOptions mapOptions;
    mapOptions.size = options.mapSize;
    mapOptions.centerM = canonicalCenter(body);
    auto maps = canonicalMaps(mesh, mapOptions);
    if (!maps) return atPlace(maps.error(), options.input);
    const Skeleton skeleton = mesh.skeleton();
    ARS_TRY(const Pose pose, readMapPose(options, skeleton));
    ARS_TRY_STATUS(reportProgress(bar.function(), 0.6, "posing the maps"));
    ARS_TRY(const std::vector<glm::vec3> posed, posedMapPoints(skeleton, *maps, pose));
    std::vector<float> priors(maps->pointCount() * kPriorWidth);
    ARS_TRY_STATUS(deformationPriors(*maps, posed, mapBodyVertices(body, {}, pose), priors));
    ExrImage exr;
    exr.textAttributes["ars"] = stageDocument(options, "maps").dump();
    const std::vector<float> ones(maps->pointCount(), 1.0f);
    ARS_TRY_STATUS(addMapLayer(exr, *maps, "mask", ones, 1, "Y"));
    ARS_TRY_STATUS(addMapLayer(exr, *maps, "canonical", numbers(maps->positions), 3, "XYZ"));
    ARS_TRY_STATUS(addMapLayer(exr, *maps, "canonical_normal", numbers(maps->normals), 3, "XYZ"));
    ARS_TRY_STATUS(addMapLayer(exr, *maps, "posed", numbers(posed), 3, "XYZ"));
    ARS_TRY_STATUS(addPriorLayers(exr, *maps, priors));
    ARS_TRY_STATUS(writeExr(options.out, exr));
    bar.clear();
    report(options, Json{{"size", {2 * maps->size, maps->size}}, {"points", maps->pointCount()}},
           fmt::format("front and back map of {}x{}, {} surfels", maps->size, maps->size, grouped(maps->pointCount())));
    return {};
}

// --- splat ---

/// The channels whose attributes the surfels have.
ChannelSet splattable(const Surfels& surfels) {
    ChannelSet channels{Channel::Opacity, Channel::Depth, Channel::Normal, Channel::Position};
    if (!surfels.colors.empty()) channels.add(Channel::Radiance);
    if (!surfels.albedos.empty()) channels.add(Channel::Albedo);
    if (!surfels.roughnesses.empty()) channels.add(Channel::Roughness);
    if (!surfels.radii.empty()) channels.add(Channel::Radius);
    if (!surfels.importances.empty()) channels.add(Channel::Importance);
    return channels;
}

Result<ChannelSet> chosenChannels(const StageOptions& options, const Surfels& surfels) {
    const ChannelSet there = splattable(surfels);
    if (options.buffers.empty()) return there;
    auto buffers = parseBuffers(options.buffers);
    if (!buffers) return atPlace(buffers.error(), "--aov");
    ChannelSet chosen{Channel::Opacity};
    for (const BufferId id : *buffers) {
        const auto channel = bufferInfo(id).channel;
        if (!channel || !there.has(*channel)) {
            return makeError(ErrorCode::NotFound, options.input,
                             fmt::format("the surfels have nothing for the buffer {}", bufferInfo(id).name));
        }
        chosen.add(*channel);
    }
    return chosen;
}

Json fatesJson(const SplatStats& stats) {
    Json json;
    for (std::size_t i = 0; i < kSurfelFateCount; ++i) {
        json[std::string(surfelFateName(static_cast<SurfelFate>(i)))] = stats.fates[i];
    }
    return json;
}

Status stageSplat(const StageOptions& options) {
    ARS_TRY(const Device device, chooseDevice(options.frame.device));
    FrameInputs settings;
    ARS_TRY_STATUS(applyFrameOptions(options.frame, settings));
    ARS_TRY(const Camera camera, requiredCamera(options));
    ARS_TRY(const Surfels surfels, readSurfelPly(options.input));
    ARS_TRY(const ChannelSet channels, chosenChannels(options, surfels));
    DeviceSurfels arrays;
    SurfelView view = viewOf(surfels);
    if (device.kind == DeviceKind::Cuda) {
        ARS_TRY(view, arrays.setSurfels(device, surfels));
    }
    GBuffer gbuffer;
    SplatWorkspace workspace;
    SplatStats stats;
    const auto begin = Clock::now();
    ARS_TRY_STATUS(splat(settings.splat, view, camera, channels, gbuffer, workspace, nullptr, &stats));
    const double milliseconds = millisecondsSince(begin);
    ExrImage exr;
    Json document = stageDocument(options, "splat");
    document["camera"] = cameraToJson(camera);
    document["settings"] = splatParameters().toJson(settings.splat);
    exr.textAttributes["ars"] = document.dump();
    for (const BufferInfo& info : bufferCatalogue()) {
        if (!info.channel || !gbuffer.channels.has(*info.channel)) continue;
        ARS_TRY(const Image picture, toHost(gbuffer[*info.channel]));
        ARS_TRY_STATUS(addBufferLayer(exr, info.id, picture));
    }
    ARS_TRY_STATUS(writeExr(options.out, exr));
    report(options,
           Json{{"surfels", stats.surfels},
                {"fates", fatesJson(stats)},
                {"instances", stats.instances},
                {"blended", stats.blended},
                {"foreground", stats.foreground},
                {"milliseconds", milliseconds}},
           fmt::format("{} of {} surfels in {} pixels, {:.1f} ms", grouped(stats.visible()), grouped(stats.surfels),
                       grouped(stats.foreground), milliseconds));
    return {};
}

// --- occlude ---

/// The layer, or the radius of --radius everywhere where the file has none.
Result<DevicePicture> radiusPicture(const StageOptions& options, const LayerReader& layers, const Camera& camera,
                                    const Device& device, float radiusM) {
    if (layers.has(BufferId::Radius) && options.frame.radius.empty()) return layers.picture(BufferId::Radius);
    if (options.frame.radius.empty()) return layers.picture(BufferId::Radius); // its error names the layers
    Image image;
    image.width = camera.width;
    image.height = camera.height;
    image.channels = 1;
    image.pixels.assign(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), radiusM);
    return toDevice(image, device);
}

Status stageOcclude(const StageOptions& options) {
    ARS_TRY(const Device device, chooseDevice(options.frame.device));
    FrameInputs settings;
    ARS_TRY_STATUS(applyFrameOptions(options.frame, settings));
    if (settings.occlusion.method != OcclusionMethod::ScreenSpace) {
        return wrongUsage("--occlusion", "this stage has buffers only; expected body or reference");
    }
    ARS_TRY(const Camera camera, requiredCamera(options));
    ARS_TRY(const LayerReader layers, openLayers(options, camera, device));
    ARS_TRY(const DevicePicture depth, layers.picture(BufferId::Depth));
    ARS_TRY(const DevicePicture normal, layers.picture(BufferId::Normal));
    ARS_TRY(const DevicePicture radius, radiusPicture(options, layers, camera, device, settings.radii[0]));
    ARS_TRY(const DevicePicture importance, layers.optional(BufferId::Importance));
    ARS_TRY(const DevicePicture bone, layers.optional(BufferId::Bone));
    ARS_TRY(const DevicePicture opacity, layers.optional(BufferId::Opacity));
    OcclusionInputs inputs;
    inputs.device = device;
    inputs.camera = camera;
    inputs.depth = depth.view();
    inputs.normal = normal.view();
    inputs.radius = radius.view();
    inputs.importance = importance.view();
    inputs.bone = bone.view();
    inputs.opacity = opacity.view();
    OcclusionWorkspace workspace;
    PixelBuffer occlusion;
    ARS_TRY_STATUS(occlusion.reshape(device, camera.width, camera.height, 1, "occlusion"));
    const auto begin = Clock::now();
    ARS_TRY_STATUS(ambientOcclusion(settings.occlusion.screenSpace, inputs, workspace, occlusion.view()));
    ARS_TRY_STATUS(waitForDevice(device));
    const double milliseconds = millisecondsSince(begin);
    ARS_TRY(Image picture, toHost(occlusion));
    // In files empty pixels are 0.
    ARS_TRY(const Image depths, layers.image(BufferId::Depth));
    std::size_t foreground = 0;
    double sum = 0;
    for (std::size_t p = 0; p < picture.pixels.size(); ++p) {
        if (!(depths.pixels[p] > 0.0f)) {
            picture.pixels[p] = 0.0f;
            continue;
        }
        ++foreground;
        sum += picture.pixels[p];
    }
    ExrImage exr;
    Json document = stageDocument(options, "occlude");
    document["camera"] = cameraToJson(camera);
    document["settings"] = occlusionParameters().toJson(settings.occlusion.screenSpace);
    exr.textAttributes["ars"] = document.dump();
    ARS_TRY_STATUS(addBufferLayer(exr, BufferId::AmbientOcclusion, picture));
    ARS_TRY_STATUS(writeExr(options.out, exr));
    const double mean = foreground ? sum / static_cast<double>(foreground) : 0.0;
    report(options, Json{{"foreground", foreground}, {"mean", mean}, {"milliseconds", milliseconds}},
           fmt::format("mean {:.3f} over {} pixels, {:.1f} ms", mean, grouped(foreground), milliseconds));
    return {};
}

// --- shade ---

Status stageShade(const StageOptions& options, ProgressBar& bar) {
    ARS_TRY(const Device device, chooseDevice(options.frame.device));
    FrameInputs settings;
    ARS_TRY_STATUS(applyFrameOptions(options.frame, settings));
    ARS_TRY(const Camera camera, requiredCamera(options));
    ARS_TRY(const LayerReader layers, openLayers(options, camera, device));
    ARS_TRY(const DevicePicture albedo, layers.picture(BufferId::Albedo));
    ARS_TRY(const DevicePicture roughness, layers.picture(BufferId::Roughness));
    ARS_TRY(const DevicePicture normal, layers.picture(BufferId::Normal));
    ARS_TRY(const DevicePicture position, layers.optional(BufferId::Position));
    ARS_TRY(const DevicePicture occlusion, layers.optional(BufferId::AmbientOcclusion));
    // Without opacity whatever has depth is covered whole.
    DevicePicture opacity;
    if (layers.has(BufferId::Opacity)) {
        ARS_TRY(opacity, layers.picture(BufferId::Opacity));
    } else {
        ARS_TRY(Image depth, layers.image(BufferId::Depth));
        for (float& value : depth.pixels) value = value > 0.0f ? 1.0f : 0.0f;
        ARS_TRY(opacity, toDevice(depth, device));
    }
    ARS_TRY(const LightSource light,
            readLightSource(options.environment, device, LightQuality::Exact, options.lightSize, bar.part(0.0, 0.9)));
    ShadingInputs inputs;
    inputs.albedo = albedo.view();
    inputs.roughness = roughness.view();
    inputs.normal = normal.view();
    inputs.opacity = opacity.view();
    inputs.occlusion = occlusion.view();
    inputs.position = position.view();
    inputs.camera = camera;
    inputs.light = light.filtered->view(
        {static_cast<float>(options.environmentRotationDeg), static_cast<float>(options.environmentScale)});
    PixelBuffer beauty, diffuse, specular;
    ARS_TRY_STATUS(beauty.reshape(device, camera.width, camera.height, 4, "shading"));
    ARS_TRY_STATUS(diffuse.reshape(device, camera.width, camera.height, 3, "shading"));
    ARS_TRY_STATUS(specular.reshape(device, camera.width, camera.height, 3, "shading"));
    ShadingOutputs outputs{beauty.view(), diffuse.view(), specular.view(), {}};
    const auto begin = Clock::now();
    ARS_TRY_STATUS(shade(device, settings.shading, inputs, outputs));
    ARS_TRY_STATUS(waitForDevice(device));
    const double milliseconds = millisecondsSince(begin);
    ExrImage exr;
    Json document = stageDocument(options, "shade");
    document["camera"] = cameraToJson(camera);
    document["environment"] = Json{{"source", options.environment},
                                   {"scale", options.environmentScale},
                                   {"rotation_deg", options.environmentRotationDeg}};
    exr.textAttributes["ars"] = document.dump();
    ARS_TRY(Image picture, toHost(beauty));
    picture.space = ColorSpace::Linear;
    picture.premultiplied = true;
    ARS_TRY_STATUS(addBufferLayer(exr, BufferId::Beauty, picture));
    ARS_TRY(picture, toHost(diffuse));
    ARS_TRY_STATUS(addBufferLayer(exr, BufferId::Diffuse, picture));
    ARS_TRY(picture, toHost(specular));
    ARS_TRY_STATUS(addBufferLayer(exr, BufferId::Specular, picture));
    ARS_TRY_STATUS(writeExr(options.out, exr));
    bar.clear();
    report(options, Json{{"milliseconds", milliseconds}, {"occluded", layers.has(BufferId::AmbientOcclusion)}},
           fmt::format("shaded {}x{} {} occlusion, {:.1f} ms", camera.width, camera.height,
                       layers.has(BufferId::AmbientOcclusion) ? "with" : "without", milliseconds));
    return {};
}

} // namespace

int runStageMaps(const StageOptions& options) {
    ProgressBar bar(options.output.quiet);
    const Status status = stageMaps(options, bar);
    bar.clear();
    return finish(status, options.output);
}

int runStageSplat(const StageOptions& options) { return finish(stageSplat(options), options.output); }

int runStageOcclude(const StageOptions& options) { return finish(stageOcclude(options), options.output); }

int runStageShade(const StageOptions& options) {
    ProgressBar bar(options.output.quiet);
    const Status status = stageShade(options, bar);
    bar.clear();
    return finish(status, options.output);
}

} // namespace ars::app
