#include "engine/surfel/splat_gradient.h"
#include "model/operators/operator_support.h"

#include <ATen/ATen.h>

#include <mutex>

namespace ars {

using operators::adopt;
using operators::checked;
using operators::require;

namespace {

constexpr const char* kPlace = "splat";

/// What a splat must keep until backward has passed and its pictures are forgotten.
struct SplatMemory {
    GBuffer gbuffer;
};

/// A stack of things to use again. Any thread may take and give.
template <typename T>
class Shelf {
public:
    std::unique_ptr<T> take() {
        const std::lock_guard lock(mutex_);
        if (free_.empty()) return std::make_unique<T>();
        std::unique_ptr<T> item = std::move(free_.back());
        free_.pop_back();
        return item;
    }
    void give(std::unique_ptr<T> item) {
        const std::lock_guard lock(mutex_);
        free_.push_back(std::move(item));
    }

private:
    std::mutex mutex_;
    std::vector<std::unique_ptr<T>> free_;
};

} // namespace

/// What is needed only while a pass runs is shared by all splats.
struct SplatScratchPool::State {
    Shelf<SplatMemory> memories;
    Shelf<SplatWorkspace> workspaces;
    Shelf<SplatGradientWorkspace> gradientWorkspaces;
};

/// One splat's share of the pool; goes back when the last that looks at it is gone.
class SplatScratch {
public:
    explicit SplatScratch(std::shared_ptr<SplatScratchPool::State> pool)
        : pool_(std::move(pool)), memory_(pool_->memories.take()) {}
    ~SplatScratch() { pool_->memories.give(std::move(memory_)); }
    SplatScratch(const SplatScratch&) = delete;
    SplatScratch& operator=(const SplatScratch&) = delete;

    GBuffer& gbuffer() { return memory_->gbuffer; }

    Status forward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, ChannelSet channels) {
        std::unique_ptr<SplatWorkspace> workspace = pool_->workspaces.take();
        const Status status = splat(params, surfels, camera, channels, memory_->gbuffer, *workspace);
        pool_->workspaces.give(std::move(workspace));
        return status;
    }
    Status backward(const SplatParams& params, const SurfelView& surfels, const Camera& camera,
                    const GBufferGradients& gradients, SurfelGradients& out) {
        std::unique_ptr<SplatGradientWorkspace> workspace = pool_->gradientWorkspaces.take();
        const Status status =
            splatBackward(params, surfels, camera, memory_->gbuffer, nullptr, gradients, *workspace, out);
        pool_->gradientWorkspaces.give(std::move(workspace));
        return status;
    }

private:
    std::shared_ptr<SplatScratchPool::State> pool_;
    std::unique_ptr<SplatMemory> memory_;
};

SplatScratchPool::SplatScratchPool() : state_(std::make_shared<State>()) {}
SplatScratchPool::~SplatScratchPool() = default;
std::shared_ptr<SplatScratch> SplatScratchPool::take() { return std::make_shared<SplatScratch>(state_); }

namespace {

/// Attributes that carry a gradient, in the order of the node's inputs.
enum Input : std::size_t { kMeans, kRotations, kScales, kOpacities, kColors, kAlbedos, kRoughnesses, kRadii, kInputs };
/// Pictures that carry one: R+, R-, I and Q do not (design section 4).
constexpr ChannelSet kDifferentiable{Channel::Opacity,  Channel::Depth,  Channel::Normal,    Channel::Position,
                                     Channel::Radiance, Channel::Albedo, Channel::Roughness, Channel::Radius};

using InputTensors = std::array<at::Tensor, kInputs>;

const float* dataOf(const at::Tensor& tensor) { return tensor.defined() ? tensor.const_data_ptr<float>() : nullptr; }
const glm::vec3* vectorsOf(const at::Tensor& tensor) { return reinterpret_cast<const glm::vec3*>(dataOf(tensor)); }

SurfelView viewOfInputs(const InputTensors& inputs) {
    SurfelView view;
    view.count = static_cast<std::size_t>(inputs[kMeans].size(0));
    view.means = vectorsOf(inputs[kMeans]);
    view.rotations = dataOf(inputs[kRotations]);
    view.scales = reinterpret_cast<const glm::vec2*>(dataOf(inputs[kScales]));
    view.opacities = dataOf(inputs[kOpacities]);
    view.colors = vectorsOf(inputs[kColors]);
    view.albedos = vectorsOf(inputs[kAlbedos]);
    view.roughnesses = dataOf(inputs[kRoughnesses]);
    view.radii = dataOf(inputs[kRadii]);
    return view;
}

/// (N, width), or with width 1 also (N).
at::Tensor attribute(const at::Tensor& tensor, const char* name, std::int64_t count, std::int64_t width) {
    if (!tensor.defined()) return {};
    if (width == 1 && tensor.dim() == 1) return checked(tensor, kPlace, name, {count});
    return checked(tensor, kPlace, name, {count, width});
}

InputTensors checkedInputs(const SurfelTensors& surfels) {
    InputTensors inputs;
    inputs[kMeans] = checked(surfels.means, kPlace, "means", {-1, 3});
    const std::int64_t n = inputs[kMeans].size(0);
    inputs[kRotations] = checked(surfels.rotations, kPlace, "rotations", {n, 4});
    inputs[kScales] = checked(surfels.scales, kPlace, "scales", {n, 2});
    if (!surfels.opacities.defined()) operators::fail(kPlace, "opacities are missing");
    inputs[kOpacities] = attribute(surfels.opacities, "opacities", n, 1);
    inputs[kColors] = attribute(surfels.colors, "colors", n, 3);
    inputs[kAlbedos] = attribute(surfels.albedos, "albedos", n, 3);
    inputs[kRoughnesses] = attribute(surfels.roughnesses, "roughnesses", n, 1);
    inputs[kRadii] = attribute(surfels.radii, "radii", n, 1);
    return inputs;
}

template <typename T>
at::Tensor gradientFor(std::vector<T>& values, const at::Tensor& input) {
    return values.empty() ? at::Tensor() : adopt(std::move(values), input.sizes());
}

/// Inputs in the order of Input; outputs the differentiable pictures in that of Channel.
struct SplatNode : operators::Node {
    SplatParams params;
    Camera camera;
    std::shared_ptr<SplatScratch> scratch;
    std::vector<Channel> outputs;

