#include "engine/frame/frame_pipeline.h"

#include "engine/core/parallel.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace ars {

namespace {

bool samePose(const Pose& a, const Pose& b) {
    return a.rotations == b.rotations && a.translation == b.translation && a.expression == b.expression;
}

bool sameOcclusion(const OcclusionSettings& a, const OcclusionSettings& b) {
    if (a.method != b.method) return false;
    switch (a.method) {
    case OcclusionMethod::ScreenSpace:
        return a.screenSpace == b.screenSpace;
    case OcclusionMethod::MeshRays:
        return a.meshRays == b.meshRays;
    case OcclusionMethod::Rasterised:
        return a.rasterised == b.rasterised;
    case OcclusionMethod::Baked:
        return a.baked == b.baked;
    case OcclusionMethod::Off:
        return true;
    }
    return false;
}

Status checkInputs(const FrameInputs& inputs, const AvatarEvaluator& avatar) {
    ARS_TRY_STATUS(validateCamera(inputs.camera));
    const int joints = avatar.rig().skeleton.jointCount();
    if (static_cast<int>(inputs.pose.rotations.size()) != joints) {
        return makeError(ErrorCode::InvalidArgument, "pose",
                         fmt::format("{} rotations, the avatar has {} joints", inputs.pose.rotations.size(), joints));
    }
    auto finite = [](float number) { return std::isfinite(number); };
    for (std::size_t j = 0; j < inputs.pose.rotations.size(); ++j) {
        const glm::quat& q = inputs.pose.rotations[j];
        if (!finite(q.w) || !finite(q.x) || !finite(q.y) || !finite(q.z)) {
            return makeError(ErrorCode::InvalidArgument, "pose",
                             fmt::format("the rotation of joint {} is not finite", avatar.rig().skeleton.names[j]));
        }
    }
    const glm::vec3& t = inputs.pose.translation;
    if (!finite(t.x) || !finite(t.y) || !finite(t.z)) {
        return makeError(ErrorCode::InvalidArgument, "pose", "the translation is not finite");
    }
    return {};
}

bool isShaded(BufferId id) { return id == BufferId::Beauty || id == BufferId::Diffuse || id == BufferId::Specular; }

/// What splatting must write for these buffers.
ChannelSet neededChannels(const std::vector<BufferId>& wanted, const OcclusionSettings& occlusion, bool occlude) {
    ChannelSet channels{Channel::Opacity};
    bool shaded = false, occluded = false;
    for (const BufferId id : wanted) {
        if (const auto channel = bufferInfo(id).channel) channels.add(*channel);
        shaded = shaded || isShaded(id);
        occluded = occluded || id == BufferId::AmbientOcclusion;
    }
    if (shaded) {
        for (const Channel c : {Channel::Albedo, Channel::Roughness, Channel::Normal, Channel::Depth}) channels.add(c);
        occluded = occluded || occlude;
    }
    if (occluded && occlusion.method == OcclusionMethod::ScreenSpace) {
        for (const Channel c : {Channel::Depth, Channel::Normal, Channel::Radius, Channel::Bone}) channels.add(c);
        if (occlusion.screenSpace.adaptive != OcclusionAdaptive::Off) channels.add(Channel::Importance);
    }
    if (occluded && occlusion.method == OcclusionMethod::MeshRays) {
        for (const Channel c : {Channel::Position, Channel::Normal, Channel::Radius}) channels.add(c);
    }
    return channels;
}

/// The values of a picture in host memory.
Status toHost(const PixelBuffer& picture, std::vector<float>& values) {
    const ImageView<const float> view = picture.view();
    values.resize(view.valueCount());
    if (picture.device().kind != DeviceKind::Host)
        return downloadBuffer(std::as_writable_bytes(std::span(values)), picture.memory());
    constexpr std::size_t grain = 1u << 16;
    parallelRanges(values.size(), grain, [&](std::size_t begin, std::size_t end) {
        std::copy(view.data + begin, view.data + end, &values[begin]);
    });
    return {};
}

bool wantsParts(const std::vector<BufferId>& wanted) {
    return std::any_of(wanted.begin(), wanted.end(),
                       [](BufferId id) { return id == BufferId::Diffuse || id == BufferId::Specular; });
}

bool wantsRadiance(const std::vector<BufferId>& wanted) {
    return std::find(wanted.begin(), wanted.end(), BufferId::Radiance) != wanted.end();
}

bool wantsOcclusion(const FrameInputs& inputs, const std::vector<BufferId>& wanted) {
    return std::find(wanted.begin(), wanted.end(), BufferId::AmbientOcclusion) != wanted.end() ||
           (inputs.shading.occlude && std::any_of(wanted.begin(), wanted.end(), isShaded));
}

} // namespace

