#include "engine/rig/body_model.h"

#include "engine/core/file.h"
#include "engine/core/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace ars {
namespace {

constexpr std::size_t kJoints = kSmplxJointCount;
constexpr std::size_t kPoseFeatures = (kJoints - 1) * 9;
constexpr std::size_t kHandNumbers = 45;

/// "[3,1,0]" for a flat index.
std::string formatIndex(std::span<const std::size_t> shape, std::size_t flat) {
    std::vector<std::size_t> index(shape.size());
    for (std::size_t d = shape.size(); d-- > 0;) {
        index[d] = flat % shape[d];
        flat /= shape[d];
    }
    std::string text;
    for (const std::size_t i : index) {
        text += text.empty() ? '[' : ',';
        text += std::to_string(i);
    }
    return text + ']';
}

/// An array of this shape as finite floats.
Result<std::vector<float>> floatsOfShape(const NpzFile& file, std::string_view key, std::vector<std::size_t> shape) {
    ARS_TRY(const Array* array, file.find(key));
    ARS_TRY_STATUS(requireShape(*array, key, shape));
    auto values = array->toFloat();
    if (!values) return atPlace(std::move(values).error(), key);
    const std::vector<float>& numbers = *values;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        if (std::isfinite(numbers[i])) continue;
        return makeError(ErrorCode::BadFile, fmt::format("{}{}", key, formatIndex(array->shape, i)),
                         fmt::format("found {}, expected a finite number", numbers[i]));
    }
    return values;
}

/// The same for a key that need not be there: empty then.
Result<std::vector<float>> optionalFloats(const NpzFile& file, std::string_view key, std::vector<std::size_t> shape) {
    if (!file.arrays.contains(std::string(key))) return std::vector<float>();
    return floatsOfShape(file, key, std::move(shape));
}

Status readVertices(const NpzFile& file, BodyModel& body) {
    ARS_TRY(const std::vector<float> numbers, floatsOfShape(file, "v_template", {kAnySize, 3}));
    if (numbers.empty()) return makeError(ErrorCode::BadFile, "v_template", "it has no vertices");
    body.templateVertices.resize(numbers.size() / 3);
    for (std::size_t v = 0; v < body.vertexCount(); ++v) {
        body.templateVertices[v] = {numbers[3 * v], numbers[3 * v + 1], numbers[3 * v + 2]};
    }
    return {};
}

Status readTriangles(const NpzFile& file, BodyModel& body) {
    ARS_TRY(const Array* array, file.find("f"));
    ARS_TRY_STATUS(requireShape(*array, "f", std::array{kAnySize, std::size_t{3}}));
    auto indices = array->toInt64();
    if (!indices) return atPlace(std::move(indices).error(), "f");
    const auto vertices = static_cast<std::int64_t>(body.vertexCount());
    body.triangles.resize(indices->size() / 3);
    for (std::size_t i = 0; i < indices->size(); ++i) {
        const std::int64_t index = (*indices)[i];
        if (index < 0 || index >= vertices) {
            return makeError(ErrorCode::BadFile, fmt::format("f{}", formatIndex(array->shape, i)),
                             fmt::format("found vertex {}, expected 0 to {}", index, vertices - 1));
        }
        body.triangles[i / 3][static_cast<int>(i % 3)] = static_cast<std::uint32_t>(index);
    }
    return {};
}

/// Columns [first, first + count) of the last axis of an array with `width` of them.
std::vector<float> takeColumns(std::span<const float> numbers, std::size_t width, std::size_t first,
                               std::size_t count) {
    if (width == 0) return {};
    const std::size_t rows = numbers.size() / width;
    std::vector<float> result(rows * count);
    parallelFor(
        rows, [&](std::size_t r) { std::copy_n(&numbers[r * width + first], count, result.data() + r * count); }, 4096);
    return result;
}

