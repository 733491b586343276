#include "engine/io/gltf.h"

#include "engine/core/file.h"
#include "engine/io/gltf_accessor.h"
#include "engine/io/gltf_check.h"
#include "engine/io/text_scanner.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <new>
#include <set>
#include <utility>

namespace ars {
namespace {

Error bad(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

/// "the file has 3" or -1 where nothing is named.
Status checkIndex(int index, std::size_t count, std::string_view what, const std::string& place) {
    if (index >= -1 && index < static_cast<int>(count)) return {};
    return bad(place, fmt::format("names {} {}, the file has {}", what, index, count));
}

/// A double of the JSON as a finite float.
Result<float> toFloat(double value, const std::string& place) {
    if (std::abs(value) <= std::numeric_limits<float>::max()) return static_cast<float>(value);
    return bad(place, fmt::format("{} is beyond the range of a float", value));
}

/// A list of the JSON with a fixed length; `values` keeps its defaults when the list is missing.
template <std::size_t N>
Status readNumbers(const std::vector<double>& list, std::array<float, N>& values, const std::string& place) {
    if (list.empty()) return {};
    if (list.size() != N) return bad(place, fmt::format("expected {} numbers, found {}", N, list.size()));
    for (std::size_t i = 0; i < N; ++i) {
        ARS_TRY(values[i], toFloat(list[i], place));
    }
    return {};
}

template <typename Vector>
std::vector<Vector> asVectors(const std::vector<float>& values) {
    constexpr int kWidth = Vector::length();
    std::vector<Vector> vectors(values.size() / kWidth);
    for (std::size_t i = 0; i < vectors.size(); ++i) {
        for (int k = 0; k < kWidth; ++k) vectors[i][k] = values[i * kWidth + static_cast<std::size_t>(k)];
    }
    return vectors;
}

glm::mat4 matrixFrom(std::span<const float> columns) {
    glm::mat4 matrix;
    for (int c = 0; c < 4; ++c) {
        for (int r = 0; r < 4; ++r) matrix[c][r] = columns[static_cast<std::size_t>(4 * c + r)];
    }
    return matrix;
}

/// Translation, rotation and scale of a matrix; a mirrored one gets a negative x scale.
void decompose(const glm::mat4& matrix, GltfNode& node) {
    glm::mat3 axes(matrix);
    for (int k = 0; k < 3; ++k) node.scale[k] = glm::length(axes[k]);
    if (glm::determinant(axes) < 0.0f) node.scale.x = -node.scale.x;
    node.translation = glm::vec3(matrix[3]);
    const bool flat = node.scale.x == 0.0f || node.scale.y == 0.0f || node.scale.z == 0.0f;
    if (flat) return; // no rotation can be told
    for (int k = 0; k < 3; ++k) axes[k] /= node.scale[k];
    node.rotation = glm::normalize(glm::quat_cast(axes));
}

/// What tinygltf calls back for. Pictures stay encoded, and no file is read but those that were checked.
bool keepImageBytes(tinygltf::Image* image, const int, std::string*, std::string*, int, int, const unsigned char* bytes,
                    int size, void*) {
    image->as_is = true;
    // A picture in a buffer view is taken from there later; tinygltf hands its bytes over unchecked.
    if (image->bufferView < 0 && size > 0) image->image.assign(bytes, bytes + size);
    return true;
}

struct FolderAccess {
    std::filesystem::path folder; ///< canonical; empty: no file may be read
    ReadLimits limits;
};

bool allowedFile(const std::string& name, void* user) {
    const auto& access = *static_cast<const FolderAccess*>(user);
    const std::filesystem::path relative = std::filesystem::path(name).lexically_relative(access.folder);
    const auto path = resolveGltfUri(access.folder, relative.string());
    std::error_code ignored;
    return path && std::filesystem::is_regular_file(name, ignored);
}

bool readAllowedFile(std::vector<unsigned char>* out, std::string* error, const std::string& name, void* user) {
    Result<std::vector<std::byte>> bytes = readFile(name, static_cast<const FolderAccess*>(user)->limits);
    if (!bytes) {
        *error = bytes.error().describe();
        return false;
    }
    const auto* data = reinterpret_cast<const unsigned char*>(bytes->data());
    out->assign(data, data + bytes->size());
    return true;
}

bool refuseToWrite(std::string*, const std::string&, const std::vector<unsigned char>&, void*) { return false; }

std::string firstLine(std::string text) {
    text = text.substr(0, text.find('\n'));
    return text.empty() ? "tinygltf gives no reason" : text;
}

Status loadModel(std::span<const std::byte> bytes, const GltfParts& parts, FolderAccess& access,
                 tinygltf::Model& model) {
    if (bytes.size() > std::numeric_limits<std::uint32_t>::max()) {
        return makeError(ErrorCode::LimitExceeded, "",
                         fmt::format("{} bytes, a glTF file ends at 4 GiB", bytes.size()));
    }
    tinygltf::TinyGLTF loader;
    loader.SetImageLoader(&keepImageBytes, nullptr);
    loader.SetFsCallbacks(
        {&allowedFile, [](const std::string& name, void*) { return name; }, &readAllowedFile, &refuseToWrite, &access});
    std::string errors, warnings;
    try {
        const std::string folder = access.folder.string();
        const bool loaded = parts.isBinary
                                ? loader.LoadBinaryFromMemory(&model, &errors, &warnings,
                                                              reinterpret_cast<const unsigned char*>(bytes.data()),
                                                              static_cast<unsigned int>(bytes.size()), folder)
                                : loader.LoadASCIIFromString(&model, &errors, &warnings, parts.json.data(),
                                                             static_cast<unsigned int>(parts.json.size()), folder);
        if (!loaded) return bad("", firstLine(errors));
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, "", fmt::format("no memory for a glTF of {} bytes", bytes.size()));
    } catch (const std::exception& error) {
        return bad("", firstLine(error.what()));
    }
    return {};
}

/// tinygltf's model into ours, one list after the other.
class GltfBuilder {
public:
    GltfBuilder(const tinygltf::Model& model, const ReadLimits& limits, std::vector<std::string> notes)
        : model_(model), limits_(limits), accessors_(model, limits) {
        document_.notes = std::move(notes);
    }