bool sameInputs(const FrameInputs& a, const FrameInputs& b) {
    return samePose(a.pose, b.pose) && a.camera == b.camera && a.radii == b.radii && a.placement == b.placement &&
           a.splat == b.splat && a.posing == b.posing && sameOcclusion(a.occlusion, b.occlusion) &&
           a.shading == b.shading && a.keepCanonical == b.keepCanonical && a.keepVisibility == b.keepVisibility &&
           a.refineOcclusion == b.refineOcclusion;
}

std::string_view frameStageName(FrameStage stage) {
    constexpr std::array<std::string_view, kFrameStageCount> names{"evaluate", "pose", "splat", "occlude", "shade"};
    return names[static_cast<std::size_t>(stage)];
}

FramePipeline::FramePipeline(std::shared_ptr<AvatarEvaluator> avatar, const Device& device)
    : avatar_(std::move(avatar)), device_(device) {
    for (int i = 0; i < kFrameStageCount; ++i) reports_[static_cast<std::size_t>(i)].stage = static_cast<FrameStage>(i);
}

FramePipeline::~FramePipeline() = default;

Result<std::unique_ptr<FramePipeline>> FramePipeline::create(std::shared_ptr<AvatarEvaluator> avatar,
                                                             const Device& device) {
    const auto devices = availableDevices();
    if (std::find(devices.begin(), devices.end(), device) == devices.end()) {
        return makeError(ErrorCode::Unavailable, deviceName(device), "there is no such device here");
    }
    std::unique_ptr<FramePipeline> pipeline(new FramePipeline(std::move(avatar), device));
    if (device.kind == DeviceKind::Cuda) pipeline->arrays_ = std::make_unique<DeviceSurfels>();
    return pipeline;
}

void FramePipeline::setLight(std::shared_ptr<const PrefilteredLight> light) {
    if (light == light_) return;
    light_ = std::move(light);
    lightVersion_ = ++version_;
}

template <typename Work>
Status FramePipeline::timed(FrameStage stage, Work&& work) {
    const auto begin = std::chrono::steady_clock::now();
    ARS_TRY_STATUS(work());
    if (waitForTimings_) ARS_TRY_STATUS(waitForDevice(device_));
    StageReport& report = reports_[static_cast<std::size_t>(stage)];
    report.milliseconds = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    report.ran = true;
    ++report.runs;
    return {};
}

FramePipeline::Changes FramePipeline::changes(const FrameInputs& inputs, const Target& target) const {
    Changes changes;
    changes.pose = poseVersion_ == 0 || !samePose(inputs.pose, pose_) || inputs.posing != posing_;
    changes.radii = radiiVersion_ == 0 || inputs.radii != radii_;
    const FrameInputs& last = target.inputs;
    const bool first = target.cameraVersion == 0;
    changes.camera = first || inputs.camera != last.camera || inputs.splat != last.splat;
    changes.occlusion = first || !sameOcclusion(inputs.occlusion, last.occlusion);
    changes.shading = first || inputs.shading != last.shading || inputs.placement != last.placement;
    return changes;
}

