// Renders the same scenes on every device, takes every backward function of the engine on them, reports how far each
// buffer is from the processor's, and can dump and compare with another machine's pictures. Fails where the processor
// gives other gradients the second time. usage: compare_devices [--dump DIR] [--against DIR] [--surfels N] [--size N]
#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"
#include "engine/frame/framing.h"
#include "engine/frame/light_source.h"
#include "engine/frame/rest_avatar.h"
#include "engine/io/exr.h"
#include "tests/parity/gradient_parity.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>

namespace {

using namespace ars;
namespace fs = std::filesystem;

struct Options {
    fs::path dump, against;
    int surfels = 60000;
    int size = 384;
};

struct Scene {
    std::string name;
    FrameInputs inputs;
};

/// The kernels, a bent pose, an off-centre camera, interactive occlusion: what differs in code must differ in a scene.
std::vector<Scene> makeScenes(const AvatarEvaluator& avatar, int size) {
    FrameInputs base;
    base.pose = restPose(avatar.rig().skeleton.jointCount());
    const Bounds bounds = boundsOf(avatar.mesh().mesh.positions);
    base.camera = orbitCamera(bounds, 25, 10, 30, size, size);
    std::vector<Scene> scenes{{"rest", base}};
    FrameInputs posed = base;
    posed.pose.rotations[16] = quatFromAxisAngle({0.2f, -0.3f, -1.1f});
    posed.pose.rotations[18] = quatFromAxisAngle({0.0f, -1.4f, 0.0f});
    posed.pose.rotations[4] = quatFromAxisAngle({0.9f, 0.0f, 0.0f});
    posed.posing.trainingRadii = true;
    scenes.push_back({"posed", posed});
    FrameInputs shifted = posed;
    shifted.camera.cx += 0.21 * size;
    shifted.camera.cy -= 0.13 * size;
    shifted.splat.depth = DepthMode::Exact;
    scenes.push_back({"off_centre_exact_depth", shifted});
    FrameInputs rays = posed;
    rays.splat.kernel = SurfelKernel::RaySplat;
    scenes.push_back({"ray_splat", rays});
    FrameInputs reference = posed;
    reference.occlusion.screenSpace = referenceOcclusion();
    scenes.push_back({"reference_occlusion", reference});
    FrameInputs interactive = base;
    interactive.occlusion.screenSpace.quality = OcclusionQuality::Interactive;
    scenes.push_back({"interactive_occlusion", interactive});
    return scenes;
}

using Pictures = std::map<std::string, Image>;

Result<Pictures> renderScene(const Scene& scene, FramePipeline& pipeline) {
    auto buffers = parseBuffers("all");
    if (scene.inputs.posing.trainingRadii) {
        buffers->push_back(BufferId::RadiusPlus);
        buffers->push_back(BufferId::RadiusMinus);
    }
    ARS_TRY_STATUS(pipeline.render(scene.inputs, *buffers));
    Pictures pictures;
    for (const BufferId id : *buffers) {
        ARS_TRY(Image picture, pipeline.picture(id));
        pictures[std::string(bufferInfo(id).name)] = std::move(picture);
    }
    return pictures;
}

Status dumpPictures(const fs::path& path, const Pictures& pictures) {
    ExrImage exr;
    for (const BufferInfo& info : bufferCatalogue()) {
        const auto found = pictures.find(std::string(info.name));
        if (found == pictures.end()) continue;
        ARS_TRY_STATUS(addExrLayer(exr, info.name, found->second, info.letters, ExrPixelType::Float));
    }
    return writeExr(path, exr);
}

Result<Pictures> readPictures(const fs::path& path) {
    ARS_TRY(const ExrImage exr, readExr(path));
    Pictures pictures;
    for (const std::string& layer : exrLayers(exr)) {
        ARS_TRY(pictures[layer], exrLayer(exr, layer));
    }
    return pictures;
}

/// Largest and mean difference and how many numbers differ by more than 1e-4 of the buffer's size.
void report(const std::string& scene, const std::string& what, const Pictures& expected, const Pictures& found) {
    fmt::print("\n{}: {}\n| buffer | largest | mean | above 1e-4 |\n|---|---|---|---|\n", scene, what);
    for (const auto& [name, a] : expected) {
        const auto other = found.find(name);
        if (other == found.end() || other->second.pixels.size() != a.pixels.size()) {
            fmt::print("| {} | missing or of another size | | |\n", name);
            continue;
        }
        double largest = 0, sum = 0;
        std::size_t above = 0;
        for (std::size_t i = 0; i < a.pixels.size(); ++i) {
            const double difference = std::abs(static_cast<double>(a.pixels[i]) - other->second.pixels[i]);
            largest = std::max(largest, difference);
            sum += difference;
            above += difference > 1e-4;
        }
        fmt::print("| {} | {:.2e} | {:.2e} | {} of {} |\n", name, largest, sum / static_cast<double>(a.pixels.size()),
                   above, a.pixels.size());
    }
}

/// Every backward function: the processor against itself, and each other device against the processor.
Status compareGradients(AvatarEvaluator& avatar, const std::vector<Scene>& scenes) {
    for (const Scene& scene : scenes) {
        // Those that change what backward does.
        if (scene.name != "posed" && scene.name != "off_centre_exact_depth" && scene.name != "ray_splat") continue;
        ARS_TRY(const auto gradients, parity::GradientScene::create(avatar, scene.inputs));
        const parity::Gradients host = gradients->backward({});
        const bool same = gradients->backward({}) == host;
        fmt::print("\n{}: {} gradients on the processor, the same numbers the second time: {}\n", scene.name,
                   host.size(), same ? "yes" : "NO");
        if (!same) return makeError(ErrorCode::Internal, scene.name, "the processor gives other gradients each time");
        for (const Device& device : availableDevices()) {
            if (device.kind == DeviceKind::Host) continue;
            parity::reportGradients(fmt::format("{}: gradients of {} against cpu", scene.name, deviceName(device)),
                                    host, gradients->backward(device));
        }
    }
    return {};
}

Status run(const Options& options) {
    RestAvatarOptions rest;
    rest.maxSurfels = options.surfels;
    ARS_TRY(std::unique_ptr<RestAvatar> built, restAvatarFromFile("open", rest));
    const std::shared_ptr<AvatarEvaluator> avatar = std::move(built);
    const std::vector<Scene> scenes = makeScenes(*avatar, options.size);
    std::map<std::string, Pictures> host;
    for (const Device& device : availableDevices()) {
        fmt::print("{}\n", deviceName(device));
        ARS_TRY(const LightSource light, readLightSource("sky", device));
        for (const Scene& scene : scenes) {
            ARS_TRY(const auto pipeline, FramePipeline::create(avatar, device));
            pipeline->setLight(light.filtered);
            ARS_TRY(Pictures pictures, renderScene(scene, *pipeline));
            const std::string file = fmt::format("{}_{}.exr", scene.name, deviceName(device));
            if (!options.dump.empty()) ARS_TRY_STATUS(dumpPictures(options.dump / file, pictures));
            if (!options.against.empty()) {
                const fs::path other = options.against / fmt::format("{}_cpu.exr", scene.name);
                ARS_TRY(const Pictures before, readPictures(other));
                report(scene.name, fmt::format("{} against {}", deviceName(device), other.string()), before, pictures);
            }
            if (device.kind == DeviceKind::Host) {
                host[scene.name] = std::move(pictures);
            } else {
                report(scene.name, fmt::format("{} against cpu", deviceName(device)), host[scene.name], pictures);
            }
        }
    }
    ARS_TRY_STATUS(compareGradients(*avatar, scenes));
    if (availableDevices().size() == 1) fmt::print("NOT RUN: there is no CUDA device to compare with\n");
    return {};
}

} // namespace

int main(int argc, char** argv) {
    Options options;
    for (int i = 1; i + 1 < argc; i += 2) {
        const std::string name = argv[i], value = argv[i + 1];
        if (name == "--dump")
            options.dump = value;
        else if (name == "--against")
            options.against = value;
        else if (name == "--surfels")
            options.surfels = std::atoi(value.c_str());
        else if (name == "--size")
            options.size = std::atoi(value.c_str());
        else {
            std::fprintf(stderr, "usage: compare_devices [--dump DIR] [--against DIR] [--surfels N] [--size N]\n");
            return 2;
        }
    }
    const Status status = run(options);
    if (!status) std::fprintf(stderr, "error: %s\n", status.error().describe().c_str());
    return status.ok() ? 0 : 1;
}