    Result<GltfDocument> build() {
        document_.generator = model_.asset.generator;
        ARS_TRY_STATUS(readNodes());
        ARS_TRY_STATUS(linkNodes());
        ARS_TRY_STATUS(readScene());
        ARS_TRY_STATUS(readImages());
        ARS_TRY_STATUS(readMaterials());
        ARS_TRY_STATUS(readMeshes());
        ARS_TRY_STATUS(readSkins());
        ARS_TRY_STATUS(checkSkinnedNodes());
        ARS_TRY_STATUS(readAnimations());
        return std::move(document_);
    }

private:
    void note(std::string text) {
        // A hostile file must not fill memory with remarks.
        if (document_.notes.size() < 100) document_.notes.push_back(std::move(text));
    }

    Status readNode(const tinygltf::Node& source, const std::string& place, GltfNode& node) {
        node.name = source.name;
        node.mesh = source.mesh;
        node.skin = source.skin;
        node.children = source.children;
        ARS_TRY_STATUS(checkIndex(node.mesh, model_.meshes.size(), "mesh", place));
        ARS_TRY_STATUS(checkIndex(node.skin, model_.skins.size(), "skin", place));
        std::array<float, 3> translation{0, 0, 0}, scale{1, 1, 1};
        std::array<float, 4> rotation{0, 0, 0, 1};
        std::array<float, 16> matrix{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
        ARS_TRY_STATUS(readNumbers(source.translation, translation, place + ".translation"));
        ARS_TRY_STATUS(readNumbers(source.rotation, rotation, place + ".rotation"));
        ARS_TRY_STATUS(readNumbers(source.scale, scale, place + ".scale"));
        ARS_TRY_STATUS(readNumbers(source.matrix, matrix, place + ".matrix"));
        if (!source.matrix.empty()) {
            node.hasMatrix = true;
            node.localMatrix = matrixFrom(matrix);
            decompose(node.localMatrix, node);
            return {};
        }
        node.translation = {translation[0], translation[1], translation[2]};
        node.scale = {scale[0], scale[1], scale[2]};
        const glm::quat q(rotation[3], rotation[0], rotation[1], rotation[2]);
        // Double: the squares of large floats overflow.
        const double length = glm::length(glm::dquat(q));
        if (!(length > 1e-6)) return bad(place + ".rotation", "expected a quaternion of unit length, found 0");
        node.rotation = glm::quat(glm::dquat(q) / length);
        node.localMatrix = gltfLocalMatrix(node);
        return {};
    }
    Status readNodes() {
        document_.nodes.resize(model_.nodes.size());
        for (std::size_t i = 0; i < model_.nodes.size(); ++i) {
            ARS_TRY_STATUS(readNode(model_.nodes[i], fmt::format("nodes[{}]", i), document_.nodes[i]));
        }
        return {};
    }
    /// Parents from children. A node below two parents is refused; one below itself is never reached from a root.
    Status linkNodes() {
        auto& nodes = document_.nodes;
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            const std::string place = fmt::format("nodes[{}].children", i);
            for (const int child : nodes[i].children) {
                if (child < 0 || static_cast<std::size_t>(child) >= nodes.size()) {
                    return bad(place, fmt::format("names node {}, the file has {}", child, nodes.size()));
                }
                GltfNode& node = nodes[static_cast<std::size_t>(child)];
                if (node.parent >= 0) {
                    return bad(place, fmt::format("node {} already hangs below node {}", child, node.parent));
                }
                node.parent = static_cast<int>(i);
            }
        }
        std::vector<std::uint32_t> depth(nodes.size(), 0); // 0: not reached
        std::vector<std::size_t> open;
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            if (nodes[i].parent >= 0) continue;
            depth[i] = 1;
            open.push_back(i);
        }
        while (!open.empty()) {
            const std::size_t i = open.back();
            open.pop_back();
            if (depth[i] > limits_.maxNesting) {
                return makeError(ErrorCode::LimitExceeded, fmt::format("nodes[{}]", i),
                                 fmt::format("nodes nested deeper than {}", limits_.maxNesting));
            }
            for (const int child : nodes[i].children) {
                depth[static_cast<std::size_t>(child)] = depth[i] + 1;
                open.push_back(static_cast<std::size_t>(child));
            }
        }
        const auto cyclic = std::find(depth.begin(), depth.end(), 0u);
        if (cyclic == depth.end()) return {};
        return bad(fmt::format("nodes[{}]", cyclic - depth.begin()), "the node is its own ancestor");
    }
    Status readScene() {
        ARS_TRY_STATUS(checkIndex(model_.defaultScene, model_.scenes.size(), "scene", "scene"));
        if (model_.scenes.empty()) {
            for (std::size_t i = 0; i < document_.nodes.size(); ++i) {
                if (document_.nodes[i].parent < 0) document_.sceneRoots.push_back(static_cast<int>(i));
            }
            return {};
        }
        const int scene = std::max(model_.defaultScene, 0);
        for (const int root : model_.scenes[static_cast<std::size_t>(scene)].nodes) {
            if (root < 0) return bad(fmt::format("scenes[{}].nodes", scene), fmt::format("names node {}", root));
            ARS_TRY_STATUS(checkIndex(root, document_.nodes.size(), "node", fmt::format("scenes[{}].nodes", scene)));
            document_.sceneRoots.push_back(root);
        }
        return {};
    }

