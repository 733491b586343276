#include "engine/rig/retarget.h"

#include <glm/gtc/constants.hpp>
#include <glm/gtc/type_ptr.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace ars {
namespace {

/// A joint whose place changes by less than this part of the skeleton's size keeps the length of its bone.
constexpr float kTravelFraction = 0.01f;

Status checkClipSize(std::uint64_t frames, std::uint64_t joints, const ReadLimits& limits) {
    const std::uint64_t perFrame =
        joints * (sizeof(glm::quat) + sizeof(glm::vec3)) + kSmplxJointCount * sizeof(glm::quat);
    if (frames <= limits.maxElements && frames <= limits.maxBytes / perFrame) return {};
    return makeError(ErrorCode::LimitExceeded, "",
                     fmt::format("{} frames of {} joints need {:.0f} MB, the limit is {} MB", frames, joints,
                                 static_cast<double>(frames) * static_cast<double>(perFrame) / 1e6,
                                 limits.maxBytes / 1000000));
}

void resizeClip(SourceClip& clip, std::size_t frames) {
    clip.frameCount = frames;
    const std::size_t joints = clip.skeleton.parents.size();
    clip.worldRotations.resize(frames * joints);
    clip.worldPositions.resize(frames * joints);
}

// ---- BVH

Skeleton bvhSkeleton(const BvhFile& file) {
    Skeleton skeleton;
    for (const BvhJoint& joint : file.joints) {
        const bool root = joint.parent < 0;
        skeleton.names.push_back(joint.name);
        skeleton.parents.push_back(joint.parent);
        skeleton.restPositions.push_back(
            root ? joint.offset : skeleton.restPositions[static_cast<std::size_t>(joint.parent)] + joint.offset);
        skeleton.restOrientations.emplace_back(1.0f, 0.0f, 0.0f, 0.0f);
    }
    return skeleton;
}

float extent(const std::vector<glm::vec3>& points) {
    glm::vec3 low = points.front(), high = points.front();
    for (const glm::vec3& p : points) {
        low = glm::min(low, p);
        high = glm::max(high, p);
    }
    return glm::length(high - low);
}

/// Whether the numbers of a position channel move the joint.
bool travels(const BvhFile& file, std::size_t channel, float threshold) {
    float low = file.values[channel], high = low;
    for (std::size_t f = 1; f < file.frameCount; ++f) {
        const float value = file.frame(f)[channel];
        low = std::min(low, value);
        high = std::max(high, value);
    }
    return high - low > threshold;
}

/// For each joint, whether its position channels count.
std::vector<char> travellingJoints(const BvhFile& file, const Skeleton& skeleton) {
    const float threshold = kTravelFraction * extent(skeleton.restPositions);
    std::vector<char> travelling(file.joints.size(), 0);
    for (std::size_t j = 0; j < file.joints.size(); ++j) {
        const BvhJoint& joint = file.joints[j];
        if (joint.parent < 0) travelling[j] = 1;
        for (std::size_t c = 0; c < joint.channels.size() && !travelling[j]; ++c) {
            travelling[j] = !isRotation(joint.channels[c]) && travels(file, joint.firstChannel + c, threshold);
        }
    }
    return travelling;
}

struct LocalTransform {
    glm::dquat rotation{1, 0, 0, 0};
    glm::dvec3 position{0};
};

LocalTransform bvhLocal(const BvhJoint& joint, std::span<const float> frame, bool placed) {
    LocalTransform local;
    local.position = glm::dvec3(joint.offset);
    for (std::size_t c = 0; c < joint.channels.size(); ++c) {
        const double value = frame[joint.firstChannel + c];
        const int axis = channelAxis(joint.channels[c]);
        if (isRotation(joint.channels[c])) {
            glm::dvec3 direction(0.0);
            direction[axis] = 1.0;
            local.rotation = local.rotation * glm::angleAxis(glm::radians(value), direction);
        } else if (placed) {
            local.position[axis] = value;
        }
    }
    return local;
}

// ---- glTF

std::string listNames(const std::vector<GltfAnimation>& animations) {
    std::string names;
    for (std::size_t i = 0; i < animations.size() && i < 20; ++i) {
        names += fmt::format("{}{} \"{}\"", i ? ", " : "", i, animations[i].name);
    }
    return animations.size() > 20 ? names + " ..." : names;
}

Result<const GltfAnimation*> findAnimation(const GltfDocument& document, std::string_view wanted) {
    if (document.animations.empty()) return makeError(ErrorCode::NotFound, "", "the file has no animation");
    if (wanted.empty()) return &document.animations.front();
    for (const GltfAnimation& animation : document.animations) {
        if (animation.name == wanted) return &animation;
    }
    std::size_t index = 0;
    const auto [end, error] = std::from_chars(wanted.data(), wanted.data() + wanted.size(), index);
    if (error == std::errc() && end == wanted.data() + wanted.size() && index < document.animations.size()) {
        return &document.animations[index];
    }
    return makeError(ErrorCode::NotFound, "",
                     fmt::format("no animation \"{}\"; there are {}", wanted, listNames(document.animations)));
}

/// Nodes in the order of their depth, parents first.
std::vector<int> nodesParentsFirst(const GltfDocument& document) {
    std::vector<int> order, roots;
    for (std::size_t n = 0; n < document.nodes.size(); ++n) {
        if (document.nodes[n].parent < 0) order.push_back(static_cast<int>(n));
    }
    for (std::size_t i = 0; i < order.size(); ++i) {
        const auto& children = document.nodes[static_cast<std::size_t>(order[i])].children;
        order.insert(order.end(), children.begin(), children.end());
    }
    return order;
}

const GltfSkin* largestSkin(const GltfDocument& document) {
    const auto largest =
        std::max_element(document.skins.begin(), document.skins.end(),
                         [](const auto& a, const auto& b) { return a.joints.size() < b.joints.size(); });
    return largest == document.skins.end() || largest->joints.empty() ? nullptr : &*largest;
}

/// Nodes that become joints: the skin's (or the animated ones) and all above them.
std::vector<char> wantedNodes(const GltfDocument& document, const GltfAnimation& animation, const GltfSkin* skin) {
    std::vector<char> wanted(document.nodes.size(), 0);
    const auto take = [&](int node) {
        for (; node >= 0 && !wanted[static_cast<std::size_t>(node)];
             node = document.nodes[static_cast<std::size_t>(node)].parent) {
            wanted[static_cast<std::size_t>(node)] = 1;
        }
    };
    if (skin) {
        for (int node : skin->joints) take(node);
    } else {
        for (const GltfChannel& channel : animation.channels) take(channel.node);
    }
    return wanted;
}

glm::vec3 safeNormal(const glm::vec3& v, const glm::vec3& fallback) {
    const float length = glm::length(v);
    return length > 1e-20f && std::isfinite(length) ? v / length : fallback;
}

/// Rotation of a matrix whatever its scale; shear is taken out by Gram-Schmidt, a mirrored axis turned back.
glm::quat orientationOf(const glm::mat4& matrix) {
    const glm::vec3 x = safeNormal(glm::vec3(matrix[0]), {1, 0, 0});
    glm::vec3 y = glm::vec3(matrix[1]);
    y = safeNormal(y - glm::dot(x, y) * x, std::abs(x.y) < 0.9f
                                               ? safeNormal(glm::cross(glm::cross(x, {0, 1, 0}), x), {0, 1, 0})
                                               : glm::vec3(0, 0, 1));
    return glm::normalize(glm::quat_cast(glm::mat3(x, y, glm::cross(x, y))));
}

/// Rest matrices of the nodes in world space: bind matrices where there is a skin, else the nodes' own transforms.
std::vector<glm::mat4> restMatrices(const GltfDocument& document, const GltfSkin* skin, const std::vector<int>& order) {
    std::vector<glm::mat4> rest = document.globalMatrices();
    if (!skin || skin->inverseBindMatrices.size() != skin->joints.size()) return rest;
    std::vector<int> bindIndex(document.nodes.size(), -1);
    for (std::size_t i = 0; i < skin->joints.size(); ++i)
        bindIndex[static_cast<std::size_t>(skin->joints[i])] = static_cast<int>(i);
    const auto top =
        std::find_if(order.begin(), order.end(), [&](int n) { return bindIndex[static_cast<std::size_t>(n)] >= 0; });
    if (top == order.end()) return rest;
    const auto bind = [&](int node) {
        return skin->inverseBindMatrices[static_cast<std::size_t>(bindIndex[static_cast<std::size_t>(node)])];
    };
    // The mesh's own space is placed in the world by the topmost joint.
    const glm::mat4 place = rest[static_cast<std::size_t>(*top)] * bind(*top);
    for (int node : order) {
        if (bindIndex[static_cast<std::size_t>(node)] < 0) continue;
        const float determinant = glm::determinant(glm::mat3(bind(node)));
        if (!std::isfinite(determinant) || std::abs(determinant) < 1e-20f) return document.globalMatrices();
        rest[static_cast<std::size_t>(node)] = place * glm::inverse(bind(node));
    }
    return rest;
}

/// Value of a channel at a time: `width` numbers, clamped at both ends (glTF 2.0, appendix C).
void sampleChannel(const GltfChannel& channel, float timeS, float* out) {
    const std::size_t width = static_cast<std::size_t>(channel.width);
    const bool cubic = channel.interpolation == GltfInterpolation::CubicSpline;
    const std::size_t stride = cubic ? 3 * width : width;
    const auto value = [&](std::size_t key) { return channel.values.data() + key * stride + (cubic ? width : 0); };
    const auto next = static_cast<std::size_t>(std::upper_bound(channel.times.begin(), channel.times.end(), timeS) -
                                               channel.times.begin());
    if (next == 0 || next == channel.times.size() || channel.interpolation == GltfInterpolation::Step) {
        std::copy_n(value(next == 0 ? 0 : next - 1), width, out);
        return;
    }
    const float step = channel.times[next] - channel.times[next - 1];
    const float t = (timeS - channel.times[next - 1]) / step;
    const float *a = value(next - 1), *b = value(next);
    if (cubic) {
        const float *tangentA = a + width, *tangentB = b - width;
        const float t2 = t * t, t3 = t2 * t;
        for (std::size_t i = 0; i < width; ++i) {
            out[i] = (2 * t3 - 3 * t2 + 1) * a[i] + (t3 - 2 * t2 + t) * step * tangentA[i] + (3 * t2 - 2 * t3) * b[i] +
                     (t3 - t2) * step * tangentB[i];
        }
    } else if (channel.path == GltfPath::Rotation) {
        const glm::quat q = glm::slerp(glm::quat(a[3], a[0], a[1], a[2]), glm::quat(b[3], b[0], b[1], b[2]), t);
        out[0] = q.x, out[1] = q.y, out[2] = q.z, out[3] = q.w;
    } else {
        for (std::size_t i = 0; i < width; ++i) out[i] = a[i] + t * (b[i] - a[i]);
    }
}

glm::mat4 localMatrix(const GltfNode& node, const std::vector<const GltfChannel*>& channels, float timeS) {
    if (channels.empty()) return node.localMatrix;
    glm::vec3 translation = node.translation, scale = node.scale;
    glm::quat rotation = node.rotation;
    for (const GltfChannel* channel : channels) {
        float v[4] = {0, 0, 0, 0};
        sampleChannel(*channel, timeS, v);
        if (channel->path == GltfPath::Translation) translation = {v[0], v[1], v[2]};
        if (channel->path == GltfPath::Scale) scale = {v[0], v[1], v[2]};
        if (channel->path == GltfPath::Rotation) {
            const glm::quat q(v[3], v[0], v[1], v[2]);
            if (glm::length(q) > 1e-6f) rotation = glm::normalize(q);
        }
    }
    glm::mat4 matrix = glm::mat4_cast(rotation);
    for (int i = 0; i < 3; ++i) matrix[i] *= scale[i];
    matrix[3] = glm::vec4(translation, 1.0f);
    return matrix;
}

bool moves(const GltfChannel& channel) {
    const int width = channel.path == GltfPath::Rotation ? 4 : 3;
    return channel.path != GltfPath::Weights && channel.width == width && !channel.times.empty();
}

/// The chosen nodes as a skeleton, and for each joint its node and the channels that move it.
struct GltfJoints {
    std::vector<int> nodes;
    std::vector<std::vector<const GltfChannel*>> channels;
};

GltfJoints gltfJoints(const GltfDocument& document, const GltfAnimation& animation, Skeleton& skeleton) {
    const GltfSkin* skin = largestSkin(document);
    const std::vector<char> wanted = wantedNodes(document, animation, skin);
    const std::vector<int> order = nodesParentsFirst(document);
    const std::vector<glm::mat4> rest = restMatrices(document, skin, order);
    GltfJoints joints;
    std::vector<int> jointOfNode(document.nodes.size(), -1);
    for (int node : order) {
        const auto n = static_cast<std::size_t>(node);
        if (!wanted[n]) continue;
        jointOfNode[n] = static_cast<int>(joints.nodes.size());
        joints.nodes.push_back(node);
        const int parent = document.nodes[n].parent;
        skeleton.names.push_back(document.nodes[n].name);
        skeleton.parents.push_back(parent < 0 ? -1 : jointOfNode[static_cast<std::size_t>(parent)]);
        skeleton.restPositions.emplace_back(rest[n][3]);
        skeleton.restOrientations.push_back(orientationOf(rest[n]));
    }
    joints.channels.resize(joints.nodes.size());
    for (const GltfChannel& channel : animation.channels) {
        const int joint = channel.node < 0 ? -1 : jointOfNode[static_cast<std::size_t>(channel.node)];
        if (joint >= 0 && moves(channel)) joints.channels[static_cast<std::size_t>(joint)].push_back(&channel);
    }
    return joints;
}

} // namespace

