// Loops are the engine's own; Eigen must not start threads of its own inside them.
#define EIGEN_DONT_PARALLELIZE

#include "engine/maps/pose_pca.h"

#include "engine/core/parallel.h"
#include "engine/io/safetensors.h"

#include <Eigen/Dense>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr float kTrainingSigmas = 2.0f; ///< of PosePca::trainingDistance: AnimatableGaussians' clamp
/// Components below this share of the largest variance are rounding of the float samples.
constexpr double kNoVariance = 1e-11;
constexpr std::size_t kChunk = 2048; ///< numbers of a sample that are worked on at once
constexpr std::size_t kRows = 64;    ///< rows of the Gram matrix that one thread works on

Error wrong(std::string message) { return makeError(ErrorCode::InvalidArgument, "pose PCA", std::move(message)); }

Status checkSamples(std::span<const std::vector<float>> samples, int components) {
    if (components < 1) return wrong(fmt::format("{} components, expected at least 1", components));
    if (samples.empty()) return wrong("no poses to learn from");
    for (std::size_t i = 0; i < samples.size(); ++i) {
        if (samples[i].size() != samples[0].size() || samples[i].empty()) {
            return wrong(fmt::format("pose {} has {} numbers, pose 0 has {}", i, samples[i].size(), samples[0].size()));
        }
        for (const float value : samples[i]) {
            if (!std::isfinite(value)) return wrong(fmt::format("pose {} holds a number that is not finite", i));
        }
    }
    return {};
}

std::vector<float> meanOf(std::span<const std::vector<float>> samples) {
    std::vector<float> mean(samples[0].size());
    parallelFor(
        mean.size(),
        [&](std::size_t d) {
            double sum = 0.0;
            for (const std::vector<float>& sample : samples) sum += sample[d];
            mean[d] = static_cast<float>(sum / static_cast<double>(samples.size()));
        },
        1024);
    return mean;
}

/// Samples minus mean, numbers [begin, begin + count).
Matrix centred(std::span<const std::vector<float>> samples, const std::vector<float>& mean, std::size_t begin,
               std::size_t count) {
    Matrix x(static_cast<Eigen::Index>(samples.size()), static_cast<Eigen::Index>(count));
    for (Eigen::Index i = 0; i < x.rows(); ++i) {
        const float* row = samples[static_cast<std::size_t>(i)].data() + begin;
        for (Eigen::Index d = 0; d < x.cols(); ++d) {
            x(i, d) = static_cast<double>(row[d]) - mean[begin + static_cast<std::size_t>(d)];
        }
    }
    return x;
}

/// G = X X^T of the centred samples, lower triangle, in double: float sums over 10^5 numbers would blur the small
/// components.
Result<Matrix> gramMatrix(std::span<const std::vector<float>> samples, const std::vector<float>& mean,
                          const ProgressFunction& progress) {
    const std::size_t n = samples.size(), dimension = mean.size();
    Matrix gram = Matrix::Zero(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(n));
    for (std::size_t begin = 0; begin < dimension; begin += kChunk) {
        ARS_TRY_STATUS(reportProgress(progress, 0.7 * static_cast<double>(begin) / static_cast<double>(dimension),
                                      "comparing poses"));
        const Matrix x = centred(samples, mean, begin, std::min(kChunk, dimension - begin));
        parallelFor((n + kRows - 1) / kRows,
                    [&](std::size_t block) {
                        const auto first = static_cast<Eigen::Index>(block * kRows);
                        const auto rows = static_cast<Eigen::Index>(std::min(kRows, n - block * kRows));
                        gram.block(first, 0, rows, first + rows).noalias() +=
                            x.middleRows(first, rows) * x.topRows(first + rows).transpose();
                    },
                    1);
    }
    return gram;
}

