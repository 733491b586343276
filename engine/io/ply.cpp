#include "engine/io/ply.h"

#include "engine/core/file.h"
#include "engine/io/byte_reader.h"
#include "engine/io/image.h"
#include "engine/io/memory_budget.h"
#include "engine/io/text_scanner.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <set>

namespace ars {
namespace {

struct TypeInfo {
    PlyType type;
    std::string_view name;
    std::string_view sizedName;
    std::size_t bytes;
    double lowest;
    double highest;
};

constexpr TypeInfo kTypes[] = {
    {PlyType::I8, "char", "int8", 1, -128.0, 127.0},
    {PlyType::U8, "uchar", "uint8", 1, 0.0, 255.0},
    {PlyType::I16, "short", "int16", 2, -32768.0, 32767.0},
    {PlyType::U16, "ushort", "uint16", 2, 0.0, 65535.0},
    {PlyType::I32, "int", "int32", 4, -2147483648.0, 2147483647.0},
    {PlyType::U32, "uint", "uint32", 4, 0.0, 4294967295.0},
    {PlyType::F32, "float", "float32", 4, 0.0, 0.0},
    {PlyType::F64, "double", "float64", 8, 0.0, 0.0},
};

const TypeInfo& typeInfo(PlyType type) { return kTypes[static_cast<std::size_t>(type)]; }

bool isInteger(PlyType type) { return type != PlyType::F32 && type != PlyType::F64; }

std::optional<PlyType> typeFromName(std::string_view name) {
    for (const TypeInfo& info : kTypes) {
        if (name == info.name || name == info.sizedName) return info.type;
    }
    return std::nullopt;
}

/// Calls body with a value of the C++ type.
template <typename Body>
void withType(PlyType type, Body&& body) {
    switch (type) {
    case PlyType::I8:
        body(std::int8_t{});
        break;
    case PlyType::U8:
        body(std::uint8_t{});
        break;
    case PlyType::I16:
        body(std::int16_t{});
        break;
    case PlyType::U16:
        body(std::uint16_t{});
        break;
    case PlyType::I32:
        body(std::int32_t{});
        break;
    case PlyType::U32:
        body(std::uint32_t{});
        break;
    case PlyType::F32:
        body(float{});
        break;
    case PlyType::F64:
        body(double{});
        break;
    }
}

/// T with its bytes in the other order where the file is big endian.
template <typename T>
T loadValue(const std::byte* source, bool bigEndian) {
    std::byte bytes[sizeof(T)];
    std::memcpy(bytes, source, sizeof(T));
    if (bigEndian) std::reverse(bytes, bytes + sizeof(T));
    return std::bit_cast<T>(bytes);
}

double loadNumber(const std::byte* source, PlyType type, bool bigEndian) {
    double value = 0;
    withType(type, [&](auto zero) { value = static_cast<double>(loadValue<decltype(zero)>(source, bigEndian)); });
    return value;
}

Error bad(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

/// The lines up to end_header.
class HeaderParser {
public:
    HeaderParser(TextScanner& scanner, const ReadLimits& limits) : scanner_(scanner), limits_(limits) {}

    Result<PlyFile> parse() {
        nextLine();
        if (line_ != "ply") return bad(place_, fmt::format("expected the word ply, found {}", quotedFound(line_)));
        for (;;) {
            if (scanner_.atEnd()) return bad(scanner_.place(), "the header ends without end_header");
            nextLine();
            if (line_ == "end_header") break;
            ARS_TRY_STATUS(readLine());
        }
        if (!hasFormat_) return bad(place_, "the header has no format line");
        return std::move(file_);
    }

private:
    void nextLine() {
        place_ = scanner_.place();
        line_ = scanner_.restOfLine();
        words_.clear();
        TextScanner line(line_);
        for (std::string_view word = line.word(); !word.empty() && words_.size() < 6; word = line.word()) {
            words_.push_back(word);
        }
    }
    Error expected(std::string_view what) const {
        return bad(place_, fmt::format("expected {}, found {}", what, line_.empty() ? "\"\"" : quotedFound(line_)));
    }
    Status readLine() {
        if (words_.empty()) return expected("a header line");
        if (words_[0] == "format") return readFormat();
        if (words_[0] == "comment" || words_[0] == "obj_info") {
            TextScanner line(line_);
            line.word();
            file_.comments.emplace_back(line.restOfLine());
            return {};
        }
        if (words_[0] == "element") return readElement();
        if (words_[0] == "property") return readProperty();
        return expected("format, comment, element, property or end_header");
    }
    Status readFormat() {
        if (words_.size() != 3 || words_[2] != "1.0") return expected("\"format ENCODING 1.0\"");
        if (words_[1] == "ascii") {
            file_.format = PlyFormat::Ascii;
        } else if (words_[1] == "binary_little_endian") {
            file_.format = PlyFormat::BinaryLittleEndian;
        } else if (words_[1] == "binary_big_endian") {
            file_.format = PlyFormat::BinaryBigEndian;
        } else {
            return expected("ascii, binary_little_endian or binary_big_endian");
        }
        hasFormat_ = true;
        return {};
    }
    Status readElement() {
        if (words_.size() != 3) return expected("\"element NAME COUNT\"");
        PlyElement element;
        element.name = words_[1];
        const auto count = parseUnsigned(words_[2]);
        if (!count) return expected("an element with a count from 0");
        if (*count > limits_.maxElements) {
            return makeError(
                ErrorCode::LimitExceeded, place_,
                fmt::format("{} elements {}, the limit is {}", *count, quotedFound(element.name), limits_.maxElements));
        }
        if (file_.find(element.name))
            return bad(place_, fmt::format("element {} stands twice", quotedFound(words_[1])));
        element.count = *count;
        file_.elements.push_back(std::move(element));
        names_.clear();
        return {};
    }
    Status readProperty() {
        if (file_.elements.empty()) return bad(place_, "a property before the first element");
        PlyProperty property;
        property.isList = words_.size() > 1 && words_[1] == "list";
        if (words_.size() != (property.isList ? 5u : 3u)) {
            return expected("\"property TYPE NAME\" or \"property list TYPE TYPE NAME\"");
        }
        const auto type = typeFromName(words_[words_.size() - 2]);
        const auto countType = property.isList ? typeFromName(words_[2]) : PlyType::U8;
        if (!type || !countType || !isInteger(*countType)) return expected("a property of known types");
        property.type = *type;
        property.countType = *countType;
        property.name = words_.back();
        if (!names_.insert(property.name).second) {
            return bad(place_, fmt::format("property {} stands twice", quotedFound(property.name)));
        }
        file_.elements.back().properties.push_back(std::move(property));
        return {};
    }

    TextScanner& scanner_;
    const ReadLimits& limits_;
    std::string place_;
    std::string_view line_;
    std::vector<std::string_view> words_;
    std::set<std::string> names_; ///< properties of the current element
    bool hasFormat_ = false;
    PlyFile file_;
};

std::string rowPlace(const PlyElement& element, std::uint64_t row) { return fmt::format("{} {}", element.name, row); }

/// The least that one row takes: in text a digit and a separator per number.
std::uint64_t leastRowBytes(const PlyElement& element, PlyFormat format) {
    std::uint64_t bytes = 0;
    for (const PlyProperty& p : element.properties) {
        bytes += format == PlyFormat::Ascii ? 2 : plyTypeBytes(p.isList ? p.countType : p.type);
    }
    return bytes;
}

Status prepareElement(PlyElement& element, PlyFormat format, std::uint64_t remaining, MemoryBudget& budget) {
    if (element.count == 0) {
        for (PlyProperty& p : element.properties) p.starts.assign(p.isList ? 1 : 0, 0);
        return {};
    }
    if (element.properties.empty()) {
        return bad(fmt::format("element {}", element.name), fmt::format("{} rows without a property", element.count));
    }
    const std::uint64_t row = leastRowBytes(element, format);
    // The last number of a text needs no separator.
    const std::uint64_t slack = format == PlyFormat::Ascii ? 1 : 0;
    if (element.count > (remaining + slack) / row) {
        return bad(
            fmt::format("element {}", element.name),
            fmt::format("expected {} rows of at least {} bytes, the file has {} left", element.count, row, remaining));
    }
    ARS_TRY_STATUS(budget.take(element.count * element.properties.size() * sizeof(double),
                               fmt::format("element {}", element.name)));
    for (PlyProperty& p : element.properties) {
        if (p.isList) {
            p.starts.reserve(element.count + 1);
            p.starts.push_back(0);
        } else {
            p.values.reserve(element.count);
        }
    }
    return {};
}

Status readBinaryList(ByteReader& reader, bool bigEndian, MemoryBudget& budget, const std::string& place,
                      PlyProperty& property) {
    ARS_TRY(const auto countBytes, reader.readBytes(plyTypeBytes(property.countType), property.name));
    const double count = loadNumber(countBytes.data(), property.countType, bigEndian);
    if (count < 0) return bad(place, fmt::format("list {} has {} entries", property.name, count));
    const auto entries = static_cast<std::uint64_t>(count);
    ARS_TRY(const auto bytes, reader.readBytes(entries * plyTypeBytes(property.type), property.name));
    ARS_TRY_STATUS(budget.take(entries * sizeof(double), place));
    withType(property.type, [&](auto zero) {
        using T = decltype(zero);
        for (std::uint64_t i = 0; i < entries; ++i) {
            property.values.push_back(static_cast<double>(loadValue<T>(bytes.data() + i * sizeof(T), bigEndian)));
        }
    });
    property.starts.push_back(property.values.size());
    return {};
}

/// Rows of fixed length: column by column, so that the type is looked at once per column.
Status readFixedRows(ByteReader& reader, bool bigEndian, PlyElement& element) {
    std::size_t rowBytes = 0;
    for (const PlyProperty& p : element.properties) rowBytes += plyTypeBytes(p.type);
    ARS_TRY(const auto bytes, reader.readBytes(element.count * rowBytes, element.name));
    std::size_t offset = 0;
    for (PlyProperty& p : element.properties) {
        p.values.resize(element.count);
        withType(p.type, [&](auto zero) {
            using T = decltype(zero);
            const std::byte* source = bytes.data() + offset;
            for (double& value : p.values) {
                value = static_cast<double>(loadValue<T>(source, bigEndian));
                source += rowBytes;
            }
        });
        offset += plyTypeBytes(p.type);
    }
    return {};
}

Status readBinaryElement(ByteReader& reader, PlyFormat format, MemoryBudget& budget, PlyElement& element) {
    const bool bigEndian = format == PlyFormat::BinaryBigEndian;
    const bool hasLists = std::any_of(element.properties.begin(), element.properties.end(),
                                      [](const PlyProperty& p) { return p.isList; });
    if (!hasLists) return readFixedRows(reader, bigEndian, element);
    for (std::uint64_t row = 0; row < element.count; ++row) {
        for (PlyProperty& p : element.properties) {
            if (p.isList) {
                if (Status status = readBinaryList(reader, bigEndian, budget, rowPlace(element, row), p); !status) {
                    const bool hasPlace = status.error().place == rowPlace(element, row);
                    return hasPlace ? std::move(status) : atPlace(std::move(status).error(), rowPlace(element, row));
                }
            } else {
                auto bytes = reader.readBytes(plyTypeBytes(p.type), p.name);
                if (!bytes) return atPlace(std::move(bytes).error(), rowPlace(element, row));
                p.values.push_back(loadNumber(bytes->data(), p.type, bigEndian));
            }
        }
    }
    return {};
}

/// A value of a property's type in text form.
Result<double> readTextNumber(TextScanner& scanner, const PlyElement& element, std::uint64_t row,
                              std::string_view property, PlyType type) {
    const std::string_view word = scanner.word();
    const auto number = parseDouble(word);
    const TypeInfo& info = typeInfo(type);
    const bool fits = number && (!isInteger(type) ||
                                 (*number >= info.lowest && *number <= info.highest && *number == std::floor(*number)));
    if (fits) return type == PlyType::F32 ? static_cast<double>(parseFloat(word).value_or(0.0f)) : *number;
    return bad(rowPlace(element, row), fmt::format("{}: expected {} for {}, found {}", scanner.place(), info.name,
                                                   property, quotedFound(word)));
}

Status readTextElement(TextScanner& scanner, MemoryBudget& budget, PlyElement& element) {
    for (std::uint64_t row = 0; row < element.count; ++row) {
        for (PlyProperty& p : element.properties) {
            std::uint64_t entries = 1;
            if (p.isList) {
                ARS_TRY(const double count, readTextNumber(scanner, element, row, p.name, p.countType));
                if (count < 0 || count > static_cast<double>(scanner.remaining())) {
                    return bad(rowPlace(element, row), fmt::format("list {} has {} entries, the file has {} bytes left",
                                                                   p.name, count, scanner.remaining()));
                }
                entries = static_cast<std::uint64_t>(count);
                ARS_TRY_STATUS(budget.take(entries * sizeof(double), rowPlace(element, row)));
            }
            for (std::uint64_t i = 0; i < entries; ++i) {
                ARS_TRY(const double value, readTextNumber(scanner, element, row, p.name, p.type));
                p.values.push_back(value);
            }
            if (p.isList) p.starts.push_back(p.values.size());
        }
    }
    return {};
}

Error invalid(std::string place, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(place), std::move(message));
}

bool isWord(std::string_view text) {
    return !text.empty() && text.find_first_of(" \t\r\n\v\f") == std::string_view::npos;
}

Status checkProperty(const PlyElement& element, const PlyProperty& property) {
    const std::string place = fmt::format("element {}, property {}", element.name, property.name);
    if (!isWord(element.name) || !isWord(property.name)) return invalid(place, "a name must be one word");
    if (property.isList) {
        const auto& starts = property.starts;
        if (starts.size() != element.count + 1 || starts.front() != 0 || starts.back() != property.values.size() ||
            !std::is_sorted(starts.begin(), starts.end())) {
            return invalid(place, fmt::format("the starts of {} lists do not fit {} values", element.count,
                                              property.values.size()));
        }
        for (std::size_t i = 0; i < element.count; ++i) {
            const std::size_t entries = property.list(i).size();
            if (isInteger(property.countType) && static_cast<double>(entries) <= typeInfo(property.countType).highest)
                continue;
            return invalid(place, fmt::format("list {} has {} entries, too many for {}", i, entries,
                                              plyTypeName(property.countType)));
        }
    } else if (property.values.size() != element.count) {
        return invalid(place, fmt::format("{} values for {} rows", property.values.size(), element.count));
    }
    if (!isInteger(property.type)) return {};
    for (const double value : property.values) {
        const TypeInfo& info = typeInfo(property.type);
        if (value >= info.lowest && value <= info.highest && value == std::floor(value)) continue;
        return invalid(place, fmt::format("{} does not fit {}", value, info.name));
    }
    return {};
}

std::string formatHeader(const PlyFile& file) {
    std::string text = "ply\nformat ";
    text += file.format == PlyFormat::Ascii             ? "ascii"
            : file.format == PlyFormat::BinaryBigEndian ? "binary_big_endian"
                                                        : "binary_little_endian";
    text += " 1.0\n";
    const auto out = std::back_inserter(text);
    for (const std::string& comment : file.comments) fmt::format_to(out, "comment {}\n", comment);
    for (const PlyElement& element : file.elements) {
        fmt::format_to(out, "element {} {}\n", element.name, element.count);
        for (const PlyProperty& p : element.properties) {
            if (p.isList) {
                fmt::format_to(out, "property list {} {} {}\n", plyTypeName(p.countType), plyTypeName(p.type), p.name);
            } else {
                fmt::format_to(out, "property {} {}\n", plyTypeName(p.type), p.name);
            }
        }
    }
    return text + "end_header\n";
}

class BodyWriter {
public:
    BodyWriter(PlyFormat format, std::string header) : format_(format), bytes_(std::move(header)) {}

