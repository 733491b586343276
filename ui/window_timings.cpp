#include "ui/window_timings.h"

#include "engine/core/file.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <ctime>

namespace ars::ui {
namespace {
constexpr std::size_t kKept = 100'000;
constexpr std::size_t kRecent = 240;
constexpr std::size_t kSlowest = 10;

nlohmann::ordered_json jsonOf(const WindowTimings::Parts& parts) {
    return {{"total_ms", parts.totalMs()},
            {"update_ms", parts.updateMs},
            {"widgets_ms", parts.widgetsMs},
            {"draw_ms", parts.drawMs},
            {"processor_ms", parts.processorMs}};
}

} // namespace

double threadProcessorMs() {
    timespec time{};
    if (clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time) != 0) return 0.0;
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

void WindowTimings::addStartUp(const Parts& parts) {
    ++startUpFrames_;
    if (parts.totalMs() > longestStartUp_.totalMs()) longestStartUp_ = parts;
}

void WindowTimings::add(const Parts& parts) {
    const float total = parts.totalMs();
    ++frames_;
    if (total > longest_.totalMs()) longest_ = parts;
    if (slowest_.size() < kSlowest || total > slowest_.back().parts.totalMs()) {
        const auto place = std::upper_bound(slowest_.begin(), slowest_.end(), total,
                                            [](float ms, const Slow& slow) { return ms > slow.parts.totalMs(); });
        slowest_.insert(place, {frames_, parts});
        if (slowest_.size() > kSlowest) slowest_.pop_back();
    }
    const auto bin = std::lower_bound(kEdgesMs.begin(), kEdgesMs.end(), total) - kEdgesMs.begin();
    ++histogram_[static_cast<std::size_t>(bin)];
    if (ring_.size() < kKept) {
        ring_.push_back(total);
    } else {
        ring_[next_] = total;
        next_ = (next_ + 1) % kKept;
    }
}

std::vector<float> WindowTimings::recentMs() const {
    const std::size_t count = std::min(kRecent, ring_.size());
    std::vector<float> recent(count);
    for (std::size_t i = 0; i < count; ++i) {
        recent[i] = ring_[(next_ + ring_.size() - count + i) % ring_.size()];
    }
    return recent;
}

float WindowTimings::percentileMs(double share) const {
    if (ring_.empty()) return 0.0f;
    std::vector<float> sorted = ring_;
    const double rank = std::ceil(std::clamp(share, 0.0, 1.0) * static_cast<double>(sorted.size())) - 1.0;
    const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(std::max(rank, 0.0));
    std::nth_element(sorted.begin(), nth, sorted.end());
    return *nth;
}

Status WindowTimings::write(const std::filesystem::path& file) const {
    nlohmann::ordered_json json;
    json["start_up"] = {
        {"frames", startUpFrames_}, {"longest_ms", longestStartUp_.totalMs()}, {"longest", jsonOf(longestStartUp_)}};
    json["frames"] = frames_;
    json["longest_ms"] = longest_.totalMs();
    json["longest"] = jsonOf(longest_);
    json["percentiles_ms"] = {{"50", percentileMs(0.5)}, {"90", percentileMs(0.9)}, {"99", percentileMs(0.99)}};
    json["histogram"] = nlohmann::ordered_json::array();
    for (std::size_t i = 0; i < histogram_.size(); ++i) {
        nlohmann::ordered_json bin;
        if (i < kEdgesMs.size()) bin["below_ms"] = kEdgesMs[i];
        bin["count"] = histogram_[i];
        json["histogram"].push_back(bin);
    }
    json["slowest"] = nlohmann::ordered_json::array();
    for (const Slow& slow : slowest_) {
        nlohmann::ordered_json entry{{"frame", slow.frame}};
        entry.update(jsonOf(slow.parts));
        json["slowest"].push_back(entry);
    }
    return writeFileAtomic(file, std::string_view(json.dump(2) + "\n"));
}

} // namespace ars::ui
