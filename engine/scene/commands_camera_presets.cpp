#include "engine/scene/commands_camera.h"

#include "engine/rig/joint_names.h"
#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"
#include "engine/scene/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>

namespace ars::edit {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kMargin = 1.08;
constexpr double kAspect = 4.0 / 3.0;    ///< of the picture that a thing must fit into; wider ones show more
constexpr double kSmallestFrameM = 0.12; ///< half the height of what a close view shows at least

/// The body on the screen: vertices, joints, and which joint moves each vertex most.
struct PosedBody {
    const Skeleton* skeleton = nullptr;
    const SkinWeights* weights = nullptr;
    std::vector<glm::vec3> vertices;
    std::vector<glm::mat4> joints;
};

Result<PosedBody> posedBody(const Document& document, const CommandContext& context) {
    PosedBody body;
    body.skeleton = skeletonOf(context);
    if (!body.skeleton) return body;
    const Pose pose = currentPose(document, context);
    body.weights = &context.assets.avatar->evaluator->mesh().weights;
    body.joints = jointWorldMatrices(*body.skeleton, pose);
    ARS_TRY(body.vertices, posedVertices(context, pose));
    return body;
}

/// Marks a joint and everything that hangs from it.
void markSubtree(const Skeleton& skeleton, int joint, std::vector<bool>& marked) {
    marked[static_cast<std::size_t>(joint)] = true;
    for (int j = joint + 1; j < skeleton.jointCount(); ++j) {
        const int parent = skeleton.parents[static_cast<std::size_t>(j)];
        if (parent >= 0 && marked[static_cast<std::size_t>(parent)]) marked[static_cast<std::size_t>(j)] = true;
    }
}

Bounds boundsOfMarked(const PosedBody& body, const std::vector<bool>& marked) {
    std::vector<glm::vec3> chosen;
    for (std::size_t v = 0; v < body.vertices.size(); ++v) {
        const std::size_t first = body.weights->joints[v * kMaxInfluences]; // largest weight first
        if (first < marked.size() && marked[first]) chosen.push_back(body.vertices[v]);
    }
    for (std::size_t j = 0; j < marked.size() && chosen.empty(); ++j) {
        if (marked[j]) return {glm::vec3(body.joints[j][3]) - 0.05f, glm::vec3(body.joints[j][3]) + 0.05f};
    }
    return boundsOf(chosen);
}

/// The joint of this avatar that does what a SMPL-X joint does.
Result<int> jointLike(const Skeleton& skeleton, const char* smplxName) {
    if (const int same = skeleton.find(smplxName); same >= 0) return same;
    const std::vector<int> meanings = smplxJointsForNames(skeleton.names);
    for (std::size_t j = 0; j < meanings.size(); ++j) {
        if (meanings[j] == smplxJointIndex(smplxName)) return static_cast<int>(j);
    }
    return makeError(ErrorCode::NotFound, "camera", fmt::format("the avatar has no {}", spoken(smplxName)));
}

glm::dvec3 directionOf(double azimuthDeg, double elevationDeg) {
    const double azimuth = azimuthDeg * kDegree, elevation = elevationDeg * kDegree;
    return {std::sin(azimuth) * std::cos(elevation), std::sin(elevation), std::cos(azimuth) * std::cos(elevation)};
}

/// Looks at the middle of a box from a direction, as near as the box fits into the picture.
SceneCamera framing(const Bounds& bounds, const glm::dvec3& towards, double fieldDeg) {
    SceneCamera camera;
    camera.verticalFieldDeg = fieldDeg;
    camera.target = glm::dvec3(bounds.center());
    camera.eye = camera.target + towards;
    const glm::dmat3 axes = glm::transpose(cameraOf(camera, 2, 2).rotation);
    const double tangent = std::tan(0.5 * fieldDeg * kDegree);
    double distance = kSmallestFrameM / tangent;
    for (int corner = 0; corner < 8; ++corner) {
        const glm::dvec3 p(corner & 1 ? bounds.high.x : bounds.low.x, corner & 2 ? bounds.high.y : bounds.low.y,
                           corner & 4 ? bounds.high.z : bounds.low.z);
        const glm::dvec3 d = p - camera.target;
        const double across =
            kMargin * std::max(std::abs(glm::dot(d, axes[0])) / kAspect, std::abs(glm::dot(d, axes[1])));
        distance = std::max(distance, across / tangent - glm::dot(d, axes[2]));
    }
    camera.eye = camera.target + distance * glm::normalize(towards);
    return camera;
}

/// Where a joint's front (+z of the rest pose) points now, about the vertical axis, degrees.
double headingDeg(const PosedBody& body, int joint) {
    const glm::mat4& world = body.joints[static_cast<std::size_t>(joint)];
    const Skeleton& skeleton = *body.skeleton;
    glm::quat rest(1.0f, 0.0f, 0.0f, 0.0f);
    if (!skeleton.restOrientations.empty()) rest = skeleton.restOrientations[static_cast<std::size_t>(joint)];
    const glm::vec3 front = glm::mat3(world) * (glm::inverse(rest) * glm::vec3(0.0f, 0.0f, 1.0f));
    return std::atan2(front.x, front.z) / kDegree;
}

/// What a close view shows: the joints whose subtrees are framed, those left out, and from where.
struct CloseView {
    const char* name;
    std::initializer_list<const char*> shown, hidden;
    const char* facing; ///< joint whose front azimuths count from
    double azimuthDeg, elevationDeg;
};

const CloseView kCloseViews[]{
    {"face", {"head"}, {}, "head", 12.0, 4.0},
    {"upper_body", {"spine2"}, {"left_elbow", "right_elbow"}, "spine3", 15.0, 5.0},
    {"left_hand", {"left_wrist"}, {}, "pelvis", 55.0, 20.0},
    {"right_hand", {"right_wrist"}, {}, "pelvis", -55.0, 20.0},
    {"feet", {"left_ankle", "right_ankle"}, {}, "pelvis", 30.0, 18.0},
};

Result<SceneCamera> closeCamera(const CloseView& view, const PosedBody& body, double fieldDeg) {
    std::vector<bool> marked(static_cast<std::size_t>(body.skeleton->jointCount()), false);
    for (const char* name : view.shown) {
        ARS_TRY(const int joint, jointLike(*body.skeleton, name));
        markSubtree(*body.skeleton, joint, marked);
    }
    for (const char* name : view.hidden) {
        ARS_TRY(const int joint, jointLike(*body.skeleton, name));
        std::vector<bool> away(marked.size(), false);
        markSubtree(*body.skeleton, joint, away);
        for (std::size_t j = 0; j < marked.size(); ++j) marked[j] = marked[j] && !away[j];
    }
    ARS_TRY(const int facing, jointLike(*body.skeleton, view.facing));
    const glm::dvec3 towards = directionOf(headingDeg(body, facing) + view.azimuthDeg, view.elevationDeg);
    return framing(boundsOfMarked(body, marked), towards, fieldDeg);
}

Bounds wholeBody(const PosedBody& body) {
    if (body.vertices.empty()) return {glm::vec3(-0.9f, 0.0f, -0.2f), glm::vec3(0.9f, 1.75f, 0.2f)};
    return boundsOf(body.vertices);
}

} // namespace