    Status readImages() {
        document_.images.resize(model_.images.size());
        for (std::size_t i = 0; i < model_.images.size(); ++i) {
            const tinygltf::Image& source = model_.images[i];
            GltfImage& image = document_.images[i];
            const std::string place = fmt::format("images[{}]", i);
            image.name = source.name;
            image.mimeType = source.mimeType;
            image.uri = source.uri;
            std::span<const unsigned char> bytes = source.image;
            if (source.bufferView >= 0) {
                ARS_TRY(bytes, accessors_.view(source.bufferView, place));
            }
            ARS_TRY_STATUS(accessors_.budget().take(bytes.size(), place));
            const auto* data = reinterpret_cast<const std::byte*>(bytes.data());
            image.bytes.assign(data, data + bytes.size());
        }
        return {};
    }

    /// The image behind a texture reference of a material, or -1.
    template <typename TextureInfo>
    Status readTexture(const TextureInfo& info, const std::string& place, int& image) {
        ARS_TRY_STATUS(checkIndex(info.index, model_.textures.size(), "texture", place));
        if (info.index < 0) return {};
        image = model_.textures[static_cast<std::size_t>(info.index)].source;
        ARS_TRY_STATUS(checkIndex(image, document_.images.size(), "image", fmt::format("textures[{}]", info.index)));
        if (info.texCoord != 0) {
            note(fmt::format("{}: texture coordinates {} are not read, the first are used", place, info.texCoord));
        }
        if (info.extensions.count("KHR_texture_transform") > 0) {
            note(fmt::format("{}: its texture transform is ignored", place));
        }
        return {};
    }
    Status readMaterial(const tinygltf::Material& source, const std::string& place, GltfMaterial& material) {
        const tinygltf::PbrMetallicRoughness& pbr = source.pbrMetallicRoughness;
        material.name = source.name;
        material.doubleSided = source.doubleSided;
        std::array<float, 4> color{1, 1, 1, 1};
        std::array<float, 3> emissive{0, 0, 0};
        ARS_TRY_STATUS(readNumbers(pbr.baseColorFactor, color, place + ".baseColorFactor"));
        ARS_TRY_STATUS(readNumbers(source.emissiveFactor, emissive, place + ".emissiveFactor"));
        material.baseColorFactor = {color[0], color[1], color[2], color[3]};
        material.emissiveFactor = {emissive[0], emissive[1], emissive[2]};
        ARS_TRY(material.metallicFactor, toFloat(pbr.metallicFactor, place + ".metallicFactor"));
        ARS_TRY(material.roughnessFactor, toFloat(pbr.roughnessFactor, place + ".roughnessFactor"));
        ARS_TRY(material.normalScale, toFloat(source.normalTexture.scale, place + ".normalTexture.scale"));
        ARS_TRY(material.alphaCutoff, toFloat(source.alphaCutoff, place + ".alphaCutoff"));
        ARS_TRY_STATUS(readTexture(pbr.baseColorTexture, place + ".baseColorTexture", material.baseColorImage));
        ARS_TRY_STATUS(readTexture(pbr.metallicRoughnessTexture, place + ".metallicRoughnessTexture",
                                   material.metallicRoughnessImage));
        ARS_TRY_STATUS(readTexture(source.normalTexture, place + ".normalTexture", material.normalImage));
        ARS_TRY_STATUS(readTexture(source.occlusionTexture, place + ".occlusionTexture", material.occlusionImage));
        ARS_TRY_STATUS(readTexture(source.emissiveTexture, place + ".emissiveTexture", material.emissiveImage));
        if (source.alphaMode == "MASK") material.alphaMode = GltfAlphaMode::Mask;
        if (source.alphaMode == "BLEND") material.alphaMode = GltfAlphaMode::Blend;
        return {};
    }
    Status readMaterials() {
        document_.materials.resize(model_.materials.size());
        for (std::size_t i = 0; i < model_.materials.size(); ++i) {
            ARS_TRY_STATUS(readMaterial(model_.materials[i], fmt::format("materials[{}]", i), document_.materials[i]));
        }
        return {};
    }

