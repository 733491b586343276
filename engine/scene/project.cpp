#include "engine/scene/project.h"

#include "engine/core/file.h"
#include "engine/scene/json_archive.h"

#include <cstdlib>

namespace ars {
namespace fs = std::filesystem;

namespace {

constexpr std::uint64_t kMaxProjectBytes = 512ull << 20;

fs::path folderOf(const fs::path& path) {
    std::error_code failure;
    const fs::path absolute = fs::absolute(path, failure);
    return (failure ? path : absolute).parent_path().lexically_normal();
}

} // namespace

Status saveProject(const fs::path& path, const Document& document) {
    return writeFileAtomic(path, documentToJson(document, folderOf(path)).dump(1) + "\n");
}

Result<Document> readProject(const fs::path& path, std::vector<std::string>* notes) {
    ReadLimits limits = defaultReadLimits();
    limits.maxFileBytes = std::min(limits.maxFileBytes, kMaxProjectBytes);
    ARS_TRY(const std::string text, readTextFile(path, limits));
    const auto json = detail::parseJsonText(text);
    if (!json) return atPlace(json.error(), path.string());
    auto document = documentFromJson(*json, folderOf(path), notes);
    if (!document) return atPlace(std::move(document).error(), path.string());
    return document;
}

fs::path stateFolder() {
    const auto variable = [](const char* name) {
        const char* text = std::getenv(name);
        return fs::path(text ? text : "");
    };
    if (const fs::path own = variable("ARS_STATE"); !own.empty()) return fs::absolute(own);
    // The XDG rules: a path that is not absolute does not count.
    if (const fs::path state = variable("XDG_STATE_HOME"); state.is_absolute()) return state / "ars";
    if (const fs::path home = variable("HOME"); home.is_absolute()) return home / ".local" / "state" / "ars";
    std::error_code failure;
    return fs::temp_directory_path(failure) / "ars";
}

} // namespace ars
