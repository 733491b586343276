#include "engine/io/npy.h"

#include "engine/core/file.h"
#include "engine/io/npz.h"
#include "engine/io/utf8.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <limits>
#include <utility>

namespace ars {
namespace {

constexpr std::string_view kMagic{"\x93NUMPY", 6};
/// numpy itself refuses to read headers above 10,000 bytes unless told; plain arrays need about 100.
constexpr std::size_t kMaxHeaderBytes = 65536;
constexpr std::size_t kMaxDimensions = 64; // numpy 2: NPY_MAXDIMS
constexpr std::uint64_t kMaxItemBytes = std::numeric_limits<std::int32_t>::max();

constexpr std::string_view kHowToConvert =
    "which this program never runs; convert it once in Python: load it with numpy.load(FILE, allow_pickle=True) and "
    "write its plain number arrays with numpy.savez(OUT, name=array, ...)";

std::uint64_t saturatingMultiply(std::uint64_t a, std::uint64_t b) {
    std::uint64_t product = 0;
    return __builtin_mul_overflow(a, b, &product) ? std::numeric_limits<std::uint64_t>::max() : product;
}

std::uint64_t saturatingAdd(std::uint64_t a, std::uint64_t b) {
    std::uint64_t sum = 0;
    return __builtin_add_overflow(a, b, &sum) ? std::numeric_limits<std::uint64_t>::max() : sum;
}

/// A strict reader of the one Python literal that a .npy header is: a dictionary of a string, a bool and a tuple.
class HeaderParser {
public:
    HeaderParser(std::string_view text, std::size_t firstByte) : text_(text), firstByte_(firstByte) {}

    /// Fills descr, fortranOrder and shape of `header`'s dictionary.
    Status parse(std::string& descr, bool& fortranOrder, std::vector<std::size_t>& shape);

private:
    Error bad(std::string_view expected) const {
        const std::string found =
            position_ < text_.size() ? fmt::format("\"{}\"", text_.substr(position_, 16)) : "the end of the header";
        return makeError(ErrorCode::BadFile, fmt::format("byte {}", firstByte_ + position_),
                         fmt::format("expected {} in the .npy header, found {}", expected, found));
    }
    void skipSpace() {
        while (position_ < text_.size() && (text_[position_] == ' ' || text_[position_] == '\n')) ++position_;
    }
    bool accept(std::string_view token) {
        skipSpace();
        if (!text_.substr(position_).starts_with(token)) return false;
        position_ += token.size();
        return true;
    }
    Result<std::string> parseString(std::string_view what);
    Result<std::size_t> parseExtent();
    Status parseShape(std::vector<std::size_t>& shape);
    Status parseDescr(std::string& descr);
    Status parseValue(std::string_view key, std::string& descr, bool& fortranOrder, std::vector<std::size_t>& shape);