    static int attribute(const std::map<std::string, int>& attributes, const std::string& name) {
        const auto found = attributes.find(name);
        return found == attributes.end() ? -1 : found->second;
    }
    template <typename Vector>
    Status readVectors(const std::map<std::string, int>& attributes, const char* name, int type, std::size_t count,
                       const std::string& place, std::vector<Vector>& vectors) {
        const int accessor = attribute(attributes, name);
        if (accessor < 0) return {};
        ARS_TRY(const std::vector<float> values,
                accessors_.floats(accessor, type, count, fmt::format("{}.{}", place, name)));
        vectors = asVectors<Vector>(values);
        return {};
    }
    Status readColors(const std::map<std::string, int>& attributes, std::size_t count, const std::string& place,
                      std::vector<glm::vec4>& colors) {
        if (accessors_.typeOf(attribute(attributes, "COLOR_0")) != TINYGLTF_TYPE_VEC3) {
            return readVectors(attributes, "COLOR_0", TINYGLTF_TYPE_VEC4, count, place, colors);
        }
        std::vector<glm::vec3> opaque;
        ARS_TRY_STATUS(readVectors(attributes, "COLOR_0", TINYGLTF_TYPE_VEC3, count, place, opaque));
        colors.reserve(opaque.size());
        for (const glm::vec3& color : opaque) colors.emplace_back(color, 1.0f);
        return {};
    }

    /// One set of four joints and weights into columns [4 set, 4 set + 4).
    Status readInfluenceSet(const std::map<std::string, int>& attributes, int set, std::size_t count,
                            const std::string& place, GltfPrimitive& primitive) {
        const std::string jointName = fmt::format("JOINTS_{}", set), weightName = fmt::format("WEIGHTS_{}", set);
        const int weightAccessor = attribute(attributes, weightName);
        if (weightAccessor < 0) return bad(place, fmt::format("{} without {}", jointName, weightName));
        ARS_TRY(const auto joints, accessors_.integers(attribute(attributes, jointName), TINYGLTF_TYPE_VEC4, count,
                                                       fmt::format("{}.{}", place, jointName)));
        ARS_TRY(const auto weights,
                accessors_.floats(weightAccessor, TINYGLTF_TYPE_VEC4, count, fmt::format("{}.{}", place, weightName)));
        const auto width = static_cast<std::size_t>(primitive.influences);
        for (std::size_t i = 0; i < joints.size(); ++i) {
            if (weights[i] < 0.0f) {
                return bad(fmt::format("{}.{}", place, weightName),
                           fmt::format("vertex {} has the weight {}", i / 4, weights[i]));
            }
            if (joints[i] > std::numeric_limits<std::uint16_t>::max()) {
                return bad(fmt::format("{}.{}", place, jointName),
                           fmt::format("vertex {} names joint {}", i / 4, joints[i]));
            }
            const std::size_t slot = i / 4 * width + static_cast<std::size_t>(4 * set) + i % 4;
            primitive.joints[slot] = static_cast<std::uint16_t>(joints[i]);
            primitive.weights[slot] = weights[i];
        }
        return {};
    }
    Status readInfluences(const std::map<std::string, int>& attributes, std::size_t count, const std::string& place,
                          GltfPrimitive& primitive) {
        int sets = 0;
        while (attribute(attributes, fmt::format("JOINTS_{}", sets)) >= 0) ++sets;
        if (sets == 0) return {};
        if (sets > 2) {
            return makeError(ErrorCode::Unsupported, place,
                             fmt::format("{} joints for a vertex; at most 8 are read", 4 * sets));
        }
        primitive.influences = 4 * sets;
        const std::size_t slots = count * static_cast<std::size_t>(primitive.influences);
        ARS_TRY_STATUS(accessors_.budget().take(slots * 6, place));
        primitive.joints.resize(slots);
        primitive.weights.resize(slots);
        for (int set = 0; set < sets; ++set) {
            ARS_TRY_STATUS(readInfluenceSet(attributes, set, count, place, primitive));
        }
        return {};
    }

