#include "app/inspect.h"
#include "app/text.h"
#include "engine/core/file.h"
#include "engine/io/gltf.h"
#include "engine/io/image_file.h"
#include "engine/io/obj.h"
#include "engine/io/ply.h"
#include "engine/rig/gltf_rig.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace ars::app {
namespace {

void addMesh(FileReport& report, const TriangleMesh& mesh) {
    report.add("vertices", grouped(mesh.positions.size()), mesh.positions.size());
    report.add("triangles", mesh.triangles.empty() ? "none (a set of points)" : grouped(mesh.triangles.size()),
               mesh.triangles.size());
    std::vector<std::string> attributes;
    if (!mesh.normals.empty()) attributes.push_back("normals");
    if (!mesh.uvs.empty()) attributes.push_back("texture coordinates");
    if (!mesh.colors.empty()) attributes.push_back("colours");
    report.add("attributes", attributes.empty() ? "positions only" : listed(attributes), attributes);
    if (!mesh.materialNames.empty()) report.add("materials", listed(mesh.materialNames), mesh.materialNames);
    addExtent(report, mesh.positions);
}

bool isGaussianSet(const PlyElement& vertex) {
    for (const char* name : {"x", "y", "z", "rot_0", "rot_1", "rot_2", "rot_3", "scale_0", "scale_1", "opacity"}) {
        if (!vertex.find(name)) return false;
    }
    return true;
}

/// Number of spherical-harmonics coefficients a colour of a Gaussian set, the constant one included.
std::size_t harmonics(const PlyElement& vertex) {
    const auto rest = std::count_if(vertex.properties.begin(), vertex.properties.end(),
                                    [](const PlyProperty& p) { return p.name.starts_with("f_rest_"); });
    return (vertex.find("f_dc_0") ? 1 : 0) + static_cast<std::size_t>(rest) / 3;
}

void inspectGaussians(FileReport& report, const PlyElement& vertex) {
    report.kind = "gaussians";
    const bool surfels = !vertex.find("scale_2");
    report.title = surfels ? "PLY, Gaussian surfels" : "PLY, 3D Gaussians";
    report.add("gaussians", grouped(vertex.count), vertex.count);
    report.add("harmonics", fmt::format("{} a colour", counted(harmonics(vertex), "coefficient")), harmonics(vertex));
    std::vector<std::string> extra;
    for (const char* name : {"albedo_0", "roughness", "radius", "importance"}) {
        if (vertex.find(name)) extra.emplace_back(name);
    }
    if (!extra.empty()) report.add("extra", listed(extra), extra);
    for (const PlyProperty& property : vertex.properties) {
        if (property.isList) continue;
        if (const auto column = vertex.column(property.name); !column) return report.fail(column.error());
    }
}

} // namespace

void inspectPly(FileReport& report, const InspectOptions& options) {
    report.kind = "mesh";
    report.title = "PLY";
    if (options.fast) return;
    const auto file = readPly(report.path, options.limits);
    if (!file) return report.fail(file.error());
    static constexpr std::array kEncodings{"ascii", "binary, little endian", "binary, big endian"};
    report.add("encoding", kEncodings.at(static_cast<std::size_t>(file->format)));
    std::vector<std::string> elements;
    Json json = Json::object();
    for (const PlyElement& element : file->elements) {
        elements.push_back(fmt::format("{} ({}: {})", element.name, grouped(element.count),
                                       counted(element.properties.size(), "property", "properties")));
        Json names = Json::array();
        for (const PlyProperty& property : element.properties) names.push_back(property.name);
        json[element.name] = {{"count", element.count}, {"properties", names}};
    }
    report.add("elements", listed(elements), json);
    const PlyElement* vertex = file->find("vertex");
    if (vertex && isGaussianSet(*vertex)) return inspectGaussians(report, *vertex);
    const auto mesh = meshFromPly(*file);
    if (!mesh) return report.fail(mesh.error());
    report.title = mesh->triangles.empty() ? "PLY, point set" : "PLY, triangle mesh";
    addMesh(report, *mesh);
    if (const Status status = validateMesh(*mesh); !status) report.fail(status.error());
}

void inspectObj(FileReport& report, const InspectOptions& options) {
    report.kind = "mesh";
    report.title = "Wavefront OBJ, mesh";
    if (options.fast) return;
    const auto file = readObj(report.path, options.limits);
    if (!file) return report.fail(file.error());
    const TriangleMesh& mesh = file->mesh;
    addMesh(report, mesh);
    report.add("file_vertices",
               file->sourceVertexCount == mesh.positions.size() ? "" : grouped(file->sourceVertexCount),
               file->sourceVertexCount);
    if (file->groups.size() > 1) report.add("groups", std::to_string(file->groups.size()), file->groups.size());
    if (!file->materialLibraries.empty()) {
        report.add("material_libraries", listed(file->materialLibraries) + " (not read)", file->materialLibraries);
    }
    if (const Status status = validateMesh(mesh); !status) report.fail(status.error());
}