Status readShapes(const NpzFile& file, BodyModel& body) {
    ARS_TRY(const Array* array, file.find("shapedirs"));
    ARS_TRY(const std::vector<float> numbers, floatsOfShape(file, "shapedirs", {body.vertexCount(), 3, kAnySize}));
    const std::size_t width = array->shape[2];
    const bool wide = width >= 400;
    const std::size_t shapes = std::min<std::size_t>(width, wide ? 300 : 10);
    const std::size_t expressions = std::min<std::size_t>(width - shapes, wide ? 100 : 10);
    body.shapeCount = static_cast<int>(shapes);
    body.expressionCount = static_cast<int>(expressions);
    if (shapes > 0) body.shapeDirs = takeColumns(numbers, width, 0, shapes);
    if (expressions > 0) body.expressionDirs = takeColumns(numbers, width, shapes, expressions);
    return {};
}

bool allZeroBytes(std::span<const std::byte> bytes) {
    // Compared with itself moved by one: the fastest scan that the C library has.
    return bytes.empty() ||
           (bytes[0] == std::byte{0} && std::memcmp(bytes.data(), bytes.data() + 1, bytes.size() - 1) == 0);
}

Status readPoseDirs(const NpzFile& file, BodyModel& body) {
    if (!file.has("posedirs")) return {};
    ARS_TRY(const Array* array, file.find("posedirs"));
    const std::array<std::size_t, 3> shape = {body.vertexCount(), 3, kPoseFeatures};
    ARS_TRY_STATUS(requireShape(*array, "posedirs", shape));
    if (allZeroBytes(array->bytes)) return {};
    ARS_TRY(body.poseDirs, floatsOfShape(file, "posedirs", {shape.begin(), shape.end()}));
    return {};
}

Error withConversionHelp(Error error) {
    error.message += "; a scipy sparse J_regressor is made plain once with: python3 -c \"import numpy as np; "
                     "d = dict(np.load('IN.npz', allow_pickle=True)); j = d['J_regressor']; "
                     "d['J_regressor'] = np.asarray((j.item() if j.ndim == 0 else j).todense(), dtype=np.float32); "
                     "np.savez_compressed('OUT.npz', **d)\"";
    return error;
}

Status readRegressor(const NpzFile& file, BodyModel& body) {
    const auto bad = file.unreadable.find("J_regressor");
    if (bad != file.unreadable.end()) return withConversionHelp(bad->second);
    ARS_TRY(body.jointRegressor, floatsOfShape(file, "J_regressor", {kJoints, body.vertexCount()}));
    return {};
}

Status checkJointCount(const Array& kintree) {
    if (kintree.shape.size() == 2 && kintree.shape[0] == 2 && (kintree.shape[1] == 24 || kintree.shape[1] == 52)) {
        return makeError(ErrorCode::Unsupported, "kintree_table",
                         fmt::format("{} joints: this is a {} body, expected SMPL-X with {}", kintree.shape[1],
                                     kintree.shape[1] == 24 ? "SMPL" : "SMPL+H", kJoints));
    }
    return requireShape(kintree, "kintree_table", std::array{std::size_t{2}, kJoints});
}

Status readTree(const NpzFile& file, BodyModel& body) {
    ARS_TRY(const Array* array, file.find("kintree_table"));
    ARS_TRY_STATUS(checkJointCount(*array));
    auto table = array->toInt64();
    if (!table) return atPlace(std::move(table).error(), "kintree_table");
    // The root's parent is -1, written as 2^32-1 in an unsigned table; smplx ignores what stands there.
    body.parents.assign(1, -1);
    for (std::size_t j = 1; j < kJoints; ++j) {
        const std::int64_t parent = (*table)[j];
        if (parent < 0 || parent >= static_cast<std::int64_t>(kJoints)) {
            return makeError(ErrorCode::BadFile, fmt::format("kintree_table[0,{}]", j),
                             fmt::format("found the parent {}, expected 0 to {}", parent, j - 1));
        }
        body.parents.push_back(static_cast<int>(parent));
    }
    Skeleton skeleton = smplxSkeleton(std::vector<glm::vec3>(kJoints, glm::vec3(0.0f)));
    skeleton.parents = body.parents;
    if (auto status = validateSkeleton(skeleton); !status) {
        return atPlace(std::move(status).error(), "kintree_table");
    }
    return {};
}