    std::string_view text_;
    std::size_t firstByte_;
    std::size_t position_ = 0;
    bool seen_[3] = {};
};

Result<std::string> HeaderParser::parseString(std::string_view what) {
    skipSpace();
    const char quote = position_ < text_.size() ? text_[position_] : '\0';
    if (quote != '\'' && quote != '"') return bad(what);
    const std::size_t end = text_.find(quote, position_ + 1);
    if (end == std::string_view::npos) return bad(what);
    const std::string_view inside = text_.substr(position_ + 1, end - position_ - 1);
    if (inside.find('\\') != std::string_view::npos) return bad(what);
    position_ = end + 1;
    return std::string(inside);
}

Result<std::size_t> HeaderParser::parseExtent() {
    skipSpace();
    std::size_t extent = 0;
    const char* begin = text_.data() + position_;
    const auto [end, code] = std::from_chars(begin, text_.data() + text_.size(), extent);
    if (code == std::errc::result_out_of_range) return bad("an extent below 2^64");
    if (code != std::errc{}) return bad("an extent of 0 or more");
    position_ += static_cast<std::size_t>(end - begin);
    accept("L"); // Python 2 wrote long integers so
    return extent;
}

Status HeaderParser::parseShape(std::vector<std::size_t>& shape) {
    if (!accept("(")) return bad("a tuple as shape");
    bool comma = true;
    while (!accept(")")) {
        if (!comma) return bad("\",\" or \")\"");
        if (shape.size() == kMaxDimensions) return bad(fmt::format("at most {} extents", kMaxDimensions));
        ARS_TRY(const std::size_t extent, parseExtent());
        shape.push_back(extent);
        comma = accept(",");
    }
    // "(3)" is a number in brackets, not a tuple.
    if (shape.size() == 1 && !comma) return bad("\",\" in a shape of one extent");
    return {};
}

Status HeaderParser::parseDescr(std::string& descr) {
    if (accept("[") || accept("(")) {
        return makeError(ErrorCode::Unsupported, "",
                         "is a structured array (several fields an element), expected plain numbers; save each field "
                         "as an array of its own with numpy.savez(OUT, name=array['name'], ...)");
    }
    ARS_TRY(descr, parseString("a type string"));
    return {};
}

Status HeaderParser::parseValue(std::string_view key, std::string& descr, bool& fortranOrder,
                                std::vector<std::size_t>& shape) {
    if (key == "descr") return parseDescr(descr);
    if (key == "shape") return parseShape(shape);
    fortranOrder = accept("True");
    if (!fortranOrder && !accept("False")) return bad("True or False");
    return {};
}

Status HeaderParser::parse(std::string& descr, bool& fortranOrder, std::vector<std::size_t>& shape) {
    constexpr std::string_view kKeys[] = {"descr", "fortran_order", "shape"};
    if (!accept("{")) return bad("\"{\"");
    bool comma = true;
    while (!accept("}")) {
        if (!comma) return bad("\",\" or \"}\"");
        ARS_TRY(const std::string key, parseString("a quoted key"));
        const auto index = static_cast<std::size_t>(std::find(kKeys, kKeys + 3, key) - kKeys);
        if (index == 3 || seen_[index]) return bad("the keys descr, fortran_order and shape, once each, before this");
        seen_[index] = true;
        if (!accept(":")) return bad("\":\"");
        ARS_TRY_STATUS(parseValue(key, descr, fortranOrder, shape));
        comma = accept(",");
    }
    for (std::size_t i = 0; i < 3; ++i) {
        if (!seen_[i]) return bad(fmt::format("the key {} before this", kKeys[i]));
    }
    skipSpace();
    if (position_ != text_.size()) return bad("nothing but spaces after \"}\"");
    return {};
}

Error unsupportedType(std::string_view descr, std::string_view why) {
    return makeError(ErrorCode::Unsupported, "", fmt::format("the element type \"{}\" {}", descr, why));
}

struct NumberType {
    char kind;
    std::size_t bytes;
    DType dtype;
};
constexpr NumberType kNumberTypes[] = {
    {'b', 1, DType::Bool}, {'i', 1, DType::I8},  {'i', 2, DType::I16}, {'i', 4, DType::I32},   {'i', 8, DType::I64},
    {'u', 1, DType::U8},   {'u', 2, DType::U16}, {'u', 4, DType::U32}, {'u', 8, DType::U64},   {'f', 2, DType::F16},
    {'f', 4, DType::F32},  {'f', 8, DType::F64}, {'c', 8, DType::C64}, {'c', 16, DType::C128},
};

/// Reads numpy's type string: an optional byte order, a letter, bytes (or characters) an element.
Status parseTypeString(std::string_view descr, NpyHeader& header) {
    const auto bad = [&] {
        return makeError(
            ErrorCode::BadFile, "",
            fmt::format("expected an element type such as \"<f4\" in the .npy header, found \"{}\"", descr));
    };
    std::string_view rest = descr;
    if (!rest.empty() && std::string_view("<>|=").find(rest[0]) != std::string_view::npos) {
        header.bigEndian = rest[0] == '>';
        rest.remove_prefix(1);
    }
    if (rest.empty()) return bad();
    const char kind = rest[0];
    if (kind == 'O') {
        return makeError(ErrorCode::Unsupported, "",
                         fmt::format("is an array of Python objects, stored as a pickle, {}", kHowToConvert));
    }
    if (kind == 'M' || kind == 'm') return unsupportedType(descr, "is a date or time; save it as integers");
    std::uint64_t size = 0;
    const auto [end, code] = std::from_chars(rest.data() + 1, rest.data() + rest.size(), size);
    if (code != std::errc{} || end != rest.data() + rest.size() || size > kMaxItemBytes) return bad();
    if (kind == 'V') return unsupportedType(descr, "has no meaning of its own; save it as numbers");
    if (kind == 'U' || kind == 'S') {
        header.kind = kind == 'U' ? NpyHeader::Kind::UnicodeText : NpyHeader::Kind::ByteText;
        header.dtype = DType::Text;
        header.itemBytes = static_cast<std::size_t>(kind == 'U' ? 4 * size : size);
        return {};
    }
    for (const NumberType& type : kNumberTypes) {
        if (type.kind != kind || type.bytes != size) continue;
        header.dtype = type.dtype;
        header.itemBytes = type.bytes;
        return {};
    }
    if ((kind == 'f' || kind == 'c') && size > 8) {
        return unsupportedType(descr, "is a long double; save it with .astype(numpy.float64)");
    }
    return bad();
}

/// Reads magic, version and header length; gives the header's text.
Result<std::string> readHeaderText(ByteStream& stream) {
    std::array<std::byte, 8> start{};
    const std::size_t there = static_cast<std::size_t>(std::min<std::uint64_t>(start.size(), stream.size()));
    ARS_TRY_STATUS(stream.read(std::span(start).first(there), "the start of a .npy file"));
    if (there < kMagic.size() || std::memcmp(start.data(), kMagic.data(), kMagic.size()) != 0) {
        return notNumpy(std::span(start).first(there), ".npy");
    }
    const int version = static_cast<int>(start[6]);
    if (there == start.size() && (version < 1 || version > 3 || start[7] != std::byte{0})) {
        return makeError(
            ErrorCode::Unsupported, "byte 6",
            fmt::format("expected .npy version 1.0, 2.0 or 3.0, found {}.{}", version, static_cast<int>(start[7])));
    }
    std::array<std::byte, 4> lengthBytes{};
    ARS_TRY_STATUS(stream.read(std::span(lengthBytes).first(version == 1 ? 2 : 4), "the .npy header's length"));
    std::uint32_t length = 0;
    std::memcpy(&length, lengthBytes.data(), sizeof length);
    if (length > kMaxHeaderBytes) {
        return makeError(ErrorCode::LimitExceeded, "byte 8",
                         fmt::format("the .npy header has {} bytes, the limit is {}", length, kMaxHeaderBytes));
    }
    std::string text(length, '\0');
    ARS_TRY_STATUS(stream.read(std::as_writable_bytes(std::span(text)), "the .npy header"));
    return text;
}

/// Reverses the bytes of every `unit` bytes.
void swapBytes(std::span<std::byte> bytes, std::size_t unit) {
    for (std::size_t i = 0; i + unit <= bytes.size(); i += unit) std::reverse(&bytes[i], &bytes[i] + unit);
}

template <std::size_t Size>
struct FixedItem {
    std::byte bytes[Size];
};

/// Calls move(to, from) for every element of an array of `shape`: `from` counts in Fortran order, `to` in C order.
template <typename Move>
void fortranToC(const std::vector<std::size_t>& shape, Move&& move) {
    const std::size_t first = shape.front(), last = shape.back();
    const std::span middle(shape.data() + 1, shape.size() - 2);
    std::size_t middleCount = 1;
    for (const std::size_t extent : middle) middleCount *= extent;
    const std::size_t lastStride = first * middleCount;
    std::vector<std::size_t> index(middle.size(), 0);
    for (std::size_t m = 0; m < middleCount; ++m) {
        std::size_t from = 0, stride = first;
        for (std::size_t k = 0; k < middle.size(); stride *= middle[k], ++k) from += index[k] * stride;
        // Square tiles, since one side of the copy always jumps.
        constexpr std::size_t kTile = 32;
        for (std::size_t i0 = 0; i0 < first; i0 += kTile) {
            for (std::size_t j0 = 0; j0 < last; j0 += kTile) {
                for (std::size_t i = i0; i < std::min(first, i0 + kTile); ++i) {
                    for (std::size_t j = j0; j < std::min(last, j0 + kTile); ++j) {
                        move((i * middleCount + m) * last + j, from + i + j * lastStride);
                    }
                }
            }
        }
        for (std::size_t k = middle.size(); k-- > 0 && ++index[k] == middle[k];) index[k] = 0;
    }
}

template <std::size_t Size>
void reorderFixed(const std::vector<std::size_t>& shape, std::span<const std::byte> from, std::span<std::byte> to) {
    const auto* source = reinterpret_cast<const FixedItem<Size>*>(from.data());
    auto* target = reinterpret_cast<FixedItem<Size>*>(to.data());
    fortranToC(shape, [=](std::size_t t, std::size_t f) { target[t] = source[f]; });
}

/// The elements of a Fortran-ordered array in C order.
Result<std::vector<std::byte>> reorder(const NpyHeader& header, std::vector<std::byte> from) {
    ARS_TRY(std::vector<std::byte> to, allocateBytes(from.size(), "a Fortran-ordered array"));
    const std::size_t size = header.itemBytes;
    switch (size) {
    case 1:
        reorderFixed<1>(header.shape, from, to);
        break;
    case 2:
        reorderFixed<2>(header.shape, from, to);
        break;
    case 4:
        reorderFixed<4>(header.shape, from, to);
        break;
    case 8:
        reorderFixed<8>(header.shape, from, to);
        break;
    case 16:
        reorderFixed<16>(header.shape, from, to);
        break;
    default:
        fortranToC(header.shape, [&](std::size_t t, std::size_t f) {
            std::memcpy(to.data() + t * size, from.data() + f * size, size);
        });
    }
    return to;
}

/// One element of a 'U' array: code points in native order, padded with zeros.
Result<std::string> decodeUnicode(std::span<const std::byte> item, std::size_t index) {
    std::string text;
    std::size_t length = item.size() / 4;
    const auto codeAt = [&](std::size_t i) {
        std::uint32_t code = 0;
        std::memcpy(&code, item.data() + 4 * i, 4);
        return code;
    };
    while (length > 0 && codeAt(length - 1) == 0) --length;
    for (std::size_t i = 0; i < length; ++i) {
        const std::uint32_t code = codeAt(i);
        if (code > 0x10FFFF) {
            return makeError(ErrorCode::BadFile, fmt::format("element {}", index),
                             fmt::format("expected a unicode character, found 0x{:x}", code));
        }
        appendUtf8(text, code);
    }
    text.shrink_to_fit();
    return text;
}

std::string decodeByteText(std::span<const std::byte> item) {
    std::string_view text(reinterpret_cast<const char*>(item.data()), item.size());
    while (!text.empty() && text.back() == '\0') text.remove_suffix(1);
    return utf8OrLatin1(text);
}

Status decodeTexts(const NpyHeader& header, std::span<const std::byte> raw, std::vector<std::string>& texts) {
    try {
        texts.reserve(header.count);
        for (std::size_t i = 0; i < header.count; ++i) {
            const auto item = raw.subspan(i * header.itemBytes, header.itemBytes);
            if (header.kind == NpyHeader::Kind::ByteText) {
                texts.push_back(decodeByteText(item));
            } else {
                ARS_TRY(std::string text, decodeUnicode(item, i));
                texts.push_back(std::move(text));
            }
        }
    } catch (const std::exception&) { // bad_alloc
        return makeError(ErrorCode::OutOfMemory, "", fmt::format("no memory for {} texts", header.count));
    }
    return {};
}

std::string typeString(const Array& array, std::size_t textLength) {
    if (array.dtype == DType::Text) return fmt::format("<U{}", textLength);
    const DType stored = array.dtype == DType::BF16 ? DType::F32 : array.dtype;
    for (const NumberType& type : kNumberTypes) {
        if (type.dtype == stored) return fmt::format("{}{}{}", type.bytes == 1 ? '|' : '<', type.kind, type.bytes);
    }
    return {};
}

/// Texts as numpy's fixed-length UTF-32, and the length in characters.
Result<std::size_t> encodeTexts(const Array& array, std::vector<std::byte>& bytes) {
    std::vector<std::u32string> decoded;
    std::size_t longest = 1; // numpy widens empty texts to one character
    for (std::size_t i = 0; i < array.texts.size(); ++i) {
        auto text = decodeUtf8(array.texts[i]);
        if (!text) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("element {}", i), "expected UTF-8 text");
        }
        longest = std::max(longest, text->size());
        decoded.push_back(*std::move(text));
    }
    const std::uint64_t size = saturatingMultiply(4 * longest, decoded.size());
    ARS_TRY(bytes, allocateBytes(size, "texts of equal length"));
    for (std::size_t i = 0; i < decoded.size(); ++i) {
        if (decoded[i].empty()) continue;
        std::memcpy(bytes.data() + 4 * longest * i, decoded[i].data(), 4 * decoded[i].size());
    }
    return longest;
}

