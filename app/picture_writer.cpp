#include "app/picture_writer.h"

#include "app/text.h"
#include "engine/io/png.h"

#include <fmt/format.h>

namespace ars::app {

Result<PictureFormats> parseFormats(const std::string& text) {
    PictureFormats formats;
    std::size_t begin = 0;
    while (begin <= text.size()) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        const std::string word = text.substr(begin, end - begin);
        begin = end + 1;
        if (word == "png")
            formats.png = true;
        else if (word == "exr")
            formats.exr = true;
        else if (word == "buffers")
            formats.buffers = true;
        else if (word == "mp4")
            formats.mp4 = true;
        else {
            return makeError(ErrorCode::InvalidArgument, "--write",
                             fmt::format("expected png, exr, buffers or mp4 with commas between them, found \"{}\"",
                                         printable(word)));
        }
    }
    return formats;
}

PictureWriter::PictureWriter(std::filesystem::path folder, PictureFormats formats, std::vector<BufferId> buffers)
    : folder_(std::move(folder)), formats_(formats), buffers_(std::move(buffers)) {}

Status PictureWriter::add(const WrittenFrame& frame) {
    PngWriteOptions png;
    png.text["ars"] = frame.document;
    if (formats_.png || formats_.mp4) {
        ARS_TRY(const Image shown, frame.shown(frame.main, true));
        if (formats_.png) {
            files_.push_back(folder_ / fmt::format("{:04}.png", frame.number));
            ARS_TRY_STATUS(writePng(files_.back(), shown, png));
        }
        if (formats_.mp4) ARS_TRY_STATUS(addFilmFrame(shown));
    }
    if (!formats_.exr && !formats_.buffers) return {};
    ExrImage exr;
    exr.textAttributes["ars"] = frame.document;
    for (const BufferId id : buffers_) {
        if (formats_.exr) {
            ARS_TRY(const Image picture, frame.picture(id));
            ARS_TRY_STATUS(addBufferLayer(exr, id, picture));
        }
        if (formats_.buffers) {
            ARS_TRY(const Image shown, frame.shown(id, false));
            files_.push_back(folder_ / fmt::format("{:04}_{}.png", frame.number, bufferInfo(id).name));
            ARS_TRY_STATUS(writePng(files_.back(), shown, png));
        }
    }
    if (!formats_.exr) return {};
    files_.push_back(folder_ / fmt::format("{:04}.exr", frame.number));
    return writeExr(files_.back(), exr);
}

Status PictureWriter::addFilmFrame(const Image& shown) {
    if (!film_) {
        VideoFormat options;
        options.width = shown.width;
        options.height = shown.height;
        options.framesPerSecond = framesPerSecond;
        options.metadata["comment"] = filmDocument;
        filmPath_ = folder_ / "beauty.mp4";
        ARS_TRY(VideoWriter film, VideoWriter::open(filmPath_, options));
        film_ = std::move(film);
    }
    return film_->add(displayBytes(shown));
}

Status PictureWriter::finish() {
    if (!film_) return {};
    ARS_TRY_STATUS(film_->finish());
    film_.reset();
    files_.push_back(filmPath_);
    return {};
}

} // namespace ars::app
