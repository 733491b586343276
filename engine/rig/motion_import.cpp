#include "engine/rig/motion_import.h"

#include "engine/core/file.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace ars {
namespace {

constexpr float kCentimetresPerMetre = 100.0f;
/// A target whose pelvis lies this near to SMPL-X's is taken for the body that was recorded, shape aside.
constexpr float kSamePelvisM = 0.15f;

std::string_view textOf(std::span<const std::byte> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

bool startsWithWord(std::string_view text, std::string_view word) {
    if (text.size() < word.size()) return false;
    return std::equal(word.begin(), word.end(), text.begin(),
                      [](char a, char b) { return a == (b >= 'a' && b <= 'z' ? b - 32 : b); });
}

MotionReadOptions readOptions(const Skeleton& target, const MotionImportOptions& options) {
    MotionReadOptions read;
    read.up = options.up;
    read.targetPelvisM = target.restPositions.front();
    if (glm::distance(*read.targetPelvisM, kSmplxPelvisM) < kSamePelvisM) read.recordedPelvisM = read.targetPelvisM;
    return read;
}

Result<Motion> importArrays(std::span<const std::byte> file, MotionFormat format, const Skeleton& target,
                            const MotionImportOptions& options, const ReadLimits& limits) {
    NpzFile arrays;
    if (format == MotionFormat::Npy) {
        ARS_TRY(Array array, parseNpy(file, limits));
        arrays.arrays.emplace("poses", std::move(array));
    } else {
        ARS_TRY(arrays, parseNpz(file, limits));
    }
    MotionReadOptions read = readOptions(target, options);
    // SMPL+H has its own pelvis; SMPL-X's applies to everything else.
    const auto poses = arrays.arrays.find("poses");
    if (poses != arrays.arrays.end() && !poses->second.shape.empty() &&
        poses->second.count() < 165 * poses->second.shape[0]) {
        read.recordedPelvisM.reset();
    }
    return motionFromArrays(arrays, read, limits);
}

Result<RetargetMap> namedMap(const std::string& wanted, std::span<const RetargetMap> maps) {
    for (const RetargetMap& map : maps) {
        if (map.name == wanted) return map;
    }
    std::error_code ignored;
    if (std::filesystem::exists(wanted, ignored)) return readRetargetMap(wanted);
    std::string names;
    for (const RetargetMap& map : maps) names += (names.empty() ? "" : ", ") + map.name;
    return makeError(ErrorCode::NotFound, wanted,
                     fmt::format("neither a file nor a joint map of this program ({})", names));
}

Result<Motion> retargetClip(const SourceClip& clip, const Skeleton& target, const MotionImportOptions& options,
                            RetargetReport* report, const std::vector<RetargetMap>* given) {
    std::vector<RetargetMap> own;
    if (!given) {
        // Without the folder of maps, names can still be recognised.
        if (auto read = readRetargetMaps())
            own = std::move(*read);
        else if (read.error().code != ErrorCode::NotFound && read.error().code != ErrorCode::Io)
            return std::move(read).error();
        given = &own;
    }
    ARS_TRY(const RetargetMap map,
            options.map.empty() ? chooseRetargetMap(clip.skeleton, *given) : namedMap(options.map, *given));
    RetargetOptions transfer;
    transfer.up = options.up;
    transfer.metresPerUnit = options.metresPerUnit;
    transfer.startAtOrigin = false; // both shifts belong to the frames that are kept
    transfer.placeOnFloor = false;
    transfer.skipLeadIn = options.skipLeadIn && options.firstFrame == 0 && options.frameCount == 0;
    return retarget(clip, map, target, transfer, report);
}

Status cutFrames(Motion& motion, const MotionImportOptions& options) {
    const std::size_t total = motion.frames.size();
    if (options.firstFrame >= total) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("frame {} is asked for, the motion has {}", options.firstFrame, total));
    }
    const std::size_t rest = total - options.firstFrame;
    const std::size_t count = options.frameCount == 0 ? rest : std::min(options.frameCount, rest);
    const auto begin = motion.frames.begin() + static_cast<std::ptrdiff_t>(options.firstFrame);
    motion.frames = std::vector<Pose>(begin, begin + static_cast<std::ptrdiff_t>(count));
    return {};
}

void place(Motion& motion, const Skeleton& target, const MotionImportOptions& options, RetargetReport* report) {
    const bool clip = motion.source == "bvh" || motion.source == "gltf";
    glm::vec3 shift(0.0f);
    if (clip && options.startAtOrigin) {
        shift = -(target.restPositions.front() + motion.frames.front().translation);
        shift.y = 0.0f;
    }
    const bool wanted = options.floor == FloorPlacement::Place ||
                        (options.floor == FloorPlacement::Auto && motion.source != "smpl_params");
    if (wanted) shift.y = floorShift(motion, target, options.soleHeightM);
    for (Pose& pose : motion.frames) pose.translation += shift;
    if (report) report->floorShiftM = shift.y;
}