    Status readTriangles(const tinygltf::Primitive& source, const std::string& place, int mode, TriangleMesh& mesh) {
        const std::size_t vertices = mesh.positions.size();
        std::vector<std::uint32_t> indices;
        if (source.indices >= 0) {
            ARS_TRY(indices,
                    accessors_.integers(source.indices, TINYGLTF_TYPE_SCALAR, std::nullopt, place + ".indices"));
        } else {
            ARS_TRY_STATUS(accessors_.budget().take(vertices * sizeof(std::uint32_t), place));
            indices.resize(vertices);
            for (std::size_t i = 0; i < vertices; ++i) indices[i] = static_cast<std::uint32_t>(i);
        }
        for (std::size_t i = 0; i < indices.size(); ++i) {
            if (indices[i] < vertices) continue;
            return bad(place + ".indices",
                       fmt::format("index {} names vertex {}, the primitive has {}", i, indices[i], vertices));
        }
        ARS_TRY_STATUS(accessors_.budget().take(indices.size() * sizeof(glm::uvec3), place));
        if (mode == TINYGLTF_MODE_TRIANGLES) {
            if (indices.size() % 3 != 0) {
                return bad(place, fmt::format("{} corners of triangles, expected a multiple of 3", indices.size()));
            }
            for (std::size_t i = 0; i < indices.size(); i += 3) {
                mesh.triangles.emplace_back(indices[i], indices[i + 1], indices[i + 2]);
            }
        } else {
            // glTF 2.0, 3.7.2.1: every second triangle of a strip turns round; a fan keeps its first vertex.
            for (std::size_t i = 0; i + 2 < indices.size(); ++i) {
                const bool fan = mode == TINYGLTF_MODE_TRIANGLE_FAN;
                const std::size_t turned = i % 2;
                mesh.triangles.push_back(
                    fan ? glm::uvec3(indices[i + 1], indices[i + 2], indices[0])
                        : glm::uvec3(indices[i], indices[i + 1 + turned], indices[i + 2 - turned]));
            }
        }
        return {};
    }
    Status readMorphTargets(const tinygltf::Primitive& source, const std::vector<std::string>& names, std::size_t count,
                            const std::string& place, GltfPrimitive& primitive) {
        for (std::size_t t = 0; t < source.targets.size(); ++t) {
            const std::string targetPlace = fmt::format("{}.targets[{}]", place, t);
            GltfMorphTarget target;
            if (t < names.size()) target.name = names[t];
            ARS_TRY_STATUS(
                readVectors(source.targets[t], "POSITION", TINYGLTF_TYPE_VEC3, count, targetPlace, target.positions));
            ARS_TRY_STATUS(
                readVectors(source.targets[t], "NORMAL", TINYGLTF_TYPE_VEC3, count, targetPlace, target.normals));
            primitive.morphTargets.push_back(std::move(target));
        }
        return {};
    }
    Status readPrimitive(const tinygltf::Mesh& owner, const tinygltf::Primitive& source,
                         const std::vector<std::string>& targetNames, const std::string& place, GltfMesh& mesh) {
        const int mode = source.mode < 0 ? TINYGLTF_MODE_TRIANGLES : source.mode;
        if (mode > TINYGLTF_MODE_TRIANGLE_FAN) return bad(place, fmt::format("mode {}, expected 0 to 6", mode));
        if (mode < TINYGLTF_MODE_TRIANGLES) {
            note(fmt::format("{}: points and lines are left out", place));
            return {};
        }
        const std::string attributes = place + ".attributes";
        const int position = attribute(source.attributes, "POSITION");
        if (position < 0) {
            note(fmt::format("{}: a primitive without positions is left out", place));
            return {};
        }
        GltfPrimitive primitive;
        primitive.mesh.name = owner.name;
        primitive.material = source.material;
        ARS_TRY_STATUS(checkIndex(source.material, model_.materials.size(), "material", place));
        ARS_TRY(const std::vector<float> positions,
                accessors_.floats(position, TINYGLTF_TYPE_VEC3, std::nullopt, attributes + ".POSITION"));
        primitive.mesh.positions = asVectors<glm::vec3>(positions);
        const std::size_t count = primitive.mesh.positions.size();
        TriangleMesh& triangles = primitive.mesh;
        ARS_TRY_STATUS(
            readVectors(source.attributes, "NORMAL", TINYGLTF_TYPE_VEC3, count, attributes, triangles.normals));
        ARS_TRY_STATUS(
            readVectors(source.attributes, "TEXCOORD_0", TINYGLTF_TYPE_VEC2, count, attributes, triangles.uvs));
        ARS_TRY_STATUS(readColors(source.attributes, count, attributes, triangles.colors));
        ARS_TRY_STATUS(readInfluences(source.attributes, count, attributes, primitive));
        ARS_TRY_STATUS(readTriangles(source, place, mode, triangles));
        ARS_TRY_STATUS(readMorphTargets(source, targetNames, count, place, primitive));
        mesh.primitives.push_back(std::move(primitive));
        return {};
    }
    /// Exporters agree on naming morph targets in the mesh's extras.
    static std::vector<std::string> morphTargetNames(const tinygltf::Mesh& mesh) {
        std::vector<std::string> names;
        if (!mesh.extras.IsObject() || !mesh.extras.Has("targetNames")) return names;
        const tinygltf::Value& list = mesh.extras.Get("targetNames");
        for (std::size_t i = 0; i < list.ArrayLen(); ++i) {
            const tinygltf::Value& name = list.Get(static_cast<int>(i));
            names.push_back(name.IsString() ? name.Get<std::string>() : "");
        }
        return names;
    }
    Status readMeshes() {
        document_.meshes.resize(model_.meshes.size());
        for (std::size_t i = 0; i < model_.meshes.size(); ++i) {
            const tinygltf::Mesh& source = model_.meshes[i];
            GltfMesh& mesh = document_.meshes[i];
            mesh.name = source.name;
            const std::string place = fmt::format("meshes[{}]", i);
            for (const double weight : source.weights) {
                ARS_TRY(const float value, toFloat(weight, place + ".weights"));
                mesh.morphWeights.push_back(value);
            }
            const std::vector<std::string> names = morphTargetNames(source);
            for (std::size_t p = 0; p < source.primitives.size(); ++p) {
                ARS_TRY_STATUS(readPrimitive(source, source.primitives[p], names,
                                             fmt::format("{}.primitives[{}]", place, p), mesh));
            }
        }
        return {};
    }

