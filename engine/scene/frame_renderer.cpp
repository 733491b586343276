#include "engine/scene/frame_renderer.h"

#include <algorithm>
#include <atomic>
#include <cmath>

namespace ars {

namespace {

using Clock = std::chrono::steady_clock;

/// Of a change to a finer level: its time must stay below this share of the budget.
constexpr double kRoomToSpare = 0.75;
/// An evaluation that takes no longer is part of a draft.
constexpr double kQuickEvaluationMs = 0.4 * kDraftBudgetMs;
/// Pictures that become finer are shown at most this often; shading and copying them costs time that refining needs.
constexpr double kRefiningShownMs = 60.0;
/// Directions of a refining pass: few passes cost less in all, and bands keep their calls short.
constexpr int kPassDirections = 1024;
/// Time of a refining call that is aimed at; a new request waits for one at most.
constexpr double kSliceMs = 30.0;
constexpr double kMostBands = 128.0;
/// Images that nobody holds and are kept for the next frame.
constexpr std::size_t kSpareImages = 24;

double millisecondsSince(Clock::time_point begin) {
    return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

bool contains(const std::vector<BufferId>& buffers, BufferId id) {
    return std::find(buffers.begin(), buffers.end(), id) != buffers.end();
}

bool isShaded(BufferId id) { return id == BufferId::Beauty || id == BufferId::Diffuse || id == BufferId::Specular; }

/// In units that are about proportional to its time.
double stageWork(FrameStage stage, const FrameInputs& inputs) {
    const double pixels = 1e-6 * inputs.camera.width * inputs.camera.height;
    switch (stage) {
    case FrameStage::Evaluate:
    case FrameStage::Pose:
        return 1.0;
    case FrameStage::Splat:
    case FrameStage::Shade:
        return pixels;
    case FrameStage::Occlude:
        break;
    }
    if (inputs.occlusion.method == OcclusionMethod::MeshRays) return pixels * inputs.occlusion.meshRays.rays;
    if (inputs.occlusion.method != OcclusionMethod::ScreenSpace) return pixels;
    // A pixel costs as much as some 70 directions before the first is taken (measured).
    return pixels * (1.0 + inputs.occlusion.screenSpace.interactiveDirections / 70.0);
}

bool takesLong(OcclusionMethod method) {
    return method == OcclusionMethod::MeshRays || method == OcclusionMethod::Rasterised ||
           method == OcclusionMethod::Baked;
}

/// Of the directions or rays that the full picture takes.
float shareOf(const FrameInputs& taken, const FrameInputs& full, float share) {
    if (taken.occlusion.method != OcclusionMethod::MeshRays) return share;
    return static_cast<float>(taken.occlusion.meshRays.rays) /
           static_cast<float>(std::max(1, full.occlusion.meshRays.rays));
}

double copyWork(const std::vector<BufferId>& buffers, const Camera& camera) {
    int channels = 0;
    for (const BufferId id : buffers) channels += bufferInfo(id).channels();
    return 1e-6 * camera.width * camera.height * channels;
}

} // namespace

const std::array<DraftLevel, kDraftLevelCount>& draftLevels() {
    // The coarsest is for pictures of a 4K window.
    static const std::array<DraftLevel, kDraftLevelCount> levels{
        {{1.0, 1024, 32}, {0.75, 48, 24}, {0.5, 32, 16}, {0.35, 24, 16}, {0.25, 16, 16}}};
    return levels;
}

void DraftCosts::measured(int stage, double work, double milliseconds) {
    if (!(work > 0.0)) return;
    double& known = perWork_[static_cast<std::size_t>(stage)];
    const double now = milliseconds / work;
    known = known < 0.0 ? now : known + 0.4 * (now - known);
}

void EvaluationTimes::measured(double milliseconds) {
    last_[static_cast<std::size_t>(next_)] = milliseconds;
    next_ = (next_ + 1) % static_cast<int>(last_.size());
}

bool EvaluationTimes::quick(double milliseconds) const {
    const double slowest = *std::max_element(last_.begin(), last_.end());
    return slowest >= 0.0 && slowest <= milliseconds;
}

int chooseDraftLevel(const std::array<double, kDraftLevelCount>& milliseconds, int current) {
    if (milliseconds.front() < 0.0) return kFirstDraftLevel;
    for (int level = 0; level < kDraftLevelCount - 1; ++level) {
        const double budget = level < current ? kRoomToSpare * kDraftBudgetMs : kDraftBudgetMs;
        if (milliseconds[static_cast<std::size_t>(level)] <= budget) return level;
    }
    return kDraftLevelCount - 1;
}

FrameInputs inputsForBuffers(FrameInputs inputs, const std::vector<BufferId>& buffers) {
    if (contains(buffers, BufferId::RadiusPlus) || contains(buffers, BufferId::RadiusMinus))
        inputs.posing.trainingRadii = true;
    return inputs;
}

Status FrameRenderer::prepare(const FrameRequest& request) {
    if (!request.avatar || !request.avatar->evaluator)
        return makeError(ErrorCode::InvalidArgument, "frame", "there is no avatar to show");
    if (request.avatar != avatar_) {
        pipeline_.reset(); // first, so that both are never in memory together
        avatar_.reset();
        evaluations_ = {};
        copies_ = {};
        parts_ = {};
        partPicture_ = PartPicture();
        means_.reset();
        surfels_.reset();
        meansVersion_ = surfelsVersion_ = 0;
        ARS_TRY(pipeline_, FramePipeline::create(request.avatar->evaluator, device_));
        avatar_ = request.avatar;
    }
    const bool light = request.light && request.light->source;
    pipeline_->setLight(light ? request.light->source->filtered : nullptr);
    // Times tell which size a draft may have: on CUDA they must be those of the work, not of queueing it.
    pipeline_->waitForTimings(device_.kind == DeviceKind::Cuda);
    wanted_.clear();
    for (const BufferId id : request.buffers) {
        if ((light || !isShaded(id)) && !contains(wanted_, id)) wanted_.push_back(id);
    }
    for (const BufferId id : {BufferId::Opacity, BufferId::Depth}) {
        if (!contains(wanted_, id)) wanted_.push_back(id);
    }
    inputs_ = inputsForBuffers(request.inputs, wanted_);
    inputs_.occlusion.screenSpace.quality = OcclusionQuality::Interactive;
    complete_ = false;
    begin_ = Clock::now();
    return {};
}

FrameInputs FrameRenderer::draftInputs(const FrameInputs& full, int level) const {
    const DraftLevel& draft = draftLevels()[static_cast<std::size_t>(level)];
    FrameInputs inputs = full;
    // Networks that are quick enough follow every pose; the others wait for rest.
    inputs.keepCanonical = !evaluations_.quick(kQuickEvaluationMs);
    inputs.keepVisibility = true;
    inputs.refineOcclusion = false;
    if (level == 0) {
        // What stands at full size is used as it is: turning the light, say, then costs its shading alone.
        if (!pipeline_->pending(inputs, wanted_)[static_cast<std::size_t>(FrameStage::Occlude)]) return inputs;
    } else {
        const auto side = [&draft](int pixels) {
            return std::max(1, static_cast<int>(std::lround(pixels * draft.scale)));
        };
        inputs.camera = resizedCamera(full.camera, side(full.camera.width), side(full.camera.height));
    }
    OcclusionSettings& occlusion = inputs.occlusion;
    occlusion.screenSpace.interactiveDirections =
        std::min(occlusion.screenSpace.interactiveDirections, draft.directions);
    occlusion.meshRays.rays = std::min(occlusion.meshRays.rays, draft.rays);
    // A second of work on the mesh before the first picture is no draft: until then the paper's method stands in.
    if (takesLong(occlusion.method) && !pipeline_->occlusionPrepared(occlusion))
        occlusion.method = OcclusionMethod::ScreenSpace;
    return inputs;
}

/// Negative where a stage has never run.
double FrameRenderer::foretoldMs(const FrameInputs& inputs, FrameTarget target, const FrameRequest& request) const {
    double sum = 0.0;
    const auto add = [&](int stage, double work) {
        if (sum >= 0.0) sum = costs_.known(stage) ? sum + costs_.foretold(stage, work) : -1.0;
    };
    const StageFlags due = pipeline_->pending(inputs, wanted_, target);
    for (int i = 0; i < kFrameStageCount; ++i) {
        if (due[static_cast<std::size_t>(i)]) add(i, stageWork(static_cast<FrameStage>(i), inputs));
    }
    std::vector<BufferId> copied;
    for (const BufferId id : wanted_) {
        if (due[static_cast<std::size_t>(FrameStage::Splat)] || isShaded(id)) copied.push_back(id);
    }
    add(DraftCosts::kCopy, copyWork(copied, inputs.camera));
    if (request.parts && due[static_cast<std::size_t>(FrameStage::Splat)] && costs_.known(DraftCosts::kParts))
        add(DraftCosts::kParts, stageWork(FrameStage::Splat, inputs));
    return sum;
}

Status FrameRenderer::render(const FrameInputs& inputs, const std::vector<BufferId>& buffers, FrameTarget target) {
    ARS_TRY_STATUS(pipeline_->render(inputs, buffers, target));
    for (const StageReport& report : pipeline_->stages()) {
        // A refining pass takes another number of directions than a draft would.
        const bool refined = report.stage == FrameStage::Occlude && inputs.refineOcclusion;
        const bool viewAlone = report.stage == FrameStage::Evaluate && pipeline_->evaluatedViewAlone();
        if (report.ran && report.stage == FrameStage::Evaluate && !viewAlone)
            evaluations_.measured(report.milliseconds);
        if (report.ran && !refined && !viewAlone)
            costs_.measured(static_cast<int>(report.stage), stageWork(report.stage, inputs), report.milliseconds);
        if (report.ran && refined) adaptSlices(report.milliseconds);
    }
    return {};
}

/// Rows differ in how much there is to do, so that bands become wider carefully and narrower at once.
void FrameRenderer::adaptSlices(double milliseconds) {
    const double factor = std::clamp(milliseconds / kSliceMs, 0.8, 8.0);
    bands_ = std::clamp(bands_ * factor, 1.0, kMostBands);
    pipeline_->setRefinementSlices(static_cast<int>(std::ceil(bands_)), kPassDirections);
}

Result<std::shared_ptr<const Frame>> FrameRenderer::draft(const FrameRequest& request, std::uint64_t number) {
    ARS_TRY_STATUS(prepare(request));
    advancing_ = 0;
    std::array<double, kDraftLevelCount> foretold{};
    std::array<FrameInputs, kDraftLevelCount> inputs;
    const auto target = [](int level) { return level == 0 ? FrameTarget::Main : FrameTarget::Draft; };
    for (int level = 0; level < kDraftLevelCount; ++level) {
        const auto i = static_cast<std::size_t>(level);
        inputs[i] = draftInputs(inputs_, level);
        foretold[i] = foretoldMs(inputs[i], target(level), request);
    }
    const int chosen = chooseDraftLevel(foretold, level_);
    ARS_TRY_STATUS(render(inputs[static_cast<std::size_t>(chosen)], wanted_, target(chosen)));
    // Where geometry stands, full size is free: that says nothing about the next drag.
    if (pipeline_->stages()[static_cast<std::size_t>(FrameStage::Splat)].ran) level_ = chosen;
    return finish(request, number, target(chosen));
}

Result<std::shared_ptr<const Frame>> FrameRenderer::advance(const FrameRequest& request, std::uint64_t number) {
    const bool first = advancing_ != number;
    if (first) {
        ARS_TRY_STATUS(prepare(request));
        advancing_ = number;
    }
    if (first && costs_.known(static_cast<int>(FrameStage::Occlude))) {
        FrameInputs pass = inputs_;
        pass.occlusion.screenSpace.interactiveDirections = kPassDirections;
        const double whole =
            costs_.foretold(static_cast<int>(FrameStage::Occlude), stageWork(FrameStage::Occlude, pass));
        bands_ = std::clamp(whole / kSliceMs, 1.0, kMostBands);
    }
    pipeline_->setRefinementSlices(static_cast<int>(std::ceil(bands_)), kPassDirections);
    const auto due = [this](FrameStage stage) {
        return pipeline_->pending(inputs_, wanted_)[static_cast<std::size_t>(stage)];
    };
    const OcclusionMethod method = inputs_.occlusion.method;
    const bool slow = takesLong(method) && due(FrameStage::Occlude);
    if (first && slow && pipeline_->occlusionPrepared(inputs_.occlusion)) {
        ARS_TRY_STATUS(render(draftInputs(inputs_, 0), wanted_, FrameTarget::Main));
        return finish(request, number, FrameTarget::Main);
    }
    if (first || due(FrameStage::Splat) || millisecondsSince(shown_) > kRefiningShownMs) {
        FrameInputs inputs = inputs_;
        // The first pass of all is what a draft at full size costs.
        inputs.refineOcclusion = !first || !due(FrameStage::Splat);
        ARS_TRY_STATUS(render(inputs, wanted_, FrameTarget::Main));
    } else if (due(FrameStage::Occlude)) {
        ARS_TRY_STATUS(render(inputs_, {BufferId::AmbientOcclusion}, FrameTarget::Main));
        if (due(FrameStage::Occlude)) return std::shared_ptr<const Frame>();
        ARS_TRY_STATUS(render(inputs_, wanted_, FrameTarget::Main));
    } else {
        ARS_TRY_STATUS(render(inputs_, wanted_, FrameTarget::Main));
    }
    const StageFlags rest = pipeline_->pending(inputs_, wanted_);
    complete_ = std::none_of(rest.begin(), rest.end(), [](bool stage) { return stage; });
    return finish(request, number, FrameTarget::Main);
}

std::shared_ptr<Image> FrameRenderer::freeImage(std::size_t values) {
    std::size_t spare = 0;
    for (const std::shared_ptr<Image>& image : pool_) {
        if (image.use_count() > 1) continue;
        ++spare;
        if (image->pixels.size() != values) continue;
        // What the last holder read happened before it let go.
        std::atomic_thread_fence(std::memory_order_acquire);
        return image;
    }
    if (spare > kSpareImages) std::erase_if(pool_, [](const auto& image) { return image.use_count() == 1; });
    pool_.push_back(std::make_shared<Image>());
    return pool_.back();
}

Result<std::shared_ptr<const Image>> FrameRenderer::copyOf(BufferId id, FrameTarget target) {
    Copy& copy = copies_[static_cast<std::size_t>(target)][id];
    const std::uint64_t version = pipeline_->pictureVersion(id);
    if (copy.image && copy.version == version) return copy.image;
    copy.image.reset(); // so that it can be used again
    const Camera& camera = pipeline_->inputs().camera;
    const std::shared_ptr<Image> image =
        freeImage(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height) *
                  static_cast<std::size_t>(bufferInfo(id).channels()));
    ARS_TRY_STATUS(pipeline_->copyPicture(id, *image));
    copy = {version, image};
    return copy.image;
}

Status FrameRenderer::paintParts(Frame& frame, FrameTarget target) {
    const auto index = static_cast<std::size_t>(target);
    Copy& copy = parts_[index];
    const FrameInputs& inputs = pipeline_->inputs();
    const std::uint64_t version = pipeline_->pictureVersion(BufferId::Opacity); // pose, camera and kernel stand
    if (!copy.image || copy.version != version) {
        const auto begin = Clock::now();
        copy.image.reset();
        const std::shared_ptr<Image> image = freeImage(3 * static_cast<std::size_t>(inputs.camera.width) *
                                                       static_cast<std::size_t>(inputs.camera.height));
        ARS_TRY_STATUS(partPicture_.render(avatar_->evaluator->rig(), pipeline_->liveSurfels(), inputs.splat,
                                           inputs.camera, *image));
        copy = {version, image};
        costs_.measured(DraftCosts::kParts, stageWork(FrameStage::Splat, inputs), millisecondsSince(begin));
    }
    frame.parts = copy.image;
    return {};
}

Result<std::shared_ptr<const Frame>> FrameRenderer::finish(const FrameRequest& request, std::uint64_t number,
                                                           FrameTarget target) {
    auto frame = std::make_shared<Frame>();
    frame->request = number;
    frame->avatar = request.avatar;
    frame->light = request.light;
    const bool whole = target == FrameTarget::Main && pipeline_->canonicalFresh();
    const StageFlags rest = pipeline_->pending(inputs_, wanted_);
    const bool full = whole && std::none_of(rest.begin(), rest.end(), [](bool stage) { return stage; });
    frame->quality = full ? FrameQuality::Full : whole ? FrameQuality::Refining : FrameQuality::Draft;
    frame->inputs = full ? request.inputs : pipeline_->inputs();
    if (!full) frame->occlusionShare = shareOf(frame->inputs, inputs_, pipeline_->occlusionShare());
    const auto begin = Clock::now();
    double floats = 0.0;
    for (const BufferId id : wanted_) {
        const Copy before = copies_[static_cast<std::size_t>(target)][id];
        ARS_TRY(frame->pictures[id], copyOf(id, target));
        if (frame->pictures[id] != before.image) floats += static_cast<double>(frame->pictures[id]->pixels.size());
    }
    frame->copyMs = millisecondsSince(begin);
    costs_.measured(DraftCosts::kCopy, 1e-6 * floats, frame->copyMs);
    if (request.parts) ARS_TRY_STATUS(paintParts(*frame, target));
    const std::uint64_t surfels = pipeline_->surfelVersion();
    if (!means_ || meansVersion_ != surfels) {
        ARS_TRY(std::vector<glm::vec3> means, pipeline_->surfelMeans());
        means_ = std::make_shared<const std::vector<glm::vec3>>(std::move(means));
        meansVersion_ = surfels;
    }
    frame->surfelMeans = means_;
    if (request.surfels && (!surfels_ || surfelsVersion_ != surfels)) {
        ARS_TRY(Surfels posed, pipeline_->surfels());
        surfels_ = std::make_shared<const Surfels>(std::move(posed));
        surfelsVersion_ = surfels;
    }
    if (request.surfels) frame->surfels = surfels_;
    frame->jointWorld = pipeline_->jointWorld();
    frame->stages = pipeline_->stages();
    frame->totalMs = millisecondsSince(begin_);
    shown_ = begin_ = Clock::now();
    return std::shared_ptr<const Frame>(std::move(frame));
}

} // namespace ars
