#include "engine/io/array.h"

#include <half.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace ars {
namespace {

float halfToFloat(std::uint16_t bits) { return imath_half_to_float(bits); }

float brainToFloat(std::uint16_t bits) { return std::bit_cast<float>(static_cast<std::uint32_t>(bits) << 16); }

/// Calls visit(get) where get(i) is element i in a type that holds it exactly. False for Text and complex.
template <typename Visit>
bool visitReal(const Array& array, Visit&& visit) {
    const auto plain = [&]<typename T>(T) { visit([v = array.as<T>()](std::size_t i) { return v[i]; }); };
    switch (array.dtype) {
    case DType::Bool:
    case DType::U8:
        plain(std::uint8_t{});
        return true;
    case DType::I8:
        plain(std::int8_t{});
        return true;
    case DType::I16:
        plain(std::int16_t{});
        return true;
    case DType::I32:
        plain(std::int32_t{});
        return true;
    case DType::I64:
        plain(std::int64_t{});
        return true;
    case DType::U16:
        plain(std::uint16_t{});
        return true;
    case DType::U32:
        plain(std::uint32_t{});
        return true;
    case DType::U64:
        plain(std::uint64_t{});
        return true;
    case DType::F32:
        plain(float{});
        return true;
    case DType::F64:
        plain(double{});
        return true;
    case DType::F16:
        visit([v = array.as<std::uint16_t>()](std::size_t i) { return halfToFloat(v[i]); });
        return true;
    case DType::BF16:
        visit([v = array.as<std::uint16_t>()](std::size_t i) { return brainToFloat(v[i]); });
        return true;
    case DType::C64:
    case DType::C128:
    case DType::Text:
        return false;
    }
    return false;
}

Error notReal(const Array& array, std::string_view wanted) {
    return makeError(ErrorCode::InvalidArgument, "",
                     fmt::format("expected real numbers to convert to {}, found {}", wanted, array.describe()));
}

template <typename T>
Result<std::vector<T>> toReal(const Array& array) {
    ARS_TRY_STATUS(validateArray(array));
    std::vector<T> values(array.count());
    const bool real = visitReal(array, [&](auto get) {
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<T>(get(i));
    });
    if (!real) return notReal(array, sizeof(T) == 4 ? "float32" : "float64");
    return values;
}

/// Whether `value` is an integer that int64 holds.
template <typename T>
bool fitsInt64(T value) {
    if constexpr (std::is_floating_point_v<T>) {
        return value >= T(-9223372036854775808.0) && value < T(9223372036854775808.0) && std::trunc(value) == value;
    } else if constexpr (std::is_same_v<T, std::uint64_t>) {
        return value <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
    } else {
        return true;
    }
}

template <typename T>
Array fromNumbers(DType dtype, std::vector<std::size_t> shape, std::span<const T> values) {
    Array array;
    array.dtype = dtype;
    array.shape = std::move(shape);
    array.bytes.resize(values.size_bytes());
    if (!values.empty()) std::memcpy(array.bytes.data(), values.data(), values.size_bytes());
    assert(array.count() == values.size());
    return array;
}

} // namespace

std::size_t dtypeBytes(DType type) {
    switch (type) {
    case DType::Bool:
    case DType::I8:
    case DType::U8:
        return 1;
    case DType::I16:
    case DType::U16:
    case DType::F16:
    case DType::BF16:
        return 2;
    case DType::I32:
    case DType::U32:
    case DType::F32:
        return 4;
    case DType::I64:
    case DType::U64:
    case DType::F64:
    case DType::C64:
        return 8;
    case DType::C128:
        return 16;
    case DType::Text:
        return 0;
    }
    return 0;
}

std::string_view dtypeName(DType type) {
    switch (type) {
    case DType::Bool:
        return "bool";
    case DType::I8:
        return "int8";
    case DType::I16:
        return "int16";
    case DType::I32:
        return "int32";
    case DType::I64:
        return "int64";
    case DType::U8:
        return "uint8";
    case DType::U16:
        return "uint16";
    case DType::U32:
        return "uint32";
    case DType::U64:
        return "uint64";
    case DType::F16:
        return "float16";
    case DType::BF16:
        return "bfloat16";
    case DType::F32:
        return "float32";
    case DType::F64:
        return "float64";
    case DType::C64:
        return "complex64";
    case DType::C128:
        return "complex128";
    case DType::Text:
        return "text";
    }
    return "?";
}