    Status readSkin(const tinygltf::Skin& source, const std::string& place, GltfSkin& skin) {
        skin.name = source.name;
        skin.skeletonRoot = source.skeleton;
        ARS_TRY_STATUS(checkIndex(source.skeleton, model_.nodes.size(), "node", place + ".skeleton"));
        if (source.joints.empty()) return bad(place + ".joints", "expected at least one joint");
        if (source.joints.size() > limits_.maxJoints) {
            return makeError(ErrorCode::LimitExceeded, place + ".joints",
                             fmt::format("{} joints, the limit is {}", source.joints.size(), limits_.maxJoints));
        }
        std::set<int> seen;
        for (const int joint : source.joints) {
            if (joint < 0) return bad(place + ".joints", fmt::format("names node {}", joint));
            ARS_TRY_STATUS(checkIndex(joint, model_.nodes.size(), "node", place + ".joints"));
            if (!seen.insert(joint).second) return bad(place + ".joints", fmt::format("names node {} twice", joint));
        }
        skin.joints = source.joints;
        skin.inverseBindMatrices.assign(skin.joints.size(), glm::mat4(1.0f));
        if (source.inverseBindMatrices < 0) return {};
        const std::string matrixPlace = place + ".inverseBindMatrices";
        ARS_TRY(const std::size_t matrices, accessors_.count(source.inverseBindMatrices, matrixPlace));
        if (matrices < skin.joints.size()) {
            return bad(matrixPlace, fmt::format("{} matrices for {} joints", matrices, skin.joints.size()));
        }
        ARS_TRY(const std::vector<float> values,
                accessors_.floats(source.inverseBindMatrices, TINYGLTF_TYPE_MAT4, std::nullopt, matrixPlace));
        for (std::size_t i = 0; i < skin.joints.size(); ++i) {
            skin.inverseBindMatrices[i] = matrixFrom(std::span<const float>(values).subspan(16 * i, 16));
        }
        return {};
    }
    Status readSkins() {
        document_.skins.resize(model_.skins.size());
        for (std::size_t i = 0; i < model_.skins.size(); ++i) {
            ARS_TRY_STATUS(readSkin(model_.skins[i], fmt::format("skins[{}]", i), document_.skins[i]));
        }
        return {};
    }
    /// A joint beyond the skin is harmless where its weight is 0 (exporters pad with any number): it becomes 0.
    static Status checkJoints(GltfPrimitive& primitive, std::size_t jointCount, const std::string& place) {
        for (std::size_t i = 0; i < primitive.joints.size(); ++i) {
            if (primitive.joints[i] < jointCount) continue;
            if (primitive.weights[i] > 0.0f) {
                return bad(place, fmt::format("vertex {} names joint {}, its skin has {}",
                                              i / static_cast<std::size_t>(primitive.influences), primitive.joints[i],
                                              jointCount));
            }
            primitive.joints[i] = 0;
        }
        return {};
    }
    /// Each mesh against the smallest skin that moves it: many nodes may share one mesh.
    Status checkSkinnedNodes() {
        constexpr std::size_t kUnskinned = std::numeric_limits<std::size_t>::max();
        std::vector<std::size_t> jointCounts(document_.meshes.size(), kUnskinned);
        for (const GltfNode& node : document_.nodes) {
            if (node.mesh < 0 || node.skin < 0) continue;
            std::size_t& count = jointCounts[static_cast<std::size_t>(node.mesh)];
            count = std::min(count, document_.skins[static_cast<std::size_t>(node.skin)].joints.size());
        }
        for (std::size_t m = 0; m < jointCounts.size(); ++m) {
            auto& primitives = document_.meshes[m].primitives;
            for (std::size_t p = 0; p < primitives.size() && jointCounts[m] != kUnskinned; ++p) {
                ARS_TRY_STATUS(
                    checkJoints(primitives[p], jointCounts[m], fmt::format("meshes[{}].primitives[{}]", m, p)));
            }
        }
        return {};
    }

