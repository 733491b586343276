#pragma once

#include "engine/core/error.h"

#include <filesystem>

namespace ars {

/// Takes the advisory lock on `path` (made when missing) for as long as the descriptor that it returns is open: it goes
/// with the process, however that ends. Writes the process and its host into the file. Unavailable naming the owner
/// when another process, or another writer of this one, holds it, or runOwnerElsewhere names one.
Result<int> takeRunLock(const std::filesystem::path& path);
/// Lets it go; the file then names nobody.
void releaseRunLock(int descriptor);

/// Syncs every file of a folder and the folder itself to disk. Io naming the first that cannot be.
Status syncTree(const std::filesystem::path& folder);
/// The folder's own entries (names) alone.
Status syncFolder(const std::filesystem::path& folder);

} // namespace ars
