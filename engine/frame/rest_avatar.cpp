#include "engine/frame/rest_avatar.h"

#include "engine/core/parallel.h"
#include "engine/core/parameter_ranges.h"
#include "engine/frame/surface_samples.h"
#include "engine/frame/template_materials.h"
#include "engine/io/file_recognition.h"
#include "engine/io/npz.h"
#include "engine/maps/surface_attributes.h"
#include "engine/occlusion/mesh_occlusion.h"
#include "engine/surfel/knn.h"

#include <algorithm>
#include <cmath>

namespace ars {
namespace {

constexpr float kInvisible = 1.0f / 255.0f; ///< opacity below which the splatter draws nothing
/// Neighbour distances beyond this many spacings are those of lone islands, which must not swell.
constexpr float kMostSpacings = 1.6f;

Status checkOptions(const RestAvatarOptions& options) {
    return checkRanges(restAvatarParameters(), options, "rest avatar");
}

Status checkMesh(const TemplateMesh& mesh) {
    Status sound = validateTemplate(mesh);
    if (!sound) return atPlace(std::move(sound).error(), mesh.name.empty() ? "rest avatar" : mesh.name);
    if (mesh.mesh.triangles.empty()) {
        return makeError(ErrorCode::InvalidArgument, mesh.name.empty() ? "rest avatar" : mesh.name,
                         fmt::format("has {} vertices and no triangle", mesh.mesh.positions.size()));
    }
    return {};
}

/// One sample at each vertex: the first corner of a triangle that meets it.
SurfaceSamples vertexSamples(const TriangleMesh& mesh) {
    std::vector<std::uint8_t> seen(mesh.positions.size(), 0);
    SurfaceSamples samples;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
        for (int c = 0; c < 3; ++c) {
            std::uint8_t& known = seen[mesh.triangles[t][c]];
            if (known) continue;
            known = 1;
            glm::vec3 shares(0.0f);
            shares[c] = 1.0f;
            samples.triangles.push_back(static_cast<std::uint32_t>(t));
            samples.barycentrics.push_back(shares);
        }
    }
    return samples;
}

Result<SurfaceSamples> samplesFor(const TriangleMesh& mesh, const RestAvatarOptions& options,
                                  const ProgressFunction& progress) {
    const std::size_t sides = options.twoSided ? 2 : 1;
    const std::size_t most = static_cast<std::size_t>(options.maxSurfels) / sides;
    if (options.sampling == RestSampling::Surface) {
        return sampleSurface(
            mesh, {std::max<std::size_t>(most, 1), options.spacingM, static_cast<std::uint32_t>(options.seed)},
            progress);
    }
    SurfaceSamples samples = vertexSamples(mesh);
    if (samples.triangles.size() > most) {
        return makeError(
            ErrorCode::LimitExceeded, "rest avatar",
            fmt::format("one surfel at each of {} vertices, at most {} are allowed", samples.triangles.size(), most));
    }
    return samples;
}

/// The shortest turn from +z to a unit normal: isotropic surfels do not care for their tangents, which so change
/// smoothly everywhere but at -z.
glm::quat turnToNormal(const glm::vec3& n) {
    if (n.z < -0.99999f) return glm::quat(0.0f, 1.0f, 0.0f, 0.0f);
    return glm::normalize(glm::quat(1.0f + n.z, -n.y, n.x, 0.0f));
}

void setRotation(std::vector<float>& rotations, std::size_t i, const glm::quat& q) {
    rotations[4 * i] = q.w;
    rotations[4 * i + 1] = q.x;
    rotations[4 * i + 2] = q.y;
    rotations[4 * i + 3] = q.z;
}

glm::vec3 srgbOf(const glm::vec3& linear) {
    return {linearToSrgb(linear.x), linearToSrgb(linear.y), linearToSrgb(linear.z)};
}

/// Leaves out the samples whose material is transparent there.
std::vector<MaterialSample> sampleMaterials(const TemplateMaterials& materials, SurfaceSamples& samples) {
    std::vector<MaterialSample> found(samples.triangles.size());
    parallelFor(found.size(), [&](std::size_t i) {
        found[i] = materials.sample(samples.triangles[i], samples.barycentrics[i], samples.spacingM);
    });
    std::size_t kept = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        if (found[i].alpha < kInvisible) continue;
        found[kept] = found[i];
        samples.triangles[kept] = samples.triangles[i];
        samples.barycentrics[kept++] = samples.barycentrics[i];
    }
    found.resize(kept);
    samples.triangles.resize(kept);
    samples.barycentrics.resize(kept);
    return found;
}

