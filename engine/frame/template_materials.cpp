#include "engine/frame/template_materials.h"

#include "engine/core/parallel.h"
#include "engine/io/image_file.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace ars {
namespace {

constexpr float kGray = 0.5f;           ///< albedo of what has no colour at all
constexpr float kPlainRoughness = 0.6f; ///< of triangles without a material
constexpr int kMaxLevel = 5;            ///< coarser copies would mix parts of the texture that lie apart

/// Half as wide and high, odd sides rounded up.
Image halved(const Image& image) {
    Image half;
    half.width = (image.width + 1) / 2;
    half.height = (image.height + 1) / 2;
    half.channels = image.channels;
    half.space = image.space;
    half.pixels.resize(static_cast<std::size_t>(half.width) * static_cast<std::size_t>(half.height) *
                       static_cast<std::size_t>(half.channels));
    parallelFor(
        static_cast<std::size_t>(half.height),
        [&](std::size_t rowIndex) {
            const int row = static_cast<int>(rowIndex);
            const int below = std::min(2 * row + 1, image.height - 1);
            for (int column = 0; column < half.width; ++column) {
                const int right = std::min(2 * column + 1, image.width - 1);
                for (int c = 0; c < image.channels; ++c) {
                    half.at(row, column, c) =
                        0.25f * (image.at(2 * row, 2 * column, c) + image.at(below, 2 * column, c) +
                                 image.at(2 * row, right, c) + image.at(below, right, c));
                }
            }
        },
        16);
    return half;
}

/// glTF: colours are sRGB-encoded whatever the picture itself declares; alpha never is.
void decodeColors(Image& image) {
    const int colors = image.channels - (image.hasAlpha() ? 1 : 0);
    const auto width = static_cast<std::size_t>(image.channels);
    parallelFor(
        image.pixels.size() / width,
        [&](std::size_t i) {
            for (int c = 0; c < colors; ++c) {
                float& value = image.pixels[i * width + static_cast<std::size_t>(c)];
                value = srgbToLinear(value);
            }
        },
        4096);
    image.space = ColorSpace::Linear;
}

int wrapped(int index, int size) {
    const int rest = index % size;
    return rest < 0 ? rest + size : rest;
}

glm::vec4 texel(const Image& image, int row, int column) {
    const float* p = &image.pixels[(static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width) +
                                    static_cast<std::size_t>(column)) *
                                   static_cast<std::size_t>(image.channels)];
    switch (image.channels) {
    case 1:
        return {p[0], p[0], p[0], 1.0f};
    case 2:
        return {p[0], p[0], p[0], p[1]};
    case 3:
        return {p[0], p[1], p[2], 1.0f};
    default:
        return {p[0], p[1], p[2], p[3]};
    }
}

} // namespace

Texture::Texture(Image image) {
    levels_.push_back(std::move(image));
    while (static_cast<int>(levels_.size()) <= kMaxLevel && std::max(levels_.back().width, levels_.back().height) > 1) {
        levels_.push_back(halved(levels_.back()));
    }
}

glm::vec4 Texture::sample(const glm::vec2& uv, int level) const {
    const Image& image = levels_[static_cast<std::size_t>(std::clamp(level, 0, static_cast<int>(levels_.size()) - 1))];
    // The fractional part first: repeated coordinates far from 0 would not fit an int.
    const float x = (uv.x - std::floor(uv.x)) * static_cast<float>(image.width) - 0.5f;
    const float y = (uv.y - std::floor(uv.y)) * static_cast<float>(image.height) - 0.5f;
    if (!std::isfinite(x) || !std::isfinite(y)) return texel(image, 0, 0);
    const float left = std::floor(x), top = std::floor(y);
    const float fx = x - left, fy = y - top;
    const int c0 = wrapped(static_cast<int>(left), image.width), c1 = wrapped(c0 + 1, image.width);
    const int r0 = wrapped(static_cast<int>(top), image.height), r1 = wrapped(r0 + 1, image.height);
    return (1.0f - fy) * ((1.0f - fx) * texel(image, r0, c0) + fx * texel(image, r0, c1)) +
           fy * ((1.0f - fx) * texel(image, r1, c0) + fx * texel(image, r1, c1));
}

