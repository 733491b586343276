#include "ui/pose/thumbnails.h"

#include "engine/core/log.h"
#include "engine/io/png.h"

#include <mutex>

namespace ars::ui {

/// What jobs hand over; they may outlive the panel.
struct Thumbnails::Finished {
    std::mutex mutex;
    std::map<std::string, Image> images;
    bool busy = false; ///< of the window's thread alone

    void add(const std::string& key, Image image) {
        const std::lock_guard lock(mutex);
        images[key] = std::move(image);
    }
};

Thumbnails::Thumbnails(std::filesystem::path folder)
    : folder_(std::move(folder)), finished_(std::make_shared<Finished>()) {}

bool Thumbnails::busy() const { return finished_->busy; }

const Texture* Thumbnails::find(const std::string& key) const {
    const auto found = textures_.find(key);
    return found == textures_.end() ? nullptr : &found->second;
}

void Thumbnails::adopt() {
    const std::lock_guard lock(finished_->mutex);
    for (const auto& [key, image] : finished_->images) {
        textures_[key].upload({image.pixels.data(), image.width, image.height, image.channels}, true);
    }
    finished_->images.clear();
}

void Thumbnails::update(Session& session, const std::vector<ThumbnailWish>& wishes) {
    adopt();
    // While another body loads the assets still hold the one before: its pictures would get the new one's keys.
    const std::shared_ptr<const AvatarAsset>& avatar = session.assets().avatar;
    if (busy() || !avatar || !avatar->evaluator || avatar->key != avatarKey(session.document().avatar)) return;
    // The picture that the person waits for comes first.
    if (avatar->coarse || !session.frame()) return;
    std::vector<ThumbnailWish> missing;
    for (const ThumbnailWish& wish : wishes) {
        if (asked_.insert(wish.key).second) missing.push_back(wish);
    }
    if (missing.empty()) return;
    finished_->busy = true;
    const std::shared_ptr<AvatarEvaluator> evaluator = avatar->evaluator;
    const auto work = [missing, evaluator, folder = folder_,
                       finished = finished_](const ProgressFunction& progress) -> Status {
        std::vector<ThumbnailWish> unknown;
        for (const ThumbnailWish& wish : missing) {
            Result<PngFile> stored = readPng(folder / (wish.key + ".png"));
            if (stored && stored->image.channels == 4 && stored->image.width == kThumbnailWidth) {
                finished->add(wish.key, std::move(stored->image));
            } else {
                unknown.push_back(wish);
            }
        }
        if (unknown.empty()) return {};
        const auto keep = [&](const std::string& key, Image image) {
            // A folder that cannot be written costs time at the next start and nothing else.
            if (const Status written = writePng(folder / (key + ".png"), image); !written) {
                logWarning("{}", written.error().describe());
            }
            finished->add(key, std::move(image));
        };
        return renderThumbnails(evaluator->mesh(), unknown, keep, progress);
    };
    session.start(
        "Pictures of the pose library", work, [finished = finished_](const Status&) { finished->busy = false; }, true);
}

} // namespace ars::ui
