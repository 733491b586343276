#include "app/inspect.h"

#include "app/text.h"
#include "engine/core/buffer.h"
#include "engine/core/file.h"
#include "engine/io/mesh.h"

#include <algorithm>

namespace ars::app {
namespace fs = std::filesystem;
namespace {

/// As a tree JSON takes some twenty times its bytes; calibrations and maps are far below this.
constexpr std::uint64_t kMaxJsonBytes = 64ull << 20;

void inspectForeign(FileReport& report, const FileRecognition& file) {
    const bool checkpoint = file.name.starts_with("PyTorch");
    const bool video = file.name.ends_with("video");
    const bool picture = file.name.ends_with("picture");
    report.kind = checkpoint ? "checkpoint" : video ? "video" : picture ? "picture" : "foreign";
    report.fail(makeError(ErrorCode::Unsupported, "",
                          file.advice.empty() ? "this program does not read such files"
                                              : fmt::format("this program does not read such files; {}", file.advice)));
}

void inspectUnknown(FileReport& report) {
    report.fail(
        makeError(ErrorCode::Unsupported, "",
                  "expected npy, npz, safetensors, EXR, HDR, PNG, JPEG, PLY, OBJ, glTF, BVH or a JSON file of this "
                  "program, found none of them"));
}

void inspectFormat(FileReport& report, const FileRecognition& file, const InspectOptions& options) {
    switch (file.format) {
    case FileFormat::Empty:
        return report.fail(makeError(ErrorCode::BadFile, "", "the file is empty (0 bytes)"));
    case FileFormat::Npy:
        return inspectNpy(report, options);
    case FileFormat::Npz:
        return inspectNpz(report, options);
    case FileFormat::Safetensors:
        return inspectSafetensors(report, options);
    case FileFormat::Exr:
        return inspectExr(report, options);
    case FileFormat::Hdr:
        return inspectHdr(report, options);
    case FileFormat::Png:
        return inspectPng(report, options);
    case FileFormat::Jpeg:
        return inspectJpeg(report, options);
    case FileFormat::Ply:
        return inspectPly(report, options);
    case FileFormat::Obj:
        return inspectObj(report, options);
    case FileFormat::Glb:
    case FileFormat::Gltf:
        return inspectGltf(report, options);
    case FileFormat::Bvh:
        return inspectBvh(report, options);
    case FileFormat::Json:
        return inspectJson(report, options);
    case FileFormat::Text:
        return inspectText(report, options);
    case FileFormat::Foreign:
        return inspectForeign(report, file);
    case FileFormat::Unknown:
        return inspectUnknown(report);
    }
}

void inspectFile(FileReport& report, const fs::path& path, const InspectOptions& options) {
    auto recognised = recogniseFile(path, options.limits);
    if (!recognised) {
        report.kind = recognised.error().code == ErrorCode::NotFound ? "missing" : "unreadable";
        report.title = recognised.error().code == ErrorCode::NotFound ? "no such file" : "cannot be opened";
        return report.fail(recognised.error());
    }
    report.format = fileFormatName(recognised->format);
    report.title = recognised->name;
    report.kind = report.format;
    report.add("size", formatBytes(recognised->bytes), recognised->bytes);
    const bool isText = recognised->format == FileFormat::Text || recognised->format == FileFormat::Empty;
    if (path.filename() == "missing_img_files.txt" && isText) return inspectMissingImages(report, options);
    inspectFormat(report, *recognised, options);
    if (!extensionFits(path, *recognised)) {
        report.warn(
            fmt::format("the name ends with {}, the content is {}", path.extension().string(), recognised->name));
    }
}

} // namespace

FileReport inspectPath(const fs::path& path, const InspectOptions& options) {
    FileReport report;
    report.path = path.string();
    std::error_code failure;
    if (fs::is_directory(path, failure)) {
        report.kind = "folder";
        report.format = "folder";
        report.title = "folder";
        if (!inspectAvatarFolder(report, options)) inspectCaptureFolder(report, options);
    } else {
        inspectFile(report, path, options);
    }
    report.checked = report.ok() && !options.fast;
    return report;
}

Result<Json> readJsonFile(const fs::path& path, ReadLimits limits) {
    limits.maxFileBytes = std::min(limits.maxFileBytes, kMaxJsonBytes);
    ARS_TRY(const std::string text, readTextFile(path, limits));
    Json json;
    try {
        json = Json::parse(text);
    } catch (const Json::parse_error& error) {
        // "[json.exception.parse_error.101] parse error at line 1, column 8: ..." without what only programmers know
        std::string_view what = error.what();
        if (const std::size_t bracket = what.find("] "); bracket != std::string_view::npos)
            what.remove_prefix(bracket + 2);
        return makeError(ErrorCode::BadFile, path.string(), fmt::format("is no sound JSON: {}", what));
    }
    return json;
}

void addExtent(FileReport& report, std::span<const glm::vec3> positions) {
    if (positions.empty()) return;
    glm::vec3 low = positions[0], high = positions[0];
    for (const glm::vec3& p : positions) {
        low = glm::min(low, p);
        high = glm::max(high, p);
    }
    const glm::vec3 size = high - low;
    report.add("extent", fmt::format("{:.4g} x {:.4g} x {:.4g} (x, y, z)", size.x, size.y, size.z),
               Json{{"min", {low.x, low.y, low.z}}, {"max", {high.x, high.y, high.z}}});
}

} // namespace ars::app
