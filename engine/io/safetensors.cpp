#include "engine/io/safetensors.h"

#include "engine/core/file.h"
#include "engine/io/byte_source.h"
#include "engine/io/utf8.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <utility>

namespace ars {
namespace {

constexpr std::uint64_t kMaxHeaderBytes = 100'000'000; // the format's own limit
constexpr std::uint64_t kLengthBytes = 8;
constexpr std::string_view kMetadata = "__metadata__";
constexpr std::size_t kMaxDimensions = 64;

struct TypeName {
    std::string_view name;
    DType dtype;
};
constexpr TypeName kTypes[] = {
    {"BOOL", DType::Bool}, {"I8", DType::I8},   {"I16", DType::I16}, {"I32", DType::I32}, {"I64", DType::I64},
    {"U8", DType::U8},     {"U16", DType::U16}, {"U32", DType::U32}, {"U64", DType::U64}, {"F16", DType::F16},
    {"BF16", DType::BF16}, {"F32", DType::F32}, {"F64", DType::F64}, {"C64", DType::C64},
};

std::optional<DType> typeOf(std::string_view name) {
    for (const TypeName& type : kTypes) {
        if (type.name == name) return type.dtype;
    }
    return {};
}

std::string_view nameOf(DType dtype) {
    for (const TypeName& type : kTypes) {
        if (type.dtype == dtype) return type.name;
    }
    return {};
}

/// Takes the header's JSON event by event, so that a header of 100 MB costs no more memory than the tensors it names,
/// and nesting, surprises and repeated keys end the parse at once.
class HeaderHandler : public nlohmann::json_sax<nlohmann::json> {
public:
    std::vector<SafetensorsEntry> entries;
    std::map<std::string, std::string> metadata;
    std::optional<Error> error;

    bool start_object(std::size_t) override;
    bool key(string_t& name) override;
    bool end_object() override;
    bool start_array(std::size_t) override;
    bool end_array() override;
    bool string(string_t& text) override;
    bool number_unsigned(number_unsigned_t value) override;
    bool number_integer(number_integer_t value) override { return surprise(fmt::format("{}", value)); }
    bool number_float(number_float_t, const string_t& text) override { return surprise(text); }
    bool null() override { return surprise("null"); }
    bool boolean(bool value) override { return surprise(value ? "true" : "false"); }
    bool binary(binary_t&) override { return surprise("binary data"); }
    bool parse_error(std::size_t position, const std::string&, const nlohmann::json::exception&) override {
        return fail(fmt::format("byte {}", kLengthBytes + position - std::min<std::size_t>(position, 1)),
                    "the header is no valid JSON");
    }

private:
    enum class State { Start, Top, Metadata, Tensor, Shape, Offsets, Done };

    bool fail(std::string place, std::string message) {
        if (!error) error = makeError(ErrorCode::BadFile, std::move(place), std::move(message));
        return false;
    }
    std::string place() const { return name_; }
    std::string_view expected() const;
    bool surprise(std::string_view found) {
        return fail(place(), fmt::format("expected {} in the header, found {}", expected(), found));
    }
    bool tensorKey(const std::string& name);
    bool finishTensor();