StageFlags FramePipeline::pending(const FrameInputs& inputs, const std::vector<BufferId>& wanted,
                                  FrameTarget where) const {
    const Target& t = targets_[static_cast<std::size_t>(where)];
    const Changes changed = changes(inputs, t);
    const bool shaded = std::any_of(wanted.begin(), wanted.end(), isShaded);
    const bool otherPose = canonicalVersion_ == 0 || !avatar_->sameSurfels(evaluatedPose_, inputs.pose);
    const bool otherView = wantsRadiance(wanted) && !colorsFit(inputs.camera);
    const bool evaluate = canonicalVersion_ == 0 || (!inputs.keepCanonical && (otherPose || otherView));
    const bool pose = evaluate || changed.pose || changed.radii || posedCanonical_ != canonicalVersion_ ||
                      posedPose_ != poseVersion_ || posedRadii_ != radiiVersion_;
    const bool splat = pose || changed.camera || t.gbufferVersion == 0 || t.splattedLive != liveVersion_ ||
                       t.splattedCamera != t.cameraVersion ||
                       !t.gbuffer.channels.includes(neededChannels(wanted, inputs.occlusion, inputs.shading.occlude));
    const bool occlude =
        wantsOcclusion(inputs, wanted) &&
        (splat || changed.occlusion || t.occludedGBuffer != t.gbufferVersion ||
         t.occludedSettings != t.occlusionSettingsVersion || (!t.occlusionComplete && inputs.refineOcclusion));
    const bool shade = shaded && (splat || changed.shading || (occlude && inputs.shading.occlude) ||
                                  t.shadedGBuffer != t.gbufferVersion || t.shadedLight != lightVersion_ ||
                                  t.shadedOcclusion != (inputs.shading.occlude ? t.occlusionVersion : 0) ||
                                  t.shadedShading != t.shadingVersion || (!t.shadedParts && wantsParts(wanted)));
    return {evaluate, pose, splat, occlude, shade};
}

void FramePipeline::adopt(const FrameInputs& inputs, const Changes& changes) {
    Target& t = target();
    if (changes.pose) poseVersion_ = ++version_;
    if (changes.radii) radiiVersion_ = ++version_;
    if (changes.camera) t.cameraVersion = ++version_;
    if (changes.occlusion) t.occlusionSettingsVersion = ++version_;
    if (changes.shading) t.shadingVersion = ++version_;
    pose_ = inputs.pose;
    posing_ = inputs.posing;
    radii_ = inputs.radii;
    t.inputs = inputs;
}

Status FramePipeline::render(const FrameInputs& inputs, const std::vector<BufferId>& wanted, FrameTarget where) {
    ARS_TRY_STATUS(checkInputs(inputs, *avatar_));
    const bool shaded = std::any_of(wanted.begin(), wanted.end(), isShaded);
    if (shaded && !light_) {
        return makeError(ErrorCode::InvalidArgument, "render", "a shaded picture needs a light, none was set");
    }
    for (StageReport& report : reports_) report.ran = false;
    const StageFlags runs = pending(inputs, wanted, where);
    current_ = where;
    adopt(inputs, changes(inputs, target()));
    const auto due = [&runs](FrameStage stage) { return runs[static_cast<std::size_t>(stage)]; };
    target().radiance = wantsRadiance(wanted);
    if (due(FrameStage::Evaluate)) ARS_TRY_STATUS(evaluate(inputs, target().radiance));
    if (due(FrameStage::Pose)) ARS_TRY_STATUS(poseStage(inputs));
    if (due(FrameStage::Splat))
        ARS_TRY_STATUS(splatStage(inputs, neededChannels(wanted, inputs.occlusion, inputs.shading.occlude)));
    if (due(FrameStage::Occlude)) ARS_TRY_STATUS(occludeStage(inputs));
    if (due(FrameStage::Shade)) ARS_TRY_STATUS(shadeStage(inputs, wantsParts(wanted)));
    return {};
}

