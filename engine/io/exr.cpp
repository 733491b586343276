#include "engine/io/exr.h"

#include "engine/core/file.h"
#include "engine/io/exr_header.h"

#include <Iex.h>
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <set>

namespace ars {

namespace {

/// The library's own bounds are global. They only back up the checks made here, so they are set once and wide.
constexpr int kLibraryMaxSide = 1 << 17;
constexpr float kHalfMax = 65504.0f;

void boundLibrary() {
    static std::once_flag once;
    std::call_once(once, [] {
        Imf::Header::setMaxImageSize(kLibraryMaxSide, kLibraryMaxSide);
        Imf::Header::setMaxTileSize(kLibraryMaxSide, kLibraryMaxSide);
    });
}

class SpanStream : public Imf::IStream {
public:
    explicit SpanStream(std::span<const std::byte> bytes) : IStream("picture"), bytes_(bytes) {}

    bool read(char out[], int count) override {
        if (count < 0 || position_ > bytes_.size() || static_cast<std::size_t>(count) > bytes_.size() - position_) {
            throw Iex::InputExc("the file ends too early");
        }
        std::memcpy(out, bytes_.data() + position_, static_cast<std::size_t>(count));
        position_ += static_cast<std::size_t>(count);
        return position_ < bytes_.size();
    }
    std::uint64_t tellg() override { return position_; }
    void seekg(std::uint64_t position) override { position_ = position; }

private:
    std::span<const std::byte> bytes_;
    std::uint64_t position_ = 0;
};

class VectorStream : public Imf::OStream {
public:
    VectorStream() : OStream("picture") {}

