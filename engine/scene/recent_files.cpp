#include "engine/core/file.h"
#include "engine/core/log.h"
#include "engine/scene/json_archive.h"
#include "engine/scene/project.h"

#include <algorithm>

namespace ars {
namespace fs = std::filesystem;

namespace {

constexpr std::size_t kMost = 20;
constexpr std::uint64_t kMaxListBytes = 4u << 20;

/// Empty where there is no sound list: recent files are a convenience that nobody should be told off about.
std::vector<fs::path> readList(const fs::path& file) {
    ReadLimits limits = defaultReadLimits();
    limits.maxFileBytes = std::min(limits.maxFileBytes, kMaxListBytes);
    const auto text = readTextFile(file, limits);
    if (!text) return {};
    const auto json = detail::parseJsonText(*text);
    if (!json || !json->is_array()) {
        logWarning("{}: the list of recent files is broken and begins anew", file.string());
        return {};
    }
    std::vector<fs::path> files;
    for (const auto& item : *json) {
        const std::optional<std::string> path = detail::textFromJson(item);
        if (path && !path->empty() && path->find('\0') == std::string::npos && files.size() < kMost) {
            files.emplace_back(*path);
        }
    }
    return files;
}

} // namespace

RecentFiles::RecentFiles(fs::path folder) : file_(std::move(folder) / "recent_files.json"), files_(readList(file_)) {}

void RecentFiles::add(const fs::path& path) {
    std::error_code failure;
    const fs::path absolute = fs::absolute(path, failure);
    const fs::path added = (failure ? path : absolute).lexically_normal();
    // Another window may have added files since.
    if (fs::exists(file_, failure)) files_ = readList(file_);
    std::erase(files_, added);
    files_.insert(files_.begin(), added);
    if (files_.size() > kMost) files_.resize(kMost);
    if (const Status saved = save(); !saved) logWarning("recent files: {}", saved.error().describe());
}

void RecentFiles::clear() {
    files_.clear();
    if (const Status saved = save(); !saved) logWarning("recent files: {}", saved.error().describe());
}

Status RecentFiles::save() const {
    detail::Json json = detail::Json::array();
    for (const fs::path& path : files_) json.push_back(detail::textToJson(path.string()));
    return writeFileAtomic(file_, json.dump(1) + "\n");
}

} // namespace ars