Result<std::size_t> elementCount(std::span<const std::size_t> shape, std::size_t elementBytes) {
    constexpr std::uint64_t kMost = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
    std::uint64_t bytes = std::max<std::size_t>(elementBytes, 1);
    bool empty = false;
    for (const std::size_t extent : shape) {
        if (extent == 0) {
            empty = true;
        } else if (extent > kMost / bytes) {
            return makeError(ErrorCode::LimitExceeded, "",
                             fmt::format("shape {} of {} bytes an element does not fit in 63 bits", formatShape(shape),
                                         elementBytes));
        } else {
            bytes *= extent;
        }
    }
    return empty ? std::size_t{0} : static_cast<std::size_t>(bytes / std::max<std::size_t>(elementBytes, 1));
}

std::size_t Array::count() const {
    std::size_t product = 1;
    for (const std::size_t extent : shape) product *= extent;
    return product;
}

std::string Array::describe() const { return fmt::format("{} {}", dtypeName(dtype), formatShape(shape)); }

Result<std::vector<float>> Array::toFloat() const { return toReal<float>(*this); }

Result<std::vector<double>> Array::toDouble() const { return toReal<double>(*this); }

Result<std::vector<std::int64_t>> Array::toInt64() const {
    ARS_TRY_STATUS(validateArray(*this));
    std::vector<std::int64_t> values(count());
    std::optional<Error> misfit;
    const bool real = visitReal(*this, [&](auto get) {
        for (std::size_t i = 0; i < values.size(); ++i) {
            const auto value = get(i);
            if (!fitsInt64(value)) {
                misfit = makeError(ErrorCode::InvalidArgument, fmt::format("element {}", i),
                                   fmt::format("expected a 64-bit integer, found {}", value));
                return;
            }
            values[i] = static_cast<std::int64_t>(value);
        }
    });
    if (!real) return notReal(*this, "int64");
    if (misfit) return *std::move(misfit);
    return values;
}

Array Array::fromFloats(std::vector<std::size_t> shape, std::span<const float> values) {
    return fromNumbers(DType::F32, std::move(shape), values);
}

Array Array::fromDoubles(std::vector<std::size_t> shape, std::span<const double> values) {
    return fromNumbers(DType::F64, std::move(shape), values);
}

Array Array::fromInts(std::vector<std::size_t> shape, std::span<const std::int64_t> values) {
    return fromNumbers(DType::I64, std::move(shape), values);
}

Array Array::fromTexts(std::vector<std::size_t> shape, std::vector<std::string> values) {
    Array array;
    array.dtype = DType::Text;
    array.shape = std::move(shape);
    array.texts = std::move(values);
    assert(array.count() == array.texts.size());
    return array;
}

Status validateArray(const Array& array) {
    ARS_TRY(const std::size_t count, elementCount(array.shape, dtypeBytes(array.dtype)));
    const bool text = array.dtype == DType::Text;
    if (text ? array.texts.size() != count : array.bytes.size() != count * dtypeBytes(array.dtype)) {
        return makeError(ErrorCode::InvalidArgument, "",
                         text ? fmt::format("{} has {} texts, expected {}", array.describe(), array.texts.size(), count)
                              : fmt::format("{} has {} bytes, expected {}", array.describe(), array.bytes.size(),
                                            count * dtypeBytes(array.dtype)));
    }
    return {};
}

Status requireShape(const Array& array, std::string_view name, std::span<const std::size_t> shape) {
    const auto matches = [](std::size_t expected, std::size_t found) {
        return expected == kAnySize || expected == found;
    };
    if (std::equal(shape.begin(), shape.end(), array.shape.begin(), array.shape.end(), matches)) return {};
    return makeError(ErrorCode::InvalidArgument, std::string(name),
                     fmt::format("expected shape {}, found {}", formatShape(shape), formatShape(array.shape)));
}

std::string formatShape(std::span<const std::size_t> shape) {
    std::string text = "(";
    for (std::size_t i = 0; i < shape.size(); ++i) {
        if (i > 0) text += ", ";
        text += shape[i] == kAnySize ? "*" : fmt::format("{}", shape[i]);
    }
    return text + (shape.size() == 1 ? ",)" : ")");
}

} // namespace ars
