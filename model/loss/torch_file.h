#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/array.h"

#include <filesystem>
#include <map>
#include <string>

namespace ars {

/// The tensors of a state dict as torch.save writes it: a zip (since PyTorch 1.6) or the older file of five pickles and
/// raw storages. No pickled code is run: the pickle is read by a machine of its own that knows containers, numbers,
/// text and the four names that a state dict is made of, and refuses everything else.
///
/// @return the dictionary's own tensors (entries that are none are left out); BadFile with the byte and what was found
///         there; Unsupported naming a global that state dicts do not use, or a type of numbers that arrays have not
Result<std::map<std::string, Array>> readTorchFile(const std::filesystem::path& path,
                                                   const ReadLimits& limits = defaultReadLimits());

/// The same of either a .safetensors or a torch file: the content counts, not the name.
Result<std::map<std::string, Array>> readTensorFile(const std::filesystem::path& path,
                                                    const ReadLimits& limits = defaultReadLimits());

} // namespace ars
