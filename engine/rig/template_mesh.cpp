#include "engine/rig/template_mesh.h"

#include "engine/core/file.h"
#include "engine/core/parallel.h"
#include "engine/rig/template_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace ars {
namespace {

constexpr float kLargestRatio = 1.6f;   ///< a template larger than this times the body is in other units
constexpr float kSmallestRatio = 0.15f; ///< and one smaller; a single garment is larger
constexpr float kReach = 0.25f; ///< how far clothes and hair may stick out of the body's box, of its longest side
constexpr float kFarFromBodyM = 0.35f; ///< beyond this the weights are a guess and the user is told

struct Box {
    glm::vec3 low{std::numeric_limits<float>::max()};
    glm::vec3 high{std::numeric_limits<float>::lowest()};

    explicit Box(std::span<const glm::vec3> points) {
        for (const glm::vec3& p : points) {
            low = glm::min(low, p);
            high = glm::max(high, p);
        }
    }
    glm::vec3 size() const { return high - low; }
    glm::vec3 center() const { return 0.5f * (low + high); }
    float longestSide() const { return std::max({size().x, size().y, size().z}); }
    std::string describeSize() const { return fmt::format("{:.4g} x {:.4g} x {:.4g}", size().x, size().y, size().z); }
};

std::string formatPoint(const glm::vec3& p) { return fmt::format("({:.3f}, {:.3f}, {:.3f})", p.x, p.y, p.z); }

TemplateMesh givenTemplate(LoadedTemplate loaded) {
    TemplateMesh result;
    result.name = loaded.mesh.name;
    result.mesh = std::move(loaded.mesh);
    result.weights = std::move(loaded.weights);
    result.joints = std::move(loaded.joints);
    result.materials = std::move(loaded.materials);
    result.images = std::move(loaded.images);
    result.notes = std::move(loaded.notes);
    return result;
}

// ---- size and place ----

/// "is it in centimetres? Try scale 0.01" for a template that is `ratio` times as large as the body.
std::string unitHint(float ratio) {
    struct Unit {
        float perMetre;
        float scale;
        std::string_view name;
    };
    constexpr std::array<Unit, 5> kUnits = {Unit{100.0f, 0.01f, "centimetres"}, Unit{1000.0f, 0.001f, "millimetres"},
                                            Unit{39.37f, 0.0254f, "inches"}, Unit{3.281f, 0.3048f, "feet"},
                                            Unit{10.0f, 0.1f, "decimetres"}};
    for (const Unit& unit : kUnits) {
        const float factor = ratio / unit.perMetre;
        if (factor > 0.8f && factor < 1.25f) return fmt::format("is it in {}? Try scale {}", unit.name, unit.scale);
    }
    return fmt::format("try scale {:.4g}", 1.0f / ratio);
}

/// The template must be as large as the body and stand where it stands: weights come from what is nearest.
Status checkFit(const Box& box, const Box& body) {
    const float ratio = box.longestSide() / body.longestSide();
    if (!(ratio <= kLargestRatio && ratio >= kSmallestRatio)) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("the template's box measures {} m, the body's {} m: {}", box.describeSize(),
                                     body.describeSize(), unitHint(ratio)));
    }
    if (box.size().z > 3.0f * body.size().z && box.size().y < 0.5f * body.size().y) {
        return makeError(ErrorCode::InvalidArgument, "",
                         fmt::format("the template's box measures {} m, the body's {} m: is its z axis up? Turn it so "
                                     "that y is up and it faces +z",
                                     box.describeSize(), body.describeSize()));
    }
    const glm::vec3 reach(kReach * body.longestSide());
    const bool inside = glm::all(glm::greaterThanEqual(box.low, body.low - reach)) &&
                        glm::all(glm::lessThanEqual(box.high, body.high + reach));
    if (!inside) {
        return makeError(
            ErrorCode::InvalidArgument, "",
            fmt::format("the template's box is centred at {}, the body's at {}: it stands elsewhere. Move it, "
                        "or have it placed on the body (placement: match the body)",
                        formatPoint(box.center()), formatPoint(body.center())));
    }
    return {};
}

/// Scales and moves the mesh into the body's place.
Status placeMesh(TriangleMesh& mesh, std::span<const glm::vec3> bodyVertices, const TemplateOptions& options,
                 std::vector<std::string>& notes) {
    if (!(options.scale > 0.0f) || !std::isfinite(options.scale)) {
        return makeError(ErrorCode::InvalidArgument, "scale",
                         fmt::format("{} is not a positive number", options.scale));
    }
    for (glm::vec3& p : mesh.positions) p *= options.scale;
    const Box body(bodyVertices);
    if (options.placement == TemplatePlacement::MatchBody) {
        const glm::vec3 offset = body.center() - Box(mesh.positions).center();
        for (glm::vec3& p : mesh.positions) p += offset;
        notes.push_back(fmt::format("moved by {} m to match the body", formatPoint(offset)));
    }
    return checkFit(Box(mesh.positions), body);
}

