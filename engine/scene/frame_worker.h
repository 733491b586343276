#pragma once

#include "engine/frame/frame_pipeline.h"
#include "engine/scene/assets.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

namespace ars {

/// What somebody wants to see.
struct FrameRequest {
    std::shared_ptr<const AvatarAsset> avatar;
    std::shared_ptr<const LightAsset> light; ///< null: no shaded buffers
    FrameInputs inputs;                      ///< camera of the full size
    std::vector<BufferId> buffers;           ///< wanted; Opacity and Depth always come with them
    bool moving = false; ///< something is being dragged or played: drafts are welcome. The full frame follows by itself
                         ///< when the last request says false, or stands for 0.3 s.
    bool parts = false;  ///< also the picture of the nine parts
    bool surfels = false; ///< also the posed surfels (for discs)
};

/// How good a frame is; the person always sees which.
enum class FrameQuality {
    Draft,    ///< as fine as a twentieth of a second allows, or surfels of the last evaluation
    Refining, ///< full size, occlusion still becoming finer
    Full,
};
std::string_view frameQualityName(FrameQuality quality);

/// A finished frame, in host memory, immutable.
struct Frame {
    std::uint64_t request = 0; ///< number of the request that it answers
    FrameQuality quality = FrameQuality::Full;
    float occlusionShare = 1.0f; ///< of the directions taken, [0, 1]
    FrameInputs inputs;          ///< as rendered: the camera has the pictures' size
    std::shared_ptr<const AvatarAsset> avatar;
    std::shared_ptr<const LightAsset> light;
    std::map<BufferId, std::shared_ptr<const Image>> pictures; ///< AO of empty pixels is 0
    std::shared_ptr<const Image> parts; ///< RGB sRGB colours of the nine parts, blended by skin weights; 0 where empty
    std::shared_ptr<const std::vector<glm::vec3>> surfelMeans; ///< posed, world: for picking; index = surfel of the rig
    std::shared_ptr<const Surfels> surfels;                    ///< posed, where asked for
    std::vector<glm::mat4> jointWorld;                         ///< (J) world matrix of every joint
    std::array<StageReport, kFrameStageCount> stages;
    double totalMs = 0.0; ///< wall time of this frame, copies included
    double copyMs = 0.0;  ///< of bringing pictures to host memory

    const Image* picture(BufferId id) const; ///< null when absent
};

/// The colours of the nine parts, sRGB, in the order of BodyPart; also for panels and legends.
const std::array<glm::vec3, kBodyPartCount>& bodyPartColors();

/// Renders requests on a thread of its own, the newest first: requests that were overtaken are never started. While
/// nothing new comes it refines, in slices short enough to answer the next request within a few hundredths of a second.
class FrameWorker {
public:
    /// @param wake  called on the worker's thread after every finished frame or error; may be null
    explicit FrameWorker(const Device& device, std::function<void()> wake = {});
    ~FrameWorker(); ///< waits for the frame in work
    FrameWorker(const FrameWorker&) = delete;
    FrameWorker& operator=(const FrameWorker&) = delete;

    /// Never waits. Returns the request's number. The same request as the last costs nothing.
    std::uint64_t submit(FrameRequest request);
    /// The newest frame, or null.
    std::shared_ptr<const Frame> latest() const;
    /// The error of the newest request, once; nothing when it went well.
    std::optional<Error> takeError();
    /// Nothing is to be done: the newest request stands complete (or failed).
    bool idle() const;
    /// For tests and headless callers: false on timeout.
    bool waitUntilIdle(std::chrono::milliseconds timeout);

    /// Frames finished since the start, and those of the last second.
    struct Rates {
        std::uint64_t frames = 0;
        double framesPerSecond = 0.0;
    };
    Rates rates() const;
    const Device& device() const;

private:
    struct State;
    std::unique_ptr<State> state_;
};

} // namespace ars
