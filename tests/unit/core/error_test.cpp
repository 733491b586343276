#include "engine/core/error.h"

#include <gtest/gtest.h>

#include <memory>

namespace ars {
namespace {

Result<int> half(int value) {
    if (value % 2)
        return makeError(ErrorCode::InvalidArgument, "value", fmt::format("expected an even number, found {}", value));
    return value / 2;
}

Result<int> quarter(int value) {
    ARS_TRY(const int first, half(value));
    ARS_TRY(const int second, half(first));
    return second;
}

Status checkEven(int value) {
    ARS_TRY_STATUS([&]() -> Status {
        auto result = half(value);
        return result ? Status() : Status(result.error());
    }());
    return {};
}

TEST(Error, PlaceMessageAndContextMakeOneLine) {
    Error error = makeError(ErrorCode::BadFile, "K", "has 8 numbers, expected 9");
    error = atPlace(std::move(error), "calibration.json");
    error = withContext(std::move(error), "opening the capture");
    EXPECT_EQ(error.describe(), "calibration.json: K: has 8 numbers, expected 9 (while opening the capture)");
    EXPECT_EQ(errorCodeName(error.code), "bad_file");
    EXPECT_NE(std::string(error.origin.fileName()).find("error_test.cpp"), std::string::npos);
}

TEST(Error, ControlCharactersOfHostileNamesCannotBreakTheLine) {
    const std::string text = makeError(ErrorCode::BadFile, "a\nb", "x\x1b[31m\r").describe();
    EXPECT_EQ(text.find_first_of("\n\r\x1b"), std::string::npos);
}

TEST(Result, FirstFailureEndsTheFunction) {
    EXPECT_EQ(quarter(12).value(), 3);
    const Result<int> failed = quarter(6);
    ASSERT_FALSE(failed.ok());
    EXPECT_EQ(failed.error().message, "expected an even number, found 3");
    EXPECT_TRUE(checkEven(4).ok());
    EXPECT_EQ(checkEven(5).error().code, ErrorCode::InvalidArgument);
}

TEST(Result, HoldsTypesThatOnlyMove) {
    Result<std::unique_ptr<int>> result(std::make_unique<int>(7));
    ASSERT_TRUE(result.ok());
    const std::unique_ptr<int> taken = std::move(result).value();
    EXPECT_EQ(*taken, 7);
}

} // namespace
} // namespace ars