std::string headerText(const Array& array, std::size_t textLength) {
    std::string text = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}",
                                   typeString(array, textLength), formatShape(array.shape));
    // Magic, version and length are 10 bytes; the data begin at a multiple of 64.
    text.append(63 - (10 + text.size()) % 64, ' ');
    text += '\n';
    const auto length = static_cast<std::uint16_t>(text.size());
    std::string start(kMagic);
    start += {'\x01', '\x00', static_cast<char>(length & 0xFF), static_cast<char>(length >> 8)};
    return start + text;
}

Result<Array> decodeNpy(const ByteSource& source, const ReadLimits& limits) {
    SourceStream stream(source);
    ARS_TRY(const NpyHeader header, readNpyHeader(stream));
    ARS_TRY_STATUS(checkDecodeLimit(header.decodeBytes(), "the array", limits));
    return readNpyData(header, stream);
}

} // namespace

std::uint64_t NpyHeader::decodeBytes() const {
    const std::uint64_t copies = fortranOrder && shape.size() > 1 ? 2 : 1;
    if (kind == Kind::Number) return saturatingMultiply(dataBytes, copies);
    // The raw characters, and a string each: UTF-8 takes at most four bytes a character, Latin-1 grows to two.
    const std::uint64_t raw = saturatingMultiply(dataBytes, copies + 2);
    return saturatingAdd(raw, saturatingMultiply(count, 2 * sizeof(std::string)));
}

