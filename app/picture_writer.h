#pragma once

#include "app/command.h"
#include "engine/frame/display.h"
#include "engine/frame/frame_pipeline.h"
#include "engine/io/video.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace ars::app {

/// Which files a rendering leaves.
struct PictureFormats {
    bool png = false;     ///< NNNN.png, the shaded picture
    bool exr = false;     ///< NNNN.exr, every wanted buffer as a layer
    bool buffers = false; ///< NNNN_albedo.png ..., every wanted buffer with its colour map
    bool mp4 = false;     ///< beauty.mp4
};
/// "png,exr,buffers,mp4" in any choice. InvalidArgument (place --write) otherwise.
Result<PictureFormats> parseFormats(const std::string& text);

/// Writes the frames of one rendering, one after the other, in a folder. Every file carries the document that made it:
/// PNG and EXR under "ars", MP4 under "comment".
class PictureWriter {
public:
    PictureWriter(std::filesystem::path folder, PictureFormats formats, std::vector<BufferId> buffers,
                  DisplaySettings display);

    /// @param environment  put behind the shaded picture where given
    Status add(const FramePipeline& pipeline, std::size_t number, const Json& document, const Environment* environment);
    /// Closes the film.
    Status finish();

    double framesPerSecond = 30.0;
    Json filmDocument; ///< what the film carries; set before the first frame
    const std::vector<std::filesystem::path>& files() const { return files_; }

private:
    Status addFilmFrame(const Image& shown);

    std::filesystem::path folder_;
    PictureFormats formats_;
    std::vector<BufferId> buffers_;
    DisplaySettings display_;
    std::optional<VideoWriter> film_;
    std::filesystem::path filmPath_;
    std::vector<std::filesystem::path> files_;
};

} // namespace ars::app
