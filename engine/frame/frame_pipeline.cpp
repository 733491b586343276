#include "engine/frame/frame_pipeline.h"

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

Image hostImage(ImageView<const float> view, const Device& device, const Buffer& memory, Status& status) {
    Image image;
    image.width = view.width;
    image.height = view.height;
    image.channels = view.channels;
    image.pixels.resize(view.valueCount());
    if (device.kind == DeviceKind::Host) {
        std::copy(view.data, view.data + view.valueCount(), image.pixels.begin());
    } else {
        status = downloadBuffer(std::as_writable_bytes(std::span(image.pixels)), memory);
    }
    return image;
}

} // namespace

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

Status FramePipeline::render(const FrameInputs& inputs, const std::vector<BufferId>& wanted) {
    ARS_TRY_STATUS(checkInputs(inputs, *avatar_));
    const bool shaded = std::any_of(wanted.begin(), wanted.end(), isShaded);
    if (shaded && !light_) {
        return makeError(ErrorCode::InvalidArgument, "render", "a shaded picture needs a light, none was set");
    }
    for (StageReport& report : reports_) report.ran = false;
    const bool first = poseVersion_ == 0;
    if (first || !samePose(inputs.pose, inputs_.pose) || inputs.posing != inputs_.posing) poseVersion_ = ++version_;
    if (first || inputs.radii != inputs_.radii) radiiVersion_ = ++version_;
    if (first || inputs.camera != inputs_.camera || inputs.splat != inputs_.splat) cameraVersion_ = ++version_;
    if (first || !sameOcclusion(inputs.occlusion, inputs_.occlusion)) occlusionSettingsVersion_ = ++version_;
    if (first || inputs.shading != inputs_.shading || inputs.placement != inputs_.placement)
        shadingVersion_ = ++version_;
    inputs_ = inputs;

    ARS_TRY_STATUS(evaluate(inputs));
    ARS_TRY_STATUS(poseStage(inputs));
    ARS_TRY_STATUS(splatStage(inputs, neededChannels(wanted, inputs.occlusion, inputs.shading.occlude)));
    const bool occluded = std::find(wanted.begin(), wanted.end(), BufferId::AmbientOcclusion) != wanted.end() ||
                          (shaded && inputs.shading.occlude);
    if (occluded) ARS_TRY_STATUS(occludeStage(inputs));
    if (shaded) ARS_TRY_STATUS(shadeStage(inputs, wanted));
    return {};
}

Status FramePipeline::evaluate(const FrameInputs& inputs) {
    const bool view = avatar_->colorsDependOnView();
    const bool fresh = canonicalVersion_ != 0 && (!avatar_->dependsOnPose() || evaluatedPose_ == poseVersion_) &&
                       (!view || evaluatedCamera_ == cameraVersion_);
    if (fresh) return {};
    return timed(FrameStage::Evaluate, [&]() -> Status {
        canonicalVersion_ = 0; // nothing holds if it fails half-way
        ARS_TRY_STATUS(avatar_->evaluate(inputs.pose, view ? &inputs.camera : nullptr, canonical_));
        ARS_TRY_STATUS(checkSurfels(canonical_));
        canonicalVersion_ = ++version_;
        evaluatedPose_ = poseVersion_;
        evaluatedCamera_ = cameraVersion_;
        return {};
    });
}

