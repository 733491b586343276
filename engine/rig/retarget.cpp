#include "engine/rig/retarget.h"

#include "engine/rig/retarget_joints.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace ars {
namespace {

// SMPL-X joints by name, for the rules below.
enum Smplx {
    Pelvis = 0,
    LeftHip = 1,
    RightHip = 2,
    Spine1 = 3,
    LeftKnee = 4,
    RightKnee = 5,
    Spine2 = 6,
    LeftAnkle = 7,
    RightAnkle = 8,
    Spine3 = 9,
    LeftFoot = 10,
    RightFoot = 11,
    Neck = 12,
    LeftCollar = 13,
    RightCollar = 14,
    Head = 15,
    LeftShoulder = 16,
    RightShoulder = 17,
    LeftElbow = 18,
    RightElbow = 19,
    LeftWrist = 20,
    RightWrist = 21,
    Jaw = 22,
    LeftHand = 25,
    RightHand = 40
};
constexpr int kHandJoints = 15;

/// Rest bones that differ by less than this differ by anatomy, by more in pose.
constexpr float kAnatomyRad = 0.349f; // 20 degrees
/// How far a collar swings between an arm held out and one that hangs or is raised.
constexpr float kCollarSwingRad = 0.19f;
/// Frames of a clip that may dip below the floor, and how far.
constexpr double kDippingShare = 0.1;
constexpr float kDeepestDipM = 0.03f;
constexpr std::size_t kLongestLeadIn = 12;
constexpr float kFarthestM = 1e6f;

std::size_t at(int joint) { return static_cast<std::size_t>(joint); }

float angleBetween(const glm::vec3& a, const glm::vec3& b) {
    return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
}

/// The smallest rotation that takes direction a to direction b; none where either has no length.
glm::quat smallestRotation(const glm::vec3& a, const glm::vec3& b) {
    const float lengths = glm::length(a) * glm::length(b);
    if (!(lengths > 1e-12f)) return {1, 0, 0, 0};
    const float cosine = glm::dot(a, b) / lengths;
    if (cosine < -0.999999f) { // opposite: any perpendicular axis
        const glm::vec3 side = std::abs(a.x) < 0.9f * glm::length(a) ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0);
        return glm::angleAxis(3.14159265f, glm::normalize(glm::cross(a, side)));
    }
    const glm::vec3 axis = glm::cross(a, b) / lengths;
    return glm::normalize(glm::quat(1.0f + cosine, axis.x, axis.y, axis.z));
}

/// The signed axis nearest to a direction, among those perpendicular to `normal` (0: all).
glm::vec3 nearestAxis(const glm::vec3& direction, const glm::vec3& normal = glm::vec3(0.0f)) {
    glm::vec3 best(0.0f);
    float largest = -1.0f;
    for (int i = 0; i < 3; ++i) {
        if (std::abs(normal[i]) > 0.5f || std::abs(direction[i]) <= largest) continue;
        largest = std::abs(direction[i]);
        best = glm::vec3(0.0f);
        best[i] = direction[i] < 0.0f ? -1.0f : 1.0f;
    }
    return best;
}

/// Positions and orientations that count as the source's rest pose.
struct SourceRest {
    std::vector<glm::vec3> positions;
    std::vector<glm::quat> orientations;
    bool fromFirstFrame = false;
};

/// One transfer: everything that does not change from frame to frame.
struct Transfer {
    MappedJoints mapped;
    SourceRest rest;
    glm::mat3 toOurs{1.0f}; ///< C: the file's axes to ours
    glm::quat toOursQuat{1, 0, 0, 0};
    glm::vec3 upInFile{0.0f};
    std::array<glm::quat, kSmplxJointCount> align; ///< A
    float scale = 1.0f;                            ///< file units to metres
    std::array<bool, 2> rigidCollar{};             ///< left, right

    bool has(int joint) const { return mapped.first[at(joint)] >= 0; }
    /// Rest position of a mapped joint, file units, our axes.
    glm::vec3 position(int joint) const { return toOurs * rest.positions[at(mapped.first[at(joint)])]; }
    glm::vec3 bone(int joint, int child) const { return position(child) - position(joint); }
};

glm::vec3 rawPosition(const Transfer& transfer, std::span<const glm::vec3> positions, int joint) {
    return positions[at(transfer.mapped.first[at(joint)])];
}