Status readWeights(const NpzFile& file, BodyModel& body) {
    ARS_TRY(const std::vector<float> dense, floatsOfShape(file, "weights", {body.vertexCount(), kJoints}));
    ARS_TRY(body.weights, sparseWeights(dense, body.vertexCount(), kJoints));
    return {};
}

Status readHands(const NpzFile& file, BodyModel& body) {
    ARS_TRY(body.handMeanLeft, optionalFloats(file, "hands_meanl", {kHandNumbers}));
    ARS_TRY(body.handMeanRight, optionalFloats(file, "hands_meanr", {kHandNumbers}));
    body.handMeanLeft.resize(kHandNumbers, 0.0f);
    body.handMeanRight.resize(kHandNumbers, 0.0f);
    ARS_TRY(body.handComponentsLeft, optionalFloats(file, "hands_componentsl", {kHandNumbers, kHandNumbers}));
    ARS_TRY(body.handComponentsRight, optionalFloats(file, "hands_componentsr", {kHandNumbers, kHandNumbers}));
    return {};
}

/// A list of names of the right length, or nothing: names are a courtesy, not a condition.
std::vector<std::string> readNames(const NpzFile& file, const std::string& key, std::size_t count) {
    const auto found = file.arrays.find(key);
    if (found == file.arrays.end() || found->second.dtype != DType::Text) return {};
    return found->second.texts.size() == count ? found->second.texts : std::vector<std::string>();
}

void addNames(const NpzFile& file, BodyModel& body) {
    body.jointNames = readNames(file, "joint_names", kJoints);
    if (body.jointNames.empty()) {
        for (int j = 0; j < kSmplxJointCount; ++j) body.jointNames.emplace_back(smplxJointName(j));
    }
    body.shapeNames = readNames(file, "shape_names", static_cast<std::size_t>(body.shapeCount));
    body.expressionNames = readNames(file, "expression_names", static_cast<std::size_t>(body.expressionCount));
}

/// Eight sums side by side, which the compiler turns into vectors, as it may not with one.
float dot(const float* a, const float* b, std::size_t count) {
    std::array<float, 8> sums{};
    std::size_t i = 0;
    for (; i + 8 <= count; i += 8) {
        for (std::size_t k = 0; k < 8; ++k) sums[k] += a[i + k] * b[i + k];
    }
    float sum = 0.0f;
    for (; i < count; ++i) sum += a[i] * b[i];
    return sum + ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7]));
}

/// vertices += directions (V,3,width) . coefficients; at most `width` of them count.
void addDirections(std::span<const float> directions, std::size_t width, std::span<const float> coefficients,
                   std::vector<glm::vec3>& vertices) {
    std::size_t used = std::min(width, coefficients.size());
    while (used > 0 && coefficients[used - 1] == 0.0f) --used;
    if (used == 0 || directions.empty()) return;
    parallelFor(vertices.size(), [&](std::size_t v) {
        const float* rows = &directions[v * 3 * width];
        vertices[v] += glm::vec3(dot(rows, coefficients.data(), used), dot(rows + width, coefficients.data(), used),
                                 dot(rows + 2 * width, coefficients.data(), used));
    });
}

/// (R_j - I) of joints 1..54, rows first (avatar reference 5.5).
std::array<float, kPoseFeatures> poseFeature(const Pose& pose) {
    std::array<float, kPoseFeatures> feature{};
    const std::size_t joints = std::min(pose.rotations.size(), kJoints);
    for (std::size_t j = 1; j < joints; ++j) {
        const glm::dmat3 rotation = glm::mat3_cast(glm::normalize(glm::dquat(pose.rotations[j])));
        for (int r = 0; r < 3; ++r) {
            for (int c = 0; c < 3; ++c) {
                feature[(j - 1) * 9 + static_cast<std::size_t>(r * 3 + c)] =
                    static_cast<float>(rotation[c][r] - (r == c ? 1.0 : 0.0));
            }
        }
    }
    return feature;
}

} // namespace