    void write(const char bytes[], int count) override {
        const auto size = static_cast<std::size_t>(count);
        if (position_ + size > bytes_.size()) bytes_.resize(position_ + size);
        std::memcpy(bytes_.data() + position_, bytes, size);
        position_ += size;
    }
    std::uint64_t tellp() override { return position_; }
    void seekp(std::uint64_t position) override { position_ = position; }
    std::vector<std::byte> take() { return std::move(bytes_); }

private:
    std::vector<std::byte> bytes_;
    std::size_t position_ = 0;
};

/// The library's words without the name of our stream and the last period.
std::string tidy(std::string words) {
    const std::string_view stream = " from image file \"picture\"";
    if (const std::size_t at = words.find(stream); at != words.npos) words.erase(at, stream.size());
    while (words.ends_with('.') || words.ends_with('\n')) words.pop_back();
    return words;
}

/// Runs calls into the library and turns what it throws into an error of code `blame`.
template <typename Body>
Status guarded(ErrorCode blame, std::string_view what, const Body& body) {
    try {
        body();
        return {};
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, "", fmt::format("no memory for the pixels ({})", what));
    } catch (const std::exception& error) {
        return makeError(blame, "", fmt::format("{}: {}", what, tidy(error.what())));
    } catch (...) {
        return makeError(blame, "", fmt::format("{}: the OpenEXR library failed without a word", what));
    }
}

Imath::Box2i toImath(const ExrBox& box) { return {Imath::V2i(box.x0, box.y0), Imath::V2i(box.x1, box.y1)}; }

/// Names for all channels of all parts in file order: as they are, with the part's name before those that clash.
Result<std::vector<std::vector<std::string>>> channelNames(const detail::ExrHeader& header) {
    std::map<std::string, int> uses;
    for (const auto& part : header.parts) {
        for (const auto& channel : part.info.channels) ++uses[channel.name];
    }
    std::set<std::string> taken;
    std::vector<std::vector<std::string>> names;
    for (const auto& part : header.parts) {
        names.emplace_back();
        for (const auto& channel : part.info.channels) {
            names.back().push_back(uses[channel.name] > 1 ? part.info.name + '.' + channel.name : channel.name);
            if (!taken.insert(names.back().back()).second) {
                return makeError(
                    ErrorCode::BadFile, "channels",
                    fmt::format("\"{}\" stands twice, even with the names of its parts", names.back().back()));
            }
        }
    }
    return names;
}

/// Takes memory for all channels, in the order of the parts.
Status prepareChannels(const detail::ExrHeader& header, ExrImage& image) {
    ARS_TRY(auto names, channelNames(header));
    const std::size_t pixels = std::size_t(image.dataWindow.width()) * image.dataWindow.height();
    for (std::size_t p = 0; p < header.parts.size(); ++p) {
        const auto& channels = header.parts[p].info.channels;
        for (std::size_t c = 0; c < channels.size(); ++c) {
            image.channels.push_back({std::move(names[p][c]), channels[c].type, std::vector<float>(pixels)});
        }
        for (const auto& [name, text] : header.parts[p].info.textAttributes) {
            image.textAttributes.try_emplace(name, text);
        }
    }
    return {};
}

Imf::Slice floatSlice(ExrChannel& channel, const ExrBox& window) {
    return Imf::Slice::Make(Imf::FLOAT, channel.pixels.data(), toImath(window), sizeof(float),
                            sizeof(float) * static_cast<std::size_t>(window.width()));
}

void readParts(const detail::ExrHeader& header, std::span<const std::byte> bytes, ExrImage& image) {
    SpanStream stream(bytes);
    Imf::MultiPartInputFile file(stream, 0, false);
    std::size_t next = 0;
    for (std::size_t p = 0; p < header.parts.size(); ++p) {
        const ExrPartInfo& info = header.parts[p].info;
        Imf::FrameBuffer frame;
        for (const ExrChannelInfo& channel : info.channels) {
            frame.insert(channel.name, floatSlice(image.channels[next++], image.dataWindow));
        }
        Imf::InputPart part(file, static_cast<int>(p));
        part.setFrameBuffer(frame);
        part.readPixels(info.dataWindow.y0, info.dataWindow.y1);
    }
}

Status checkChannel(const ExrChannel& channel, std::size_t pixels) {
    const auto invalid = [&](std::string message) {
        return makeError(ErrorCode::InvalidArgument, fmt::format("channel \"{}\"", channel.name), std::move(message));
    };
    if (channel.name.empty() || channel.name.size() > 255 || channel.name.find('\0') != channel.name.npos) {
        return invalid("a channel's name has 1 to 255 bytes, none of them zero");
    }
    if (channel.pixels.size() != pixels) {
        return invalid(fmt::format("{} values, the data window has {} pixels", channel.pixels.size(), pixels));
    }
    for (const float value : channel.pixels) {
        if (channel.type == ExrPixelType::Half && std::isfinite(value) && std::abs(value) > kHalfMax) {
            return invalid(fmt::format("{} is beyond a half ({}); write it as float", value, kHalfMax));
        }
        if (channel.type == ExrPixelType::UInt && !(value >= 0.0f && value < 0x1p32f && value == std::floor(value))) {
            return invalid(fmt::format("{} is no unsigned integer", value));
        }
    }
    return {};
}

Status checkWritable(const ExrImage& image) {
    for (const ExrBox* box : {&image.dataWindow, &image.displayWindow}) {
        if (box->x1 < box->x0 || box->y1 < box->y0) {
            return makeError(ErrorCode::InvalidArgument, box == &image.dataWindow ? "dataWindow" : "displayWindow",
                             fmt::format("({}, {}) to ({}, {}) has no pixel", box->x0, box->y0, box->x1, box->y1));
        }
    }
    if (image.channels.empty()) return makeError(ErrorCode::InvalidArgument, "", "a picture needs a channel");
    const std::size_t pixels = std::size_t(image.dataWindow.width()) * image.dataWindow.height();
    std::set<std::string> names;
    for (const ExrChannel& channel : image.channels) {
        ARS_TRY_STATUS(checkChannel(channel, pixels));
        if (!names.insert(channel.name).second) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("channel \"{}\"", channel.name),
                             "it stands twice");
        }
    }
    const Imf::Header plain;
    for (const auto& [name, text] : image.textAttributes) {
        const bool taken = plain.find(name) != plain.end() || name == "name" || name == "type" || name == "tiles" ||
                           name == "chunkCount" || name == "version" || name == "dwaCompressionLevel";
        if (taken || name.empty() || name.size() > 255 || text.size() > std::size_t(std::numeric_limits<int>::max())) {
            return makeError(ErrorCode::InvalidArgument, fmt::format("text \"{}\"", name.substr(0, 60)),
                             "an attribute of 1 to 255 bytes that OpenEXR does not use itself is needed");
        }
    }
    return {};
}

Imf::Header makeHeader(const ExrImage& image) {
    Imf::Header header(toImath(image.displayWindow), toImath(image.dataWindow), 1.0f, Imath::V2f(0.0f, 0.0f), 1.0f,
                       Imf::INCREASING_Y, static_cast<Imf::Compression>(image.compression));
    if (image.compression == ExrCompression::Dwaa || image.compression == ExrCompression::Dwab) {
        header.dwaCompressionLevel() = image.dwaLevel;
    }
    for (const ExrChannel& channel : image.channels) {
        header.channels().insert(channel.name, Imf::Channel(static_cast<Imf::PixelType>(channel.type)));
    }
    for (const auto& [name, text] : image.textAttributes) header.insert(name, Imf::StringAttribute(text));
    return header;
}