/// Standard deviations from the distances to the neighbours. On an evenly sampled surface they stay near the spacing,
/// whatever lies closely behind (a distance too small) or how lonely an island is (too large).
Result<std::vector<float>> surfelScales(std::span<const glm::vec3> points, float spacing,
                                        const RestAvatarOptions& options) {
    ARS_TRY(std::vector<float> scales, neighborDistances(points, 3));
    for (float& scale : scales) {
        if (spacing > 0.0f) scale = std::clamp(scale, spacing, kMostSpacings * spacing);
        scale *= options.scaleFactor;
    }
    return scales;
}

/// A second surfel behind each, turned by 180 degrees about its first tangent.
void addBackSides(Surfels& surfels, SkinWeights& weights) {
    const std::size_t count = surfels.count();
    auto twice = [](auto& values) {
        const auto copy = values;
        values.insert(values.end(), copy.begin(), copy.end());
    };
    twice(surfels.means);
    twice(surfels.rotations);
    twice(surfels.scales);
    twice(surfels.opacities);
    twice(surfels.colors);
    twice(surfels.albedos);
    twice(surfels.roughnesses);
    twice(weights.joints);
    twice(weights.weights);
    for (std::size_t i = 0; i < count; ++i) {
        const float* q = &surfels.rotations[4 * i];
        setRotation(surfels.rotations, count + i,
                    glm::quat(q[0], q[1], q[2], q[3]) * glm::quat(0.0f, 1.0f, 0.0f, 0.0f));
    }
}

} // namespace

const ParameterTable<RestAvatarOptions>& restAvatarParameters() {
    static const ParameterTable<RestAvatarOptions> table{
        {"sampling",
         &RestAvatarOptions::sampling,
         {},
         "",
         ParameterTier::Advanced,
         "Where surfels are put: evenly over the surface, or at the vertices of the mesh."},
        {"surfels",
         &RestAvatarOptions::maxSurfels,
         {1, 10000000},
         "",
         ParameterTier::Basic,
         "Most surfels; the surface is filled with about so many."},
        {"spacing",
         &RestAvatarOptions::spacingM,
         {0, 0.5},
         "m",
         ParameterTier::Advanced,
         "Least distance of neighbouring surfels; 0 chooses it from their number."},
        {"scale_factor",
         &RestAvatarOptions::scaleFactor,
         {0.1, 5},
         "",
         ParameterTier::Advanced,
         "Standard deviation of a surfel over the distance to its three nearest neighbours."},
        {"opacity", &RestAvatarOptions::opacity, {0.01, 1}, "", ParameterTier::Advanced, "Opacity of every surfel."},
        {"inset",
         &RestAvatarOptions::insetM,
         {0, 0.1},
         "m",
         ParameterTier::Expert,
         "How far inside the surface surfels lie: balances the width that splatting adds to a silhouette."},
        {"two_sided",
         &RestAvatarOptions::twoSided,
         {},
         "",
         ParameterTier::Advanced,
         "A second surfel behind each, so that the inside of open garments is seen."},
        {"seed", &RestAvatarOptions::seed, {0, 2147483647}, "", ParameterTier::Expert, "Seed of the sampling."},
    };
    return table;
}

namespace {

/// How far each point may go inwards: all of `insetM` where three times as far there is no other sheet of the mesh, a
/// half or a quarter of it where there is none within three times that, else nothing. A shirt would otherwise sink into
/// the skin under it, and lips would show the mouth behind them.
Result<std::vector<float>> insets(const TriangleMesh& mesh, const std::vector<glm::vec3>& points,
                                  const std::vector<glm::vec3>& normals, float insetM) {
    std::vector<float> result(points.size(), 0.0f);
    if (insetM <= 0.0f) return result;
    ARS_TRY(const MeshOcclusion sheets, MeshOcclusion::build(mesh.positions, mesh.triangles));
    std::vector<glm::vec3> inwards(normals.size());
    std::transform(normals.begin(), normals.end(), inwards.begin(), [](const glm::vec3& n) { return -n; });
    std::vector<std::uint8_t> blocked(points.size());
    for (const float share : {0.25f, 0.5f, 1.0f}) {
        // The first tenth of a millimetre is the sheet that the point lies on.
        ARS_TRY_STATUS(sheets.blockedRays(points, inwards, 1e-4f, 3.0f * share * insetM, blocked));
        for (std::size_t i = 0; i < points.size(); ++i) {
            if (!blocked[i]) result[i] = share * insetM;
        }
    }
    return result;
}

} // namespace

