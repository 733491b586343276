#include "engine/core/standard_exception.h"

#include <gtest/gtest.h>

#include <new>
#include <stdexcept>
#include <system_error>

namespace ars {
namespace {

TEST(StandardException, RefusedMemoryIsToldFromMistakes) {
    const Error memory = errorOfStandardException(std::bad_array_new_length(), "reading");
    EXPECT_EQ(memory.code, ErrorCode::OutOfMemory);
    EXPECT_EQ(memory.describe(), "reading: not enough memory");

    const Error thread = errorOfStandardException(
        std::system_error(std::make_error_code(std::errc::resource_unavailable_try_again)), "");
    EXPECT_EQ(thread.code, ErrorCode::OutOfMemory);
    EXPECT_EQ(thread.describe(), "not enough memory: a thread was refused");

    const Error map =
        errorOfStandardException(std::system_error(ENOMEM, std::generic_category(), "mapping a file"), "loading");
    EXPECT_EQ(map.code, ErrorCode::OutOfMemory);

    const Error door =
        errorOfStandardException(std::system_error(std::make_error_code(std::errc::permission_denied), "a door"), "");
    EXPECT_EQ(door.code, ErrorCode::Internal);
    EXPECT_NE(door.message.find("a door"), std::string::npos);

    const Error mistake = errorOfStandardException(std::out_of_range("index 7"), "step 3");
    EXPECT_EQ(mistake.code, ErrorCode::Internal);
    EXPECT_EQ(mistake.describe(), "step 3: index 7");
}

} // namespace
} // namespace ars
