#include "engine/capture/view_cache.h"

#include "engine/core/file.h"
#include "engine/core/log.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <list>
#include <map>
#include <mutex>
#include <system_error>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Bytes = std::shared_ptr<const std::vector<std::byte>>;

constexpr std::string_view kSuffix = ".view";
constexpr std::string_view kPartSuffix = ".part";
constexpr std::string_view kKeyHead = "ars view 2";
constexpr auto kPartAge = std::chrono::minutes(10); ///< a part that old has lost its writer

/// Two independent 64-bit FNV-1a sums as 32 hexadecimal digits.
std::string digestOf(std::string_view text) {
    std::uint64_t a = 0xcbf29ce484222325ull, b = 0x84222325cbf29ce4ull;
    for (const char c : text) {
        a = (a ^ static_cast<unsigned char>(c)) * 0x100000001b3ull;
        b = (b ^ (static_cast<unsigned char>(c) + 0x5bu)) * 0x100000001b3ull;
    }
    return fmt::format("{:016x}{:016x}", a, b);
}

/// Path, size and time of a file; empty where it cannot be looked at.
std::string fileKey(const fs::path& path) {
    if (path.empty()) return "-";
    std::error_code failure;
    const fs::path whole = fs::absolute(path, failure).lexically_normal();
    const std::uint64_t size = fs::file_size(path, failure);
    if (failure) return {};
    const auto time = fs::last_write_time(path, failure).time_since_epoch().count();
    if (failure) return {};
    return fmt::format("{} {} {}", whole.string(), size, time);
}

std::string cameraKey(const CalibratedCamera& camera) {
    const Camera& c = camera.camera;
    std::string text = fmt::format("{}x{} {:a} {:a} {:a} {:a}", c.width, c.height, c.fx, c.fy, c.cx, c.cy);
    for (int i = 0; i < 3; ++i) {
        text +=
            fmt::format(" {:a} {:a} {:a} {:a}", c.rotation[i].x, c.rotation[i].y, c.rotation[i].z, c.translation[i]);
    }
    for (const double d : camera.distortion) text += fmt::format(" {:a}", d);
    return text;
}

/// Packed views in memory, the least recently used at the end of the list.
class MemoryCache {
public:
    explicit MemoryCache(std::size_t most) : most_(most) {}

    Bytes find(ViewId id) {
        const auto found = byView_.find(id);
        if (found == byView_.end()) return nullptr;
        entries_.splice(entries_.begin(), entries_, found->second);
        return found->second->second;
    }
    void insert(ViewId id, Bytes bytes) {
        if (bytes->size() > most_ || byView_.contains(id)) return;
        held_ += bytes->size();
        entries_.emplace_front(id, std::move(bytes));
        byView_[id] = entries_.begin();
        while (held_ > most_) {
            held_ -= entries_.back().second->size();
            byView_.erase(entries_.back().first);
            entries_.pop_back();
        }
    }
    std::size_t held() const { return held_; }

private:
    std::size_t most_;
    std::size_t held_ = 0;
    std::list<std::pair<ViewId, Bytes>> entries_;
    std::map<ViewId, std::list<std::pair<ViewId, Bytes>>::iterator> byView_;
};

/// Files of packed views. When the folder is full, files that this run has not used go first, oldest first; then
/// nothing more is written: pictures come in a new order every round, so a fixed part of them is worth more than the
/// latest.
class FolderCache {
public:
    FolderCache(fs::path folder, std::size_t most) : folder_(std::move(folder)), most_(most) {}

    Status scan() {
        std::error_code failure;
        fs::create_directories(folder_, failure);
        unused_.clear();
        held_ = 0;
        fs::directory_iterator entry(folder_, failure), end;
        if (failure) {
            return makeError(ErrorCode::Io, folder_.string(),
                             fmt::format("the cache of pictures cannot be kept here: {}", failure.message()));
        }
        for (; !failure && entry != end; entry.increment(failure)) note(*entry);
        std::sort(unused_.begin(), unused_.end(), [](const File& a, const File& b) { return a.time < b.time; });
        writtenSinceScan_ = 0;
        return {};
    }