/// Row k of the components: X^T u_k / sqrt(lambda_k), its largest number positive.
std::vector<float> componentsFrom(std::span<const std::vector<float>> samples, const std::vector<float>& mean,
                                  const Matrix& scaled) {
    const std::size_t dimension = mean.size();
    const auto count = static_cast<std::size_t>(scaled.cols());
    std::vector<float> components(count * dimension);
    parallelFor((dimension + kChunk - 1) / kChunk,
                [&](std::size_t chunk) {
                    const std::size_t begin = chunk * kChunk, width = std::min(kChunk, dimension - begin);
                    const Matrix part = scaled.transpose() * centred(samples, mean, begin, width);
                    for (std::size_t k = 0; k < count; ++k) {
                        for (std::size_t d = 0; d < width; ++d) {
                            components[k * dimension + begin + d] =
                                static_cast<float>(part(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(d)));
                        }
                    }
                },
                1);
    for (std::size_t k = 0; k < count; ++k) {
        float* row = &components[k * dimension];
        const float* largest =
            std::max_element(row, row + dimension, [](float a, float b) { return std::abs(a) < std::abs(b); });
        if (*largest < 0.0f) std::transform(row, row + dimension, row, [](float v) { return -v; });
    }
    return components;
}

/// sum over d of a[d] (b[d] - c[d]), in double.
double product(const float* a, const float* b, const float* c, std::size_t count) {
    double sum = 0.0;
    for (std::size_t d = 0; d < count; ++d) sum += static_cast<double>(a[d]) * (static_cast<double>(b[d]) - c[d]);
    return sum;
}

} // namespace

Result<PosePca> fitPosePca(std::span<const std::vector<float>> samples, int components,
                           const ProgressFunction& progress) {
    ARS_TRY_STATUS(checkSamples(samples, components));
    PosePca pca;
    pca.poses = static_cast<int>(samples.size());
    pca.mean = meanOf(samples);
    if (samples.size() > 1) {
        ARS_TRY(const Matrix gram, gramMatrix(samples, pca.mean, progress));
        ARS_TRY_STATUS(reportProgress(progress, 0.7, "finding principal components"));
        const Eigen::SelfAdjointEigenSolver<Matrix> solver(gram); // reads the lower triangle; eigenvalues rise
        const Eigen::VectorXd& values = solver.eigenvalues();
        const Eigen::Index most = std::min<Eigen::Index>(components, values.size() - 1);
        Eigen::Index kept = 0;
        const double largest = values[values.size() - 1];
        while (kept < most && values[values.size() - 1 - kept] > kNoVariance * largest && largest > 0.0) ++kept;
        Matrix scaled(values.size(), kept);
        for (Eigen::Index k = 0; k < kept; ++k) {
            const Eigen::Index from = values.size() - 1 - k;
            scaled.col(k) = solver.eigenvectors().col(from) / std::sqrt(values[from]);
            pca.deviations.push_back(
                static_cast<float>(std::sqrt(values[from] / static_cast<double>(samples.size() - 1))));
        }
        pca.components = componentsFrom(samples, pca.mean, scaled);
    }
    ARS_TRY_STATUS(reportProgress(progress, 0.9, "measuring the training poses"));
    std::vector<float> distances(samples.size());
    parallelFor(
        samples.size(),
        [&](std::size_t i) {
            std::vector<float> values = samples[i];
            distances[i] = projectPose(pca, values, kTrainingSigmas)->distance;
        },
        1);
    pca.trainingDistance = *std::max_element(distances.begin(), distances.end());
    return pca;
}

Result<PcaProjection> projectPose(const PosePca& pca, std::span<float> values, float sigmas) {
    const std::size_t dimension = pca.dimension();
    if (values.size() != dimension || dimension == 0) {
        return wrong(fmt::format("a pose of {} numbers, the components have {}", values.size(), dimension));
    }
    if (!(sigmas > 0.0f)) return wrong(fmt::format("a clamp at {} standard deviations, expected more than 0", sigmas));
    const auto count = static_cast<std::size_t>(pca.componentCount());
    PcaProjection projection;
    projection.coefficients.resize(count);
    parallelFor(
        count,
        [&](std::size_t k) {
            projection.coefficients[k] =
                static_cast<float>(product(&pca.components[k * dimension], values.data(), pca.mean.data(), dimension));
        },
        1);
    for (std::size_t k = 0; k < count; ++k) {
        float& coefficient = projection.coefficients[k];
        const float most = sigmas * pca.deviations[k];
        projection.largestDeviation = std::max(projection.largestDeviation, std::abs(coefficient) / pca.deviations[k]);
        if (std::abs(coefficient) > most) ++projection.clamped;
        coefficient = std::clamp(coefficient, -most, most);
    }
    std::vector<double> squares((dimension + kChunk - 1) / kChunk, 0.0);
    parallelFor(
        squares.size(),
        [&](std::size_t chunk) {
            const std::size_t end = std::min((chunk + 1) * kChunk, dimension);
            for (std::size_t d = chunk * kChunk; d < end; ++d) {
                float value = pca.mean[d];
                for (std::size_t k = 0; k < count; ++k) {
                    value += projection.coefficients[k] * pca.components[k * dimension + d];
                }
                const double off = static_cast<double>(values[d]) - value;
                squares[chunk] += off * off;
                values[d] = value;
            }
        },
        4);
    double sum = 0.0;
    for (const double square : squares) sum += square; // in a fixed order
    projection.distance = static_cast<float>(std::sqrt(3.0 * sum / static_cast<double>(dimension)));
    projection.outOfRange = std::max(0.0f, projection.distance - pca.trainingDistance);
    return projection;
}