/// From the hips' middle to the highest joint of the trunk that is mapped.
glm::vec3 trunkDirection(const Transfer& transfer, std::span<const glm::vec3> p) {
    const glm::vec3 hips = 0.5f * (rawPosition(transfer, p, LeftHip) + rawPosition(transfer, p, RightHip));
    const glm::vec3 shoulders =
        0.5f * (rawPosition(transfer, p, LeftShoulder) + rawPosition(transfer, p, RightShoulder));
    return shoulders - hips;
}

/// Whether joints stand as a person does: trunk over legs, hips side by side.
bool looksUpright(const Transfer& transfer, std::span<const glm::vec3> p) {
    const glm::vec3 trunk = trunkDirection(transfer, p);
    const glm::vec3 hips = 0.5f * (rawPosition(transfer, p, LeftHip) + rawPosition(transfer, p, RightHip));
    const glm::vec3 knees = 0.5f * (rawPosition(transfer, p, LeftKnee) + rawPosition(transfer, p, RightKnee));
    const glm::vec3 across = rawPosition(transfer, p, LeftHip) - rawPosition(transfer, p, RightHip);
    const float size = glm::length(trunk);
    if (!(size > 1e-9f) || !(glm::length(hips - knees) > 0.1f * size) || !(glm::length(across) > 0.02f * size))
        return false;
    return angleBetween(trunk, hips - knees) < 1.05f && std::abs(angleBetween(trunk, across) - 1.5708f) < 0.52f;
}

/// The zero pose when it is a standing person, else the first frame.
SourceRest chooseRest(const SourceClip& clip, const Transfer& transfer) {
    SourceRest rest{clip.skeleton.restPositions, clip.skeleton.restOrientations, false};
    if (rest.orientations.empty()) rest.orientations.assign(rest.positions.size(), glm::quat(1, 0, 0, 0));
    if (looksUpright(transfer, rest.positions) || !looksUpright(transfer, clip.positions(0))) return rest;
    rest.positions.assign(clip.positions(0).begin(), clip.positions(0).end());
    rest.orientations.assign(clip.rotations(0).begin(), clip.rotations(0).end());
    rest.fromFirstFrame = true;
    return rest;
}

glm::vec3 upVector(UpAxis up) {
    if (up == UpAxis::Z) return {0, 0, 1};
    return {0, up == UpAxis::NegativeY ? -1.0f : 1.0f, 0};
}

/// Finds C: up from what is asked for or from the trunk, left from the hips.
void findAxes(Transfer& transfer, UpAxis wanted) {
    const auto& p = transfer.rest.positions;
    const glm::vec3 up = wanted == UpAxis::Auto ? nearestAxis(trunkDirection(transfer, p)) : upVector(wanted);
    const glm::vec3 across = rawPosition(transfer, p, LeftHip) - rawPosition(transfer, p, RightHip);
    const glm::vec3 left = nearestAxis(across, up);
    const glm::vec3 front = glm::cross(left, up);
    transfer.upInFile = up;
    transfer.toOurs = glm::transpose(glm::mat3(left, up, front));
    transfer.toOursQuat = glm::normalize(glm::quat_cast(transfer.toOurs));
}

/// A of the torso: left to left exactly; the trunk's lean only where it is a matter of pose.
glm::quat alignTorso(const Transfer& transfer, const Skeleton& target) {
    const auto& t = target.restPositions;
    const glm::vec3 left = transfer.bone(RightHip, LeftHip);
    glm::quat turn = smallestRotation(t[LeftHip] - t[RightHip], left);
    const glm::vec3 axis = glm::normalize(left);
    const auto flat = [&](const glm::vec3& v) { return v - glm::dot(v, axis) * axis; };
    const glm::vec3 ours = flat(turn * (0.5f * (t[LeftShoulder] + t[RightShoulder] - t[LeftHip] - t[RightHip])));
    const glm::vec3 theirs = flat(0.5f * (transfer.position(LeftShoulder) + transfer.position(RightShoulder) -
                                          transfer.position(LeftHip) - transfer.position(RightHip)));
    if (angleBetween(ours, theirs) > kAnatomyRad) turn = smallestRotation(ours, theirs) * turn;
    return turn;
}

