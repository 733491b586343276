#include "ui/viewport/picking.h"

#include <algorithm>
#include <cctype>
#include <limits>
#include <string_view>

namespace ars::ui {

namespace {

/// What the skin of a joint is called, and which joint is dragged by it. {} stands for "left" and "right".
struct Segment {
    std::string_view joint;
    std::string_view name;
    std::string_view dragged;
};
constexpr Segment kSided[] = {
    {"hip", "thigh", "knee"},      {"knee", "shin", "ankle"},        {"ankle", "foot", "ankle"},
    {"foot", "toes", "foot"},      {"collar", "collar", "shoulder"}, {"shoulder", "upper arm", "elbow"},
    {"elbow", "forearm", "wrist"}, {"wrist", "hand", "wrist"},
};
constexpr Segment kMiddle[] = {
    {"pelvis", "Pelvis", "pelvis"},
    {"spine1", "Waist", "spine3"},
    {"spine2", "Chest", "spine3"},
    {"spine3", "Chest", "spine3"},
    {"neck", "Neck", "head"},
    {"head", "Head", "head"},
    {"jaw", "Jaw", "head"},
    {"left_eye_smplhf", "Left eye", "head"},
    {"right_eye_smplhf", "Right eye", "head"},
};

/// "left_" or "right_" at the beginning of a name, or "".
std::string_view sideOf(std::string_view name) {
    for (const std::string_view side : {std::string_view("left_"), std::string_view("right_")}) {
        if (name.substr(0, side.size()) == side) return side;
    }
    return {};
}

const Segment* segmentOf(std::string_view name) {
    const std::string_view side = sideOf(name);
    for (const Segment& segment : kMiddle) {
        if (segment.joint == name) return &segment;
    }
    if (side.empty()) return nullptr;
    const std::string_view rest = name.substr(side.size());
    for (const Segment& segment : kSided) {
        if (segment.joint == rest) return &segment;
    }
    return nullptr;
}

int nearestJoint(const Frame& frame, const glm::vec3& point) {
    int best = -1;
    float least = std::numeric_limits<float>::max();
    for (std::size_t j = 0; j < frame.jointWorld.size(); ++j) {
        const glm::vec3 d = glm::vec3(frame.jointWorld[j][3]) - point;
        if (glm::dot(d, d) < least) {
            least = glm::dot(d, d);
            best = static_cast<int>(j);
        }
    }
    return best;
}

int dominantJoint(const SkinWeights& weights, std::size_t point) {
    // Influences are sorted, the largest first.
    return weights.joints[point * kMaxInfluences];
}

} // namespace

std::optional<BodyHit> bodyAt(const Frame& frame, int column, int row) {
    const Image* depth = frame.picture(BufferId::Depth);
    const Image* opacity = frame.picture(BufferId::Opacity);
    if (!depth || column < 0 || row < 0 || column >= depth->width || row >= depth->height) return std::nullopt;
    if (opacity && opacity->at(row, column, 0) < 0.05f) return std::nullopt;
    BodyHit hit;
    hit.depthM = depth->at(row, column, 0);
    if (!(hit.depthM > 0.0)) return std::nullopt;
    const Camera& camera = frame.inputs.camera;
    hit.world = camera.toWorld(hit.depthM * camera.ray(column + 0.5, row + 0.5));
    const glm::vec3 point(hit.world);
    if (frame.surfelMeans && !frame.surfelMeans->empty() && frame.avatar) {
        float least = std::numeric_limits<float>::max();
        for (std::size_t i = 0; i < frame.surfelMeans->size(); ++i) {
            const glm::vec3 d = (*frame.surfelMeans)[i] - point;
            const float square = glm::dot(d, d);
            if (square < least) {
                least = square;
                hit.surfel = static_cast<int>(i);
            }
        }
        const SkinWeights& weights = frame.avatar->evaluator->rig().weights;
        if (hit.surfel >= 0 && static_cast<std::size_t>(hit.surfel) < weights.pointCount()) {
            hit.joint = dominantJoint(weights, static_cast<std::size_t>(hit.surfel));
        }
    }
    if (hit.joint < 0) hit.joint = nearestJoint(frame, point);
    return hit;
}

int draggedJoint(const Skeleton& skeleton, int joint) {
    if (joint < 0 || joint >= skeleton.jointCount()) return -1;
    const std::string& name = skeleton.names[static_cast<std::size_t>(joint)];
    if (const Segment* segment = segmentOf(name)) {
        const bool sided = !sideOf(name).empty() && segment->dragged != "head";
        const int found =
            skeleton.find((sided ? std::string(sideOf(name)) : std::string()) + std::string(segment->dragged));
        if (found >= 0) return found;
    }
    if (skeleton.parents[static_cast<std::size_t>(joint)] < 0) return joint;
    const std::vector<int> children = skeleton.children(joint);
    return children.size() == 1 ? children.front() : joint;
}

std::string readableName(const std::string& name) {
    std::string text = name;
    std::replace(text.begin(), text.end(), '_', ' ');
    if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
    return text;
}

std::string segmentName(const Skeleton& skeleton, int joint) {
    if (joint < 0 || joint >= skeleton.jointCount()) return {};
    const std::string& name = skeleton.names[static_cast<std::size_t>(joint)];
    const Segment* segment = segmentOf(name);
    if (!segment) return readableName(name);
    const std::string_view side = sideOf(name);
    if (side.empty() || segment->name.front() < 'a') return std::string(segment->name);
    return readableName(std::string(side) + std::string(segment->name));
}

std::vector<int> dominantJoints(const AvatarRig& rig) {
    std::vector<int> joints(rig.weights.pointCount());
    for (std::size_t i = 0; i < joints.size(); ++i) joints[i] = dominantJoint(rig.weights, i);
    return joints;
}

std::vector<int> surfelsDraggedBy(const AvatarRig& rig, int dragged) {
    std::vector<int> draggedBy(static_cast<std::size_t>(rig.skeleton.jointCount()));
    for (int j = 0; j < rig.skeleton.jointCount(); ++j) {
        draggedBy[static_cast<std::size_t>(j)] = draggedJoint(rig.skeleton, j);
    }
    std::vector<int> surfels;
    for (std::size_t i = 0; i < rig.weights.pointCount(); ++i) {
        const auto joint = static_cast<std::size_t>(dominantJoint(rig.weights, i));
        if (joint < draggedBy.size() && draggedBy[joint] == dragged) surfels.push_back(static_cast<int>(i));
    }
    return surfels;
}

} // namespace ars::ui
