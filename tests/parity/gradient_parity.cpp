#include "tests/parity/gradient_parity.h"

#include "engine/frame/device_surfels.h"
#include "engine/frame/light_source.h"
#include "engine/light/prefilter_gradient.h"
#include "engine/occlusion/radius_gradient.h"
#include "engine/shade/shading_gradient.h"
#include "engine/shade/tone_gradient.h"
#include "engine/surfel/pose_surfels_gradient.h"
#include "engine/surfel/splat_gradient.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <random>
#include <span>
#include <utility>

namespace ars::parity {
namespace {

constexpr ChannelSet kTraining{Channel::Opacity,     Channel::Depth,      Channel::Normal, Channel::Radiance,
                               Channel::Albedo,      Channel::Roughness,  Channel::Radius, Channel::RadiusPlus,
                               Channel::RadiusMinus, Channel::Importance, Channel::Bone};
constexpr ChannelSet kWithGradient{Channel::Opacity, Channel::Depth,     Channel::Normal, Channel::Radiance,
                                   Channel::Albedo,  Channel::Roughness, Channel::Radius};
constexpr int kLightBase = 128;

std::vector<float> randomNumbers(std::size_t count, unsigned seed, float low = -1.0f) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> between(low, 1.0f);
    std::vector<float> values(count);
    for (float& v : values) v = between(random);
    return values;
}

std::vector<float> numbersOf(const PixelBuffer& picture) {
    std::vector<float> values(picture.view().valueCount());
    if (!downloadBuffer(std::as_writable_bytes(std::span(values)), picture.memory())) values.clear();
    return values;
}

/// Pictures on a device for as long as this lives.
class Pictures {
public:
    explicit Pictures(const Device& device) : device_(device) {}

    Result<ImageView<const float>> upload(const std::vector<float>& values, int width, int height, int channels) {
        ARS_TRY(PixelBuffer * made, add(width, height, channels));
        ARS_TRY_STATUS(uploadBuffer(made->memory(), std::as_bytes(std::span(values))));
        return std::as_const(*made).view();
    }
    Result<ImageView<const float>> upload(const PixelBuffer& host) {
        return upload(numbersOf(host), host.width(), host.height(), host.channels());
    }
    Result<PixelBuffer*> add(int width, int height, int channels) {
        ARS_TRY(PixelBuffer made, PixelBuffer::allocate(device_, width, height, channels, "parity"));
        kept_.push_back(std::move(made));
        return &kept_.back();
    }

private:
    Device device_;
    std::deque<PixelBuffer> kept_;
};

/// A light that the processor filtered, in the memory of a device.
Result<LightView<float>> lightOn(const PrefilteredLight& light, Pictures& pictures) {
    LightView<float> view = light.view();
    for (int l = 0; l < light.levels; ++l) {
        ARS_TRY(const ImageView<const float> level, pictures.upload(light.specular[static_cast<std::size_t>(l)]));
        view.specular[l].texels = level.data;
    }
    ARS_TRY(const ImageView<const float> diffuse, pictures.upload(light.diffuse));
    view.diffuse.texels = diffuse.data;
    ARS_TRY(const ImageView<const float> lut, pictures.upload(*light.lut));
    view.lut = lut.data;
    return view;
}

template <typename T>
void put(Gradients& all, const std::string& name, const std::vector<T>& values) {
    if (values.empty()) return;
    const auto* first = reinterpret_cast<const float*>(values.data());
    all["splat: dL/d" + name].assign(first, first + values.size() * sizeof(T) / sizeof(float));
}

} // namespace

struct GradientScene::Data {
    FrameInputs inputs;
    const AvatarRig* rig = nullptr;
    Surfels canonical, live;
    std::vector<glm::mat4> matrices;
    std::vector<glm::vec3> jointPositions;
    GBuffer gbuffer;
    PrefilteredLight light;
    PixelBuffer occlusion, occlusionPlus, occlusionMinus;

    int width() const { return inputs.camera.width; }
    int height() const { return inputs.camera.height; }
    std::size_t pixels() const { return gbuffer[Channel::Opacity].view().pixelCount(); }
    SurfelPosing posing() const { return {matrices, jointPositions, rig->parts}; }

    Status splat(const Device& device, Gradients& all) const;
    Status pose(Gradients& all) const;
    Status occlude(const Device& device, Gradients& all) const;
    Status shade(const Device& device, Gradients& all) const;
    Status tone(const Device& device, Gradients& all) const;
    Status filter(const Device& device, Gradients& all) const;
};