namespace {

struct GltfCounts {
    std::size_t primitives = 0;
    std::size_t vertices = 0;
    std::size_t triangles = 0;
    std::size_t skinned = 0;
    std::size_t unnormalised = 0; ///< vertices whose weights do not sum to one
};

GltfCounts countPrimitives(const GltfDocument& document) {
    GltfCounts counts;
    for (const GltfMesh& mesh : document.meshes) {
        for (const GltfPrimitive& primitive : mesh.primitives) {
            ++counts.primitives;
            counts.vertices += primitive.mesh.positions.size();
            counts.triangles += primitive.mesh.triangles.size();
            if (primitive.influences == 0) continue;
            ++counts.skinned;
            const auto width = static_cast<std::size_t>(primitive.influences);
            for (std::size_t v = 0; v * width < primitive.weights.size(); ++v) {
                double sum = 0.0;
                for (std::size_t i = 0; i < width; ++i) sum += primitive.weights[v * width + i];
                // Weights quantised to bytes sum to one within a few 1/255.
                if (std::abs(sum - 1.0) > 0.02) ++counts.unnormalised;
            }
        }
    }
    return counts;
}

/// The pictures of a glTF: size and type each; a picture that does not decode makes the file unsound.
void addGltfImages(FileReport& report, const GltfDocument& document, const InspectOptions& options) {
    Json json = Json::array();
    std::vector<std::string> shown;
    for (std::size_t i = 0; i < document.images.size(); ++i) {
        const GltfImage& source = document.images[i];
        const std::string place = fmt::format("images[{}]", i);
        if (source.bytes.empty()) {
            json.push_back({{"name", source.name}, {"missing", true}});
            continue; // the reader has noted it
        }
        const auto format = recogniseImage(source.bytes);
        const auto image = parseImageFile(source.bytes, options.limits);
        if (!image) return report.fail(atPlace(image.error(), place));
        const std::string_view type = format ? imageFormatName(*format) : "picture";
        shown.push_back(fmt::format("{} x {} {}", image->width, image->height, type));
        json.push_back({{"name", source.name}, {"width", image->width}, {"height", image->height}, {"type", type}});
    }
    if (!document.images.empty()) report.add("images", listed(shown), json);
}

void addAnimations(FileReport& report, const GltfDocument& document) {
    if (document.animations.empty()) return;
    Json json = Json::array();
    std::vector<std::string> shown;
    for (const GltfAnimation& animation : document.animations) {
        shown.push_back(fmt::format("{} ({:.2f} s, {})", animation.name.empty() ? "unnamed" : animation.name,
                                    animation.endS(), counted(animation.channels.size(), "channel")));
        json.push_back(
            {{"name", animation.name}, {"duration", animation.endS()}, {"channels", animation.channels.size()}});
    }
    report.add("animations", listed(shown, 4), json);
}

void addRig(FileReport& report, const GltfDocument& document, const InspectOptions& options) {
    const auto rig = rigFromGltf(document, options.limits);
    if (!rig) return report.fail(rig.error());
    report.kind = "skinned_mesh";
    report.add("joints", fmt::format("{}{}", rig->skeleton.jointCount(), rig->isSmplx ? ", the SMPL-X skeleton" : ""),
               rig->skeleton.jointCount());
    report.add("smplx", rig->isSmplx ? "" : "no: posed by its own joint names", rig->isSmplx);
    if (rig->restSource == RestSource::BindMatrices) {
        report.add("rest_pose",
                   fmt::format("from the inverse bind matrices; the nodes stand up to {:.3f} m off it",
                               rig->restDisagreementM),
                   "bind_matrices");
    }
    addExtent(report, rig->mesh.positions);
    for (const std::string& note : rig->notes) report.warn(note);
}

} // namespace

void inspectGltf(FileReport& report, const InspectOptions& options) {
    report.kind = "scene";
    if (options.fast) return;
    const auto document = readGltf(report.path, options.limits);
    if (!document) return report.fail(document.error());
    const GltfCounts counts = countPrimitives(*document);
    const char* container = report.format == "glb" ? "glTF binary" : "glTF";
    report.title = fmt::format("{}, {}", container,
                               counts.skinned      ? "skinned mesh"
                               : counts.primitives ? "mesh"
                                                   : "no mesh");
    report.kind = counts.primitives ? "mesh" : "scene";
    if (!document->generator.empty()) report.add("generator", document->generator);
    report.add("meshes",
               fmt::format("{}, {}", counted(document->meshes.size(), "mesh", "meshes"),
                           counted(counts.primitives, "primitive")),
               document->meshes.size());
    report.add("vertices", grouped(counts.vertices), counts.vertices);
    report.add("triangles", grouped(counts.triangles), counts.triangles);
    report.add("nodes", "", document->nodes.size());
    std::vector<std::string> materials;
    for (const GltfMaterial& material : document->materials) materials.push_back(material.name);
    if (!materials.empty()) report.add("materials", listed(materials), materials);
    addGltfImages(report, *document, options);
    if (!report.ok()) return;
    if (counts.skinned) addRig(report, *document, options);
    if (!report.ok()) return;
    addAnimations(report, *document);
    for (const std::string& note : document->notes) report.warn(note);
    if (counts.unnormalised) {
        report.warn(fmt::format("the weights of {} do not sum to one; they are normalised when read",
                                counted(counts.unnormalised, "vertex", "vertices")));
    }
}

} // namespace ars::app
