#pragma once

#include "engine/core/progress.h"
#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"
#include "engine/scene/assets.h"
#include "engine/scene/document.h"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace ars {

/// A still picture of a document at a time.
struct ScreenshotOptions {
    std::filesystem::path file; ///< .png: the buffer as it is shown; .exr: `buffers` as layers
    int width = 960;
    int height = 720;
    bool transparent = false;      ///< PNG: straight alpha instead of background and backdrop
    std::vector<BufferId> buffers; ///< of an EXR; empty: all but R+ and R-
};

/// A film of a document's timeline range.
struct VideoOptions {
    std::filesystem::path file; ///< .mp4, or a folder: NNNN.png
    int width = 960;
    int height = 720;
    double startS = 0.0; ///< both 0: the timeline's range
    double endS = 0.0;
    double framesPerSecond = 0.0; ///< 0: the timeline's
};

/// Full quality, with the document in the file's metadata (paths absolute), written to a temporary name first. These
/// are what the window's dialogs and `ars render --project` run, so that both give the same pictures. The avatar's
/// evaluator is called on this thread: one that cannot take two callers must not be in use elsewhere meanwhile.
/// @return InvalidArgument for sizes outside [1, 16384] (MP4: even sides) or an ending that is none; Io; Cancelled.
Status writeScreenshot(const Document& document, const SceneAssets& assets, const Device& device,
                       const ScreenshotOptions& options, const ProgressFunction& progress = {});
Status writeVideo(const Document& document, const SceneAssets& assets, const Device& device,
                  const VideoOptions& options, const ProgressFunction& progress = {});

/// What a picture of a document carries under "ars": documentToJson with absolute paths, and under "picture" the facts
/// that are no part of it (program, device, number of surfels).
std::string pictureText(const Document& document, const SceneAssets& assets, const Device& device);

/// One frame of a document in full quality: renders, and keeps what the next frame can use. For one thread.
class DocumentRenderer {
public:
    /// InvalidArgument where the avatar is not loaded; Unavailable without the device.
    static Result<DocumentRenderer> create(const SceneAssets& assets, const Device& device);

    /// Shaded buffers are left out where there is no light.
    /// @param progress  within this frame; may be null
    Status render(const Document& document, double timeS, int width, int height, const std::vector<BufferId>& buffers,
                  const ProgressFunction& progress = {});
    /// Of the last frame; NotFound when it was not wanted.
    Result<Image> picture(BufferId id) const { return pipeline_->picture(id); }
    /// A buffer of the last frame as the view shows it (shownPicture).
    Result<Image> shown(const Document& document, BufferId buffer, bool transparent = false) const;
    const FramePipeline& pipeline() const { return *pipeline_; }

private:
    DocumentRenderer(const SceneAssets& assets, std::unique_ptr<FramePipeline> pipeline);
    SceneAssets assets_;
    std::unique_ptr<FramePipeline> pipeline_;
};

/// The times of a film's frames: from the start in steps of the rate, the end left out, so that the film lasts as long
/// as the range and a loop does not show its seam twice.
std::vector<double> filmTimes(const Document& document, const VideoOptions& options);

/// Buffers of an EXR where none are chosen: all but R+ and R-.
std::vector<BufferId> allViewedBuffers();

/// The picture that a view shows: one buffer with range, colour map, exposure, curve, background and backdrop.
/// Looks like the window's (engine/gl/presenter); without an environment its backdrop is the background's colour.
/// @param picture      of FramePipeline or Frame, with the camera's size
/// @param transparent  straight alpha instead of background and backdrop
/// @return sRGB-encoded RGB, or RGBA where transparent; InvalidArgument where sizes differ
Result<Image> shownPicture(const Document& document, BufferId buffer, const Image& picture, const Image& opacity,
                           const Camera& camera, const EnvironmentPlacement& placement, const Environment* environment,
                           bool transparent = false);

} // namespace ars
