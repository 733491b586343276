#pragma once

#include <filesystem>
#include <mutex>
#include <string_view>

namespace ars {

/// log.txt of a run: what it did when, and every warning and error of the program while this lives. Where the program's
/// standard error goes into that file already (the studio starts runs so) its records are not written twice.
class RunLog {
public:
    explicit RunLog(const std::filesystem::path& folder);
    ~RunLog();
    RunLog(const RunLog&) = delete;
    RunLog& operator=(const RunLog&) = delete;

    /// One line with the date and time before it. A log that cannot be written stops nothing.
    void line(std::string_view text);
    /// No further line, so that the folder can be removed.
    void close();

private:
    std::mutex mutex_;
    int descriptor_ = -1;
    int sink_ = 0;
};

} // namespace ars
