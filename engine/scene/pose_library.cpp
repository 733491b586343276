#include "engine/scene/pose_library.h"

#include "engine/core/file.h"
#include "engine/rig/joint_names.h"
#include "engine/scene/project.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <map>

namespace ars {
namespace fs = std::filesystem;
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxPoseBytes = 4u << 20; ///< a pose of a few hundred joints has some ten thousand
constexpr double kMaxDegrees = 36000.0;
constexpr double kMaxMetres = 1000.0;
constexpr double kMaxCoefficient = 100.0;

struct BuiltIn {
    const char* name;
    const char* label;
    const char* json;
};
const BuiltIn kBuiltIn[]{
    {"rest", "Rest", R"({"rotations": {}})"},
    {"canonical", "Canonical", R"({"rotations": {"left_hip": [0, 0, 25], "right_hip": [0, 0, -25]}})"},
};

Error wrong(std::string place, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(place), std::move(message));
}

/// `count` finite numbers within a bound.
Result<std::vector<double>> numbersOf(const Json& json, const std::string& place, std::size_t count, double bound) {
    if (!json.is_array() || json.size() != count) {
        return wrong(place, fmt::format("expected a list of {} numbers, found {}", count,
                                        json.is_array() ? fmt::format("{}", json.size()) : json.type_name()));
    }
    std::vector<double> numbers;
    for (const Json& entry : json) {
        const double value = entry.is_number() ? entry.get<double>() : std::nan("");
        if (!(std::abs(value) <= bound)) return wrong(place, fmt::format("expected numbers within +-{:g}", bound));
        numbers.push_back(value);
    }
    return numbers;
}

bool isSmplx(const Skeleton& skeleton) {
    if (skeleton.jointCount() != kSmplxJointCount) return false;
    for (int j = 0; j < kSmplxJointCount; ++j) {
        if (skeleton.names[static_cast<std::size_t>(j)] != smplxJointName(j)) return false;
    }
    return true;
}

/// Where the rotation of a named joint goes: the joint of this name, or the first that does what a SMPL-X joint of this
/// name does. -1: nowhere.
struct Target {
    int joint = -1;
    bool turned = false; ///< the rotation is about model axes, not the joint's own
};
Target targetOf(const Skeleton& skeleton, const std::vector<int>& meanings, const std::string& name) {
    if (const int same = skeleton.find(name); same >= 0) return {same, false};
    const int meaning = smplxJointIndex(name);
    const auto found = std::find(meanings.begin(), meanings.end(), meaning);
    if (meaning < 0 || found == meanings.end()) return {};
    return {static_cast<int>(found - meanings.begin()), true};
}

Status readRotations(const Json& json, const Skeleton& skeleton, Pose& pose) {
    if (!json.is_object()) {
        return wrong("rotations", fmt::format("expected an object of joint names, found {}", json.type_name()));
    }
    const bool smplx = isSmplx(skeleton);
    std::vector<int> meanings;
    if (!smplx) meanings = smplxJointsForNames(skeleton.names);
    std::size_t used = 0;
    for (const auto& item : json.items()) {
        const std::string place = fmt::format("rotations: \"{}\"", item.key());
        ARS_TRY(const std::vector<double> degrees, numbersOf(item.value(), place, 3, kMaxDegrees));
        const Target target = targetOf(skeleton, meanings, item.key());
        if (target.joint < 0 && smplx) return wrong(place, "there is no joint of this name");
        if (target.joint < 0) continue;
        const auto j = static_cast<std::size_t>(target.joint);
        glm::quat rotation = quatFromAxisAngle(glm::radians(glm::vec3(degrees[0], degrees[1], degrees[2])));
        if (target.turned && !skeleton.restOrientations.empty()) {
            const glm::quat rest = skeleton.restOrientations[j];
            rotation = glm::normalize(glm::inverse(rest) * rotation * rest);
        }
        pose.rotations[j] = rotation;
        ++used;
    }
    if (used == 0 && !json.empty()) {
        return makeError(ErrorCode::Unsupported, "rotations", "the avatar has none of the pose's joints");
    }
    return {};
}

Status readExpression(const Json& json, Pose& pose) {
    if (!json.is_array() || json.size() > 300) return wrong("expression", "expected a list of at most 300 numbers");
    ARS_TRY(const std::vector<double> numbers, numbersOf(json, "expression", json.size(), kMaxCoefficient));
    pose.expression.assign(numbers.begin(), numbers.end());
    return {};
}

std::string labelOf(const std::string& name) {
    std::string label = name;
    std::replace(label.begin(), label.end(), '_', ' ');
    if (!label.empty()) label[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(label[0])));
    return label;
}

/// The JSON files of a folder by name; none where it does not exist.
void addFolder(const fs::path& folder, bool user, std::map<std::string, PoseLibraryEntry>& entries) {
    std::error_code failure;
    for (fs::directory_iterator it(folder, failure), end; !failure && it != end; it.increment(failure)) {
        if (it->path().extension() != ".json") continue;
        const std::string name = it->path().stem().string();
        entries[name] = {name, labelOf(name), it->path(), user};
    }
}

