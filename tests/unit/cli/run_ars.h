#pragma once

#include "engine/core/process.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

namespace ars::test {

/// The program, built into the folder of the tests.
inline std::string programPath() {
    return (std::filesystem::read_symlink("/proc/self/exe").parent_path() / "ars").string();
}

/// Without the lines that say how far slow work has come ("reading the motion: 20 %"): a loaded machine sees them.
inline std::string withoutProgress(const std::string& errors) {
    static const std::regex line("[^\n]*: [0-9]+ %\n");
    return std::regex_replace(errors, line, "");
}

/// Runs the built program to its end; ProcessResult::errors comes without progress.
inline ProcessResult runArs(std::vector<std::string> arguments, const ProcessOptions& options = {}) {
    arguments.insert(arguments.begin(), programPath());
    ProcessOptions bounded = options;
    if (bounded.timeout.count() == 0) bounded.timeout = std::chrono::minutes(5);
    auto result = runProcess(arguments, bounded);
    if (!result) {
        ADD_FAILURE() << result.error().describe();
        return {};
    }
    EXPECT_FALSE(result->timedOut);
    result->errors = withoutProgress(result->errors);
    return *result;
}

/// Standard output as JSON; a failure of the test when it is none.
inline nlohmann::json parsed(const ProcessResult& result) {
    auto json = nlohmann::json::parse(result.output, nullptr, false);
    EXPECT_FALSE(json.is_discarded()) << "no JSON: " << result.output << result.errors;
    return json.is_discarded() ? nlohmann::json::object() : json;
}

inline void writeText(const std::filesystem::path& path, const std::string& text) {
    std::ofstream file(path, std::ios::binary);
    file << text;
}

inline std::string readBytes(const std::filesystem::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

/// Names of everything in a folder, sorted.
inline std::vector<std::string> namesIn(const std::filesystem::path& folder) {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
}

inline std::size_t countLines(const std::string& text) {
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

/// Exit code 1, nothing on standard output unless `outputAllowed`, and one line "error: ..." that holds every `word`.
inline void expectOneError(const ProcessResult& result, const std::vector<std::string>& words,
                           bool outputAllowed = false) {
    EXPECT_EQ(result.exitCode, 1) << result.errors;
    EXPECT_EQ(countLines(result.errors), 1u) << result.errors;
    EXPECT_TRUE(result.errors.starts_with("error: ")) << result.errors;
    for (const std::string& word : words) {
        EXPECT_NE(result.errors.find(word), std::string::npos) << "no \"" << word << "\" in: " << result.errors;
    }
    if (!outputAllowed) {
        EXPECT_EQ(result.output, "");
    }
}

} // namespace ars::test