Status GradientScene::Data::splat(const Device& device, Gradients& all) const {
    Pictures pictures(device);
    DeviceSurfels copies;
    SurfelView view = viewOf(live);
    if (device.kind != DeviceKind::Host) {
        ARS_TRY(view, copies.setSurfels(device, live));
    }
    GBuffer own;
    SplatWorkspace workspace;
    ContributorLists contributors;
    ARS_TRY_STATUS(ars::splat(inputs.splat, view, inputs.camera, kTraining, own, workspace, &contributors));
    GBufferGradients gradients;
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        if (!kWithGradient.has(channel)) continue;
        const int channels = channelWidth(channel);
        const std::vector<float> values =
            randomNumbers(pixels() * static_cast<std::size_t>(channels), static_cast<unsigned>(i));
        ARS_TRY(gradients[channel], pictures.upload(values, width(), height(), channels));
    }
    SplatGradientWorkspace memory;
    SurfelGradients out;
    ARS_TRY_STATUS(splatBackward(inputs.splat, view, inputs.camera, own, &contributors, gradients, memory, out));
    put(all, "means", out.means);
    put(all, "rotations", out.rotations);
    put(all, "scales", out.scales);
    put(all, "opacities", out.opacities);
    put(all, "colors", out.colors);
    put(all, "albedos", out.albedos);
    put(all, "roughnesses", out.roughnesses);
    put(all, "radii", out.radii);
    return {};
}

Status GradientScene::Data::pose(Gradients& all) const {
    const std::size_t n = canonical.count();
    const std::vector<float> gMeans = randomNumbers(3 * n, 21), gRotations = randomNumbers(4 * n, 22),
                             gRadii = randomNumbers(n, 23);
    std::vector<glm::vec3> means(n);
    std::vector<float> rotations(4 * n);
    PartRadii radii{};
    const std::span<const glm::vec3> gVectors(reinterpret_cast<const glm::vec3*>(gMeans.data()), n);
    ARS_TRY_STATUS(poseSurfelsBackward(posing(), rig->weights, canonical, {gVectors, gRotations, gRadii}, means,
                                       rotations, radii));
    const auto* first = reinterpret_cast<const float*>(means.data());
    all["pose: dL/dmeans"].assign(first, first + 3 * n);
    all["pose: dL/drotations"] = rotations;
    all["pose: dL/dradii"].assign(radii.begin(), radii.end());
    return {};
}

Status GradientScene::Data::occlude(const Device& device, Gradients& all) const {
    Pictures pictures(device);
    OcclusionInputs from;
    from.device = device;
    from.camera = inputs.camera;
    ARS_TRY(from.depth, pictures.upload(gbuffer[Channel::Depth]));
    ARS_TRY(from.normal, pictures.upload(gbuffer[Channel::Normal]));
    ARS_TRY(from.radius, pictures.upload(gbuffer[Channel::Radius]));
    ARS_TRY(from.importance, pictures.upload(gbuffer[Channel::Importance]));
    ARS_TRY(from.bone, pictures.upload(gbuffer[Channel::Bone]));
    ARS_TRY(from.opacity, pictures.upload(gbuffer[Channel::Opacity]));
    ARS_TRY(const auto radiusPlus, pictures.upload(gbuffer[Channel::RadiusPlus]));
    ARS_TRY(const auto radiusMinus, pictures.upload(gbuffer[Channel::RadiusMinus]));
    PixelBuffer* maps[3];
    for (PixelBuffer*& map : maps) {
        ARS_TRY(map, pictures.add(width(), height(), 1));
    }
    OcclusionParams params = inputs.occlusion.screenSpace;
    params.quality = OcclusionQuality::Interactive;
    params.interactiveDirections = 128;
    OcclusionWorkspace workspace;
    ARS_TRY_STATUS(ambientOcclusionTriple(params, from, radiusPlus, radiusMinus, workspace, maps[0]->view(),
                                          maps[1]->view(), maps[2]->view(), 3));
    all["occlusion: O"] = numbersOf(*maps[0]);
    all["occlusion: O+"] = numbersOf(*maps[1]);
    all["occlusion: O-"] = numbersOf(*maps[2]);
    ARS_TRY(const auto plus, pictures.upload(occlusionPlus));
    ARS_TRY(const auto minus, pictures.upload(occlusionMinus));
    ARS_TRY(const auto upper, pictures.upload(randomNumbers(pixels(), 31), width(), height(), 1));
    ARS_TRY(PixelBuffer * lower, pictures.add(width(), height(), 1));
    ARS_TRY_STATUS(
        backwardRadius(device, {}, upper, plus, minus, radiusPlus, radiusMinus, from.opacity, lower->view()));
    all["radius: dL/dR"] = numbersOf(*lower);
    return {};
}

