#include "engine/frame/surface_samples.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <numeric>
#include <unordered_map>

namespace ars {
namespace {

/// Candidates thrown per sample that fits: from 12 on the gaps hardly shrink any more.
constexpr double kCandidatesPerSample = 12.0;
/// Share of the area that disks of half the spacing cover in the end: random packing gets to 0.547 if it goes on for
/// ever, these candidates to a little less on a curved surface.
constexpr double kPackedShare = 0.475;
constexpr std::size_t kPasses = 24, kPassStep = 7; // the step is coprime to the passes

/// PCG output function over a counter: a fixed, well mixed number for every index.
std::uint32_t mixed(std::uint32_t value) {
    const std::uint32_t state = value * 747796405u + 2891336453u;
    const std::uint32_t word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

double unitInterval(std::uint32_t bits) { return (static_cast<double>(bits) + 0.5) / 4294967296.0; }

struct Candidate {
    std::uint32_t triangle;
    glm::vec3 barycentric;
    glm::vec3 position;
};

double triangleArea(const TriangleMesh& mesh, const glm::uvec3& t) {
    const glm::dvec3 a(mesh.positions[t.x]), b(mesh.positions[t.y]), c(mesh.positions[t.z]);
    return 0.5 * glm::length(glm::cross(b - a, c - a));
}

/// `count` candidates, one in each of as many equal shares of the area in the order of the triangles, inside its
/// triangle by the R2 sequence.
std::vector<Candidate> throwCandidates(const TriangleMesh& mesh, const std::vector<double>& areas, double totalArea,
                                       std::size_t count, std::uint32_t seed) {
    constexpr double kR2x = 0.7548776662466927, kR2y = 0.5698402909980532;
    std::vector<Candidate> candidates;
    candidates.reserve(count);
    double before = 0.0;
    std::size_t triangle = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const auto key = static_cast<std::uint32_t>(i);
        const double at = (static_cast<double>(i) + unitInterval(mixed(key ^ mixed(seed)))) *
                          (totalArea / static_cast<double>(count));
        while (triangle + 1 < areas.size() && before + areas[triangle] <= at) before += areas[triangle++];
        double u = std::fmod(0.5 + kR2x * static_cast<double>(i) + unitInterval(mixed(seed)), 1.0);
        double v = std::fmod(0.5 + kR2y * static_cast<double>(i) + unitInterval(mixed(seed + 1)), 1.0);
        if (u + v > 1.0) {
            u = 1.0 - u;
            v = 1.0 - v;
        }
        const glm::uvec3& t = mesh.triangles[triangle];
        const glm::vec3 shares(static_cast<float>(1.0 - u - v), static_cast<float>(u), static_cast<float>(v));
        candidates.push_back(
            {static_cast<std::uint32_t>(triangle), shares,
             shares.x * mesh.positions[t.x] + shares.y * mesh.positions[t.y] + shares.z * mesh.positions[t.z]});
    }
    return candidates;
}

/// Accepted candidates in cells as wide as the spacing, chained from a hash table.
class DartBoard {
public:
    DartBoard(const std::vector<Candidate>& candidates, float spacing)
        : candidates_(candidates), inverseCell_(1.0f / spacing), square_(spacing * spacing) {
        // Few slots stay in the caches; about one in kCandidatesPerSample of the candidates is ever taken.
        std::size_t slots = 64;
        while (slots < candidates.size() / 6) slots *= 2;
        heads_.assign(slots, -1);
        next_.assign(candidates.size(), -1);
    }

    /// Whether candidate i keeps its distance from all that were taken.
    template <typename SameSheet>
    bool fits(std::size_t i, const SameSheet& sameSheet) const {
        const glm::vec3& p = candidates_[i].position;
        const glm::ivec3 cell = cellOf(p);
        auto crowded = [&](const glm::ivec3& at) {
            for (std::int32_t other = heads_[slotOf(at)]; other >= 0; other = next_[static_cast<std::size_t>(other)]) {
                const auto o = static_cast<std::size_t>(other);
                const glm::vec3 away = candidates_[o].position - p;
                if (glm::dot(away, away) < square_ && sameSheet(i, o)) return true;
            }
            return false;
        };
        // Most candidates fall to a sample of their own cell.
        if (crowded(cell)) return false;
        for (int n = 0; n < 27; ++n) {
            if (n != 13 && crowded(cell + glm::ivec3(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1))) return false;
        }
        return true;
    }