Status checkOptions(const Skeleton& target, const MotionImportOptions& options) {
    if (target.jointCount() != kSmplxJointCount || target.restPositions.size() != kSmplxJointCount) {
        return makeError(
            ErrorCode::InvalidArgument, "",
            fmt::format("motions are played on SMPL-X skeletons of 55 joints, this one has {}", target.jointCount()));
    }
    const double rate = options.framesPerSecond;
    if (rate == 0.0 || (rate >= kMinFramesPerSecond && rate <= kMaxFramesPerSecond)) return {};
    return makeError(ErrorCode::InvalidArgument, "", fmt::format("{} frames per second is no rate", rate));
}

Status checkResampled(const Motion& motion, double rate, const ReadLimits& limits) {
    const double frames = motion.durationS() * rate + 1.0;
    const double bytes = frames * static_cast<double>(sizeof(Pose) + kSmplxJointCount * sizeof(glm::quat));
    if (bytes <= static_cast<double>(limits.maxBytes)) return {};
    return makeError(ErrorCode::LimitExceeded, "",
                     fmt::format("{:.0f} frames at {} frames per second, the limit is {} MB", frames, rate,
                                 limits.maxBytes / 1000000));
}

Result<Motion> readAny(std::span<const std::byte> file, const Skeleton& target, const MotionImportOptions& options,
                       RetargetReport* report, const ReadLimits& limits, const std::vector<RetargetMap>* maps,
                       const std::filesystem::path& folder) {
    const MotionFormat format = recogniseMotion(file);
    switch (format) {
    case MotionFormat::Npz:
    case MotionFormat::Npy:
        return importArrays(file, format, target, options, limits);
    case MotionFormat::Bvh: {
        ARS_TRY(const BvhFile bvh, parseBvh(file, limits));
        ARS_TRY(const SourceClip clip, clipFromBvh(bvh, limits));
        return retargetClip(clip, target, options, report, maps);
    }
    case MotionFormat::Gltf: {
        ARS_TRY(const GltfDocument document, parseGltf(file, folder, limits));
        const double rate = options.framesPerSecond > 0.0 ? options.framesPerSecond : 30.0;
        ARS_TRY(const SourceClip clip, clipFromGltf(document, options.animation, rate, limits));
        return retargetClip(clip, target, options, report, maps);
    }
    case MotionFormat::Unknown:
        break;
    }
    return makeError(ErrorCode::Unsupported, "",
                     "expected a motion (npz, npy, BVH, glTF or glb), found something else");
}

// ---- BVH out

/// Rotation as Z, X, Y angles in degrees, R = Rz Rx Ry; the Z angle is 0 where the two outer axes fall together.
glm::vec3 anglesZxy(const glm::quat& rotation) {
    const glm::dmat3 r = glm::mat3_cast(glm::normalize(glm::dquat(rotation))); // r[column][row]
    const double sineX = glm::clamp(r[1][2], -1.0, 1.0);
    const double x = std::asin(sineX);
    double y, z;
    if (std::abs(sineX) < 1.0 - 1e-12) {
        z = std::atan2(-r[1][0], r[1][1]);
        y = std::atan2(-r[0][2], r[2][2]);
    } else {
        z = 0.0;
        y = std::atan2(r[2][0], r[0][0]);
    }
    return glm::vec3(glm::degrees(glm::dvec3(z, x, y)));
}

BvhFile bvhHierarchy(const Skeleton& skeleton) {
    using enum BvhChannel;
    BvhFile file;
    for (int j = 0; j < skeleton.jointCount(); ++j) {
        const auto i = static_cast<std::size_t>(j);
        BvhJoint joint;
        joint.name = skeleton.names[i];
        joint.parent = skeleton.parents[i];
        joint.firstChannel = file.channelCount;
        joint.channels = {Zrotation, Xrotation, Yrotation};
        glm::vec3 bone(0.0f, 0.05f, 0.0f);
        if (joint.parent < 0) {
            joint.channels.insert(joint.channels.begin(), {Xposition, Yposition, Zposition});
        } else {
            bone = skeleton.restPositions[i] - skeleton.restPositions[static_cast<std::size_t>(joint.parent)];
            joint.offset = kCentimetresPerMetre * bone;
        }
        // A leaf needs an end: half the bone before it goes on.
        if (skeleton.children(j).empty()) joint.endSites.push_back(0.5f * kCentimetresPerMetre * bone);
        file.channelCount += joint.channels.size();
        file.joints.push_back(std::move(joint));
    }
    return file;
}