struct RestAvatar::SkinPoints {
    SurfaceSamples samples;
    std::vector<MaterialSample> materials;
    double areaM2 = 0.0; ///< of the mesh that they were spread over
    std::vector<std::string> notes;
};

namespace {

double surfaceArea(const TriangleMesh& mesh) {
    double area = 0.0;
    for (const glm::uvec3& t : mesh.triangles) {
        const glm::vec3& a = mesh.positions[t.x];
        area += 0.5 * glm::length(glm::cross(mesh.positions[t.y] - a, mesh.positions[t.z] - a));
    }
    return area;
}

glm::vec3 pointAt(const TriangleMesh& mesh, std::span<const glm::vec3> positions, std::uint32_t triangle,
                  const glm::vec3& share) {
    const glm::uvec3& t = mesh.triangles[triangle];
    return share.x * positions[t.x] + share.y * positions[t.y] + share.z * positions[t.z];
}

Status checkCoefficients(const std::vector<float>& values, std::string_view what) {
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (std::abs(values[i]) <= kMaxShapeCoefficient) continue; // false for NaN
        return makeError(ErrorCode::InvalidArgument, fmt::format("{} coefficient {}", what, i),
                         fmt::format("expected a number from {} to {}, found {}", -kMaxShapeCoefficient,
                                     kMaxShapeCoefficient, values[i]));
    }
    return {};
}

/// The body's names, or "shape 1", "shape 2"... where it has none.
std::vector<std::string> coefficientNames(const std::vector<std::string>& given, int count, std::string_view what) {
    std::vector<std::string> names = given;
    names.resize(static_cast<std::size_t>(count));
    for (std::size_t i = 0; i < names.size(); ++i) {
        if (names[i].empty()) names[i] = fmt::format("{} {}", what, i + 1);
    }
    return names;
}

} // namespace

Result<std::shared_ptr<const RestAvatar::SkinPoints>>
RestAvatar::pointsOn(const TemplateMesh& mesh, const RestAvatarOptions& options, const ProgressFunction& progress) {
    ARS_TRY_STATUS(checkOptions(options));
    ARS_TRY_STATUS(checkMesh(mesh));
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "decoding textures"));
    ARS_TRY(const TemplateMaterials materials, TemplateMaterials::decode(mesh));
    auto points = std::make_shared<SkinPoints>();
    points->notes = materials.notes();
    ARS_TRY(points->samples, samplesFor(mesh.mesh, options, progress));
    points->materials = sampleMaterials(materials, points->samples);
    if (points->materials.empty()) {
        return makeError(ErrorCode::InvalidArgument, "rest avatar", "its materials are transparent everywhere");
    }
    points->areaM2 = surfaceArea(mesh.mesh);
    ARS_TRY_STATUS(reportProgress(progress, 0.9, "making surfels"));
    return std::shared_ptr<const SkinPoints>(std::move(points));
}

Result<std::unique_ptr<RestAvatar>> RestAvatar::create(TemplateMesh mesh, const RestAvatarOptions& options,
                                                       const ProgressFunction& progress) {
    ARS_TRY(std::shared_ptr<const SkinPoints> points, pointsOn(mesh, options, progress));
    return onPoints(std::move(mesh), std::move(points), options);
}

Result<std::unique_ptr<RestAvatar>> RestAvatar::onPoints(TemplateMesh mesh, std::shared_ptr<const SkinPoints> points,
                                                         const RestAvatarOptions& options) {
    std::unique_ptr<RestAvatar> avatar(new RestAvatar);
    avatar->mesh_ = std::move(mesh);
    avatar->options_ = options;
    avatar->notes_ = points->notes;
    const TriangleMesh& surface = avatar->mesh_.mesh;
    const SurfaceSamples& samples = points->samples;
    const SurfacePoints places{samples.triangles, samples.barycentrics};
    const std::vector<glm::vec3> normals =
        interpolatedNormals(surface, surface.positions, smoothNormals(surface), places);
    avatar->rig_.weights = interpolatedWeights(surface, avatar->mesh_.weights, places);
    const std::size_t count = points->materials.size();
    Surfels& surfels = avatar->surfels_;
    surfels.means.resize(count);
    surfels.rotations.resize(4 * count);
    surfels.scales.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
        const MaterialSample& material = points->materials[i];
        surfels.means[i] = pointAt(surface, surface.positions, samples.triangles[i], samples.barycentrics[i]);
        setRotation(surfels.rotations, i, turnToNormal(normals[i]));
        surfels.opacities.push_back(options.opacity * material.alpha);
        surfels.albedos.push_back(material.albedo);
        surfels.colors.push_back(srgbOf(material.albedo));
        surfels.roughnesses.push_back(material.roughness);
    }
    // A heavier body stretches the pattern of its points.
    const double stretch = std::sqrt(surfaceArea(surface) / points->areaM2);
    const float spacing = static_cast<float>(stretch * static_cast<double>(samples.spacingM));
    ARS_TRY(const std::vector<float> scales, surfelScales(surfels.means, spacing, options));
    ARS_TRY(avatar->depths_, insets(surface, surfels.means, normals, options.insetM));
    for (std::size_t i = 0; i < count; ++i) {
        surfels.scales[i] = glm::vec2(scales[i]);
        surfels.means[i] -= avatar->depths_[i] * normals[i];
    }
    if (options.twoSided) addBackSides(surfels, avatar->rig_.weights);

    avatar->points_ = std::move(points);
    avatar->rig_.skeleton = avatar->mesh_.skeleton();
    avatar->rig_.parts = jointParts(avatar->rig_.skeleton);
    avatar->rig_.canonical.assign(avatar->rig_.parts.size(), glm::mat4(1.0f));
    return avatar;
}