std::span<const glm::quat> SourceClip::rotations(std::size_t frame) const {
    const std::size_t joints = skeleton.parents.size();
    return std::span<const glm::quat>(worldRotations).subspan(frame * joints, joints);
}

std::span<const glm::vec3> SourceClip::positions(std::size_t frame) const {
    const std::size_t joints = skeleton.parents.size();
    return std::span<const glm::vec3>(worldPositions).subspan(frame * joints, joints);
}

Result<SourceClip> clipFromBvh(const BvhFile& file, const ReadLimits& limits) {
    if (file.joints.empty() || file.frameCount == 0) {
        return makeError(
            ErrorCode::BadFile, "",
            fmt::format("expected joints and frames, found {} and {}", file.joints.size(), file.frameCount));
    }
    ARS_TRY_STATUS(checkClipSize(file.frameCount, file.joints.size(), limits));
    SourceClip clip;
    clip.format = "bvh";
    const double rate = 1.0 / file.frameTimeS;
    const bool sound = rate >= kMinFramesPerSecond && rate <= kMaxFramesPerSecond;
    if (!sound && file.frameCount > 1) {
        return makeError(ErrorCode::BadFile, "Frame Time",
                         fmt::format("expected {} to {} seconds, found {}", 1.0 / kMaxFramesPerSecond,
                                     1.0 / kMinFramesPerSecond, file.frameTimeS));
    }
    clip.framesPerSecond = sound ? rate : 30.0; // the rate of a single pose means nothing
    clip.skeleton = bvhSkeleton(file);
    const std::vector<char> travelling = travellingJoints(file, clip.skeleton);
    const std::size_t joints = file.joints.size();
    resizeClip(clip, file.frameCount);
    std::vector<LocalTransform> world(joints);
    for (std::size_t f = 0; f < file.frameCount; ++f) {
        for (std::size_t j = 0; j < joints; ++j) {
            const BvhJoint& joint = file.joints[j];
            world[j] = bvhLocal(joint, file.frame(f), travelling[j] != 0);
            if (joint.parent >= 0) {
                const LocalTransform& parent = world[static_cast<std::size_t>(joint.parent)];
                world[j].position = parent.position + parent.rotation * world[j].position;
                world[j].rotation = parent.rotation * world[j].rotation;
            }
            clip.worldRotations[f * joints + j] = glm::quat(glm::normalize(world[j].rotation));
            clip.worldPositions[f * joints + j] = glm::vec3(world[j].position);
        }
    }
    return clip;
}

