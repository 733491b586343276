#include "engine/io/video.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars {

namespace {

/// The last line that ffmpeg printed: it says what was wrong.
std::string lastLine(std::string text) {
    while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
    return text.substr(text.find_last_of('\n') + 1);
}

std::vector<std::string> encoderCommand(const std::filesystem::path& path, const VideoOptions& options) {
    std::vector<std::string> command{
        "ffmpeg", "-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24", "-video_size",
        fmt::format("{}x{}", options.width, options.height), "-framerate", fmt::format("{}", options.framesPerSecond),
        "-i", "pipe:0", "-an",
        // Pixels are sRGB, whose primaries are Rec.709's: without the tags players guess by the size of the picture.
        "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p", "-c:v",
        "libx264", "-preset", "medium", "-crf", fmt::format("{}", options.quality), "-colorspace", "bt709",
        "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv", "-movflags",
        "+faststart+use_metadata_tags"};
    for (const auto& [name, value] : options.metadata) {
        command.push_back("-metadata");
        command.push_back(name + "=" + value);
    }
    command.insert(command.end(), {"-f", "mp4", path.string()});
    return command;
}

} // namespace

Result<VideoWriter> VideoWriter::open(const std::filesystem::path& path, const VideoOptions& options) {
    if (options.width < 1 || options.height < 1 || options.width > 16384 || options.height > 16384) {
        return makeError(
            ErrorCode::InvalidArgument, path.string(),
            fmt::format("a video of {}x{} pixels; sides must be 1 to 16384", options.width, options.height));
    }
    if (!(options.framesPerSecond >= 1.0 / 60.0) || options.framesPerSecond > 1000.0) {
        return makeError(ErrorCode::InvalidArgument, path.string(),
                         fmt::format("{} frames a second; expected 1/60 to 1000", options.framesPerSecond));
    }
    ARS_TRY(AtomicFile file, AtomicFile::open(path));
    auto encoder = FedProcess::start(encoderCommand(file.temporaryPath(), options));
    if (!encoder && encoder.error().code == ErrorCode::NotFound) {
        return makeError(ErrorCode::Unavailable, path.string(),
                         "writing MP4 needs the program ffmpeg, which is not on PATH; install the package ffmpeg");
    }
    if (!encoder) return std::move(encoder).error();
    const std::size_t bytes = static_cast<std::size_t>(options.width) * static_cast<std::size_t>(options.height) * 3;
    return VideoWriter(std::move(file), std::move(*encoder), path, bytes);
}

Status VideoWriter::add(std::span<const std::uint8_t> rgb) {
    if (rgb.size() != frameBytes_) {
        return makeError(ErrorCode::InvalidArgument, path_.string(),
                         fmt::format("a frame of {} bytes, expected {}", rgb.size(), frameBytes_));
    }
    if (Status written = encoder_.write(std::as_bytes(rgb)); !written) {
        const auto ended = encoder_.finish();
        return makeError(ErrorCode::Io, path_.string(),
                         fmt::format("ffmpeg gave up: {}", ended ? lastLine(ended->errors) : written.error().message));
    }
    return {};
}

Status VideoWriter::finish() {
    ARS_TRY(const ProcessResult ended, encoder_.finish());
    if (ended.exitCode != 0) {
        return makeError(ErrorCode::Io, path_.string(),
                         fmt::format("ffmpeg ended with code {}: {}", ended.exitCode, lastLine(ended.errors)));
    }
    return file_.commit();
}

} // namespace ars