    fs::path pathOf(const std::string& key) const { return folder_ / (digestOf(key) + std::string(kSuffix)); }

    /// The bytes kept under a key; null where there are none, or damaged ones.
    Bytes find(const std::string& key) const {
        const fs::path path = pathOf(key);
        std::error_code failure;
        if (!fs::exists(path, failure)) return nullptr;
        auto bytes = readFile(path);
        if (!bytes || bytes->size() <= key.size()) return nullptr;
        if (std::string_view(reinterpret_cast<const char*>(bytes->data()), key.size()) != key) return nullptr;
        bytes->erase(bytes->begin(), bytes->begin() + static_cast<std::ptrdiff_t>(key.size()));
        return std::make_shared<const std::vector<std::byte>>(*std::move(bytes));
    }

    /// This run has used the file: it is not to go.
    void keep(const std::string& key) {
        const fs::path path = pathOf(key);
        used_.insert(path.filename().string());
        std::error_code ignored;
        fs::last_write_time(path, fs::file_time_type::clock::now(), ignored);
    }

    /// Makes room for a file; false where there is none.
    bool makeRoom(std::size_t bytes) {
        if (refused_) return false;
        if (writtenSinceScan_ > most_ / 16 && !scan()) return false; // another run may write here as well
        std::size_t next = 0;
        for (; held_ + bytes > most_ && next < unused_.size(); ++next) {
            if (used_.contains(unused_[next].path.filename().string())) continue;
            std::error_code ignored;
            fs::remove(unused_[next].path, ignored);
            held_ -= std::min<std::uintmax_t>(held_, unused_[next].bytes);
        }
        unused_.erase(unused_.begin(), unused_.begin() + static_cast<std::ptrdiff_t>(next));
        return held_ + bytes <= most_;
    }
    void wrote(const std::string& key, std::size_t bytes) {
        used_.insert(pathOf(key).filename().string());
        held_ += bytes;
        writtenSinceScan_ += bytes;
    }
    /// The disk said no; once is enough to hear it.
    void refuse() {
        if (!refused_) logWarning("{}: pictures cannot be kept here any more, training goes on", folder_.string());
        refused_ = true;
    }

private:
    struct File {
        fs::path path;
        std::uintmax_t bytes;
        fs::file_time_type time;
    };

    void note(const fs::directory_entry& entry) {
        std::error_code failure;
        const std::string extension = entry.path().extension().string();
        const fs::file_time_type time = entry.last_write_time(failure);
        if (failure) return;
        if (extension == kPartSuffix && fs::file_time_type::clock::now() - time > kPartAge) {
            fs::remove(entry.path(), failure);
        }
        if (extension != kSuffix) return;
        const std::uintmax_t bytes = entry.file_size(failure);
        if (failure) return;
        held_ += bytes;
        if (!used_.contains(entry.path().filename().string())) unused_.push_back({entry.path(), bytes, time});
    }

    fs::path folder_;
    std::uintmax_t most_;
    std::uintmax_t held_ = 0, writtenSinceScan_ = 0;
    std::vector<File> unused_; ///< oldest first
    std::set<std::string> used_;
    bool refused_ = false;
};

/// Writes key and bytes beside the path and renames them there. Not synced: a torn file is known by its checksum.
bool writeCacheFile(const fs::path& path, const std::string& key, const std::vector<std::byte>& bytes) {
    static std::atomic<unsigned> counter{0};
    fs::path part = path;
    part += fmt::format(".{}-{}{}", ::getpid(), counter++, kPartSuffix);
    std::error_code failure;
    {
        std::ofstream stream(part, std::ios::binary | std::ios::trunc);
        if (!stream) { // the folder was deleted
            fs::create_directories(path.parent_path(), failure);
            stream.open(part, std::ios::binary | std::ios::trunc);
        }
        stream.write(key.data(), static_cast<std::streamsize>(key.size()));
        stream.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
        stream.close();
        if (stream) {
            fs::rename(part, path, failure);
            if (!failure) return true;
        }
    }
    fs::remove(part, failure);
    return false;
}

} // namespace

