#include "engine/io/obj.h"

#include "engine/core/file.h"
#include "engine/io/image.h"
#include "engine/io/text_scanner.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <unordered_map>

namespace ars {
namespace {

// Statements of the format that say nothing about a triangle mesh.
constexpr std::string_view kSkipped[] = {
    "s",      "l",      "p",        "vp",       "deg",  "bmat",  "step",  "cstype",     "curv",
    "curv2",  "surf",   "parm",     "trim",     "hole", "scrv",  "sp",    "end",        "con",
    "mg",     "bevel",  "c_interp", "d_interp", "lod",  "ctech", "stech", "shadow_obj", "trace_obj",
    "maplib", "usemap", "call",     "csh",      "bsp",  "bzp",   "cdc",   "cdp",        "res"};

/// Zero-based indices of one corner; -1 where the file gives none.
struct Corner {
    std::int64_t position = -1;
    std::int64_t uv = -1;
    std::int64_t normal = -1;

    bool operator==(const Corner&) const = default;
};

struct CornerHash {
    std::size_t operator()(const Corner& c) const {
        std::uint64_t hash = static_cast<std::uint64_t>(c.position) * 0x9e3779b97f4a7c15ull;
        hash = (hash ^ (hash >> 29) ^ static_cast<std::uint64_t>(c.uv)) * 0xbf58476d1ce4e5b9ull;
        hash = (hash ^ (hash >> 32) ^ static_cast<std::uint64_t>(c.normal)) * 0x94d049bb133111ebull;
        return static_cast<std::size_t>(hash ^ (hash >> 31));
    }
};

/// A corner and the line of its face, for messages about indices that turn out not to exist.
struct FaceCorner {
    Corner corner;
    std::size_t line = 0;
};

/// Splits lines into words and joins lines that end with "\".
class ObjParser {
public:
    ObjParser(std::span<const std::byte> bytes, const ReadLimits& limits) : scanner_(bytes), limits_(limits) {}

    Result<ObjFile> parse() {
        while (!scanner_.atEnd()) {
            ARS_TRY_STATUS(readStatement());
            ARS_TRY_STATUS(checkLimits());
        }
        if (positions_.empty()) return makeError(ErrorCode::BadFile, "", "no vertex (\"v\" line) in the whole file");
        closeGroup();
        return build();
    }

private:
    Error bad(std::string message) const { return makeError(ErrorCode::BadFile, place_, std::move(message)); }

    /// Words of the next statement; `text` is everything behind the first.
    void readWords() {
        scanner_.skipSpace();
        place_ = scanner_.place();
        line_ = scanner_.line();
        words_.clear();
        statement_ = scanner_.restOfLine();
        // Joining copies; only statements that really go on in another line pay for it.
        if (!statement_.empty() && statement_.back() == '\\') {
            joined_.clear();
            while (!statement_.empty() && statement_.back() == '\\') {
                joined_.append(statement_.substr(0, statement_.size() - 1)).push_back(' ');
                statement_ = scanner_.restOfLine();
            }
            joined_.append(statement_);
            statement_ = joined_;
        }
        if (const std::size_t comment = statement_.find('#'); comment != std::string_view::npos && !isNamed()) {
            statement_ = statement_.substr(0, comment);
        }
        TextScanner line(statement_);
        for (std::string_view word = line.word(); !word.empty(); word = line.word()) words_.push_back(word);
    }
    /// Names may hold a '#'.
    bool isNamed() const {
        return statement_.starts_with("usemtl") || statement_.starts_with("mtllib") || statement_.starts_with("o ") ||
               statement_.starts_with("g ");
    }
    std::string nameAfterKeyword() const {
        TextScanner line(statement_);
        line.word();
        return std::string(line.restOfLine());
    }

    Status readStatement() {
        readWords();
        if (words_.empty()) return {};
        const std::string_view keyword = words_[0];
        if (keyword == "v") return readVertex();
        if (keyword == "vt") return readUv();
        if (keyword == "vn") return readNormal();
        if (keyword == "f" || keyword == "fo") return readFace();
        if (keyword == "o" || keyword == "g") {
            closeGroup();
            groupName_ = nameAfterKeyword();
            if (keyword == "o" && file_.mesh.name.empty()) file_.mesh.name = groupName_;
            return {};
        }
        if (keyword == "usemtl") return readMaterial();
        if (keyword == "mtllib") {
            file_.materialLibraries.push_back(nameAfterKeyword());
            return {};
        }
        if (std::find(std::begin(kSkipped), std::end(kSkipped), keyword) != std::end(kSkipped)) return {};
        return bad(fmt::format("expected a statement such as v, vt, vn or f, found {}", quotedFound(keyword)));
    }
    Status checkLimits() const {
        const std::size_t most = std::max({positions_.size(), uvs_.size(), normals_.size(), corners_.size() / 3});
        if (most <= limits_.maxElements && corners_.size() * sizeof(FaceCorner) <= limits_.maxBytes) return {};
        return makeError(ErrorCode::LimitExceeded, place_,
                         fmt::format("{} vertices or triangles, the limit is {} and {} bytes", most,
                                     limits_.maxElements, limits_.maxBytes));
    }