/// A of a joint whose bone must point as the source's: the parent's A, then the smallest turn of the bone.
glm::quat alignBone(const Transfer& transfer, const Skeleton& target, int joint, int child, const glm::quat& parent,
                    float atLeastRad = 0.0f) {
    if (!transfer.has(joint) || !transfer.has(child)) return parent;
    const glm::vec3 ours = parent * (target.restPositions[at(child)] - target.restPositions[at(joint)]);
    const glm::vec3 theirs = transfer.bone(joint, child);
    if (angleBetween(ours, theirs) < atLeastRad) return parent;
    return smallestRotation(ours, theirs) * parent;
}

/// Orthonormal frame of a hand: along the middle finger, across the knuckles.
glm::quat handFrame(const glm::vec3& along, const glm::vec3& across) {
    const glm::vec3 x = glm::normalize(along);
    const glm::vec3 y = glm::normalize(glm::cross(across, x));
    return glm::normalize(glm::quat_cast(glm::mat3(x, y, glm::cross(x, y))));
}

/// Angle by which a rotation turns about an axis of unit length.
float twistAngle(const glm::quat& q, const glm::vec3& axis) {
    const float angle = 2.0f * std::atan2(glm::dot(glm::vec3(q.x, q.y, q.z), axis), q.w);
    return std::remainder(angle, 6.2831853f);
}

/// Hand and forearm: the palm as the source's where its knuckles are known, half of that twist in the forearm.
void alignHand(Transfer& transfer, const Skeleton& target, int elbow, int wrist, int hand) {
    auto& align = transfer.align;
    align[at(wrist)] = align[at(elbow)];
    const int index = hand, middle = hand + 3, pinky = hand + 6;
    if (!transfer.has(wrist) || !transfer.has(index) || !transfer.has(middle) || !transfer.has(pinky)) return;
    const auto& t = target.restPositions;
    const glm::vec3 theirsAlong = transfer.bone(wrist, middle), theirsAcross = transfer.bone(pinky, index);
    const glm::vec3 oursAlong = t[at(middle)] - t[at(wrist)], oursAcross = t[at(index)] - t[at(pinky)];
    const auto flat = [](const glm::vec3& along, const glm::vec3& across) {
        return angleBetween(along, across) < 0.35f;
    };
    if (!(glm::length(theirsAlong) > 1e-9f) || !(glm::length(theirsAcross) > 1e-9f) || flat(theirsAlong, theirsAcross))
        return;
    align[at(wrist)] = handFrame(theirsAlong, theirsAcross) * glm::inverse(handFrame(oursAlong, oursAcross));
    const glm::vec3 forearm = glm::normalize(t[at(wrist)] - t[at(elbow)]);
    const float twist = twistAngle(glm::inverse(align[at(elbow)]) * align[at(wrist)], forearm);
    align[at(elbow)] = align[at(elbow)] * glm::angleAxis(0.5f * twist, forearm);
}

void alignFingers(Transfer& transfer, const Skeleton& target, int wrist, int hand) {
    for (int base = hand; base < hand + kHandJoints; base += 3) {
        auto& align = transfer.align;
        align[at(base)] = alignBone(transfer, target, base, base + 1, align[at(wrist)], kAnatomyRad);
        align[at(base + 1)] = alignBone(transfer, target, base + 1, base + 2, align[at(base)], kAnatomyRad);
        align[at(base + 2)] = align[at(base + 1)];
    }
}

/// Feet stand on the floor in both rest poses: only a foot that points elsewhere is turned, about the vertical.
glm::quat alignFoot(const Transfer& transfer, const Skeleton& target, int knee, int ankle, int foot) {
    if (transfer.rest.fromFirstFrame) {
        return alignBone(transfer, target, ankle, foot, transfer.align[at(knee)]);
    }
    const glm::quat torso = transfer.align[Pelvis];
    if (!transfer.has(ankle) || !transfer.has(foot)) return torso;
    const auto flat = [](glm::vec3 v) { return v.y = 0.0f, v; };
    const glm::vec3 ours = flat(torso * (target.restPositions[at(foot)] - target.restPositions[at(ankle)]));
    const glm::vec3 theirs = flat(transfer.bone(ankle, foot));
    if (glm::length(theirs) < 0.3f * glm::length(transfer.bone(ankle, foot))) return torso;
    return angleBetween(ours, theirs) > kAnatomyRad ? smallestRotation(ours, theirs) * torso : torso;
}