    State state_ = State::Start;
    std::string name_;  ///< of the tensor, or __metadata__
    std::string field_; ///< last key inside it
    SafetensorsEntry entry_;
    std::vector<std::uint64_t> offsets_;
    bool hasType_ = false, hasShape_ = false, hasOffsets_ = false;
    bool seenMetadata_ = false;
};

std::string_view HeaderHandler::expected() const {
    switch (state_) {
    case State::Start:
        return "an object";
    case State::Top:
        return "an object for each name";
    case State::Metadata:
        return "texts in __metadata__";
    case State::Tensor:
        return "dtype (a text), shape and data_offsets (lists)";
    case State::Shape:
        return "extents of 0 or more below 2^64";
    case State::Offsets:
        return "two byte offsets below 2^64";
    case State::Done:
        return "nothing more";
    }
    return "";
}

bool HeaderHandler::start_object(std::size_t) {
    if (state_ == State::Start) {
        state_ = State::Top;
        return true;
    }
    if (state_ != State::Top) return surprise("an object");
    if (name_ == kMetadata) {
        state_ = State::Metadata;
        return true;
    }
    state_ = State::Tensor;
    entry_ = SafetensorsEntry{};
    entry_.name = name_;
    offsets_.clear();
    hasType_ = hasShape_ = hasOffsets_ = false;
    return true;
}

bool HeaderHandler::key(string_t& name) {
    if (state_ == State::Top) {
        name_ = name;
        if (name != kMetadata) return true; // repeated tensors are found when all are sorted by name
        if (std::exchange(seenMetadata_, true)) return fail(name_, "is named twice in the header");
        return true;
    }
    field_ = name;
    if (state_ == State::Tensor) return tensorKey(name);
    if (metadata.contains(name)) return fail(place(), fmt::format("the key \"{}\" is given twice", name));
    return true;
}

bool HeaderHandler::tensorKey(const std::string& name) {
    bool* seen = name == "dtype"          ? &hasType_
                 : name == "shape"        ? &hasShape_
                 : name == "data_offsets" ? &hasOffsets_
                                          : nullptr;
    if (!seen) return surprise(fmt::format("the key \"{}\"", name));
    if (std::exchange(*seen, true)) return fail(place(), fmt::format("the key \"{}\" is given twice", name));
    return true;
}

bool HeaderHandler::start_array(std::size_t) {
    if (state_ != State::Tensor || field_ == "dtype") return surprise("a list");
    state_ = field_ == "shape" ? State::Shape : State::Offsets;
    return true;
}

bool HeaderHandler::end_array() {
    if (state_ == State::Offsets && offsets_.size() != 2) return surprise(fmt::format("{} numbers", offsets_.size()));
    state_ = State::Tensor;
    return true;
}

bool HeaderHandler::number_unsigned(number_unsigned_t value) {
    if (state_ == State::Shape) {
        if (entry_.shape.size() == kMaxDimensions) return fail(place(), "has more than 64 dimensions");
        entry_.shape.push_back(static_cast<std::size_t>(value));
        return true;
    }
    if (state_ != State::Offsets || offsets_.size() == 2) return surprise(fmt::format("the number {}", value));
    offsets_.push_back(value);
    return true;
}

bool HeaderHandler::string(string_t& text) {
    if (state_ == State::Metadata) {
        metadata.emplace(field_, text);
        return true;
    }
    if (state_ != State::Tensor || field_ != "dtype") return surprise("a text");
    entry_.storedType = text;
    return true;
}

bool HeaderHandler::end_object() {
    if (state_ == State::Tensor && !finishTensor()) return false;
    state_ = state_ == State::Top ? State::Done : State::Top;
    return true;
}

bool HeaderHandler::finishTensor() {
    if (!hasType_ || !hasShape_ || !hasOffsets_) {
        return surprise(!hasType_ ? "no dtype" : !hasShape_ ? "no shape" : "no data_offsets");
    }
    entry_.begin = offsets_[0];
    entry_.end = offsets_[1];
    entries.push_back(std::move(entry_));
    return true;
}

/// Checks type, shape and range of one tensor against each other; names the problem of types that Array has not.
Status checkEntry(SafetensorsEntry& entry) {
    if (entry.begin > entry.end) {
        return makeError(ErrorCode::BadFile, entry.name,
                         fmt::format("data_offsets end at {} before they begin at {}", entry.end, entry.begin));
    }
    const auto dtype = typeOf(entry.storedType);
    if (!dtype) {
        entry.problem =
            fmt::format("the element type \"{}\" is not one that this program reads (BOOL, I8 to I64, U8 to "
                        "U64, F16, BF16, F32, F64, C64)",
                        entry.storedType);
        return {};
    }
    entry.dtype = *dtype;
    auto count = elementCount(entry.shape, dtypeBytes(*dtype));
    if (!count) return atPlace(std::move(count).error(), entry.name);
    if (*count * dtypeBytes(*dtype) != entry.end - entry.begin) {
        return makeError(ErrorCode::BadFile, entry.name,
                         fmt::format("expected {} bytes for {} {}, data_offsets give {}", *count * dtypeBytes(*dtype),
                                     entry.storedType, formatShape(entry.shape), entry.end - entry.begin));
    }
    return {};
}

/// The tensors must cover the bytes behind the header from first to last without gap or overlap.
Status checkCoverage(std::vector<SafetensorsEntry>& entries, std::uint64_t dataBytes) {
    std::sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
    for (std::size_t i = 1; i < entries.size(); ++i) {
        if (entries[i].name != entries[i - 1].name) continue;
        return makeError(ErrorCode::BadFile, entries[i].name, "is named twice in the header");
    }
    std::stable_sort(entries.begin(), entries.end(), [](const auto& a, const auto& b) {
        return std::pair(a.begin, a.end) < std::pair(b.begin, b.end);
    });
    std::uint64_t covered = 0;
    for (const SafetensorsEntry& entry : entries) {
        if (entry.begin != covered) {
            return makeError(ErrorCode::BadFile, entry.name,
                             fmt::format("expected its data at byte {} behind the header, data_offsets say {} ({})",
                                         covered, entry.begin, entry.begin < covered ? "an overlap" : "a gap"));
        }
        covered = entry.end;
    }
    if (covered != dataBytes) {
        return makeError(
            ErrorCode::BadFile, "",
            fmt::format("expected {} bytes of tensors behind the header, the file has {}", covered, dataBytes));
    }
    return {};
}

Result<SafetensorsIndex> readIndex(const ByteSource& source, const ReadLimits& limits) {
    std::array<std::byte, kLengthBytes> lengthBytes{};
    ARS_TRY_STATUS(source.readAt(0, lengthBytes, "the header's length"));
    std::uint64_t length = 0;
    std::memcpy(&length, lengthBytes.data(), sizeof length);
    const std::uint64_t most = std::min(kMaxHeaderBytes, limits.maxBytes);
    if (length > source.size() - kLengthBytes) {
        return makeError(ErrorCode::BadFile, "byte 0",
                         fmt::format("expected a safetensors header of {} bytes, the file ends after {}", length,
                                     source.size() - kLengthBytes));
    }
    if (length > most) {
        return makeError(ErrorCode::LimitExceeded, "byte 0",
                         fmt::format("the header has {} bytes, the limit is {}", length, most));
    }
    ARS_TRY(std::vector<std::byte> header, allocateBytes(length, "the header"));
    ARS_TRY_STATUS(source.readAt(kLengthBytes, header, "the header"));
    HeaderHandler handler;
    const auto* text = reinterpret_cast<const char*>(header.data());
    if (!nlohmann::json::sax_parse(text, text + header.size(), &handler) || handler.error) {
        return handler.error ? *std::move(handler.error)
                             : makeError(ErrorCode::BadFile, "byte 8", "the header is no valid JSON");
    }
    SafetensorsIndex index{std::move(handler.entries), std::move(handler.metadata), kLengthBytes + length};
    for (SafetensorsEntry& entry : index.entries) ARS_TRY_STATUS(checkEntry(entry));
    ARS_TRY_STATUS(checkCoverage(index.entries, source.size() - index.dataOffset));
    return index;
}

Result<SafetensorsFile> decode(const ByteSource& source, const ReadLimits& limits) {
    ARS_TRY(SafetensorsIndex index, readIndex(source, limits));
    const std::uint64_t total = source.size() - index.dataOffset;
    if (total > limits.maxBytes) {
        return makeError(ErrorCode::LimitExceeded, "",
                         fmt::format("the tensors need {} bytes of memory, the limit is {}", total, limits.maxBytes));
    }
    SafetensorsFile file;
    file.metadata = std::move(index.metadata);
    for (SafetensorsEntry& entry : index.entries) {
        if (!entry.problem.empty()) return makeError(ErrorCode::Unsupported, entry.name, entry.problem);
        Array array;
        array.dtype = entry.dtype;
        array.shape = std::move(entry.shape);
        ARS_TRY(array.bytes, allocateBytes(entry.end - entry.begin, "a tensor"));
        ARS_TRY_STATUS(source.readAt(index.dataOffset + entry.begin, array.bytes, "a tensor"));
        if (entry.dtype == DType::Bool) {
            for (std::byte& flag : array.bytes) flag = std::byte{flag != std::byte{0}};
        }
        file.tensors.emplace(std::move(entry.name), std::move(array));
    }
    return file;
}

/// Reads a file through `read` and puts the path before the place of its errors.
template <typename T, typename Read>
Result<T> readPath(const std::filesystem::path& path, const ReadLimits& limits, Read&& read) {
    auto source = FileSource::open(path, limits);
    if (!source) return atPlace(std::move(source).error(), path.string());
    Result<T> result = read(**source, limits);
    if (!result) return atPlace(std::move(result).error(), path.string());
    return result;
}

using NamedTensor = std::pair<const std::string, Array>;

Status checkTensor(const std::string& name, const Array& array) {
    if (name == kMetadata || !isUtf8(name)) {
        return makeError(ErrorCode::InvalidArgument, name,
                         "expected a tensor name in UTF-8 other than \"__metadata__\"");
    }
    if (nameOf(array.dtype).empty()) {
        return makeError(ErrorCode::InvalidArgument, name,
                         fmt::format("expected a type that safetensors has, found {}", array.describe()));
    }
    if (array.shape.size() > kMaxDimensions) {
        return makeError(ErrorCode::InvalidArgument, name, "expected at most 64 dimensions");
    }
    if (Status valid = validateArray(array); !valid) return atPlace(std::move(valid).error(), name);
    return {};
}

/// The length, the header padded to eight bytes, and the tensors in the order of their bytes.
Result<std::string> encodeHeader(const SafetensorsFile& file, std::vector<const NamedTensor*>& order) {
    for (const NamedTensor& tensor : file.tensors) {
        ARS_TRY_STATUS(checkTensor(tensor.first, tensor.second));
        order.push_back(&tensor);
    }
    std::stable_sort(order.begin(), order.end(), [](const NamedTensor* a, const NamedTensor* b) {
        return dtypeBytes(a->second.dtype) > dtypeBytes(b->second.dtype);
    });
    auto header = nlohmann::json::object();
    if (!file.metadata.empty()) header[std::string(kMetadata)] = file.metadata;
    std::uint64_t offset = 0;
    for (const NamedTensor* tensor : order) {
        const Array& array = tensor->second;
        header[tensor->first] = {{"dtype", nameOf(array.dtype)},
                                 {"shape", array.shape},
                                 {"data_offsets", {offset, offset + array.bytes.size()}}};
        offset += array.bytes.size();
    }
    std::string text;
    try {
        text = header.dump();
    } catch (const nlohmann::json::exception&) { // the names are checked, so it is a text of the metadata
        return makeError(ErrorCode::InvalidArgument, std::string(kMetadata), "expected UTF-8 texts");
    }
    text.append((kLengthBytes - text.size() % kLengthBytes) % kLengthBytes, ' ');
    if (text.size() > kMaxHeaderBytes) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("the header has {} bytes, safetensors allows {}", text.size(), kMaxHeaderBytes));
    }
    const std::uint64_t length = text.size();
    return std::string(reinterpret_cast<const char*>(&length), sizeof length) + text;
}

} // namespace