    void writeElement(const PlyElement& element) {
        for (std::size_t row = 0; row < element.count; ++row) {
            bool first = true;
            for (const PlyProperty& p : element.properties) {
                if (!p.isList) {
                    writeNumber(p.type, p.values[row], first);
                    continue;
                }
                const std::span<const double> list = p.list(row);
                writeNumber(p.countType, static_cast<double>(list.size()), first);
                for (const double value : list) writeNumber(p.type, value, first);
            }
            if (format_ == PlyFormat::Ascii) bytes_ += '\n';
        }
    }
    std::vector<std::byte> take() {
        const auto* data = reinterpret_cast<const std::byte*>(bytes_.data());
        return {data, data + bytes_.size()};
    }

private:
    void writeNumber(PlyType type, double value, bool& first) {
        withType(type, [&](auto zero) {
            using T = decltype(zero);
            const T number = static_cast<T>(value);
            if (format_ == PlyFormat::Ascii) {
                // "+number" prints a char type as a number.
                fmt::format_to(std::back_inserter(bytes_), "{}{}", first ? "" : " ", +number);
                first = false;
                return;
            }
            char raw[sizeof(T)];
            std::memcpy(raw, &number, sizeof(T));
            if (format_ == PlyFormat::BinaryBigEndian) std::reverse(raw, raw + sizeof(T));
            bytes_.append(raw, sizeof(T));
        });
    }

