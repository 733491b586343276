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

bool isBodyFile(const std::string& path, const ReadLimits& limits) {
    const auto file = recogniseFile(path, limits);
    if (!file || file->format != FileFormat::Npz) return false;
    const auto entries = listNpz(path, limits);
    if (!entries) return false;
    return std::any_of(entries->begin(), entries->end(),
                       [](const NpzEntry& e) { return e.key == "v_template" || e.key == "J_regressor"; });
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

Result<std::unique_ptr<RestAvatar>> RestAvatar::create(TemplateMesh mesh, const RestAvatarOptions& options,
                                                       const ProgressFunction& progress) {
    ARS_TRY_STATUS(checkOptions(options));
    ARS_TRY_STATUS(checkMesh(mesh));
    std::unique_ptr<RestAvatar> avatar(new RestAvatar);
    avatar->mesh_ = std::move(mesh);
    const TriangleMesh& surface = avatar->mesh_.mesh;
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "decoding textures"));
    ARS_TRY(const TemplateMaterials materials, TemplateMaterials::decode(avatar->mesh_));
    avatar->notes_ = materials.notes();
    ARS_TRY(SurfaceSamples samples, samplesFor(surface, options, progress));
    const std::vector<MaterialSample> found = sampleMaterials(materials, samples);
    if (found.empty()) {
        return makeError(ErrorCode::InvalidArgument, "rest avatar", "its materials are transparent everywhere");
    }
    ARS_TRY_STATUS(reportProgress(progress, 0.9, "making surfels"));

    const SurfacePoints points{samples.triangles, samples.barycentrics};
    const std::vector<glm::vec3> normals =
        interpolatedNormals(surface, surface.positions, smoothNormals(surface), points);
    avatar->rig_.weights = interpolatedWeights(surface, avatar->mesh_.weights, points);
    const std::size_t count = found.size();
    Surfels& surfels = avatar->surfels_;
    surfels.means.resize(count);
    surfels.rotations.resize(4 * count);
    surfels.scales.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
        const glm::uvec3& t = surface.triangles[samples.triangles[i]];
        const glm::vec3& share = samples.barycentrics[i];
        surfels.means[i] =
            share.x * surface.positions[t.x] + share.y * surface.positions[t.y] + share.z * surface.positions[t.z];
        setRotation(surfels.rotations, i, turnToNormal(normals[i]));
        surfels.opacities.push_back(options.opacity * found[i].alpha);
        surfels.albedos.push_back(found[i].albedo);
        surfels.colors.push_back(srgbOf(found[i].albedo));
        surfels.roughnesses.push_back(found[i].roughness);
    }
    ARS_TRY(const std::vector<float> scales, surfelScales(surfels.means, samples.spacingM, options));
    ARS_TRY(const std::vector<float> depths, insets(surface, surfels.means, normals, options.insetM));
    for (std::size_t i = 0; i < count; ++i) {
        surfels.scales[i] = glm::vec2(scales[i]);
        surfels.means[i] -= depths[i] * normals[i];
    }
    if (options.twoSided) addBackSides(surfels, avatar->rig_.weights);

    avatar->rig_.skeleton = avatar->mesh_.skeleton();
    avatar->rig_.parts = jointParts(avatar->rig_.skeleton);
    avatar->rig_.canonical.assign(avatar->rig_.parts.size(), glm::mat4(1.0f));
    return avatar;
}

std::string RestAvatar::description() const {
    std::string digits = std::to_string(surfels_.count());
    for (std::size_t i = digits.size(); i > 3; i -= 3) digits.insert(i - 3, ",");
    return fmt::format("rest avatar of {}, {} surfels", mesh_.name.empty() ? "a mesh" : mesh_.name, digits);
}

Status RestAvatar::evaluate(const Pose&, const Camera*, Surfels& surfels) {
    surfels = surfels_;
    return {};
}

Result<std::unique_ptr<RestAvatar>> restAvatarFromFile(const std::string& source, const RestAvatarOptions& options,
                                                       const ProgressFunction& progress, const ReadLimits& limits) {
    ARS_TRY_STATUS(checkOptions(options));
    if (source == "open" || isBodyFile(source, limits)) {
        ARS_TRY(const BodyModel body, source == "open" ? readOpenBody() : readBodyModel(source, limits));
        return RestAvatar::create(templateFromBody(body), options, progress);
    }
    ARS_TRY(const BodyModel body, readOpenBody());
    ARS_TRY(TemplateMesh mesh, readTemplate(source, body, {}, {}, progress, limits));
    auto avatar = RestAvatar::create(std::move(mesh), options, progress);
    if (!avatar) return atPlace(std::move(avatar).error(), source);
    return avatar;
}

} // namespace ars
