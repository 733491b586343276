#pragma once

#include "engine/core/error.h"
#include "engine/rig/pose.h"
#include "engine/rig/skeleton.h"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// Named poses as small JSON files:
/// `{"pose": 1, "label": "Wave", "rotations": {"left_elbow": [x, y, z], ...}, "translation": [x, y, z],
///   "expression": [...]}` with rotation vectors in degrees, relative to the parent, in the joint's rest axes, and
/// metres. Joints that are not named stay at rest; all keys but "rotations" may be missing.
struct NamedPose {
    std::string name;  ///< of the file, without ending
    std::string label; ///< for people
    Pose pose;         ///< for the skeleton that it was read for
    bool hasTranslation = false;
    bool hasExpression = false;
};

/// One entry of the library; reading is left to readPoseFile.
struct PoseLibraryEntry {
    std::string name;
    std::string label;
    std::filesystem::path file; ///< empty: made by the program ("rest", "canonical")
    bool ownedByUser = false;   ///< may be replaced and deleted
};

/// The poses that the program brings along (resources/poses) and the user's (stateFolder()/poses), in the order of
/// menus: built-in ones first, each kind by name; a file of the user's hides a built-in one of the same name.
std::vector<PoseLibraryEntry> poseLibrary();
/// Where the user's poses lie.
std::filesystem::path userPoseFolder();

/// A pose of the library by name, for a skeleton. NotFound lists the names; Unsupported when a pose of SMPL-X joints
/// fits no joint of the skeleton.
Result<NamedPose> libraryPose(std::string_view name, const Skeleton& skeleton);

/// Pose from JSON text. Joints that the skeleton does not have are InvalidArgument for SMPL-X skeletons, left out for
/// others (by their own name or, failing that, by what joint of SMPL-X they move); errors name the key.
Result<NamedPose> parsePose(std::string_view json, const Skeleton& skeleton);
/// The same of a file, with the path in front of errors; `name` is the file's.
Result<NamedPose> readPoseFile(const std::filesystem::path& path, const Skeleton& skeleton);

/// JSON text that parsePose reads back to within 1e-5 degrees; rest joints are left out.
std::string poseToJson(const Pose& pose, const Skeleton& skeleton, std::string_view label = {});
/// Writes a pose of the user's into the library. InvalidArgument for a name that is no file name.
Result<std::filesystem::path> saveLibraryPose(std::string_view name, const Pose& pose, const Skeleton& skeleton);

} // namespace ars
