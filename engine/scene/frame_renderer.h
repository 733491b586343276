#pragma once

#include "engine/scene/frame_worker.h"
#include "engine/scene/part_picture.h"

#include <array>
#include <chrono>
#include <map>
#include <memory>
#include <vector>

namespace ars {

/// A size and sampling at which something that moves is drawn, finest first.
struct DraftLevel {
    double scale = 1.0;  ///< of both sides
    int directions = 64; ///< of interactive occlusion, at most
    int rays = 32;       ///< of mesh_rays, at most
};
inline constexpr int kDraftLevelCount = 5;
const std::array<DraftLevel, kDraftLevelCount>& draftLevels();
/// The level of a first draft, of which nothing has been measured.
inline constexpr int kFirstDraftLevel = 2;

/// What a stage has cost lately, so that what it would cost at another size can be foretold.
class DraftCosts {
public:
    void measured(int stage, double work, double milliseconds);
    bool known(int stage) const { return perWork_[static_cast<std::size_t>(stage)] >= 0.0; }
    double foretold(int stage, double work) const { return perWork_[static_cast<std::size_t>(stage)] * work; }

    static constexpr int kCopy = kFrameStageCount; ///< bringing pictures to host memory, a stage of its own
    static constexpr int kParts = kCopy + 1;       ///< painting the parts
    static constexpr int kCount = kParts + 1;

private:
    std::array<double, kCount> perWork_{-1, -1, -1, -1, -1, -1, -1};
};

/// How long an avatar's last evaluations took. The slowest of a few counts: a turned finger may cost its networks
/// nothing and the next elbow all, and what only the first run of a network costs is soon forgotten.
class EvaluationTimes {
public:
    void measured(double milliseconds);
    /// Whether there were some and none took longer.
    bool quick(double milliseconds) const;

private:
    std::array<double, 4> last_{-1, -1, -1, -1};
    int next_ = 0;
};

/// The finest level whose foretold time fits, with hysteresis: changing to a finer one asks for room to spare, so that
/// the size does not flicker.
/// @param milliseconds  foretold, of each level; negative where unknown
/// @param current       the level of the last draft
int chooseDraftLevel(const std::array<double, kDraftLevelCount>& milliseconds, int current);
/// Time of a draft that is aimed at: 25 frames a second.
inline constexpr double kDraftBudgetMs = 40.0;

/// What FrameWorker does on its thread: pipelines, levels and pictures, without the thread. One thread at a time.
class FrameRenderer {
public:
    explicit FrameRenderer(const Device& device) : device_(device) {}

    /// A frame now, as good as a twentieth of a second allows.
    Result<std::shared_ptr<const Frame>> draft(const FrameRequest& request, std::uint64_t number);
    /// One step towards the full frame. Null where the step ended without a picture worth showing; the next may.
    Result<std::shared_ptr<const Frame>> advance(const FrameRequest& request, std::uint64_t number);
    /// The last call gave the full frame.
    bool complete() const { return complete_; }

private:
    /// A picture in host memory and what it is a copy of.
    struct Copy {
        std::uint64_t version = 0;
        std::shared_ptr<const Image> image;
    };

    Status prepare(const FrameRequest& request);
    FrameInputs draftInputs(const FrameInputs& full, int level) const;
    double foretoldMs(const FrameInputs& inputs, FrameTarget target, const FrameRequest& request) const;
    Status render(const FrameInputs& inputs, const std::vector<BufferId>& buffers, FrameTarget target);
    void adaptSlices(double milliseconds);
    Result<std::shared_ptr<const Frame>> finish(const FrameRequest& request, std::uint64_t number, FrameTarget target);
    Result<std::shared_ptr<const Image>> copyOf(BufferId id, FrameTarget target);
    Status paintParts(Frame& frame, FrameTarget target);
    std::shared_ptr<Image> freeImage(std::size_t values);

    Device device_;
    std::shared_ptr<const AvatarAsset> avatar_;
    std::unique_ptr<FramePipeline> pipeline_;
    FrameInputs inputs_;           ///< of the request, as the pipeline takes them
    std::vector<BufferId> wanted_; ///< of the request, as far as they can be rendered
    int level_ = kFirstDraftLevel;
    DraftCosts costs_;
    EvaluationTimes evaluations_; ///< of avatar_, for other poses
    bool complete_ = false;
    double bands_ = 1.0;          ///< of refining passes
    std::uint64_t advancing_ = 0; ///< number of the request that advance() works on
    std::chrono::steady_clock::time_point begin_, shown_;

    std::array<std::map<BufferId, Copy>, kFrameTargetCount> copies_;
    std::array<Copy, kFrameTargetCount> parts_;
    std::array<Camera, kFrameTargetCount> partsCamera_;
    PartPicture partPicture_;
    std::uint64_t meansVersion_ = 0, surfelsVersion_ = 0;
    std::shared_ptr<const std::vector<glm::vec3>> means_;
    std::shared_ptr<const Surfels> surfels_;
    std::vector<std::shared_ptr<Image>> pool_; ///< images made here; those that nobody else holds are used again
};

/// R+ and R- are posed where one of them is to be seen.
FrameInputs inputsForBuffers(FrameInputs inputs, const std::vector<BufferId>& buffers);

} // namespace ars