Status FramePipeline::evaluate(const FrameInputs& inputs, bool radiance) {
    return timed(FrameStage::Evaluate, [&]() -> Status {
        evaluatedViewAlone_ = canonicalVersion_ != 0 && avatar_->sameSurfels(evaluatedPose_, inputs.pose);
        canonicalVersion_ = 0; // nothing holds if it fails half-way
        // Colours of a view cost a pass of their own, which nobody needs who looks at other buffers.
        const bool view = radiance && avatar_->colorsDependOnView();
        ARS_TRY_STATUS(avatar_->evaluate(inputs.pose, view ? &inputs.camera : nullptr, canonical_));
        ARS_TRY_STATUS(checkSurfels(canonical_));
        canonicalVersion_ = ++version_;
        evaluatedPose_ = inputs.pose;
        evaluatedView_ = view ? std::optional<Camera>(inputs.camera) : std::nullopt;
        return {};
    });
}

/// The radiance colours at hand are those of this view. Its field and size do not matter: a zoom, or a draft at another
/// size, evaluates nothing.
bool FramePipeline::colorsFit(const Camera& camera) const {
    if (!avatar_->colorsDependOnView()) return true;
    return evaluatedView_ && evaluatedView_->rotation == camera.rotation &&
           evaluatedView_->translation == camera.translation;
}

bool FramePipeline::canonicalFresh() const {
    return canonicalVersion_ != 0 && avatar_->sameSurfels(evaluatedPose_, pose_) &&
           (!target().radiance || colorsFit(target().inputs.camera));
}

Status FramePipeline::poseStage(const FrameInputs& inputs) {
    const bool moved = posedCanonical_ != canonicalVersion_ || posedPose_ != poseVersion_;
    return timed(FrameStage::Pose, [&]() -> Status {
        const std::uint64_t canonicalBefore = std::exchange(posedCanonical_, 0);
        if (device_.kind == DeviceKind::Cuda) {
            ARS_TRY_STATUS(poseOnDevice(inputs, canonicalBefore != canonicalVersion_));
        } else {
            ARS_TRY_STATUS(poseOnHost(inputs, !moved));
        }
        posedCanonical_ = canonicalVersion_;
        posedPose_ = poseVersion_;
        posedRadii_ = radiiVersion_;
        liveVersion_ = ++version_;
        return {};
    });
}

Status FramePipeline::poseOnHost(const FrameInputs& inputs, bool radiiOnly) {
    const AvatarRig& rig = avatar_->rig();
    SurfelPosing posing;
    ARS_TRY(const std::vector<glm::mat4> matrices,
            canonicalToPosed(skinningMatrices(rig.skeleton, inputs.pose), rig.canonical));
    const std::vector<glm::vec3> joints = posedJointPositions(rig.skeleton, inputs.pose);
    posing.matrices = matrices;
    posing.jointPositions = joints;
    posing.parts = rig.parts;
    posing.radii = inputs.radii;
    if (radiiOnly) return poseRadii(inputs.posing, posing, rig.weights, posed_);
    return poseSurfels(inputs.posing, posing, rig.weights, canonical_, posed_);
}

Status FramePipeline::poseOnDevice(const FrameInputs& inputs, bool newSurfels) {
    const AvatarRig& rig = avatar_->rig();
    if (newSurfels) ARS_TRY_STATUS(arrays_->setCanonical(device_, canonical_, rig.weights));
    ARS_TRY(const std::vector<glm::mat4> matrices,
            canonicalToPosed(skinningMatrices(rig.skeleton, inputs.pose), rig.canonical));
    return arrays_->pose(inputs.posing, matrices, posedJointPositions(rig.skeleton, inputs.pose), rig.parts,
                         inputs.radii);
}