/// The bytes of a channel in its file type; the library converts when reading, but not when writing.
std::vector<std::byte> storedPixels(const ExrChannel& channel) {
    const std::size_t size = channel.type == ExrPixelType::Half ? sizeof(half) : sizeof(float);
    std::vector<std::byte> bytes(channel.pixels.size() * size);
    for (std::size_t i = 0; i < channel.pixels.size(); ++i) {
        const float value = channel.pixels[i];
        if (channel.type == ExrPixelType::Half) {
            const half converted(value);
            std::memcpy(bytes.data() + i * size, &converted, size);
        } else if (channel.type == ExrPixelType::UInt) {
            const auto converted = static_cast<std::uint32_t>(value);
            std::memcpy(bytes.data() + i * size, &converted, size);
        } else {
            std::memcpy(bytes.data() + i * size, &value, size);
        }
    }
    return bytes;
}

void writeParts(const ExrImage& image, VectorStream& stream) {
    std::vector<std::vector<std::byte>> stored;
    Imf::FrameBuffer frame;
    for (const ExrChannel& channel : image.channels) {
        stored.push_back(storedPixels(channel));
        const std::size_t size = stored.back().size() / channel.pixels.size();
        frame.insert(channel.name, Imf::Slice::Make(static_cast<Imf::PixelType>(channel.type), stored.back().data(),
                                                    toImath(image.dataWindow), size,
                                                    size * static_cast<std::size_t>(image.dataWindow.width())));
    }
    Imf::OutputFile file(stream, makeHeader(image), 0);
    file.setFrameBuffer(frame);
    file.writePixels(image.dataWindow.height());
}

} // namespace

Result<ExrImage> parseExr(std::span<const std::byte> bytes, const ReadLimits& limits) {
    boundLibrary();
    ARS_TRY(const detail::ExrHeader header, detail::readExrHeader(bytes));
    ExrImage image;
    image.dataWindow = detail::exrDataWindow(header);
    image.displayWindow = header.parts.front().info.displayWindow;
    image.compression = header.parts.front().info.compression;
    ARS_TRY_STATUS(detail::checkExrHeader(header, image.dataWindow, limits));
    ARS_TRY_STATUS(detail::checkExrBlocks(header, bytes));
    ARS_TRY_STATUS(prepareChannels(header, image));
    ARS_TRY_STATUS(guarded(ErrorCode::BadFile, "broken EXR", [&] { readParts(header, bytes, image); }));
    return image;
}

Result<ExrImage> readExr(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const auto bytes, readFile(path, limits));
    auto image = parseExr(bytes, limits);
    if (!image) return atPlace(std::move(image).error(), path.string());
    return image;
}

Result<std::vector<std::byte>> encodeExr(const ExrImage& image) {
    boundLibrary();
    ARS_TRY_STATUS(checkWritable(image));
    VectorStream stream;
    ARS_TRY_STATUS(guarded(ErrorCode::InvalidArgument, "cannot write the EXR", [&] { writeParts(image, stream); }));
    return stream.take();
}

Status writeExr(const std::filesystem::path& path, const ExrImage& image) {
    auto bytes = encodeExr(image);
    if (!bytes) return atPlace(std::move(bytes).error(), path.string());
    return writeFileAtomic(path, *bytes);
}

Result<ExrInfo> parseExrInfo(std::span<const std::byte> bytes) {
    ARS_TRY(detail::ExrHeader header, detail::readExrHeader(bytes));
    ExrInfo info;
    std::set<std::string> layers;
    for (detail::ExrPart& part : header.parts) {
        for (const ExrChannelInfo& channel : part.info.channels) {
            const std::size_t dot = channel.name.rfind('.');
            layers.insert(dot == std::string::npos ? "" : channel.name.substr(0, dot));
        }
        info.parts.push_back(std::move(part.info));
    }
    info.layers.assign(layers.begin(), layers.end());
    return info;
}

Result<ExrInfo> listExr(const std::filesystem::path& path, const ReadLimits& limits) {
    // A header may carry a document of megabytes, but mostly it does not.
    for (std::size_t head = 1 << 16;; head <<= 4) {
        ARS_TRY(const auto bytes, readFileHead(path, head));
        auto info = parseExrInfo(bytes);
        if (info) return info;
        if (bytes.size() < head || head >= limits.maxFileBytes) return atPlace(std::move(info).error(), path.string());
    }
}

} // namespace ars
