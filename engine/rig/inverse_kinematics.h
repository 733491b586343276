#pragma once

#include "engine/core/error.h"
#include "engine/rig/pose.h"
#include "engine/rig/skeleton.h"

#include <glm/glm.hpp>

#include <span>
#include <vector>

namespace ars {

/// Range of motion of one joint, in model axes and radians.
///
/// The local rotation is R = exp([s]) exp([a t]): first a twist t about the bone's axis a (x, y or z of the model),
/// then a swing s perpendicular to it. Component `twistAxis` of the bounds limits t, the other two limit s.
struct JointLimit {
    int twistAxis = 0;        ///< 0, 1, 2: x, y, z
    glm::vec3 minimum{-3.2f}; ///< radians, not above 0
    glm::vec3 maximum{3.2f};  ///< radians, not below 0
    float stiffness = 1.0f;   ///< above 1: moves less than its neighbours; 0 is not allowed
};

/// Limits of the 55 SMPL-X joints: elbows and knees bend one way, fingers curl, the rest have swing and twist ranges
/// after the tables of the American Academy of Orthopaedic Surgeons (Joint Motion, 1965) and Norkin & White
/// (Measurement of Joint Motion), turned into SMPL-X's T-pose axes; what those tables give for spine and neck as a
/// whole is shared between the joints.
std::span<const JointLimit> smplxJointLimits();

/// The coordinates that a JointLimit bounds: the twist in component `twistAxis`, the swing in the others. Radians.
glm::vec3 limitCoordinates(const JointLimit& limit, const glm::quat& rotation);
glm::quat rotationFromCoordinates(const JointLimit& limit, const glm::vec3& coordinates);

struct IkOptions {
    /// First joint that turns; -1: defaultChainRoot. Must be an ancestor of the dragged joint.
    int chainRoot = -1;
    /// The dragged joint keeps its orientation in the world, as far as its own limits let it.
    bool keepEndOrientation = false;
    /// One per joint; empty: smplxJointLimits() for SMPL-X skeletons, none for others.
    std::span<const JointLimit> limits;
    bool useLimits = true;
    float toleranceM = 1e-4f; ///< good enough, metres
    int maxIterations = 60;   ///< a limb needs 2 to 20
};

struct IkResult {
    float residualM = 0.0f; ///< distance between the joint and its target
    int iterations = 0;
    bool reached = false; ///< residualM <= toleranceM
};

/// The joint from which a drag of `joint` turns by default: shoulder for elbow, wrist and knuckles, hip for leg and
/// foot, the finger's own base for its outer joints, lowest spine joint for torso, neck and head. On other skeletons
/// the third joint above, or the nearest one below a branching. -1 for a root, which can only be moved.
int defaultChainRoot(const Skeleton& skeleton, int joint);

/// Turns the joints from the chain's root down to the parent of `joint` so that `joint` comes to `targetWorld`; all
/// other local rotations stay bit for bit. A root joint moves the whole body instead (Pose::translation).
///
/// Damped least squares (Levenberg-Marquardt) on swing and twist coordinates with the joint limits as an active set,
/// from the present pose: the smallest change that gets there, so that a drag is continuous. A target out of reach is
/// pulled back to the limb's full length, and the limb ends straight, pointing at it; one that only the limits keep
/// away is approached as far as they let, and tried again from two other starts. A joint that is outside its limits
/// when the drag starts may stay there but goes no further out.
///
/// @return InvalidArgument for joints, roots, limits or targets that do not fit
Result<IkResult> solveIk(const Skeleton& skeleton, Pose& pose, int joint, const glm::vec3& targetWorld,
                         const IkOptions& options = {});

} // namespace ars