SurfelView FramePipeline::liveSurfels() const {
    return device_.kind == DeviceKind::Cuda ? arrays_->view() : liveView(canonical_, posed_);
}

Result<Surfels> FramePipeline::surfels() const {
    if (posedCanonical_ == 0) return makeError(ErrorCode::NotFound, "surfels", "no frame was rendered yet");
    if (device_.kind == DeviceKind::Cuda) return arrays_->download();
    return ars::liveSurfels(canonical_, posed_);
}

Result<std::vector<glm::vec3>> FramePipeline::surfelMeans() const {
    if (posedCanonical_ == 0) return makeError(ErrorCode::NotFound, "surfels", "no frame was rendered yet");
    if (device_.kind == DeviceKind::Cuda) return arrays_->downloadMeans();
    return posed_.means;
}

std::vector<glm::mat4> FramePipeline::jointWorld() const { return jointWorldMatrices(avatar_->rig().skeleton, pose_); }

Status FramePipeline::splatStage(const FrameInputs& inputs, ChannelSet channels) {
    Target& t = target();
    const bool fresh = t.gbufferVersion != 0 && t.splattedLive == liveVersion_ && t.splattedCamera == t.cameraVersion;
    return timed(FrameStage::Splat, [&]() -> Status {
        // Looking at one more buffer of the same picture keeps those that are there.
        const ChannelSet all = fresh ? channels.united(t.gbuffer.channels) : channels;
        t.gbufferVersion = 0; // nothing holds if splatting fails half-way
        // On CUDA splatting looks whether its pictures are whole, and makes them again where not, only for who waits
        // for it. Whoever waits for the stage anyway does.
        const bool whole = collectStats_ || (waitForTimings_ && device_.kind == DeviceKind::Cuda);
        ARS_TRY_STATUS(splat(inputs.splat, liveSurfels(), inputs.camera, all, t.gbuffer, t.splatWorkspace, nullptr,
                             whole ? &splatStats_ : nullptr));
        t.gbufferVersion = ++version_;
        t.splattedLive = liveVersion_;
        t.splattedCamera = t.cameraVersion;
        return {};
    });
}

Status FramePipeline::occludeStage(const FrameInputs& inputs) {
    return timed(FrameStage::Occlude, [&]() -> Status {
        Target& t = target();
        OcclusionStageInputs stage;
        stage.avatar = avatar_.get();
        stage.pose = &t.inputs.pose;
        stage.poseVersion = poseVersion_;
        stage.canonical = &canonical_;
        stage.canonicalVersion = canonicalVersion_;
        stage.live = liveSurfels();
        stage.gbuffer = &t.gbuffer;
        stage.gbufferVersion = t.gbufferVersion;
        stage.camera = inputs.camera;
        stage.splat = inputs.splat;
        stage.refinement = &t.refinement;
        stage.keepVisibility = inputs.keepVisibility;
        t.occludedGBuffer = 0;
        ARS_TRY_STATUS(occlusion_.run(inputs.occlusion, stage, t.occlusion));
        t.occlusionComplete = occlusion_.complete();
        t.occlusionShare = occlusion_.share();
        t.occludedGBuffer = t.gbufferVersion;
        t.occludedSettings = t.occlusionSettingsVersion;
        t.occlusionVersion = ++version_;
        return {};
    });
}