    /// All words behind the keyword as finite numbers.
    Status readNumbers(std::string_view what, std::size_t least, std::size_t most) {
        const std::size_t count = words_.size() - 1;
        if (count < least || count > most) {
            const std::string range = least == most ? fmt::format("{}", least) : fmt::format("{} to {}", least, most);
            return bad(fmt::format("expected {} numbers for {}, found {}", range, what, count));
        }
        for (std::size_t i = 0; i < count; ++i) {
            const auto number = parseFloat(words_[i + 1]);
            if (!number || !std::isfinite(*number)) {
                return bad(fmt::format("expected a finite number for {}, found {}", what, quotedFound(words_[i + 1])));
            }
            numbers_[i] = *number;
        }
        return {};
    }
    Status readVertex() {
        ARS_TRY_STATUS(readNumbers("a vertex", 3, 7));
        const std::size_t count = words_.size() - 1;
        if (count == 5) return bad("expected 3, 4, 6 or 7 numbers for a vertex, found 5");
        positions_.emplace_back(numbers_[0], numbers_[1], numbers_[2]);
        if (count < 6) return {};
        const glm::vec4 color(srgbToLinear(numbers_[3]), srgbToLinear(numbers_[4]), srgbToLinear(numbers_[5]),
                              count == 7 ? numbers_[6] : 1.0f);
        for (int k = 0; k < 3; ++k) {
            // The transfer function grows with a power of 2.4.
            if (!std::isfinite(color[k]))
                return bad(fmt::format("a colour of {} is too large", numbers_[3 + static_cast<std::size_t>(k)]));
        }
        colors_.resize(positions_.size() - 1, glm::vec4(1.0f));
        colors_.push_back(color);
        return {};
    }
    Status readUv() {
        ARS_TRY_STATUS(readNumbers("a texture coordinate", 1, 3));
        uvs_.emplace_back(numbers_[0], 1.0f - (words_.size() > 2 ? numbers_[1] : 0.0f));
        return {};
    }
    Status readNormal() {
        ARS_TRY_STATUS(readNumbers("a normal", 3, 3));
        normals_.emplace_back(numbers_[0], numbers_[1], numbers_[2]);
        return {};
    }
    Status readMaterial() {
        const std::string name = nameAfterKeyword();
        const auto [entry, isNew] = materialIndex_.try_emplace(name, static_cast<int>(materialIndex_.size()));
        if (isNew) file_.mesh.materialNames.push_back(name);
        material_ = entry->second;
        return {};
    }

    /// "12" or "-1" as a zero-based index; whether it exists is known at the end.
    Status readIndex(std::string_view text, std::size_t count, std::int64_t& index) const {
        const auto number = parseInt(text);
        if (!number || *number == 0) {
            return bad(fmt::format("expected an index from 1, or below 0, in a face, found {}", quotedFound(text)));
        }
        index = *number > 0 ? *number - 1 : static_cast<std::int64_t>(count) + *number;
        if (index < 0) {
            return bad(fmt::format("index {} of a face reaches before the first of {} so far", *number, count));
        }
        return {};
    }
    Status readCorner(std::string_view word, Corner& corner) const {
        const std::size_t slash = word.find('/');
        ARS_TRY_STATUS(readIndex(word.substr(0, slash), positions_.size(), corner.position));
        if (slash == std::string_view::npos) return {};
        const std::string_view rest = word.substr(slash + 1);
        const std::size_t second = rest.find('/');
        const std::string_view uv = rest.substr(0, second);
        if (!uv.empty()) ARS_TRY_STATUS(readIndex(uv, uvs_.size(), corner.uv));
        if (second == std::string_view::npos) return {};
        const std::string_view normal = rest.substr(second + 1);
        if (!normal.empty()) ARS_TRY_STATUS(readIndex(normal, normals_.size(), corner.normal));
        return {};
    }
    Status readFace() {
        if (words_.size() < 4) {
            return bad(fmt::format("expected a face of at least 3 corners, found {}", words_.size() - 1));
        }
        std::array<Corner, 3> triangle; // first, previous, this
        for (std::size_t i = 1; i < words_.size(); ++i) {
            Corner corner;
            ARS_TRY_STATUS(readCorner(words_[i], corner));
            if (i == 1) triangle[0] = corner;
            triangle[1] = triangle[2];
            triangle[2] = corner;
            if (i < 3) continue;
            for (const Corner& c : triangle) corners_.push_back({c, line_});
            triangleMaterials_.push_back(material_);
        }
        return {};
    }
    void closeGroup() {
        const std::size_t triangles = corners_.size() / 3;
        const std::size_t first =
            file_.groups.empty() ? 0 : file_.groups.back().firstTriangle + file_.groups.back().triangleCount;
        if (triangles > first) file_.groups.push_back({groupName_, first, triangles - first});
    }