Status GradientScene::Data::shade(const Device& device, Gradients& all) const {
    Pictures pictures(device);
    ShadingInputs from;
    ARS_TRY(from.albedo, pictures.upload(gbuffer[Channel::Albedo]));
    ARS_TRY(from.roughness, pictures.upload(gbuffer[Channel::Roughness]));
    ARS_TRY(from.normal, pictures.upload(gbuffer[Channel::Normal]));
    ARS_TRY(from.opacity, pictures.upload(gbuffer[Channel::Opacity]));
    ARS_TRY(from.occlusion, pictures.upload(occlusion));
    from.camera = inputs.camera;
    ARS_TRY(from.light, lightOn(light, pictures));
    ARS_TRY(const auto upper, pictures.upload(randomNumbers(4 * pixels(), 41), width(), height(), 4));
    std::map<std::string, PixelBuffer*> out;
    const std::pair<const char*, int> wanted[]{
        {"albedo", 3}, {"roughness", 1}, {"normal", 3}, {"opacity", 1}, {"occlusion", 1}};
    for (const auto& [name, channels] : wanted) {
        ARS_TRY(out[name], pictures.add(width(), height(), channels));
    }
    ShadingGradientOutputs outputs{out["albedo"]->view(),  out["roughness"]->view(), out["normal"]->view(),
                                   out["opacity"]->view(), out["occlusion"]->view(), {}};
    outputs.light.levels = light.levels;
    for (int l = 0; l <= light.levels; ++l) {
        const auto level = static_cast<std::size_t>(l);
        const int side = l < light.levels ? light.specular[level].width() : light.diffuse.width();
        ARS_TRY(PixelBuffer * cube, pictures.add(side, 6 * side, 3));
        out[l < light.levels ? fmt::format("light level {}", l) : "diffuse light"] = cube;
        (l < light.levels ? outputs.light.specular[level] : outputs.light.diffuse) = cube->view();
    }
    ShadingGradientWorkspace workspace;
    ARS_TRY_STATUS(shadeBackward(device, inputs.shading, from, upper, outputs, workspace));
    for (const auto& [name, picture] : out) all["shade: dL/d" + name] = numbersOf(*picture);
    return {};
}

Status GradientScene::Data::tone(const Device& device, Gradients& all) const {
    Pictures pictures(device);
    ARS_TRY(const auto linear, pictures.upload(randomNumbers(4 * pixels(), 51, 0.0f), width(), height(), 4));
    ARS_TRY(const auto upper, pictures.upload(randomNumbers(4 * pixels(), 52), width(), height(), 4));
    ARS_TRY(PixelBuffer * lower, pictures.add(width(), height(), 4));
    for (const ToneCurve curve : {ToneCurve::None, ToneCurve::Aces, ToneCurve::Agx}) {
        ARS_TRY_STATUS(toneMapBackward(device, {.exposureEv = 0.5f, .curve = curve}, linear, upper, lower->view()));
        all[fmt::format("tone {}: dL/dlinear", EnumWords<ToneCurve>::words[static_cast<std::size_t>(curve)])] =
            numbersOf(*lower);
    }
    return {};
}

Status GradientScene::Data::filter(const Device& device, Gradients& all) const {
    Pictures pictures(device);
    LightLevelViews<const float> levels;
    levels.levels = light.levels;
    for (int l = 0; l <= light.levels; ++l) {
        const auto level = static_cast<std::size_t>(l);
        const PixelBuffer& like = l < light.levels ? light.specular[level] : light.diffuse;
        const std::vector<float> values = randomNumbers(like.view().valueCount(), static_cast<unsigned>(60 + l));
        ARS_TRY((l < light.levels ? levels.specular[level] : levels.diffuse),
                pictures.upload(values, like.width(), like.height(), 3));
    }
    ARS_TRY(PixelBuffer * base, pictures.add(kLightBase, 6 * kLightBase, 3));
    PrefilterGradientWorkspace workspace;
    ARS_TRY_STATUS(prefilterLightBackward(device, kLightBase, {}, levels, base->view(), workspace));
    all["light: dL/dbase"] = numbersOf(*base);
    return {};
}

