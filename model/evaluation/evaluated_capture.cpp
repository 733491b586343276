#include "model/evaluation/evaluated_view.h"

#include "engine/capture/layout.h"
#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/image_file.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <system_error>

namespace ars::detail {
namespace fs = std::filesystem;
namespace {

/// What lies in a folder, by name; nothing where there is no folder. Io where it cannot be read to its end.
Result<std::vector<fs::path>> entriesOf(const fs::path& folder) {
    std::vector<fs::path> entries;
    std::error_code failure;
    for (fs::directory_iterator i(folder, failure), end; !failure && i != end; i.increment(failure)) {
        entries.push_back(i->path());
    }
    if (failure && failure != std::errc::no_such_file_or_directory && failure != std::errc::not_a_directory) {
        return makeError(ErrorCode::Io, folder.string(), fmt::format("cannot be read: {}", failure.message()));
    }
    std::sort(entries.begin(), entries.end());
    return entries;
}

/// The folder itself, or the captures directly below it, by name.
Result<std::vector<fs::path>> captureFolders(const fs::path& folder) {
    if (looksLikeCapture(folder)) return std::vector<fs::path>{folder};
    std::vector<fs::path> below;
    ARS_TRY(const std::vector<fs::path> entries, entriesOf(folder));
    for (const fs::path& entry : entries) {
        std::error_code ignored;
        if (fs::is_directory(entry, ignored) && looksLikeCapture(entry)) below.push_back(entry);
    }
    // openCapture says what is missing.
    return below.empty() ? std::vector<fs::path>{folder} : below;
}

nlohmann::json readJson(const fs::path& path) {
    std::error_code ignored;
    if (!fs::is_regular_file(path, ignored)) return {};
    const auto text = readTextFile(path);
    if (!text) return {};
    return nlohmann::json::parse(*text, nullptr, false);
}

struct LightNote {
    std::string name;
    std::optional<double> exposure;
};

/// Light and exposure as the capture says them: {"light": "courtyard", "exposure": 0.7} or {"light": {"name", ...}}.
LightNote lightNote(const nlohmann::json& json) {
    LightNote note;
    if (!json.is_object()) return note;
    const auto takeExposure = [&](const nlohmann::json& object) {
        const auto found = object.find("exposure");
        if (found != object.end() && found->is_number() && std::isfinite(found->get<double>()) &&
            found->get<double>() > 0) {
            note.exposure = found->get<double>();
        }
    };
    takeExposure(json);
    const auto light = json.find("light");
    if (light == json.end()) return note;
    if (light->is_string()) note.name = light->get<std::string>();
    if (light->is_object()) {
        takeExposure(*light);
        if (light->contains("name") && light->at("name").is_string()) note.name = light->at("name").get<std::string>();
    }
    return note;
}

/// lights/NAME.exr in the capture or beside it; the only one there when no name is given.
Result<fs::path> trueLightOf(const fs::path& capture, const std::string& name) {
    for (const fs::path& folder : {capture / "lights", capture.parent_path() / "lights"}) {
        std::vector<fs::path> found;
        ARS_TRY(const std::vector<fs::path> entries, entriesOf(folder));
        for (const fs::path& entry : entries) {
            const std::string ending = entry.extension().string();
            if (ending != ".exr" && ending != ".hdr") continue;
            if (entry.stem().string() == name) return entry;
            found.push_back(entry);
        }
        if (name.empty() && found.size() == 1) return found.front();
    }
    return fs::path();
}

std::vector<ViewId> viewsOf(const Capture& capture, const CaptureSplit& split) {
    std::vector<ViewId> views;
    // Frames outside: an avatar is asked once for each pose.
    for (const int frame : split.frames) {
        for (const int camera : split.cameras) {
            if (capture.has({camera, frame})) views.push_back({camera, frame});
        }
    }
    return views;
}

/// The split that a protocol is about where none was named and the capture has it.
std::string splitName(const Capture& capture, const EvaluationOptions& options) {
    if (!options.split.empty()) return options.split;
    const std::vector<std::string> names = splitNames(capture);
    const std::string wanted = options.protocol == EvaluationProtocol::Ag        ? "ag"
                               : options.protocol == EvaluationProtocol::HeldOut ? "held_out_cameras"
                                                                                 : "all";
    return std::find(names.begin(), names.end(), wanted) != names.end() ? wanted : "all";
}

float medianOf(std::vector<float>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

/// Median colour of the pixels whose alpha is as good as 0.
std::array<float, 3> backgroundOf(const Image& color, const Image& alpha) {
    std::array<std::vector<float>, 3> values;
    for (std::size_t p = 0; p < alpha.pixels.size(); ++p) {
        if (alpha.pixels[p] > 2.5f / 255.0f) continue;
        for (std::size_t c = 0; c < 3; ++c) values[c].push_back(color.pixels[3 * p + c]);
    }
    if (values[0].empty()) return {1.0f, 1.0f, 1.0f};
    return {medianOf(values[0]), medianOf(values[1]), medianOf(values[2])};
}

/// An EXR of ground truth with one or three channels; none where there is no file.
Result<std::optional<Image>> readTruth(const fs::path& path, int channels, const Camera& camera) {
    std::error_code ignored;
    if (!fs::is_regular_file(path, ignored)) return std::optional<Image>();
    ARS_TRY(const ExrImage exr, readExr(path));
    auto layer = exrLayer(exr, "");
    if (!layer) return atPlace(std::move(layer).error(), path.string());
    if (layer->width != camera.width || layer->height != camera.height || layer->channels != channels) {
        return makeError(ErrorCode::BadFile, path.string(),
                         fmt::format("expected {} x {} pixels with {} channels as the camera's pictures, found {} x {} "
                                     "with {}",
                                     camera.width, camera.height, channels, layer->width, layer->height,
                                     layer->channels));
    }
    return std::optional<Image>(std::move(*layer));
}

} // namespace

fs::path EvaluatedCapture::truthPath(ViewId view, const std::string& buffer) const {
    return capture.folder / capture.cameras[static_cast<std::size_t>(view.camera)].name / "gt" / buffer /
           fmt::format("{:08}.exr", capture.frames[static_cast<std::size_t>(view.frame)]);
}

Result<std::vector<EvaluatedCapture>> openEvaluatedCaptures(const fs::path& folder, const EvaluationOptions& options) {
    std::vector<EvaluatedCapture> result;
    ARS_TRY(const std::vector<fs::path> folders, captureFolders(folder.lexically_normal()));
    for (const fs::path& path : folders) {
        EvaluatedCapture set;
        ARS_TRY(set.capture, openCapture(path));
        auto split = namedSplit(set.capture, splitName(set.capture, options), options.cameras, options.frames);
        if (!split) return atPlace(std::move(split).error(), path.string());
        set.split = std::move(*split);
        set.name = (path.has_filename() ? path : path.parent_path()).filename().string();
        set.views = viewsOf(set.capture, set.split);
        LightNote note = lightNote(readJson(path / "frames.json"));
        const LightNote other = lightNote(readJson(path / "metadata.json"));
        if (note.name.empty()) note.name = other.name;
        set.exposure = note.exposure ? *note.exposure : other.exposure.value_or(1.0);
        set.light = options.light;
        if (set.light.empty()) {
            ARS_TRY(set.light, trueLightOf(path.lexically_normal(), note.name));
        }
        result.push_back(std::move(set));
    }
    return result;
}

Result<std::optional<Photograph>> readPhotograph(const EvaluatedCapture& set, ViewId view) {
    Photograph photograph;
    ViewOptions whole;
    whole.cropMargin = -1;
    ARS_TRY(photograph.view, readView(set.capture, view, whole));
    photograph.mask = photograph.view.mask;
    for (float& value : photograph.mask.pixels) value = value > 128.5f / 255.0f ? 1.0f : 0.0f;
    if (std::find(photograph.mask.pixels.begin(), photograph.mask.pixels.end(), 1.0f) == photograph.mask.pixels.end()) {
        return std::optional<Photograph>();
    }
    photograph.background = backgroundOf(photograph.view.color, photograph.view.mask);
    return std::optional<Photograph>(std::move(photograph));
}

Result<TrueBuffers> readTrueBuffers(const EvaluatedCapture& set, ViewId view, const Camera& camera) {
    TrueBuffers truth;
    ARS_TRY(truth.albedo, readTruth(set.truthPath(view, "albedo"), 3, camera));
    ARS_TRY(truth.roughness, readTruth(set.truthPath(view, "roughness"), 1, camera));
    ARS_TRY(truth.occlusion, readTruth(set.truthPath(view, "ao"), 1, camera));
    ARS_TRY(truth.normal, readTruth(set.truthPath(view, "normal"), 3, camera));
    ARS_TRY(truth.depth, readTruth(set.truthPath(view, "depth"), 1, camera));
    if (!truth.normal) return truth;
    truth.normal->space = ColorSpace::Data;
    const glm::mat3 rotation(camera.rotation);
    for (std::size_t i = 0; i < truth.normal->pixels.size(); i += 3) {
        float* n = &truth.normal->pixels[i];
        const glm::vec3 turned = rotation * glm::vec3(n[0], n[1], n[2]);
        for (int c = 0; c < 3; ++c) n[c] = turned[c];
    }
    return truth;
}

} // namespace ars::detail