Error notNumpy(std::span<const std::byte> head, std::string_view expected) {
    const std::string_view start(reinterpret_cast<const char*>(head.data()), head.size());
    if (start.size() >= 2 && start[0] == '\x80' && start[1] >= 2 && start[1] <= 5) {
        return makeError(ErrorCode::Unsupported, "", fmt::format("is a Python pickle, {}", kHowToConvert));
    }
    std::string_view found = "something else";
    if (head.empty()) found = "an empty file";
    if (start.starts_with("PK")) found = "a zip file (.npz?)";
    if (start.starts_with("\x93NUMPY")) found = "a single .npy array";
    if (start.starts_with("\x89HDF")) found = "an HDF5 file";
    return makeError(ErrorCode::BadFile, "byte 0", fmt::format("expected a {} file, found {}", expected, found));
}

Status checkDecodeLimit(std::uint64_t bytes, std::string_view what, const ReadLimits& limits) {
    if (bytes <= limits.maxBytes) return {};
    return makeError(ErrorCode::LimitExceeded, "",
                     fmt::format("{} needs {} bytes of memory, the limit is {}", what, bytes, limits.maxBytes));
}

Result<NpyHeader> readNpyHeader(ByteStream& stream) {
    ARS_TRY(const std::string text, readHeaderText(stream));
    NpyHeader header;
    std::string descr;
    HeaderParser parser(text, static_cast<std::size_t>(stream.position()) - text.size());
    ARS_TRY_STATUS(parser.parse(descr, header.fortranOrder, header.shape));
    ARS_TRY_STATUS(parseTypeString(descr, header));
    ARS_TRY(header.count, elementCount(header.shape, header.itemBytes));
    header.dataBytes = static_cast<std::uint64_t>(header.count) * header.itemBytes;
    if (header.dataBytes != stream.remaining()) {
        return makeError(ErrorCode::BadFile, fmt::format("byte {}", stream.position()),
                         fmt::format("expected {} bytes of data for \"{}\" {}, found {}", header.dataBytes, descr,
                                     formatShape(header.shape), stream.remaining()));
    }
    return header;
}

