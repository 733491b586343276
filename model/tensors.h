#pragma once

#include "engine/core/error.h"
#include "engine/core/image_view.h"
#include "engine/io/array.h"

#include <ATen/core/Tensor.h>

#include <glm/glm.hpp>

#include <span>
#include <string>
#include <vector>

namespace ars {

struct SafetensorsFile;

/// Copies of numbers: (N), (N, 2), (N, 3) float.
at::Tensor tensorOf(std::span<const float> values);
at::Tensor tensorOf(std::span<const glm::vec2> values);
at::Tensor tensorOf(std::span<const glm::vec3> values);
/// A copy of a picture, (height, width, channels).
at::Tensor tensorOf(ImageView<const float> picture);

/// A view of a contiguous (height, width, channels) or (height, width) float tensor in host memory; asserts on others.
ImageView<const float> viewOf(const at::Tensor& picture);
ImageView<float> writableViewOf(at::Tensor& picture);

/// Between tensors and arrays of files, both copied; any type that both know.
Array arrayFromTensor(const at::Tensor& tensor);
Result<at::Tensor> tensorFromArray(const Array& array);

/// A tensor that training changes, or one that belongs to the network all the same (fixed noise).
struct NetworkTensor {
    std::string name; ///< "position.convs1.3.conv.weight"
    at::Tensor tensor;
    bool trainable = true;
};

/// The tensors of a network under their names, in a fixed order: what optimiser, checkpoint and counting go through.
/// Tensors are handles: a network keeps copies of them that share memory.
class NetworkTensors {
public:
    /// Adds a leaf that requires a gradient; returns it.
    at::Tensor parameter(std::string name, at::Tensor initial);
    /// Adds one that does not.
    at::Tensor constant(std::string name, at::Tensor initial);
    /// All of `other` with `prefix` before their names.
    void append(const std::string& prefix, const NetworkTensors& other);

    const std::vector<NetworkTensor>& all() const { return tensors_; }
    std::vector<NetworkTensor>& all() { return tensors_; }
    /// Numbers in trainable tensors.
    std::int64_t parameterCount() const;

    /// float32 copies under `prefix` + name.
    void store(SafetensorsFile& file, const std::string& prefix = "") const;
    /// Copies values into the tensors. BadFile naming the tensor that is missing, has another shape (both given) or
    /// holds numbers that are not finite; nothing is changed then.
    Status load(const SafetensorsFile& file, const std::string& prefix = "");

private:
    std::vector<NetworkTensor> tensors_;
};

} // namespace ars