Result<const Array*> SafetensorsFile::find(std::string_view name) const {
    if (const auto found = tensors.find(std::string(name)); found != tensors.end()) return &found->second;
    std::string names;
    constexpr std::size_t kMostNamed = 32;
    std::size_t named = 0;
    for (const auto& [other, array] : tensors) {
        if (named++ == kMostNamed) break;
        names += (names.empty() ? "" : ", ") + other;
    }
    if (tensors.size() > kMostNamed) names += fmt::format(" and {} more", tensors.size() - kMostNamed);
    return makeError(ErrorCode::NotFound, "",
                     fmt::format("expected the tensor \"{}\", found {}", name, names.empty() ? "no tensors" : names));
}

Result<SafetensorsFile> parseSafetensors(std::span<const std::byte> file, const ReadLimits& limits) {
    return decode(MemorySource(file), limits);
}

Result<SafetensorsFile> readSafetensors(const std::filesystem::path& path, const ReadLimits& limits) {
    return readPath<SafetensorsFile>(path, limits, decode);
}

Result<SafetensorsIndex> listSafetensors(const std::filesystem::path& path, const ReadLimits& limits) {
    return readPath<SafetensorsIndex>(path, limits, readIndex);
}

Result<std::vector<std::byte>> encodeSafetensors(const SafetensorsFile& file) {
    std::vector<const NamedTensor*> order;
    ARS_TRY(const std::string header, encodeHeader(file, order));
    std::vector<std::byte> bytes;
    ARS_TRY_STATUS(appendBytes(bytes, std::as_bytes(std::span(header))));
    for (const NamedTensor* tensor : order) ARS_TRY_STATUS(appendBytes(bytes, tensor->second.bytes));
    return bytes;
}

Status writeSafetensors(const std::filesystem::path& path, const SafetensorsFile& file) {
    std::vector<const NamedTensor*> order;
    auto header = encodeHeader(file, order);
    if (!header) return atPlace(std::move(header).error(), path.string());
    ARS_TRY(AtomicFile output, AtomicFile::open(path));
    ARS_TRY_STATUS(output.write(std::string_view(*header)));
    for (const NamedTensor* tensor : order) {
        ARS_TRY_STATUS(output.write(std::span<const std::byte>(tensor->second.bytes)));
    }
    return output.commit();
}

} // namespace ars