/// Swing of a collar for an upper arm in the axes of the chest: our rest pose holds the arms out.
glm::quat collarSwing(const Skeleton& target, int side, const glm::quat& shoulderInChest) {
    const glm::vec3 rest = target.restPositions[at(LeftElbow + side)] - target.restPositions[at(LeftShoulder + side)];
    const float raised = (shoulderInChest * glm::normalize(rest)).y - glm::normalize(rest).y;
    return glm::angleAxis((side == 0 ? kCollarSwingRad : -kCollarSwingRad) * raised, glm::vec3(0, 0, 1));
}

void findAlignment(Transfer& transfer, const Skeleton& target) {
    auto& align = transfer.align;
    align.fill(alignTorso(transfer, target));
    for (const int side : {0, 1}) {
        const int hip = LeftHip + side, knee = LeftKnee + side, ankle = LeftAnkle + side, foot = LeftFoot + side;
        align[at(hip)] = alignBone(transfer, target, hip, knee, align[Pelvis]);
        align[at(knee)] = alignBone(transfer, target, knee, ankle, align[at(hip)]);
        align[at(ankle)] = alignFoot(transfer, target, knee, ankle, foot);
        align[at(foot)] = align[at(ankle)];
        const int shoulder = LeftShoulder + side, elbow = LeftElbow + side, wrist = LeftWrist + side;
        const int hand = side == 0 ? LeftHand : RightHand;
        align[at(shoulder)] = alignBone(transfer, target, shoulder, elbow, align[Spine3]);
        align[at(elbow)] = alignBone(transfer, target, elbow, wrist, align[at(shoulder)]);
        const glm::quat& chest = align[Spine3];
        align[at(LeftCollar + side)] = chest * collarSwing(target, side, glm::inverse(chest) * align[at(shoulder)]);
        alignHand(transfer, target, elbow, wrist, hand);
        alignFingers(transfer, target, wrist, hand);
    }
}

float legLength(const std::function<glm::vec3(int, int)>& bone, bool withShin) {
    float length = 0.0f;
    for (const int side : {0, 1}) {
        length += glm::length(bone(LeftHip + side, LeftKnee + side));
        if (withShin) length += glm::length(bone(LeftKnee + side, LeftAnkle + side));
    }
    return 0.5f * length;
}

Status findScale(Transfer& transfer, const Skeleton& target, double metresPerUnit) {
    const bool shins = transfer.has(LeftAnkle) && transfer.has(RightAnkle);
    const float theirs = legLength([&](int a, int b) { return transfer.bone(a, b); }, shins);
    const float ours =
        legLength([&](int a, int b) { return target.restPositions[at(b)] - target.restPositions[at(a)]; }, shins);
    if (!(theirs > 1e-9f) || !std::isfinite(theirs)) {
        return makeError(ErrorCode::BadFile, "", fmt::format("the legs of the skeleton are {} units long", theirs));
    }
    transfer.scale = metresPerUnit > 0.0 ? static_cast<float>(metresPerUnit) : ours / theirs;
    return {};
}

/// A spine joint that the map leaves out, or the neck: the mapped joint above it, and how much of its rotation to take.
struct Between {
    int next = -1;
    float share = 0.0f;
};

Between sharedRotation(const Transfer& transfer, int joint) {
    if (joint == Neck) return transfer.has(Head) ? Between{Head, 0.5f} : Between{};
    constexpr std::array kSpine{int(Spine1), int(Spine2), int(Spine3)};
    const auto self = std::find(kSpine.begin(), kSpine.end(), joint);
    if (self == kSpine.end()) return {};
    const auto next = std::find_if(self, kSpine.end(), [&](int j) { return transfer.has(j); });
    if (next == kSpine.end()) return {};
    return {*next, 1.0f / static_cast<float>(next - self + 1)};
}

/// C D C^-1 A of a mapped joint.
glm::quat targetRotation(const Transfer& transfer, std::span<const glm::quat> rotations, int joint) {
    const auto source = at(transfer.mapped.last[at(joint)]);
    const glm::quat delta = rotations[source] * glm::inverse(transfer.rest.orientations[source]);
    const glm::quat& c = transfer.toOursQuat;
    return glm::normalize(c * delta * glm::inverse(c) * transfer.align[at(joint)]);
}

/// Whether a source joint never turns against the chest's source by more than a degree.
bool holdsStill(const SourceClip& clip, const Transfer& transfer, int joint) {
    if (!transfer.has(joint) || !transfer.has(Spine3)) return !transfer.has(joint);
    const std::size_t self = at(transfer.mapped.last[at(joint)]), chest = at(transfer.mapped.last[Spine3]);
    for (std::size_t f = 0; f < clip.frameCount; ++f) {
        const auto now = clip.rotations(f);
        const glm::quat a = now[self] * glm::inverse(transfer.rest.orientations[self]);
        const glm::quat b = now[chest] * glm::inverse(transfer.rest.orientations[chest]);
        if (std::abs(glm::dot(a, b)) < 0.99996f) return false;
    }
    return true;
}