    PlyFormat format_;
    std::string bytes_;
};

/// The first of several names that the element has as a scalar property.
const PlyProperty* findAny(const PlyElement& element, std::initializer_list<std::string_view> names) {
    for (const std::string_view name : names) {
        const PlyProperty* found = element.find(name);
        if (found && !found->isList) return found;
    }
    return nullptr;
}

/// Columns side by side as vectors; left empty unless all are there.
template <typename Vector>
Status readVectors(const PlyElement& element, std::array<const PlyProperty*, Vector::length()> columns,
                   std::vector<Vector>& vectors) {
    for (const PlyProperty* column : columns) {
        if (!column) return {};
    }
    vectors.resize(element.count);
    for (int k = 0; k < Vector::length(); ++k) {
        ARS_TRY(const std::vector<float> values, element.column(columns[static_cast<std::size_t>(k)]->name));
        for (std::size_t i = 0; i < values.size(); ++i) vectors[i][k] = values[i];
    }
    return {};
}

Status readColors(const PlyElement& element, std::vector<glm::vec4>& colors) {
    const std::array<const PlyProperty*, 3> channels = {
        findAny(element, {"red", "r"}), findAny(element, {"green", "g"}), findAny(element, {"blue", "b"})};
    std::vector<glm::vec3> rgb;
    ARS_TRY_STATUS(readVectors(element, channels, rgb));
    if (rgb.empty()) return {};
    std::vector<float> alphas(rgb.size(), 1.0f);
    if (const PlyProperty* alpha = findAny(element, {"alpha", "a"})) {
        ARS_TRY(alphas, element.column(alpha->name));
        const double scale = isInteger(alpha->type) ? typeInfo(alpha->type).highest : 1.0;
        for (float& value : alphas) value = static_cast<float>(value / scale);
    }
    colors.resize(rgb.size());
    for (std::size_t i = 0; i < rgb.size(); ++i) {
        colors[i].w = alphas[i];
        for (int k = 0; k < 3; ++k) {
            const PlyType type = channels[static_cast<std::size_t>(k)]->type;
            colors[i][k] =
                isInteger(type) ? srgbToLinear(static_cast<float>(rgb[i][k] / typeInfo(type).highest)) : rgb[i][k];
        }
    }
    return {};
}

Status readVertices(const PlyElement& element, TriangleMesh& mesh) {
    for (const char* name : {"x", "y", "z"}) {
        // Says which one is missing.
        if (!findAny(element, {name})) return Status(element.column(name).error());
    }
    ARS_TRY_STATUS(readVectors(element, {element.find("x"), element.find("y"), element.find("z")}, mesh.positions));
    ARS_TRY_STATUS(readVectors(element, {findAny(element, {"nx"}), findAny(element, {"ny"}), findAny(element, {"nz"})},
                               mesh.normals));
    ARS_TRY_STATUS(readVectors(
        element, {findAny(element, {"s", "u", "texture_u"}), findAny(element, {"t", "v", "texture_v"})}, mesh.uvs));
    for (glm::vec2& uv : mesh.uvs) uv.y = 1.0f - uv.y;
    return readColors(element, mesh.colors);
}

Status readFaces(const PlyElement& element, TriangleMesh& mesh) {
    const PlyProperty* indices = element.find("vertex_indices");
    if (!indices) indices = element.find("vertex_index");
    if (!indices || !indices->isList) return bad("element face", "expected a list vertex_indices, found none");
    for (std::size_t face = 0; face < element.count; ++face) {
        const std::span<const double> corners = indices->list(face);
        for (const double corner : corners) {
            if (corner >= 0 && corner < static_cast<double>(mesh.positions.size()) && corner == std::floor(corner))
                continue;
            return bad(rowPlace(element, face),
                       fmt::format("names vertex {}, the file has {}", corner, mesh.positions.size()));
        }
        for (std::size_t i = 2; i < corners.size(); ++i) {
            mesh.triangles.emplace_back(static_cast<std::uint32_t>(corners[0]),
                                        static_cast<std::uint32_t>(corners[i - 1]),
                                        static_cast<std::uint32_t>(corners[i]));
        }
    }
    return {};
}

PlyProperty scalarProperty(std::string name, PlyType type, std::size_t count) {
    PlyProperty property;
    property.name = std::move(name);
    property.type = type;
    property.values.resize(count);
    return property;
}

template <typename Vector>
void appendColumns(PlyElement& element, std::initializer_list<const char*> names, const std::vector<Vector>& rows) {
    int axis = 0;
    for (const char* name : names) {
        PlyProperty property = scalarProperty(name, PlyType::F32, rows.size());
        for (std::size_t i = 0; i < rows.size(); ++i) property.values[i] = static_cast<double>(rows[i][axis]);
        element.properties.push_back(std::move(property));
        ++axis;
    }
}

/// [0,1] as a byte; anything else is clamped.
double byteValue(float value) {
    return std::isfinite(value) ? std::floor(std::clamp(static_cast<double>(value), 0.0, 1.0) * 255.0 + 0.5) : 0.0;
}

} // namespace

std::size_t plyTypeBytes(PlyType type) { return typeInfo(type).bytes; }
std::string_view plyTypeName(PlyType type) { return typeInfo(type).name; }

const PlyProperty* PlyElement::find(std::string_view property) const {
    for (const PlyProperty& p : properties) {
        if (p.name == property) return &p;
    }
    return nullptr;
}

Result<std::vector<float>> PlyElement::column(std::string_view property) const {
    const PlyProperty* const found = find(property);
    if (!found) {
        std::string names;
        for (const PlyProperty& p : properties) names += (names.empty() ? "" : " ") + p.name;
        return makeError(ErrorCode::NotFound, fmt::format("element {}", name),
                         fmt::format("no property {}, it has: {}", quotedFound(property), names));
    }
    if (found->isList) {
        return bad(fmt::format("element {}", name),
                   fmt::format("property {} is a list, expected one number", property));
    }
    std::vector<float> column(found->values.size());
    for (std::size_t i = 0; i < column.size(); ++i) {
        // A double beyond the range of float has no defined conversion.
        if (!(std::abs(found->values[i]) <= std::numeric_limits<float>::max())) {
            return bad(rowPlace(*this, i),
                       fmt::format("{} is {}, expected a finite number", property, found->values[i]));
        }
        column[i] = static_cast<float>(found->values[i]);
    }
    return column;
}

const PlyElement* PlyFile::find(std::string_view element) const {
    for (const PlyElement& e : elements) {
        if (e.name == element) return &e;
    }
    return nullptr;
}

Result<PlyFile> parsePly(std::span<const std::byte> bytes, const ReadLimits& limits) {
    TextScanner scanner(bytes);
    ARS_TRY(PlyFile file, HeaderParser(scanner, limits).parse());
    ByteReader reader(bytes);
    ARS_TRY_STATUS(reader.seek(scanner.position(), "the first element"));
    MemoryBudget budget(limits);
    for (PlyElement& element : file.elements) {
        const bool text = file.format == PlyFormat::Ascii;
        ARS_TRY_STATUS(prepareElement(element, file.format, text ? scanner.remaining() : reader.remaining(), budget));
        if (element.count == 0) continue;
        ARS_TRY_STATUS(text ? readTextElement(scanner, budget, element)
                            : readBinaryElement(reader, file.format, budget, element));
    }
    if (file.format == PlyFormat::Ascii) {
        // Numbers left over are the sign of a count that lies; binary files may be padded.
        if (const std::string_view word = scanner.word(); !word.empty()) {
            return bad(scanner.place(), fmt::format("expected the end of the file, found {}", quotedFound(word)));
        }
    }
    return file;
}

Result<PlyFile> readPly(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    Result<PlyFile> file = parsePly(bytes, limits);
    if (!file) return atPlace(std::move(file).error(), path.string());
    return file;
}

Result<std::vector<std::byte>> encodePly(const PlyFile& file) {
    for (const PlyElement& element : file.elements) {
        for (const PlyProperty& property : element.properties) ARS_TRY_STATUS(checkProperty(element, property));
        if (element.properties.empty() && element.count > 0) {
            return invalid(fmt::format("element {}", element.name), "rows without a property");
        }
    }
    for (const std::string& comment : file.comments) {
        if (comment.find_first_of("\r\n") != std::string::npos) return invalid("", "a comment with a line end");
    }
    BodyWriter writer(file.format, formatHeader(file));
    for (const PlyElement& element : file.elements) writer.writeElement(element);
    return writer.take();
}

Status writePly(const std::filesystem::path& path, const PlyFile& file) {
    Result<std::vector<std::byte>> bytes = encodePly(file);
    if (!bytes) return atPlace(std::move(bytes).error(), path.string());
    return writeFileAtomic(path, *bytes);
}

PlyElement plyColumns(std::string elementName,
                      const std::vector<std::pair<std::string, std::span<const float>>>& columns) {
    PlyElement element;
    element.name = std::move(elementName);
    element.count = columns.empty() ? 0 : columns.front().second.size();
    for (const auto& [name, values] : columns) {
        PlyProperty property = scalarProperty(name, PlyType::F32, 0);
        property.values.assign(values.begin(), values.end());
        element.properties.push_back(std::move(property));
    }
    return element;
}

Result<TriangleMesh> meshFromPly(const PlyFile& file) {
    const PlyElement* const vertices = file.find("vertex");
    if (!vertices) return bad("", "no element vertex, so this is no mesh");
    TriangleMesh mesh;
    ARS_TRY_STATUS(readVertices(*vertices, mesh));
    if (const PlyElement* const faces = file.find("face")) {
        ARS_TRY_STATUS(readFaces(*faces, mesh));
    } else if (file.find("tristrips")) {
        return makeError(ErrorCode::Unsupported, "element tristrips",
                         "triangle strips are not read; save the mesh with faces");
    }
    return mesh;
}

Result<TriangleMesh> readPlyMesh(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const PlyFile file, readPly(path, limits));
    Result<TriangleMesh> mesh = meshFromPly(file);
    if (!mesh) return atPlace(std::move(mesh).error(), path.string());
    return mesh;
}