void appendFrame(BvhFile& file, const Skeleton& skeleton, const Pose& pose) {
    const auto orientation = [&](std::size_t j) {
        return skeleton.restOrientations.empty() ? glm::quat(1, 0, 0, 0) : skeleton.restOrientations[j];
    };
    for (std::size_t j = 0; j < file.joints.size(); ++j) {
        if (file.joints[j].parent < 0) {
            const glm::vec3 place = kCentimetresPerMetre * (skeleton.restPositions[j] + pose.translation);
            file.values.insert(file.values.end(), {place.x, place.y, place.z});
        }
        // BVH joints share the file's axes at rest: the rotation is told in model axes.
        const glm::quat o = orientation(j);
        const glm::vec3 angles = anglesZxy(o * pose.rotations[j] * glm::inverse(o));
        file.values.insert(file.values.end(), {angles.x, angles.y, angles.z});
    }
}

} // namespace

std::string_view motionFormatName(MotionFormat format) {
    switch (format) {
    case MotionFormat::Npz:
        return "npz";
    case MotionFormat::Npy:
        return "npy";
    case MotionFormat::Bvh:
        return "bvh";
    case MotionFormat::Gltf:
        return "gltf";
    case MotionFormat::Unknown:
        break;
    }
    return "unknown";
}

MotionFormat recogniseMotion(std::span<const std::byte> head) {
    std::string_view text = textOf(head.subspan(0, std::min<std::size_t>(head.size(), 4096)));
    if (text.starts_with("PK")) return MotionFormat::Npz;
    if (text.starts_with("\x93NUMPY")) return MotionFormat::Npy;
    if (text.starts_with("glTF")) return MotionFormat::Gltf;
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    while (!text.empty()) {
        text.remove_prefix(std::min(text.find_first_not_of(" \t\r\n"), text.size()));
        if (!text.starts_with('#')) break;
        text.remove_prefix(std::min(text.find('\n'), text.size())); // a comment before the hierarchy
    }
    if (startsWithWord(text, "HIERARCHY")) return MotionFormat::Bvh;
    return text.starts_with('{') ? MotionFormat::Gltf : MotionFormat::Unknown;
}

Result<Motion> importMotionBytes(std::span<const std::byte> file, const Skeleton& target,
                                 const MotionImportOptions& options, RetargetReport* report, const ReadLimits& limits,
                                 const std::vector<RetargetMap>* maps, const std::filesystem::path& folder) {
    ARS_TRY_STATUS(checkOptions(target, options));
    ARS_TRY(Motion motion, readAny(file, target, options, report, limits, maps, folder));
    ARS_TRY_STATUS(cutFrames(motion, options));
    if (options.framesPerSecond > 0.0 && options.framesPerSecond != motion.framesPerSecond) {
        ARS_TRY_STATUS(checkResampled(motion, options.framesPerSecond, limits));
        motion = resampleMotion(motion, options.framesPerSecond);
    }
    place(motion, target, options, report);
    return motion;
}

Result<Motion> importMotion(const std::filesystem::path& path, const Skeleton& target,
                            const MotionImportOptions& options, RetargetReport* report, const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    auto motion = importMotionBytes(bytes, target, options, report, limits, nullptr,
                                    path.has_parent_path() ? path.parent_path() : std::filesystem::path("."));
    if (!motion) return atPlace(std::move(motion).error(), path.string());
    if (motion->name.empty()) motion->name = path.stem().string();
    return motion;
}

Result<BvhFile> bvhFromMotion(const Motion& motion, const Skeleton& skeleton) {
    if (motion.frames.empty()) return makeError(ErrorCode::InvalidArgument, "", "a motion without frames");
    ARS_TRY_STATUS(validateSkeleton(skeleton));
    BvhFile file = bvhHierarchy(skeleton);
    file.frameTimeS = 1.0 / motion.framesPerSecond;
    file.frameCount = motion.frames.size();
    file.values.reserve(file.frameCount * file.channelCount);
    for (std::size_t f = 0; f < motion.frames.size(); ++f) {
        if (motion.frames[f].rotations.size() != file.joints.size()) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("frame {}", f),
                             fmt::format("it has {} joints, the skeleton {}", motion.frames[f].rotations.size(),
                                         file.joints.size()));
        }
        appendFrame(file, skeleton, motion.frames[f]);
    }
    return file;
}

Status writeMotionBvh(const std::filesystem::path& path, const Motion& motion, const Skeleton& skeleton) {
    ARS_TRY(const BvhFile file, bvhFromMotion(motion, skeleton));
    return writeBvh(path, file);
}

} // namespace ars
