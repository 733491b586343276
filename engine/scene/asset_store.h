#pragma once

#include "engine/scene/assets.h"
#include "engine/scene/jobs.h"
#include "engine/scene/session.h"

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace ars {

/// What a document needs from files and generators, loaded beside the window; one thread, none of its calls waits.
///
/// The last assets stay until the new ones are there, and those used last are kept, so that undo is quick. While a
/// person drags at a generated light or a shape, each load ends before the next begins with the newest values.
class AssetStore {
public:
    /// @param jobs    must outlive this, and be destroyed without being pumped again
    /// @param notify  receives one notice for every thing that could not be loaded
    AssetStore(const LightTarget& target, JobRunner& jobs, std::function<void(Notice)> notify);

    const SceneAssets& assets() const { return assets_; }
    /// Another number after every change of assets().
    std::uint64_t version() const { return version_; }

    struct Wish {
        bool dragging = false; ///< drafts of generated lights are enough
        bool other = false;    ///< the other side of the comparison is seen
    };
    /// Makes assets() those of the document, as far as they are there, and loads the rest.
    void follow(const Document& document, const Wish& wish);
    /// What the document of the last follow() needs is there as well as it will be: whole, or failed.
    bool complete() const { return complete_; }
    /// The next document is another one: failures are tried again, and what fails is replaced by the open body and the
    /// three lamps instead of by what was there before.
    void replaceDocument();

    /// Loads something that is not in the document yet. `accept` is called once with assets() holding it, at the first
    /// moment that there is something to look at: false puts back what was there. `fail` is called instead of it.
    struct Opening {
        std::string title;
        std::function<bool()> accept;
        std::function<void(const Error&)> fail;
    };
    void openAvatar(const AvatarSection& avatar, Opening opening);
    void openLight(const LightSection& light, Opening opening);
    void openClip(const std::string& path, Opening opening); ///< waits for an avatar where none is loaded yet
    void openCapture(const std::string& path, Opening opening);
    void openPicture(const std::string& path, const std::string& layer, Opening opening);

private:
    template <typename Asset>
    using Pointer = std::shared_ptr<const Asset>;
    /// On a job's thread: loads, handing a forerunner to the first argument.
    template <typename Asset>
    using Loader = std::function<Result<Pointer<Asset>>(const std::function<void(Pointer<Asset>)>& early,
                                                        const ProgressFunction& progress)>;
    template <typename Asset>
    struct Cached {
        std::string key;
        Pointer<Asset> asset;
    };
    template <typename Asset>
    using Cache = std::deque<Cached<Asset>>; ///< the one used last in front
    template <typename Asset>
    struct Slot {
        Pointer<Asset> SceneAssets::* member;
        Cache<Asset>* cache;
        std::string key{};              ///< of what is in assets()
        bool whole = false;             ///< and it is no forerunner
        std::uint64_t job = 0;          ///< that loads for it; 0: none
        std::string jobKey{};           ///< what it loads
        bool jobShort = false;          ///< soon done, so worth waiting for
        std::string wanted{};           ///< what was needed last
        std::set<std::string> failed{}; ///< what could not be loaded since that changed
    };
    template <typename Asset>
    struct Need {
        std::string key;
        std::string name; ///< for people
        Loader<Asset> load;
        bool draftEnough = false;   ///< a forerunner of this key does for now
        bool quick = false;         ///< the load takes a moment only
        bool dropOnFailure = false; ///< nothing is better than what was there before
    };

    template <typename Asset>
    std::uint64_t startLoad(const std::string& title, bool listed, Loader<Asset> load,
                            std::function<void(std::uint64_t, Pointer<Asset>, bool whole)> arrived,
                            std::function<void(std::uint64_t, const Error&)> failed);
    template <typename Asset>
    void adopt(Slot<Asset>& slot, const std::string& key, Pointer<Asset> asset, bool whole);
    template <typename Asset>
    void clear(Slot<Asset>& slot);
    template <typename Asset>
    void provide(Slot<Asset>& slot, Need<Asset> need, const Need<Asset>* standIn = nullptr);
    template <typename Asset>
    void open(Slot<Asset>& slot, Need<Asset> need, Opening opening);

    Need<AvatarAsset> avatarNeed(const AvatarSection& avatar, const Slot<AvatarAsset>& slot) const;
    Need<LightAsset> lightNeed(const LightSection& light, const Slot<LightAsset>& slot, bool dragging) const;
    Need<ClipAsset> clipNeed(const std::string& path) const;
    Need<CaptureAsset> captureNeed(const std::string& path) const;
    void followClip(const Document& document, const Wish& wish);
    void followWaitingClips();
    void followPicture(const Document& document);
    void followOther(const Document& document, const Wish& wish);

    LightTarget target_;
    JobRunner& jobs_;
    std::function<void(Notice)> notify_;
    SceneAssets assets_;
    std::uint64_t version_ = 1;
    bool complete_ = false;
    bool replaced_ = false;
    std::vector<std::pair<std::string, Opening>> waitingClips_;

    Cache<AvatarAsset> avatars_;
    Cache<LightAsset> lights_;
    Cache<ClipAsset> clips_;
    Cache<CaptureAsset> captures_;
    Cache<PictureAsset> pictures_;
    Slot<AvatarAsset> avatar_{&SceneAssets::avatar, &avatars_};
    Slot<LightAsset> light_{&SceneAssets::light, &lights_};
    Slot<ClipAsset> clip_{&SceneAssets::clip, &clips_};
    Slot<CaptureAsset> capture_{&SceneAssets::capture, &captures_};
    Slot<PictureAsset> picture_{&SceneAssets::picture, &pictures_};
    Slot<AvatarAsset> otherAvatar_{&SceneAssets::otherAvatar, &avatars_};
    Slot<LightAsset> otherLight_{&SceneAssets::otherLight, &lights_};
};

} // namespace ars
