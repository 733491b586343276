#include "engine/io/gltf_accessor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace ars {
namespace {

Error bad(const std::string& place, std::string message) {
    return makeError(ErrorCode::BadFile, place, std::move(message));
}

std::size_t componentBytes(int componentType) {
    switch (componentType) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return 2;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
        return 4;
    default:
        return 0; // 32-bit signed integers and doubles are not glTF
    }
}

std::string_view typeName(int type) {
    switch (type) {
    case TINYGLTF_TYPE_SCALAR:
        return "SCALAR";
    case TINYGLTF_TYPE_VEC2:
        return "VEC2";
    case TINYGLTF_TYPE_VEC3:
        return "VEC3";
    case TINYGLTF_TYPE_VEC4:
        return "VEC4";
    case TINYGLTF_TYPE_MAT4:
        return "MAT4";
    default:
        return "another type";
    }
}

template <typename T>
T load(const unsigned char* source) {
    T value;
    std::memcpy(&value, source, sizeof(T));
    return value;
}

/// glTF 2.0, 3.6.2.3: normalised integers c stand for c / max, signed ones for max(c / max, -1).
template <typename T>
float scaled(const unsigned char* source, bool normalized) {
    const auto value = static_cast<float>(load<T>(source));
    return normalized ? std::max(value / static_cast<float>(std::numeric_limits<T>::max()), -1.0f) : value;
}

float floatComponent(const unsigned char* source, int componentType, bool normalized) {
    switch (componentType) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
        return scaled<std::int8_t>(source, normalized);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return scaled<std::uint8_t>(source, normalized);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
        return scaled<std::int16_t>(source, normalized);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return scaled<std::uint16_t>(source, normalized);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
        return scaled<std::uint32_t>(source, normalized);
    default:
        return load<float>(source);
    }
}

std::uint32_t integerComponent(const unsigned char* source, int componentType) {
    switch (componentType) {
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return load<std::uint8_t>(source);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return load<std::uint16_t>(source);
    default:
        return load<std::uint32_t>(source);
    }
}

bool isUnsignedInteger(int componentType) {
    return componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
           componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT ||
           componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
}

} // namespace

Result<std::size_t> GltfAccessors::count(int index, const std::string& place) const {
    if (index < 0 || static_cast<std::size_t>(index) >= model_.accessors.size()) {
        return bad(place, fmt::format("names accessor {}, the file has {}", index, model_.accessors.size()));
    }
    return model_.accessors[static_cast<std::size_t>(index)].count;
}

int GltfAccessors::typeOf(int index) const {
    const bool exists = index >= 0 && static_cast<std::size_t>(index) < model_.accessors.size();
    return exists ? model_.accessors[static_cast<std::size_t>(index)].type : -1;
}

Result<std::span<const unsigned char>> GltfAccessors::view(int index, const std::string& place) const {
    if (index < 0 || static_cast<std::size_t>(index) >= model_.bufferViews.size()) {
        return bad(place, fmt::format("names buffer view {}, the file has {}", index, model_.bufferViews.size()));
    }
    const tinygltf::BufferView& view = model_.bufferViews[static_cast<std::size_t>(index)];
    if (view.buffer < 0 || static_cast<std::size_t>(view.buffer) >= model_.buffers.size()) {
        return bad(place, fmt::format("buffer view {} names buffer {}, the file has {}", index, view.buffer,
                                      model_.buffers.size()));
    }
    const std::vector<unsigned char>& data = model_.buffers[static_cast<std::size_t>(view.buffer)].data;
    if (view.byteOffset > data.size() || view.byteLength > data.size() - view.byteOffset) {
        return bad(place, fmt::format("buffer view {} is bytes {} to {} of buffer {}, which has {}", index,
                                      view.byteOffset, view.byteOffset + view.byteLength, view.buffer, data.size()));
    }
    return std::span<const unsigned char>(data).subspan(view.byteOffset, view.byteLength);
}

Result<GltfAccessors::Layout> GltfAccessors::layout(int index, int type, std::optional<std::size_t> expectedCount,
                                                    const std::string& place) const {
    ARS_TRY(const std::size_t elements, count(index, place));
    const tinygltf::Accessor& accessor = model_.accessors[static_cast<std::size_t>(index)];
    Layout layout;
    layout.accessor = &accessor;
    layout.componentBytes = componentBytes(accessor.componentType);
    if (layout.componentBytes == 0) {
        return bad(place,
                   fmt::format("accessor {} has the component type {}, expected one from 5120 to 5126 except 5124",
                               index, accessor.componentType));
    }
    if (accessor.type != type) {
        return bad(place,
                   fmt::format("accessor {} is {}, expected {}", index, typeName(accessor.type), typeName(type)));
    }
    layout.components = static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type)));
    if (elements == 0) return bad(place, fmt::format("accessor {} has no elements", index));
    if (expectedCount && elements != *expectedCount) {
        return bad(place, fmt::format("accessor {} has {} elements, expected {}", index, elements, *expectedCount));
    }
    if (elements > limits_.maxElements) {
        return makeError(ErrorCode::LimitExceeded, place,
                         fmt::format("{} elements, the limit is {}", elements, limits_.maxElements));
    }
    if (accessor.bufferView < 0) {
        if (!expectedCount) return bad(place, fmt::format("accessor {} has no buffer view", index));
        return layout;
    }
    ARS_TRY(const auto bytes, view(accessor.bufferView, place));
    const std::size_t elementBytes = layout.componentBytes * layout.components;
    const std::size_t viewStride = model_.bufferViews[static_cast<std::size_t>(accessor.bufferView)].byteStride;
    layout.stride = viewStride == 0 ? elementBytes : viewStride;
    if (layout.stride < elementBytes) {
        return bad(place, fmt::format("accessor {} has elements of {} bytes every {} bytes", index, elementBytes,
                                      layout.stride));
    }
    // All factors fit in 32 bits, so 64 bits hold the sum.
    const std::uint64_t end = accessor.byteOffset + (elements - 1) * layout.stride + elementBytes;
    if (end > bytes.size()) {
        return bad(place, fmt::format("accessor {} reaches to byte {} of buffer view {}, which has {}", index, end,
                                      accessor.bufferView, bytes.size()));
    }
    layout.data = bytes.data() + accessor.byteOffset;
    return layout;
}

