#include "engine/rig/motion.h"

#include "engine/core/file.h"

#include <glm/gtc/constants.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string_view>
#include <tuple>
#include <utility>

namespace ars {
namespace {

constexpr double kMaxAngleRad = 1000.0;
constexpr double kMaxLengthM = 1e6;
constexpr std::size_t kMaxCoefficients = 1024;

/// Numbers of one key, a row per frame.
struct Rows {
    std::vector<float> values;
    std::size_t frames = 0;
    std::size_t width = 0;

    bool empty() const { return frames == 0; }
    glm::vec3 vec3(std::size_t frame, std::size_t column) const {
        const float* row = values.data() + frame * width + column;
        return {row[0], row[1], row[2]};
    }
};

Error badKey(std::string_view key, std::string message) {
    return makeError(ErrorCode::BadFile, fmt::format("key \"{}\"", key), std::move(message));
}

/// Splits a shape into frames and numbers per frame: (F,W), (F,W/3,3), or (W) as one frame.
std::pair<std::size_t, std::size_t> framesAndWidth(const Array& array) {
    if (array.shape.empty()) return {1, array.count()};
    if (array.shape.size() == 1) return {1, array.shape[0]};
    std::size_t width = 1;
    for (std::size_t i = 1; i < array.shape.size(); ++i) width *= array.shape[i];
    return {array.shape[0], width};
}

Status checkNumbers(std::string_view key, const Rows& rows, double bound, std::string_view unit) {
    for (std::size_t i = 0; i < rows.values.size(); ++i) {
        const float value = rows.values[i];
        if (std::isfinite(value) && std::abs(value) <= bound) continue;
        return badKey(key, fmt::format("frame {}, number {}: expected a finite number within {}{}, found {}",
                                       i / rows.width, i % rows.width, bound, unit, value));
    }
    return {};
}

Result<Rows> toRows(std::string_view key, const Array& array) {
    Rows rows;
    std::tie(rows.frames, rows.width) = framesAndWidth(array);
    auto values = array.toFloat();
    if (!values) return badKey(key, fmt::format("expected numbers, found {}", array.describe()));
    rows.values = std::move(*values);
    if (rows.frames == 0 || rows.width == 0) {
        return badKey(key, fmt::format("expected at least one frame, found {}", array.describe()));
    }
    return rows;
}

/// Also a key that cannot be read: asking for it gives its own error, which says why.
bool present(const NpzFile& file, std::string_view key) {
    return file.has(key) || file.unreadable.contains(std::string(key));
}

/// A key of `width` numbers a frame; an absent key gives empty rows.
Result<Rows> readRows(const NpzFile& file, std::string_view key, std::size_t width, double bound,
                      std::string_view unit) {
    if (!present(file, key)) return Rows{};
    ARS_TRY(const Array* array, file.find(key));
    const auto [frames, found] = framesAndWidth(*array);
    if (found != width) {
        const bool hand = width == 45 && found < 45;
        return badKey(key,
                      fmt::format("expected shape (frames, {}), found {}{}", width, array->describe(),
                                  hand ? "; hands must be full axis-angle rotations: export with use_pca=False" : ""));
    }
    ARS_TRY(Rows rows, toRows(key, *array));
    ARS_TRY_STATUS(checkNumbers(key, rows, bound, unit));
    return rows;
}

Result<Rows> readAngles(const NpzFile& file, std::string_view key, std::size_t width) {
    return readRows(file, key, width, kMaxAngleRad, " rad");
}

Result<Rows> readRequiredAngles(const NpzFile& file, std::string_view key, std::size_t width) {
    ARS_TRY([[maybe_unused]] const Array* array, file.find(key));
    return readAngles(file, key, width);
}

/// A list of coefficients, any number: (N), (1,N) or (F,N).
Result<Rows> readCoefficients(const NpzFile& file, std::string_view key) {
    if (!file.has(key)) return Rows{};
    ARS_TRY(const Array* array, file.find(key));
    if (array->count() == 0) return Rows{};
    ARS_TRY(Rows rows, toRows(key, *array));
    if (rows.width > kMaxCoefficients) {
        return badKey(key,
                      fmt::format("expected at most {} coefficients, found {}", kMaxCoefficients, array->describe()));
    }
    ARS_TRY_STATUS(checkNumbers(key, rows, kMaxLengthM, ""));
    return rows;
}

/// Poses by parts, each in SMPL-X's order; empty parts stay at rest.
struct PoseParts {
    std::string anchorKey; ///< whose frame count the others must have
    std::vector<std::pair<std::string, Rows>> parts;
    std::vector<int> firstJoints;

