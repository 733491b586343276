#include "ui/pose/pose_pictures.h"

#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"
#include "engine/frame/framing.h"
#include "engine/frame/light_source.h"
#include "engine/frame/rest_avatar.h"

#include <array>

namespace ars::ui {
namespace {

constexpr int kSurfels = 6000;
constexpr float kAroundJointsM = 0.14f; ///< flesh around the outermost joints

std::uint64_t fnv1a(std::uint64_t hash, const void* bytes, std::size_t count) {
    const auto* data = static_cast<const unsigned char*>(bytes);
    for (std::size_t i = 0; i < count; ++i) hash = (hash ^ data[i]) * 0x100000001b3ull;
    return hash;
}

Camera cameraFor(const Skeleton& skeleton, const Pose& pose) {
    std::vector<glm::vec3> points;
    for (const glm::mat4& joint : jointWorldMatrices(skeleton, pose)) points.emplace_back(joint[3]);
    Bounds bounds = boundsOf(points);
    bounds.low -= glm::vec3(kAroundJointsM);
    bounds.high += glm::vec3(kAroundJointsM);
    // A box without depth: the picture is taken from the front only, and must not shrink for the side view.
    bounds.low.z = bounds.high.z = bounds.center().z;
    return orbitCamera(bounds, 18.0, 4.0, 26.0, kThumbnailWidth, kThumbnailHeight);
}

Result<Image> render(FramePipeline& pipeline, const Pose& pose) {
    FrameInputs inputs;
    inputs.pose = pose;
    inputs.pose.expression.clear();
    inputs.pose.translation = glm::vec3(0.0f);
    inputs.camera = cameraFor(pipeline.avatar().rig().skeleton, inputs.pose);
    ARS_TRY_STATUS(pipeline.render(inputs, {BufferId::Beauty, BufferId::Opacity}));
    ARS_TRY(const Image beauty, pipeline.picture(BufferId::Beauty));
    ARS_TRY(const Image opacity, pipeline.picture(BufferId::Opacity));
    DisplaySettings display;
    display.tone.curve = ToneCurve::Agx;
    display.tone.exposureEv = 0.6f;
    display.tone.transparent = true;
    return displayPicture(BufferId::Beauty, beauty, opacity, display);
}

Result<std::unique_ptr<FramePipeline>> makePipeline(const TemplateMesh& mesh, const ProgressFunction& progress) {
    RestAvatarOptions options;
    options.maxSurfels = kSurfels;
    ARS_TRY(std::shared_ptr<AvatarEvaluator> avatar, RestAvatar::create(mesh, options, progress));
    ARS_TRY(auto pipeline, FramePipeline::create(std::move(avatar)));
    ARS_TRY(Environment studio, generateStudio(studioPreset(StudioPreset::ThreePoint)));
    ARS_TRY(const LightSource light, filterLight("studio", std::move(studio), Device{}, LightQuality::Exact, 64));
    pipeline->setLight(light.filtered);
    return pipeline;
}

} // namespace

std::string thumbnailKey(const std::string& avatarSource, const Pose& pose) {
    std::uint64_t hash = fnv1a(0xcbf29ce484222325ull, avatarSource.data(), avatarSource.size());
    for (const glm::quat& rotation : pose.rotations) {
        const std::array numbers{rotation.w, rotation.x, rotation.y, rotation.z};
        hash = fnv1a(hash, numbers.data(), sizeof(numbers));
    }
    return fmt::format("{:016x}", hash);
}

Status renderThumbnails(const TemplateMesh& mesh, const std::vector<ThumbnailWish>& wishes,
                        const std::function<void(const std::string&, Image)>& made, const ProgressFunction& progress) {
    ARS_TRY(const std::unique_ptr<FramePipeline> pipeline, makePipeline(mesh, progress));
    for (std::size_t i = 0; i < wishes.size(); ++i) {
        const double fraction = static_cast<double>(i) / static_cast<double>(wishes.size());
        ARS_TRY_STATUS(reportProgress(progress, fraction, "pictures of the pose library"));
        ARS_TRY(Image image, render(*pipeline, wishes[i].pose));
        made(wishes[i].key, std::move(image));
    }
    return {};
}

} // namespace ars::ui
