#pragma once

#include "engine/core/error.h"

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

namespace ars::ui {

/// How long the frames of the window took: from the moment when events were picked up until the next are waited for.
/// Longest is the longest time for which the window could not answer.
class WindowTimings {
public:
    /// One frame, milliseconds: bringing the session up to date, widgets, drawing and showing.
    struct Parts {
        float updateMs = 0.0f;
        float widgetsMs = 0.0f;
        float drawMs = 0.0f;
        float totalMs() const { return updateMs + widgetsMs + drawMs; }
    };
    /// Upper edges of the histogram's bins, milliseconds; one more bin takes what is longer.
    static constexpr std::array<float, 11> kEdgesMs{1, 2, 4, 8, 12, 16, 24, 33, 50, 100, 200};

    void add(const Parts& parts);
    std::uint64_t frames() const { return frames_; }
    const Parts& longest() const { return longest_; }
    /// The last 240, oldest first.
    std::vector<float> recentMs() const;
    /// Of all frames (of the last 100,000 where there are more), share in [0, 1]; 0 without frames.
    float percentileMs(double share) const;
    std::array<std::uint64_t, kEdgesMs.size() + 1> histogram() const { return histogram_; }
    void clear() { *this = {}; }

    /// {"frames", "longest_ms", "longest": {parts}, "percentiles_ms": {"50", "90", "99"}, "histogram": [{"below_ms",
    /// "count"}]}
    Status write(const std::filesystem::path& file) const;

private:
    std::uint64_t frames_ = 0;
    Parts longest_;
    std::array<std::uint64_t, kEdgesMs.size() + 1> histogram_{};
    std::vector<float> ring_; ///< total of the last kKept
    std::size_t next_ = 0;
};

} // namespace ars::ui