struct ViewCache::State {
    std::shared_ptr<const Capture> capture;
    Options options;
    mutable std::mutex mutex; ///< of all that follows
    MemoryCache memory{0};
    std::unique_ptr<FolderCache> folder;
    Counts counts;

    /// Everything that the bytes in a file depend on; empty where the picture cannot be looked at.
    std::string keyOf(ViewId view) const {
        const std::string picture = fileKey(capture->imagePath(view));
        const std::string mask = fileKey(capture->maskPath(view));
        if (picture.empty() || mask.empty()) return {};
        const ViewOptions& o = options.view;
        return fmt::format("{}\n{}\n{}\n{}\n{} {} {} {} {} {}\n", kKeyHead, picture, mask,
                           cameraKey(capture->cameras[static_cast<std::size_t>(view.camera)]), o.scale, o.cropMargin,
                           o.maskThreshold, o.bandPixels, view.camera, view.frame);
    }

    void remember(ViewId view, Bytes bytes, std::uint64_t Counts::* count) {
        const std::lock_guard lock(mutex);
        memory.insert(view, std::move(bytes));
        ++(counts.*count);
    }

    void writeToFolder(const std::string& key, const std::vector<std::byte>& bytes) {
        const std::size_t size = key.size() + bytes.size();
        {
            const std::lock_guard lock(mutex);
            if (!folder->makeRoom(size)) return;
        }
        const bool written = writeCacheFile(folder->pathOf(key), key, bytes);
        const std::lock_guard lock(mutex);
        if (written) {
            folder->wrote(key, size);
        } else {
            folder->refuse();
        }
    }
};

ViewCache::ViewCache() : state_(std::make_unique<State>()) {}
ViewCache::~ViewCache() = default;

Result<std::unique_ptr<ViewCache>> ViewCache::open(std::shared_ptr<const Capture> capture, Options options) {
    ARS_TRY_STATUS(validateViewOptions(options.view));
    std::unique_ptr<ViewCache> cache(new ViewCache);
    State& state = *cache->state_;
    state.memory = MemoryCache(options.memoryBytes);
    if (!options.folder.empty()) {
        state.folder = std::make_unique<FolderCache>(options.folder, options.folderBytes);
        ARS_TRY_STATUS(state.folder->scan());
    }
    state.capture = std::move(capture);
    state.options = std::move(options);
    return cache;
}

Result<std::shared_ptr<const CapturedView>> ViewCache::read(ViewId view) {
    using Answer = std::shared_ptr<const CapturedView>;
    Bytes bytes;
    {
        const std::lock_guard lock(state_->mutex);
        bytes = state_->memory.find(view);
        if (bytes) ++state_->counts.fromMemory;
    }
    if (bytes) {
        ARS_TRY(CapturedView kept, unpackView(*bytes));
        return Answer(std::make_shared<CapturedView>(std::move(kept)));
    }
    const bool exists = view.camera >= 0 && view.camera < static_cast<int>(state_->capture->cameras.size()) &&
                        view.frame >= 0 && view.frame < static_cast<int>(state_->capture->frames.size());
    const std::string key = state_->folder && exists ? state_->keyOf(view) : std::string();
    if (!key.empty()) {
        if (Bytes stored = state_->folder->find(key)) {
            if (auto kept = unpackView(*stored); kept && kept->id == view) {
                state_->remember(view, std::move(stored), &Counts::fromFolder);
                const std::lock_guard lock(state_->mutex);
                state_->folder->keep(key);
                return Answer(std::make_shared<CapturedView>(*std::move(kept)));
            }
        }
    }
    ARS_TRY(CapturedView decoded, readView(*state_->capture, view, state_->options.view));
    const auto packed = std::make_shared<const std::vector<std::byte>>(packView(decoded));
    state_->remember(view, packed, &Counts::decoded);
    if (!key.empty()) state_->writeToFolder(key, *packed);
    return Answer(std::make_shared<CapturedView>(std::move(decoded)));
}

std::size_t ViewCache::memoryBytes() const {
    const std::lock_guard lock(state_->mutex);
    return state_->memory.held();
}

ViewCache::Counts ViewCache::counts() const {
    const std::lock_guard lock(state_->mutex);
    return state_->counts;
}

} // namespace ars
