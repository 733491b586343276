#include "engine/surfel/splat_gradient.h"
#include "model/operators/operator_support.h"

#include <ATen/ATen.h>

#include <mutex>

namespace ars {

using operators::checked;
using operators::require;

namespace {

constexpr const char* kPlace = "splat";

/// What a splat must keep until backward has passed and its pictures are forgotten.
struct SplatMemory {
    GBuffer gbuffer;
    ContributorLists lists; ///< CUDA alone, with gradients
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

    /// @param gradient  whether backward will be asked for
    Status forward(const SplatParams& params, const SurfelView& surfels, const Camera& camera, ChannelSet channels,
                   bool gradient) {
        listed_ = gradient && surfels.device.kind == DeviceKind::Cuda;
        // Without lists CUDA would not wait, and might leave surfels out: whoever asks for counts gets whole pictures.
        SplatStats counts;
        const bool whole = !listed_ && surfels.device.kind == DeviceKind::Cuda;
        std::unique_ptr<SplatWorkspace> workspace = pool_->workspaces.take();
        const Status status = splat(params, surfels, camera, channels, memory_->gbuffer, *workspace,
                                    listed_ ? &memory_->lists : nullptr, whole ? &counts : nullptr);
        pool_->workspaces.give(std::move(workspace));
        return status;
    }
    Status backward(const SplatParams& params, const SurfelView& surfels, const Camera& camera,
                    const GBufferGradients& gradients, const SurfelGradientArrays& out) {
        std::unique_ptr<SplatGradientWorkspace> workspace = pool_->gradientWorkspaces.take();
        const Status status = splatBackward(params, surfels, camera, memory_->gbuffer,
                                            listed_ ? &memory_->lists : nullptr, gradients, *workspace, out);
        pool_->gradientWorkspaces.give(std::move(workspace));
        return status;
    }

private:
    std::shared_ptr<SplatScratchPool::State> pool_;
    std::unique_ptr<SplatMemory> memory_;
    bool listed_ = false;
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
    view.device = deviceOf(inputs[kMeans]);
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

/// (N, width), or with width 1 also (N), beside the means.
at::Tensor attribute(const at::Tensor& tensor, const char* name, const at::Tensor& means, std::int64_t width) {
    if (!tensor.defined()) return {};
    const std::int64_t count = means.size(0);
    if (width == 1 && tensor.dim() == 1) return checked(tensor, kPlace, name, {count}, means);
    return checked(tensor, kPlace, name, {count, width}, means);
}

InputTensors checkedInputs(const SurfelTensors& surfels) {
    InputTensors inputs;
    inputs[kMeans] = checked(surfels.means, kPlace, "means", {-1, 3});
    const at::Tensor& means = inputs[kMeans];
    const std::int64_t n = means.size(0);
    inputs[kRotations] = checked(surfels.rotations, kPlace, "rotations", {n, 4}, means);
    inputs[kScales] = checked(surfels.scales, kPlace, "scales", {n, 2}, means);
    if (!surfels.opacities.defined()) operators::fail(kPlace, "opacities are missing");
    inputs[kOpacities] = attribute(surfels.opacities, "opacities", means, 1);
    inputs[kColors] = attribute(surfels.colors, "colors", means, 3);
    inputs[kAlbedos] = attribute(surfels.albedos, "albedos", means, 3);
    inputs[kRoughnesses] = attribute(surfels.roughnesses, "roughnesses", means, 1);
    inputs[kRadii] = attribute(surfels.radii, "radii", means, 1);
    return inputs;
}

/// Where backward writes: zeros of the inputs' sizes; attributes of whose picture no gradient came stay undefined.
struct InputGradients {
    InputTensors tensors;
    SurfelGradientArrays arrays;

    InputGradients(const InputTensors& inputs, const GBufferGradients& gradients) {
        const auto zeros = [&](Input input) {
            tensors[input] = at::zeros_like(inputs[input]);
            return tensors[input].mutable_data_ptr<float>();
        };
        arrays.means = zeros(kMeans);
        arrays.rotations = zeros(kRotations);
        arrays.scales = zeros(kScales);
        arrays.opacities = zeros(kOpacities);
        for (const auto& [channel, input] :
             {std::pair{Channel::Radiance, kColors}, std::pair{Channel::Albedo, kAlbedos},
              std::pair{Channel::Roughness, kRoughnesses}, std::pair{Channel::Radius, kRadii}}) {
            if (gradients[channel].empty()) continue;
            arrays.attributes[static_cast<std::size_t>(channel)] = zeros(input);
        }
    }
};

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
        const InputGradients out(inputs, gradients);
        require(scratch->backward(params, viewOfInputs(inputs), camera, gradients, out.arrays));
        return {out.tensors.begin(), out.tensors.end()};
    }
};

GBufferTensors picturesOf(const std::shared_ptr<SplatScratch>& scratch, ChannelSet channels) {
    GBufferTensors tensors;
    for (int i = 0; i < kChannelCount; ++i) {
        const auto channel = static_cast<Channel>(i);
        if (!channels.has(channel)) continue;
        PixelBuffer& picture = scratch->gbuffer()[channel];
        const ImageView<float> view = picture.view();
        tensors[channel] =
            operators::tensorOwnedBy(scratch, view.data, {view.height, view.width, view.channels}, picture.device());
    }
    return tensors;
}

} // namespace

GBufferTensors splatTensors(const SplatParams& params, const SurfelTensors& surfels, const Camera& camera,
                            ChannelSet channels, SplatScratchPool& pool) {
    const InputTensors inputs = checkedInputs(surfels);
    const at::Tensor& means = inputs[kMeans];
    const at::Tensor plus = attribute(surfels.radiiPlus, "radiiPlus", means, 1);
    const at::Tensor minus = attribute(surfels.radiiMinus, "radiiMinus", means, 1);
    const at::Tensor importances = attribute(surfels.importances, "importances", means, 1);
    const at::Tensor bones = attribute(surfels.bones, "bones", means, 3);
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
    require(scratch->forward(params, view, camera, made, gradient));
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