Result<SceneCamera> presetCamera(const std::string& name, const SceneCamera& from, const Document& document,
                                 const CommandContext& context) {
    ARS_TRY(const PosedBody body, posedBody(document, context));
    for (const CloseView& view : kCloseViews) {
        if (view.name != name) continue;
        if (!body.skeleton) return unavailable("no avatar is loaded yet");
        return closeCamera(view, body, from.verticalFieldDeg);
    }
    glm::dvec3 towards(0.0, 0.0, 1.0);
    if (name == "back") towards = directionOf(180.0, 0.0);
    if (name == "left") towards = directionOf(90.0, 0.0);
    if (name == "right") towards = directionOf(-90.0, 0.0);
    if (name == "top") towards = directionOf(0.0, 89.0);
    if (name == "three_quarter") towards = directionOf(35.0, 12.0);
    return framing(wholeBody(body), towards, from.verticalFieldDeg);
}

Result<SceneCamera> focusedCamera(int joint, const SceneCamera& from, const Document& document,
                                  const CommandContext& context) {
    ARS_TRY(const PosedBody body, posedBody(document, context));
    Bounds bounds = wholeBody(body);
    const bool known = body.skeleton && joint >= 0 && joint < body.skeleton->jointCount();
    if (known && body.skeleton->parents[static_cast<std::size_t>(joint)] >= 0) {
        std::vector<bool> marked(static_cast<std::size_t>(body.skeleton->jointCount()), false);
        markSubtree(*body.skeleton, joint, marked);
        bounds = boundsOfMarked(body, marked);
    }
    SceneCamera camera = framing(bounds, from.eye - from.target, from.verticalFieldDeg);
    camera.rollDeg = from.rollDeg;
    return camera;
}

} // namespace ars::edit
