#include "model/tensors.h"

#include "engine/io/safetensors.h"

#include <ATen/ATen.h>
#include <torch/csrc/autograd/grad_mode.h>

#include <cassert>
#include <cmath>
#include <cstring>
#include <optional>

namespace ars {
namespace {

struct TypePair {
    DType file;
    at::ScalarType torch;
};
constexpr TypePair kTypes[] = {
    {DType::Bool, at::kBool},  {DType::I8, at::kChar},          {DType::I16, at::kShort},
    {DType::I32, at::kInt},    {DType::I64, at::kLong},         {DType::U8, at::kByte},
    {DType::U16, at::kUInt16}, {DType::U32, at::kUInt32},       {DType::U64, at::kUInt64},
    {DType::F16, at::kHalf},   {DType::BF16, at::kBFloat16},    {DType::F32, at::kFloat},
    {DType::F64, at::kDouble}, {DType::C64, at::kComplexFloat}, {DType::C128, at::kComplexDouble},
};

template <typename T>
at::Tensor copyOf(const T* values, at::IntArrayRef shape) {
    // from_blob wants memory it may write; the clone is the only one who keeps it.
    return at::from_blob(const_cast<T*>(values), shape, at::kFloat).clone();
}

std::int64_t signedSize(std::size_t size) { return static_cast<std::int64_t>(size); }

std::string shapeText(at::IntArrayRef shape) {
    const std::vector<std::size_t> sizes(shape.begin(), shape.end());
    return formatShape(sizes);
}

/// The numbers of a file's tensor as floats: its own memory where it has that type already, else `converted`.
Result<std::span<const float>> floatsOf(const Array& array, std::vector<float>& converted) {
    if (array.dtype == DType::F32) return array.as<float>();
    ARS_TRY(converted, array.toFloat());
    return std::span<const float>(converted);
}

Status checkLoadable(const NetworkTensor& entry, const std::string& name, const SafetensorsFile& file) {
    const auto found = file.tensors.find(name);
    if (found == file.tensors.end()) {
        return makeError(
            ErrorCode::BadFile, name,
            fmt::format("the network has this tensor of shape {}, the file has not", shapeText(entry.tensor.sizes())));
    }
    const Array& array = found->second;
    const auto sizes = entry.tensor.sizes();
    if (!std::equal(sizes.begin(), sizes.end(), array.shape.begin(), array.shape.end(),
                    [](std::int64_t a, std::size_t b) { return a == static_cast<std::int64_t>(b); })) {
        return makeError(ErrorCode::BadFile, name,
                         fmt::format("expected shape {}, found {}", shapeText(sizes), formatShape(array.shape)));
    }
    std::vector<float> converted;
    auto values = floatsOf(array, converted);
    if (!values) {
        return makeError(ErrorCode::BadFile, name, fmt::format("expected numbers, found {}", array.describe()));
    }
    for (std::size_t i = 0; i < values->size(); ++i) {
        if (!std::isfinite((*values)[i])) {
            return makeError(ErrorCode::BadFile, name,
                             fmt::format("expected finite numbers, found {} at element {}", (*values)[i], i));
        }
    }
    return {};
}

} // namespace

at::Tensor tensorOf(std::span<const float> values) { return copyOf(values.data(), {signedSize(values.size())}); }

at::Tensor tensorOf(std::span<const glm::vec2> values) { return copyOf(values.data(), {signedSize(values.size()), 2}); }

at::Tensor tensorOf(std::span<const glm::vec3> values) { return copyOf(values.data(), {signedSize(values.size()), 3}); }

at::Tensor tensorOf(ImageView<const float> picture) {
    return copyOf(picture.data, {picture.height, picture.width, picture.channels});
}

ImageView<float> writableViewOf(at::Tensor& picture) {
    assert(picture.is_contiguous() && picture.scalar_type() == at::kFloat && picture.device().is_cpu());
    assert(picture.dim() == 2 || picture.dim() == 3);
    return {picture.data_ptr<float>(), static_cast<int>(picture.size(1)), static_cast<int>(picture.size(0)),
            picture.dim() == 3 ? static_cast<int>(picture.size(2)) : 1};
}

ImageView<const float> viewOf(const at::Tensor& picture) {
    at::Tensor handle = picture;
    return writableViewOf(handle);
}

Array arrayFromTensor(const at::Tensor& tensor) {
    const at::Tensor plain = tensor.detach().cpu().contiguous();
    Array array;
    for (const TypePair& pair : kTypes) {
        if (pair.torch == plain.scalar_type()) array.dtype = pair.file;
    }
    array.shape.assign(plain.sizes().begin(), plain.sizes().end());
    array.bytes.resize(plain.nbytes());
    assert(array.bytes.size() == array.count() * dtypeBytes(array.dtype));
    if (!array.bytes.empty()) std::memcpy(array.bytes.data(), plain.const_data_ptr(), array.bytes.size());
    return array;
}

Result<at::Tensor> tensorFromArray(const Array& array) {
    ARS_TRY_STATUS(validateArray(array));
    std::optional<at::ScalarType> type;
    for (const TypePair& pair : kTypes) {
        if (pair.file == array.dtype) type = pair.torch;
    }
    if (!type) {
        return makeError(ErrorCode::Unsupported, "", fmt::format("expected numbers, found {}", array.describe()));
    }
    const std::vector<std::int64_t> shape(array.shape.begin(), array.shape.end());
    at::Tensor tensor = at::empty(shape, *type);
    if (!array.bytes.empty()) std::memcpy(tensor.mutable_data_ptr(), array.bytes.data(), array.bytes.size());
    return tensor;
}

at::Tensor NetworkTensors::parameter(std::string name, at::Tensor initial) {
    at::Tensor leaf = initial.detach();
    leaf.requires_grad_(true);
    tensors_.push_back({std::move(name), leaf, true});
    return leaf;
}

at::Tensor NetworkTensors::constant(std::string name, at::Tensor initial) {
    at::Tensor fixed = initial.detach();
    tensors_.push_back({std::move(name), fixed, false});
    return fixed;
}

void NetworkTensors::append(const std::string& prefix, const NetworkTensors& other) {
    for (const NetworkTensor& entry : other.tensors_) {
        tensors_.push_back({prefix + entry.name, entry.tensor, entry.trainable});
    }
}

std::int64_t NetworkTensors::parameterCount() const {
    std::int64_t count = 0;
    for (const NetworkTensor& entry : tensors_) count += entry.trainable ? entry.tensor.numel() : 0;
    return count;
}

void NetworkTensors::store(SafetensorsFile& file, const std::string& prefix) const {
    for (const NetworkTensor& entry : tensors_) {
        file.tensors[prefix + entry.name] = arrayFromTensor(entry.tensor.detach().to(at::kFloat));
    }
}

Status NetworkTensors::load(const SafetensorsFile& file, const std::string& prefix) {
    for (const NetworkTensor& entry : tensors_) {
        ARS_TRY_STATUS(checkLoadable(entry, prefix + entry.name, file));
    }
    const at::NoGradGuard noGradients;
    std::vector<float> converted;
    for (NetworkTensor& entry : tensors_) {
        ARS_TRY(const std::span<const float> values, floatsOf(file.tensors.at(prefix + entry.name), converted));
        entry.tensor.copy_(at::from_blob(const_cast<float*>(values.data()), entry.tensor.sizes(), at::kFloat));
    }
    return {};
}

} // namespace ars
