#include "ui/look/picture_cache.h"

namespace ars::ui {

namespace {
constexpr int kAtOnce = 2;
}

PictureCache::Shown PictureCache::get(Session& session, const std::string& key, const Make& make) {
    Entry& entry = state_->entries[key];
    if (!entry.started && state_->running < kAtOnce) {
        entry.started = true;
        ++state_->running;
        const auto made = std::make_shared<Image>();
        session.start(
            "Thumbnail",
            [made, make](const ProgressFunction& progress) -> Status {
                ARS_TRY(*made, make(progress));
                return {};
            },
            [made, key, state = std::weak_ptr<State>(state_)](const Status& status) {
                const std::shared_ptr<State> alive = state.lock();
                if (!alive) return;
                Entry& waiting = alive->entries[key];
                --alive->running;
                waiting.done = true;
                if (status) {
                    waiting.image = std::move(*made);
                } else {
                    waiting.error = status.error().describe();
                }
            },
            true);
    }
    if (entry.done && entry.texture.empty() && !entry.image.pixels.empty()) {
        const Image& image = entry.image;
        entry.texture.upload({image.pixels.data(), image.width, image.height, image.channels}, true);
        entry.image = {};
    }
    return {entry.texture.empty() ? nullptr : &entry.texture, entry.error};
}

int PictureCache::pending() const {
    int count = 0;
    for (const auto& [key, entry] : state_->entries) count += !entry.done;
    return count;
}

} // namespace ars::ui