    void add(std::string key, Rows rows, int firstJoint) {
        parts.emplace_back(std::move(key), std::move(rows));
        firstJoints.push_back(firstJoint);
    }
};

Status checkFrameCount(std::string_view key, const Rows& rows, std::string_view anchorKey, std::size_t frames) {
    if (rows.empty() || rows.frames == frames) return {};
    return badKey(key, fmt::format("expected {} frames as in \"{}\", found {}", frames, anchorKey, rows.frames));
}

Status checkFrameLimit(std::size_t frames, std::size_t expressionCount, const ReadLimits& limits) {
    const std::uint64_t frameBytes =
        sizeof(Pose) + kSmplxJointCount * sizeof(glm::quat) + expressionCount * sizeof(float);
    if (frames <= limits.maxElements && frames <= limits.maxBytes / frameBytes) return {};
    return makeError(ErrorCode::LimitExceeded, "",
                     fmt::format("{} frames need {} MB of poses, the limit is {} MB", frames,
                                 frames / 1000000.0 * static_cast<double>(frameBytes), limits.maxBytes / 1000000));
}

Result<std::vector<Pose>> assemble(const PoseParts& pose, const Rows& translation, const Rows& expression,
                                   const ReadLimits& limits) {
    const std::size_t frames = pose.parts.front().second.frames;
    for (const auto& [key, rows] : pose.parts) ARS_TRY_STATUS(checkFrameCount(key, rows, pose.anchorKey, frames));
    ARS_TRY_STATUS(checkFrameCount("transl", translation, pose.anchorKey, frames));
    if (expression.frames != 1) ARS_TRY_STATUS(checkFrameCount("expression", expression, pose.anchorKey, frames));
    ARS_TRY_STATUS(checkFrameLimit(frames, expression.width, limits));
    std::vector<Pose> poses(frames, restPose(kSmplxJointCount));
    for (std::size_t f = 0; f < frames; ++f) {
        for (std::size_t p = 0; p < pose.parts.size(); ++p) {
            const Rows& rows = pose.parts[p].second;
            if (rows.empty()) continue;
            for (std::size_t j = 0; j * 3 < rows.width; ++j) {
                const std::size_t joint = static_cast<std::size_t>(pose.firstJoints[p]) + j;
                poses[f].rotations[joint] = quatFromAxisAngle(rows.vec3(f, j * 3));
            }
        }
        if (!translation.empty()) poses[f].translation = translation.vec3(f, 0);
        if (!expression.empty()) {
            const std::size_t row = expression.frames == 1 ? 0 : f;
            const auto begin = expression.values.begin() + static_cast<std::ptrdiff_t>(row * expression.width);
            poses[f].expression.assign(begin, begin + static_cast<std::ptrdiff_t>(expression.width));
        }
    }
    return poses;
}

Result<double> readRate(const NpzFile& file, double override) {
    if (override != 0.0) {
        if (override >= kMinFramesPerSecond && override <= kMaxFramesPerSecond) return override;
        return makeError(ErrorCode::InvalidArgument, "", fmt::format("{} frames per second is no rate", override));
    }
    for (const char* key : {"mocap_framerate", "mocap_frame_rate", "framerate", "fps"}) {
        if (!file.has(key)) continue;
        ARS_TRY(const Array* array, file.find(key));
        auto values = array->toDouble();
        if (!values || values->size() != 1) {
            return badKey(key, fmt::format("expected one number, found {}", array->describe()));
        }
        const double rate = values->front();
        if (rate >= kMinFramesPerSecond && rate <= kMaxFramesPerSecond) return rate;
        return badKey(key, fmt::format("expected frames per second between {:.3f} and {:.0f}, found {}",
                                       kMinFramesPerSecond, kMaxFramesPerSecond, rate));
    }
    return 30.0;
}

/// The axis along which the pelvis's own y points on average: people are mostly upright.
UpAxis guessUp(const std::vector<Pose>& frames) {
    glm::vec3 mean(0.0f);
    for (const Pose& pose : frames) mean += pose.rotations[0] * glm::vec3(0, 1, 0);
    if (mean.z > std::abs(mean.y)) return UpAxis::Z;
    return mean.y < 0.0f && -mean.y > std::abs(mean.z) ? UpAxis::NegativeY : UpAxis::Y;
}

glm::quat turnToYUp(UpAxis up) {
    if (up == UpAxis::Z) return glm::angleAxis(-glm::half_pi<float>(), glm::vec3(1, 0, 0));
    if (up == UpAxis::NegativeY) return glm::quat(0, 1, 0, 0); // half a turn about x
    return glm::quat(1, 0, 0, 0);
}

void turnWorld(std::vector<Pose>& frames, const glm::quat& turn, const glm::vec3& recordedPelvis,
               const glm::vec3& targetPelvis) {
    for (Pose& pose : frames) {
        pose.translation = turn * (recordedPelvis + pose.translation) - targetPelvis;
        pose.rotations[0] = turn * pose.rotations[0];
    }
}

Result<Motion> readSmplParams(const NpzFile& file, const MotionReadOptions& options, const ReadLimits& limits) {
    PoseParts pose;
    pose.anchorKey = "global_orient";
    struct Part {
        const char* key;
        std::size_t width;
        int firstJoint;
        bool required;
    };
    for (const Part& part :
         {Part{"global_orient", 3, 0, true}, Part{"body_pose", 63, 1, true}, Part{"jaw_pose", 3, 22, false},
          Part{"leye_pose", 3, 23, false}, Part{"reye_pose", 3, 24, false}, Part{"left_hand_pose", 45, 25, false},
          Part{"right_hand_pose", 45, 40, false}}) {
        ARS_TRY(Rows rows, part.required ? readRequiredAngles(file, part.key, part.width)
                                         : readAngles(file, part.key, part.width));
        pose.add(part.key, std::move(rows), part.firstJoint);
    }
    ARS_TRY([[maybe_unused]] const Array* array, file.find("transl"));
    ARS_TRY(const Rows translation, readRows(file, "transl", 3, kMaxLengthM, " m"));
    ARS_TRY(const Rows expression, readCoefficients(file, "expression"));
    ARS_TRY(Rows betas, readCoefficients(file, "betas"));
    Motion motion;
    motion.source = "smpl_params";
    ARS_TRY(motion.framesPerSecond, readRate(file, options.framesPerSecond));
    ARS_TRY(motion.frames, assemble(pose, translation, expression, limits));
    betas.values.resize(std::min(betas.values.size(), betas.width));
    motion.betas = std::move(betas.values);
    const glm::vec3 recorded = options.recordedPelvisM.value_or(kSmplxPelvisM);
    if (options.up == UpAxis::Z || options.up == UpAxis::NegativeY) {
        turnWorld(motion.frames, turnToYUp(options.up), recorded, options.targetPelvisM.value_or(recorded));
    }
    return motion;
}

enum class PoseLayout { BodyOnly, Smpl, SmplH, SmplX };

/// Where the numbers of `poses` (one long row a frame) belong.
Result<PoseLayout> layoutOfWidth(std::string_view key, const Array& array) {
    switch (framesAndWidth(array).second) {
    case 66:
        return PoseLayout::BodyOnly;
    case 72:
        return PoseLayout::Smpl;
    case 156:
        return PoseLayout::SmplH;
    case 165:
        return PoseLayout::SmplX;
    default:
        break;
    }
    return badKey(key,
                  fmt::format("expected 165 (SMPL-X), 156 (SMPL+H), 72 (SMPL) or 66 (body) numbers a frame, found {}",
                              array.describe()));
}

/// Columns [begin, begin + count) of `rows`.
Rows columns(const Rows& rows, std::size_t begin, std::size_t count) {
    Rows part;
    part.frames = rows.frames;
    part.width = count;
    part.values.reserve(rows.frames * count);
    for (std::size_t f = 0; f < rows.frames; ++f) {
        const auto first = rows.values.begin() + static_cast<std::ptrdiff_t>(f * rows.width + begin);
        part.values.insert(part.values.end(), first, first + static_cast<std::ptrdiff_t>(count));
    }
    return part;
}

Result<PoseParts> splitPoses(const Array& array, PoseLayout& layout) {
    ARS_TRY(layout, layoutOfWidth("poses", array));
    ARS_TRY(const Rows rows, toRows("poses", array));
    ARS_TRY_STATUS(checkNumbers("poses", rows, kMaxAngleRad, " rad"));
    PoseParts pose;
    pose.anchorKey = "poses";
    if (layout == PoseLayout::SmplX) {
        pose.add("poses", rows, 0);
        return pose;
    }
    pose.add("poses", columns(rows, 0, 66), 0);
    // SMPL+H has no jaw and eyes; SMPL's two rigid hands say nothing about fingers.
    if (layout == PoseLayout::SmplH) pose.add("poses", columns(rows, 66, 90), 25);
    return pose;
}

Result<PoseParts> readNamedParts(const NpzFile& file) {
    PoseParts pose;
    pose.anchorKey = "root_orient";
    ARS_TRY(Rows root, readRequiredAngles(file, "root_orient", 3));
    ARS_TRY(Rows body, readRequiredAngles(file, "pose_body", 63));
    ARS_TRY(Rows jaw, readAngles(file, "pose_jaw", 3));
    ARS_TRY(Rows eyes, readAngles(file, "pose_eye", 6));
    ARS_TRY(Rows hands, readAngles(file, "pose_hand", 90));
    pose.add("root_orient", std::move(root), 0);
    pose.add("pose_body", std::move(body), 1);
    pose.add("pose_jaw", std::move(jaw), 22);
    pose.add("pose_eye", std::move(eyes), 23);
    pose.add("pose_hand", std::move(hands), 25);
    return pose;
}

bool isAmass(const NpzFile& file) {
    return file.has("mocap_framerate") || file.has("mocap_frame_rate") || file.has("dmpls") || file.has("marker_data");
}

Result<Motion> readPoses(const NpzFile& file, const MotionReadOptions& options, const ReadLimits& limits) {
    PoseLayout layout = PoseLayout::SmplX;
    PoseParts pose;
    if (present(file, "poses")) {
        ARS_TRY(const Array* array, file.find("poses"));
        ARS_TRY(pose, splitPoses(*array, layout));
    } else {
        ARS_TRY(pose, readNamedParts(file));
    }
    const char* translationKey = present(file, "trans") ? "trans" : "transl";
    ARS_TRY(const Rows translation, readRows(file, translationKey, 3, kMaxLengthM, " m"));
    Motion motion;
    ARS_TRY(motion.framesPerSecond, readRate(file, options.framesPerSecond));
    ARS_TRY(motion.frames, assemble(pose, translation, {}, limits));
    const bool smplx = layout == PoseLayout::SmplX;
    motion.source = !isAmass(file) ? "poses" : smplx ? "amass smpl-x" : "amass smpl+h";
    if (smplx) { // shapes of other models mean nothing to SMPL-X
        ARS_TRY(Rows betas, readCoefficients(file, "betas"));
        betas.values.resize(std::min(betas.values.size(), betas.width));
        motion.betas = std::move(betas.values);
    }
    UpAxis up = options.up;
    if (up == UpAxis::Auto) up = isAmass(file) ? UpAxis::Z : guessUp(motion.frames);
    const glm::vec3 recorded = options.recordedPelvisM.value_or(smplx ? kSmplxPelvisM : kSmplhPelvisM);
    const glm::vec3 target = options.targetPelvisM.value_or(smplx ? recorded : kSmplxPelvisM);
    // A file without translation puts the pelvis over the origin, not below it.
    const glm::quat turn = turnToYUp(up);
    if (translation.empty())
        turnWorld(motion.frames, turn, glm::vec3(0.0f), glm::vec3(0.0f));
    else
        turnWorld(motion.frames, turn, recorded, target);
    return motion;
}

Array packed(const Motion& motion, int firstJoint, int jointCount) {
    std::vector<float> values;
    values.reserve(motion.frames.size() * static_cast<std::size_t>(jointCount) * 3);
    for (const Pose& pose : motion.frames) {
        for (int j = firstJoint; j < firstJoint + jointCount; ++j) {
            const glm::vec3 v = axisAngleFromQuat(pose.rotations[static_cast<std::size_t>(j)]);
            values.insert(values.end(), {v.x, v.y, v.z});
        }
    }
    return Array::fromFloats({motion.frames.size(), static_cast<std::size_t>(jointCount) * 3}, values);
}

Array packedTranslation(const Motion& motion) {
    std::vector<float> values;
    for (const Pose& pose : motion.frames) {
        values.insert(values.end(), {pose.translation.x, pose.translation.y, pose.translation.z});
    }
    return Array::fromFloats({motion.frames.size(), 3}, values);
}

Array packedExpression(const Motion& motion) {
    std::size_t width = 10;
    for (const Pose& pose : motion.frames) width = std::max(width, pose.expression.size());
    std::vector<float> values(motion.frames.size() * width, 0.0f);
    for (std::size_t f = 0; f < motion.frames.size(); ++f) {
        std::copy(motion.frames[f].expression.begin(), motion.frames[f].expression.end(),
                  values.begin() + static_cast<std::ptrdiff_t>(f * width));
    }
    return Array::fromFloats({motion.frames.size(), width}, values);
}

bool turns(const Motion& motion, int joint) {
    return std::any_of(motion.frames.begin(), motion.frames.end(), [joint](const Pose& pose) {
        return std::abs(pose.rotations[static_cast<std::size_t>(joint)].w) < 1.0f - 1e-7f;
    });
}

double clampedRate(double framesPerSecond) {
    if (!(framesPerSecond >= kMinFramesPerSecond)) return kMinFramesPerSecond; // NaN too
    return std::min(framesPerSecond, kMaxFramesPerSecond);
}

} // namespace

double Motion::durationS() const {
    return frames.empty() ? 0.0 : static_cast<double>(frames.size() - 1) / framesPerSecond;
}

std::string_view upAxisName(UpAxis up) {
    switch (up) {
    case UpAxis::Auto:
        return "auto";
    case UpAxis::Y:
        return "y";
    case UpAxis::Z:
        return "z";
    case UpAxis::NegativeY:
        return "-y";
    }
    return "auto";
}

Result<UpAxis> parseUpAxis(std::string_view name) {
    for (UpAxis up : {UpAxis::Auto, UpAxis::Y, UpAxis::Z, UpAxis::NegativeY}) {
        if (name == upAxisName(up)) return up;
    }
    return makeError(ErrorCode::InvalidArgument, "", fmt::format("expected auto, y, z or -y, found \"{}\"", name));
}

Result<Motion> motionFromArrays(const NpzFile& file, const MotionReadOptions& options, const ReadLimits& limits) {
    if (present(file, "global_orient") || present(file, "body_pose")) return readSmplParams(file, options, limits);
    for (const char* key : {"poses", "root_orient", "pose_body"}) {
        if (present(file, key)) return readPoses(file, options, limits);
    }
    std::string keys;
    for (const auto& [key, array] : file.arrays) keys += (keys.empty() ? "" : ", ") + key;
    return makeError(ErrorCode::BadFile, "",
                     fmt::format("expected a motion: global_orient and body_pose (smpl_params), poses (AMASS), or "
                                 "root_orient and pose_body; found {}",
                                 keys.empty() ? "no keys" : "the keys " + keys));
}

Result<Motion> readMotionNpz(const std::filesystem::path& path, const MotionReadOptions& options,
                             const ReadLimits& limits) {
    const auto read = [&]() -> Result<Motion> {
        ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
        NpzFile file;
        if (!bytes.empty() && bytes[0] == std::byte{0x93}) {
            auto array = parseNpy(bytes, limits);
            if (!array) return atPlace(std::move(array).error(), path.string());
            file.arrays.emplace("poses", std::move(*array));
        } else {
            auto parsed = parseNpz(bytes, limits);
            if (!parsed) return atPlace(std::move(parsed).error(), path.string());
            file = std::move(*parsed);
        }
        auto motion = motionFromArrays(file, options, limits);
        if (!motion) return atPlace(std::move(motion).error(), path.string());
        return motion;
    };
    auto motion = read();
    if (motion) motion->name = path.stem().string();
    return motion;
}

Status writeSmplParams(const std::filesystem::path& path, const Motion& motion) {
    if (motion.frames.empty()) return makeError(ErrorCode::InvalidArgument, path.string(), "a motion without frames");
    for (std::size_t f = 0; f < motion.frames.size(); ++f) {
        if (motion.frames[f].rotations.size() == kSmplxJointCount) continue;
        return makeError(ErrorCode::InvalidArgument, path.string(),
                         fmt::format("frame {}: expected 55 joints, found {}", f, motion.frames[f].rotations.size()));
    }
    std::vector<float> betas = motion.betas;
    betas.resize(std::max<std::size_t>(betas.size(), 10), 0.0f);
    std::vector<std::pair<std::string, Array>> arrays;
    arrays.emplace_back("betas", Array::fromFloats({1, betas.size()}, betas));
    arrays.emplace_back("global_orient", packed(motion, 0, 1));
    arrays.emplace_back("transl", packedTranslation(motion));
    arrays.emplace_back("body_pose", packed(motion, 1, 21));
    arrays.emplace_back("jaw_pose", packed(motion, 22, 1));
    arrays.emplace_back("expression", packedExpression(motion));
    arrays.emplace_back("left_hand_pose", packed(motion, 25, 15));
    arrays.emplace_back("right_hand_pose", packed(motion, 40, 15));
    const double rate[] = {motion.framesPerSecond};
    arrays.emplace_back("mocap_framerate", Array::fromDoubles({}, rate));
    if (turns(motion, 23)) arrays.emplace_back("leye_pose", packed(motion, 23, 1));
    if (turns(motion, 24)) arrays.emplace_back("reye_pose", packed(motion, 24, 1));
    return writeNpz(path, arrays);
}

Pose sampleMotion(const Motion& motion, double timeS) {
    if (motion.frames.empty()) return restPose(kSmplxJointCount);
    const double last = static_cast<double>(motion.frames.size() - 1);
    const double position = timeS * motion.framesPerSecond;
    if (!(position > 0.0)) return motion.frames.front(); // NaN too
    if (position >= last) return motion.frames.back();
    const std::size_t frame = static_cast<std::size_t>(position);
    const float t = static_cast<float>(position - static_cast<double>(frame));
    return interpolatePoses(motion.frames[frame], motion.frames[frame + 1], t);
}

Motion resampleMotion(const Motion& motion, double framesPerSecond) {
    Motion result;
    result.name = motion.name;
    result.source = motion.source;
    result.betas = motion.betas;
    result.framesPerSecond = clampedRate(framesPerSecond);
    if (motion.frames.empty()) return result;
    // A small excess keeps the last frame when the rates divide evenly but the quotient rounds down.
    const double steps = motion.durationS() * result.framesPerSecond;
    const std::size_t count = static_cast<std::size_t>(steps + 1e-6) + 1;
    result.frames.reserve(count);
    for (std::size_t f = 0; f < count; ++f) {
        Pose pose = sampleMotion(motion, static_cast<double>(f) / result.framesPerSecond);
        if (f > 0) {
            // Neighbours keep the same sign, so that whoever interpolates the four numbers takes the short way.
            for (std::size_t j = 0; j < pose.rotations.size(); ++j) {
                if (glm::dot(pose.rotations[j], result.frames.back().rotations[j]) < 0.0f) {
                    pose.rotations[j] = -pose.rotations[j];
                }
            }
        }
        result.frames.push_back(std::move(pose));
    }
    return result;
}

} // namespace ars
