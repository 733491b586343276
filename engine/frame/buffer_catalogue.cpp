#include "engine/frame/buffer_catalogue.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace ars {

namespace {

constexpr std::array<BufferInfo, kBufferCount> kRows{{
    {BufferId::Beauty, "beauty", "Shaded", "C_pbr", "RGBA", BufferKind::LinearColor, "", 0.0f, 1.0f, ColorMap::Gray,
     std::nullopt, "The relit picture: diffuse and specular light times ambient occlusion, premultiplied by opacity"},
    {BufferId::Radiance, "radiance", "Radiance", "C", "RGB", BufferKind::SrgbColor, "", 0.0f, 1.0f, ColorMap::Gray,
     Channel::Radiance, "The colour that the avatar learned under its capture light; of a rest avatar the albedo"},
    {BufferId::Albedo, "albedo", "Albedo", "A", "RGB", BufferKind::LinearAlbedo, "", 0.0f, 1.0f, ColorMap::Gray,
     Channel::Albedo, "Base colour, linear"},
    {BufferId::Roughness, "roughness", "Roughness", "H", "Y", BufferKind::Scalar, "", 0.0f, 1.0f, ColorMap::Gray,
     Channel::Roughness, "Perceptual roughness; GGX's alpha is its square"},
    {BufferId::Normal, "normal", "Normal", "N", "XYZ", BufferKind::Direction, "", -1.0f, 1.0f, ColorMap::Gray,
     Channel::Normal, "Unit normal in camera space, facing the camera"},
    {BufferId::Depth, "depth", "Depth", "D", "Z", BufferKind::Scalar, "m", 1.0f, 5.0f, ColorMap::Turbo, Channel::Depth,
     "Distance along the camera's axis"},
    {BufferId::Position, "position", "Position", "P", "XYZ", BufferKind::Place, "m", -1.0f, 2.0f, ColorMap::Gray,
     Channel::Position, "Point in the world that the pixel sees"},
    {BufferId::AmbientOcclusion, "ao", "Ambient occlusion", "O", "Y", BufferKind::Scalar, "", 0.0f, 1.0f,
     ColorMap::Gray, std::nullopt, "Share of the hemisphere that is open within the radius; 1 is open"},
    {BufferId::Radius, "radius", "Occlusion radius", "R", "Y", BufferKind::Scalar, "m", 0.0f, 0.3f, ColorMap::Viridis,
     Channel::Radius, "How far occluders are looked for, blended from the nine body parts"},
    {BufferId::RadiusPlus, "radius_plus", "Radius +", "R+", "Y", BufferKind::Scalar, "m", 0.0f, 0.3f, ColorMap::Viridis,
     Channel::RadiusPlus, "Radius enlarged by epsilon, for its gradient"},
    {BufferId::RadiusMinus, "radius_minus", "Radius -", "R-", "Y", BufferKind::Scalar, "m", 0.0f, 0.3f,
     ColorMap::Viridis, Channel::RadiusMinus, "Radius reduced by epsilon, for its gradient"},
    {BufferId::Importance, "importance", "Sample importance", "I", "Y", BufferKind::Scalar, "", 0.0f, 1.0f,
     ColorMap::Magma, Channel::Importance, "Where occlusion takes more directions: near thin limbs"},
    {BufferId::Bone, "bone", "Bone direction", "Q", "XYZ", BufferKind::Direction, "", -1.0f, 1.0f, ColorMap::Gray,
     Channel::Bone, "Direction of the bone in camera space, which the sampling pattern follows"},
    {BufferId::Opacity, "opacity", "Opacity", "", "Y", BufferKind::Scalar, "", 0.0f, 1.0f, ColorMap::Gray,
     Channel::Opacity, "How much of the pixel is covered"},
    {BufferId::Diffuse, "diffuse", "Diffuse light", "C_diff", "RGB", BufferKind::LinearColor, "", 0.0f, 1.0f,
     ColorMap::Gray, std::nullopt, "Light scattered by the surface, after occlusion"},
    {BufferId::Specular, "specular", "Specular light", "C_spec", "RGB", BufferKind::LinearColor, "", 0.0f, 1.0f,
     ColorMap::Gray, std::nullopt, "Light mirrored by the surface, after occlusion"},
}};

std::string allNames() {
    std::string names;
    for (const BufferInfo& row : kRows) names += fmt::format("{}{}", names.empty() ? "" : ", ", row.name);
    return names;
}

} // namespace

std::span<const BufferInfo> bufferCatalogue() { return kRows; }

const BufferInfo& bufferInfo(BufferId id) { return kRows[static_cast<std::size_t>(id)]; }

Result<std::vector<BufferId>> parseBuffers(std::string_view text) {
    std::vector<BufferId> result;
    auto add = [&](BufferId id) {
        if (std::find(result.begin(), result.end(), id) == result.end()) result.push_back(id);
    };
    std::size_t begin = 0;
    while (begin <= text.size()) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        const std::string_view word = text.substr(begin, end - begin);
        begin = end + 1;
        if (word == "all") {
            for (const BufferInfo& row : kRows) {
                if (row.id != BufferId::RadiusPlus && row.id != BufferId::RadiusMinus) add(row.id);
            }
            continue;
        }
        const auto found =
            std::find_if(kRows.begin(), kRows.end(), [&](const BufferInfo& row) { return row.name == word; });
        if (found == kRows.end()) {
            return makeError(ErrorCode::InvalidArgument, "",
                             fmt::format("no buffer \"{}\"; there are all, {}", word, allNames()));
        }
        add(found->id);
    }
    return result;
}

} // namespace ars