Result<Array> readNpyData(const NpyHeader& header, ByteStream& stream) {
    ARS_TRY(std::vector<std::byte> raw, allocateBytes(header.dataBytes, "an array"));
    ARS_TRY_STATUS(stream.read(raw, "the array's data"));
    ARS_TRY_STATUS(stream.finish());
    const bool complex = header.dtype == DType::C64 || header.dtype == DType::C128;
    const std::size_t unit = header.kind == NpyHeader::Kind::UnicodeText ? 4
                             : header.kind == NpyHeader::Kind::ByteText  ? 1
                             : complex                                   ? header.itemBytes / 2
                                                                         : header.itemBytes;
    if (header.bigEndian && unit > 1) swapBytes(raw, unit);
    if (header.fortranOrder && header.shape.size() > 1 && !raw.empty()) {
        ARS_TRY(raw, reorder(header, std::move(raw)));
    }
    Array array;
    array.dtype = header.dtype;
    array.shape = header.shape;
    if (header.kind != NpyHeader::Kind::Number) {
        ARS_TRY_STATUS(decodeTexts(header, raw, array.texts));
        return array;
    }
    if (header.dtype == DType::Bool) {
        for (std::byte& flag : raw) flag = std::byte{flag != std::byte{0}};
    }
    array.bytes = std::move(raw);
    return array;
}

