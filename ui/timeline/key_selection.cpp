#include "ui/timeline/key_selection.h"

#include "ui/studio.h"
#include "ui/widgets.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace ars::ui {
namespace {

/// The key in the set that means the same one: times may differ by rounding.
std::set<KeyRef>::const_iterator findNear(const std::set<KeyRef>& keys, const KeyRef& key) {
    const auto from = keys.lower_bound({key.track, key.timeS - kKeyTimeTolerance});
    const bool near =
        from != keys.end() && from->track == key.track && std::abs(from->timeS - key.timeS) <= kKeyTimeTolerance;
    return near ? from : keys.end();
}

} // namespace

void runTogether(StudioContext& context, const std::vector<std::pair<std::string, Arguments>>& calls) {
    static std::uint64_t count = 0;
    const std::string gesture = fmt::format("together {}", ++count);
    for (const auto& [command, arguments] : calls) {
        if (const Status status = context.session.run(command, arguments, gesture); !status) {
            context.studio.toast(status.error().describe());
            break;
        }
    }
    context.session.endGesture();
}

bool KeySelection::contains(const KeyRef& key) const { return findNear(keys_, key) != keys_.end(); }

bool KeySelection::containsAll(const std::vector<KeyRef>& keys) const {
    return !keys.empty() && std::all_of(keys.begin(), keys.end(), [this](const KeyRef& key) { return contains(key); });
}

void KeySelection::set(const std::vector<KeyRef>& keys) {
    keys_.clear();
    add(keys);
}

void KeySelection::add(const std::vector<KeyRef>& keys) {
    for (const KeyRef& key : keys) {
        if (!contains(key)) keys_.insert(key);
    }
}

void KeySelection::remove(const std::vector<KeyRef>& keys) {
    for (const KeyRef& key : keys) {
        if (const auto found = findNear(keys_, key); found != keys_.end()) keys_.erase(found);
    }
}

void KeySelection::forgetMissing(const TimelineSection& timeline, const std::vector<std::string>& jointNames) {
    std::map<std::string, std::vector<KeyMark>> tracks;
    for (auto key = keys_.begin(); key != keys_.end();) {
        const auto [track, isNew] = tracks.try_emplace(key->track);
        if (isNew) track->second = trackKeys(timeline, jointNames, key->track);
        const bool there = std::any_of(track->second.begin(), track->second.end(), [&](const KeyMark& mark) {
            return std::abs(mark.timeS - key->timeS) <= kKeyTimeTolerance;
        });
        key = there ? std::next(key) : keys_.erase(key);
    }
}

void KeySelection::deleteKeys(StudioContext& context) {
    std::vector<std::pair<std::string, Arguments>> calls;
    for (const KeyRef& key : keys_) {
        calls.emplace_back("timeline.delete_key", Arguments{{"track", key.track}, {"time", key.timeS}});
    }
    runTogether(context, calls);
    keys_.clear();
}

void KeySelection::interpolate(StudioContext& context, KeyInterpolation kind) {
    const std::string word(EnumWords<KeyInterpolation>::words[static_cast<std::size_t>(kind)]);
    std::vector<std::pair<std::string, Arguments>> calls;
    for (const KeyRef& key : keys_) {
        calls.emplace_back("timeline.interpolation",
                           Arguments{{"track", key.track}, {"time", key.timeS}, {"kind", word}});
    }
    runTogether(context, calls);
}

double KeySelection::originStartS() const {
    double start = origin_.empty() ? 0.0 : origin_.front().timeS;
    for (const KeyRef& key : origin_) start = std::min(start, key.timeS);
    return start;
}

void KeySelection::drag(StudioContext& context, double deltaS, bool copying) {
    // The last step is taken back and all start over from where they were.
    context.session.cancelGesture();
    set(origin_);
    if (std::abs(deltaS) <= kKeyTimeTolerance) return;
    // The foremost goes first, so that none lands on one that has still to go.
    std::vector<KeyRef> order = origin_;
    std::sort(order.begin(), order.end(), [deltaS](const KeyRef& a, const KeyRef& b) {
        return deltaS > 0.0 ? a.timeS > b.timeS : a.timeS < b.timeS;
    });
    const char* command = copying ? "timeline.copy_key" : "timeline.move_key";
    std::vector<KeyRef> moved;
    for (const KeyRef& key : order) {
        const double to = key.timeS + deltaS;
        runFromWidget(context, command, {{"track", key.track}, {"from", key.timeS}, {"to", to}});
        moved.push_back({key.track, to});
    }
    set(moved);
}

} // namespace ars::ui
