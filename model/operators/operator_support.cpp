#include "model/operators/operator_support.h"

#include <ATen/ATen.h>

namespace ars::operators {

namespace {

std::string sizesText(at::IntArrayRef sizes) {
    std::string text = "(";
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        if (i > 0) text += ", ";
        text += sizes[i] < 0 ? "any" : std::to_string(sizes[i]);
    }
    return text + ")";
}

bool fits(at::IntArrayRef found, at::IntArrayRef expected) {
    if (found.size() != expected.size()) return false;
    for (std::size_t i = 0; i < found.size(); ++i) {
        if (expected[i] >= 0 && found[i] != expected[i]) return false;
    }
    return true;
}

} // namespace

void require(const Status& status) {
    if (!status) throw OperatorFailure(status.error());
}

void fail(std::string_view place, std::string message) {
    throw OperatorFailure(makeError(ErrorCode::InvalidArgument, std::string(place), std::move(message)));
}

at::Tensor checked(const at::Tensor& tensor, std::string_view place, std::string_view name,
                   std::initializer_list<std::int64_t> sizes, const at::Tensor& beside) {
    const at::IntArrayRef expected(sizes.begin(), sizes.size());
    if (!tensor.defined()) {
        fail(place, fmt::format("{} is missing, expected a tensor {}", name, sizesText(expected)));
    }
    if (beside.defined() && tensor.device() != beside.device()) {
        fail(place, fmt::format("{} lies on {}, expected {} as the others of this call", name, tensor.device().str(),
                                beside.device().str()));
    }
    if (tensor.scalar_type() != at::kFloat || !(tensor.device().is_cpu() || tensor.device().is_cuda())) {
        fail(place, fmt::format("{} is {} on {}, expected float in host memory or on a CUDA device", name,
                                c10::toString(tensor.scalar_type()), tensor.device().str()));
    }
    if (!fits(tensor.sizes(), expected)) {
        fail(place, fmt::format("{} is {}, expected {}", name, sizesText(tensor.sizes()), sizesText(expected)));
    }
    return tensor.contiguous();
}

at::Tensor tensorOwnedBy(std::shared_ptr<void> owner, const float* data, at::IntArrayRef sizes, const Device& device) {
    const c10::Device where = torchDevice(device);
    const at::TensorOptions options = at::TensorOptions(at::kFloat).device(where);
    if (!data) return at::zeros(sizes, options); // nothing has no memory
    return at::from_blob(
        const_cast<float*>(data), sizes, [owner = std::move(owner)](void*) mutable { owner.reset(); }, options, where);
}

ImageView<const float> pictureOf(const at::Tensor& tensor) {
    if (!tensor.defined()) return {};
    return {tensor.const_data_ptr<float>(), static_cast<int>(tensor.size(1)), static_cast<int>(tensor.size(0)),
            static_cast<int>(tensor.size(2))};
}

ImageView<float> pictureToFill(at::Tensor& tensor) {
    return {tensor.mutable_data_ptr<float>(), static_cast<int>(tensor.size(1)), static_cast<int>(tensor.size(0)),
            static_cast<int>(tensor.size(2))};
}

bool wantsGradient(std::initializer_list<at::Tensor> inputs) {
    if (!at::GradMode::is_enabled()) return false;
    for (const at::Tensor& input : inputs) {
        if (input.defined() && input.requires_grad()) return true;
    }
    return false;
}

void Node::begin(const char* place) const {
    if (at::GradMode::is_enabled()) {
        throw OperatorFailure(makeError(ErrorCode::Unsupported, place, "derivatives of derivatives were asked for"));
    }
    if (released_) {
        throw OperatorFailure(makeError(ErrorCode::InvalidArgument, place,
                                        "backward has passed here already and what it needs was let go of; expected "
                                        "it once for each forward"));
    }
}

} // namespace ars::operators