Result<TemplateMaterials> TemplateMaterials::decode(const TemplateMesh& templateMesh, const ReadLimits& limits) {
    TemplateMaterials result;
    result.mesh_ = &templateMesh.mesh;
    std::map<std::pair<int, bool>, int> decoded; // (image, is colour) -> texture
    auto textureOf = [&](const GltfMaterial& material, int image, bool color) -> Result<int> {
        if (image < 0 || templateMesh.mesh.uvs.empty()) return -1;
        if (static_cast<std::size_t>(image) >= templateMesh.images.size()) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("material \"{}\"", material.name),
                             fmt::format("points to picture {}, there are {}", image, templateMesh.images.size()));
        }
        if (const auto known = decoded.find({image, color}); known != decoded.end()) return known->second;
        const GltfImage& encoded = templateMesh.images[static_cast<std::size_t>(image)];
        if (encoded.bytes.empty()) {
            result.notes_.push_back(fmt::format("the picture {} of material \"{}\" is missing",
                                                encoded.uri.empty() ? encoded.name : encoded.uri, material.name));
            return decoded[{image, color}] = -1;
        }
        Result<Image> picture = parseImageFile(encoded.bytes, limits);
        if (!picture) {
            return atPlace(std::move(picture).error(),
                           fmt::format("material \"{}\": picture {} \"{}\"", material.name, image, encoded.name));
        }
        if (color) decodeColors(*picture);
        result.textures_.emplace_back(std::move(picture).value());
        return decoded[{image, color}] = static_cast<int>(result.textures_.size()) - 1;
    };
    for (const GltfMaterial& material : templateMesh.materials) {
        Decoded one;
        one.baseColor = material.baseColorFactor;
        one.roughness = material.roughnessFactor;
        one.alphaMode = material.alphaMode;
        one.alphaCutoff = material.alphaCutoff;
        ARS_TRY(one.baseTexture, textureOf(material, material.baseColorImage, true));
        ARS_TRY(one.roughnessTexture, textureOf(material, material.metallicRoughnessImage, false));
        const bool white = glm::vec3(one.baseColor) == glm::vec3(1.0f);
        if (one.baseTexture < 0 && white && templateMesh.mesh.colors.empty()) {
            one.baseColor = glm::vec4(glm::vec3(kGray), one.baseColor.w);
            result.notes_.push_back(fmt::format("material \"{}\" has no colour and becomes grey", material.name));
        }
        result.materials_.push_back(one);
    }
    if (result.materials_.empty() && templateMesh.mesh.colors.empty()) {
        result.notes_.emplace_back("the template has no colours and becomes grey");
    }
    return result;
}

int TemplateMaterials::levelFor(const Texture& texture, std::uint32_t triangle, float footprintM) const {
    if (!(footprintM > 0.0f)) return 0;
    const glm::uvec3& t = mesh_->triangles[triangle];
    const glm::vec3 a = mesh_->positions[t.y] - mesh_->positions[t.x],
                    b = mesh_->positions[t.z] - mesh_->positions[t.x];
    const glm::vec2 size(texture.width(), texture.height());
    const glm::vec2 u = size * (mesh_->uvs[t.y] - mesh_->uvs[t.x]), v = size * (mesh_->uvs[t.z] - mesh_->uvs[t.x]);
    const float area = glm::length(glm::cross(a, b));
    const float texels = std::abs(u.x * v.y - u.y * v.x);
    if (!(area > 0.0f) || !(texels > 0.0f)) return 0;
    const float footprint = footprintM * std::sqrt(texels / area); // texels
    return footprint > 2.0f ? std::min(static_cast<int>(std::log2(footprint)), kMaxLevel) : 0;
}

MaterialSample TemplateMaterials::sample(std::uint32_t triangle, const glm::vec3& barycentric, float footprintM) const {
    const TriangleMesh& mesh = *mesh_;
    const glm::uvec3& t = mesh.triangles[triangle];
    MaterialSample sample;
    glm::vec4 base(kGray, kGray, kGray, 1.0f);
    sample.roughness = kPlainRoughness;
    const std::int32_t index = mesh.materials.empty() ? (materials_.size() == 1 ? 0 : -1) : mesh.materials[triangle];
    const Decoded* material = index >= 0 ? &materials_[static_cast<std::size_t>(index)] : nullptr;
    glm::vec2 uv(0.0f);
    if (!mesh.uvs.empty()) {
        uv = barycentric.x * mesh.uvs[t.x] + barycentric.y * mesh.uvs[t.y] + barycentric.z * mesh.uvs[t.z];
    }
    if (material) {
        base = material->baseColor;
        sample.roughness = material->roughness;
        if (material->baseTexture >= 0) {
            const Texture& texture = textures_[static_cast<std::size_t>(material->baseTexture)];
            base *= texture.sample(uv, levelFor(texture, triangle, footprintM));
        }
        if (material->roughnessTexture >= 0) {
            const Texture& texture = textures_[static_cast<std::size_t>(material->roughnessTexture)];
            sample.roughness *= texture.sample(uv, levelFor(texture, triangle, footprintM)).y;
        }
    }
    if (!mesh.colors.empty()) {
        const glm::vec4 color =
            barycentric.x * mesh.colors[t.x] + barycentric.y * mesh.colors[t.y] + barycentric.z * mesh.colors[t.z];
        base = material ? base * color : color;
    }
    sample.albedo = glm::clamp(glm::vec3(base), 0.0f, 1.0f);
    sample.roughness = std::clamp(sample.roughness, 0.0f, 1.0f);
    if (material && material->alphaMode == GltfAlphaMode::Mask)
        sample.alpha = base.w >= material->alphaCutoff ? 1.0f : 0.0f;
    if (material && material->alphaMode == GltfAlphaMode::Blend) sample.alpha = std::clamp(base.w, 0.0f, 1.0f);
    return sample;
}

} // namespace ars
