#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/mesh.h"

#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// A node of the scene tree. Lengths in metres, y up, as glTF demands.
struct GltfNode {
    std::string name;
    int parent = -1; ///< -1: a root
    std::vector<int> children;
    glm::vec3 translation{0.0f};
    glm::quat rotation{1.0f, 0.0f, 0.0f, 0.0f}; ///< w, x, y, z in constructor order; unit length
    glm::vec3 scale{1.0f};
    /// The node's transform relative to its parent. Where the file gives a matrix this is that matrix, and translation,
    /// rotation and scale are its decomposition (exact unless it shears); else it is T R S.
    glm::mat4 localMatrix{1.0f};
    bool hasMatrix = false; ///< the file gave a matrix
    int mesh = -1;
    int skin = -1;
};

/// T R S of a node's translation, rotation and scale.
glm::mat4 gltfLocalMatrix(const GltfNode& node);

/// Offsets of one blend shape; each list is empty or has one entry per vertex.
struct GltfMorphTarget {
    std::string name;
    std::vector<glm::vec3> positions;
    std::vector<glm::vec3> normals;
};

/// A part of a mesh with one material.
struct GltfPrimitive {
    TriangleMesh mesh; ///< in the space of the node that carries it; in bind space when skinned
    int material = -1;
    int influences = 0;                ///< joints per vertex: 0 (not skinned), 4 or 8
    std::vector<std::uint16_t> joints; ///< (vertices, influences): index into the skin's joint list
    std::vector<float> weights;        ///< (vertices, influences): finite, not negative, not normalised
    std::vector<GltfMorphTarget> morphTargets;
};

struct GltfMesh {
    std::string name;
    std::vector<GltfPrimitive> primitives;
    std::vector<float> morphWeights; ///< defaults of the blend shapes; may be empty
};

enum class GltfAlphaMode { Opaque, Mask, Blend };

/// Metallic-roughness material. Factors are linear; base colour and emissive images are sRGB-encoded.
struct GltfMaterial {
    std::string name;
    glm::vec4 baseColorFactor{1.0f};
    float metallicFactor = 1.0f;
    float roughnessFactor = 1.0f;
    glm::vec3 emissiveFactor{0.0f};
    int baseColorImage = -1;         ///< index into GltfDocument::images
    int metallicRoughnessImage = -1; ///< roughness in green, metallic in blue
    int normalImage = -1;
    float normalScale = 1.0f;
    int occlusionImage = -1;
    int emissiveImage = -1;
    GltfAlphaMode alphaMode = GltfAlphaMode::Opaque;
    float alphaCutoff = 0.5f;
    bool doubleSided = false;
};

/// An encoded picture; the image readers decode it.
struct GltfImage {
    std::string name;
    std::string mimeType; ///< "image/png", "image/jpeg"; empty when the file does not say
    std::string uri;      ///< as in the file, when the image was a file beside it
    std::vector<std::byte> bytes;
};

struct GltfSkin {
    std::string name;
    std::vector<int> joints;                    ///< node indices, no index twice
    std::vector<glm::mat4> inverseBindMatrices; ///< one per joint; identity where the file has none
    int skeletonRoot = -1;                      ///< node, or -1 when the file does not say
};

enum class GltfPath { Translation, Rotation, Scale, Weights };
enum class GltfInterpolation { Step, Linear, CubicSpline };

/// Keys of one property of one node.
struct GltfChannel {
    int node = -1;
    GltfPath path = GltfPath::Translation;
    GltfInterpolation interpolation = GltfInterpolation::Linear;
    int width = 3;            ///< numbers per value: 3, 4 (rotation: x, y, z, w as in the file), or the morph targets
    std::vector<float> times; ///< seconds, strictly increasing
    /// (times, width); CubicSpline: (times, 3, width) with in-tangent, value, out-tangent.
    std::vector<float> values;
};

struct GltfAnimation {
    std::string name;
    std::vector<GltfChannel> channels;

    float endS() const; ///< largest time of any channel, 0 when there is none
};

/// A glTF 2.0 file as plain structs.
struct GltfDocument {
    std::vector<GltfNode> nodes;
    std::vector<GltfMesh> meshes;
    std::vector<GltfMaterial> materials;
    std::vector<GltfImage> images;
    std::vector<GltfSkin> skins;
    std::vector<GltfAnimation> animations;
    std::vector<int> sceneRoots; ///< of the default scene; all roots when the file has no scene
    std::string generator;
    std::vector<std::string> notes; ///< what the file has and this reader left out, one sentence each

    /// First node of this name, or -1.
    int findNode(std::string_view name) const;
    /// Node-to-world matrices of the rest pose, one per node.
    std::vector<glm::mat4> globalMatrices() const;
};

/// Reads .gltf or .glb (told by content).
///
/// Files that a .gltf refers to must lie in its own folder or below; a picture that is missing there leaves an image
/// without bytes and a note, anything else that is missing is NotFound. Everything is checked: accessor ranges against
/// buffer lengths, indices against vertex counts, the node tree for cycles, joints and weights, key times. Triangle
/// strips and fans become triangles; points and lines are left out with a note. Indices may be missing, attributes
/// interleaved, normalised or sparse. Draco and meshopt compression and unknown required extensions are Unsupported.
/// BadFile names the place ("meshes[0].primitives[1].attributes.POSITION: ...").
Result<GltfDocument> readGltf(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

/// The same from memory. With an empty `folder` no other file is opened.
Result<GltfDocument> parseGltf(std::span<const std::byte> bytes, const std::filesystem::path& folder = {},
                               const ReadLimits& limits = defaultReadLimits());

/// Writes a .glb: nodes, meshes, materials, images (embedded; one without bytes is left out), skins, animations. The
/// tree is taken from the nodes' `parent`; without `sceneRoots` all roots form the scene. A primitive whose mesh has
/// materials per triangle (indices into `materials`) becomes one primitive for each. InvalidArgument names what does
/// not fit together.
Status writeGlb(const std::filesystem::path& path, const GltfDocument& document);
Result<std::vector<std::byte>> encodeGlb(const GltfDocument& document);

} // namespace ars