Result<std::unique_ptr<RestAvatar>> RestAvatar::create(std::shared_ptr<const BodyModel> body,
                                                       const std::vector<float>& betas,
                                                       const RestAvatarOptions& options,
                                                       const ProgressFunction& progress) {
    ARS_TRY_STATUS(checkCoefficients(betas, "shape"));
    // The points are spread over the body without shape, so that a slider of shape moves surfels and makes none.
    ARS_TRY(std::shared_ptr<const SkinPoints> points, pointsOn(templateFromBody(*body), options, progress));
    return ofBody(std::move(body), betas, std::move(points), options);
}

Result<std::unique_ptr<RestAvatar>> RestAvatar::withShape(const std::vector<float>& betas) const {
    if (!body_) {
        return makeError(ErrorCode::Unsupported, mesh_.name, "only bodies have a shape, this avatar is made of a mesh");
    }
    ARS_TRY_STATUS(checkCoefficients(betas, "shape"));
    return ofBody(body_, betas, points_, options_);
}

Result<std::unique_ptr<RestAvatar>> RestAvatar::ofBody(std::shared_ptr<const BodyModel> body,
                                                       const std::vector<float>& betas,
                                                       std::shared_ptr<const SkinPoints> points,
                                                       const RestAvatarOptions& options) {
    TemplateMesh mesh = templateFromBody(*body, {betas, {}});
    ARS_TRY_STATUS(checkMesh(mesh));
    ARS_TRY(std::unique_ptr<RestAvatar> avatar, onPoints(std::move(mesh), std::move(points), options));
    avatar->body_ = std::move(body);
    avatar->shapeNames_ = coefficientNames(avatar->body_->shapeNames, avatar->body_->shapeCount, "shape");
    avatar->expressionNames_ =
        coefficientNames(avatar->body_->expressionNames, avatar->body_->expressionCount, "expression");
    avatar->findMovingSurfels();
    return avatar;
}

void RestAvatar::findMovingSurfels() {
    constexpr float kMovesM = 1e-6f;
    const std::vector<float>& directions = body_->expressionDirs;
    const std::size_t width = 3 * static_cast<std::size_t>(body_->expressionCount);
    const std::vector<glm::uvec3>& triangles = mesh_.mesh.triangles;
    std::vector<std::uint8_t> moves(body_->vertexCount(), 0), turns(body_->vertexCount(), 0);
    for (std::size_t v = 0; v < moves.size() && width > 0; ++v) {
        moves[v] = std::any_of(&directions[v * width], &directions[v * width] + width,
                               [](float d) { return std::abs(d) > kMovesM; });
        if (moves[v]) movingVertices_.push_back(static_cast<std::uint32_t>(v));
    }
    for (const glm::uvec3& t : triangles) {
        if (moves[t.x] || moves[t.y] || moves[t.z]) turns[t.x] = turns[t.y] = turns[t.z] = 1; // its normals change
    }
    for (std::size_t i = 0; i < points_->materials.size(); ++i) {
        const glm::uvec3& t = triangles[points_->samples.triangles[i]];
        if (turns[t.x] || turns[t.y] || turns[t.z]) movingSurfels_.push_back(static_cast<std::uint32_t>(i));
    }
}

std::string RestAvatar::description() const {
    std::string digits = std::to_string(surfels_.count());
    for (std::size_t i = digits.size(); i > 3; i -= 3) digits.insert(i - 3, ",");
    return fmt::format("rest avatar of {}, {} surfels", mesh_.name.empty() ? "a mesh" : mesh_.name, digits);
}