PlyFile plyFromMesh(const TriangleMesh& mesh, PlyFormat format) {
    PlyFile file;
    file.format = format;
    PlyElement vertices;
    vertices.name = "vertex";
    vertices.count = mesh.positions.size();
    appendColumns(vertices, {"x", "y", "z"}, mesh.positions);
    if (!mesh.normals.empty()) appendColumns(vertices, {"nx", "ny", "nz"}, mesh.normals);
    if (!mesh.uvs.empty()) {
        appendColumns(vertices, {"s", "t"}, mesh.uvs);
        for (double& t : vertices.properties.back().values) t = static_cast<double>(static_cast<float>(1.0 - t));
    }
    if (!mesh.colors.empty()) {
        const char* const names[] = {"red", "green", "blue", "alpha"};
        for (int k = 0; k < 4; ++k) {
            PlyProperty property = scalarProperty(names[k], PlyType::U8, mesh.colors.size());
            for (std::size_t i = 0; i < mesh.colors.size(); ++i) {
                property.values[i] = byteValue(k == 3 ? mesh.colors[i][k] : linearToSrgb(mesh.colors[i][k]));
            }
            vertices.properties.push_back(std::move(property));
        }
    }
    file.elements.push_back(std::move(vertices));
    if (mesh.triangles.empty()) return file;

    PlyElement faces;
    faces.name = "face";
    faces.count = mesh.triangles.size();
    PlyProperty indices = scalarProperty("vertex_indices", PlyType::I32, 0);
    indices.isList = true;
    indices.values.reserve(3 * mesh.triangles.size());
    indices.starts.reserve(mesh.triangles.size() + 1);
    for (const glm::uvec3& t : mesh.triangles) {
        indices.starts.push_back(indices.values.size());
        for (int k = 0; k < 3; ++k) indices.values.push_back(static_cast<double>(t[k]));
    }
    indices.starts.push_back(indices.values.size());
    faces.properties.push_back(std::move(indices));
    file.elements.push_back(std::move(faces));
    return file;
}

Status writePlyMesh(const std::filesystem::path& path, const TriangleMesh& mesh, PlyFormat format) {
    if (Status status = validateMesh(mesh); !status) return atPlace(std::move(status).error(), path.string());
    return writePly(path, plyFromMesh(mesh, format));
}

} // namespace ars
