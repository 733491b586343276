#include "engine/rig/skinning.h"

#include "engine/core/parallel.h"
#include "engine/rig/skinning_kernels.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>

namespace ars {
namespace {

static_assert(sizeof(glm::vec3) == 12 && sizeof(glm::mat4) == 64 && sizeof(glm::quat) == 16,
              "device buffers hold tightly packed GLM types");

/// Sum of the clipped row, or -1 where a number is not finite.
double rowSum(std::span<const float> row) {
    double sum = 0.0;
    for (const float w : row) {
        if (!std::isfinite(w)) return -1.0;
        sum += std::max(w, 0.0f);
    }
    return sum;
}

/// The kMaxInfluences largest positive weights of a row, largest first (ties: lower joint first), normalised.
void takeLargest(std::span<const float> row, std::uint16_t* joints, float* weights) {
    std::array<float, kMaxInfluences> best{};
    std::array<std::uint16_t, kMaxInfluences> index{};
    for (std::size_t j = 0; j < row.size(); ++j) {
        if (!(row[j] > best.back())) continue;
        std::size_t at = kMaxInfluences - 1;
        for (; at > 0 && row[j] > best[at - 1]; --at) {
            best[at] = best[at - 1];
            index[at] = index[at - 1];
        }
        best[at] = row[j];
        index[at] = static_cast<std::uint16_t>(j);
    }
    double sum = 0.0;
    for (const float w : best) sum += w;
    for (std::size_t k = 0; k < kMaxInfluences; ++k) {
        joints[k] = index[k];
        weights[k] = static_cast<float>(best[k] / sum);
    }
}

Status checkCount(std::string_view name, std::size_t found, std::size_t expected) {
    if (found == expected) return {};
    return makeError(ErrorCode::InvalidArgument, "skinning",
                     fmt::format("{} {}, expected {} (one for each point)", found, name, expected));
}

Result<SkinArguments> checkedArguments(std::span<const glm::mat4> matrices, const SkinWeights& weights) {
    const std::size_t points = weights.pointCount();
    if (weights.joints.size() != weights.weights.size() || weights.weights.size() != points * kMaxInfluences) {
        return makeError(ErrorCode::InvalidArgument, "skinning",
                         fmt::format("{} joint indices and {} weights, expected {} of each for every point",
                                     weights.joints.size(), weights.weights.size(), kMaxInfluences));
    }
    if (points > 0 && largestJoint(weights.joints) >= matrices.size()) {
        return makeError(ErrorCode::InvalidArgument, "skinning",
                         fmt::format("a point follows joint {}, but there are only {} joint matrices",
                                     largestJoint(weights.joints), matrices.size()));
    }
    SkinArguments arguments;
    arguments.matrices = matrices.data();
    arguments.jointCount = matrices.size();
    arguments.joints = weights.joints.data();
    arguments.weights = weights.weights.data();
    arguments.pointCount = points;
    return arguments;
}

Status checkBuffer(std::string_view name, const Buffer& buffer, const Device& device, std::size_t bytes) {
    if (!(buffer.device() == device)) {
        return makeError(ErrorCode::InvalidArgument, "skinning",
                         fmt::format("{} lies on {}, the joint matrices on {}", name, deviceName(buffer.device()),
                                     deviceName(device)));
    }
    if (buffer.bytes() < bytes) {
        return makeError(ErrorCode::InvalidArgument, "skinning",
                         fmt::format("{} holds {} bytes, expected {}", name, buffer.bytes(), bytes));
    }
    return {};
}

/// Host buffers: the joint indices are checked as in skinPoints.
Status checkJointIndices(const SkinArguments& arguments) {
    const std::size_t count = arguments.pointCount * kMaxInfluences;
    for (std::size_t i = 0; i < count; ++i) {
        if (arguments.joints[i] < arguments.jointCount) continue;
        return makeError(ErrorCode::InvalidArgument, "skinning",
                         fmt::format("point {} follows joint {}, but there are only {} joint matrices",
                                     i / kMaxInfluences, arguments.joints[i], arguments.jointCount));
    }
    return {};
}

} // namespace

std::uint16_t largestJoint(const std::vector<std::uint16_t>& joints) {
    constexpr std::size_t kGrain = 1 << 16;
    std::atomic<std::uint16_t> largest{0};
    parallelRanges(joints.size(), kGrain, [&](std::size_t begin, std::size_t end) {
        std::uint16_t found = 0; // the compiler turns this loop into vector maxima
        for (std::size_t i = begin; i < end; ++i) found = std::max(found, joints[i]);
        std::uint16_t seen = largest.load();
        while (seen < found && !largest.compare_exchange_weak(seen, found)) {
        }
    });
    return largest.load();
}

Result<SkinWeights> sparseWeights(std::span<const float> dense, std::size_t points, std::size_t joints) {
    if (joints == 0 || joints > std::numeric_limits<std::uint16_t>::max()) {
        return makeError(ErrorCode::InvalidArgument, "weights",
                         fmt::format("{} joints, expected 1 to {}", joints, std::numeric_limits<std::uint16_t>::max()));
    }
    if (dense.size() / joints != points || dense.size() % joints != 0) {
        return makeError(ErrorCode::InvalidArgument, "weights",
                         fmt::format("{} numbers, expected {} points x {} joints", dense.size(), points, joints));
    }
    SkinWeights result;
    result.joints.resize(points * kMaxInfluences);
    result.weights.resize(points * kMaxInfluences);
    std::atomic<std::size_t> firstBad{points};
    parallelFor(points, [&](std::size_t i) {
        const std::span<const float> row = dense.subspan(i * joints, joints);
        if (!(rowSum(row) > 1e-12)) {
            std::size_t seen = firstBad.load();
            while (i < seen && !firstBad.compare_exchange_weak(seen, i)) {
            }
            return;
        }
        takeLargest(row, &result.joints[i * kMaxInfluences], &result.weights[i * kMaxInfluences]);
    });
    if (const std::size_t bad = firstBad.load(); bad < points) {
        const double sum = rowSum(dense.subspan(bad * joints, joints));
        return makeError(ErrorCode::BadFile, fmt::format("weights row {}", bad),
                         sum < 0.0 ? std::string("a weight is not a finite number")
                                   : fmt::format("its weights sum to {}, expected a positive sum", sum));
    }
    return result;
}

std::vector<float> denseWeights(const SkinWeights& weights, std::size_t joints) {
    std::vector<float> dense(weights.pointCount() * joints, 0.0f);
    for (std::size_t i = 0; i < weights.weights.size(); ++i) {
        if (weights.weights[i] == 0.0f) continue;
        assert(weights.joints[i] < joints);
        dense[i / kMaxInfluences * joints + weights.joints[i]] += weights.weights[i];
    }
    return dense;
}

Status skinPoints(std::span<const glm::mat4> matrices, const SkinWeights& weights,
                  std::span<const glm::vec3> restPoints, std::span<glm::vec3> points) {
    ARS_TRY(SkinArguments arguments, checkedArguments(matrices, weights));
    ARS_TRY_STATUS(checkCount("rest points", restPoints.size(), arguments.pointCount));
    ARS_TRY_STATUS(checkCount("points to fill", points.size(), arguments.pointCount));
    arguments.restPoints = restPoints.data();
    arguments.points = points.data();
    cpu::skin(arguments);
    return {};
}

Status skinPointsAndNormals(std::span<const glm::mat4> matrices, const SkinWeights& weights,
                            std::span<const glm::vec3> restPoints, std::span<const glm::vec3> restNormals,
                            std::span<glm::vec3> points, std::span<glm::vec3> normals) {
    ARS_TRY(SkinArguments arguments, checkedArguments(matrices, weights));
    ARS_TRY_STATUS(checkCount("rest points", restPoints.size(), arguments.pointCount));
    ARS_TRY_STATUS(checkCount("rest normals", restNormals.size(), arguments.pointCount));
    ARS_TRY_STATUS(checkCount("points to fill", points.size(), arguments.pointCount));
    ARS_TRY_STATUS(checkCount("normals to fill", normals.size(), arguments.pointCount));
    arguments.restPoints = restPoints.data();
    arguments.restNormals = restNormals.data();
    arguments.points = points.data();
    arguments.normals = normals.data();
    cpu::skin(arguments);
    return {};
}

Status skinRotations(std::span<const glm::mat4> matrices, const SkinWeights& weights, std::span<glm::quat> rotations) {
    ARS_TRY(const SkinArguments arguments, checkedArguments(matrices, weights));
    ARS_TRY_STATUS(checkCount("rotations to fill", rotations.size(), arguments.pointCount));
    cpu::skinRotations(arguments, rotations.data());
    return {};
}

Status skinOnDevice(const Buffer& matrices, const Buffer& joints, const Buffer& weights, const Buffer& restPoints,
                    const Buffer* restNormals, Buffer& points, Buffer* normals, std::size_t pointCount) {
    if ((restNormals == nullptr) != (normals == nullptr)) {
        return makeError(ErrorCode::InvalidArgument, "skinning",
                         "rest normals and normals to fill must be given together or not at all");
    }
    if (pointCount > std::numeric_limits<std::size_t>::max() / 64) {
        return makeError(ErrorCode::InvalidArgument, "skinning", fmt::format("{} points", pointCount));
    }
    const Device device = matrices.device();
    ARS_TRY_STATUS(checkBuffer("joints", joints, device, pointCount * kMaxInfluences * sizeof(std::uint16_t)));
    ARS_TRY_STATUS(checkBuffer("weights", weights, device, pointCount * kMaxInfluences * sizeof(float)));
    ARS_TRY_STATUS(checkBuffer("restPoints", restPoints, device, pointCount * sizeof(glm::vec3)));
    ARS_TRY_STATUS(checkBuffer("points", points, device, pointCount * sizeof(glm::vec3)));
    if (normals) {
        ARS_TRY_STATUS(checkBuffer("restNormals", *restNormals, device, pointCount * sizeof(glm::vec3)));
        ARS_TRY_STATUS(checkBuffer("normals", *normals, device, pointCount * sizeof(glm::vec3)));
    }
    SkinArguments arguments;
    arguments.matrices = static_cast<const glm::mat4*>(matrices.data());
    arguments.jointCount = matrices.bytes() / sizeof(glm::mat4);
    arguments.joints = static_cast<const std::uint16_t*>(joints.data());
    arguments.weights = static_cast<const float*>(weights.data());
    arguments.restPoints = static_cast<const glm::vec3*>(restPoints.data());
    arguments.restNormals = restNormals ? static_cast<const glm::vec3*>(restNormals->data()) : nullptr;
    arguments.points = static_cast<glm::vec3*>(points.data());
    arguments.normals = normals ? static_cast<glm::vec3*>(normals->data()) : nullptr;
    arguments.pointCount = pointCount;
    if (device.kind == DeviceKind::Host) {
        ARS_TRY_STATUS(checkJointIndices(arguments));
        cpu::skin(arguments);
        return {};
    }
#ifdef ARS_HAVE_CUDA
    return cuda::skin(arguments, device.index);
#else
    return makeError(ErrorCode::Unavailable, "skinning", "this build has no CUDA kernels");
#endif
}

} // namespace ars