bool RestAvatar::sameSurfels(const Pose& a, const Pose& b) const {
    if (movingSurfels_.empty()) return true;
    const auto coefficient = [](const Pose& pose, std::size_t i) {
        return i < pose.expression.size() ? pose.expression[i] : 0.0f;
    };
    for (std::size_t i = 0; i < std::max(a.expression.size(), b.expression.size()); ++i) {
        if (coefficient(a, i) != coefficient(b, i)) return false;
    }
    return true;
}

Status RestAvatar::evaluate(const Pose& pose, const Camera*, Surfels& surfels) {
    surfels = surfels_;
    const bool plain = std::all_of(pose.expression.begin(), pose.expression.end(), [](float e) { return e == 0.0f; });
    if (plain || movingSurfels_.empty()) return {};
    ARS_TRY_STATUS(checkCoefficients(pose.expression, "expression"));
    const TriangleMesh& surface = mesh_.mesh;
    std::vector<glm::vec3> positions = surface.positions;
    const auto count = static_cast<std::size_t>(body_->expressionCount);
    const std::size_t used = std::min(count, pose.expression.size());
    parallelFor(movingVertices_.size(), [&](std::size_t i) {
        const std::size_t v = movingVertices_[i];
        for (std::size_t c = 0; c < 3; ++c) {
            const float* direction = &body_->expressionDirs[(3 * v + c) * count];
            float sum = 0.0f;
            for (std::size_t e = 0; e < used; ++e) sum += direction[e] * pose.expression[e];
            positions[v][static_cast<int>(c)] += sum;
        }
    });
    std::vector<std::uint32_t> triangles;
    std::vector<glm::vec3> shares;
    for (const std::uint32_t i : movingSurfels_) {
        triangles.push_back(points_->samples.triangles[i]);
        shares.push_back(points_->samples.barycentrics[i]);
    }
    const std::vector<glm::vec3> normals =
        interpolatedNormals(surface, positions, vertexNormals(positions, surface.triangles), {triangles, shares});
    const std::size_t back = options_.twoSided ? points_->materials.size() : 0;
    parallelFor(movingSurfels_.size(), [&](std::size_t m) {
        const std::size_t i = movingSurfels_[m];
        const glm::quat turn = turnToNormal(normals[m]);
        surfels.means[i] = pointAt(surface, positions, triangles[m], shares[m]) - depths_[i] * normals[m];
        setRotation(surfels.rotations, i, turn);
        if (back == 0) return;
        surfels.means[back + i] = surfels.means[i];
        setRotation(surfels.rotations, back + i, turn * glm::quat(0.0f, 1.0f, 0.0f, 0.0f));
    });
    return {};
}

bool isBodyFile(const std::string& path, const ReadLimits& limits) {
    const auto file = recogniseFile(path, limits);
    if (!file || file->format != FileFormat::Npz) return false;
    const auto entries = listNpz(path, limits);
    if (!entries) return false;
    return std::any_of(entries->begin(), entries->end(),
                       [](const NpzEntry& e) { return e.key == "v_template" || e.key == "J_regressor"; });
}

Result<RestInput> readRestInput(const std::string& source, const ProgressFunction& progress, const ReadLimits& limits) {
    RestInput result;
    if (source == "open" || isBodyFile(source, limits)) {
        ARS_TRY(BodyModel body, source == "open" ? readOpenBody() : readBodyModel(source, limits));
        result.body = std::make_shared<const BodyModel>(std::move(body));
        return result;
    }
    ARS_TRY(const BodyModel body, readOpenBody());
    ARS_TRY(result.mesh, readTemplate(source, body, {}, {}, progress, limits));
    return result;
}

Result<std::unique_ptr<RestAvatar>> makeRestAvatar(RestInput source, const std::vector<float>& betas,
                                                   const RestAvatarOptions& options, const ProgressFunction& progress) {
    if (source.body) return RestAvatar::create(std::move(source.body), betas, options, progress);
    return RestAvatar::create(std::move(source.mesh), options, progress);
}

Result<std::unique_ptr<RestAvatar>> restAvatarFromFile(const std::string& source, const RestAvatarOptions& options,
                                                       const ProgressFunction& progress, const ReadLimits& limits,
                                                       const std::vector<float>& betas) {
    ARS_TRY_STATUS(checkOptions(options));
    ARS_TRY(RestInput read, readRestInput(source, progress, limits));
    auto avatar = makeRestAvatar(std::move(read), betas, options, progress);
    if (!avatar) return atPlace(std::move(avatar).error(), source);
    return avatar;
}

} // namespace ars
