#include "engine/surfel/surfel_ply.h"

#include "engine/io/ply.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

namespace ars {
namespace {

constexpr float kColorScale = 0.2820948f; ///< the constant spherical harmonic, as other viewers write it
constexpr float kLeastOpacity = 1e-6f;    ///< an opacity of 0 or 1 has no finite logit

Error bad(std::string message) { return makeError(ErrorCode::BadFile, "", std::move(message)); }

/// A property that must be there.
Result<std::vector<float>> column(const PlyElement& vertex, std::string_view name) {
    if (!vertex.find(name)) {
        return bad(fmt::format("the element \"vertex\" has no property \"{}\", which a set of surfels needs", name));
    }
    Result<std::vector<float>> values = vertex.column(name);
    if (!values) return std::move(values).error();
    return values;
}

/// prefix_0, prefix_1, prefix_2 as vectors; empty when all three are absent.
Result<std::vector<glm::vec3>> triple(const PlyElement& vertex, std::string_view prefix) {
    std::vector<glm::vec3> result;
    bool any = false;
    for (int k = 0; k < 3; ++k) any = any || vertex.find(fmt::format("{}_{}", prefix, k));
    if (!any) return result;
    result.resize(vertex.count);
    for (int k = 0; k < 3; ++k) {
        ARS_TRY(const std::vector<float> values, column(vertex, fmt::format("{}_{}", prefix, k)));
        for (std::size_t i = 0; i < result.size(); ++i) result[i][k] = values[i];
    }
    return result;
}

Result<std::vector<float>> optionalColumn(const PlyElement& vertex, std::string_view name) {
    if (!vertex.find(name)) return std::vector<float>();
    return column(vertex, name);
}

Status readGeometry(const PlyElement& vertex, Surfels& s) {
    const std::size_t n = vertex.count;
    s.means.resize(n);
    s.rotations.resize(4 * n);
    s.scales.resize(n);
    constexpr std::string_view kAxes[] = {"x", "y", "z"};
    for (int k = 0; k < 3; ++k) {
        ARS_TRY(const std::vector<float> values, column(vertex, kAxes[k]));
        for (std::size_t i = 0; i < n; ++i) s.means[i][k] = values[i];
    }
    for (std::size_t k = 0; k < 4; ++k) {
        ARS_TRY(const std::vector<float> values, column(vertex, fmt::format("rot_{}", k)));
        for (std::size_t i = 0; i < n; ++i) s.rotations[4 * i + k] = values[i];
    }
    for (int k = 0; k < 2; ++k) {
        const std::string name = fmt::format("scale_{}", k);
        ARS_TRY(const std::vector<float> values, column(vertex, name));
        for (std::size_t i = 0; i < n; ++i) {
            s.scales[i][k] = std::exp(values[i]);
            if (s.scales[i][k] > 0 && std::isfinite(s.scales[i][k])) continue;
            return bad(
                fmt::format("vertex {}: {} is {}, expected the logarithm of a length in metres", i, name, values[i]));
        }
    }
    return {};
}

Status normalizeRotations(Surfels& s) {
    for (std::size_t i = 0; i < s.count(); ++i) {
        float* q = s.rotations.data() + 4 * i;
        const double length = std::hypot(std::hypot(double(q[0]), q[1]), std::hypot(double(q[2]), q[3]));
        if (!(length > 1e-12)) return bad(fmt::format("vertex {}: the quaternion rot_0..3 is zero", i));
        if (std::abs(length - 1) < 1e-6) continue; // unit already: stays bit for bit
        for (int k = 0; k < 4; ++k) q[k] = static_cast<float>(q[k] / length);
    }
    return {};
}

Result<Surfels> surfelsFromPly(const PlyFile& file) {
    const PlyElement* vertex = file.find("vertex");
    if (!vertex) return bad("there is no element \"vertex\"");
    Surfels s;
    ARS_TRY_STATUS(readGeometry(*vertex, s));
    ARS_TRY_STATUS(normalizeRotations(s));
    ARS_TRY(s.opacities, column(*vertex, "opacity"));
    for (float& opacity : s.opacities) opacity = 1.0f / (1.0f + std::exp(-opacity));
    ARS_TRY(s.colors, triple(*vertex, "f_dc"));
    for (glm::vec3& color : s.colors) color = 0.5f + kColorScale * color;
    ARS_TRY(s.albedos, triple(*vertex, "albedo"));
    ARS_TRY(s.roughnesses, optionalColumn(*vertex, "roughness"));
    ARS_TRY(s.radii, optionalColumn(*vertex, "radius"));
    ARS_TRY(s.importances, optionalColumn(*vertex, "importance"));
    return s;
}

/// Columns under construction: they own their numbers until the file is written.
struct Columns {
    std::size_t count;
    std::vector<std::pair<std::string, std::vector<float>>> columns;

