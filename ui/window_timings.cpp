#include "ui/window_timings.h"

#include "engine/core/file.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>

namespace ars::ui {
namespace {
constexpr std::size_t kKept = 100'000;
constexpr std::size_t kRecent = 240;
} // namespace

void WindowTimings::add(const Parts& parts) {
    const float total = parts.totalMs();
    ++frames_;
    if (total > longest_.totalMs()) longest_ = parts;
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
    json["frames"] = frames_;
    json["longest_ms"] = longest_.totalMs();
    json["longest"] = {
        {"update_ms", longest_.updateMs}, {"widgets_ms", longest_.widgetsMs}, {"draw_ms", longest_.drawMs}};
    json["percentiles_ms"] = {{"50", percentileMs(0.5)}, {"90", percentileMs(0.9)}, {"99", percentileMs(0.99)}};
    json["histogram"] = nlohmann::ordered_json::array();
    for (std::size_t i = 0; i < histogram_.size(); ++i) {
        nlohmann::ordered_json bin;
        if (i < kEdgesMs.size()) bin["below_ms"] = kEdgesMs[i];
        bin["count"] = histogram_[i];
        json["histogram"].push_back(bin);
    }
    return writeFileAtomic(file, std::string_view(json.dump(2) + "\n"));
}

} // namespace ars::ui
