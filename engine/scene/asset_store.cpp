#include "engine/scene/asset_store.h"

#include "engine/scene/session_notices.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

namespace ars {
namespace {

constexpr std::size_t kKept = 4; ///< assets of one kind that are kept, those in use included

bool isWhole(const AvatarAsset& asset) { return !asset.coarse; }
bool isWhole(const LightAsset& asset) { return asset.quality == LightQuality::Exact; }
bool isWhole(const ClipAsset&) { return true; }
bool isWhole(const CaptureAsset&) { return true; }
bool isWhole(const PictureAsset&) { return true; }

/// Tells skeletons apart: a clip is made for one.
std::string fingerprint(const AvatarAsset& avatar) {
    std::uint64_t hash = 1469598103934665603ull; // FNV-1a
    const auto add = [&](std::span<const std::byte> bytes) {
        for (const std::byte b : bytes) hash = (hash ^ static_cast<std::uint64_t>(b)) * 1099511628211ull;
    };
    add(std::as_bytes(std::span(avatar.evaluator->rig().skeleton.restPositions)));
    add(std::as_bytes(std::span(&avatar.soleHeightM, 1)));
    return fmt::format("{:016x}", hash);
}

std::string lightName(const LightSection& light) {
    switch (light.kind) {
    case LightKind::File:
        return shortName(light.file);
    case LightKind::Sky:
        return "the sky";
    case LightKind::Studio:
        return "the studio";
    case LightKind::Uniform:
        break;
    }
    return "the uniform light";
}

} // namespace

AssetStore::AssetStore(const LightTarget& target, JobRunner& jobs, std::function<void(Notice)> notify)
    : target_(target), jobs_(jobs), notify_(std::move(notify)) {}

// ---- loading one thing

template <typename Asset>
std::uint64_t AssetStore::startLoad(const std::string& title, bool listed, Loader<Asset> load,
                                    std::function<void(std::uint64_t, Pointer<Asset>, bool)> arrived,
                                    std::function<void(std::uint64_t, const Error&)> failed) {
    struct Outcome {
        std::uint64_t job = 0;
        Pointer<Asset> asset;
    };
    auto outcome = std::make_shared<Outcome>();
    JobRequest request;
    request.title = title;
    request.listed = listed;
    request.work = [this, outcome, load = std::move(load), arrived](const ProgressFunction& progress) -> Status {
        const auto early = [&](Pointer<Asset> asset) {
            jobs_.post([outcome, arrived, asset] { arrived(outcome->job, asset, false); });
        };
        ARS_TRY(outcome->asset, load(early, progress));
        return {};
    };
    request.done = [outcome, arrived, failed = std::move(failed)](const Status& status) {
        if (status) return arrived(outcome->job, outcome->asset, true);
        failed(outcome->job, status.error());
    };
    outcome->job = jobs_.start(std::move(request)); // read by deliveries alone, which come in a later pump()
    return outcome->job;
}

template <typename Asset>
void AssetStore::adopt(Slot<Asset>& slot, const std::string& key, Pointer<Asset> asset, bool whole) {
    assets_.*slot.member = asset;
    slot.key = key;
    slot.whole = whole;
    ++version_;
    if (!whole) return;
    Cache<Asset>& cache = *slot.cache;
    std::erase_if(cache, [&](const Cached<Asset>& c) { return c.key == key; });
    cache.push_front({key, std::move(asset)});
    if (cache.size() > kKept) cache.pop_back();
}

template <typename Asset>
void AssetStore::clear(Slot<Asset>& slot) {
    if (slot.job != 0) jobs_.cancel(slot.job);
    slot.job = 0;
    slot.wanted.clear();
    slot.failed.clear();
    if (!(assets_.*slot.member)) return;
    assets_.*slot.member = nullptr;
    slot.key.clear();
    slot.whole = false;
    ++version_;
}

/// Sees to it that a slot gets what is needed; complete_ becomes false where it has not.
template <typename Asset>
void AssetStore::provide(Slot<Asset>& slot, Need<Asset> need, const Need<Asset>* standIn) {
    if (slot.wanted != need.key) {
        slot.wanted = need.key;
        slot.failed.clear();
    }
    if (slot.failed.contains(need.key)) {
        if (!standIn || slot.failed.contains(standIn->key)) return;
        need = *standIn;
    }
    if (slot.key == need.key && (slot.whole || need.draftEnough)) {
        if (need.draftEnough && !slot.whole) complete_ = false;
        if (slot.job != 0 && (slot.jobKey != need.key || slot.whole)) {
            jobs_.cancel(slot.job); // of something that was wanted before
            slot.job = 0;
        }
        return;
    }
    const auto cached =
        std::find_if(slot.cache->begin(), slot.cache->end(), [&](const Cached<Asset>& c) { return c.key == need.key; });
    if (cached != slot.cache->end()) {
        if (slot.job != 0) jobs_.cancel(slot.job);
        slot.job = 0;
        return adopt(slot, need.key, cached->asset, true);
    }
    complete_ = false;
    if (slot.job != 0) {
        const bool stays = slot.jobKey == need.key && (need.draftEnough || !slot.jobShort);
        if (stays || slot.jobShort) return;
        jobs_.cancel(slot.job);
    }
    slot.jobKey = need.key;
    slot.jobShort = need.quick;
    const std::string name = need.name;
    const bool drop = need.dropOnFailure;
    slot.job = startLoad<Asset>(
        "Loading " + name, !need.quick, std::move(need.load),
        [this, &slot](std::uint64_t job, Pointer<Asset> asset, bool last) {
            if (slot.job != job) return;
            const bool whole = isWhole(*asset);
            adopt(slot, slot.jobKey, std::move(asset), whole);
            if (last) slot.job = 0;
        },
        [this, &slot, name, drop](std::uint64_t job, const Error& error) {
            if (slot.job != job) return;
            slot.job = 0;
            slot.failed.insert(slot.jobKey);
            ++version_; // follow() again: something may stand in
            if (drop && assets_.*slot.member) {
                assets_.*slot.member = nullptr;
                slot.key.clear();
            }
            if (error.code == ErrorCode::Cancelled) {
                return notify_({Notice::Kind::Note, "Stopped loading " + name, "The picture stays as it was.", ""});
            }
            notify_(failureNotice("Could not load " + name, error));
        });
}

template <typename Asset>
void AssetStore::open(Slot<Asset>& slot, Need<Asset> need, Opening opening) {
    auto decided = std::make_shared<bool>(false);
    const std::string key = need.key;
    auto shared = std::make_shared<Opening>(std::move(opening));
    startLoad<Asset>(
        shared->title, true, std::move(need.load),
        [this, &slot, key, decided, shared](std::uint64_t job, Pointer<Asset> asset, bool last) {
            const bool whole = isWhole(*asset);
            if (*decided) {
                if (slot.job != job) return; // refused, or something else was wanted since
                adopt(slot, key, std::move(asset), whole);
                if (last) slot.job = 0;
                return;
            }
            *decided = true;
            const Pointer<Asset> before = assets_.*slot.member;
            assets_.*slot.member = asset;
            const bool accepted = shared->accept();
            assets_.*slot.member = before;
            if (!accepted) return jobs_.cancel(job);
            if (slot.job != 0) jobs_.cancel(slot.job);
            slot.job = last ? 0 : job;
            slot.jobKey = key;
            slot.jobShort = false;
            std::erase_if(*slot.cache, [&](const Cached<Asset>& c) { return c.key == key; }); // read anew
            adopt(slot, key, std::move(asset), whole);
        },
        [this, &slot, decided, shared](std::uint64_t job, const Error& error) {
            if (*decided) {
                if (slot.job != job) return;
                slot.job = 0;
                slot.failed.insert(slot.jobKey);
                ++version_;
            }
            shared->fail(error);
        });
}

// ---- what is needed

AssetStore::Need<AvatarAsset> AssetStore::avatarNeed(const AvatarSection& avatar, const Slot<AvatarAsset>& slot) const {
    Need<AvatarAsset> need;
    need.key = avatarKey(avatar);
    need.name = shortName(avatar.source);
    Pointer<AvatarAsset> relative;
    for (const Cached<AvatarAsset>& c : avatars_) {
        if (!relative && !c.asset->shapeNames.empty() && sameButShape(avatar, *c.asset)) relative = c.asset;
    }
    need.quick = relative != nullptr;
    const bool forerunner = !(slot.key == need.key);
    need.load = [avatar, relative, forerunner](const std::function<void(Pointer<AvatarAsset>)>& early,
                                               const ProgressFunction& progress) {
        return loadAvatarAsset(avatar, relative, forerunner ? early : nullptr, progress);
    };
    return need;
}

AssetStore::Need<LightAsset> AssetStore::lightNeed(const LightSection& light, const Slot<LightAsset>& slot,
                                                   bool dragging) const {
    Need<LightAsset> need;
    need.key = lightKey(light);
    need.name = lightName(light);
    need.draftEnough = dragging && light.kind != LightKind::File;
    need.quick = need.draftEnough;
    const bool forerunner = slot.key != need.key;
    need.load = [light, target = target_, forerunner, draft = need.draftEnough](
                    const std::function<void(Pointer<LightAsset>)>& early, const ProgressFunction& progress) {
        if (draft) return loadLightAsset(light, target, LightQuality::Draft, progress);
        return loadLightAsset(light, target, forerunner ? early : nullptr, progress);
    };
    return need;
}

AssetStore::Need<ClipAsset> AssetStore::clipNeed(const std::string& path) const {
    Need<ClipAsset> need;
    need.key = path + "\n" + fingerprint(*assets_.avatar);
    need.name = shortName(path);
    need.dropOnFailure = true;
    need.load = [path, avatar = assets_.avatar](const std::function<void(Pointer<ClipAsset>)>&,
                                                const ProgressFunction& progress) {
        return loadClipAsset(path, avatar->evaluator->rig().skeleton, progress, avatar->soleHeightM);
    };
    return need;
}

AssetStore::Need<CaptureAsset> AssetStore::captureNeed(const std::string& path) const {
    Need<CaptureAsset> need;
    need.key = path;
    need.name = shortName(path);
    need.dropOnFailure = true;
    need.load = [path](const std::function<void(Pointer<CaptureAsset>)>&, const ProgressFunction&) {
        return loadCaptureAsset(path);
    };
    return need;
}

void AssetStore::followPicture(const Document& document) {
    Need<PictureAsset> need;
    need.key = pictureKey(document);
    if (need.key.empty()) return clear(picture_);
    need.dropOnFailure = true;
    const CompareSection& compare = document.view.compare;
    if (compare.kind == CompareKind::Picture) {
        need.name = shortName(compare.file);
        need.load = [file = compare.file, layer = compare.layer](const std::function<void(Pointer<PictureAsset>)>&,
                                                                 const ProgressFunction&) {
            return loadPictureAsset(file, layer);
        };
        return provide(picture_, std::move(need));
    }
    if (capture_.key != document.camera.capture) { // on its way, or not to be had
        if (picture_.key != need.key) {
            const bool failed = capture_.failed.contains(document.camera.capture);
            clear(picture_);
            complete_ = complete_ && failed;
        }
        return;
    }
    need.name = fmt::format("photograph {} of camera {}", document.camera.photograph, document.camera.datasetCamera);
    need.load = [camera = document.camera, capture = assets_.capture](const std::function<void(Pointer<PictureAsset>)>&,
                                                                      const ProgressFunction&) {
        return loadPhotographAsset(camera, *capture);
    };
    provide(picture_, std::move(need));
}

void AssetStore::followOther(const Document& document, const Wish& wish) {
    const std::optional<Document> other = wish.other ? otherDocument(document) : std::nullopt;
    if (!other) {
        clear(otherAvatar_);
        return clear(otherLight_);
    }
    // What both sides share is loaded once.
    if (const std::string key = avatarKey(other->avatar); key == avatar_.key && avatar_.whole) {
        if (otherAvatar_.key != key) adopt(otherAvatar_, key, assets_.avatar, true);
    } else {
        provide(otherAvatar_, avatarNeed(other->avatar, otherAvatar_));
    }
    const std::string key = lightKey(other->light);
    if (key != light_.key) return provide(otherLight_, lightNeed(other->light, otherLight_, wish.dragging));
    if (assets_.otherLight != assets_.light) adopt(otherLight_, key, assets_.light, light_.whole);
}

void AssetStore::followClip(const Document& document, const Wish& wish) {
    if (clipKey(document.timeline).empty()) return clear(clip_);
    // It is made for the skeleton of the avatar that is there, or comes.
    const bool avatarComes = avatar_.job != 0 && avatar_.key != avatarKey(document.avatar);
    const bool later = wish.dragging && assets_.clip && assets_.clip->key == document.timeline.clip;
    if (!assets_.avatar || avatarComes || later) {
        complete_ = false;
        return;
    }
    provide(clip_, clipNeed(document.timeline.clip));
}

void AssetStore::followWaitingClips() {
    if (waitingClips_.empty()) return;
    if (!assets_.avatar && !complete_) return; // it comes
    std::vector<std::pair<std::string, Opening>> waiting;
    waiting.swap(waitingClips_);
    for (auto& entry : waiting) {
        if (assets_.avatar) {
            openClip(entry.first, std::move(entry.second));
        } else {
            entry.second.fail(makeError(ErrorCode::Unavailable, entry.first, "there is no avatar that could play it"));
        }
    }
}

void AssetStore::follow(const Document& document, const Wish& wish) {
    complete_ = true;
    const AvatarSection openBody;
    const Need<AvatarAsset> body = avatarNeed(openBody, avatar_);
    provide(avatar_, avatarNeed(document.avatar, avatar_), !assets_.avatar || replaced_ ? &body : nullptr);
    const LightSection threeLamps;
    const Need<LightAsset> lamps = lightNeed(threeLamps, light_, false);
    provide(light_, lightNeed(document.light, light_, wish.dragging), !assets_.light || replaced_ ? &lamps : nullptr);
    followClip(document, wish);
    if (captureKey(document.camera).empty()) {
        clear(capture_);
    } else {
        provide(capture_, captureNeed(document.camera.capture));
    }
    followPicture(document);
    followOther(document, wish);
    followWaitingClips();
    if (complete_) replaced_ = false;
}

void AssetStore::replaceDocument() {
    replaced_ = true;
    const auto retry = [](auto& slot) { slot.failed.clear(); };
    retry(avatar_);
    retry(light_);
    retry(clip_);
    retry(capture_);
    retry(picture_);
    retry(otherAvatar_);
    retry(otherLight_);
}

// ---- opening

void AssetStore::openAvatar(const AvatarSection& avatar, Opening opening) {
    Need<AvatarAsset> need = avatarNeed(avatar, avatar_);
    // Read anew, whatever is known of it: the file may have changed.
    need.load = [avatar](const std::function<void(Pointer<AvatarAsset>)>& early, const ProgressFunction& progress) {
        return loadAvatarAsset(avatar, nullptr, early, progress);
    };
    open(avatar_, std::move(need), std::move(opening));
}

void AssetStore::openLight(const LightSection& light, Opening opening) {
    Need<LightAsset> need = lightNeed(light, light_, false);
    need.load = [light, target = target_](const std::function<void(Pointer<LightAsset>)>& early,
                                          const ProgressFunction& progress) {
        return loadLightAsset(light, target, early, progress);
    };
    open(light_, std::move(need), std::move(opening));
}

void AssetStore::openClip(const std::string& path, Opening opening) {
    if (!assets_.avatar) {
        waitingClips_.emplace_back(path, std::move(opening));
        complete_ = false;
        ++version_; // follow() looks after it
        return;
    }
    open(clip_, clipNeed(path), std::move(opening));
}

void AssetStore::openCapture(const std::string& path, Opening opening) {
    open(capture_, captureNeed(path), std::move(opening));
}

void AssetStore::openPicture(const std::string& path, const std::string& layer, Opening opening) {
    Need<PictureAsset> need;
    need.key = path + "\n" + layer;
    need.load = [path, layer](const std::function<void(Pointer<PictureAsset>)>&, const ProgressFunction&) {
        return loadPictureAsset(path, layer);
    };
    open(picture_, std::move(need), std::move(opening));
}

} // namespace ars