Status FramePipeline::shadeStage(const FrameInputs& inputs, bool parts) {
    return timed(FrameStage::Shade, [&]() -> Status {
        Target& t = target();
        const int width = t.gbuffer.width(), height = t.gbuffer.height();
        t.shadedGBuffer = 0;
        ARS_TRY_STATUS(t.beauty.reshape(device_, width, height, 4, "shading"));
        ShadingOutputs outputs;
        outputs.beauty = t.beauty.view();
        if (parts) {
            ARS_TRY_STATUS(t.diffuse.reshape(device_, width, height, 3, "shading"));
            ARS_TRY_STATUS(t.specular.reshape(device_, width, height, 3, "shading"));
            outputs.diffuse = t.diffuse.view();
            outputs.specular = t.specular.view();
        }
        ShadingInputs pictures;
        const GBuffer& g = t.gbuffer;
        pictures.albedo = g[Channel::Albedo].view();
        pictures.roughness = g[Channel::Roughness].view();
        pictures.normal = g[Channel::Normal].view();
        pictures.opacity = g[Channel::Opacity].view();
        if (inputs.shading.occlude) pictures.occlusion = std::as_const(t.occlusion).view();
        pictures.camera = inputs.camera;
        pictures.light = light_->view(inputs.placement);
        ARS_TRY_STATUS(shade(device_, inputs.shading, pictures, outputs));
        t.shadedGBuffer = t.gbufferVersion;
        t.shadedOcclusion = inputs.shading.occlude ? t.occlusionVersion : 0;
        t.shadedLight = lightVersion_;
        t.shadedShading = t.shadingVersion;
        t.shadedParts = parts;
        t.shadedVersion = ++version_;
        return {};
    });
}

const PixelBuffer* FramePipeline::pixels(BufferId id) const {
    const Target& t = target();
    if (const auto channel = bufferInfo(id).channel) {
        return t.gbufferVersion != 0 && t.gbuffer.channels.has(*channel) ? &t.gbuffer[*channel] : nullptr;
    }
    if (id == BufferId::AmbientOcclusion) return t.occludedGBuffer != 0 ? &t.occlusion : nullptr;
    if (t.shadedGBuffer == 0) return nullptr;
    if (id == BufferId::Beauty) return &t.beauty;
    if (!t.shadedParts) return nullptr;
    return id == BufferId::Diffuse ? &t.diffuse : &t.specular;
}

std::uint64_t FramePipeline::pictureVersion(BufferId id) const {
    if (!pixels(id)) return 0;
    const Target& t = target();
    if (bufferInfo(id).channel) return t.gbufferVersion;
    return id == BufferId::AmbientOcclusion ? t.occlusionVersion : t.shadedVersion;
}

Result<ImageView<const float>> FramePipeline::buffer(BufferId id) const {
    const PixelBuffer* picture = pixels(id);
    if (!picture || picture->empty()) {
        return makeError(ErrorCode::NotFound, std::string(bufferInfo(id).name), "this buffer was not rendered");
    }
    return picture->view();
}

Result<Image> FramePipeline::picture(BufferId id) const {
    Image image;
    ARS_TRY_STATUS(copyPicture(id, image));
    return image;
}

Status FramePipeline::copyPicture(BufferId id, Image& image) const {
    ARS_TRY(const ImageView<const float> view, buffer(id));
    const BufferInfo& info = bufferInfo(id);
    image.width = view.width;
    image.height = view.height;
    image.channels = view.channels;
    image.space = info.kind == BufferKind::SrgbColor                                              ? ColorSpace::Srgb
                  : info.kind == BufferKind::LinearColor || info.kind == BufferKind::LinearAlbedo ? ColorSpace::Linear
                                                                                                  : ColorSpace::Data;
    image.premultiplied = id == BufferId::Beauty;
    image.sourceBits = 32;
    ARS_TRY_STATUS(toHost(*pixels(id), image.pixels));
    if (id != BufferId::AmbientOcclusion) return {};
    const PixelBuffer& covered = target().gbuffer[Channel::Opacity];
    std::vector<float> downloaded;
    if (device_.kind != DeviceKind::Host) ARS_TRY_STATUS(toHost(covered, downloaded));
    const float* opacity = device_.kind == DeviceKind::Host ? covered.view().data : downloaded.data();
    parallelFor(
        image.pixels.size(),
        [&](std::size_t p) {
            if (!(opacity[p] > kMinOpacity)) image.pixels[p] = 0.0f;
        },
        1u << 16);
    return {};
}

} // namespace ars