    /// Numbers of one value of a channel: 3, 4, or the morph targets of the node's mesh; 0 when there are none.
    int channelWidth(int node, GltfPath path) const {
        if (path == GltfPath::Rotation) return 4;
        if (path != GltfPath::Weights) return 3;
        const int mesh = document_.nodes[static_cast<std::size_t>(node)].mesh;
        if (mesh < 0 || document_.meshes[static_cast<std::size_t>(mesh)].primitives.empty()) return 0;
        return static_cast<int>(document_.meshes[static_cast<std::size_t>(mesh)].primitives[0].morphTargets.size());
    }
    Status readSampler(const tinygltf::AnimationSampler& sampler, const std::string& place, GltfChannel& channel) {
        if (sampler.interpolation == "STEP") {
            channel.interpolation = GltfInterpolation::Step;
        } else if (sampler.interpolation == "CUBICSPLINE") {
            channel.interpolation = GltfInterpolation::CubicSpline;
        } else if (sampler.interpolation != "LINEAR") {
            return bad(place, fmt::format("interpolation {}, expected STEP, LINEAR or CUBICSPLINE",
                                          quotedFound(sampler.interpolation)));
        }
        ARS_TRY(channel.times, accessors_.floats(sampler.input, TINYGLTF_TYPE_SCALAR, std::nullopt, place + ".input"));
        for (std::size_t i = 1; i < channel.times.size(); ++i) {
            if (channel.times[i] > channel.times[i - 1]) continue;
            return bad(place + ".input",
                       fmt::format("time {} is {} s, not after {} s", i, channel.times[i], channel.times[i - 1]));
        }
        const std::size_t perTime = channel.interpolation == GltfInterpolation::CubicSpline ? 3 : 1;
        const bool weights = channel.path == GltfPath::Weights;
        const int type = weights                              ? TINYGLTF_TYPE_SCALAR
                         : channel.path == GltfPath::Rotation ? TINYGLTF_TYPE_VEC4
                                                              : TINYGLTF_TYPE_VEC3;
        const std::size_t count =
            channel.times.size() * perTime * (weights ? static_cast<std::size_t>(channel.width) : 1);
        ARS_TRY(channel.values, accessors_.floats(sampler.output, type, count, place + ".output"));
        return {};
    }
    Status readChannel(const tinygltf::Animation& source, const tinygltf::AnimationChannel& from,
                       const std::string& place, GltfAnimation& animation) {
        GltfChannel channel;
        channel.node = from.target_node;
        if (from.target_path == "rotation") {
            channel.path = GltfPath::Rotation;
        } else if (from.target_path == "scale") {
            channel.path = GltfPath::Scale;
        } else if (from.target_path == "weights") {
            channel.path = GltfPath::Weights;
        } else if (from.target_path != "translation") {
            note(fmt::format("{}: the animated property {} is left out", place, quotedFound(from.target_path)));
            return {};
        }
        ARS_TRY_STATUS(checkIndex(channel.node, document_.nodes.size(), "node", place + ".target"));
        channel.width = channel.node < 0 ? 0 : channelWidth(channel.node, channel.path);
        if (channel.width == 0) {
            note(fmt::format("{}: it moves nothing and is left out", place));
            return {};
        }
        if (from.sampler < 0) return bad(place, "has no sampler");
        ARS_TRY_STATUS(checkIndex(from.sampler, source.samplers.size(), "sampler", place));
        ARS_TRY_STATUS(readSampler(source.samplers[static_cast<std::size_t>(from.sampler)], place, channel));
        animation.channels.push_back(std::move(channel));
        return {};
    }
    Status readAnimations() {
        document_.animations.resize(model_.animations.size());
        for (std::size_t i = 0; i < model_.animations.size(); ++i) {
            const tinygltf::Animation& source = model_.animations[i];
            document_.animations[i].name = source.name;
            for (std::size_t c = 0; c < source.channels.size(); ++c) {
                ARS_TRY_STATUS(readChannel(source, source.channels[c], fmt::format("animations[{}].channels[{}]", i, c),
                                           document_.animations[i]));
            }
        }
        return {};
    }