    template <typename Value>
    void add(std::string name, Value value) {
        std::vector<float> values(count);
        for (std::size_t i = 0; i < count; ++i) values[i] = value(i);
        columns.emplace_back(std::move(name), std::move(values));
    }
};

Columns columnsOf(const Surfels& s) {
    Columns c{s.count(), {}};
    constexpr const char* kAxes[] = {"x", "y", "z"};
    constexpr const char* kNormals[] = {"nx", "ny", "nz"};
    for (int k = 0; k < 3; ++k) c.add(kAxes[k], [&](std::size_t i) { return s.means[i][k]; });
    for (const char* name : kNormals) c.add(name, [](std::size_t) { return 0.0f; });
    for (int k = 0; k < 3; ++k) {
        c.add(fmt::format("f_dc_{}", k),
              [&](std::size_t i) { return s.colors.empty() ? 0.0f : (s.colors[i][k] - 0.5f) / kColorScale; });
    }
    c.add("opacity", [&](std::size_t i) {
        const float kept = std::clamp(s.opacities[i], kLeastOpacity, 1.0f - kLeastOpacity);
        return std::log(kept / (1.0f - kept));
    });
    for (int k = 0; k < 2; ++k)
        c.add(fmt::format("scale_{}", k), [&](std::size_t i) { return std::log(s.scales[i][k]); });
    c.add("scale_2", [](std::size_t) { return std::log(1e-6f); });
    for (std::size_t k = 0; k < 4; ++k)
        c.add(fmt::format("rot_{}", k), [&](std::size_t i) { return s.rotations[4 * i + k]; });
    if (!s.albedos.empty()) {
        for (int k = 0; k < 3; ++k) c.add(fmt::format("albedo_{}", k), [&](std::size_t i) { return s.albedos[i][k]; });
    }
    if (!s.roughnesses.empty()) c.add("roughness", [&](std::size_t i) { return s.roughnesses[i]; });
    if (!s.radii.empty()) c.add("radius", [&](std::size_t i) { return s.radii[i]; });
    if (!s.importances.empty()) c.add("importance", [&](std::size_t i) { return s.importances[i]; });
    return c;
}

} // namespace

Result<Surfels> readSurfelPly(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const PlyFile file, readPly(path, limits));
    Result<Surfels> surfels = surfelsFromPly(file);
    if (!surfels) return atPlace(std::move(surfels).error(), path.string());
    return surfels;
}

Status writeSurfelPly(const std::filesystem::path& path, const Surfels& surfels) {
    if (Status status = checkSurfels(surfels); !status) return atPlace(std::move(status).error(), path.string());
    for (std::size_t i = 0; i < surfels.count(); ++i) {
        const glm::vec2 scale = surfels.scales[i];
        if (scale.x > 0 && scale.y > 0) continue;
        return makeError(ErrorCode::InvalidArgument, path.string(),
                         fmt::format("surfel {}: scales {} and {} are not positive", i, scale.x, scale.y));
    }
    const Columns columns = columnsOf(surfels);
    std::vector<std::pair<std::string, std::span<const float>>> spans;
    for (const auto& [name, values] : columns.columns) spans.emplace_back(name, values);
    PlyFile file;
    file.elements.push_back(plyColumns("vertex", spans));
    file.comments.emplace_back("surfels: scale is the logarithm of metres, colour = 0.5 + 0.2820948 f_dc");
    return writePly(path, file);
}

} // namespace ars