    void take(std::size_t i) {
        std::int32_t& head = heads_[slotOf(cellOf(candidates_[i].position))];
        next_[i] = head;
        head = static_cast<std::int32_t>(i);
    }

private:
    glm::ivec3 cellOf(const glm::vec3& p) const { return glm::ivec3(glm::floor(p * inverseCell_)); }
    std::size_t slotOf(const glm::ivec3& cell) const {
        const std::uint32_t key = static_cast<std::uint32_t>(cell.x) * 73856093u ^
                                  static_cast<std::uint32_t>(cell.y) * 19349663u ^
                                  static_cast<std::uint32_t>(cell.z) * 83492791u;
        return mixed(key) & (heads_.size() - 1);
    }

    const std::vector<Candidate>& candidates_;
    std::vector<std::int32_t> heads_, next_;
    float inverseCell_;
    float square_;
};

/// Indices of the candidates that are taken, increasing.
std::vector<std::size_t> throwDarts(const std::vector<Candidate>& candidates, float spacing,
                                    const std::vector<std::uint32_t>& parts,
                                    const std::vector<glm::vec3>& faceNormals) {
    auto sameSheet = [&](std::size_t a, std::size_t b) {
        const std::uint32_t ta = candidates[a].triangle, tb = candidates[b].triangle;
        return parts[ta] == parts[tb] && glm::dot(faceNormals[ta], faceNormals[tb]) > 0.0f;
    };
    DartBoard board(candidates, spacing);
    std::vector<std::size_t> taken;
    // Every pass walks the whole surface in the order of its triangles, which keeps the cells in the caches; a wholly
    // shuffled order spreads the samples no better and takes four times as long.
    for (std::size_t pass = 0; pass < kPasses; ++pass) {
        for (std::size_t i = pass * kPassStep % kPasses; i < candidates.size(); i += kPasses) {
            if (!board.fits(i, sameSheet)) continue;
            board.take(i);
            taken.push_back(i);
        }
    }
    std::sort(taken.begin(), taken.end());
    return taken;
}

std::vector<glm::vec3> faceNormalsOf(const TriangleMesh& mesh) {
    std::vector<glm::vec3> normals;
    normals.reserve(mesh.triangles.size());
    for (const glm::uvec3& t : mesh.triangles) {
        const glm::vec3& a = mesh.positions[t.x];
        const glm::vec3 n = glm::cross(mesh.positions[t.y] - a, mesh.positions[t.z] - a);
        const float length = glm::length(n);
        normals.push_back(length > 0.0f ? n / length : glm::vec3(0.0f));
    }
    return normals;
}

SurfaceSamples gathered(const std::vector<Candidate>& candidates, const std::vector<std::size_t>& taken,
                        float spacing) {
    SurfaceSamples samples;
    samples.spacingM = spacing;
    for (const std::size_t i : taken) {
        samples.triangles.push_back(candidates[i].triangle);
        samples.barycentrics.push_back(candidates[i].barycentric);
    }
    return samples;
}

} // namespace

std::vector<std::uint32_t> connectedParts(const TriangleMesh& mesh) {
    struct Hash {
        std::size_t operator()(const glm::vec3& p) const {
            std::uint32_t bits[3];
            std::memcpy(bits, &p, sizeof bits);
            return mixed(bits[0] ^ mixed(bits[1] ^ mixed(bits[2])));
        }
    };
    std::vector<std::uint32_t> parent(mesh.positions.size());
    std::unordered_map<glm::vec3, std::uint32_t, Hash> first;
    first.reserve(mesh.positions.size());
    for (std::uint32_t v = 0; v < parent.size(); ++v) parent[v] = first.try_emplace(mesh.positions[v], v).first->second;
    auto root = [&](std::uint32_t v) {
        while (parent[v] != v) v = parent[v] = parent[parent[v]];
        return v;
    };
    for (const glm::uvec3& t : mesh.triangles) {
        parent[root(t.y)] = root(t.x);
        parent[root(t.z)] = root(t.x);
    }
    std::vector<std::uint32_t> number(mesh.positions.size(), UINT32_MAX);
    std::vector<std::uint32_t> parts;
    std::uint32_t count = 0;
    for (const glm::uvec3& t : mesh.triangles) {
        std::uint32_t& part = number[root(t.x)];
        if (part == UINT32_MAX) part = count++;
        parts.push_back(part);
    }
    return parts;
}

Result<SurfaceSamples> sampleSurface(const TriangleMesh& mesh, const SurfaceSampleOptions& options,
                                     const ProgressFunction& progress) {
    constexpr std::size_t kMostSamples = 20000000; // twelve candidates each still fit 32-bit indices
    if (options.maxSamples < 1 || options.maxSamples > kMostSamples || !(options.spacingM >= 0.0f)) {
        return makeError(ErrorCode::InvalidArgument, "surface samples",
                         fmt::format("{} samples at {} m, expected 1 to {} and no negative spacing", options.maxSamples,
                                     options.spacingM, kMostSamples));
    }
    std::vector<double> areas;
    for (const glm::uvec3& t : mesh.triangles) areas.push_back(triangleArea(mesh, t));
    const double total = std::accumulate(areas.begin(), areas.end(), 0.0);
    if (!(total > 0.0) || !std::isfinite(total)) {
        return makeError(ErrorCode::InvalidArgument, "surface samples",
                         fmt::format("the mesh's {} triangles have no finite area", mesh.triangles.size()));
    }
    const std::vector<std::uint32_t> parts = connectedParts(mesh);
    const std::vector<glm::vec3> faceNormals = faceNormalsOf(mesh);
    // Disks of half the spacing cover the packed share: count pi (spacing/2)^2 = share area.
    auto spacingFor = [&](double count) { return std::sqrt(4.0 * kPackedShare * total / (std::numbers::pi * count)); };
    const auto most = static_cast<double>(options.maxSamples);
    double spacing = options.spacingM > 0.0f ? options.spacingM : spacingFor(most);
    const double expected = 4.0 * kPackedShare * total / (std::numbers::pi * spacing * spacing);
    if (expected > 2.0 * most) {
        return makeError(ErrorCode::LimitExceeded, "surface samples",
                         fmt::format("a spacing of {:.4g} m needs about {:.0f} samples, at most {} are allowed; {:.4g} "
                                     "m would do",
                                     spacing, expected, options.maxSamples, spacingFor(most)));
    }
    for (int attempt = 0; attempt < 8; ++attempt) {
        ARS_TRY_STATUS(reportProgress(progress, attempt / 8.0, "spreading surfels"));
        const double samples = std::max(1.0, 4.0 * kPackedShare * total / (std::numbers::pi * spacing * spacing));
        const auto wanted = static_cast<std::size_t>(std::ceil(kCandidatesPerSample * samples));
        const std::vector<Candidate> candidates = throwCandidates(mesh, areas, total, wanted, options.seed);
        const std::vector<std::size_t> taken = throwDarts(candidates, static_cast<float>(spacing), parts, faceNormals);
        if (taken.size() <= options.maxSamples) {
            if (taken.size() == 0) break;
            return gathered(candidates, taken, static_cast<float>(spacing));
        }
        if (options.spacingM > 0.0f) {
            return makeError(ErrorCode::LimitExceeded, "surface samples",
                             fmt::format("a spacing of {:.4g} m gives {} samples, at most {} are allowed", spacing,
                                         taken.size(), options.maxSamples));
        }
        spacing *= std::sqrt(static_cast<double>(taken.size()) / most) * 1.002;
    }
    return makeError(ErrorCode::InvalidArgument, "surface samples",
                     fmt::format("no spacing gives at most {} samples on this mesh", options.maxSamples));
}

} // namespace ars
