#include "engine/scene/part_picture.h"

#include "engine/core/parallel.h"
#include "engine/scene/frame_worker.h"

namespace ars {

// Okabe and Ito's palette, which stays apart for eyes that miss a kind of cone, calmed towards grey, with a slate and a
// violet to make nine; neighbours on the body are far apart in hue or lightness.
const std::array<glm::vec3, kBodyPartCount>& bodyPartColors() {
    static const std::array<glm::vec3, kBodyPartCount> colors{{
        {0.36f, 0.47f, 0.58f}, // torso: slate
        {0.80f, 0.58f, 0.28f}, // hip: ochre
        {0.30f, 0.60f, 0.49f}, // knee: sea green
        {0.74f, 0.42f, 0.30f}, // foot: terracotta
        {0.85f, 0.79f, 0.49f}, // head: straw
        {0.49f, 0.70f, 0.83f}, // shoulder: sky
        {0.72f, 0.49f, 0.62f}, // elbow: mauve
        {0.58f, 0.68f, 0.36f}, // wrist: moss
        {0.52f, 0.44f, 0.71f}, // hand: violet
    }};
    return colors;
}

std::vector<glm::vec3> surfelPartColors(const AvatarRig& rig) {
    const std::array<glm::vec3, kBodyPartCount>& colors = bodyPartColors();
    std::vector<glm::vec3> result(rig.weights.pointCount(), glm::vec3(0.0f));
    parallelFor(result.size(), [&](std::size_t i) {
        for (std::size_t k = i * kMaxInfluences; k < (i + 1) * kMaxInfluences; ++k) {
            const std::size_t joint = rig.weights.joints[k];
            if (joint < rig.parts.size())
                result[i] += rig.weights.weights[k] * colors[static_cast<std::size_t>(rig.parts[joint])];
        }
    });
    return result;
}

Status PartPicture::render(const AvatarRig& rig, const SurfelView& surfels, const SplatParams& params,
                           const Camera& camera, Image& picture) {
    if (rig_ != &rig || colors_.size() != rig.weights.pointCount()) {
        colors_ = surfelPartColors(rig);
        rig_ = &rig;
        deviceColors_ = Buffer();
    }
    if (colors_.size() != surfels.count) {
        return makeError(ErrorCode::InvalidArgument, "parts",
                         fmt::format("{} surfels, the rig has weights for {}", surfels.count, colors_.size()));
    }
    SurfelView painted = surfels;
    painted.colors = colors_.data();
    if (surfels.device.kind == DeviceKind::Cuda && !colors_.empty()) {
        const auto bytes = std::as_bytes(std::span(colors_));
        if (!deviceColors_.data() || deviceColors_.device() != surfels.device) {
            ARS_TRY(deviceColors_, Buffer::allocate(surfels.device, bytes.size(), "part picture"));
            ARS_TRY_STATUS(uploadBuffer(deviceColors_, bytes));
        }
        painted.colors = static_cast<const glm::vec3*>(deviceColors_.data());
    }
    ARS_TRY_STATUS(splat(params, painted, camera, {Channel::Opacity, Channel::Radiance}, gbuffer_, workspace_));
    const PixelBuffer& radiance = gbuffer_[Channel::Radiance];
    picture.width = camera.width;
    picture.height = camera.height;
    picture.channels = 3;
    picture.space = ColorSpace::Srgb;
    picture.pixels.resize(radiance.view().valueCount());
    if (surfels.device.kind == DeviceKind::Cuda)
        return downloadBuffer(std::as_writable_bytes(std::span(picture.pixels)), radiance.memory());
    std::copy_n(radiance.view().data, picture.pixels.size(), picture.pixels.begin());
    return {};
}

} // namespace ars
