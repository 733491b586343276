#pragma once

#include "engine/core/image_view.h"
#include "model/device.h"
#include "model/operators/surfel_operators.h"

#include <torch/csrc/autograd/function.h>
#include <torch/csrc/autograd/functions/utils.h>
#include <torch/csrc/autograd/saved_variable.h>

#include <initializer_list>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

/// What the operators of autograd share. Private to this folder.
namespace ars::operators {

/// Throws OperatorFailure where there is an error.
void require(const Status& status);
template <typename T>
T require(Result<T> result) {
    if (!result) throw OperatorFailure(std::move(result).error());
    return std::move(result).value();
}
[[noreturn]] void fail(std::string_view place, std::string message);

/// A float tensor of these sizes (-1: any) where engine/ works: in host memory or on a CUDA device; contiguous. Else
/// InvalidArgument naming it.
/// @param beside  another tensor of the call, on whose device it must lie; undefined: there is none yet
at::Tensor checked(const at::Tensor& tensor, std::string_view place, std::string_view name,
                   std::initializer_list<std::int64_t> sizes, const at::Tensor& beside = {});

/// A tensor over memory of `device` that `owner` keeps alive; not copied.
at::Tensor tensorOwnedBy(std::shared_ptr<void> owner, const float* data, at::IntArrayRef sizes, const Device& device);

/// A view of a picture for engine/; empty where the tensor is undefined.
ImageView<const float> pictureOf(const at::Tensor& tensor);
/// The same to write to.
ImageView<float> pictureToFill(at::Tensor& tensor);

/// Whether autograd must remember this call.
bool wantsGradient(std::initializer_list<at::Tensor> inputs);

/// A step of the graph that has one derivative. Nodes rather than torch::autograd::Function: these let go of what they
/// kept as soon as backward has passed, and memory for splatting is worth having back.
class Node : public torch::autograd::Node {
public:
    /// Called by `apply` of nodes before anything else: OperatorFailure for derivatives of derivatives, or where
    /// backward has passed already.
    void begin(const char* place) const;

    /// Keeps an input (or with `output` one of the node's own) whose later change autograd shall notice.
    void keep(const at::Tensor& tensor, bool output = false) { kept_.emplace_back(tensor, output); }
    /// In the order of keep(); undefined where that was.
    at::Tensor kept(std::size_t index) { return kept_[index].unpack(shared_from_this()); }

    void release_variables() override {
        kept_.clear();
        released_ = true;
    }

private:
    std::vector<torch::autograd::SavedVariable> kept_;
    bool released_ = false;
};

/// A node behind `inputs`: gradients are returned in their order.
template <typename NodeType, typename... Inputs>
std::shared_ptr<NodeType> makeNode(const Inputs&... inputs) {
    std::shared_ptr<NodeType> node(new NodeType(), torch::autograd::deleteNode);
    node->set_next_edges(torch::autograd::collect_next_edges(inputs...));
    return node;
}

} // namespace ars::operators