Status checkName(std::string_view name) {
    const bool sound = !name.empty() && name.size() <= 100 && name.front() != '.' &&
                       name.find_first_of(std::string_view("/\\\0", 3)) == std::string_view::npos;
    if (sound) return {};
    return wrong("name", fmt::format("expected a file name without slashes, found \"{}\"", name));
}

} // namespace

fs::path userPoseFolder() { return stateFolder() / "poses"; }

std::vector<PoseLibraryEntry> poseLibrary() {
    std::map<std::string, PoseLibraryEntry> built, own;
    for (const BuiltIn& pose : kBuiltIn) built[pose.name] = {pose.name, pose.label, {}, false};
    if (const auto resources = resourceFolder(); resources) addFolder(resources.value() / "poses", false, built);
    addFolder(userPoseFolder(), true, own);
    std::vector<PoseLibraryEntry> entries;
    for (auto& [name, entry] : built) {
        if (own.count(name) == 0) entries.push_back(std::move(entry));
    }
    for (auto& [name, entry] : own) entries.push_back(std::move(entry));
    return entries;
}

Result<NamedPose> libraryPose(std::string_view name, const Skeleton& skeleton) {
    std::vector<std::string> names;
    for (const PoseLibraryEntry& entry : poseLibrary()) {
        names.push_back(entry.name);
        if (entry.name != name) continue;
        if (!entry.file.empty()) return readPoseFile(entry.file, skeleton);
        for (const BuiltIn& pose : kBuiltIn) {
            if (name != pose.name) continue;
            ARS_TRY(NamedPose result, parsePose(pose.json, skeleton));
            result.name = pose.name;
            result.label = pose.label;
            return result;
        }
    }
    return makeError(ErrorCode::NotFound, "pose library",
                     fmt::format("there is no pose \"{}\"; there are {}", name, fmt::join(names, ", ")));
}

Result<NamedPose> parsePose(std::string_view text, const Skeleton& skeleton) {
    if (text.size() > kMaxPoseBytes) {
        return makeError(ErrorCode::LimitExceeded, "pose",
                         fmt::format("{} bytes, at most {} are read", text.size(), kMaxPoseBytes));
    }
    const Json json = Json::parse(text, nullptr, false);
    if (json.is_discarded()) return wrong("pose", "expected JSON, found something else");
    if (!json.is_object() || !json.contains("rotations")) {
        return wrong("pose", "expected a JSON object with \"rotations\"");
    }
    if (json.contains("pose") && json["pose"] != 1) {
        return makeError(ErrorCode::Unsupported, "pose", "is of a newer format than this program reads (1)");
    }
    NamedPose result;
    result.pose = restPose(skeleton.jointCount());
    if (json.contains("label") && json["label"].is_string()) result.label = json["label"].get<std::string>();
    ARS_TRY_STATUS(readRotations(json["rotations"], skeleton, result.pose));
    if (json.contains("translation")) {
        ARS_TRY(const std::vector<double> metres, numbersOf(json["translation"], "translation", 3, kMaxMetres));
        result.pose.translation = glm::vec3(metres[0], metres[1], metres[2]);
        result.hasTranslation = true;
    }
    if (json.contains("expression")) {
        ARS_TRY_STATUS(readExpression(json["expression"], result.pose));
        result.hasExpression = true;
    }
    return result;
}

Result<NamedPose> readPoseFile(const fs::path& path, const Skeleton& skeleton) {
    ARS_TRY(const std::string text, readTextFile(path));
    auto read = parsePose(text, skeleton);
    if (!read) {
        Error error = atPlace(std::move(read).error(), path.string());
        if (error.code == ErrorCode::InvalidArgument) error.code = ErrorCode::BadFile;
        return error;
    }
    NamedPose pose = std::move(read).value();
    pose.name = path.stem().string();
    if (pose.label.empty()) pose.label = labelOf(pose.name);
    return pose;
}

std::string poseToJson(const Pose& pose, const Skeleton& skeleton, std::string_view label) {
    // Whole millionths: far below what is seen, and readable.
    const auto rounded = [](double value) { return std::round(value * 1e6) / 1e6 + 0.0; };
    Json json;
    json["pose"] = 1;
    if (!label.empty()) json["label"] = std::string(label);
    json["rotations"] = Json::object();
    const std::size_t joints = std::min(pose.rotations.size(), skeleton.names.size());
    for (std::size_t j = 0; j < joints; ++j) {
        const glm::dvec3 degrees = glm::degrees(glm::dvec3(axisAngleFromQuat(pose.rotations[j])));
        if (glm::length(degrees) < 1e-5) continue;
        json["rotations"][skeleton.names[j]] = {rounded(degrees.x), rounded(degrees.y), rounded(degrees.z)};
    }
    json["translation"] = {rounded(pose.translation.x), rounded(pose.translation.y), rounded(pose.translation.z)};
    if (!pose.expression.empty()) json["expression"] = pose.expression;
    return json.dump(2) + "\n";
}

Result<fs::path> saveLibraryPose(std::string_view name, const Pose& pose, const Skeleton& skeleton) {
    ARS_TRY_STATUS(checkName(name));
    const fs::path path = userPoseFolder() / (std::string(name) + ".json");
    ARS_TRY_STATUS(writeFileAtomic(path, poseToJson(pose, skeleton, labelOf(std::string(name)))));
    return path;
}

} // namespace ars
