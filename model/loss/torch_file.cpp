#include "model/loss/torch_file.h"

#include "engine/core/file.h"
#include "engine/io/byte_source.h"
#include "engine/io/safetensors.h"
#include "engine/io/zip.h"
#include "model/loss/pickle.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <set>

namespace ars {
namespace {

using detail::Pickle;
using detail::PickleKind;
using detail::PickleNode;
using detail::PickleValue;

/// Bytes of the storages by their keys.
using Storages = std::map<std::string, std::span<const std::byte>>;

Error bad(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

std::optional<DType> dtypeOfStorage(const std::string& type) {
    static const std::map<std::string, DType> kTypes{{"FloatStorage", DType::F32},     {"DoubleStorage", DType::F64},
                                                     {"HalfStorage", DType::F16},      {"LongStorage", DType::I64},
                                                     {"BFloat16Storage", DType::BF16}, {"IntStorage", DType::I32},
                                                     {"ShortStorage", DType::I16},     {"CharStorage", DType::I8},
                                                     {"ByteStorage", DType::U8},       {"BoolStorage", DType::Bool}};
    const auto found = kTypes.find(type);
    if (found == kTypes.end()) return std::nullopt;
    return found->second;
}

/// A tensor's elements copied out of its storage in row-major order.
Result<Array> arrayOf(const Pickle& pickle, const PickleNode& tensor, const Storages& storages,
                      const ReadLimits& limits) {
    const PickleNode& storage = pickle.nodes[tensor.storage];
    const auto type = dtypeOfStorage(storage.storageType);
    if (!type) {
        return makeError(ErrorCode::Unsupported, "",
                         fmt::format("expected a storage of plain numbers, found {}", storage.storageType));
    }
    const auto found = storages.find(storage.text);
    if (found == storages.end()) return bad("", fmt::format("expected storage \"{}\", found none", storage.text));
    Array array;
    array.dtype = *type;
    array.shape.assign(tensor.shape.begin(), tensor.shape.end());
    const std::size_t size = dtypeBytes(*type);
    ARS_TRY(const std::size_t count, elementCount(array.shape, size));
    if (count * size > limits.maxBytes)
        return makeError(ErrorCode::LimitExceeded, "", fmt::format("expected at most {} bytes", limits.maxBytes));
    const std::uint64_t available = found->second.size() / size;
    // The farthest element, in numbers that cannot overflow: strides beyond the storage are wrong whatever the shape.
    std::uint64_t last = static_cast<std::uint64_t>(tensor.offset);
    bool outside = last > available;
    for (std::size_t d = 0; d < tensor.shape.size() && count > 0 && !outside; ++d) {
        const auto steps = static_cast<std::uint64_t>(tensor.shape[d] - 1);
        const auto stride = static_cast<std::uint64_t>(tensor.strides[d]);
        outside = steps > 0 && stride > available / steps;
        if (!outside) last += steps * stride;
        outside = outside || last > available;
    }
    if (outside || (count > 0 && last >= available))
        return bad(
            "", fmt::format("expected elements of storage \"{}\" up to {}, it has {}", storage.text, last, available));
    // Views that repeat a storage (stride 0) may be larger than the file, but not by more than a tensor's own bytes.
    array.bytes.resize(count * size);
    std::vector<std::int64_t> index(tensor.shape.size(), 0);
    std::int64_t place = tensor.offset;
    for (std::size_t i = 0; i < count; ++i) {
        std::memcpy(&array.bytes[i * size], &found->second[static_cast<std::size_t>(place) * size], size);
        for (std::size_t d = index.size(); d-- > 0;) {
            place += tensor.strides[d];
            if (++index[d] < tensor.shape[d]) break;
            place -= tensor.strides[d] * tensor.shape[d];
            index[d] = 0;
        }
    }
    return array;
}

Result<std::map<std::string, Array>> tensorsOf(const Pickle& pickle, const Storages& storages,
                                               const ReadLimits& limits) {
    if (pickle.top.kind != PickleKind::Dictionary)
        return bad("", "expected a state dict (names and tensors), found something else");
    std::map<std::string, Array> tensors;
    std::uint64_t bytes = 0;
    for (const auto& [key, value] : pickle.node(pickle.top).entries) {
        if (key.kind != PickleKind::Text || value.kind != PickleKind::Tensor) continue;
        const std::string& name = pickle.node(key).text;
        auto array = arrayOf(pickle, pickle.node(value), storages, limits);
        if (!array) return atPlace(std::move(array).error(), fmt::format("tensor \"{}\"", name));
        bytes += array->bytes.size();
        if (bytes > limits.maxBytes) {
            return makeError(ErrorCode::LimitExceeded, "",
                             fmt::format("expected tensors of at most {} bytes in all", limits.maxBytes));
        }
        tensors[name] = std::move(*array);
    }
    if (tensors.empty()) return bad("", "expected a state dict (names and tensors), found no tensor");
    return tensors;
}

/// Keys of the storages whose sizes the old form does not repeat beside their bytes.
std::map<std::string, std::size_t> elementBytesOfStorages(const Pickle& pickle) {
    std::map<std::string, std::size_t> sizes;
    for (const PickleNode& node : pickle.nodes) {
        if (node.storageType.empty()) continue;
        const auto type = dtypeOfStorage(node.storageType);
        sizes[node.text] = type ? dtypeBytes(*type) : 0;
    }
    return sizes;
}

/// Magic number, protocol, system, the state dict, keys of storages, and their bytes in that order.
Result<std::map<std::string, Array>> parseOldForm(std::span<const std::byte> bytes, const ReadLimits& limits) {
    std::size_t at = 0;
    std::vector<Pickle> pickles;
    for (int i = 0; i < 5; ++i) {
        auto pickle = detail::parsePickle(bytes.subspan(at));
        if (!pickle) return atPlace(std::move(pickle).error(), fmt::format("pickle {} at byte {}", i + 1, at));
        at += pickle->length;
        pickles.push_back(std::move(*pickle));
    }
    const Pickle &dictionary = pickles[3], &keys = pickles[4];
    if (keys.top.kind != PickleKind::Sequence) return bad("", "expected a list of storages");
    const auto sizes = elementBytesOfStorages(dictionary);
    Storages storages;
    for (const PickleValue& item : keys.node(keys.top).items) {
        if (item.kind != PickleKind::Text) return bad("", "expected a list of names of storages");
        const std::string& key = keys.node(item).text;
        const auto size = sizes.find(key);
        if (size == sizes.end() || size->second == 0)
            return bad("", fmt::format("expected the type of storage \"{}\", found none that is known", key));
        std::uint64_t count = 0;
        if (bytes.size() - at < sizeof count)
            return bad(fmt::format("byte {}", at), "expected a storage, the file ends");
        std::memcpy(&count, &bytes[at], sizeof count);
        at += sizeof count;
        if (count > (bytes.size() - at) / size->second) {
            return bad(fmt::format("byte {}", at),
                       fmt::format("expected {} elements of storage \"{}\", the file ends before", count, key));
        }
        storages[key] = bytes.subspan(at, count * size->second);
        at += count * size->second;
    }
    return tensorsOf(dictionary, storages, limits);
}

Result<std::vector<std::byte>> memberBytes(const ByteSource& source, const ZipEntry& entry) {
    ARS_TRY(const auto stream, openZipEntry(source, entry));
    ARS_TRY(auto bytes, allocateBytes(entry.plainBytes, entry.name));
    ARS_TRY_STATUS(stream->read(bytes, entry.name));
    ARS_TRY_STATUS(stream->finish());
    return bytes;
}

/// NAME/data.pkl and NAME/data/KEY.
Result<std::map<std::string, Array>> parseZipForm(std::span<const std::byte> bytes, const ReadLimits& limits) {
    const MemorySource source(bytes);
    ARS_TRY(const auto entries, readZipDirectory(source));
    const auto dictionaryEntry = std::find_if(entries.begin(), entries.end(), [](const ZipEntry& entry) {
        return entry.name == "data.pkl" || entry.name.ends_with("/data.pkl");
    });
    if (dictionaryEntry == entries.end()) return bad("", "expected a member data.pkl, found none: no torch.save file");
    const std::string folder = dictionaryEntry->name.substr(0, dictionaryEntry->name.size() - 8);
    std::uint64_t total = 0;
    for (const ZipEntry& entry : entries) {
        if (entry.plainBytes > limits.maxBytes - std::min(total, limits.maxBytes))
            return makeError(ErrorCode::LimitExceeded, "", fmt::format("expected at most {} bytes", limits.maxBytes));
        total += entry.plainBytes;
    }
    ARS_TRY(const auto pickleBytes, memberBytes(source, *dictionaryEntry));
    auto pickle = detail::parsePickle(pickleBytes);
    if (!pickle) return atPlace(std::move(pickle).error(), "data.pkl");
    std::map<std::string, std::vector<std::byte>> memory;
    Storages storages;
    for (const ZipEntry& entry : entries) {
        if (!entry.name.starts_with(folder + "data/")) continue;
        const std::string key = entry.name.substr(folder.size() + 5);
        ARS_TRY(memory[key], memberBytes(source, entry));
        storages[key] = memory[key];
    }
    return tensorsOf(*pickle, storages, limits);
}

bool beginsWith(std::span<const std::byte> bytes, std::string_view text) {
    return bytes.size() >= text.size() && std::memcmp(bytes.data(), text.data(), text.size()) == 0;
}

} // namespace

Result<std::map<std::string, Array>> readTorchFile(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const auto bytes, readFile(path, limits));
    auto tensors = beginsWith(bytes, "PK") ? parseZipForm(bytes, limits)
                   : beginsWith(bytes, "\x80\x02\x8a\x0a")
                       ? parseOldForm(bytes, limits)
                       : Result<std::map<std::string, Array>>(
                             bad("", "expected a file of torch.save (a zip, or pickles), found neither"));
    if (!tensors) return atPlace(std::move(tensors).error(), path.string());
    return tensors;
}

Result<std::map<std::string, Array>> readTensorFile(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const auto head, readFileHead(path, 9));
    // A safetensors file begins with eight bytes of length and its JSON.
    if (head.size() == 9 && static_cast<char>(head[8]) == '{') {
        ARS_TRY(auto file, readSafetensors(path, limits));
        return std::move(file.tensors);
    }
    return readTorchFile(path, limits);
}

} // namespace ars
