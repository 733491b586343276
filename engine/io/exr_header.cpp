#include "engine/io/exr_header.h"

#include "engine/io/byte_reader.h"

#include <algorithm>
#include <bit>
#include <set>

namespace ars::detail {

namespace {

constexpr std::uint32_t kMagic = 20000630;
constexpr std::uint32_t kTiledFlag = 0x200;
constexpr std::uint32_t kDeepFlag = 0x800;
constexpr std::uint32_t kMultipartFlag = 0x1000;
constexpr std::uint32_t kKnownFlags = 0x1e00; ///< with 0x400: names longer than 31 bytes
constexpr std::size_t kMaxName = 255;
constexpr std::int32_t kMaxCoordinate = (1 << 30) - 2; // a width still fits an int
constexpr int kMaxCompression = static_cast<int>(ExrCompression::Dwab);
/// deflate reaches 1032, the run lengths of RLE 64, of PIZ 410.
constexpr std::uint64_t kMaxRatio = 1100;

Error badExr(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

/// A text that ends with a zero byte.
Result<std::string> readName(ByteReader& reader, std::string_view what) {
    std::string name;
    while (true) {
        ARS_TRY(const char c, reader.read<char>(what));
        if (c == 0) return name;
        if (name.size() == kMaxName) {
            return badExr(fmt::format("byte {}", reader.position()),
                          fmt::format("a name beyond 255 bytes for {}", what));
        }
        name += c;
    }
}

Result<ExrBox> readBox(ByteReader& value, std::string_view name) {
    ARS_TRY(const auto corners, (value.read<std::array<std::int32_t, 4>>(name)));
    const ExrBox box{corners[0], corners[1], corners[2], corners[3]};
    const bool inRange = std::all_of(corners.begin(), corners.end(),
                                     [](std::int32_t c) { return c >= -kMaxCoordinate && c <= kMaxCoordinate; });
    if (!inRange || box.x1 < box.x0 || box.y1 < box.y0) {
        return badExr(std::string(name),
                      fmt::format("expected a window of at least one pixel, found ({}, {}) to ({}, {})", box.x0, box.y0,
                                  box.x1, box.y1));
    }
    return box;
}

Result<std::vector<ExrChannelInfo>> readChannels(ByteReader& value) {
    struct Stored {
        std::int32_t type;
        std::array<std::uint8_t, 4> linearAndReserved;
        std::int32_t xSampling;
        std::int32_t ySampling;
    };
    std::vector<ExrChannelInfo> channels;
    std::set<std::string> names;
    while (true) {
        ARS_TRY(std::string name, readName(value, "a channel name"));
        if (name.empty()) break;
        ARS_TRY(const Stored stored, value.read<Stored>("a channel"));
        if (stored.type < 0 || stored.type > 2 || stored.xSampling < 1 || stored.ySampling < 1) {
            return badExr(
                fmt::format("channel \"{}\"", name),
                fmt::format("type {} (0 to 2) with sampling {}x{}", stored.type, stored.xSampling, stored.ySampling));
        }
        if (!names.insert(name).second) return badExr("channels", fmt::format("\"{}\" stands twice", name));
        channels.push_back(
            {std::move(name), static_cast<ExrPixelType>(stored.type), stored.xSampling, stored.ySampling});
    }
    if (channels.empty()) return badExr("channels", "expected at least one channel");
    return channels;
}

Result<ExrTiles> readTiles(ByteReader& value) {
    ExrTiles tiles;
    ARS_TRY(tiles.width, value.read<std::uint32_t>("tiles"));
    ARS_TRY(tiles.height, value.read<std::uint32_t>("tiles"));
    ARS_TRY(const auto mode, value.read<std::uint8_t>("tiles"));
    tiles.levelMode = mode & 15;
    tiles.roundUp = (mode >> 4) == 1;
    if (tiles.width == 0 || tiles.height == 0 || tiles.levelMode > 2 || (mode >> 4) > 1) {
        return badExr("tiles", fmt::format("{}x{} pixels, mode {}", tiles.width, tiles.height, mode));
    }
    return tiles;
}

struct Attribute {
    std::string name;
    std::string type;
    std::span<const std::byte> value;
};

/// The type that the format demands of the attributes that are used here.
std::string_view demandedType(std::string_view name) {
    if (name == "channels") return "chlist";
    if (name == "compression") return "compression";
    if (name == "dataWindow" || name == "displayWindow") return "box2i";
    if (name == "tiles") return "tiledesc";
    if (name == "chunkCount") return "int";
    if (name == "chromaticities") return "chromaticities";
    if (name == "name" || name == "type") return "string";
    return "";
}

Status applyAttribute(const Attribute& attribute, ExrPart& part, std::string& type) {
    const std::string_view demanded = demandedType(attribute.name);
    if (!demanded.empty() && attribute.type != demanded) {
        return badExr("", fmt::format("expected type {}, found \"{}\"", demanded, attribute.type.substr(0, 40)));
    }
    ByteReader value(attribute.value);
    const auto text = [&] {
        return std::string(reinterpret_cast<const char*>(attribute.value.data()), attribute.value.size());
    };
    if (attribute.name == "channels") {
        ARS_TRY(part.info.channels, readChannels(value));
    } else if (attribute.name == "compression") {
        ARS_TRY(const auto code, value.read<std::uint8_t>("compression"));
        part.compressionCode = code;
        if (code <= kMaxCompression) part.info.compression = static_cast<ExrCompression>(code);
    } else if (attribute.name == "dataWindow") {
        ARS_TRY(part.info.dataWindow, readBox(value, attribute.name));
    } else if (attribute.name == "displayWindow") {
        ARS_TRY(part.info.displayWindow, readBox(value, attribute.name));
    } else if (attribute.name == "tiles") {
        ARS_TRY(part.tiles, readTiles(value));
    } else if (attribute.name == "chunkCount") {
        ARS_TRY(part.declaredBlocks, value.read<std::int32_t>("chunkCount"));
        if (part.declaredBlocks < 0) return badExr("", fmt::format("{} blocks", part.declaredBlocks));
    } else if (attribute.name == "chromaticities") {
        ARS_TRY(const auto corners, (value.read<std::array<float, 8>>("chromaticities")));
        part.info.chromaticities = corners;
    } else if (attribute.name == "name") {
        part.info.name = text();
    } else if (attribute.name == "type") {
        type = text();
    } else if (attribute.type == "string") {
        part.info.textAttributes[attribute.name] = text();
    }
    return {};
}

Status applyType(const std::string& type, std::uint32_t flags, const std::set<std::string>& names, ExrPart& part) {
    part.info.tiled = (flags & kTiledFlag) != 0;
    part.info.deep = (flags & kDeepFlag) != 0;
    if (!type.empty()) {
        part.info.tiled = type == "tiledimage" || type == "deeptile";
        part.info.deep = type == "deepscanline" || type == "deeptile";
        if (!part.info.tiled && !part.info.deep && type != "scanlineimage") {
            return badExr("type", fmt::format("\"{}\" is no kind of part", type.substr(0, 40)));
        }
    }
    const bool flagged = (flags & (kTiledFlag | kDeepFlag)) != 0;
    if ((flags & kMultipartFlag) == 0 && flagged && part.info.tiled != ((flags & kTiledFlag) != 0)) {
        return badExr("type", fmt::format("\"{}\" contradicts the flags {:#x} of the file", type.substr(0, 40), flags));
    }
    for (const char* needed : {"channels", "compression", "dataWindow", "displayWindow"}) {
        if (!names.contains(needed)) return badExr("header", fmt::format("the attribute \"{}\" is missing", needed));
    }
    if (part.info.tiled && !names.contains("tiles")) return badExr("header", "the attribute \"tiles\" is missing");
    if ((flags & kMultipartFlag) != 0 && (type.empty() || part.info.name.empty() || part.declaredBlocks < 0)) {
        return badExr("header", "a file of several parts needs name, type and chunkCount for each");
    }
    return {};
}

/// One header, up to and with the zero byte that ends it. `first` has been read already.
Result<ExrPart> readPart(ByteReader& reader, std::uint32_t flags, std::string first) {
    ExrPart part;
    std::string type;
    std::set<std::string> names;
    for (std::string name = std::move(first); !name.empty();) {
        ARS_TRY(std::string typeName, readName(reader, "an attribute type"));
        ARS_TRY(const auto size, reader.read<std::int32_t>("an attribute size"));
        if (size < 0) return badExr(fmt::format("attribute \"{}\"", name), fmt::format("a size of {} bytes", size));
        ARS_TRY(const auto value, reader.readBytes(static_cast<std::uint64_t>(size), "an attribute"));
        if (!names.insert(name).second) return badExr("header", fmt::format("attribute \"{}\" stands twice", name));
        if (auto status = applyAttribute({name, std::move(typeName), value}, part, type); !status) {
            return atPlace(std::move(status).error(), fmt::format("attribute \"{}\"", name));
        }
        ARS_TRY(name, readName(reader, "an attribute name"));
    }
    ARS_TRY_STATUS(applyType(type, flags, names, part));
    return part;
}

std::uint64_t divideUp(std::uint64_t a, std::uint64_t b) { return (a + b - 1) / b; }

std::uint64_t levelSide(std::uint64_t side, int level, bool roundUp) {
    const std::uint64_t size = roundUp ? divideUp(side, 1ull << level) : side >> level;
    return std::max<std::uint64_t>(size, 1);
}

int levelCount(std::uint64_t side, bool roundUp) {
    const int floorLog = std::bit_width(side) - 1;
    return floorLog + 1 + (roundUp && !std::has_single_bit(side) ? 1 : 0);
}

/// Rows in one block of a scan-line part.
std::uint64_t blockRows(ExrCompression compression) {
    switch (compression) {
    case ExrCompression::None:
    case ExrCompression::Rle:
    case ExrCompression::Zips:
        return 1;
    case ExrCompression::Zip:
    case ExrCompression::Pxr24:
        return 16;
    case ExrCompression::Piz:
    case ExrCompression::B44:
    case ExrCompression::B44a:
    case ExrCompression::Dwaa:
        return 32;
    case ExrCompression::Dwab:
        return 256;
    }
    return 1;
}

std::uint64_t blockCount(const ExrPart& part) {
    const auto width = static_cast<std::uint64_t>(part.info.dataWindow.width());
    const auto height = static_cast<std::uint64_t>(part.info.dataWindow.height());
    if (!part.info.tiled) return divideUp(height, blockRows(part.info.compression));
    const ExrTiles& tiles = part.tiles;
    const auto inLevel = [&](int lx, int ly) {
        return divideUp(levelSide(width, lx, tiles.roundUp), tiles.width) *
               divideUp(levelSide(height, ly, tiles.roundUp), tiles.height);
    };
    if (tiles.levelMode == 0) return inLevel(0, 0);
    std::uint64_t count = 0;
    if (tiles.levelMode == 1) {
        const int levels = levelCount(std::max(width, height), tiles.roundUp);
        for (int l = 0; l < levels; ++l) count += inLevel(l, l);
        return count;
    }
    for (int ly = 0; ly < levelCount(height, tiles.roundUp); ++ly) {
        for (int lx = 0; lx < levelCount(width, tiles.roundUp); ++lx) count += inLevel(lx, ly);
    }
    return count;
}

std::uint64_t bytesPerPixel(const ExrPart& part) {
    std::uint64_t bytes = 0;
    for (const ExrChannelInfo& channel : part.info.channels) bytes += channel.type == ExrPixelType::Half ? 2 : 4;
    return bytes;
}

/// Reads one block's header at `offset` and returns the bytes of pixels that follow it.
Result<std::uint64_t> storedBytes(const ExrHeader& header, std::size_t p, std::uint64_t offset, ByteReader reader) {
    ARS_TRY_STATUS(reader.seek(offset, "a block"));
    if (header.multipart) {
        ARS_TRY(const auto number, reader.read<std::int32_t>("a block"));
        if (number < 0 || static_cast<std::size_t>(number) != p) {
            return badExr("", fmt::format("expected a block of part {}, found one of part {}", p, number));
        }
    }
    ARS_TRY_STATUS(reader.skip(header.parts[p].info.tiled ? 16 : 4, "a block"));
    ARS_TRY(const auto size, reader.read<std::int32_t>("a block"));
    if (size <= 0) return badExr("", fmt::format("a block of {} bytes", size));
    ARS_TRY_STATUS(reader.require(static_cast<std::uint64_t>(size), "a block's pixels"));
    return static_cast<std::uint64_t>(size);
}

Status checkPartBlocks(const ExrHeader& header, std::size_t p, std::uint64_t blocksBegin, ByteReader& table) {
    const ExrPart& part = header.parts[p];
    const std::uint64_t count = blockCount(part);
    std::uint64_t stored = 0;
    for (std::uint64_t i = 0; i < count; ++i) {
        ARS_TRY(const auto offset, table.read<std::uint64_t>("the table of blocks"));
        const std::string place = fmt::format("block {} of {}", i, count);
        if (offset < blocksBegin) return badExr(place, "it is missing: the picture was not written to its end");
        auto bytes = storedBytes(header, p, offset, table);
        if (!bytes) return atPlace(std::move(bytes).error(), place);
        stored += *bytes;
    }
    const std::uint64_t raw = bytesPerPixel(part) * static_cast<std::uint64_t>(part.info.dataWindow.width()) *
                              static_cast<std::uint64_t>(part.info.dataWindow.height());
    const bool dwa = part.info.compression == ExrCompression::Dwaa || part.info.compression == ExrCompression::Dwab;
    // DWA chains two coders, which has no useful bound.
    if (!dwa && stored < raw / (part.info.compression == ExrCompression::None ? 1 : kMaxRatio)) {
        return badExr("", fmt::format("{} bytes of pixels cannot hold {}x{} pixels with {} channels", stored,
                                      part.info.dataWindow.width(), part.info.dataWindow.height(),
                                      part.info.channels.size()));
    }
    return {};
}

} // namespace

Result<ExrHeader> readExrHeader(std::span<const std::byte> bytes) {
    ByteReader reader(bytes);
    ARS_TRY(const auto magic, reader.read<std::uint32_t>("the OpenEXR signature"));
    if (magic != kMagic) return badExr("byte 0", "expected the OpenEXR signature 76 2f 31 01");
    ARS_TRY(const auto version, reader.read<std::uint32_t>("the OpenEXR version"));
    const std::uint32_t flags = version & ~0xffu;
    if ((version & 0xff) > 2 || (flags & ~kKnownFlags) != 0) {
        return makeError(ErrorCode::Unsupported, "byte 4",
                         fmt::format("OpenEXR version {} with flags {:#x}, expected version 2", version & 0xff, flags));
    }
    ExrHeader header;
    header.multipart = (flags & kMultipartFlag) != 0;
    ARS_TRY(std::string name, readName(reader, "an attribute name"));
    // An empty name ends a header; in files of several parts an empty header ends the list.
    while (header.parts.empty() || (header.multipart && !name.empty())) {
        auto part = readPart(reader, flags, std::move(name));
        if (!part) {
            return header.multipart ? atPlace(std::move(part).error(), fmt::format("part {}", header.parts.size()))
                                    : std::move(part).error();
        }
        header.parts.push_back(std::move(part).value());
        name.clear();
        if (header.multipart) {
            ARS_TRY(name, readName(reader, "an attribute name"));
        }
    }
    header.end = reader.position();
    return header;
}

ExrBox exrDataWindow(const ExrHeader& header) {
    ExrBox box = header.parts.front().info.dataWindow;
    for (const ExrPart& part : header.parts) {
        const ExrBox& other = part.info.dataWindow;
        box = {std::min(box.x0, other.x0), std::min(box.y0, other.y0), std::max(box.x1, other.x1),
               std::max(box.y1, other.y1)};
    }
    return box;
}

Status checkExrHeader(const ExrHeader& header, const ExrBox& window, const ReadLimits& limits) {
    std::uint64_t channels = 0;
    for (const ExrPart& part : header.parts) {
        const std::string place = part.info.name.empty() ? "" : fmt::format("part \"{}\"", part.info.name);
        const auto unsupported = [&](std::string message) {
            return makeError(ErrorCode::Unsupported, place, std::move(message));
        };
        if (part.info.deep) return unsupported("deep pixels (many samples each); flatten the picture first");
        if (part.compressionCode > kMaxCompression) {
            return unsupported(
                fmt::format("compression {} is not known; write the file with ZIP, PIZ or DWA", part.compressionCode));
        }
        for (const ExrChannelInfo& channel : part.info.channels) {
            if (channel.xSampling == 1 && channel.ySampling == 1) continue;
            return unsupported(fmt::format("channel \"{}\" is subsampled {}x{}; write every channel at full resolution",
                                           channel.name, channel.xSampling, channel.ySampling));
        }
        // The library holds whole tiles, and whole blocks of rows, beside the picture.
        const bool tiled = part.info.tiled;
        auto tile = imageValueCount(tiled ? part.tiles.width : 1, tiled ? part.tiles.height : 1,
                                    static_cast<std::int64_t>(part.info.channels.size()), limits);
        if (!tile) return atPlace(atPlace(std::move(tile).error(), "tiles"), place);
        channels += part.info.channels.size();
    }
    auto count = imageValueCount(window.width(), window.height(), static_cast<std::int64_t>(channels), limits);
    if (!count) return std::move(count).error();
    return {};
}

Status checkExrBlocks(const ExrHeader& header, std::span<const std::byte> bytes) {
    std::uint64_t blocks = 0;
    for (std::size_t p = 0; p < header.parts.size(); ++p) {
        const std::uint64_t count = blockCount(header.parts[p]);
        const std::int64_t declared = header.parts[p].declaredBlocks;
        if (declared >= 0 && static_cast<std::uint64_t>(declared) != count) {
            return badExr(fmt::format("part {}", p),
                          fmt::format("chunkCount is {}, its windows ask for {}", declared, count));
        }
        blocks += count;
    }
    ByteReader table(bytes);
    ARS_TRY_STATUS(table.seek(header.end, "the table of blocks"));
    // One table entry, one block header and one byte of pixels each.
    const std::uint64_t needed = blocks * (8 + 8 + 1);
    if (needed > table.remaining()) {
        return badExr(fmt::format("byte {}", header.end),
                      fmt::format("{} blocks need at least {} bytes, {} are left", blocks, needed, table.remaining()));
    }
    const std::uint64_t blocksBegin = header.end + 8 * blocks;
    for (std::size_t p = 0; p < header.parts.size(); ++p) {
        auto status = checkPartBlocks(header, p, blocksBegin, table);
        if (!status) {
            return header.multipart ? atPlace(std::move(status).error(), fmt::format("part {}", p))
                                    : std::move(status).error();
        }
    }
    return {};
}

} // namespace ars::detail
