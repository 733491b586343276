#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/bvh.h"
#include "engine/io/gltf.h"
#include "engine/rig/motion.h"
#include "engine/rig/skeleton.h"

#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// An animated skeleton of any rig, as its file has it: the file's axes and length unit.
struct SourceClip {
    std::string name;
    std::string format; ///< "bvh" or "gltf"
    Skeleton skeleton;  ///< rest positions and orientations in the file's world
    double framesPerSecond = 30.0;
    std::size_t frameCount = 0;
    std::vector<glm::quat> worldRotations; ///< (frameCount, J) orientation of each joint in the file's world
    std::vector<glm::vec3> worldPositions; ///< (frameCount, J)

    std::span<const glm::quat> rotations(std::size_t frame) const;
    std::span<const glm::vec3> positions(std::size_t frame) const;
};

/// A BVH file as a clip. The rest pose is all angles zero. Position channels place the root; elsewhere they count only
/// where they travel by more than 1 % of the skeleton, so that rigs with a reference joint work and bones keep their
/// length. BadFile for an impossible rate, LimitExceeded when frames x joints do not fit.
Result<SourceClip> clipFromBvh(const BvhFile& file, const ReadLimits& limits = defaultReadLimits());

/// One animation of a glTF document, sampled at a rate (STEP, LINEAR and CUBICSPLINE keys). Joints are those of the
/// largest skin and the nodes above them; without a skin, the animated nodes and those above them. The rest pose is the
/// bind pose. `animation` is a name or an index in decimal; empty: the first. NotFound lists the names that there are.
Result<SourceClip> clipFromGltf(const GltfDocument& document, std::string_view animation = {},
                                double framesPerSecond = 30.0, const ReadLimits& limits = defaultReadLimits());

/// Which joints of a rig move which joints of SMPL-X: a readable JSON file.
///
/// ```
/// { "name": "xsens", "about": "Hips, Chest .. Chest4, RightCollar ...",
///   "up": "y",                     optional: y, z, -y; else told from the rest pose
///   "metres_per_unit": 0.01,       optional: else leg lengths are made equal
///   "joints": { "pelvis": "Hips", "spine3": ["Chest3", "Chest4"], ... } }
/// ```
/// A list is a chain from the root outwards: the joint begins where the first one is and turns as the last one does.
/// Names are compared without case, namespaces ("mixamorig:") and separators; SMPL-X joints may be left out.
struct RetargetMap {
    std::string name;
    std::string about;
    UpAxis up = UpAxis::Auto;
    double metresPerUnit = 0.0;                                    ///< 0: leg lengths are made equal
    std::array<std::vector<std::string>, kSmplxJointCount> joints; ///< by SMPL-X joint
};

/// BadFile with the key for JSON that is not a map, names that are no SMPL-X joints, lengths that are not positive.
Result<RetargetMap> parseRetargetMap(std::span<const std::byte> json);
Result<RetargetMap> readRetargetMap(const std::filesystem::path& path);

/// Every map in resources/retarget, by file name.
Result<std::vector<RetargetMap>> readRetargetMaps();

/// A map made by recognising the rig's joint names (joint_names.h).
RetargetMap recognisedMap(const Skeleton& source);

/// The map that covers most of the body, then most of hands and face; the recognised names compete with the body alone.
/// A map is taken only if it has the pelvis, hips, knees, shoulders and elbows: else NotFound says which joints are
/// missing in the best one.
Result<RetargetMap> chooseRetargetMap(const Skeleton& source, std::span<const RetargetMap> maps);

/// What a transfer did, for people and tests.
struct RetargetReport {
    std::string mapName;
    int mappedJoints = 0;             ///< of 55
    int mappedBodyJoints = 0;         ///< of the first 22
    std::vector<std::string> missing; ///< SMPL-X joints that nothing moves
    std::vector<std::string>
        unused;                ///< joints of the file whose turns are lost: they move nothing, nor does one below them
    UpAxis up = UpAxis::Auto;  ///< of the file
    glm::vec3 fileFront{0.0f}; ///< the file's axis that became +z
    double metresPerUnit = 0.0;
    float floorShiftM = 0.0f;              ///< added to every frame's height
    std::size_t skippedFrames = 0;         ///< lead-in frames that were dropped
    std::vector<std::string> rigidCollars; ///< collars that the recording holds still, so that the arm moves them
    bool firstFrameIsRest = false;         ///< the zero pose was no standing person, so frame 0 gave the rest pose
};

/// Settings of a transfer.
struct RetargetOptions {
    UpAxis up = UpAxis::Auto;   ///< overrides the map and the rest pose
    double metresPerUnit = 0.0; ///< overrides the map; 0: leg lengths are made equal
    bool placeOnFloor = true;   ///< one shift for the whole clip: it stands on y = 0 (floorShift)
    bool startAtOrigin = true;  ///< one shift for the whole clip: the pelvis starts above x = z = 0
    /// Many motion libraries begin with a T-pose that blends or jumps into the motion: drop those frames (at most 12).
    bool skipLeadIn = true;
    /// Height of the soles in the target's rest pose, metres. Unset: 3 cm below the lower foot joint.
    std::optional<float> soleHeightM;
};

/// Transfers a clip onto a SMPL-X skeleton.
///
/// With D_j the world rotation of source joint j since the source's rest pose, C the turn from the file's axes to ours
/// (found from hips and head: y up, +z front, +x left) and A_j the rotation that takes the target's rest bone to the
/// source's rest bone, the target's world rotation is C D_j C^-1 A_j. A_j is the smallest such rotation down each limb,
/// so that T-poses, A-poses and hanging arms all give the same limbs in space; torso, head and feet keep their own
/// shape (their bones differ between rigs by anatomy, not by pose) unless the whole rest pose leans or turns by more
/// than 20 degrees. Collars follow a T-pose convention: with hanging arms they slope 11 degrees less steeply up than
/// with arms held out, and where a recording never moves them they swing with the arm by that much (scapulohumeral
/// rhythm: Inman, Saunders & Abbott 1944). Where knuckles are known, the palm is aligned and half of its twist given to
/// the forearm. Spine joints that the map leaves out share the rotation between their mapped neighbours. The hips'
/// middle follows the source's, scaled.
///
/// InvalidArgument for a target that is not SMPL-X; NotFound when the map lacks joints that a transfer needs; BadFile
/// for a clip without frames or with legs of no length.
Result<Motion> retarget(const SourceClip& clip, const RetargetMap& map, const Skeleton& target,
                        const RetargetOptions& options = {}, RetargetReport* report = nullptr);

/// Shift that makes a motion stand on y = 0: feet by their rest height above the soles, the rest of the body by a
/// thickness a joint. A tenth of the frames may dip below the floor, by 3 cm at most (toes that a recording keeps rigid
/// do so at every step); the rest stands on it or above, so jumps stay jumps. What `placeOnFloor` adds.
float floorShift(const Motion& motion, const Skeleton& target, std::optional<float> soleHeightM = {});

} // namespace ars