    Status checkCorner(const FaceCorner& c) const {
        const auto check = [&](std::int64_t index, std::size_t count, std::string_view what) -> Status {
            if (index < static_cast<std::int64_t>(count)) return {};
            return makeError(ErrorCode::BadFile, fmt::format("line {}", c.line),
                             fmt::format("a face names {} {}, the file has {}", what, index + 1, count));
        };
        ARS_TRY_STATUS(check(c.corner.position, positions_.size(), "vertex"));
        ARS_TRY_STATUS(check(c.corner.uv, uvs_.size(), "texture coordinate"));
        return check(c.corner.normal, normals_.size(), "normal");
    }
    /// The first use of a "v" line keeps that line's place; other combinations are appended.
    std::uint32_t vertexOf(const Corner& corner) {
        const auto v = static_cast<std::size_t>(corner.position);
        if (firstUse_[v].position < 0) {
            firstUse_[v] = corner;
            setAttributes(v, corner);
            return static_cast<std::uint32_t>(v);
        }
        if (firstUse_[v] == corner) return static_cast<std::uint32_t>(v);
        TriangleMesh& mesh = file_.mesh;
        const auto [entry, isNew] = splits_.try_emplace(corner, static_cast<std::uint32_t>(mesh.positions.size()));
        if (isNew) {
            mesh.positions.push_back(mesh.positions[v]);
            mesh.sourceVertices.push_back(static_cast<std::int32_t>(v));
            if (!mesh.colors.empty()) mesh.colors.push_back(mesh.colors[v]);
            if (!mesh.uvs.empty()) mesh.uvs.emplace_back(0.0f);
            if (!mesh.normals.empty()) mesh.normals.emplace_back(0.0f);
            setAttributes(entry->second, corner);
        }
        return entry->second;
    }
    void setAttributes(std::size_t vertex, const Corner& corner) {
        if (corner.uv >= 0) file_.mesh.uvs[vertex] = uvs_[static_cast<std::size_t>(corner.uv)];
        if (corner.normal >= 0) file_.mesh.normals[vertex] = normals_[static_cast<std::size_t>(corner.normal)];
    }
    Result<ObjFile> build() {
        TriangleMesh& mesh = file_.mesh;
        file_.sourceVertexCount = positions_.size();
        bool hasUvs = false, hasNormals = false;
        for (const FaceCorner& c : corners_) {
            ARS_TRY_STATUS(checkCorner(c));
            hasUvs = hasUvs || c.corner.uv >= 0;
            hasNormals = hasNormals || c.corner.normal >= 0;
        }
        firstUse_.resize(positions_.size());
        if (hasUvs) mesh.uvs.resize(positions_.size(), glm::vec2(0.0f));
        if (hasNormals) mesh.normals.resize(positions_.size(), glm::vec3(0.0f));
        if (!colors_.empty()) colors_.resize(positions_.size(), glm::vec4(1.0f));
        mesh.colors = std::move(colors_);
        mesh.sourceVertices.resize(positions_.size());
        for (std::size_t i = 0; i < positions_.size(); ++i) mesh.sourceVertices[i] = static_cast<std::int32_t>(i);
        mesh.positions = std::move(positions_);
        mesh.triangles.reserve(corners_.size() / 3);
        for (std::size_t i = 0; i + 2 < corners_.size(); i += 3) {
            glm::uvec3 triangle;
            for (int k = 0; k < 3; ++k) triangle[k] = vertexOf(corners_[i + static_cast<std::size_t>(k)].corner);
            mesh.triangles.push_back(triangle);
        }
        if (!mesh.materialNames.empty()) mesh.materials = std::move(triangleMaterials_);
        return std::move(file_);
    }