Status writePosePca(const std::filesystem::path& path, const PosePca& pca) {
    const auto count = static_cast<std::size_t>(pca.componentCount());
    if (pca.components.size() != count * pca.dimension()) {
        return wrong(fmt::format("{} numbers for {} components of {}", pca.components.size(), count, pca.dimension()));
    }
    const std::int64_t poses = pca.poses;
    SafetensorsFile file;
    file.tensors["mean"] = Array::fromFloats({pca.dimension()}, pca.mean);
    file.tensors["components"] = Array::fromFloats({count, pca.dimension()}, pca.components);
    file.tensors["deviations"] = Array::fromFloats({count}, pca.deviations);
    file.tensors["training_distance"] = Array::fromFloats({1}, std::span(&pca.trainingDistance, 1));
    file.tensors["poses"] = Array::fromInts({1}, std::span(&poses, 1));
    file.metadata["format"] = "ars pose pca 1";
    return writeSafetensors(path, file);
}

namespace {

Result<std::vector<float>> tensor(const SafetensorsFile& file, std::string_view name,
                                  std::span<const std::size_t> shape) {
    ARS_TRY(const Array* array, file.find(name));
    if (Status fits = requireShape(*array, name, shape); !fits) {
        return makeError(ErrorCode::BadFile, fits.error().place, fits.error().message);
    }
    auto values = array->toFloat();
    if (!values) return makeError(ErrorCode::BadFile, std::string(name), values.error().message);
    for (const float value : *values) {
        if (!std::isfinite(value)) return makeError(ErrorCode::BadFile, std::string(name), "a number is not finite");
    }
    return values;
}

Result<PosePca> posePcaFrom(const SafetensorsFile& file) {
    PosePca pca;
    const std::size_t anyRow[] = {kAnySize}, one[] = {1};
    ARS_TRY(pca.mean, tensor(file, "mean", anyRow));
    if (pca.mean.empty()) return makeError(ErrorCode::BadFile, "mean", "it is empty");
    ARS_TRY(pca.deviations, tensor(file, "deviations", anyRow));
    const std::size_t shape[] = {pca.deviations.size(), pca.mean.size()};
    ARS_TRY(pca.components, tensor(file, "components", shape));
    for (const float deviation : pca.deviations) {
        if (!(deviation > 0.0f)) return makeError(ErrorCode::BadFile, "deviations", "one is not positive");
    }
    ARS_TRY(const std::vector<float> distance, tensor(file, "training_distance", one));
    ARS_TRY(const std::vector<float> poses, tensor(file, "poses", one));
    if (distance[0] < 0.0f) return makeError(ErrorCode::BadFile, "training_distance", "it is negative");
    if (poses[0] < 1.0f || poses[0] > 1e9f) return makeError(ErrorCode::BadFile, "poses", "expected a positive count");
    pca.trainingDistance = distance[0];
    pca.poses = static_cast<int>(poses[0]);
    return pca;
}

} // namespace

Result<PosePca> readPosePca(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const SafetensorsFile file, readSafetensors(path, limits));
    auto pca = posePcaFrom(file);
    if (!pca) return atPlace(std::move(pca).error(), path.string());
    return pca;
}

} // namespace ars
