#include "engine/light/prefilter_gradient.h"
#include "engine/shade/shading_gradient.h"
#include "model/operators/operator_support.h"

#include <ATen/ATen.h>

namespace ars {

using operators::checked;
using operators::pictureOf;
using operators::pictureToFill;
using operators::require;

/// The filtered light and its cubes as the graph knows them: the specular levels and, last, the diffuse cube, each
/// (6, side, side, 3) over the memory of `filtered`.
struct LightTensors {
    std::shared_ptr<PrefilteredLight> filtered;
    std::vector<at::Tensor> cubes;
};

namespace {

constexpr const char* kShadePlace = "shading";
constexpr const char* kLightPlace = "light";

std::size_t levelCount(const PrefilteredLight& light) { return static_cast<std::size_t>(light.levels); }

at::Tensor cubeOver(const std::shared_ptr<PrefilteredLight>& light, const PixelBuffer& cube) {
    return operators::tensorOwnedBy(light, cube.view().data, {6, cube.width(), cube.width(), 3}, cube.device());
}

at::Tensor zeroCube(std::int64_t side, const Device& device) {
    return at::zeros({6, side, side, 3}, at::TensorOptions(at::kFloat).device(torchDevice(device)));
}

/// A cube (6, side, side, 3) as engine/ sees it.
ImageView<const float> cubeView(const at::Tensor& cube) {
    const auto side = static_cast<int>(cube.size(1));
    return {cube.const_data_ptr<float>(), side, 6 * side, 3};
}
ImageView<float> cubeToFill(at::Tensor& cube) {
    const auto side = static_cast<int>(cube.size(1));
    return {cube.mutable_data_ptr<float>(), side, 6 * side, 3};
}

/// Input: the texels. Outputs: the cubes of LightTensors. Gradients of all views have been summed when this is called.
struct FilterNode : operators::Node {
    int baseSize = 0, levels = 0;
    Device device;
    PrefilterParams params;

    std::string name() const override { return "LightFilterBackward"; }

    torch::autograd::variable_list apply(torch::autograd::variable_list&& grads) override {
        begin("light gradient");
        std::vector<at::Tensor> cubes; // zeros where no gradient came
        for (int l = 0; l <= levels; ++l) {
            const at::Tensor& grad = grads[static_cast<std::size_t>(l)];
            const std::int64_t side = l < levels ? baseSize >> l : kSmallestLightLevel;
            cubes.push_back(grad.defined() ? grad.contiguous() : zeroCube(side, device));
        }
        LightLevelViews<const float> gradients;
        gradients.levels = levels;
        for (std::size_t l = 0; l + 1 < cubes.size(); ++l) gradients.specular[l] = cubeView(cubes[l]);
        gradients.diffuse = cubeView(cubes.back());
        at::Tensor result = at::empty_like(cubes.front());
        PrefilterGradientWorkspace workspace;
        require(prefilterLightBackward(device, baseSize, params, gradients, cubeToFill(result), workspace));
        return {result};
    }
};

/// Inputs: albedo, roughness, normal, opacity, occlusion, then the cubes of the light.
struct ShadeNode : operators::Node {
    static constexpr std::size_t kPictures = 5;
    ShadingParams params;
    Camera camera;
    std::shared_ptr<PrefilteredLight> light;

    std::string name() const override { return "ShadeBackward"; }
    void release_variables() override {
        Node::release_variables();
        light.reset();
    }