/// A collar that the recording holds rigid, moved by its arm instead.
glm::quat swungCollar(const Transfer& transfer, const Skeleton& target, std::span<const glm::quat> rotations, int side,
                      const glm::quat& chest) {
    const glm::quat shoulder = targetRotation(transfer, rotations, LeftShoulder + side);
    return chest * collarSwing(target, side, glm::inverse(chest) * shoulder);
}

Pose transferFrame(const Transfer& transfer, const Skeleton& target, std::span<const glm::quat> rotations,
                   std::span<const glm::vec3> positions) {
    Pose pose = restPose(kSmplxJointCount);
    std::array<glm::quat, kSmplxJointCount> world;
    for (int j = 0; j < kSmplxJointCount; ++j) {
        const int parent = smplxJointParent(j);
        const glm::quat above = parent < 0 ? glm::quat(1, 0, 0, 0) : world[at(parent)];
        if (const int side = j - LeftCollar; (side == 0 || side == 1) && transfer.rigidCollar[at(side)]) {
            world[at(j)] = swungCollar(transfer, target, rotations, side, above);
        } else if (transfer.has(j)) {
            world[at(j)] = targetRotation(transfer, rotations, j);
        } else if (const Between between = sharedRotation(transfer, j); between.next >= 0) {
            world[at(j)] = glm::slerp(above, targetRotation(transfer, rotations, between.next), between.share);
        } else {
            world[at(j)] = above;
        }
        glm::quat local = glm::normalize(glm::inverse(above) * world[at(j)]);
        pose.rotations[at(j)] = local.w < 0.0f ? -local : local;
    }
    const glm::vec3 source =
        0.5f * (rawPosition(transfer, positions, LeftHip) + rawPosition(transfer, positions, RightHip));
    const glm::vec3 pelvis = target.restPositions[Pelvis];
    const glm::vec3 hips = 0.5f * (target.restPositions[LeftHip] + target.restPositions[RightHip]) - pelvis;
    pose.translation = transfer.scale * (transfer.toOurs * source) - world[Pelvis] * hips - pelvis;
    return pose;
}

/// Rotations as quaternions have two signs: neighbours in time take the same.
void makeContinuous(std::vector<Pose>& frames) {
    for (std::size_t f = 1; f < frames.size(); ++f) {
        for (std::size_t j = 0; j < frames[f].rotations.size(); ++j) {
            glm::quat& q = frames[f].rotations[j];
            if (glm::dot(q, frames[f - 1].rotations[j]) < 0.0f) q = -q;
        }
    }
}

/// Whether arms and legs of a frame are as in the rest pose, to ten degrees.
bool standsAtRest(const SourceClip& clip, const Transfer& transfer, std::size_t frame) {
    const auto delta = [&](int joint) {
        const std::size_t source = at(transfer.mapped.last[at(joint)]);
        return clip.rotations(frame)[source] * glm::inverse(transfer.rest.orientations[source]);
    };
    for (int joint : {LeftShoulder, RightShoulder, LeftElbow, RightElbow, LeftHip, RightHip, LeftKnee, RightKnee}) {
        if (std::abs(glm::dot(delta(joint), delta(Pelvis))) < 0.985f) return false; // half of 20 degrees: cos 10
    }
    return true;
}

/// Largest way of a body joint from one frame to the next.
std::vector<float> frameSteps(const Motion& motion, const Skeleton& target) {
    std::vector<float> steps;
    std::vector<glm::mat4> before;
    for (const Pose& pose : motion.frames) {
        std::vector<glm::mat4> now = jointWorldMatrices(target, pose);
        float step = 0.0f;
        for (std::size_t j = 0; j < before.size() && j < Jaw; ++j) {
            step = std::max(step, glm::length(glm::vec3(now[j][3] - before[j][3])));
        }
        if (!before.empty()) steps.push_back(step);
        before = std::move(now);
    }
    return steps;
}

