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
    /// One frame, milliseconds: bringing the session up to date, widgets, drawing and showing. Processor time is what
    /// the thread of the window had of it: on a busy machine the rest was spent waiting for a processor.
    struct Parts {
        float updateMs = 0.0f;
        float widgetsMs = 0.0f;
        float drawMs = 0.0f;
        float processorMs = 0.0f;
        float totalMs() const { return updateMs + widgetsMs + drawMs; }
    };
    /// One of the slowest frames.
    struct Slow {
        std::uint64_t frame = 0; ///< counted from the first that was shown
        Parts parts;
    };
    /// Upper edges of the histogram's bins, milliseconds; one more bin takes what is longer.
    static constexpr std::array<float, 11> kEdgesMs{1, 2, 4, 8, 12, 16, 24, 33, 50, 100, 200};

    void add(const Parts& parts);
    /// A frame that nobody saw: before the window was shown with everything in it.
    void addStartUp(const Parts& parts);
    std::uint64_t frames() const { return frames_; }
    std::uint64_t startUpFrames() const { return startUpFrames_; }
    const Parts& longest() const { return longest_; }
    const Parts& longestStartUp() const { return longestStartUp_; }
    /// The longest frames, longest first; at most ten.
    const std::vector<Slow>& slowest() const { return slowest_; }
    /// The last 240, oldest first.
    std::vector<float> recentMs() const;
    /// Of all frames (of the last 100,000 where there are more), share in [0, 1]; 0 without frames.
    float percentileMs(double share) const;
    std::array<std::uint64_t, kEdgesMs.size() + 1> histogram() const { return histogram_; }
    void clear() { *this = {}; }

    /// {"start_up": {"frames", "longest_ms", "longest": {parts}}, "frames", "longest_ms", "longest": {parts},
    /// "percentiles_ms": {"50", "90", "99"}, "histogram": [{"below_ms", "count"}], "slowest": [{"frame", parts}]}
    Status write(const std::filesystem::path& file) const;

private:
    std::uint64_t frames_ = 0, startUpFrames_ = 0;
    Parts longest_, longestStartUp_;
    std::vector<Slow> slowest_;
    std::array<std::uint64_t, kEdgesMs.size() + 1> histogram_{};
    std::vector<float> ring_; ///< total of the last kKept
    std::size_t next_ = 0;
};

/// Processor time of the calling thread so far, milliseconds.
double threadProcessorMs();

} // namespace ars::ui