    std::string name() const override { return "SplatBackward"; }
    void release_variables() override {
        Node::release_variables();
        scratch.reset();
    }

    torch::autograd::variable_list apply(torch::autograd::variable_list&& grads) override {
        begin("splat gradient");
        InputTensors inputs;
        for (std::size_t i = 0; i < kInputs; ++i) inputs[i] = kept(i);
        // The pictures are read, too: a change of one is noticed here.
        for (std::size_t i = 0; i < outputs.size(); ++i) kept(kInputs + i);
        GBufferGradients gradients;
        for (std::size_t i = 0; i < outputs.size(); ++i) {
            if (!grads[i].defined()) continue;
            grads[i] = grads[i].contiguous();
            gradients[outputs[i]] = operators::pictureOf(grads[i]);
        }
        SurfelGradients out;
        require(scratch->backward(params, viewOfInputs(inputs), camera, gradients, out));
        return {gradientFor(out.means, inputs[kMeans]),
                gradientFor(out.rotations, inputs[kRotations]),
                gradientFor(out.scales, inputs[kScales]),
                gradientFor(out.opacities, inputs[kOpacities]),
                gradientFor(out.colors, inputs[kColors]),
                gradientFor(out.albedos, inputs[kAlbedos]),
                gradientFor(out.roughnesses, inputs[kRoughnesses]),
                gradientFor(out.radii, inputs[kRadii])};
    }
};

GBufferTensors picturesOf(const std::shared_ptr<SplatScratch>& scratch, ChannelSet channels) {
    GBufferTensors tensors;
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        if (!channels.has(channel)) continue;
        const ImageView<float> view = scratch->gbuffer()[channel].view();
        tensors[channel] = operators::tensorOwnedBy(scratch, view.data, {view.height, view.width, view.channels});
    }
    return tensors;
}

} // namespace

GBufferTensors splatTensors(const SplatParams& params, const SurfelTensors& surfels, const Camera& camera,
                            ChannelSet channels, SplatScratchPool& pool) {
    const InputTensors inputs = checkedInputs(surfels);
    const std::int64_t n = inputs[kMeans].size(0);
    const at::Tensor plus = attribute(surfels.radiiPlus, "radiiPlus", n, 1);
    const at::Tensor minus = attribute(surfels.radiiMinus, "radiiMinus", n, 1);
    const at::Tensor importances = attribute(surfels.importances, "importances", n, 1);
    const at::Tensor bones = attribute(surfels.bones, "bones", n, 3);
    SurfelView view = viewOfInputs(inputs);
    view.radiiPlus = dataOf(plus);
    view.radiiMinus = dataOf(minus);
    view.importances = dataOf(importances);
    view.bones = vectorsOf(bones);

    channels.add(Channel::Opacity);
    ChannelSet made = channels;
    if (channels.has(Channel::Position)) made.add(Channel::Depth); // its gradient needs it
    bool gradient = false;
    for (const at::Tensor& input : inputs) gradient = gradient || operators::wantsGradient({input});
    const std::shared_ptr<SplatScratch> scratch = pool.take();
    require(scratch->forward(params, view, camera, made));
    GBufferTensors pictures = picturesOf(scratch, channels);
    if (!gradient) return pictures;

    const auto node = operators::makeNode<SplatNode>(at::ArrayRef<at::Tensor>(inputs.data(), inputs.size()));
    node->params = params;
    node->camera = camera;
    node->scratch = scratch;
    for (const at::Tensor& input : inputs) node->keep(input);
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        if (!channels.has(channel) || !kDifferentiable.has(channel)) continue;
        torch::autograd::set_history(pictures[channel], node);
        node->keep(pictures[channel], true);
        node->outputs.push_back(channel);
    }
    return pictures;
}

} // namespace ars
