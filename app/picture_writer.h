#pragma once

#include "app/command.h"
#include "engine/frame/display.h"
#include "engine/io/video.h"

#include <filesystem>
#include <functional>
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

/// One frame that is to be written.
struct WrittenFrame {
    std::size_t number = 0;
    std::string document;                               ///< what made it, as text
    BufferId main = BufferId::Beauty;                   ///< the buffer of NNNN.png and of the film
    std::function<Result<Image>(BufferId)> picture;     ///< a buffer as it was computed
    std::function<Result<Image>(BufferId, bool)> shown; ///< as people see it; true: with the light's picture behind it
};

/// Writes the frames of one rendering, one after the other, in a folder. Every file carries the document that made it:
/// PNG and EXR under "ars", MP4 under "comment".
class PictureWriter {
public:
    PictureWriter(std::filesystem::path folder, PictureFormats formats, std::vector<BufferId> buffers);

    Status add(const WrittenFrame& frame);
    /// Closes the film.
    Status finish();

    double framesPerSecond = 30.0;
    std::string filmDocument; ///< what the film carries; set before the first frame
    const std::vector<std::filesystem::path>& files() const { return files_; }

private:
    Status addFilmFrame(const Image& shown);

    std::filesystem::path folder_;
    PictureFormats formats_;
    std::vector<BufferId> buffers_;
    std::optional<VideoWriter> film_;
    std::filesystem::path filmPath_;
    std::vector<std::filesystem::path> files_;
};

} // namespace ars::app
