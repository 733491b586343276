#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/image.h"
#include "engine/rig/template_mesh.h"

#include <glm/glm.hpp>

#include <string>
#include <vector>

namespace ars {

/// What a template's material says of one point.
struct MaterialSample {
    glm::vec3 albedo{0.5f}; ///< linear
    float roughness = 0.6f; ///< perceptual
    float alpha = 1.0f;     ///< 0 or 1 for masked materials
};

/// A texture with its smaller copies, linear, ready to be sampled.
class Texture {
public:
    Texture() = default;
    /// Box-filtered copies down to one texel. `image` must be linear or data.
    explicit Texture(Image image);

    bool empty() const { return levels_.empty(); }
    int channels() const { return levels_.empty() ? 0 : levels_.front().channels; }
    int width() const { return levels_.empty() ? 0 : levels_.front().width; }
    int height() const { return levels_.empty() ? 0 : levels_.front().height; }
    /// Bilinear value at (u, v), (0,0) the top left corner, repeating; level 0 is the picture itself, the next half as
    /// wide. Channels that the picture has not are 1.
    glm::vec4 sample(const glm::vec2& uv, int level = 0) const;

private:
    std::vector<Image> levels_;
};

/// Decoded materials of a template (glTF metallic-roughness; metal is not looked at).
class TemplateMaterials {
public:
    /// BadFile for a picture that cannot be decoded, naming it and its material. Pictures without bytes and materials
    /// without any colour get a note.
    static Result<TemplateMaterials> decode(const TemplateMesh& templateMesh,
                                            const ReadLimits& limits = defaultReadLimits());

    /// @param footprintM textures are averaged over about this length on the surface, metres; 0: not at all
    MaterialSample sample(std::uint32_t triangle, const glm::vec3& barycentric, float footprintM) const;
    const std::vector<std::string>& notes() const { return notes_; }

private:
    struct Decoded {
        glm::vec4 baseColor{1.0f};
        float roughness = 1.0f;
        int baseTexture = -1;
        int roughnessTexture = -1;
        GltfAlphaMode alphaMode = GltfAlphaMode::Opaque;
        float alphaCutoff = 0.5f;
    };
    int levelFor(const Texture& texture, std::uint32_t triangle, float footprintM) const;

    const TriangleMesh* mesh_ = nullptr; ///< the template's, which must outlive this
    std::vector<Decoded> materials_;
    std::vector<Texture> textures_;
    std::vector<std::string> notes_;
};

} // namespace ars