    torch::autograd::variable_list apply(torch::autograd::variable_list&& grads) override {
        begin("shading gradient");
        const std::size_t cubes = levelCount(*light) + 1;
        torch::autograd::variable_list result(kPictures + cubes);
        if (!grads[0].defined()) return result;
        const at::Tensor grad = grads[0].contiguous();
        at::Tensor pictures[kPictures];
        ImageView<float> to[kPictures];
        for (std::size_t i = 0; i < kPictures; ++i) {
            pictures[i] = kept(i);
            if (!pictures[i].defined() || !task_should_compute_output(i)) continue;
            result[i] = at::empty_like(pictures[i]);
            to[i] = pictureToFill(result[i]);
        }
        const ShadingInputs inputs{pictureOf(pictures[0]),
                                   pictureOf(pictures[1]),
                                   pictureOf(pictures[2]),
                                   pictureOf(pictures[3]),
                                   pictureOf(pictures[4]),
                                   {},
                                   camera,
                                   light->view()};
        LightLevelViews<float> toLight;
        if (task_should_compute_output({{kPictures, kPictures + cubes}})) {
            toLight.levels = light->levels;
            for (std::size_t l = 0; l < cubes; ++l) {
                const bool last = l + 1 == cubes;
                at::Tensor& cube = result[kPictures + l];
                cube = zeroCube(last ? light->diffuse.width() : light->specular[l].width(), light->device());
                (last ? toLight.diffuse : toLight.specular[l]) = cubeToFill(cube);
            }
        }
        ShadingGradientWorkspace workspace;
        require(shadeBackward(light->device(), params, inputs, pictureOf(grad),
                              {to[0], to[1], to[2], to[3], to[4], toLight}, workspace));
        return result;
    }
};

/// @param light  on whose device it must lie
at::Tensor picture(const at::Tensor& tensor, const char* name, const Camera& camera, int channels,
                   const LightTensors& light) {
    return checked(tensor, kShadePlace, name, {camera.height, camera.width, channels}, light.cubes.back());
}

} // namespace

std::shared_ptr<LightTensors> lightTensors(const at::Tensor& texels) {
    const at::Tensor base = checked(texels, kLightPlace, "the light", {6, -1, -1, 3});
    if (base.size(1) != base.size(2)) {
        operators::fail(kLightPlace,
                        fmt::format("a face of {}x{} texels, expected a square", base.size(2), base.size(1)));
    }
    const auto side = static_cast<int>(base.size(1));
    auto light = std::make_shared<LightTensors>();
    light->filtered = std::make_shared<PrefilteredLight>();
    const PrefilterParams params;
    const Device device = deviceOf(base);
    require(prefilterLight(device, cubeView(base), params, *light->filtered));
    for (std::size_t l = 0; l < levelCount(*light->filtered); ++l) {
        light->cubes.push_back(cubeOver(light->filtered, light->filtered->specular[l]));
    }
    light->cubes.push_back(cubeOver(light->filtered, light->filtered->diffuse));
    if (operators::wantsGradient({base})) {
        const auto node = operators::makeNode<FilterNode>(base);
        node->baseSize = side;
        node->levels = light->filtered->levels;
        node->device = device;
        node->params = params;
        for (const at::Tensor& cube : light->cubes) torch::autograd::set_history(cube, node);
    }
    return light;
}

at::Tensor shadeTensors(const ShadingParams& params, const GBufferTensors& gbuffer, const at::Tensor& occlusion,
                        const Camera& camera, const std::shared_ptr<LightTensors>& light) {
    if (!light) operators::fail(kShadePlace, "there is no light");
    const at::Tensor albedo = picture(gbuffer[Channel::Albedo], "albedo", camera, 3, *light);
    const at::Tensor roughness = picture(gbuffer[Channel::Roughness], "roughness", camera, 1, *light);
    const at::Tensor normal = picture(gbuffer[Channel::Normal], "normal", camera, 3, *light);
    const at::Tensor opacity = picture(gbuffer[Channel::Opacity], "opacity", camera, 1, *light);
    const at::Tensor open = occlusion.defined() ? picture(occlusion, "occlusion", camera, 1, *light) : at::Tensor();
    at::Tensor beauty = at::empty({camera.height, camera.width, 4}, albedo.options());
    const ShadingInputs inputs{pictureOf(albedo),
                               pictureOf(roughness),
                               pictureOf(normal),
                               pictureOf(opacity),
                               pictureOf(open),
                               {},
                               camera,
                               light->filtered->view()};
    require(shade(light->filtered->device(), params, inputs, {pictureToFill(beauty), {}, {}, {}}));

    if (!operators::wantsGradient({albedo, roughness, normal, opacity, open, light->cubes.back()})) return beauty;
    const auto node = operators::makeNode<ShadeNode>(albedo, roughness, normal, opacity, open, light->cubes);
    node->params = params;
    node->camera = camera;
    node->light = light->filtered;
    for (const at::Tensor& input : {albedo, roughness, normal, opacity, open}) node->keep(input);
    torch::autograd::set_history(beauty, node);
    return beauty;
}

} // namespace ars
