#pragma once

#include "engine/core/error.h"

#include <complex>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// Element types of numpy arrays and safetensors.
enum class DType { Bool, I8, I16, I32, I64, U8, U16, U32, U64, F16, BF16, F32, F64, C64, C128, Text };

/// Bytes of one element; 0 for Text, whose length belongs to the array.
std::size_t dtypeBytes(DType type);
/// "float32", "int64", "text"...
std::string_view dtypeName(DType type);

/// Whether the bytes of a `type` array can be seen as T: T itself, the bits of F16 and BF16 as uint16_t, Bool (0 or 1)
/// as uint8_t.
template <typename T>
constexpr bool dtypeHolds(DType type) {
    if constexpr (std::is_same_v<T, std::int8_t>) return type == DType::I8;
    if constexpr (std::is_same_v<T, std::int16_t>) return type == DType::I16;
    if constexpr (std::is_same_v<T, std::int32_t>) return type == DType::I32;
    if constexpr (std::is_same_v<T, std::int64_t>) return type == DType::I64;
    if constexpr (std::is_same_v<T, std::uint8_t>) return type == DType::U8 || type == DType::Bool;
    if constexpr (std::is_same_v<T, std::uint16_t>)
        return type == DType::U16 || type == DType::F16 || type == DType::BF16;
    if constexpr (std::is_same_v<T, std::uint32_t>) return type == DType::U32;
    if constexpr (std::is_same_v<T, std::uint64_t>) return type == DType::U64;
    if constexpr (std::is_same_v<T, float>) return type == DType::F32;
    if constexpr (std::is_same_v<T, double>) return type == DType::F64;
    if constexpr (std::is_same_v<T, std::complex<float>>) return type == DType::C64;
    if constexpr (std::is_same_v<T, std::complex<double>>) return type == DType::C128;
    return false;
}

/// Number of elements of a shape, or LimitExceeded when it or its bytes do not fit in 63 bits. An extent of 0 does not
/// excuse the others: (0, 2^40, 2^40) is refused, as numpy does.
Result<std::size_t> elementCount(std::span<const std::size_t> shape, std::size_t elementBytes);

/// An n-dimensional array on the host, row-major (C order), native byte order, whatever the file had.
struct Array {
    DType dtype = DType::F32;
    std::vector<std::size_t> shape; ///< empty: a scalar
    std::vector<std::byte> bytes;   ///< elements; unused by Text
    std::vector<std::string> texts; ///< Text only: UTF-8, one per element

    std::size_t count() const;
    /// "float32 (55, 13380)"
    std::string describe() const;

    /// The elements in place; the type must be exactly T's (asserted, see dtypeHolds).
    template <typename T>
    std::span<const T> as() const {
        assert(dtypeHolds<T>(dtype));
        return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
    }
    template <typename T>
    std::span<T> as() {
        assert(dtypeHolds<T>(dtype));
        return {reinterpret_cast<T*>(bytes.data()), bytes.size() / sizeof(T)};
    }

    /// The elements converted from any real number type. InvalidArgument for Text and complex, and where an integer
    /// target cannot hold a value exactly (named with its index). A double beyond float's range becomes infinite.
    Result<std::vector<float>> toFloat() const;
    Result<std::vector<double>> toDouble() const;
    Result<std::vector<std::int64_t>> toInt64() const;

    static Array fromFloats(std::vector<std::size_t> shape, std::span<const float> values);
    static Array fromDoubles(std::vector<std::size_t> shape, std::span<const double> values);
    static Array fromInts(std::vector<std::size_t> shape, std::span<const std::int64_t> values);
    static Array fromTexts(std::vector<std::size_t> shape, std::vector<std::string> values);
};

/// InvalidArgument unless bytes (or texts) hold exactly as many elements as the shape says. Writers call it.
Status validateArray(const Array& array);

/// InvalidArgument with both shapes unless `array` has `shape`; kAnySize matches any extent.
inline constexpr std::size_t kAnySize = static_cast<std::size_t>(-1);
Status requireShape(const Array& array, std::string_view name, std::span<const std::size_t> shape);

/// "(55, 13380)", "(3,)", "()", with "*" for kAnySize.
std::string formatShape(std::span<const std::size_t> shape);

} // namespace ars