/// Takes points from the pose that the matrices make back to the T-pose.
Status unpose(std::span<const glm::mat4> matrices, const SkinWeights& weights, TriangleMesh& mesh) {
    std::vector<std::uint8_t> singular(mesh.positions.size(), 0);
    parallelFor(mesh.positions.size(), [&](std::size_t v) {
        glm::dmat4 blended(0.0);
        for (std::size_t i = v * kMaxInfluences; i < (v + 1) * kMaxInfluences; ++i) {
            blended += glm::dmat4(matrices[weights.joints[i]]) * static_cast<double>(weights.weights[i]);
        }
        singular[v] = std::abs(glm::determinant(glm::dmat3(blended))) < 1e-6;
        if (singular[v]) return;
        const glm::dmat4 inverse = glm::inverse(blended);
        mesh.positions[v] = glm::vec3(inverse * glm::dvec4(glm::dvec3(mesh.positions[v]), 1.0));
        if (mesh.normals.empty()) return;
        const glm::dvec3 normal = glm::transpose(glm::dmat3(blended)) * glm::dvec3(mesh.normals[v]);
        const double length = glm::length(normal);
        if (length > 0.0) mesh.normals[v] = glm::vec3(normal / length);
    });
    const auto bad = std::find(singular.begin(), singular.end(), std::uint8_t{1});
    if (bad != singular.end()) {
        return makeError(ErrorCode::Unsupported, fmt::format("vertex {}", bad - singular.begin()),
                         "its skinning cannot be undone in the canonical pose");
    }
    return {};
}

/// Weights from the body for what a file gave without.
Result<TemplateMesh> diffusedTemplate(LoadedTemplate loaded, const BodyModel& body, const BodyShape& shape,
                                      const TemplateOptions& options, const ProgressFunction& progress,
                                      const ReadLimits& limits) {
    ARS_TRY_STATUS(validateMesh(loaded.mesh));
    TemplateMesh result = givenTemplate(std::move(loaded));
    result.weightSource = WeightSource::Diffused;
    const Skeleton skeleton = bodySkeleton(body, shape);
    result.joints = skeleton.restPositions;
    const bool canonical = options.pose == TemplatePose::Canonical;
    const std::vector<glm::vec3> bodyVertices =
        canonical ? posedVertices(body, shape, canonicalPose(), nullptr, false) : shapedVertices(body, shape);
    ARS_TRY_STATUS(placeMesh(result.mesh, bodyVertices, options, result.notes));
    ARS_TRY(result.weights,
            diffuseWeights(bodyVertices, body.triangles, body.weights, kSmplxJointCount, result.mesh.positions,
                           options.diffusion, progress, &result.diffusion, limits));
    if (result.diffusion.maxBodyDistanceM > kFarFromBodyM) {
        result.notes.push_back(fmt::format("parts lie up to {:.2f} m from the body: is the mesh in its pose?",
                                           result.diffusion.maxBodyDistanceM));
    }
    if (canonical) {
        ARS_TRY_STATUS(unpose(skinningMatrices(skeleton, canonicalPose()), result.weights, result.mesh));
    }
    return result;
}

} // namespace

std::string_view weightSourceName(WeightSource source) {
    switch (source) {
    case WeightSource::Body:
        return "body";
    case WeightSource::Given:
        return "given";
    case WeightSource::Diffused:
        return "diffused";
    }
    return "";
}

TemplateMesh templateFromBody(const BodyModel& body, const BodyShape& shape) {
    TemplateMesh result;
    result.name = body.name;
    result.mesh.name = body.name;
    result.mesh.positions = shapedVertices(body, shape);
    result.mesh.triangles = body.triangles;
    result.mesh.normals = vertexNormals(result.mesh.positions, result.mesh.triangles);
    result.weights = body.weights;
    result.joints = regressJoints(body, result.mesh.positions);
    result.weightSource = WeightSource::Body;
    return result;
}

Result<TemplateMesh> parseTemplate(std::span<const std::byte> bytes, const BodyModel& body, const BodyShape& shape,
                                   const TemplateOptions& options, const ProgressFunction& progress,
                                   const ReadLimits& limits, const std::filesystem::path& folder) {
    ARS_TRY(LoadedTemplate loaded, loadTemplate(bytes, folder, options.ignoreGivenWeights, limits));
    if (loaded.weights.weights.empty()) {
        return diffusedTemplate(std::move(loaded), body, shape, options, progress, limits);
    }
    TemplateMesh result = givenTemplate(std::move(loaded));
    if (result.joints.empty()) result.joints = bodySkeleton(body, shape).restPositions;
    ARS_TRY_STATUS(validateTemplate(result));
    return result;
}