Result<SourceClip> clipFromGltf(const GltfDocument& document, std::string_view animation, double framesPerSecond,
                                const ReadLimits& limits) {
    if (!(framesPerSecond >= kMinFramesPerSecond && framesPerSecond <= kMaxFramesPerSecond)) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("{} frames per second is no rate", framesPerSecond));
    }
    ARS_TRY(const GltfAnimation* chosen, findAnimation(document, animation));
    SourceClip clip;
    clip.name = chosen->name;
    clip.format = "gltf";
    clip.framesPerSecond = framesPerSecond;
    const GltfJoints joints = gltfJoints(document, *chosen, clip.skeleton);
    if (joints.nodes.empty()) {
        return makeError(ErrorCode::BadFile, fmt::format("animation \"{}\"", chosen->name), "it moves no node");
    }
    if (joints.nodes.size() > limits.maxJoints) {
        return makeError(ErrorCode::LimitExceeded, "",
                         fmt::format("{} joints, the limit is {}", joints.nodes.size(), limits.maxJoints));
    }
    const double frames = std::floor(static_cast<double>(chosen->endS()) * framesPerSecond + 1e-4) + 1.0;
    if (!(frames >= 1.0 && frames < 1e12)) {
        return makeError(ErrorCode::LimitExceeded, "", fmt::format("an animation of {} seconds", chosen->endS()));
    }
    ARS_TRY_STATUS(checkClipSize(static_cast<std::uint64_t>(frames), joints.nodes.size(), limits));
    resizeClip(clip, static_cast<std::size_t>(frames));
    std::vector<glm::mat4> world(joints.nodes.size());
    for (std::size_t f = 0; f < clip.frameCount; ++f) {
        const float time = static_cast<float>(static_cast<double>(f) / framesPerSecond);
        for (std::size_t j = 0; j < world.size(); ++j) {
            const GltfNode& node = document.nodes[static_cast<std::size_t>(joints.nodes[j])];
            const int parent = clip.skeleton.parents[j];
            const glm::mat4 local = localMatrix(node, joints.channels[j], time);
            world[j] = parent < 0 ? local : world[static_cast<std::size_t>(parent)] * local;
            clip.worldRotations[f * world.size() + j] = orientationOf(world[j]);
            clip.worldPositions[f * world.size() + j] = glm::vec3(world[j][3]);
        }
    }
    return clip;
}

} // namespace ars
