#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

namespace ars::test {

/// The checkout that these tests were built from; fixtures lie in it.
std::filesystem::path sourceFolder();

/// The shared test data, or an empty path where ARS_TEST_DATA is not set.
inline std::filesystem::path dataFolder() {
    const char* text = std::getenv("ARS_TEST_DATA");
    return text ? std::filesystem::path(text) : std::filesystem::path();
}

/// Says that the running test (or part of it) could not run here, in the one form that `./ars test` counts. With
/// ARS_REQUIRE_DATA=1 that is a failure.
inline void notRun(const std::string& why) {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    std::printf("NOT RUN: %s.%s: %s\n", info ? info->test_suite_name() : "", info ? info->name() : "", why.c_str());
    std::fflush(stdout);
    const char* required = std::getenv("ARS_REQUIRE_DATA");
    if (required && std::string(required) == "1") ADD_FAILURE() << "NOT RUN: " << why;
}

/// A folder of its own for the running test, removed at the end.
class TemporaryFolder {
public:
    TemporaryFolder() {
        std::string name = (std::filesystem::temp_directory_path() / "ars-test-XXXXXX").string();
        path_ = ::mkdtemp(name.data());
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    const std::filesystem::path& path() const { return path_; }
    std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

private:
    std::filesystem::path path_;
};

} // namespace ars::test

/// ARS_TEST_DATA_FILE(path, "hdri/city.exr"); declares the path, or says NOT RUN and leaves the test.
#define ARS_TEST_DATA_FILE(variable, relative)                                                                         \
    const std::filesystem::path variable = ::ars::test::dataFolder() / (relative);                                     \
    if (::ars::test::dataFolder().empty() || !std::filesystem::exists(variable)) {                                     \
        ::ars::test::notRun(std::string("needs the test data ") + (relative) + " (ARS_TEST_DATA)");                    \
        return;                                                                                                        \
    }
