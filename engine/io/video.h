#pragma once

#include "engine/core/error.h"
#include "engine/core/file.h"
#include "engine/core/process.h"
#include "engine/io/image.h"

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace ars {

struct VideoFormat {
    int width = 0;
    int height = 0;
    double framesPerSecond = 30.0;
    int quality = 16;                            ///< x264's constant rate factor: 0 lossless, 16 hardly
                                                 ///< visible, 51 worst
    std::map<std::string, std::string> metadata; ///< UTF-8; "comment" is shown by players, ffprobe lists all
};

/// Writes an MP4 (H.264, 4:2:0, Rec.709) frame by frame through the program
/// `ffmpeg`. The file appears under its name when finish() succeeds; before,
/// nothing stands there or what stood there stays. Odd sides are padded by one
/// pixel.
class VideoWriter {
public:
    /// InvalidArgument: sizes or rate out of range. Unavailable: no ffmpeg on
    /// PATH, with what to install.
    static Result<VideoWriter> open(const std::filesystem::path& path, const VideoFormat& options);

    /// The next frame: (height, width, 3) sRGB-encoded bytes. InvalidArgument for
    /// another size; Io with ffmpeg's words.
    Status add(std::span<const std::uint8_t> rgb);
    Status finish();

private:
    VideoWriter(AtomicFile file, std::shared_ptr<const int> metadata, FedProcess encoder, std::filesystem::path path,
                std::size_t frameBytes)
        : file_(std::move(file)), metadata_(std::move(metadata)), encoder_(std::move(encoder)), path_(std::move(path)),
          frameBytes_(frameBytes) {}

    AtomicFile file_;
    std::shared_ptr<const int> metadata_; ///< descriptor that ffmpeg reads the metadata from
    FedProcess encoder_;
    std::filesystem::path path_;
    std::size_t frameBytes_ = 0;
};

} // namespace ars
