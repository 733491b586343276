#include "engine/core/file.h"
#include "engine/io/gltf.h"

#include <fmt/format.h>
#include <tiny_gltf.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <new>
#include <sstream>
#include <utility>

namespace ars {
namespace {

Error invalid(std::string place, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(place), std::move(message));
}

Status checkIndex(int index, std::size_t count, std::string_view what, const std::string& place) {
    if (index >= -1 && index < static_cast<int>(count)) return {};
    return invalid(place, fmt::format("names {} {}, the document has {}", what, index, count));
}

Status checkCount(std::size_t found, std::size_t expected, std::string_view what, const std::string& place) {
    if (found == expected) return {};
    return invalid(place, fmt::format("expected {} {}, found {}", expected, what, found));
}

bool allFinite(std::span<const float> values) {
    return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

template <typename Vector>
std::span<const float> asFloats(const std::vector<Vector>& vectors) {
    static_assert(sizeof(Vector) == sizeof(float) * Vector::length());
    return {reinterpret_cast<const float*>(vectors.data()), vectors.size() * Vector::length()};
}

Status checkNodes(const GltfDocument& document) {
    for (std::size_t i = 0; i < document.nodes.size(); ++i) {
        const GltfNode& node = document.nodes[i];
        const std::string place = fmt::format("nodes[{}]", i);
        ARS_TRY_STATUS(checkIndex(node.parent, document.nodes.size(), "node", place + ".parent"));
        ARS_TRY_STATUS(checkIndex(node.mesh, document.meshes.size(), "mesh", place));
        ARS_TRY_STATUS(checkIndex(node.skin, document.skins.size(), "skin", place));
        // A walk towards the root that is longer than there are nodes goes in circles.
        std::size_t steps = 0;
        for (int n = static_cast<int>(i); n >= 0 && n < static_cast<int>(document.nodes.size());
             n = document.nodes[static_cast<std::size_t>(n)].parent) {
            if (++steps > document.nodes.size()) return invalid(place, "the node is its own ancestor");
        }
        const glm::mat4 matrix = node.hasMatrix ? node.localMatrix : gltfLocalMatrix(node);
        if (!allFinite({&matrix[0][0], 16})) return invalid(place, "its transform is not finite");
    }
    for (const int root : document.sceneRoots) {
        if (root < 0) return invalid("sceneRoots", fmt::format("names node {}", root));
        ARS_TRY_STATUS(checkIndex(root, document.nodes.size(), "node", "sceneRoots"));
    }
    return {};
}

Status checkPrimitive(const GltfDocument& document, const GltfPrimitive& primitive, const std::string& place) {
    if (Status status = validateMesh(primitive.mesh); !status) return atPlace(std::move(status).error(), place);
    const TriangleMesh& mesh = primitive.mesh;
    const std::size_t vertices = mesh.positions.size();
    if (vertices == 0 || mesh.triangles.empty()) return invalid(place, "a primitive needs at least one triangle");
    ARS_TRY_STATUS(checkIndex(primitive.material, document.materials.size(), "material", place));
    for (const std::int32_t material : mesh.materials) {
        ARS_TRY_STATUS(checkIndex(material, document.materials.size(), "material", place));
    }
    if (primitive.influences != 0 && primitive.influences != 4 && primitive.influences != 8) {
        return invalid(place, fmt::format("{} joints a vertex, expected 0, 4 or 8", primitive.influences));
    }
    const std::size_t slots = vertices * static_cast<std::size_t>(primitive.influences);
    ARS_TRY_STATUS(checkCount(primitive.joints.size(), slots, "joints", place));
    ARS_TRY_STATUS(checkCount(primitive.weights.size(), slots, "weights", place));
    for (std::size_t i = 0; i < slots; ++i) {
        if (std::isfinite(primitive.weights[i]) && primitive.weights[i] >= 0.0f) continue;
        return invalid(place, fmt::format("vertex {} has the weight {}",
                                          i / static_cast<std::size_t>(primitive.influences), primitive.weights[i]));
    }
    for (const GltfMorphTarget& target : primitive.morphTargets) {
        if (!target.positions.empty())
            ARS_TRY_STATUS(checkCount(target.positions.size(), vertices, "morph positions", place));
        if (!target.normals.empty())
            ARS_TRY_STATUS(checkCount(target.normals.size(), vertices, "morph normals", place));
        if (!allFinite(asFloats(target.positions)) || !allFinite(asFloats(target.normals))) {
            return invalid(place, "a morph target is not finite");
        }
    }
    return {};
}

Status checkMeshes(const GltfDocument& document) {
    for (std::size_t m = 0; m < document.meshes.size(); ++m) {
        const GltfMesh& mesh = document.meshes[m];
        if (mesh.primitives.empty())
            return invalid(fmt::format("meshes[{}]", m), "a mesh needs at least one primitive");
        for (std::size_t p = 0; p < mesh.primitives.size(); ++p) {
            const std::string place = fmt::format("meshes[{}].primitives[{}]", m, p);
            ARS_TRY_STATUS(checkPrimitive(document, mesh.primitives[p], place));
            ARS_TRY_STATUS(checkCount(mesh.primitives[p].morphTargets.size(), mesh.primitives[0].morphTargets.size(),
                                      "morph targets, as in the first primitive", place));
        }
    }
    // Joints must exist in every skin that moves the mesh.
    for (const GltfNode& node : document.nodes) {
        if (node.mesh < 0 || node.skin < 0) continue;
        const std::size_t joints = document.skins[static_cast<std::size_t>(node.skin)].joints.size();
        for (const GltfPrimitive& primitive : document.meshes[static_cast<std::size_t>(node.mesh)].primitives) {
            for (const std::uint16_t joint : primitive.joints) {
                if (joint < joints) continue;
                return invalid(fmt::format("meshes[{}]", node.mesh),
                               fmt::format("names joint {}, its skin has {}", joint, joints));
            }
        }
    }
    return {};
}

Status checkMaterials(const GltfDocument& document) {
    for (std::size_t i = 0; i < document.materials.size(); ++i) {
        const GltfMaterial& material = document.materials[i];
        const std::string place = fmt::format("materials[{}]", i);
        for (const int image : {material.baseColorImage, material.metallicRoughnessImage, material.normalImage,
                                material.occlusionImage, material.emissiveImage}) {
            ARS_TRY_STATUS(checkIndex(image, document.images.size(), "image", place));
        }
        const float numbers[] = {material.metallicFactor, material.roughnessFactor, material.normalScale,
                                 material.alphaCutoff};
        if (!allFinite(numbers) || !allFinite({&material.baseColorFactor[0], 4}) ||
            !allFinite({&material.emissiveFactor[0], 3})) {
            return invalid(place, "a factor is not finite");
        }
    }
    return {};
}

Status checkSkins(const GltfDocument& document) {
    for (std::size_t i = 0; i < document.skins.size(); ++i) {
        const GltfSkin& skin = document.skins[i];
        const std::string place = fmt::format("skins[{}]", i);
        if (skin.joints.empty()) return invalid(place, "a skin needs at least one joint");
        for (const int joint : skin.joints) {
            if (joint < 0) return invalid(place, fmt::format("names node {}", joint));
            ARS_TRY_STATUS(checkIndex(joint, document.nodes.size(), "node", place));
        }
        ARS_TRY_STATUS(checkIndex(skin.skeletonRoot, document.nodes.size(), "node", place));
        ARS_TRY_STATUS(checkCount(skin.inverseBindMatrices.size(), skin.joints.size(), "inverse bind matrices", place));
        for (const glm::mat4& matrix : skin.inverseBindMatrices) {
            if (!allFinite({&matrix[0][0], 16})) return invalid(place, "an inverse bind matrix is not finite");
        }
    }
    return {};
}

Status checkAnimations(const GltfDocument& document) {
    for (std::size_t a = 0; a < document.animations.size(); ++a) {
        for (std::size_t c = 0; c < document.animations[a].channels.size(); ++c) {
            const GltfChannel& channel = document.animations[a].channels[c];
            const std::string place = fmt::format("animations[{}].channels[{}]", a, c);
            if (channel.node < 0) return invalid(place, "names no node");
            ARS_TRY_STATUS(checkIndex(channel.node, document.nodes.size(), "node", place));
            const std::size_t perTime = channel.interpolation == GltfInterpolation::CubicSpline ? 3 : 1;
            const int fixedWidth = channel.path == GltfPath::Rotation ? 4 : 3;
            if (channel.path != GltfPath::Weights && channel.width != fixedWidth) {
                return invalid(place, fmt::format("width {}, expected {}", channel.width, fixedWidth));
            }
            if (channel.times.empty() || channel.width < 1) return invalid(place, "a channel needs times and values");
            ARS_TRY_STATUS(checkCount(channel.values.size(),
                                      channel.times.size() * perTime * static_cast<std::size_t>(channel.width),
                                      "numbers", place));
            if (!allFinite(channel.times) || !allFinite(channel.values))
                return invalid(place, "a time or value is not finite");
            if (std::adjacent_find(channel.times.begin(), channel.times.end(), std::greater_equal<>()) !=
                channel.times.end()) {
                return invalid(place, "the times do not increase");
            }
        }
    }
    return {};
}

/// The vertices that one material's triangles use, as a primitive of their own.
GltfPrimitive partWithMaterial(const GltfPrimitive& whole, std::int32_t material) {
    GltfPrimitive part;
    part.mesh.name = whole.mesh.name;
    part.material = material;
    part.influences = whole.influences;
    part.morphTargets.resize(whole.morphTargets.size());
    for (std::size_t t = 0; t < whole.morphTargets.size(); ++t) part.morphTargets[t].name = whole.morphTargets[t].name;

    constexpr std::uint32_t kUnused = std::numeric_limits<std::uint32_t>::max();
    std::vector<std::uint32_t> newIndex(whole.mesh.positions.size(), kUnused);
    std::vector<std::uint32_t> used;
    for (std::size_t i = 0; i < whole.mesh.triangles.size(); ++i) {
        if (whole.mesh.materials[i] != material) continue;
        glm::uvec3 triangle;
        for (int k = 0; k < 3; ++k) {
            const std::uint32_t old = whole.mesh.triangles[i][k];
            if (newIndex[old] == kUnused) {
                newIndex[old] = static_cast<std::uint32_t>(used.size());
                used.push_back(old);
            }
            triangle[k] = newIndex[old];
        }
        part.mesh.triangles.push_back(triangle);
    }
    const auto select = [&](const auto& from, auto& to, std::size_t width) {
        if (from.empty()) return;
        for (const std::uint32_t old : used) {
            for (std::size_t k = 0; k < width; ++k) to.push_back(from[old * width + k]);
        }
    };
    select(whole.mesh.positions, part.mesh.positions, 1);
    select(whole.mesh.normals, part.mesh.normals, 1);
    select(whole.mesh.uvs, part.mesh.uvs, 1);
    select(whole.mesh.colors, part.mesh.colors, 1);
    select(whole.joints, part.joints, static_cast<std::size_t>(whole.influences));
    select(whole.weights, part.weights, static_cast<std::size_t>(whole.influences));
    for (std::size_t t = 0; t < whole.morphTargets.size(); ++t) {
        select(whole.morphTargets[t].positions, part.morphTargets[t].positions, 1);
        select(whole.morphTargets[t].normals, part.morphTargets[t].normals, 1);
    }
    return part;
}

std::string imageType(const GltfImage& image) {
    if (!image.mimeType.empty()) return image.mimeType;
    const auto startsWith = [&](std::initializer_list<int> magic) {
        return image.bytes.size() >= magic.size() &&
               std::equal(magic.begin(), magic.end(), image.bytes.begin(),
                          [](int expected, std::byte found) { return std::to_integer<int>(found) == expected; });
    };
    if (startsWith({0x89, 'P', 'N', 'G'})) return "image/png";
    if (startsWith({0xff, 0xd8, 0xff})) return "image/jpeg";
    return "";
}

/// Our document as tinygltf's model with one buffer.
class GltfWriter {
public:
    explicit GltfWriter(const GltfDocument& document) : document_(document) {}

    Result<std::vector<std::byte>> encode() {
        model_.asset.version = "2.0";
        model_.asset.generator = document_.generator.empty() ? "ARS Studio" : document_.generator;
        ARS_TRY_STATUS(addImages());
        addMaterials();
        addMeshes();
        addNodes();
        addSkins();
        addAnimations();
        return serialize();
    }

private:
    int addView(std::span<const std::byte> bytes, int target) {
        while (buffer_.size() % 4 != 0) buffer_.push_back(0);
        tinygltf::BufferView view;
        view.buffer = 0;
        view.byteOffset = buffer_.size();
        view.byteLength = bytes.size();
        view.target = target;
        const auto* data = reinterpret_cast<const unsigned char*>(bytes.data());
        buffer_.insert(buffer_.end(), data, data + bytes.size());
        model_.bufferViews.push_back(std::move(view));
        return static_cast<int>(model_.bufferViews.size()) - 1;
    }
    template <typename T>
    int addAccessor(std::span<const T> values, int type, int componentType, int target) {
        tinygltf::Accessor accessor;
        accessor.bufferView = addView(std::as_bytes(values), target);
        accessor.componentType = componentType;
        accessor.type = type;
        const auto width = static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type)));
        accessor.count = values.size() / width;
        model_.accessors.push_back(std::move(accessor));
        return static_cast<int>(model_.accessors.size()) - 1;
    }
    int addFloats(std::span<const float> values, int type, int target = 0) {
        return addAccessor(values, type, TINYGLTF_COMPONENT_TYPE_FLOAT, target);
    }
    /// With the bounds that the format demands of positions and key times.
    int addBoundedFloats(std::span<const float> values, int type, int target = 0) {
        const int index = addFloats(values, type, target);
        tinygltf::Accessor& accessor = model_.accessors[static_cast<std::size_t>(index)];
        const auto width = static_cast<std::size_t>(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(type)));
        accessor.minValues.assign(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(width));
        accessor.maxValues = accessor.minValues;
        for (std::size_t i = 0; i < values.size(); ++i) {
            const auto value = static_cast<double>(values[i]);
            accessor.minValues[i % width] = std::min(accessor.minValues[i % width], value);
            accessor.maxValues[i % width] = std::max(accessor.maxValues[i % width], value);
        }
        return index;
    }

    Status addImages() {
        for (std::size_t i = 0; i < document_.images.size(); ++i) {
            const GltfImage& source = document_.images[i];
            const std::string place = fmt::format("images[{}]", i);
            tinygltf::Image image;
            image.name = source.name;
            image.mimeType = imageType(source);
            textureOf_.push_back(-1);
            if (source.bytes.empty()) continue; // a picture that was missing when its file was read
            if (image.mimeType.empty()) return invalid(place, "the picture is neither PNG nor JPEG and names no type");
            image.bufferView = addView(source.bytes, 0);
            textureOf_.back() = static_cast<int>(model_.textures.size());
            tinygltf::Texture texture;
            texture.source = static_cast<int>(model_.images.size());
            model_.images.push_back(std::move(image));
            model_.textures.push_back(std::move(texture));
        }
        return {};
    }
    int texture(int image) const { return image < 0 ? -1 : textureOf_[static_cast<std::size_t>(image)]; }
    void addMaterials() {
        for (const GltfMaterial& source : document_.materials) {
            tinygltf::Material material;
            material.name = source.name;
            material.doubleSided = source.doubleSided;
            material.alphaMode = source.alphaMode == GltfAlphaMode::Mask    ? "MASK"
                                 : source.alphaMode == GltfAlphaMode::Blend ? "BLEND"
                                                                            : "OPAQUE";
            material.alphaCutoff = source.alphaCutoff;
            for (int k = 0; k < 3; ++k) material.emissiveFactor.push_back(source.emissiveFactor[k]);
            auto& pbr = material.pbrMetallicRoughness;
            for (int k = 0; k < 4; ++k) pbr.baseColorFactor[static_cast<std::size_t>(k)] = source.baseColorFactor[k];
            pbr.metallicFactor = source.metallicFactor;
            pbr.roughnessFactor = source.roughnessFactor;
            pbr.baseColorTexture.index = texture(source.baseColorImage);
            pbr.metallicRoughnessTexture.index = texture(source.metallicRoughnessImage);
            material.normalTexture.index = texture(source.normalImage);
            material.normalTexture.scale = source.normalScale;
            material.occlusionTexture.index = texture(source.occlusionImage);
            material.emissiveTexture.index = texture(source.emissiveImage);
            model_.materials.push_back(std::move(material));
        }
    }

    void addIndices(const TriangleMesh& mesh, tinygltf::Primitive& primitive) {
        static_assert(sizeof(glm::uvec3) == 3 * sizeof(std::uint32_t));
        const std::span<const std::uint32_t> indices(reinterpret_cast<const std::uint32_t*>(mesh.triangles.data()),
                                                     3 * mesh.triangles.size());
        // 65535 itself is the strip restart of many devices.
        if (mesh.positions.size() < 65535) {
            const std::vector<std::uint16_t> narrow(indices.begin(), indices.end());
            primitive.indices =
                addAccessor<std::uint16_t>(narrow, TINYGLTF_TYPE_SCALAR, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT,
                                           TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER);
        } else {
            primitive.indices = addAccessor(indices, TINYGLTF_TYPE_SCALAR, TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT,
                                            TINYGLTF_TARGET_ELEMENT_ARRAY_BUFFER);
        }
    }
    void addInfluences(const GltfPrimitive& source, tinygltf::Primitive& primitive) {
        const auto width = static_cast<std::size_t>(source.influences);
        const std::size_t vertices = source.mesh.positions.size();
        for (std::size_t set = 0; 4 * set < width; ++set) {
            std::vector<std::uint16_t> joints(4 * vertices);
            std::vector<float> weights(4 * vertices);
            for (std::size_t i = 0; i < 4 * vertices; ++i) {
                const std::size_t slot = i / 4 * width + 4 * set + i % 4;
                weights[i] = source.weights[slot];
                // The format wants joint 0 where nothing is weighted.
                joints[i] = weights[i] > 0.0f ? source.joints[slot] : std::uint16_t{0};
            }
            primitive.attributes[fmt::format("JOINTS_{}", set)] = addAccessor<std::uint16_t>(
                joints, TINYGLTF_TYPE_VEC4, TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT, TINYGLTF_TARGET_ARRAY_BUFFER);
            primitive.attributes[fmt::format("WEIGHTS_{}", set)] =
                addFloats(weights, TINYGLTF_TYPE_VEC4, TINYGLTF_TARGET_ARRAY_BUFFER);
        }
    }
    void addPrimitive(const GltfPrimitive& source, tinygltf::Mesh& mesh) {
        tinygltf::Primitive primitive;
        primitive.mode = TINYGLTF_MODE_TRIANGLES;
        primitive.material = source.material;
        const TriangleMesh& m = source.mesh;
        constexpr int kTarget = TINYGLTF_TARGET_ARRAY_BUFFER;
        primitive.attributes["POSITION"] = addBoundedFloats(asFloats(m.positions), TINYGLTF_TYPE_VEC3, kTarget);
        if (!m.normals.empty())
            primitive.attributes["NORMAL"] = addFloats(asFloats(m.normals), TINYGLTF_TYPE_VEC3, kTarget);
        if (!m.uvs.empty())
            primitive.attributes["TEXCOORD_0"] = addFloats(asFloats(m.uvs), TINYGLTF_TYPE_VEC2, kTarget);
        if (!m.colors.empty())
            primitive.attributes["COLOR_0"] = addFloats(asFloats(m.colors), TINYGLTF_TYPE_VEC4, kTarget);
        addInfluences(source, primitive);
        addIndices(m, primitive);
        for (const GltfMorphTarget& target : source.morphTargets) {
            std::map<std::string, int> attributes;
            // A target must say something: positions that do not move stand for one that is empty.
            std::vector<glm::vec3> still;
            if (target.positions.empty() && target.normals.empty()) still.resize(m.positions.size(), glm::vec3(0.0f));
            const auto& positions = still.empty() ? target.positions : still;
            if (!positions.empty())
                attributes["POSITION"] = addBoundedFloats(asFloats(positions), TINYGLTF_TYPE_VEC3, kTarget);
            if (!target.normals.empty())
                attributes["NORMAL"] = addFloats(asFloats(target.normals), TINYGLTF_TYPE_VEC3, kTarget);
            primitive.targets.push_back(std::move(attributes));
        }
        mesh.primitives.push_back(std::move(primitive));
    }
    void addMeshes() {
        for (const GltfMesh& source : document_.meshes) {
            tinygltf::Mesh mesh;
            mesh.name = source.name;
            mesh.weights.assign(source.morphWeights.begin(), source.morphWeights.end());
            for (const GltfPrimitive& primitive : source.primitives) {
                std::vector<std::int32_t> materials = primitive.mesh.materials;
                std::sort(materials.begin(), materials.end());
                materials.erase(std::unique(materials.begin(), materials.end()), materials.end());
                if (materials.empty()) addPrimitive(primitive, mesh);
                for (const std::int32_t material : materials) addPrimitive(partWithMaterial(primitive, material), mesh);
            }
            tinygltf::Value::Array names;
            for (const GltfMorphTarget& target : source.primitives.front().morphTargets)
                names.emplace_back(target.name);
            if (!names.empty()) {
                mesh.extras =
                    tinygltf::Value(tinygltf::Value::Object{{"targetNames", tinygltf::Value(std::move(names))}});
            }
            model_.meshes.push_back(std::move(mesh));
        }
    }

    static tinygltf::Node nodeFrom(const GltfNode& source) {
        tinygltf::Node node;
        node.name = source.name;
        node.mesh = source.mesh;
        node.skin = source.skin;
        if (source.hasMatrix) {
            for (int c = 0; c < 4; ++c) {
                for (int r = 0; r < 4; ++r) node.matrix.push_back(source.localMatrix[c][r]);
            }
            return node;
        }
        const glm::quat& q = source.rotation;
        if (source.translation != glm::vec3(0.0f))
            node.translation = {source.translation.x, source.translation.y, source.translation.z};
        if (q != glm::quat(1.0f, 0.0f, 0.0f, 0.0f)) node.rotation = {q.x, q.y, q.z, q.w};
        if (source.scale != glm::vec3(1.0f)) node.scale = {source.scale.x, source.scale.y, source.scale.z};
        return node;
    }
    void addNodes() {
        tinygltf::Scene scene;
        scene.nodes = document_.sceneRoots;
        for (const GltfNode& source : document_.nodes) model_.nodes.push_back(nodeFrom(source));
        for (std::size_t i = 0; i < document_.nodes.size(); ++i) {
            const int parent = document_.nodes[i].parent;
            if (parent >= 0) {
                model_.nodes[static_cast<std::size_t>(parent)].children.push_back(static_cast<int>(i));
            } else if (document_.sceneRoots.empty()) {
                scene.nodes.push_back(static_cast<int>(i));
            }
        }
        // tinygltf writes an object without members as null.
        for (tinygltf::Node& node : model_.nodes) {
            if (node == tinygltf::Node()) node.translation = {0, 0, 0};
        }
        if (scene.nodes.empty()) return;
        model_.scenes.push_back(std::move(scene));
        model_.defaultScene = 0;
    }
    void addSkins() {
        for (const GltfSkin& source : document_.skins) {
            tinygltf::Skin skin;
            skin.name = source.name;
            skin.skeleton = source.skeletonRoot;
            skin.joints = source.joints;
            const std::span<const float> numbers(&source.inverseBindMatrices[0][0][0], 16 * source.joints.size());
            skin.inverseBindMatrices = addFloats(numbers, TINYGLTF_TYPE_MAT4);
            model_.skins.push_back(std::move(skin));
        }
    }
    void addAnimations() {
        constexpr const char* kPaths[] = {"translation", "rotation", "scale", "weights"};
        constexpr const char* kInterpolations[] = {"STEP", "LINEAR", "CUBICSPLINE"};
        for (const GltfAnimation& source : document_.animations) {
            if (source.channels.empty()) continue; // the format has no animation without channels
            tinygltf::Animation animation;
            animation.name = source.name;
            // Channels that were sampled together share their times in the file.
            std::map<std::vector<float>, int> inputs;
            for (const GltfChannel& channel : source.channels) {
                const auto [input, isNew] = inputs.try_emplace(channel.times, -1);
                if (isNew) input->second = addBoundedFloats(channel.times, TINYGLTF_TYPE_SCALAR);
                tinygltf::AnimationSampler sampler;
                sampler.input = input->second;
                sampler.interpolation = kInterpolations[static_cast<std::size_t>(channel.interpolation)];
                const int type = channel.path == GltfPath::Weights    ? TINYGLTF_TYPE_SCALAR
                                 : channel.path == GltfPath::Rotation ? TINYGLTF_TYPE_VEC4
                                                                      : TINYGLTF_TYPE_VEC3;
                sampler.output = addFloats(channel.values, type);
                tinygltf::AnimationChannel target;
                target.sampler = static_cast<int>(animation.samplers.size());
                target.target_node = channel.node;
                target.target_path = kPaths[static_cast<std::size_t>(channel.path)];
                animation.samplers.push_back(std::move(sampler));
                animation.channels.push_back(std::move(target));
            }
            model_.animations.push_back(std::move(animation));
        }
    }

    Result<std::vector<std::byte>> serialize() {
        if (buffer_.size() > std::numeric_limits<std::uint32_t>::max() / 2) {
            return makeError(ErrorCode::LimitExceeded, "",
                             fmt::format("{} bytes of data, a .glb holds 2 GiB", buffer_.size()));
        }
        while (buffer_.size() % 4 != 0) buffer_.push_back(0);
        if (!buffer_.empty()) {
            model_.buffers.emplace_back();
            model_.buffers.back().data = std::move(buffer_);
        }
        try {
            std::ostringstream stream;
            tinygltf::TinyGLTF writer;
            if (!writer.WriteGltfSceneToStream(&model_, stream, false, true)) {
                return makeError(ErrorCode::Internal, "", "tinygltf could not write the document");
            }
            const std::string text = std::move(stream).str();
            const auto* data = reinterpret_cast<const std::byte*>(text.data());
            return std::vector<std::byte>(data, data + text.size());
        } catch (const std::bad_alloc&) {
            return makeError(ErrorCode::OutOfMemory, "", "no memory for the document");
        } catch (const std::exception& error) {
            // nlohmann-json refuses names that are not UTF-8.
            return invalid("", error.what());
        }
    }

    const GltfDocument& document_;
    tinygltf::Model model_;
    std::vector<int> textureOf_; ///< texture of each image, -1 for one without bytes
    std::vector<unsigned char> buffer_;
};

} // namespace

Result<std::vector<std::byte>> encodeGlb(const GltfDocument& document) {
    ARS_TRY_STATUS(checkNodes(document));
    ARS_TRY_STATUS(checkMaterials(document));
    ARS_TRY_STATUS(checkSkins(document));
    ARS_TRY_STATUS(checkMeshes(document));
    ARS_TRY_STATUS(checkAnimations(document));
    return GltfWriter(document).encode();
}

Status writeGlb(const std::filesystem::path& path, const GltfDocument& document) {
    Result<std::vector<std::byte>> bytes = encodeGlb(document);
    if (!bytes) return atPlace(std::move(bytes).error(), path.string());
    return writeFileAtomic(path, *bytes);
}

} // namespace ars
