#include "engine/capture/calibration.h"
#include "engine/core/process.h"
#include "engine/io/exr.h"
#include "engine/io/file_recognition.h"
#include "engine/io/png.h"
#include "engine/scene/evaluate.h"
#include "engine/scene/json_archive.h"
#include "engine/scene/project.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

namespace ars {
namespace fs = std::filesystem;

namespace {

using detail::JsonReader;

constexpr const char* kAttribute = "ars";

Error withoutDocument(const fs::path& path) {
    return makeError(
        ErrorCode::NotFound, path.string(),
        "the picture carries no document of this program (it was made by another one, or was edited since)");
}

Result<std::string> textInPng(const fs::path& path) {
    ARS_TRY(const PngFile file, readPng(path));
    const auto found = file.text.find(kAttribute);
    if (found == file.text.end()) return withoutDocument(path);
    return found->second;
}

Result<std::string> textInExr(const fs::path& path) {
    ARS_TRY(const ExrInfo info, listExr(path));
    for (const ExrPartInfo& part : info.parts) {
        if (const auto found = part.textAttributes.find(kAttribute); found != part.textAttributes.end()) {
            return found->second;
        }
    }
    return withoutDocument(path);
}

Result<std::string> textInFilm(const fs::path& path) {
    std::error_code failure;
    ProcessOptions options;
    options.timeout = std::chrono::seconds(30);
    // "file:" so that no name is taken for an address.
    auto probed = runProcess({"ffprobe", "-v", "error", "-show_entries", "format_tags=comment", "-of", "json", "-i",
                              "file:" + fs::absolute(path, failure).string()},
                             options);
    if (!probed) {
        return makeError(ErrorCode::Unavailable, path.string(),
                         "the program ffprobe is needed to read the document in a film; install ffmpeg");
    }
    if (probed->exitCode != 0) {
        return makeError(ErrorCode::BadFile, path.string(),
                         fmt::format("is no sound film: {}", probed->errors.substr(0, probed->errors.find('\n'))));
    }
    ARS_TRY(const detail::Json json, detail::parseJsonText(probed->output));
    const auto comment = detail::Json::json_pointer("/format/tags/comment");
    if (!json.contains(comment) || !json[comment].is_string()) return withoutDocument(path);
    return json[comment].get<std::string>();
}

Result<std::string> documentText(const fs::path& path) {
    ARS_TRY(const FileRecognition file, recogniseFile(path));
    if (file.format == FileFormat::Png) return textInPng(path);
    if (file.format == FileFormat::Exr) return textInExr(path);
    if (file.format == FileFormat::Foreign && file.name.find("MP4") != std::string::npos) return textInFilm(path);
    return withoutDocument(path);
}

/// A file as the command line named it: from the folder that the program ran in then, if that is here.
std::string absoluteFile(const std::string& named, const fs::path& folder) {
    std::error_code failure;
    if (named.empty() || fs::path(named).is_absolute()) return named;
    const fs::path beside = (folder / named).lexically_normal();
    const fs::path here = fs::absolute(named, failure).lexically_normal();
    return (!fs::exists(here, failure) && fs::exists(beside, failure) ? beside : here).string();
}

void restoreAvatar(JsonReader& reader, const fs::path& folder, AvatarSection& avatar) {
    reader.at("avatar").text(avatar.source);
    const std::string prefix = "rest:";
    if (avatar.source.rfind(prefix, 0) != 0) {
        avatar.source = absoluteFile(avatar.source, folder);
    } else if (avatar.source != prefix + "open") {
        avatar.source = prefix + absoluteFile(avatar.source.substr(prefix.size()), folder);
    }
    std::vector<std::string> given;
    reader.at("settings_given").list(given, 1024, [](JsonReader&& item, std::string& text) { item.text(text); });
    for (const std::string& setting : given) {
        const std::string group = "rest.";
        const std::size_t equal = setting.find('=');
        if (setting.rfind(group, 0) != 0 || equal == std::string::npos) continue; // the others stand in "settings"
        const Status set = restAvatarParameters().setText(
            avatar.rest, setting.substr(group.size(), equal - group.size()), setting.substr(equal + 1));
        if (!set) reader.note(fmt::format("settings_given: {}", set.error().describe()));
    }
}

void restorePose(JsonReader&& reader, Pose& pose) {
    if (!reader.object()) return;
    const detail::NumberRange range{-1e6, 1e6};
    const auto number = [range](JsonReader&& item, float& value) { item.number(value, range); };
    std::vector<float> axisAngles;
    reader.at("axis_angle").list(axisAngles, 3 * 4096, number);
    for (std::size_t joint = 0; 3 * joint + 2 < axisAngles.size(); ++joint) {
        if (joint >= pose.rotations.size()) pose.rotations.emplace_back(1.0f, 0.0f, 0.0f, 0.0f);
        const float* v = &axisAngles[3 * joint];
        pose.rotations[joint] = quatFromAxisAngle({v[0], v[1], v[2]});
    }
    reader.at("translation").numbers(std::span<float>(&pose.translation.x, 3), range);
    reader.at("expression").list(pose.expression, 1024, number);
}

/// The free camera, with the body's middle as what orbiting turns about.
Status restoreCamera(const detail::Json& json, const Pose& pose, SceneCamera& camera) {
    const auto found = json.find("camera");
    if (found == json.end()) return {};
    auto read = cameraFromJson(*found);
    if (!read) return atPlace(std::move(read).error(), "camera");
    const double distance = read->toCamera(glm::dvec3(pose.translation)).z;
    camera = sceneCameraOf(*read, std::max(distance, 0.1));
    return {};
}

/// "sky:12,40" and "studio:rim" as the command line has them; else a file.
void restoreLightSource(const std::string& source, const fs::path& folder, LightSection& light) {
    const std::size_t colon = source.find(':');
    const std::string word = source.substr(0, colon);
    const std::string variant = colon == std::string::npos ? "" : source.substr(colon + 1);
    if (word == "sky") {
        light.kind = LightKind::Sky;
        const std::size_t comma = std::min(variant.find(','), variant.size());
        std::from_chars(variant.data(), variant.data() + comma, light.sky.sunElevationDeg);
        if (comma < variant.size()) {
            std::from_chars(variant.data() + comma + 1, variant.data() + variant.size(), light.sky.sunAzimuthDeg);
        }
    } else if (word == "studio") {
        light.kind = LightKind::Studio;
        const auto& words = EnumWords<StudioPreset>::words;
        const auto preset = std::find(words.begin(), words.end(), variant);
        light.studio = studioPreset(preset == words.end() ? StudioPreset::ThreePoint
                                                          : static_cast<StudioPreset>(preset - words.begin()));
    } else if (source == "uniform") {
        light.kind = LightKind::Uniform;
        light.uniformRadiance = 1.0f;
    } else {
        light.kind = LightKind::File;
        light.file = absoluteFile(source, folder);
    }
}

void restoreLight(JsonReader&& reader, const fs::path& folder, LightSection& light) {
    if (!reader.object()) return;
    std::string source;
    reader.at("source").text(source);
    if (!source.empty()) restoreLightSource(source, folder, light);
    double scale = 1.0;
    reader.at("scale").number(scale, {0.0, 1e12});
    if (scale <= 0.0) reader.note("the light was off, which becomes 16 stops darker");
    light.exposureEv = scale > 0.0 ? static_cast<float>(std::log2(scale)) : -16.0f;
    reader.at("rotation_deg").number(light.rotationDeg, {-360.0, 360.0});
    reader.passOver("filter");
}

void restoreSettings(JsonReader&& reader, OcclusionSection& occlusion) {
    if (!reader.object()) return;
    OcclusionSettings& settings = occlusion.settings;
    reader.at("occlusion_method")
        .word(settings.method, std::span<const std::string_view>(EnumWords<OcclusionMethod>::words));
    reader.at("splat").table(splatParameters(), occlusion.splat);
    reader.at("pose").table(poseSurfelsParameters(), occlusion.posing);
    reader.at("occlusion").table(occlusionParameters(), settings.screenSpace);
    reader.at("mesh_rays").table(meshOcclusionParameters(), settings.meshRays);
    reader.at("rasterised").table(rasterisedVisibilityParameters(), settings.rasterised);
    reader.at("baked").table(bakedVisibilityParameters(), settings.baked);
    if (JsonReader radii = reader.at("radii"); radii.object()) {
        for (std::size_t part = 0; part < occlusion.radii.size(); ++part) {
            radii.at(bodyPartName(static_cast<BodyPart>(part))).number(occlusion.radii[part], {0.0, 10.0});
        }
    }
    if (JsonReader shading = reader.at("shading"); shading.object()) {
        shading.at("occlude").flag(occlusion.shading.occlude);
        shading.at("occlude_specular").flag(occlusion.shading.occludeSpecular);
        shading.at("f0").number(occlusion.shading.f0, {0.0, 1.0});
    }
}

/// The document of pictures that `ars render --avatar` writes: what made one frame.
Result<Document> documentFromFrame(const detail::Json& json, const fs::path& folder, std::vector<std::string>* notes) {
    Document document = newDocument();
    document.view.tone = ToneParams{};
    document.pose.pose = restPose(kSmplxJointCount);
    JsonReader::Report report{folder, {}, {}};
    {
        JsonReader reader(json, report);
        reader.object();
        for (const char* key : {"program", "format", "surfels", "device", "camera", "motion"}) reader.passOver(key);
        restoreAvatar(reader, folder, document.avatar);
        restorePose(reader.at("pose"), document.pose.pose);
        restoreLight(reader.at("environment"), folder, document.light);
        restoreSettings(reader.at("settings"), document.occlusion);
        reader.at("display").table(toneParameters(), document.view.tone);
        if (json.contains("motion")) reader.note("the picture is a frame of a motion; its pose was taken over");
    }
    if (report.error) return std::move(*report.error);
    ARS_TRY_STATUS(restoreCamera(json, document.pose.pose, document.camera.camera));
    if (notes) notes->insert(notes->end(), report.notes.begin(), report.notes.end());
    return document;
}

} // namespace

Result<Document> documentFromPicture(const fs::path& path, std::vector<std::string>* notes) {
    ARS_TRY(const std::string text, documentText(path));
    const std::string place = path.string() + ": document in the picture";
    const auto json = detail::parseJsonText(text);
    if (!json) return atPlace(json.error(), place);
    std::error_code failure;
    const fs::path folder = fs::absolute(path, failure).parent_path().lexically_normal();
    const bool frame = json->is_object() && json->contains("avatar") && (*json)["avatar"].is_string();
    auto document = frame ? documentFromFrame(*json, folder, notes) : documentFromJson(*json, folder, notes);
    if (!document) return atPlace(std::move(document).error(), place);
    return document;
}

} // namespace ars