    const tinygltf::Model& model_;
    const ReadLimits& limits_;
    GltfAccessors accessors_;
    GltfDocument document_;
};

} // namespace

glm::mat4 gltfLocalMatrix(const GltfNode& node) {
    glm::mat4 matrix = glm::mat4_cast(node.rotation);
    for (int k = 0; k < 3; ++k) matrix[k] *= node.scale[k];
    matrix[3] = glm::vec4(node.translation, 1.0f);
    return matrix;
}

float GltfAnimation::endS() const {
    float end = 0.0f;
    for (const GltfChannel& channel : channels) {
        if (!channel.times.empty()) end = std::max(end, channel.times.back());
    }
    return end;
}

int GltfDocument::findNode(std::string_view name) const {
    const auto found = std::find_if(nodes.begin(), nodes.end(), [&](const GltfNode& n) { return n.name == name; });
    return found == nodes.end() ? -1 : static_cast<int>(found - nodes.begin());
}

std::vector<glm::mat4> GltfDocument::globalMatrices() const {
    std::vector<glm::mat4> matrices(nodes.size(), glm::mat4(1.0f));
    std::vector<bool> done(nodes.size(), false);
    std::vector<std::size_t> chain;
    for (std::size_t i = 0; i < nodes.size(); ++i) {
        // Up to the nearest ancestor whose matrix is known, then down again.
        for (std::size_t n = i; !done[n]; n = static_cast<std::size_t>(nodes[n].parent)) {
            chain.push_back(n);
            if (nodes[n].parent < 0) break;
        }
        while (!chain.empty()) {
            const std::size_t n = chain.back();
            chain.pop_back();
            const int parent = nodes[n].parent;
            matrices[n] =
                parent < 0 ? nodes[n].localMatrix : matrices[static_cast<std::size_t>(parent)] * nodes[n].localMatrix;
            done[n] = true;
        }
    }
    return matrices;
}

Result<GltfDocument> parseGltf(std::span<const std::byte> bytes, const std::filesystem::path& folder,
                               const ReadLimits& limits) {
    ARS_TRY(const GltfParts parts, splitGltf(bytes));
    std::vector<std::string> notes;
    ARS_TRY_STATUS(checkGltfJson(parts, folder, limits, notes));
    FolderAccess access{{}, limits};
    if (!folder.empty()) {
        std::error_code ignored;
        access.folder = std::filesystem::weakly_canonical(folder / "x", ignored).parent_path();
    }
    tinygltf::Model model;
    ARS_TRY_STATUS(loadModel(bytes, parts, access, model));
    return GltfBuilder(model, limits, std::move(notes)).build();
}

Result<GltfDocument> readGltf(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : ".";
    Result<GltfDocument> document = parseGltf(bytes, folder, limits);
    if (!document) return atPlace(std::move(document).error(), path.string());
    return document;
}

} // namespace ars