Result<GltfAccessors::Sparse> GltfAccessors::sparse(const Layout& layout, const std::string& place) const {
    Sparse result;
    const tinygltf::Accessor& accessor = *layout.accessor;
    if (!accessor.sparse.isSparse) return result;
    const auto& indices = accessor.sparse.indices;
    const auto& values = accessor.sparse.values;
    if (accessor.sparse.count < 0 || static_cast<std::size_t>(accessor.sparse.count) > accessor.count) {
        return bad(place, fmt::format("{} sparse elements of {}", accessor.sparse.count, accessor.count));
    }
    const auto count = static_cast<std::size_t>(accessor.sparse.count);
    if (!isUnsignedInteger(indices.componentType) || indices.byteOffset < 0 || values.byteOffset < 0) {
        return bad(place, "the indices of its sparse elements are not unsigned integers");
    }
    const std::size_t indexBytes = componentBytes(indices.componentType);
    const std::size_t valueBytes = layout.componentBytes * layout.components;
    ARS_TRY(const auto indexView, view(indices.bufferView, place));
    ARS_TRY(const auto valueView, view(values.bufferView, place));
    const auto indexOffset = static_cast<std::size_t>(indices.byteOffset);
    const auto valueOffset = static_cast<std::size_t>(values.byteOffset);
    if (indexOffset + count * indexBytes > indexView.size() || valueOffset + count * valueBytes > valueView.size()) {
        return bad(place, fmt::format("{} sparse elements do not fit in their buffer views", count));
    }
    result.values = valueView.data() + valueOffset;
    result.indices.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t element =
            integerComponent(indexView.data() + indexOffset + i * indexBytes, indices.componentType);
        if (element >= accessor.count) {
            return bad(place, fmt::format("sparse element {} replaces number {} of {}", i, element, accessor.count));
        }
        result.indices[i] = element;
    }
    return result;
}

template <typename T, typename Convert>
Result<std::vector<T>> GltfAccessors::gather(const Layout& layout, const std::string& place, Convert&& convert) {
    const std::size_t elements = layout.accessor->count, components = layout.components;
    ARS_TRY_STATUS(budget_.take(elements * components * sizeof(T), place));
    ARS_TRY(const Sparse replaced, sparse(layout, place));
    std::vector<T> values(elements * components);
    const auto fill = [&](std::size_t element, const unsigned char* source) {
        for (std::size_t c = 0; c < components; ++c) {
            values[element * components + c] = convert(source + c * layout.componentBytes);
        }
    };
    if (layout.data) {
        for (std::size_t i = 0; i < elements; ++i) fill(i, layout.data + i * layout.stride);
    }
    for (std::size_t i = 0; i < replaced.indices.size(); ++i) {
        fill(replaced.indices[i], replaced.values + i * components * layout.componentBytes);
    }
    return values;
}

Result<std::vector<float>> GltfAccessors::floats(int index, int type, std::optional<std::size_t> expectedCount,
                                                 const std::string& place) {
    ARS_TRY(const Layout where, layout(index, type, expectedCount, place));
    const int componentType = where.accessor->componentType;
    const bool normalized = where.accessor->normalized;
    ARS_TRY(std::vector<float> values, gather<float>(where, place, [=](const unsigned char* source) {
                return floatComponent(source, componentType, normalized);
            }));
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (std::isfinite(values[i])) continue;
        return bad(place, fmt::format("element {} is {}, expected finite numbers", i / where.components, values[i]));
    }
    return values;
}

Result<std::vector<std::uint32_t>>
GltfAccessors::integers(int index, int type, std::optional<std::size_t> expectedCount, const std::string& place) {
    ARS_TRY(const Layout where, layout(index, type, expectedCount, place));
    const int componentType = where.accessor->componentType;
    if (!isUnsignedInteger(componentType) || where.accessor->normalized) {
        return bad(place, fmt::format("accessor {} has the component type {}, expected an unsigned integer", index,
                                      componentType));
    }
    return gather<std::uint32_t>(where, place,
                                 [=](const unsigned char* source) { return integerComponent(source, componentType); });
}

} // namespace ars