    TextScanner scanner_;
    const ReadLimits& limits_;
    std::string place_;
    std::size_t line_ = 0;
    std::string_view statement_;
    std::string joined_;
    std::vector<std::string_view> words_;
    std::array<float, 7> numbers_{};

    std::vector<glm::vec3> positions_;
    std::vector<glm::vec4> colors_;
    std::vector<glm::vec2> uvs_;
    std::vector<glm::vec3> normals_;
    std::vector<FaceCorner> corners_;
    std::vector<std::int32_t> triangleMaterials_;
    std::int32_t material_ = -1;
    std::unordered_map<std::string, int> materialIndex_;
    std::string groupName_;

    std::vector<Corner> firstUse_;
    std::unordered_map<Corner, std::uint32_t, CornerHash> splits_;
    ObjFile file_;
};

void appendFaces(std::string& text, const TriangleMesh& mesh) {
    std::int32_t material = -1;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        if (!mesh.materials.empty() && mesh.materials[i] != material) {
            material = mesh.materials[i];
            const bool named = material >= 0 && static_cast<std::size_t>(material) < mesh.materialNames.size();
            fmt::format_to(std::back_inserter(text), "usemtl {}\n",
                           named ? mesh.materialNames[static_cast<std::size_t>(material)]
                                 : fmt::format("material_{}", material));
        }
        text += 'f';
        for (int k = 0; k < 3; ++k) {
            const std::uint32_t index = mesh.triangles[i][k] + 1;
            if (!mesh.uvs.empty() && !mesh.normals.empty()) {
                fmt::format_to(std::back_inserter(text), " {0}/{0}/{0}", index);
            } else if (!mesh.uvs.empty()) {
                fmt::format_to(std::back_inserter(text), " {0}/{0}", index);
            } else if (!mesh.normals.empty()) {
                fmt::format_to(std::back_inserter(text), " {0}//{0}", index);
            } else {
                fmt::format_to(std::back_inserter(text), " {}", index);
            }
        }
        text += '\n';
    }
}

} // namespace

Result<ObjFile> parseObj(std::span<const std::byte> bytes, const ReadLimits& limits) {
    return ObjParser(bytes, limits).parse();
}

Result<ObjFile> readObj(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    Result<ObjFile> file = parseObj(bytes, limits);
    if (!file) return atPlace(std::move(file).error(), path.string());
    return file;
}

Result<std::string> formatObj(const TriangleMesh& mesh, const std::string& materialLibrary) {
    ARS_TRY_STATUS(validateMesh(mesh));
    // A backslash at the end of a line goes on in the next one.
    const auto breaksTheLine = [](const std::string& name) {
        const std::size_t last = name.find_last_not_of(" \t\v\f");
        return name.find_first_of("\r\n") != std::string::npos || (last != std::string::npos && name[last] == '\\');
    };
    if (breaksTheLine(mesh.name) || breaksTheLine(materialLibrary) ||
        std::any_of(mesh.materialNames.begin(), mesh.materialNames.end(), breaksTheLine)) {
        return makeError(
            ErrorCode::InvalidArgument, "",
            "a mesh or material name with a line end, or a backslash at its end, cannot stand in an OBJ file");
    }
    std::string text;
    const auto out = std::back_inserter(text);
    if (!materialLibrary.empty()) fmt::format_to(out, "mtllib {}\n", materialLibrary);
    if (!mesh.name.empty()) fmt::format_to(out, "o {}\n", mesh.name);
    for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
        const glm::vec3& p = mesh.positions[i];
        fmt::format_to(out, "v {} {} {}", p.x, p.y, p.z);
        if (!mesh.colors.empty()) {
            const glm::vec4& c = mesh.colors[i];
            fmt::format_to(out, " {} {} {}", linearToSrgb(c.x), linearToSrgb(c.y), linearToSrgb(c.z));
        }
        text += '\n';
    }
    for (const glm::vec2& uv : mesh.uvs) fmt::format_to(out, "vt {} {}\n", uv.x, 1.0f - uv.y);
    for (const glm::vec3& n : mesh.normals) fmt::format_to(out, "vn {} {} {}\n", n.x, n.y, n.z);
    appendFaces(text, mesh);
    return text;
}

Status writeObj(const std::filesystem::path& path, const TriangleMesh& mesh, const std::string& materialLibrary) {
    Result<std::string> text = formatObj(mesh, materialLibrary);
    if (!text) return atPlace(std::move(text).error(), path.string());
    return writeFileAtomic(path, *text);
}

} // namespace ars