Result<TemplateMesh> readTemplate(const std::filesystem::path& path, const BodyModel& body, const BodyShape& shape,
                                  const TemplateOptions& options, const ProgressFunction& progress,
                                  const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    Result<TemplateMesh> result = parseTemplate(bytes, body, shape, options, progress, limits, path.parent_path());
    if (!result) return atPlace(std::move(result).error(), path.string());
    if (result->name.empty()) result->name = path.stem().string();
    return result;
}

Result<TemplateMesh> readWeightedTemplate(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    Result<LoadedTemplate> loaded = loadTemplate(bytes, path.parent_path(), false, limits);
    if (!loaded) return atPlace(std::move(loaded).error(), path.string());
    if (loaded->weights.weights.empty() || loaded->joints.empty()) {
        return makeError(ErrorCode::Unsupported, path.string(),
                         fmt::format("the file has no {} of its own; read it together with a body",
                                     loaded->weights.weights.empty() ? "skinning weights" : "joint positions"));
    }
    TemplateMesh result = givenTemplate(std::move(loaded).value());
    if (Status sound = validateTemplate(result); !sound) return atPlace(std::move(sound).error(), path.string());
    if (result.name.empty()) result.name = path.stem().string();
    return result;
}

Result<TemplateMesh> templateFromMesh(TriangleMesh mesh, const BodyModel& body, const BodyShape& shape,
                                      const TemplateOptions& options, const ProgressFunction& progress,
                                      const ReadLimits& limits) {
    LoadedTemplate loaded;
    loaded.materials = plainMaterials(mesh);
    loaded.mesh = std::move(mesh);
    return diffusedTemplate(std::move(loaded), body, shape, options, progress, limits);
}

Status validateTemplate(const TemplateMesh& templateMesh) {
    ARS_TRY_STATUS(validateMesh(templateMesh.mesh));
    if (templateMesh.joints.size() != kSmplxJointCount) {
        return makeError(ErrorCode::InvalidArgument, "template",
                         fmt::format("{} joints, expected {}", templateMesh.joints.size(), kSmplxJointCount));
    }
    const SkinWeights& weights = templateMesh.weights;
    if (weights.pointCount() != templateMesh.mesh.positions.size() || weights.joints.size() != weights.weights.size()) {
        return makeError(ErrorCode::InvalidArgument, "template",
                         fmt::format("{} rows of weights for {} vertices", weights.pointCount(),
                                     templateMesh.mesh.positions.size()));
    }
    for (std::size_t i = 0; i < weights.joints.size(); ++i) {
        if (weights.joints[i] >= kSmplxJointCount || !std::isfinite(weights.weights[i])) {
            return makeError(ErrorCode::InvalidArgument,
                             fmt::format("template: weights of vertex {}", i / kMaxInfluences),
                             fmt::format("joint {} with weight {}", weights.joints[i], weights.weights[i]));
        }
    }
    for (const std::int32_t material : templateMesh.mesh.materials) {
        if (material < -1 || material >= static_cast<std::int32_t>(templateMesh.materials.size())) {
            return makeError(
                ErrorCode::InvalidArgument, "template",
                fmt::format("a triangle has material {}, there are {}", material, templateMesh.materials.size()));
        }
    }
    return {};
}

RiggedMesh rigFromTemplate(const TemplateMesh& templateMesh) {
    RiggedMesh rig;
    rig.name = templateMesh.name;
    rig.skeleton = templateMesh.skeleton();
    rig.mesh = templateMesh.mesh;
    rig.weights = templateMesh.weights;
    rig.materials = templateMesh.materials;
    rig.images = templateMesh.images;
    rig.parts = jointParts(rig.skeleton);
    rig.isSmplx = true;
    rig.notes = templateMesh.notes;
    return rig;
}

Result<TemplateMesh> templateFromRig(RiggedMesh rig) {
    if (!rig.isSmplx) {
        return makeError(ErrorCode::Unsupported, rig.name,
                         fmt::format("its skeleton of {} joints is not SMPL-X's", rig.skeleton.jointCount()));
    }
    TemplateMesh result;
    result.name = std::move(rig.name);
    result.mesh = std::move(rig.mesh);
    result.weights = std::move(rig.weights);
    result.joints = std::move(rig.skeleton.restPositions);
    result.materials = std::move(rig.materials);
    result.images = std::move(rig.images);
    result.notes = std::move(rig.notes);
    ARS_TRY_STATUS(validateTemplate(result));
    return result;
}

Result<std::vector<glm::vec3>> posedTemplate(const TemplateMesh& templateMesh, const Pose& pose) {
    if (pose.rotations.size() != kSmplxJointCount) {
        return makeError(ErrorCode::InvalidArgument, "pose",
                         fmt::format("{} joints, expected {}", pose.rotations.size(), kSmplxJointCount));
    }
    const std::vector<glm::mat4> matrices = skinningMatrices(templateMesh.skeleton(), pose);
    std::vector<glm::vec3> points(templateMesh.mesh.positions.size());
    ARS_TRY_STATUS(skinPoints(matrices, templateMesh.weights, templateMesh.mesh.positions, points));
    return points;
}

} // namespace ars
