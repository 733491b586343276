#pragma once

#include "engine/io/array.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <complex>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace ars::test {

inline std::filesystem::path fixture(const std::string& relative) {
    return test::sourceFolder() / "tests/unit/io/fixtures" / relative;
}

inline std::vector<std::byte> bytesOf(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    EXPECT_TRUE(file.is_open()) << path;
    const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    const auto bytes = std::as_bytes(std::span(text));
    return {bytes.begin(), bytes.end()};
}

inline nlohmann::json jsonOf(const std::filesystem::path& path) { return nlohmann::json::parse(std::ifstream(path)); }

/// A number as the fixture scripts write it: what is not finite stands as text.
inline double numberOf(const nlohmann::json& value) {
    if (!value.is_string()) return value.get<double>();
    if (value == "nan") return std::nan("");
    return value == "-inf" ? -INFINITY : INFINITY;
}

inline bool sameNumber(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

/// Element `i` equals the stored value exactly: every stored number is exact in JSON.
inline bool elementMatches(const Array& array, std::size_t i, const nlohmann::json& value) {
    const auto pair = [&](std::complex<double> z) {
        return sameNumber(z.real(), numberOf(value[0])) && sameNumber(z.imag(), numberOf(value[1]));
    };
    switch (array.dtype) {
    case DType::Text:
        return array.texts[i] == value.get<std::string>();
    case DType::Bool:
        return array.as<std::uint8_t>()[i] == (value.get<bool>() ? 1 : 0);
    case DType::U64:
        return array.as<std::uint64_t>()[i] == value.get<std::uint64_t>();
    case DType::C64:
        return pair(array.as<std::complex<float>>()[i]);
    case DType::C128:
        return pair(array.as<std::complex<double>>()[i]);
    case DType::F16:
    case DType::BF16:
    case DType::F32:
    case DType::F64:
        return sameNumber(array.toDouble()->at(i), numberOf(value));
    default:
        return array.toInt64()->at(i) == value.get<std::int64_t>();
    }
}

/// Type, shape and every element are what the package that made the fixture says.
inline void expectMatches(const Array& array, const nlohmann::json& expected) {
    EXPECT_EQ(dtypeName(array.dtype), expected["dtype"].get<std::string>());
    ASSERT_EQ(array.shape, expected["shape"].get<std::vector<std::size_t>>());
    ASSERT_TRUE(validateArray(array).ok());
    ASSERT_EQ(array.count(), expected["values"].size());
    for (std::size_t i = 0; i < array.count(); ++i) {
        EXPECT_TRUE(elementMatches(array, i, expected["values"][i]))
            << "element " << i << ": " << expected["values"][i];
    }
}

/// The same array to the last bit.
inline void expectIdentical(const Array& a, const Array& b) {
    EXPECT_EQ(a.dtype, b.dtype);
    EXPECT_EQ(a.shape, b.shape);
    EXPECT_EQ(a.bytes, b.bytes);
    EXPECT_EQ(a.texts, b.texts);
}

/// The error has this code and says these words, in one line.
inline void expectError(const Error& error, ErrorCode code, const std::string& words) {
    EXPECT_EQ(errorCodeName(error.code), errorCodeName(code)) << error.describe();
    EXPECT_NE(error.describe().find(words), std::string::npos) << error.describe();
    EXPECT_EQ(error.describe().find('\n'), std::string::npos);
}

/// How far the resident memory of the process rose above its value at the start while `work` ran, bytes.
template <typename Work>
std::uint64_t peakGrowth(Work&& work) {
    const auto field = [](const std::string& name) -> std::uint64_t {
        std::ifstream status("/proc/self/status");
        for (std::string line; std::getline(status, line);) {
            if (line.starts_with(name)) return std::stoull(line.substr(name.size() + 1)) * 1024;
        }
        return 0;
    };
    std::ofstream("/proc/self/clear_refs") << "5"; // resets VmHWM
    const std::uint64_t before = field("VmRSS:");
    work();
    const std::uint64_t peak = field("VmHWM:");
    return peak > before ? peak - before : 0;
}

} // namespace ars::test