Result<EncodedNpy> encodeNpyParts(const Array& array) {
    ARS_TRY_STATUS(validateArray(array));
    if (array.shape.size() > kMaxDimensions) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("expected at most {} dimensions, found {}", kMaxDimensions, array.shape.size()));
    }
    EncodedNpy encoded;
    std::size_t textLength = 0;
    if (array.dtype == DType::Text) {
        ARS_TRY(textLength, encodeTexts(array, encoded.converted));
        encoded.payload = encoded.converted;
    } else if (array.dtype == DType::BF16) {
        ARS_TRY(const std::vector<float> values, array.toFloat());
        ARS_TRY(encoded.converted, allocateBytes(4 * values.size(), "widened numbers"));
        if (!values.empty()) std::memcpy(encoded.converted.data(), values.data(), encoded.converted.size());
        encoded.payload = encoded.converted;
    } else {
        encoded.payload = array.bytes;
    }
    encoded.header = headerText(array, textLength);
    return encoded;
}

Result<Array> parseNpy(std::span<const std::byte> file, const ReadLimits& limits) {
    return decodeNpy(MemorySource(file), limits);
}

Result<Array> readNpy(const std::filesystem::path& path, const ReadLimits& limits) {
    auto source = FileSource::open(path, limits);
    if (!source) return atPlace(std::move(source).error(), path.string());
    auto array = decodeNpy(**source, limits);
    if (!array) return atPlace(std::move(array).error(), path.string());
    return array;
}

Result<std::vector<std::byte>> encodeNpy(const Array& array) {
    ARS_TRY(const EncodedNpy encoded, encodeNpyParts(array));
    std::vector<std::byte> file;
    ARS_TRY_STATUS(appendBytes(file, std::as_bytes(std::span(encoded.header))));
    ARS_TRY_STATUS(appendBytes(file, encoded.payload));
    return file;
}

Status writeNpy(const std::filesystem::path& path, const Array& array) {
    auto encoded = encodeNpyParts(array);
    if (!encoded) return atPlace(std::move(encoded).error(), path.string());
    ARS_TRY(AtomicFile file, AtomicFile::open(path));
    ARS_TRY_STATUS(file.write(std::string_view(encoded->header)));
    ARS_TRY_STATUS(file.write(encoded->payload));
    return file.commit();
}

} // namespace ars