Status FramePipeline::poseStage(const FrameInputs& inputs) {
    const bool moved = posedCanonical_ != canonicalVersion_ || posedPose_ != poseVersion_;
    if (!moved && posedRadii_ == radiiVersion_) return {};
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

Status FramePipeline::splatStage(const FrameInputs& inputs, ChannelSet channels) {
    const bool fresh = gbufferVersion_ != 0 && splattedLive_ == liveVersion_ && splattedCamera_ == cameraVersion_;
    if (fresh && gbuffer_.channels.includes(channels)) return {};
    return timed(FrameStage::Splat, [&]() -> Status {
        // Looking at one more buffer of the same picture keeps those that are there.
        const ChannelSet all = fresh ? channels.united(gbuffer_.channels) : channels;
        gbufferVersion_ = 0; // nothing holds if splatting fails half-way
        ARS_TRY_STATUS(splat(inputs.splat, liveSurfels(), inputs.camera, all, gbuffer_, splatWorkspace_, nullptr,
                             collectStats_ ? &splatStats_ : nullptr));
        gbufferVersion_ = ++version_;
        splattedLive_ = liveVersion_;
        splattedCamera_ = cameraVersion_;
        return {};
    });
}

Status FramePipeline::occludeStage(const FrameInputs& inputs) {
    const bool fresh = occludedGBuffer_ == gbufferVersion_ && occludedSettings_ == occlusionSettingsVersion_;
    if (fresh && occlusion_.complete()) return {};
    return timed(FrameStage::Occlude, [&]() -> Status {
        OcclusionStageInputs stage;
        stage.avatar = avatar_.get();
        stage.pose = &inputs_.pose;
        stage.poseVersion = poseVersion_;
        stage.canonical = &canonical_;
        stage.canonicalVersion = canonicalVersion_;
        stage.live = liveSurfels();
        stage.gbuffer = &gbuffer_;
        stage.gbufferVersion = gbufferVersion_;
        stage.camera = inputs.camera;
        stage.splat = inputs.splat;
        occludedGBuffer_ = 0;
        ARS_TRY_STATUS(occlusion_.run(inputs.occlusion, stage, occlusionPicture_));
        occludedGBuffer_ = gbufferVersion_;
        occludedSettings_ = occlusionSettingsVersion_;
        occlusionVersion_ = ++version_;
        return {};
    });
}

Status FramePipeline::shadeStage(const FrameInputs& inputs, const std::vector<BufferId>& wanted) {
    const bool parts = std::any_of(wanted.begin(), wanted.end(),
                                   [](BufferId id) { return id == BufferId::Diffuse || id == BufferId::Specular; });
    const std::uint64_t occlusionVersion = inputs.shading.occlude ? occlusionVersion_ : 0;
    const bool fresh = shadedGBuffer_ == gbufferVersion_ && shadedOcclusion_ == occlusionVersion &&
                       shadedLight_ == lightVersion_ && shadedShading_ == shadingVersion_;
    if (fresh && (shadedParts_ || !parts)) return {};
    return timed(FrameStage::Shade, [&]() -> Status {
        const int width = gbuffer_.width(), height = gbuffer_.height();
        shadedGBuffer_ = 0;
        ARS_TRY_STATUS(beauty_.reshape(device_, width, height, 4, "shading"));
        ShadingOutputs outputs;
        outputs.beauty = beauty_.view();
        if (parts) {
            ARS_TRY_STATUS(diffuse_.reshape(device_, width, height, 3, "shading"));
            ARS_TRY_STATUS(specular_.reshape(device_, width, height, 3, "shading"));
            outputs.diffuse = diffuse_.view();
            outputs.specular = specular_.view();
        }
        ShadingInputs pictures;
        const GBuffer& g = gbuffer_;
        pictures.albedo = g[Channel::Albedo].view();
        pictures.roughness = g[Channel::Roughness].view();
        pictures.normal = g[Channel::Normal].view();
        pictures.opacity = g[Channel::Opacity].view();
        if (inputs.shading.occlude) pictures.occlusion = std::as_const(occlusionPicture_).view();
        pictures.camera = inputs.camera;
        pictures.light = light_->view(inputs.placement);
        ARS_TRY_STATUS(shade(device_, inputs.shading, pictures, outputs));
        shadedGBuffer_ = gbufferVersion_;
        shadedOcclusion_ = occlusionVersion;
        shadedLight_ = lightVersion_;
        shadedShading_ = shadingVersion_;
        shadedParts_ = parts;
        return {};
    });
}

Result<ImageView<const float>> FramePipeline::buffer(BufferId id) const {
    ImageView<const float> view;
    if (const auto channel = bufferInfo(id).channel) {
        if (gbufferVersion_ != 0 && gbuffer_.channels.has(*channel)) view = gbuffer_[*channel].view();
    } else if (id == BufferId::AmbientOcclusion) {
        if (occludedGBuffer_ != 0) view = occlusionPicture_.view();
    } else if (shadedGBuffer_ != 0) {
        if (id == BufferId::Beauty) view = beauty_.view();
        if (id == BufferId::Diffuse && shadedParts_) view = diffuse_.view();
        if (id == BufferId::Specular && shadedParts_) view = specular_.view();
    }
    if (view.empty()) {
        return makeError(ErrorCode::NotFound, std::string(bufferInfo(id).name), "this buffer was not rendered");
    }
    return view;
}

Result<Image> FramePipeline::picture(BufferId id) const {
    ARS_TRY(const ImageView<const float> view, buffer(id));
    const BufferInfo& info = bufferInfo(id);
    const PixelBuffer* owner = info.channel                       ? &gbuffer_[*info.channel]
                               : id == BufferId::AmbientOcclusion ? &occlusionPicture_
                               : id == BufferId::Beauty           ? &beauty_
                               : id == BufferId::Diffuse          ? &diffuse_
                                                                  : &specular_;
    Status status;
    Image image = hostImage(view, device_, owner->memory(), status);
    ARS_TRY_STATUS(status);
    image.space = info.kind == BufferKind::SrgbColor                                              ? ColorSpace::Srgb
                  : info.kind == BufferKind::LinearColor || info.kind == BufferKind::LinearAlbedo ? ColorSpace::Linear
                                                                                                  : ColorSpace::Data;
    image.premultiplied = id == BufferId::Beauty;
    if (id == BufferId::AmbientOcclusion) {
        Image opacity =
            hostImage(gbuffer_[Channel::Opacity].view(), device_, gbuffer_[Channel::Opacity].memory(), status);
        ARS_TRY_STATUS(status);
        for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
            if (!(opacity.pixels[p] > kMinOpacity)) image.pixels[p] = 0.0f;
        }
    }
    return image;
}

} // namespace ars