Result<BodyModel> bodyModelFromArrays(const NpzFile& file) {
    BodyModel body;
    ARS_TRY_STATUS(readTree(file, body));
    ARS_TRY_STATUS(readVertices(file, body));
    ARS_TRY_STATUS(readTriangles(file, body));
    ARS_TRY_STATUS(readShapes(file, body));
    ARS_TRY_STATUS(readPoseDirs(file, body));
    ARS_TRY_STATUS(readRegressor(file, body));
    ARS_TRY_STATUS(readWeights(file, body));
    ARS_TRY_STATUS(readHands(file, body));
    addNames(file, body);
    return body;
}

Result<BodyModel> readBodyModel(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const NpzFile file, readNpz(path, limits));
    auto body = bodyModelFromArrays(file);
    if (!body) return atPlace(std::move(body).error(), path.string());
    body->name = path.stem().string();
    return body;
}

Result<BodyModel> readOpenBody() {
    ARS_TRY(const std::filesystem::path folder, resourceFolder());
    return readBodyModel(folder / "bodies" / "open_body.npz");
}

std::vector<glm::vec3> shapedVertices(const BodyModel& body, const BodyShape& shape) {
    std::vector<glm::vec3> vertices = body.templateVertices;
    addDirections(body.shapeDirs, static_cast<std::size_t>(body.shapeCount), shape.betas, vertices);
    addDirections(body.expressionDirs, static_cast<std::size_t>(body.expressionCount), shape.expression, vertices);
    return vertices;
}

std::vector<glm::vec3> regressJoints(const BodyModel& body, std::span<const glm::vec3> vertices) {
    assert(vertices.size() == body.vertexCount());
    std::vector<glm::vec3> joints(kJoints);
    parallelFor(
        kJoints,
        [&](std::size_t j) {
            const float* row = &body.jointRegressor[j * vertices.size()];
            glm::dvec3 sum(0.0);
            for (std::size_t v = 0; v < vertices.size(); ++v) {
                if (row[v] != 0.0f) sum += static_cast<double>(row[v]) * glm::dvec3(vertices[v]);
            }
            joints[j] = glm::vec3(sum);
        },
        4);
    return joints;
}

Skeleton bodySkeleton(const BodyModel& body, const BodyShape& shape) {
    Skeleton skeleton = smplxSkeleton(regressJoints(body, shapedVertices(body, shape)));
    skeleton.parents = body.parents;
    skeleton.names = body.jointNames;
    return skeleton;
}

std::vector<glm::vec3> poseBlendedVertices(const BodyModel& body, std::span<const glm::vec3> shaped, const Pose& pose) {
    std::vector<glm::vec3> vertices(shaped.begin(), shaped.end());
    if (body.poseDirs.empty()) return vertices;
    const std::array<float, kPoseFeatures> feature = poseFeature(pose);
    addDirections(body.poseDirs, kPoseFeatures, feature, vertices);
    return vertices;
}

std::vector<glm::vec3> posedVertices(const BodyModel& body, const BodyShape& shape, const Pose& pose,
                                     std::vector<glm::vec3>* posedJoints, bool poseBlendShapes) {
    const BodyShape whole{shape.betas, shape.expression.empty() ? pose.expression : shape.expression};
    std::vector<glm::vec3> vertices = shapedVertices(body, whole);
    Skeleton skeleton = smplxSkeleton(regressJoints(body, vertices));
    skeleton.parents = body.parents;
    if (poseBlendShapes) vertices = poseBlendedVertices(body, vertices, pose);
    const Status skinned = skinPoints(skinningMatrices(skeleton, pose), body.weights, vertices, vertices);
    assert(skinned.ok()); // a body that was read has 55 joints and weights for every vertex
    static_cast<void>(skinned);
    if (posedJoints) {
        const std::vector<glm::mat4> matrices = jointWorldMatrices(skeleton, pose);
        posedJoints->resize(matrices.size());
        for (std::size_t j = 0; j < matrices.size(); ++j) (*posedJoints)[j] = glm::vec3(matrices[j][3]);
    }
    return vertices;
}

} // namespace ars
