#pragma once

#include "ui/panel.h"
#include "ui/timeline/track_rows.h"

#include <set>
#include <vector>

namespace ars::ui {

/// The chosen keys, and what is done with all of them. Holds no keys of its own: those that the document no longer has
/// fall out.
class KeySelection {
public:
    bool empty() const { return keys_.empty(); }
    std::size_t size() const { return keys_.size(); }
    bool contains(const KeyRef& key) const;
    bool containsAll(const std::vector<KeyRef>& keys) const;
    void clear() { keys_.clear(); }
    void set(const std::vector<KeyRef>& keys);
    void add(const std::vector<KeyRef>& keys);
    void remove(const std::vector<KeyRef>& keys);
    void forgetMissing(const TimelineSection& timeline, const std::vector<std::string>& jointNames);

    // Each one entry of the history.
    void deleteKeys(StudioContext& context);
    void interpolate(StudioContext& context, KeyInterpolation kind);

    /// A drag: `origin` is what was chosen when it began. While the widget is held every call starts over from there,
    /// so that keys which are passed over survive.
    void beginDrag() { origin_.assign(keys_.begin(), keys_.end()); }
    void drag(StudioContext& context, double deltaS, bool copying);
    void endDrag() { origin_.clear(); }
    bool dragging() const { return !origin_.empty(); }
    double originStartS() const; ///< earliest time of the dragged keys

private:
    std::set<KeyRef> keys_;
    std::vector<KeyRef> origin_;
};

/// Runs calls that belong together as one entry of the history; the first error ends it and is shown.
void runTogether(StudioContext& context, const std::vector<std::pair<std::string, Arguments>>& calls);

} // namespace ars::ui
