#include "engine/io/video.h"

#include <fmt/format.h>

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>

namespace ars {

namespace {

/// The last line that ffmpeg printed: it says what was wrong.
std::string lastLine(std::string text) {
    while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
    return text.substr(text.find_last_of('\n') + 1);
}

std::vector<std::string> encoderCommand(const std::filesystem::path& path, const std::string& metadata,
                                        const VideoFormat& options) {
    std::vector<std::string> command{
        "ffmpeg", "-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24", "-video_size",
        fmt::format("{}x{}", options.width, options.height), "-framerate", fmt::format("{}", options.framesPerSecond),
        "-i", "pipe:0", "-f", "ffmetadata", "-i", metadata, "-map_metadata", "1", "-an",
        // Pixels are sRGB, whose primaries are Rec.709's: without the tags
        // players guess by the size of the picture.
        "-vf",
        "pad=ceil(iw/2)*2:ceil(ih/"
        "2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p",
        "-c:v", "libx264", "-preset", "medium", "-crf", fmt::format("{}", options.quality), "-colorspace", "bt709",
        "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv", "-movflags",
        "+faststart+use_metadata_tags"};
    command.insert(command.end(), {"-f", "mp4", path.string()});
    return command;
}

/// The metadata as a nameless file of ffmpeg's own text format: an argument may
/// have 128 KiB at most, which the document of a longer animation exceeds.
Result<std::shared_ptr<const int>> metadataFile(const std::map<std::string, std::string>& metadata) {
    std::string text = ";FFMETADATA1\n";
    for (const auto& [name, value] : metadata) {
        for (const std::string_view part :
             {std::string_view(name), std::string_view("\0", 1), std::string_view(value)}) {
            for (const char c : part) {
                if (c == '=' || c == ';' || c == '#' || c == '\\' || c == '\n') text += '\\';
                text += c == '\0' ? '=' : c;
            }
        }
        text += '\n';
    }
    const int descriptor = ::memfd_create("metadata", MFD_CLOEXEC);
    if (descriptor < 0) return makeError(ErrorCode::Io, "", "no memory for the film's metadata");
    const std::shared_ptr<const int> file(new int(descriptor), [](const int* d) {
        ::close(*d);
        delete d;
    });
    for (std::size_t done = 0; done < text.size();) {
        const ssize_t put = ::write(descriptor, text.data() + done, text.size() - done);
        if (put < 0 && errno == EINTR) continue;
        if (put <= 0) return makeError(ErrorCode::Io, "", "no memory for the film's metadata");
        done += static_cast<std::size_t>(put);
    }
    return file;
}

} // namespace

Result<VideoWriter> VideoWriter::open(const std::filesystem::path& path, const VideoFormat& options) {
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
    auto metadata = metadataFile(options.metadata);
    if (!metadata) return atPlace(std::move(metadata).error(), path.string());
    const std::string metadataPath = fmt::format("/proc/{}/fd/{}", ::getpid(), **metadata);
    auto encoder = FedProcess::start(encoderCommand(file.temporaryPath(), metadataPath, options));
    if (!encoder && encoder.error().code == ErrorCode::NotFound) {
        return makeError(ErrorCode::Unavailable, path.string(),
                         "writing MP4 needs the program ffmpeg, which is not on "
                         "PATH; install the package ffmpeg");
    }
    if (!encoder) return std::move(encoder).error();
    const std::size_t bytes = static_cast<std::size_t>(options.width) * static_cast<std::size_t>(options.height) * 3;
    return VideoWriter(std::move(file), std::move(*metadata), std::move(*encoder), path, bytes);
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