GradientScene::GradientScene(std::unique_ptr<Data> data) : data_(std::move(data)) {}
GradientScene::~GradientScene() = default;

Result<std::unique_ptr<GradientScene>> GradientScene::create(AvatarEvaluator& avatar, FrameInputs inputs) {
    auto data = std::make_unique<Data>();
    inputs.posing.trainingRadii = true;
    data->inputs = inputs;
    data->rig = &avatar.rig();
    ARS_TRY_STATUS(avatar.evaluate(inputs.pose, nullptr, data->canonical));
    ARS_TRY(data->matrices, canonicalToPosed(skinningMatrices(data->rig->skeleton, inputs.pose), data->rig->canonical));
    data->jointPositions = posedJointPositions(data->rig->skeleton, inputs.pose);
    PosedSurfels posed;
    ARS_TRY_STATUS(poseSurfels(inputs.posing, data->posing(), data->rig->weights, data->canonical, posed));
    data->live = liveSurfels(data->canonical, posed);
    SplatWorkspace workspace;
    ARS_TRY_STATUS(ars::splat(inputs.splat, viewOf(data->live), inputs.camera, kTraining, data->gbuffer, workspace));
    ARS_TRY(const LightSource source, readLightSource("sky", {}, LightQuality::Exact, kLightBase));
    ARS_TRY_STATUS(prefilterLight({}, source.base, {}, data->light));
    ARS_TRY(const OcclusionInputs from, occlusionInputs(data->gbuffer, inputs.camera));
    for (PixelBuffer* map : {&data->occlusion, &data->occlusionPlus, &data->occlusionMinus}) {
        ARS_TRY_STATUS(map->reshape({}, inputs.camera.width, inputs.camera.height, 1, "parity"));
    }
    OcclusionWorkspace scratch;
    ARS_TRY_STATUS(ambientOcclusionTriple(
        inputs.occlusion.screenSpace, from, std::as_const(data->gbuffer)[Channel::RadiusPlus].view(),
        std::as_const(data->gbuffer)[Channel::RadiusMinus].view(), scratch, data->occlusion.view(),
        data->occlusionPlus.view(), data->occlusionMinus.view()));
    return std::unique_ptr<GradientScene>(new GradientScene(std::move(data)));
}

Gradients GradientScene::backward(const Device& device) const {
    Gradients all;
    const auto report = [&](const char* what, const Status& status) {
        if (!status) fmt::print("NOT RUN: {} on {}: {}\n", what, deviceName(device), status.error().describe());
    };
    report("backward of splatting", data_->splat(device, all));
    if (device.kind == DeviceKind::Host) report("backward of posing", data_->pose(all));
    report("occlusion at three radii and its backward", data_->occlude(device, all));
    report("backward of shading", data_->shade(device, all));
    report("backward of tone", data_->tone(device, all));
    report("backward of the light's filters", data_->filter(device, all));
    return all;
}

void reportGradients(const std::string& what, const Gradients& expected, const Gradients& found) {
    fmt::print("\n{}\n| buffer | largest number | largest difference | mean difference | above 1e-4 |\n"
               "|---|---|---|---|---|\n",
               what);
    for (const auto& [name, a] : expected) {
        const auto other = found.find(name);
        if (other == found.end() || other->second.size() != a.size()) {
            fmt::print("| {} | missing or of another size | | | |\n", name);
            continue;
        }
        double size = 0, largest = 0, sum = 0;
        for (const float v : a) size = std::max(size, std::abs(static_cast<double>(v)));
        std::size_t above = 0;
        for (std::size_t i = 0; i < a.size(); ++i) {
            const double difference = std::abs(static_cast<double>(a[i]) - other->second[i]);
            // Not "larger than": NaN must count.
            largest = difference <= largest ? largest : difference;
            sum += difference;
            above += !(difference <= 1e-4 * size);
        }
        const double scale = size > 0 ? 1 / size : 1;
        fmt::print("| {} | {:.2e} | {:.2e} | {:.2e} | {} of {} |\n", name, size, largest * scale,
                   sum * scale / static_cast<double>(std::max<std::size_t>(1, a.size())), above, a.size());
    }
}

} // namespace ars::parity