/// Frames at the start that stand in the rest pose and then rush into the motion: three times as fast as it is later.
std::size_t leadInFrames(const SourceClip& clip, const Transfer& transfer, const Motion& motion,
                         const Skeleton& target) {
    if (transfer.rest.fromFirstFrame || motion.frames.size() < 3 * kLongestLeadIn || !standsAtRest(clip, transfer, 0))
        return 0;
    const std::vector<float> steps = frameSteps(motion, target);
    std::vector<float> sorted = steps;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
    const float fast = 3.0f * sorted[sorted.size() / 2];
    std::size_t count = 0;
    while (count <= kLongestLeadIn && steps[count] > fast) ++count;
    return count <= kLongestLeadIn ? count : 0;
}

void moveToOrigin(Motion& motion, const Skeleton& target) {
    const glm::vec3 start = target.restPositions[Pelvis] + motion.frames.front().translation;
    for (Pose& pose : motion.frames) pose.translation -= glm::vec3(start.x, 0.0f, start.z);
}

/// Joints of the file that turn against their parent while neither they nor one below them moves anything of ours.
std::vector<std::string> unusedJoints(const SourceClip& clip, const Transfer& transfer) {
    const std::size_t joints = clip.skeleton.parents.size();
    std::vector<char> used(joints, 0), turns(joints, 0);
    for (int j = 0; j < kSmplxJointCount; ++j) {
        // What lies above a joint that is used turns it too.
        for (int source = transfer.mapped.last[at(j)]; source >= 0; source = clip.skeleton.parents[at(source)])
            used[at(source)] = 1;
    }
    const auto deltaOf = [&](std::size_t frame, std::size_t j) {
        return clip.rotations(frame)[j] * glm::inverse(transfer.rest.orientations[j]);
    };
    for (std::size_t f = 0; f < clip.frameCount; ++f) {
        for (std::size_t j = 0; j < joints; ++j) {
            const int parent = clip.skeleton.parents[j];
            if (used[j] || turns[j] || parent < 0) continue;
            turns[j] = std::abs(glm::dot(deltaOf(f, j), deltaOf(f, at(parent)))) < 0.99996f; // one degree
        }
    }
    std::vector<std::string> names;
    for (std::size_t j = 0; j < joints; ++j) {
        if (turns[j]) names.push_back(clip.skeleton.names[j]);
    }
    return names;
}

void fillReport(RetargetReport& report, const SourceClip& clip, const RetargetMap& map, const Transfer& transfer) {
    report = {};
    report.mapName = map.name;
    for (int j = 0; j < kSmplxJointCount; ++j) {
        if (transfer.has(j)) {
            ++report.mappedJoints;
            report.mappedBodyJoints += j < Jaw;
        } else {
            report.missing.emplace_back(smplxJointName(j));
        }
    }
    for (const int side : {0, 1}) {
        if (transfer.rigidCollar[at(side)]) report.rigidCollars.emplace_back(smplxJointName(LeftCollar + side));
    }
    report.unused = unusedJoints(clip, transfer);
    report.up = transfer.upInFile.z > 0.5f ? UpAxis::Z : transfer.upInFile.y < -0.5f ? UpAxis::NegativeY : UpAxis::Y;
    report.fileFront = glm::transpose(transfer.toOurs) * glm::vec3(0, 0, 1);
    report.metresPerUnit = transfer.scale;
    report.firstFrameIsRest = transfer.rest.fromFirstFrame;
}

Status checkInputs(const SourceClip& clip, const Skeleton& target) {
    const std::size_t joints = clip.skeleton.parents.size();
    if (clip.frameCount == 0 || joints == 0)
        return makeError(ErrorCode::BadFile, "", "a clip without frames or joints");
    if (clip.worldRotations.size() != clip.frameCount * joints ||
        clip.worldPositions.size() != clip.frameCount * joints || clip.skeleton.names.size() != joints ||
        clip.skeleton.restPositions.size() != joints) {
        return makeError(ErrorCode::InvalidArgument, "", "a clip whose lists differ in length");
    }
    if (target.jointCount() == kSmplxJointCount && target.restPositions.size() == kSmplxJointCount) return {};
    return makeError(
        ErrorCode::InvalidArgument, "",
        fmt::format("motions are played on SMPL-X skeletons of 55 joints, this one has {}", target.jointCount()));
}

