#include "app/inspect.h"
#include "app/text.h"
#include "engine/io/npz.h"
#include "engine/io/safetensors.h"
#include "engine/rig/body_model.h"
#include "engine/rig/motion.h"
#include "engine/rig/template_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

namespace ars::app {
namespace {

/// What the keys of an archive say it is.
enum class NpzMeaning { Body, Motion, Template, Other };

NpzMeaning meaningOf(const std::set<std::string>& keys) {
    const auto has = [&](const char* key) { return keys.contains(key); };
    // Any of them: a body that lacks one is a broken body, not an archive of something else.
    if (has("v_template") || has("J_regressor") || has("kintree_table")) return NpzMeaning::Body;
    if (has("global_orient") || has("body_pose") || has("poses") || has("root_orient") || has("pose_body")) {
        return NpzMeaning::Motion;
    }
    if (has("v") && has("f")) return NpzMeaning::Template;
    return NpzMeaning::Other;
}

std::string shapeText(DType type, const std::vector<std::size_t>& shape) {
    return fmt::format("{} {}", dtypeName(type), formatShape(shape));
}

std::size_t countNonFinite(const Array& array) {
    if (array.dtype != DType::F32 && array.dtype != DType::F64 && array.dtype != DType::F16 &&
        array.dtype != DType::BF16) {
        return 0;
    }
    const auto values = array.toDouble();
    if (!values) return 0;
    return static_cast<std::size_t>(
        std::count_if(values->begin(), values->end(), [](double value) { return !std::isfinite(value); }));
}

void warnNonFinite(FileReport& report, const std::string& name, const Array& array) {
    if (const std::size_t count = countNonFinite(array)) {
        report.warn(fmt::format("{}: {} not finite", name, counted(count, "number is", "numbers are")));
    }
}

/// Lists arrays that the program gives no meaning of its own: one line each, the rest counted.
void addArrayList(FileReport& report, const std::vector<NpzEntry>& entries, bool forPeople) {
    Json json = Json::object();
    std::string text;
    std::size_t shown = 0;
    for (const NpzEntry& entry : entries) {
        json[entry.key] = {{"dtype", dtypeName(entry.dtype)}, {"shape", entry.shape}};
        if (!entry.problem.empty()) json[entry.key] = {{"problem", entry.problem}};
        if (++shown > 24) continue;
        const std::string what = entry.problem.empty() ? shapeText(entry.dtype, entry.shape) : "cannot be read";
        text += fmt::format("{}{} {}", text.empty() ? "" : "; ", entry.key, what);
    }
    if (shown > 24) text += fmt::format("; and {} more", shown - 24);
    report.add("arrays", forPeople ? text : "", json);
}

/// Rows of given weights that do not sum to one, which the reader normalises.
void addWeightSums(FileReport& report, const NpzFile& file) {
    const auto found = file.find("weights");
    if (!found || (*found)->shape.size() != 2) return;
    const auto values = (*found)->toDouble();
    const std::size_t width = (*found)->shape[1];
    if (!values || width == 0) return;
    double low = 1.0, high = 1.0;
    for (std::size_t row = 0; row < (*found)->shape[0]; ++row) {
        double sum = 0.0;
        for (std::size_t j = 0; j < width; ++j) sum += (*values)[row * width + j];
        low = std::min(low, sum);
        high = std::max(high, sum);
    }
    report.add("weight_sums", "", Json{low, high});
    if (low < 0.999 || high > 1.001) {
        report.warn(
            fmt::format("the weights of a vertex sum to {:.4f} .. {:.4f}; they are normalised when read", low, high));
    }
}

void inspectBody(FileReport& report, const NpzFile& file) {
    const auto body = bodyModelFromArrays(file);
    if (!body) return report.fail(body.error());
    report.add("vertices", grouped(body->vertexCount()), body->vertexCount());
    report.add("triangles", grouped(body->triangles.size()), body->triangles.size());
    report.add("joints", fmt::format("{} (SMPL-X order)", body->parents.size()), body->parents.size());
    const std::string shapes = body->shapeNames.empty() ? "" : fmt::format(" ({})", listed(body->shapeNames, 4));
    report.add("shape", counted(static_cast<std::uint64_t>(body->shapeCount), "coefficient") + shapes,
               body->shapeCount);
    report.add("expression", counted(static_cast<std::uint64_t>(body->expressionCount), "coefficient"),
               body->expressionCount);
    report.add("pose_blend_shapes", body->poseDirs.empty() ? "none (all zero)" : "yes", !body->poseDirs.empty());
    const auto turns = [](const std::vector<float>& mean) {
        return std::any_of(mean.begin(), mean.end(), [](float v) { return v != 0.0f; });
    };
    const bool handMean = turns(body->handMeanLeft) || turns(body->handMeanRight);
    report.add("hand_mean", handMean ? "given" : "flat hands", handMean);
    addExtent(report, body->templateVertices);
    addWeightSums(report, file);
}

/// Largest angle of joints [first, end) over all frames, radians.
float largestAngle(const Motion& motion, int first, int end) {
    float largest = 0.0f;
    for (const Pose& pose : motion.frames) {
        for (int j = first; j < end; ++j) {
            largest = std::max(largest, glm::length(axisAngleFromQuat(pose.rotations[static_cast<std::size_t>(j)])));
        }
    }
    return largest;
}

std::vector<std::string> movingParts(const Motion& motion) {
    constexpr float kTurned = 1e-4f; // radians
    std::vector<std::string> parts;
    if (largestAngle(motion, 1, 22) > kTurned) parts.push_back("body");
    if (largestAngle(motion, 22, 23) > kTurned) parts.push_back("jaw");
    if (largestAngle(motion, 23, 25) > kTurned) parts.push_back("eyes");
    if (largestAngle(motion, 25, kSmplxJointCount) > kTurned) parts.push_back("fingers");
    const bool face = std::any_of(motion.frames.begin(), motion.frames.end(), [](const Pose& pose) {
        return std::any_of(pose.expression.begin(), pose.expression.end(), [](float v) { return v != 0.0f; });
    });
    if (face) parts.push_back("expression");
    return parts;
}

void addMotion(FileReport& report, const Motion& motion) {
    report.add("frames", grouped(motion.frames.size()), motion.frames.size());
    report.add("frames_per_second", fmt::format("{:g}", motion.framesPerSecond), motion.framesPerSecond);
    report.add("duration", fmt::format("{:.2f} s", motion.durationS()), motion.durationS());
    const std::vector<std::string> parts = movingParts(motion);
    report.add("poses", parts.empty() ? "rest pose only" : listed(parts), parts);
    const bool shaped = std::any_of(motion.betas.begin(), motion.betas.end(), [](float v) { return v != 0.0f; });
    report.add("betas",
               motion.betas.empty() ? "none" : fmt::format("{}{}", motion.betas.size(), shaped ? "" : ", all zero"),
               motion.betas);
    glm::vec3 low = motion.frames[0].translation, high = low;
    for (const Pose& pose : motion.frames) {
        low = glm::min(low, pose.translation);
        high = glm::max(high, pose.translation);
    }
    const glm::vec3 way = high - low;
    report.add("travel", fmt::format("{:.2f} x {:.2f} x {:.2f} m (x, y, z)", way.x, way.y, way.z),
               Json{way.x, way.y, way.z});
}

std::string motionTitle(std::string_view container, const Motion& motion) {
    if (motion.source == "smpl_params") return fmt::format("{}, SMPL-X motion (smpl_params)", container);
    if (motion.source == "amass smpl+h") return fmt::format("{}, AMASS motion (SMPL+H)", container);
    if (motion.source == "amass smpl-x") return fmt::format("{}, AMASS motion (SMPL-X)", container);
    return fmt::format("{}, plain poses", container);
}

void inspectMotion(FileReport& report, const NpzFile& file, const InspectOptions& options) {
    const auto motion = motionFromArrays(file, {}, options.limits);
    if (!motion) return report.fail(motion.error());
    report.title = motionTitle("numpy archive", *motion);
    report.add("source", "", motion->source);
    addMotion(report, *motion);
}

/// A template without weights: positions and indices only.
void inspectBareMesh(FileReport& report, const NpzFile& file) {
    const auto read = [&]() -> Status {
        ARS_TRY(const Array* v, file.find("v"));
        ARS_TRY(const Array* f, file.find("f"));
        ARS_TRY_STATUS(requireShape(*v, "v", std::array<std::size_t, 2>{kAnySize, 3}));
        ARS_TRY_STATUS(requireShape(*f, "f", std::array<std::size_t, 2>{kAnySize, 3}));
        ARS_TRY(const std::vector<float> positions, v->toFloat());
        ARS_TRY(const std::vector<std::int64_t> indices, f->toInt64());
        const auto vertices = static_cast<std::int64_t>(positions.size() / 3);
        for (std::size_t i = 0; i < positions.size(); ++i) {
            if (!std::isfinite(positions[i])) {
                return makeError(ErrorCode::BadFile, fmt::format("key \"v\", vertex {}", i / 3), "is not finite");
            }
        }
        for (std::size_t i = 0; i < indices.size(); ++i) {
            if (indices[i] < 0 || indices[i] >= vertices) {
                return makeError(ErrorCode::BadFile, fmt::format("key \"f\", triangle {}", i / 3),
                                 fmt::format("names vertex {}, the file has {}", indices[i], vertices));
            }
        }
        report.add("vertices", grouped(v->shape[0]), v->shape[0]);
        report.add("triangles", grouped(f->shape[0]), f->shape[0]);
        report.add("weights", "none: they are diffused from a body", Json());
        return {};
    };
    if (const Status status = read(); !status) report.fail(status.error());
}

void inspectTemplate(FileReport& report, const NpzFile& file, const InspectOptions& options) {
    if (!file.has("weights")) return inspectBareMesh(report, file);
    const auto mesh = readWeightedTemplate(report.path, options.limits);
    if (!mesh) return report.fail(mesh.error());
    report.add("vertices", grouped(mesh->mesh.positions.size()), mesh->mesh.positions.size());
    report.add("triangles", grouped(mesh->mesh.triangles.size()), mesh->mesh.triangles.size());
    report.add("joints", std::to_string(mesh->joints.size()), mesh->joints.size());
    report.add("texture_coordinates", mesh->mesh.uvs.empty() ? "no" : "yes", !mesh->mesh.uvs.empty());
    report.add("materials", mesh->mesh.materialNames.empty() ? "none" : listed(mesh->mesh.materialNames),
               mesh->mesh.materialNames);
    addExtent(report, mesh->mesh.positions);
    addWeightSums(report, file);
    for (const std::string& note : mesh->notes) report.warn(note);
}

void inspectOtherArrays(FileReport& report, const NpzFile& file) {
    for (const auto& [key, array] : file.arrays) warnNonFinite(report, key, array);
    if (file.unreadable.empty()) return;
    const auto& [key, error] = *file.unreadable.begin();
    if (file.arrays.empty()) return report.fail(error);
    for (const auto& [name, reason] : file.unreadable) report.warn(reason.describe());
}

void setMeaning(FileReport& report, NpzMeaning meaning) {
    switch (meaning) {
    case NpzMeaning::Body:
        report.kind = "body_model";
        report.title = "numpy archive, SMPL-X style body model";
        break;
    case NpzMeaning::Motion:
        report.kind = "motion";
        report.title = "numpy archive, motion";
        break;
    case NpzMeaning::Template:
        report.kind = "template";
        report.title = "numpy archive, template mesh";
        break;
    case NpzMeaning::Other:
        report.kind = "arrays";
        report.title = "numpy archive";
        break;
    }
}

} // namespace

void inspectNpz(FileReport& report, const InspectOptions& options) {
    const auto entries = listNpz(report.path, options.limits);
    if (!entries) return report.fail(entries.error());
    std::set<std::string> keys;
    for (const NpzEntry& entry : *entries) keys.insert(entry.key);
    const NpzMeaning meaning = meaningOf(keys);
    setMeaning(report, meaning);
    addArrayList(report, *entries, meaning == NpzMeaning::Other || options.fast);
    if (options.fast) return;
    const auto file = readNpz(report.path, options.limits);
    if (!file) return report.fail(file.error());
    switch (meaning) {
    case NpzMeaning::Body:
        return inspectBody(report, *file);
    case NpzMeaning::Motion:
        return inspectMotion(report, *file, options);
    case NpzMeaning::Template:
        return inspectTemplate(report, *file, options);
    case NpzMeaning::Other:
        return inspectOtherArrays(report, *file);
    }
}

void inspectNpy(FileReport& report, const InspectOptions& options) {
    report.kind = "array";
    if (options.fast) return;
    const auto array = readNpy(report.path, options.limits);
    if (!array) return report.fail(array.error());
    report.add("array", array->describe(), Json{{"dtype", dtypeName(array->dtype)}, {"shape", array->shape}});
    static const std::set<std::size_t> kPoseWidths{66, 72, 156, 165};
    const bool numbers = array->dtype == DType::F32 || array->dtype == DType::F64;
    if (numbers && array->shape.size() == 2 && kPoseWidths.contains(array->shape[1])) {
        if (const auto motion = readMotionNpz(report.path, {}, options.limits)) {
            report.kind = "motion";
            report.title = motionTitle("numpy array", *motion);
            report.add("source", "", motion->source);
            return addMotion(report, *motion);
        }
    }
    warnNonFinite(report, "the array", *array);
}

void inspectSafetensors(FileReport& report, const InspectOptions& options) {
    report.kind = "tensors";
    const auto index = listSafetensors(report.path, options.limits);
    if (!index) return report.fail(index.error());
    Json tensors = Json::object();
    std::uint64_t numbers = 0;
    std::vector<std::string> names;
    for (const SafetensorsEntry& entry : index->entries) {
        tensors[entry.name] = {{"dtype", entry.storedType}, {"shape", entry.shape}};
        names.push_back(fmt::format("{} {} {}", entry.name, entry.storedType, formatShape(entry.shape)));
        std::uint64_t count = 1;
        for (const std::size_t extent : entry.shape) count *= extent;
        numbers += count;
    }
    report.add("tensors", fmt::format("{}, {} numbers", counted(names.size(), "tensor"), grouped(numbers)), tensors);
    report.add("numbers", "", numbers);
    report.add("first", listed(names, 6), Json());
    report.add("metadata", index->metadata.empty() ? "" : counted(index->metadata.size(), "entry", "entries"),
               index->metadata);
    if (options.fast) return;
    const auto file = readSafetensors(report.path, options.limits);
    if (!file) return report.fail(file.error());
    for (const auto& [name, array] : file->tensors) warnNonFinite(report, name, array);
}

} // namespace ars::app
