#include "engine/io/file_recognition.h"

#include "engine/io/byte_source.h"
#include "engine/io/image_file.h"
#include "engine/io/text_scanner.h"
#include "engine/io/utf8.h"
#include "engine/io/zip.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <set>

namespace ars {
namespace {

constexpr std::size_t kHeadBytes = 64 << 10;
/// JSON is read further than the head, until it is clear what it holds.
constexpr std::uint64_t kMaxJsonBytes = 1ull << 30;

std::string_view textOf(std::span<const std::byte> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// A format that is only recognised, by bytes at a fixed place.
struct ForeignMagic {
    std::size_t offset;
    std::string_view magic;
    std::string_view name;
    std::string_view advice;
};

constexpr std::string_view kVideoAdvice = "turn it into numbered pictures, e.g. with ffmpeg";
constexpr std::string_view kPictureAdvice = "convert it to PNG or JPEG";
constexpr std::string_view kMeshAdvice = "export it as glb from a program that opens it, e.g. Blender";
constexpr std::string_view kPickleAdvice =
    "a pickle can run code, so none is opened: load it in Python and save plain arrays with numpy.savez";
constexpr std::string_view kCheckpointAdvice =
    "a pickle can run code, so none is opened: load it in Python and save it with safetensors.torch.save_file";
constexpr std::string_view kUnpackAdvice = "unpack it";

using namespace std::string_view_literals;
constexpr std::array kForeign{
    ForeignMagic{4, "ftyp"sv, "MP4 video", kVideoAdvice},
    ForeignMagic{0, "\x1a\x45\xdf\xa3"sv, "Matroska or WebM video", kVideoAdvice},
    ForeignMagic{8, "AVI "sv, "AVI video", kVideoAdvice},
    ForeignMagic{8, "WEBP"sv, "WebP picture", kPictureAdvice},
    ForeignMagic{0, "GIF8"sv, "GIF picture", kPictureAdvice},
    ForeignMagic{0, "II*\0"sv, "TIFF picture", kPictureAdvice},
    ForeignMagic{0, "MM\0*"sv, "TIFF picture", kPictureAdvice},
    ForeignMagic{0, "Kaydara FBX Binary"sv, "FBX scene", kMeshAdvice},
    ForeignMagic{0, "BLENDER"sv, "Blender scene", "export it as glb from Blender"},
    ForeignMagic{0, "Ogawa"sv, "Alembic scene", kMeshAdvice},
    ForeignMagic{0, "PXR-USDC"sv, "USD scene", kMeshAdvice},
    ForeignMagic{0, "\x89HDF\r\n\x1a\n"sv, "HDF5 data", "save the arrays with numpy.savez"},
    ForeignMagic{0, "MATLAB 5.0"sv, "MATLAB data", "save the arrays with numpy.savez"},
    ForeignMagic{0, "\x1f\x8b"sv, "gzip archive", kUnpackAdvice},
    ForeignMagic{0, "BZh"sv, "bzip2 archive", kUnpackAdvice},
    ForeignMagic{0,
                 "\xfd"
                 "7zXZ"sv,
                 "xz archive", kUnpackAdvice},
    ForeignMagic{0, "\x28\xb5\x2f\xfd"sv, "Zstandard archive", kUnpackAdvice},
    ForeignMagic{0, "7z\xbc\xaf\x27\x1c"sv, "7-Zip archive", kUnpackAdvice},
    ForeignMagic{257, "ustar"sv, "tar archive", kUnpackAdvice},
    ForeignMagic{0, "%PDF-"sv, "PDF document", ""},
    ForeignMagic{0,
                 "\x7f"
                 "ELF"sv,
                 "program or library", ""},
    // torch.save before version 1.6: a pickle of the number 0x1950a86a20f9469cfc6c comes first.
    ForeignMagic{0,
                 "\x80\x02\x8a\x0al\xfc\x9c"
                 "F\xf9 j\xa8P\x19"sv,
                 "PyTorch checkpoint (old form, pickles)", kCheckpointAdvice},
    ForeignMagic{0, "\x80\x02"sv, "Python pickle", kPickleAdvice},
    ForeignMagic{0, "\x80\x03"sv, "Python pickle", kPickleAdvice},
    ForeignMagic{0, "\x80\x04"sv, "Python pickle", kPickleAdvice},
    ForeignMagic{0, "\x80\x05"sv, "Python pickle", kPickleAdvice},
    ForeignMagic{0, "\xff\xfe"sv, "UTF-16 text", "save it as UTF-8"},
    ForeignMagic{0, "\xfe\xff"sv, "UTF-16 text", "save it as UTF-8"},
};

FileRecognition known(FileFormat format) {
    static constexpr std::array kNames{
        "empty file",           "numpy array", "numpy archive", "safetensors", "OpenEXR picture",
        "Radiance HDR picture", "PNG picture", "JPEG picture",  "PLY",         "Wavefront OBJ",
        "glTF binary",          "glTF",        "BVH",           "JSON",        "text"};
    return {format, kNames.at(static_cast<std::size_t>(format)), "", 0};
}

FileRecognition foreign(std::string_view name, std::string_view advice) {
    return {FileFormat::Foreign, std::string(name), std::string(advice), 0};
}

FileRecognition recogniseZip(const ByteSource& source) {
    const auto members = readZipDirectory(source);
    // Only numpy archives are read here, so a zip whose directory is broken gets the npz reader's sentence.
    if (!members) return known(FileFormat::Npz);
    const auto any = [&](std::string_view end) {
        return std::any_of(members->begin(), members->end(), [&](const ZipEntry& m) { return m.name.ends_with(end); });
    };
    if (any(".npy") || members->empty()) return known(FileFormat::Npz);
    if (any("/data.pkl") || any("constants.pkl")) {
        return foreign("PyTorch checkpoint (zip with a pickle)", kCheckpointAdvice);
    }
    if (any("[Content_Types].xml")) return foreign("Office document", "");
    return foreign("zip archive", kUnpackAdvice);
}

bool looksLikeSafetensors(std::span<const std::byte> head, std::uint64_t fileBytes) {
    std::uint64_t headerBytes = 0;
    if (head.size() < 9) return false;
    std::memcpy(&headerBytes, head.data(), sizeof(headerBytes));
    // The declared length is not compared with the file's: a truncated file is one of these, broken.
    return textOf(head)[8] == '{' && headerBytes >= 2 && (headerBytes <= 100'000'000 || headerBytes <= fileBytes);
}

/// Text without control characters; the last character of a head may be cut.
bool looksLikeText(std::string_view head) {
    const bool controls = std::any_of(head.begin(), head.end(), [](char c) {
        const auto byte = static_cast<unsigned char>(c);
        return byte < 0x20 && c != '\t' && c != '\n' && c != '\r' && c != '\f' && c != '\v';
    });
    if (controls) return false;
    for (std::size_t cut = 0; cut < 4 && cut <= head.size(); ++cut) {
        if (isUtf8(head.substr(0, head.size() - cut))) return true;
    }
    return false;
}

bool isObjKeyword(std::string_view word) {
    static const std::set<std::string_view> kKeywords{"v",      "vt",     "vn",  "vp",     "f",      "l",    "p",
                                                      "o",      "g",      "s",   "usemtl", "mtllib", "mg",   "usemap",
                                                      "maplib", "cstype", "deg", "curv",   "surf",   "parm", "end"};
    return kKeywords.contains(word);
}

bool isNumber(std::string_view word) { return parseFloat(word).has_value(); }

/// At least one vertex line, and hardly a line that is none of the format's (a broken number must not make it prose).
bool looksLikeObj(std::string_view head) {
    std::size_t lines = 0, others = 0, vertices = 0;
    TextScanner scanner(head);
    while (!scanner.atEnd()) {
        scanner.skipSpace();
        const std::string_view word = scanner.word(true);
        if (word.empty()) break;
        const std::string_view rest = scanner.restOfLine();
        if (word.starts_with('#')) continue;
        ++lines;
        if (!isObjKeyword(word)) ++others;
        TextScanner values(rest);
        if (word == "v" && isNumber(values.word(true)) && isNumber(values.word(true))) ++vertices;
    }
    return vertices > 0 && others * 20 <= lines;
}

/// Collects the keys of the outermost object and sees the rest go by, in bounded memory.
class TopLevelKeys : public nlohmann::json_sax<nlohmann::json> {
public:
    std::set<std::string, std::less<>> keys;

    bool null() override { return true; }
    bool boolean(bool) override { return true; }
    bool number_integer(number_integer_t) override { return true; }
    bool number_unsigned(number_unsigned_t) override { return true; }
    bool number_float(number_float_t, const string_t&) override { return true; }
    bool string(string_t&) override { return true; }
    bool binary(binary_t&) override { return true; }
    bool start_object(std::size_t) override { return deeper(); }
    bool end_object() override { return --depth_, true; }
    bool start_array(std::size_t) override { return deeper(); }
    bool end_array() override { return --depth_, true; }
    bool key(string_t& name) override {
        if (depth_ == 1 && keys.size() < 1000) keys.insert(name);
        return true;
    }
    bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception&) override { return false; }

private:
    bool deeper() { return ++depth_ < 10000; }
    int depth_ = 0;
};

FileFormat jsonFormat(std::string_view text) {
    TopLevelKeys found;
    (void)nlohmann::json::sax_parse(text.begin(), text.end(), &found);
    const auto has = [&](std::string_view key) { return found.keys.contains(key); };
    // A truncated file may have lost its "asset".
    const bool gltf = has("asset") || (has("accessors") && has("bufferViews")) || (has("nodes") && has("scenes"));
    return gltf ? FileFormat::Gltf : FileFormat::Json;
}

std::string_view withoutMark(std::string_view text) {
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    return text;
}

/// What the first bytes tell; nothing for zip and JSON, which need more.
std::optional<FileRecognition> recogniseHead(std::span<const std::byte> head, std::uint64_t fileBytes) {
    const std::string_view text = textOf(head);
    if (fileBytes == 0) return known(FileFormat::Empty);
    if (text.starts_with("\x93NUMPY")) return known(FileFormat::Npy);
    if (const auto image = recogniseImage(head)) {
        switch (*image) {
        case ImageFormat::Exr:
            return known(FileFormat::Exr);
        case ImageFormat::Hdr:
            return known(FileFormat::Hdr);
        case ImageFormat::Png:
            return known(FileFormat::Png);
        case ImageFormat::Jpeg:
            return known(FileFormat::Jpeg);
        }
    }
    if (text.starts_with("ply\n") || text.starts_with("ply\r")) return known(FileFormat::Ply);
    if (text.starts_with("glTF")) return known(FileFormat::Glb);
    for (const ForeignMagic& entry : kForeign) {
        if (text.size() > entry.offset && text.substr(entry.offset).starts_with(entry.magic)) {
            return foreign(entry.name, entry.advice);
        }
    }
    if (looksLikeSafetensors(head, fileBytes)) return known(FileFormat::Safetensors);
    return std::nullopt;
}

FileRecognition recogniseText(std::string_view head) {
    TextScanner scanner(withoutMark(head));
    scanner.skipSpace();
    if (equalIgnoringCase(scanner.word(), "HIERARCHY")) return known(FileFormat::Bvh);
    if (!looksLikeText(head)) return {FileFormat::Unknown, "file of an unknown kind", "", 0};
    // The last line of a head may be cut.
    return known(looksLikeObj(head) ? FileFormat::Obj : FileFormat::Text);
}

/// An object, or a list whose first entry can be one (TOML and INI files begin with a bracket too).
bool startsLikeJson(std::string_view head) {
    TextScanner scanner(withoutMark(head));
    scanner.skipSpace();
    const std::string_view text = withoutMark(head).substr(scanner.position());
    if (text.empty() || (text[0] != '{' && text[0] != '[') || !looksLikeText(head)) return false;
    const std::size_t next = text.find_first_not_of(" \t\r\n", 1);
    if (next == std::string_view::npos) return true;
    const std::string_view rest = text.substr(next);
    if (text[0] == '{') return rest[0] == '"' || rest[0] == '}';
    return std::string_view("{[\"]-0123456789").find(rest[0]) != std::string_view::npos || rest.starts_with("true") ||
           rest.starts_with("false") || rest.starts_with("null");
}

Result<FileRecognition> recogniseSource(const ByteSource& source) {
    std::vector<std::byte> head(static_cast<std::size_t>(std::min<std::uint64_t>(source.size(), kHeadBytes)));
    ARS_TRY_STATUS(source.readAt(0, head, "the beginning"));
    const std::string_view text = textOf(head);
    FileRecognition result;
    if (text.starts_with("PK\x03\x04") || text.starts_with("PK\x05\x06")) {
        result = recogniseZip(source);
    } else if (auto byHead = recogniseHead(head, source.size())) {
        result = std::move(*byHead);
    } else if (startsLikeJson(text)) {
        ARS_TRY(std::vector<std::byte> all, allocateBytes(std::min(source.size(), kMaxJsonBytes), "JSON"));
        ARS_TRY_STATUS(source.readAt(0, all, "the JSON"));
        result = known(jsonFormat(withoutMark(textOf(all))));
    } else {
        result = recogniseText(text);
    }
    result.bytes = source.size();
    return result;
}

} // namespace

std::string_view fileFormatName(FileFormat format) {
    static constexpr std::array kNames{"empty", "npy",  "npz",  "safetensors", "exr",    "hdr",
                                       "png",   "jpeg", "ply",  "obj",         "glb",    "gltf",
                                       "bvh",   "json", "text", "foreign",     "unknown"};
    return kNames.at(static_cast<std::size_t>(format));
}

Result<FileRecognition> recogniseFile(const std::filesystem::path& path, const ReadLimits& limits) {
    auto source = FileSource::open(path, limits);
    if (!source) return atPlace(std::move(source).error(), path.string());
    auto result = recogniseSource(**source);
    if (!result) return atPlace(std::move(result).error(), path.string());
    return result;
}

FileRecognition recogniseBytes(std::span<const std::byte> bytes) {
    const MemorySource source(bytes);
    auto result = recogniseSource(source);
    if (!result) return {FileFormat::Unknown, "file of an unknown kind", "", bytes.size()};
    return std::move(*result);
}

bool extensionFits(const std::filesystem::path& path, const FileRecognition& file) {
    struct Claim {
        std::string_view extension;
        FileFormat format;
    };
    static constexpr std::array kClaims{Claim{".npy", FileFormat::Npy},
                                        Claim{".npz", FileFormat::Npz},
                                        Claim{".safetensors", FileFormat::Safetensors},
                                        Claim{".exr", FileFormat::Exr},
                                        Claim{".hdr", FileFormat::Hdr},
                                        Claim{".pic", FileFormat::Hdr},
                                        Claim{".png", FileFormat::Png},
                                        Claim{".jpg", FileFormat::Jpeg},
                                        Claim{".jpeg", FileFormat::Jpeg},
                                        Claim{".ply", FileFormat::Ply},
                                        Claim{".obj", FileFormat::Obj},
                                        Claim{".glb", FileFormat::Glb},
                                        Claim{".gltf", FileFormat::Gltf},
                                        Claim{".bvh", FileFormat::Bvh},
                                        Claim{".json", FileFormat::Json}};
    const std::string extension = path.extension().string();
    for (const Claim& claim : kClaims) {
        if (equalIgnoringCase(claim.extension, extension)) return claim.format == file.format;
    }
    return true;
}

} // namespace ars
