#include "engine/rig/inverse_kinematics.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars {
namespace {

constexpr int kMaxChain = 32;
constexpr int kFirstHandJoint = 25;
constexpr float kRadPerDegree = 0.01745329252f;
/// A limb pulled back to this part of its full length looks straight and still has a direction to bend in.
constexpr double kFullReach = 0.99999;
/// Bend that a straight limb gets when its target lies on its own line, where no small rotation shortens it.
constexpr double kKickRad = 0.02;
/// No joint turns further than this in one iteration: the linear model holds no further.
constexpr double kMaxStepRad = 0.35;
constexpr int kDetourIterations = 25;

std::size_t at(int index) { return static_cast<std::size_t>(index); }

/// Limits in degrees: minimum and maximum about x, y, z.
JointLimit limitOf(int twistAxis, glm::vec3 minimum, glm::vec3 maximum, float stiffness = 1.0f) {
    return {twistAxis, minimum * kRadPerDegree, maximum * kRadPerDegree, stiffness};
}

/// The same joint of the right side: a mirror at x = 0 keeps turns about x and reverses the others.
JointLimit mirrored(const JointLimit& left) {
    JointLimit right = left;
    for (int axis : {1, 2}) {
        right.minimum[axis] = -left.maximum[axis];
        right.maximum[axis] = -left.minimum[axis];
    }
    return right;
}

using LimitTable = std::array<JointLimit, kSmplxJointCount>;

void setBoth(LimitTable& table, const char* name, const JointLimit& left) {
    table[at(smplxJointIndex(std::string("left_") + name))] = left;
    table[at(smplxJointIndex(std::string("right_") + name))] = mirrored(left);
}

void setTrunk(LimitTable& table) {
    table[0] = limitOf(1, glm::vec3(-170.0f), glm::vec3(170.0f));
    // Lumbar and thoracic flexion, extension, side bend and rotation (80/25, 35, 45 degrees) shared by three joints,
    // which resist: a dragged hand should not bow the back first.
    for (const char* name : {"spine1", "spine2", "spine3"}) {
        table[at(smplxJointIndex(name))] = limitOf(1, {-15, -20, -20}, {35, 20, 20}, 3.0f);
    }
    table[at(smplxJointIndex("neck"))] = limitOf(1, {-30, -40, -25}, {30, 40, 25});
    table[at(smplxJointIndex("head"))] = limitOf(1, {-30, -45, -25}, {35, 45, 25});
    table[at(smplxJointIndex("jaw"))] = limitOf(2, {-3, -10, -3}, {30, 10, 3});
    for (const char* name : {"left_eye_smplhf", "right_eye_smplhf"}) {
        table[at(smplxJointIndex(name))] = limitOf(2, {-30, -35, -5}, {35, 35, 5});
    }
}

void setLimbs(LimitTable& table) {
    // Hip flexion 120, extension 30, abduction 45, adduction 30, rotation 45; knee 0 to 150; ankle 20 up, 50 down.
    setBoth(table, "hip", limitOf(1, {-125, -45, -30}, {30, 45, 50}));
    setBoth(table, "knee", limitOf(1, {-2, -15, -3}, {150, 15, 3}));
    setBoth(table, "ankle", limitOf(1, {-25, -15, -25}, {50, 15, 25}));
    setBoth(table, "foot", limitOf(2, {-60, -5, -5}, {35, 5, 5}));
    setBoth(table, "collar", limitOf(0, {-15, -25, -15}, {15, 20, 40}, 3.0f));
    // From the T-pose: z raises the arm overhead (+90) or lowers it (-95), -y brings it forward and across.
    setBoth(table, "shoulder", limitOf(0, {-90, -135, -95}, {90, 45, 90}));
    setBoth(table, "elbow", limitOf(0, {-85, -150, -3}, {85, 2, 3}));
    setBoth(table, "wrist", limitOf(0, {-20, -20, -80}, {20, 30, 70}));
}

void setHands(LimitTable& table) {
    for (const char* finger : {"index", "middle", "ring", "pinky"}) {
        setBoth(table, (std::string(finger) + "1").c_str(), limitOf(0, {-10, -20, -90}, {10, 20, 30}));
        setBoth(table, (std::string(finger) + "2").c_str(), limitOf(0, {-5, -5, -110}, {5, 5, 5}));
        setBoth(table, (std::string(finger) + "3").c_str(), limitOf(0, {-5, -5, -90}, {5, 5, 10}));
    }
    setBoth(table, "thumb1", limitOf(0, {-45, -50, -45}, {45, 50, 45}));
    setBoth(table, "thumb2", limitOf(0, {-30, -60, -60}, {30, 60, 60}));
    setBoth(table, "thumb3", limitOf(0, {-20, -80, -80}, {20, 80, 80}));
}

// ---- coordinates

/// exp of a rotation vector.
glm::dquat expQuat(const glm::dvec3& v) {
    const double angle = glm::length(v);
    const double scale = angle < 1e-4 ? 0.5 - angle * angle / 48.0 : std::sin(0.5 * angle) / angle;
    return {std::cos(0.5 * angle), scale * v.x, scale * v.y, scale * v.z};
}

glm::dvec3 logQuat(glm::dquat q) {
    if (q.w < 0.0) q = -q;
    const glm::dvec3 v(q.x, q.y, q.z);
    const double sine = glm::length(v);
    return sine < 1e-12 ? 2.0 * v : (2.0 * std::atan2(sine, q.w) / sine) * v;
}

glm::dvec3 axisVector(int axis) {
    glm::dvec3 v(0.0);
    v[axis] = 1.0;
    return v;
}

glm::dvec3 coordinatesOf(int twistAxis, const glm::dquat& rotation) {
    const double part[3] = {rotation.x, rotation.y, rotation.z};
    double twist = 2.0 * std::atan2(part[twistAxis], rotation.w);
    twist = std::remainder(twist, 2.0 * 3.14159265358979323846);
    const glm::dquat turn = expQuat(twist * axisVector(twistAxis));
    glm::dvec3 coordinates = logQuat(rotation * glm::conjugate(turn));
    coordinates[twistAxis] = twist;
    return coordinates;
}

/// Swing as a rotation vector: the coordinates without the twist.
glm::dvec3 swingOf(int twistAxis, glm::dvec3 coordinates) {
    coordinates[twistAxis] = 0.0;
    return coordinates;
}

glm::dquat rotationOf(int twistAxis, const glm::dvec3& coordinates) {
    return expQuat(swingOf(twistAxis, coordinates)) * expQuat(coordinates[twistAxis] * axisVector(twistAxis));
}

/// Left Jacobian of SO(3) at s, applied to a direction: d exp([s]) = [J_l(s) ds]x exp([s]).
glm::dvec3 leftJacobian(const glm::dvec3& s, const glm::dvec3& ds) {
    const double angle2 = glm::dot(s, s), angle = std::sqrt(angle2);
    const double a = angle < 1e-4 ? 0.5 : (1.0 - std::cos(angle)) / angle2;
    const double b = angle < 1e-4 ? 1.0 / 6.0 : (angle - std::sin(angle)) / (angle2 * angle);
    const glm::dvec3 sxd = glm::cross(s, ds);
    return ds + a * sxd + b * glm::cross(s, sxd);
}

// ---- the chain

/// One joint that turns.
struct Link {
    glm::dvec3 q; ///< coordinates
    glm::dvec3 low, high;
    glm::dvec3 weight;   ///< mobility, 1 / stiffness
    glm::dquat toParent; ///< rest orientation relative to the joint above
    glm::dvec3 offset;   ///< to the next joint of the chain, in the joint's own axes
    int twistAxis = 0;
    int joint = 0;
};

struct Chain {
    std::array<Link, kMaxChain> links;
    int count = 0;
    glm::dquat above{1, 0, 0, 0}; ///< orientation of the joint above the root, world
    glm::dvec3 root{0.0};         ///< position of the root, world
};

/// Positions and orientations along the chain for the present coordinates.
struct ChainState {
    std::array<glm::dvec3, kMaxChain> position;
    std::array<glm::dquat, kMaxChain> before; ///< orientation without the joint's own rotation
    glm::dvec3 end{0.0};
    glm::dquat endAbove{1, 0, 0, 0};
};

ChainState evaluate(const Chain& chain) {
    ChainState state;
    glm::dquat world = chain.above;
    glm::dvec3 place = chain.root;
    for (int i = 0; i < chain.count; ++i) {
        const Link& link = chain.links[at(i)];
        state.position[at(i)] = place;
        state.before[at(i)] = world * link.toParent;
        world = state.before[at(i)] * rotationOf(link.twistAxis, link.q);
        place += world * link.offset;
    }
    state.end = place;
    state.endAbove = world;
    return state;
}

/// Rows d(end)/dq of each coordinate.
using ChainJacobian = std::array<std::array<glm::dvec3, 3>, kMaxChain>;

ChainJacobian jacobian(const Chain& chain, const ChainState& state) {
    ChainJacobian rows;
    for (int i = 0; i < chain.count; ++i) {
        const Link& link = chain.links[at(i)];
        const glm::dvec3 arm = state.end - state.position[at(i)];
        const glm::dvec3 swing = swingOf(link.twistAxis, link.q);
        for (int axis = 0; axis < 3; ++axis) {
            const glm::dvec3 turn =
                axis == link.twistAxis ? expQuat(swing) * axisVector(axis) : leftJacobian(swing, axisVector(axis));
            rows[at(i)][at(axis)] = glm::cross(state.before[at(i)] * turn, arm);
        }
    }
    return rows;
}

/// One damped step within the limits: coordinates that would leave them stop there, and the rest make up for it.
Chain stepped(const Chain& chain, const ChainJacobian& rows, const glm::dvec3& error, double damping) {
    Chain next = chain;
    std::array<std::array<bool, 3>, kMaxChain> fixed{};
    glm::dvec3 left = error;
    for (int round = 0; round < 6; ++round) {
        glm::dmat3 normal(damping);
        for (int i = 0; i < chain.count; ++i) {
            for (int a = 0; a < 3; ++a) {
                if (!fixed[at(i)][at(a)])
                    normal += chain.links[at(i)].weight[a] * glm::outerProduct(rows[at(i)][at(a)], rows[at(i)][at(a)]);
            }
        }
        const glm::dvec3 force = glm::inverse(normal) * left;
        bool stopped = false;
        for (int i = 0; i < chain.count; ++i) {
            const Link& link = chain.links[at(i)];
            for (int a = 0; a < 3; ++a) {
                if (fixed[at(i)][at(a)]) continue;
                const double change =
                    glm::clamp(link.weight[a] * glm::dot(rows[at(i)][at(a)], force), -kMaxStepRad, kMaxStepRad);
                const double wanted = link.q[a] + change;
                next.links[at(i)].q[a] = glm::clamp(wanted, link.low[a], link.high[a]);
                if (wanted >= link.low[a] && wanted <= link.high[a]) continue;
                fixed[at(i)][at(a)] = stopped = true;
                left -= (next.links[at(i)].q[a] - link.q[a]) * rows[at(i)][at(a)];
            }
        }
        if (!stopped) break;
    }
    return next;
}

/// A joint that bends one way only, such as a knee: the axis, and the way.
struct Hinge {
    int axis = -1;
    double way = 1.0;
};

Hinge hingeOf(const Link& link) {
    for (int a = 0; a < 3; ++a) {
        if (a == link.twistAxis) continue;
        if (link.high[a] > 1.0 && link.low[a] > -0.1) return {a, 1.0};
        if (link.low[a] < -1.0 && link.high[a] < 0.1) return {a, -1.0};
    }
    return {};
}

/// A straight limb that must get shorter could start to bend over its knee's back, where the limit would hold it: every
/// hinge starts a little on its own side.
void loosenHinges(Chain& chain) {
    for (int i = 1; i < chain.count; ++i) {
        Link& link = chain.links[at(i)];
        const Hinge hinge = hingeOf(link);
        if (hinge.axis >= 0 && hinge.way * link.q[hinge.axis] < kKickRad) link.q[hinge.axis] = hinge.way * kKickRad;
    }
}

/// Bends a straight joint a little the way it can bend.
bool kick(Chain& chain) {
    bool kicked = false;
    for (int i = 1; i < chain.count; ++i) {
        Link& link = chain.links[at(i)];
        int bend = link.twistAxis == 0 ? 1 : 0;
        for (int a = 0; a < 3; ++a) {
            if (a != link.twistAxis && link.high[a] - link.low[a] > link.high[bend] - link.low[bend]) bend = a;
        }
        const double room = link.high[bend] - link.q[bend], back = link.q[bend] - link.low[bend];
        if (std::max(room, back) < kKickRad) continue;
        link.q[bend] += room > back ? kKickRad : -kKickRad;
        kicked = true;
    }
    return kicked;
}

double chainLength(const Chain& chain) {
    double length = 0.0;
    for (int i = 0; i < chain.count; ++i) length += glm::length(chain.links[at(i)].offset);
    return length;
}

/// Levenberg-Marquardt from the present coordinates; never ends further from the target than it began.
int solveChain(Chain& chain, const glm::dvec3& target, const IkOptions& options) {
    const Chain start = chain;
    ChainState state = evaluate(chain);
    double error = glm::length(target - state.end);
    const double startError = error;
    if (glm::length(target - chain.root) < glm::length(state.end - chain.root) - 1e-5) {
        loosenHinges(chain);
        state = evaluate(chain);
        error = glm::length(target - state.end);
    }
    const double scale = std::max(chainLength(chain), 1e-6);
    double damping = 1e-4 * scale * scale;
    bool mayKick = true;
    int iteration = 0;
    int idle = 0;
    while (iteration < options.maxIterations && error > 0.1 * static_cast<double>(options.toleranceM)) {
        ++iteration;
        const Chain trial = stepped(chain, jacobian(chain, state), target - state.end, damping);
        const ChainState trialState = evaluate(trial);
        const double trialError = glm::length(target - trialState.end);
        if (trialError < error) {
            idle = trialError > error * (1.0 - 1e-5) ? idle + 1 : 0;
            chain = trial;
            state = trialState;
            error = trialError;
            damping = std::max(damping * 0.2, 1e-12 * scale * scale);
            if (idle < 4) continue;
        } else if (damping < 1e3 * scale * scale) {
            damping *= 8.0;
            continue;
        }
        // Stuck. A straight limb whose target lies on its own line needs a first bend; anything else is as near as it
        // gets.
        Chain bent = chain;
        const double reach = glm::length(target - chain.root);
        if (!mayKick || reach > kFullReach * glm::length(state.end - chain.root) || !kick(bent)) break;
        mayKick = false;
        idle = 0;
        chain = bent;
        state = evaluate(chain);
        error = glm::length(target - state.end);
        damping = 1e-4 * scale * scale;
    }
    if (error > startError) chain = start;
    return iteration;
}

/// The same from other starts, for targets that are held off by a limit on the straight way: half way to the middle of
/// every range, and the middle itself. Taken only where it arrives, so that a drag along a limit stays continuous.
int solveWithDetours(Chain& chain, const glm::dvec3& target, const IkOptions& options) {
    const Chain start = chain;
    int iterations = solveChain(chain, target, options);
    IkOptions brief = options;
    brief.maxIterations = std::min(options.maxIterations, kDetourIterations);
    const double tolerance = static_cast<double>(options.toleranceM);
    for (const double share : {0.5, 1.0}) {
        if (glm::length(target - evaluate(chain).end) <= tolerance) break;
        Chain detour = start;
        for (int i = 0; i < detour.count; ++i) {
            Link& link = detour.links[at(i)];
            const glm::dvec3 middle = glm::clamp(0.5 * (link.low + link.high), glm::dvec3(-1.5), glm::dvec3(1.5));
            link.q = glm::mix(link.q, glm::clamp(middle, link.low, link.high), share);
        }
        iterations += solveChain(detour, target, brief);
        if (glm::length(target - evaluate(detour).end) <= tolerance) chain = detour;
    }
    return iterations;
}

// ---- from and to the skeleton

bool isSmplx(const Skeleton& skeleton) {
    if (skeleton.jointCount() != kSmplxJointCount) return false;
    for (int j = 0; j < kSmplxJointCount; ++j) {
        if (skeleton.parents[at(j)] != smplxJointParent(j)) return false;
    }
    return skeleton.names.size() == kSmplxJointCount && skeleton.names[20] == smplxJointName(20);
}

glm::dquat restOrientation(const Skeleton& skeleton, int joint) {
    return skeleton.restOrientations.empty() || joint < 0 ? glm::dquat(1, 0, 0, 0)
                                                          : glm::dquat(skeleton.restOrientations[at(joint)]);
}

/// The joint itself and all above it, from the root of the skeleton.
std::vector<int> pathTo(const Skeleton& skeleton, int joint) {
    std::vector<int> path;
    for (int j = joint; j >= 0; j = skeleton.parents[at(j)]) path.push_back(j);
    std::reverse(path.begin(), path.end());
    return path;
}

glm::dquat toParent(const Skeleton& skeleton, int joint) {
    return glm::conjugate(restOrientation(skeleton, skeleton.parents[at(joint)])) * restOrientation(skeleton, joint);
}

/// Offset from a joint to the next on the path, in the joint's own axes.
glm::dvec3 offsetTo(const Skeleton& skeleton, int joint, int next) {
    const glm::dvec3 way = glm::dvec3(skeleton.restPositions[at(next)]) - glm::dvec3(skeleton.restPositions[at(joint)]);
    return glm::conjugate(restOrientation(skeleton, joint)) * way;
}

JointLimit limitFor(std::span<const JointLimit> limits, int joint) {
    JointLimit free;
    free.minimum = glm::vec3(-100.0f);
    free.maximum = glm::vec3(100.0f);
    return limits.empty() ? free : limits[at(joint)];
}

Link makeLink(const Skeleton& skeleton, const Pose& pose, int joint, int next, std::span<const JointLimit> limits) {
    const JointLimit limit = limitFor(limits, joint);
    Link link;
    link.joint = joint;
    link.twistAxis = limit.twistAxis;
    link.q = coordinatesOf(limit.twistAxis, glm::normalize(glm::dquat(pose.rotations[at(joint)])));
    // Recorded poses may lie outside: they are not pulled in, which would jump, but go no further out.
    link.low = glm::min(glm::dvec3(limit.minimum), link.q);
    link.high = glm::max(glm::dvec3(limit.maximum), link.q);
    link.weight = glm::dvec3(1.0 / static_cast<double>(limit.stiffness));
    link.toParent = toParent(skeleton, joint);
    link.offset = offsetTo(skeleton, joint, next);
    return link;
}

Chain makeChain(const Skeleton& skeleton, const Pose& pose, const std::vector<int>& path, std::size_t rootIndex,
                std::span<const JointLimit> limits) {
    Chain chain;
    chain.root = glm::dvec3(skeleton.restPositions[at(path.front())]) + glm::dvec3(pose.translation);
    for (std::size_t i = 0; i + 1 < path.size(); ++i) {
        if (i >= rootIndex) {
            chain.links[at(chain.count++)] = makeLink(skeleton, pose, path[i], path[i + 1], limits);
            continue;
        }
        chain.above =
            chain.above * toParent(skeleton, path[i]) * glm::normalize(glm::dquat(pose.rotations[at(path[i])]));
        chain.root += chain.above * offsetTo(skeleton, path[i], path[i + 1]);
    }
    return chain;
}

Error badArgument(std::string message) { return makeError(ErrorCode::InvalidArgument, "", std::move(message)); }

Status checkArguments(const Skeleton& skeleton, const Pose& pose, int joint, const glm::vec3& target,
                      const IkOptions& options) {
    if (joint < 0 || joint >= skeleton.jointCount()) {
        return badArgument(fmt::format("joint {} of a skeleton of {}", joint, skeleton.jointCount()));
    }
    if (at(skeleton.jointCount()) != pose.rotations.size()) {
        return badArgument(
            fmt::format("a pose of {} joints on a skeleton of {}", pose.rotations.size(), skeleton.jointCount()));
    }
    if (!std::isfinite(target.x + target.y + target.z)) return badArgument("the target is not finite");
    if (!options.limits.empty() && options.limits.size() != pose.rotations.size()) {
        return badArgument(fmt::format("{} joint limits for {} joints", options.limits.size(), pose.rotations.size()));
    }
    for (std::size_t j = 0; j < options.limits.size(); ++j) {
        const JointLimit& limit = options.limits[j];
        bool sound = limit.twistAxis >= 0 && limit.twistAxis < 3 && limit.stiffness > 0.0f;
        for (int a = 0; a < 3; ++a) sound = sound && limit.minimum[a] <= 0.0f && limit.maximum[a] >= 0.0f;
        if (!sound) return badArgument(fmt::format("the limit of joint {} is not sound", j));
    }
    return {};
}

Result<std::size_t> rootOnPath(const Skeleton& skeleton, const std::vector<int>& path, int wanted) {
    const auto found = std::find(path.begin(), path.end() - 1, wanted);
    if (found == path.end() - 1) {
        return badArgument(fmt::format("joint {} is not above joint {}", wanted, path.back()));
    }
    const auto index = static_cast<std::size_t>(found - path.begin());
    if (path.size() - 1 - index <= kMaxChain) return index;
    return badArgument(fmt::format("a chain of {} joints of {}, the limit is {}", path.size() - 1 - index,
                                   skeleton.jointCount(), kMaxChain));
}

void keepOrientation(const Skeleton& skeleton, Pose& pose, int joint, const glm::dquat& above, const glm::dquat& wanted,
                     std::span<const JointLimit> limits) {
    const JointLimit limit = limitFor(limits, joint);
    const glm::dvec3 now = coordinatesOf(limit.twistAxis, glm::normalize(glm::dquat(pose.rotations[at(joint)])));
    const glm::dvec3 low = glm::min(glm::dvec3(limit.minimum), now), high = glm::max(glm::dvec3(limit.maximum), now);
    const glm::dquat local = glm::conjugate(above * toParent(skeleton, joint)) * wanted;
    const glm::dvec3 q = glm::clamp(coordinatesOf(limit.twistAxis, glm::normalize(local)), low, high);
    pose.rotations[at(joint)] = glm::quat(glm::normalize(rotationOf(limit.twistAxis, q)));
}

int defaultSmplxRoot(int joint) {
    const auto named = [](const char* name) { return smplxJointIndex(name); };
    const int parent = smplxJointParent(joint);
    if (joint >= kFirstHandJoint) {
        const bool left = joint < 40;
        const int knuckle = joint - (joint - kFirstHandJoint) % 3;
        return joint == knuckle ? named(left ? "left_shoulder" : "right_shoulder") : knuckle;
    }
    for (int above = parent; above > 0; above = smplxJointParent(above)) {
        for (const char* root : {"left_hip", "right_hip", "left_shoulder", "right_shoulder"}) {
            if (above == named(root)) return above;
        }
    }
    // Shoulders turn their collar; jaw and eyes the head's neck; trunk, neck and head bend from the lowest spine joint.
    if (joint == named("left_shoulder") || joint == named("right_shoulder")) return parent;
    if (parent == named("head")) return named("neck");
    return parent <= 0 ? parent : named("spine1");
}

} // namespace

