#include "engine/core/file.h"
#include "engine/io/exr.h"
#include "engine/io/png.h"
#include "engine/io/safetensors.h"
#include "engine/rig/gltf_rig.h"
#include "engine/rig/posed_export.h"
#include "model/avatar/avatar_model.h"
#include "model/run/run_lock.h"

#include <ATen/ATen.h>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cstring>
#include <system_error>

#include <unistd.h>

/// The files of an avatar folder (design section 5; docs/user/training.md, Avatars).
namespace ars {
namespace {

constexpr int kFormatVersion = 1;

template <typename T>
Array arrayOver(DType type, std::vector<std::size_t> shape, std::span<const T> values) {
    Array array;
    array.dtype = type;
    array.shape = std::move(shape);
    array.bytes.resize(values.size_bytes());
    if (!values.empty()) std::memcpy(array.bytes.data(), values.data(), values.size_bytes());
    return array;
}

Array vectorArray(std::span<const glm::vec3> values) {
    return arrayOver<glm::vec3>(DType::F32, {values.size(), 3}, values);
}

/// Bytes of a tensor of the file as a vector, its type and shape checked; `rows` < 0: any.
template <typename T>
Status takeArray(const SafetensorsFile& file, const std::string& name, DType type, std::vector<std::size_t> shape,
                 std::vector<T>& values) {
    ARS_TRY(const Array* array, file.find(name));
    ARS_TRY_STATUS(requireShape(*array, name, shape));
    if (array->dtype != type) {
        return makeError(ErrorCode::BadFile, name, fmt::format("{}, expected {}", array->describe(), dtypeName(type)));
    }
    values.resize(array->bytes.size() / sizeof(T));
    if (!values.empty()) std::memcpy(static_cast<void*>(values.data()), array->bytes.data(), array->bytes.size());
    return {};
}

void storeWeights(SafetensorsFile& file, const std::string& prefix, const SkinWeights& weights) {
    const std::size_t n = weights.pointCount();
    file.tensors[prefix + "joints"] = arrayOver<std::uint16_t>(DType::U16, {n, kMaxInfluences}, weights.joints);
    file.tensors[prefix + "weights"] = arrayOver<float>(DType::F32, {n, kMaxInfluences}, weights.weights);
}

Status takeWeights(const SafetensorsFile& file, const std::string& prefix, std::size_t points, SkinWeights& weights) {
    ARS_TRY_STATUS(takeArray(file, prefix + "joints", DType::U16, {points, kMaxInfluences}, weights.joints));
    ARS_TRY_STATUS(takeArray(file, prefix + "weights", DType::F32, {points, kMaxInfluences}, weights.weights));
    for (const std::uint16_t joint : weights.joints) {
        if (joint < kSmplxJointCount) continue;
        return makeError(ErrorCode::BadFile, prefix + "joints",
                         fmt::format("names joint {}, there are {}", joint, kSmplxJointCount));
    }
    return {};
}

void storeMaps(SafetensorsFile& file, const CanonicalMaps& maps) {
    const std::size_t n = maps.pointCount();
    file.tensors["maps.pixels"] = arrayOver<std::uint32_t>(DType::U32, {n}, maps.pixels);
    file.tensors["maps.triangles"] = arrayOver<std::uint32_t>(DType::U32, {n}, maps.triangles);
    file.tensors["maps.barycentrics"] = vectorArray(maps.barycentrics);
    file.tensors["maps.positions"] = vectorArray(maps.positions);
    file.tensors["maps.normals"] = vectorArray(maps.normals);
    storeWeights(file, "maps.", maps.weights);
    file.tensors["maps.canonical"] = arrayOver<glm::mat4>(DType::F32, {maps.canonical.size(), 4, 4}, maps.canonical);
}

Status takeMaps(const SafetensorsFile& file, CanonicalMaps& maps) {
    ARS_TRY_STATUS(takeArray(file, "maps.pixels", DType::U32, {kAnySize}, maps.pixels));
    const std::size_t n = maps.pixels.size();
    for (std::size_t i = 0; i < n; ++i) {
        if (maps.pixels[i] < maps.pixelCount() && (i == 0 || maps.pixels[i] > maps.pixels[i - 1])) continue;
        return makeError(
            ErrorCode::BadFile, "maps.pixels",
            fmt::format("entry {} is {}, expected increasing places below {}", i, maps.pixels[i], maps.pixelCount()));
    }
    ARS_TRY_STATUS(takeArray(file, "maps.triangles", DType::U32, {n}, maps.triangles));
    ARS_TRY_STATUS(takeArray(file, "maps.barycentrics", DType::F32, {n, 3}, maps.barycentrics));
    ARS_TRY_STATUS(takeArray(file, "maps.positions", DType::F32, {n, 3}, maps.positions));
    ARS_TRY_STATUS(takeArray(file, "maps.normals", DType::F32, {n, 3}, maps.normals));
    ARS_TRY_STATUS(takeWeights(file, "maps.", n, maps.weights));
    return takeArray(file, "maps.canonical", DType::F32, {kSmplxJointCount, 4, 4}, maps.canonical);
}

void storeBody(SafetensorsFile& file, const BodyModel& body) {
    const std::size_t v = body.vertexCount();
    file.metadata["body"] = body.name;
    file.tensors["body.vertices"] = vectorArray(body.templateVertices);
    file.tensors["body.triangles"] = arrayOver<glm::uvec3>(DType::U32, {body.triangles.size(), 3}, body.triangles);
    storeWeights(file, "body.", body.weights);
    file.tensors["body.regressor"] = Array::fromFloats({kSmplxJointCount, v}, body.jointRegressor);
    if (!body.poseDirs.empty()) file.tensors["body.pose_dirs"] = Array::fromFloats({v, 3, 486}, body.poseDirs);
}

Status takeBody(const SafetensorsFile& file, const Skeleton& skeleton, BodyModel& body) {
    const auto name = file.metadata.find("body");
    body.name = name == file.metadata.end() ? "body" : name->second;
    ARS_TRY_STATUS(takeArray(file, "body.vertices", DType::F32, {kAnySize, 3}, body.templateVertices));
    const std::size_t v = body.vertexCount();
    ARS_TRY_STATUS(takeArray(file, "body.triangles", DType::U32, {kAnySize, 3}, body.triangles));
    ARS_TRY_STATUS(takeWeights(file, "body.", v, body.weights));
    ARS_TRY_STATUS(takeArray(file, "body.regressor", DType::F32, {kSmplxJointCount, v}, body.jointRegressor));
    if (file.tensors.contains("body.pose_dirs")) {
        ARS_TRY_STATUS(takeArray(file, "body.pose_dirs", DType::F32, {v, 3, 486}, body.poseDirs));
    }
    body.parents = skeleton.parents;
    body.jointNames = skeleton.names;
    return {};
}

/// Base values that are learned lie among the weights, the others follow from the maps.
void storeBase(SafetensorsFile& file, const SurfelBase& base) {
    if (!base.geometry.defined()) return;
    file.tensors["base.geometry"] = arrayFromTensor(base.geometry.detach());
    file.tensors["base.materials"] = arrayFromTensor(base.materials.detach());
    file.tensors["base.colors"] = arrayFromTensor(base.colors.detach());
}

Status takeBaseTensor(const SafetensorsFile& file, const std::string& name, at::Tensor& into) {
    ARS_TRY(const Array* array, file.find(name));
    ARS_TRY(const at::Tensor values, tensorFromArray(*array));
    if (values.sizes() != into.sizes()) {
        return makeError(ErrorCode::BadFile, name,
                         fmt::format("{}, expected {} rows of {}", array->describe(), into.size(0), into.size(1)));
    }
    at::NoGradGuard noGradient;
    into.copy_(values);
    return {};
}

nlohmann::ordered_json specToJson(const AvatarSpec& spec, const CanonicalMaps& maps) {
    nlohmann::ordered_json json;
    json["format"] = "ars.avatar";
    json["version"] = kFormatVersion;
    json["preset"] = spec.preset;
    json["origin"] = spec.origin;
    json["network"] = avatarNetworkParameters().toJson(spec.network);
    json["decoding"] = decodingParameters().toJson(spec.decoding);
    json["splat"] = splatParameters().toJson(spec.splat);
    json["occluded"] = spec.occluded;
    json["occlusion"] = occlusionParameters().toJson(spec.occlusion);
    json["posing"] = poseSurfelsParameters().toJson(spec.posing);
    json["maps"] = {{"size", maps.size},
                    {"half_extent", maps.halfExtentM},
                    {"center", {maps.centerM.x, maps.centerM.y, maps.centerM.z}},
                    {"points", maps.pointCount()}};
    for (int g = 0; g < kBodyPartCount; ++g) {
        const auto part = static_cast<std::size_t>(g);
        json["radii"][std::string(bodyPartName(static_cast<BodyPart>(g)))] = {{"initial", spec.initialRadii[part]},
                                                                              {"offset", spec.radiusOffsets[part]}};
    }
    return json;
}

/// How it is shaded and posed; avatars from before these were written have the defaults.
Status shadingFromJson(const nlohmann::json& json, AvatarSpec& spec) {
    spec.occluded = json.value("occluded", true);
    if (json.contains("occlusion")) {
        ARS_TRY_STATUS(occlusionParameters().fromJson(spec.occlusion, json.at("occlusion")));
        if (const Status sound = validateOcclusionParams(spec.occlusion); !sound) {
            return makeError(ErrorCode::BadFile, "occlusion", sound.error().describe());
        }
    }
    if (json.contains("posing")) {
        ARS_TRY_STATUS(poseSurfelsParameters().fromJson(spec.posing, json.at("posing")));
    }
    return {};
}

Status specFromJson(const nlohmann::ordered_json& ordered, AvatarSpec& spec, CanonicalMaps& maps) {
    const nlohmann::json json = ordered;
    if (!json.is_object() || json.value("format", "") != "ars.avatar") {
        return makeError(ErrorCode::BadFile, "", "is no avatar of ARS Studio: \"format\" is not \"ars.avatar\"");
    }
    if (const int version = json.value("version", 0); version < 1 || version > kFormatVersion) {
        return makeError(ErrorCode::Unsupported, "version",
                         fmt::format("is {}, this program reads up to {}", version, kFormatVersion));
    }
    spec.preset = json.value("preset", "");
    spec.origin = json.value("origin", "");
    ARS_TRY_STATUS(avatarNetworkParameters().fromJson(spec.network, json.at("network")));
    ARS_TRY_STATUS(decodingParameters().fromJson(spec.decoding, json.at("decoding")));
    ARS_TRY_STATUS(splatParameters().fromJson(spec.splat, json.at("splat")));
    ARS_TRY_STATUS(shadingFromJson(json, spec));
    const nlohmann::json& place = json.at("maps");
    maps.size = place.at("size").get<int>();
    maps.halfExtentM = place.at("half_extent").get<float>();
    for (int axis = 0; axis < 3; ++axis)
        maps.centerM[axis] = place.at("center").at(static_cast<std::size_t>(axis)).get<float>();
    if (maps.size != 2 * spec.network.inputSize || maps.size > 4096) {
        return makeError(
            ErrorCode::BadFile, "maps",
            fmt::format("size {}, expected twice the network's input of {}", maps.size, spec.network.inputSize));
    }
    spec.maps = {.size = maps.size, .halfExtentM = maps.halfExtentM, .centerM = maps.centerM};
    for (int g = 0; g < kBodyPartCount; ++g) {
        const nlohmann::json& row = json.at("radii").at(std::string(bodyPartName(static_cast<BodyPart>(g))));
        spec.initialRadii[static_cast<std::size_t>(g)] = row.at("initial").get<float>();
        spec.radiusOffsets[static_cast<std::size_t>(g)] = row.at("offset").get<float>();
    }
    return {};
}

Status readSpec(const std::filesystem::path& path, AvatarSpec& spec, CanonicalMaps& maps) {
    ARS_TRY(const std::string text, readTextFile(path));
    try {
        if (Status status = specFromJson(nlohmann::ordered_json::parse(text), spec, maps); !status) {
            return atPlace(status.error(), path.string());
        }
    } catch (const nlohmann::json::exception& exception) {
        return makeError(ErrorCode::BadFile, path.string(), fmt::format("is no avatar.json: {}", exception.what()));
    }
    return {};
}

Status writeLight(const std::filesystem::path& path, const CubeMap& light) {
    ARS_TRY(const Image picture, latLongFromCube(light, 4 * light.size, 2 * light.size));
    ExrImage exr;
    exr.dataWindow = exr.displayWindow = {0, 0, picture.width - 1, picture.height - 1};
    ARS_TRY_STATUS(addExrLayer(exr, "", picture, "RGB", ExrPixelType::Float));
    return writeExr(path, exr);
}

Status takeLight(const SafetensorsFile& file, std::optional<CubeMap>& light) {
    const auto found = file.tensors.find("light.texels");
    if (found == file.tensors.end()) return {};
    const std::vector<std::size_t>& shape = found->second.shape;
    if (shape.size() != 4 || shape[0] != 6 || shape[1] != shape[2] || shape[3] != 3 || shape[1] < 1 ||
        shape[1] > kMaxCubeSize) {
        return makeError(ErrorCode::BadFile, "light.texels",
                         fmt::format("{}, expected (6, side, side, 3)", found->second.describe()));
    }
    CubeMap cube(static_cast<int>(shape[1]));
    ARS_TRY(cube.texels, found->second.toFloat());
    light = std::move(cube);
    return {};
}

/// What a folder of an avatar may hold to be replaced: anything else in it is somebody's own, or a checkpoint's.
constexpr std::array<const char*, 6> kAvatarFiles{"avatar.json", "weights.safetensors", "template.glb",
                                                  "light.exr",   "pca.safetensors",     "preview.png"};

/// Nothing there, an empty folder, or an avatar and nothing else.
Status checkReplaceable(const std::filesystem::path& folder) {
    std::error_code failure;
    const std::filesystem::file_status status = std::filesystem::symlink_status(folder, failure);
    if (status.type() == std::filesystem::file_type::not_found) return {};
    if (status.type() != std::filesystem::file_type::directory) {
        return makeError(ErrorCode::InvalidArgument, folder.string(),
                         "expected a folder or nothing there, found a file");
    }
    for (std::filesystem::directory_iterator i(folder, failure), end; !failure && i != end; i.increment(failure)) {
        const std::string name = i->path().filename().string();
        if (std::find(kAvatarFiles.begin(), kAvatarFiles.end(), name) != kAvatarFiles.end()) continue;
        return makeError(ErrorCode::InvalidArgument, folder.string(),
                         fmt::format("expected a new name or an avatar to replace, found {} in it", name));
    }
    if (failure) return makeError(ErrorCode::Io, folder.string(), failure.message());
    return {};
}

/// Puts the finished `temporary` in the place of `folder`; what stood there is gone only once that is done.
Status takeItsPlace(const std::filesystem::path& temporary, const std::filesystem::path& folder) {
    namespace fs = std::filesystem;
    fs::path old = folder;
    old += fmt::format(".{}.old", getpid());
    std::error_code failure, ignored;
    const bool replaces = fs::exists(folder, failure);
    if (replaces) fs::rename(folder, old, failure);
    if (failure) return makeError(ErrorCode::Io, folder.string(), failure.message());
    fs::rename(temporary, folder, failure);
    if (failure) {
        if (replaces) fs::rename(old, folder, ignored);
        return makeError(ErrorCode::Io, folder.string(), failure.message());
    }
    ARS_TRY_STATUS(syncFolder(folder.parent_path()));
    if (replaces) fs::remove_all(old, ignored);
    return {};
}

} // namespace

Status writeAvatarFiles(const std::filesystem::path& folder, const AvatarModel& model, const Image& preview) {
    SafetensorsFile weights;
    model.network->tensors().store(weights);
    storeBase(weights, model.base);
    storeMaps(weights, model.maps);
    if (model.body) storeBody(weights, *model.body);
    if (model.light) {
        const auto side = static_cast<std::size_t>(model.light->size);
        weights.tensors["light.texels"] = Array::fromFloats({6, side, side, 3}, model.light->texels);
        ARS_TRY_STATUS(writeLight(folder / "light.exr", *model.light));
    }
    ARS_TRY_STATUS(writeSafetensors(folder / "weights.safetensors", weights));
    ARS_TRY_STATUS(writeRiggedGlb(folder / "template.glb", rigFromTemplate(model.mesh)));
    if (model.pca) ARS_TRY_STATUS(writePosePca(folder / "pca.safetensors", *model.pca));
    if (preview.width > 0) ARS_TRY_STATUS(writePng(folder / "preview.png", preview));
    // Last: a folder with an avatar.json is whole.
    // A name that is no UTF-8 must not cost the avatar.
    const nlohmann::ordered_json json = specToJson(model.spec, model.maps);
    return writeFileAtomic(folder / "avatar.json",
                           json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n");
}

Status writeAvatar(const std::filesystem::path& folder, const AvatarModel& model, const Image& preview) {
    std::error_code failure;
    std::filesystem::path whole = std::filesystem::absolute(folder, failure).lexically_normal();
    if (!whole.has_filename()) whole = whole.parent_path(); // "anna.avatar/"
    ARS_TRY_STATUS(checkReplaceable(whole));
    std::filesystem::path temporary = whole;
    temporary += fmt::format(".{}.tmp", getpid());
    std::filesystem::remove_all(temporary, failure);
    std::filesystem::create_directories(temporary, failure);
    if (failure) return makeError(ErrorCode::Io, temporary.string(), failure.message());
    Status status = writeAvatarFiles(temporary, model, preview);
    if (status) status = syncTree(temporary);
    if (status) status = takeItsPlace(temporary, whole);
    if (!status) std::filesystem::remove_all(temporary, failure);
    return status;
}

Result<AvatarModel> readAvatar(const std::filesystem::path& folder) {
    AvatarModel model;
    ARS_TRY_STATUS(readSpec(folder / "avatar.json", model.spec, model.maps));
    ARS_TRY(model.mesh, readWeightedTemplate(folder / "template.glb"));
    const std::filesystem::path path = folder / "weights.safetensors";
    ARS_TRY(SafetensorsFile weights, readSafetensors(path));
    const auto fill = [&]() -> Status {
        ARS_TRY_STATUS(takeMaps(weights, model.maps));
        if (weights.tensors.contains("body.vertices")) {
            BodyModel body;
            ARS_TRY_STATUS(takeBody(weights, model.mesh.skeleton(), body));
            model.body = std::make_shared<BodyModel>(std::move(body));
        }
        ARS_TRY_STATUS(completeAvatar(model, 1));
        ARS_TRY_STATUS(model.network->tensors().load(weights));
        if (model.base.geometry.defined()) {
            ARS_TRY_STATUS(takeBaseTensor(weights, "base.geometry", model.base.geometry));
            ARS_TRY_STATUS(takeBaseTensor(weights, "base.materials", model.base.materials));
            ARS_TRY_STATUS(takeBaseTensor(weights, "base.colors", model.base.colors));
        }
        return takeLight(weights, model.light);
    };
    if (Status status = fill(); !status) return atPlace(status.error(), path.string());
    if (std::filesystem::exists(folder / "pca.safetensors")) {
        ARS_TRY(model.pca, readPosePca(folder / "pca.safetensors"));
    }
    return model;
}

} // namespace ars