Status checkFinite(const Motion& motion) {
    for (std::size_t f = 0; f < motion.frames.size(); ++f) {
        for (int j = 0; j < kSmplxJointCount; ++j) {
            const glm::quat& q = motion.frames[f].rotations[at(j)];
            if (std::abs(glm::length(q) - 1.0f) < 1e-3f) continue; // false for NaN too
            return makeError(ErrorCode::BadFile, fmt::format("frame {}", f),
                             fmt::format("{} has no finite rotation", smplxJointName(j)));
        }
        const float away = glm::length(motion.frames[f].translation);
        if (away <= kFarthestM) continue;
        return makeError(ErrorCode::BadFile, fmt::format("frame {}", f),
                         fmt::format("expected a person within {} m of the origin, found {} m", kFarthestM, away));
    }
    return {};
}

/// How far the surface of the resting body reaches below a joint, metres, where it is not a foot.
float thickness(int joint) {
    if (joint >= LeftHand) return 0.01f;
    switch (joint) {
    case LeftKnee:
    case RightKnee:
        return 0.05f;
    case LeftElbow:
    case RightElbow:
        return 0.04f;
    case LeftWrist:
    case RightWrist:
        return 0.03f;
    case LeftShoulder:
    case RightShoulder:
    case Neck:
        return 0.06f;
    default:
        return 0.1f;
    }
}

} // namespace

float floorShift(const Motion& motion, const Skeleton& target, std::optional<float> soleHeightM) {
    const auto& rest = target.restPositions;
    const float sole = soleHeightM.value_or(std::min(rest[LeftFoot].y, rest[RightFoot].y) - 0.03f);
    if (motion.frames.empty()) return 0.0f;
    std::vector<float> heights;
    heights.reserve(motion.frames.size());
    for (const Pose& pose : motion.frames) {
        float lowest = std::numeric_limits<float>::max();
        const std::vector<glm::mat4> world = jointWorldMatrices(target, pose);
        for (int j = 0; j < kSmplxJointCount; ++j) {
            const bool foot = j == LeftAnkle || j == RightAnkle || j == LeftFoot || j == RightFoot;
            const float below = foot ? rest[at(j)].y - sole : thickness(j);
            lowest = std::min(lowest, world[at(j)][3].y - below);
        }
        heights.push_back(lowest);
    }
    const auto few = heights.begin() + static_cast<std::ptrdiff_t>(kDippingShare * static_cast<double>(heights.size()));
    std::nth_element(heights.begin(), few, heights.end());
    return -std::min(*few, *std::min_element(heights.begin(), few + 1) + kDeepestDipM);
}

Result<Motion> retarget(const SourceClip& clip, const RetargetMap& map, const Skeleton& target,
                        const RetargetOptions& options, RetargetReport* report) {
    ARS_TRY_STATUS(checkInputs(clip, target));
    Transfer transfer;
    transfer.mapped = resolveMap(map, clip.skeleton);
    ARS_TRY_STATUS(checkMapped(transfer.mapped, map.name, clip.skeleton));
    transfer.rest = chooseRest(clip, transfer);
    findAxes(transfer, options.up != UpAxis::Auto ? options.up : map.up);
    ARS_TRY_STATUS(
        findScale(transfer, target, options.metresPerUnit > 0.0 ? options.metresPerUnit : map.metresPerUnit));
    findAlignment(transfer, target);
    for (const int side : {0, 1}) transfer.rigidCollar[at(side)] = holdsStill(clip, transfer, LeftCollar + side);
    Motion motion;
    motion.name = clip.name;
    motion.source = clip.format;
    motion.framesPerSecond = clip.framesPerSecond;
    motion.frames.reserve(clip.frameCount);
    for (std::size_t f = 0; f < clip.frameCount; ++f) {
        motion.frames.push_back(transferFrame(transfer, target, clip.rotations(f), clip.positions(f)));
    }
    ARS_TRY_STATUS(checkFinite(motion));
    makeContinuous(motion.frames);
    const std::size_t skipped = options.skipLeadIn ? leadInFrames(clip, transfer, motion, target) : 0;
    motion.frames.erase(motion.frames.begin(), motion.frames.begin() + static_cast<std::ptrdiff_t>(skipped));
    if (options.startAtOrigin) moveToOrigin(motion, target);
    const float shift = options.placeOnFloor ? floorShift(motion, target, options.soleHeightM) : 0.0f;
    for (Pose& pose : motion.frames) pose.translation.y += shift;
    if (report) {
        fillReport(*report, clip, map, transfer);
        report->floorShiftM = shift;
        report->skippedFrames = skipped;
    }
    return motion;
}

} // namespace ars