std::span<const JointLimit> smplxJointLimits() {
    static const LimitTable table = [] {
        LimitTable limits;
        setTrunk(limits);
        setLimbs(limits);
        setHands(limits);
        return limits;
    }();
    return table;
}

glm::vec3 limitCoordinates(const JointLimit& limit, const glm::quat& rotation) {
    return glm::vec3(coordinatesOf(limit.twistAxis, glm::normalize(glm::dquat(rotation))));
}

glm::quat rotationFromCoordinates(const JointLimit& limit, const glm::vec3& coordinates) {
    return glm::quat(glm::normalize(rotationOf(limit.twistAxis, glm::dvec3(coordinates))));
}

int defaultChainRoot(const Skeleton& skeleton, int joint) {
    if (joint < 0 || joint >= skeleton.jointCount()) return -1;
    if (isSmplx(skeleton)) return defaultSmplxRoot(joint);
    int root = skeleton.parents[at(joint)];
    for (int steps = 1; root >= 0 && steps < 3; ++steps) {
        const int above = skeleton.parents[at(root)];
        if (above < 0 || skeleton.children(above).size() > 1) break;
        root = above;
    }
    return root;
}

Result<IkResult> solveIk(const Skeleton& skeleton, Pose& pose, int joint, const glm::vec3& targetWorld,
                         const IkOptions& options) {
    ARS_TRY_STATUS(checkArguments(skeleton, pose, joint, targetWorld, options));
    if (skeleton.parents[at(joint)] < 0) {
        pose.translation = targetWorld - skeleton.restPositions[at(joint)];
        return IkResult{0.0f, 0, true};
    }
    const std::vector<int> path = pathTo(skeleton, joint);
    const int wanted = options.chainRoot >= 0 ? options.chainRoot : defaultChainRoot(skeleton, joint);
    ARS_TRY(const std::size_t rootIndex, rootOnPath(skeleton, path, wanted));
    std::span<const JointLimit> limits;
    if (options.useLimits) {
        limits = options.limits;
        if (limits.empty() && isSmplx(skeleton)) limits = smplxJointLimits();
    }
    Chain chain = makeChain(skeleton, pose, path, rootIndex, limits);
    const glm::dquat endBefore =
        evaluate(chain).endAbove * toParent(skeleton, joint) * glm::normalize(glm::dquat(pose.rotations[at(joint)]));
    glm::dvec3 target(targetWorld);
    const glm::dvec3 way = target - chain.root;
    const double full = kFullReach * chainLength(chain);
    const bool tooFar = glm::length(way) > full;
    if (tooFar) target = chain.root + way * (full / glm::length(way));
    IkResult result;
    result.iterations = tooFar ? solveChain(chain, target, options) : solveWithDetours(chain, target, options);
    for (int i = 0; i < chain.count; ++i) {
        const Link& link = chain.links[at(i)];
        pose.rotations[at(link.joint)] = glm::quat(glm::normalize(rotationOf(link.twistAxis, link.q)));
    }
    const ChainState state = evaluate(chain);
    result.residualM = static_cast<float>(glm::length(glm::dvec3(targetWorld) - state.end));
    result.reached = result.residualM <= options.toleranceM;
    if (options.keepEndOrientation) keepOrientation(skeleton, pose, joint, state.endAbove, endBefore, limits);
    return result;
}

} // namespace ars
