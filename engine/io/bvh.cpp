#include "engine/io/bvh.h"

#include "engine/core/file.h"
#include "engine/io/text_scanner.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace ars {
namespace {

constexpr std::array<std::string_view, 6> kChannelNames = {"Xposition", "Yposition", "Zposition",
                                                           "Xrotation", "Yrotation", "Zrotation"};
constexpr std::uint64_t kMaxChannelsPerJoint = 6;

bool isJointName(std::string_view name) {
    return !name.empty() && name.find_first_of("\r\n{}") == std::string_view::npos;
}

/// One pass over the text; the tree is kept in a stack, so that a hostile depth costs no call stack.
class BvhParser {
public:
    BvhParser(std::span<const std::byte> bytes, const ReadLimits& limits) : scanner_(bytes), limits_(limits) {}

    Result<BvhFile> parse() {
        ARS_TRY_STATUS(expectWord("HIERARCHY"));
        ARS_TRY_STATUS(readHierarchy());
        ARS_TRY_STATUS(readMotionHeader());
        ARS_TRY_STATUS(readFrames());
        return std::move(file_);
    }

private:
    /// An open brace: a joint, or an end site of the joint below it in the stack.
    struct Block {
        int joint = -1;
        bool endSite = false;
        bool hasOffset = false;
        bool hasChannels = false;
    };

    Error bad(std::string message) const { return makeError(ErrorCode::BadFile, place_, std::move(message)); }
    Error expected(std::string_view what, std::string_view found) const {
        return bad(fmt::format("expected {}, found {}", what, quotedFound(found)));
    }

    /// The next word that is no comment; remembers its line for messages.
    std::string_view nextWord() {
        for (;;) {
            scanner_.skipSpace();
            place_ = scanner_.place();
            const std::string_view word = scanner_.word();
            if (word.empty() || word.front() != '#') return word;
            scanner_.restOfLine();
        }
    }
    Status expectWord(std::string_view keyword) {
        const std::string_view word = nextWord();
        if (!equalIgnoringCase(word, keyword)) return expected(keyword, word);
        return {};
    }
    /// Opens the block behind a joint's or end site's name; the brace may stand on the name's own line.
    Status openBlock(bool braceSeen, Block block) {
        if (!braceSeen) ARS_TRY_STATUS(expectWord("{"));
        if (blocks_.size() >= limits_.maxNesting) {
            return makeError(ErrorCode::LimitExceeded, place_,
                             fmt::format("joints nested deeper than {}", limits_.maxNesting));
        }
        blocks_.push_back(block);
        return {};
    }
    std::string_view readName(bool& braceSeen) {
        std::string_view name = scanner_.restOfLine();
        braceSeen = !name.empty() && name.back() == '{';
        if (braceSeen) name.remove_suffix(1);
        while (!name.empty() && (name.back() == ' ' || name.back() == '\t')) name.remove_suffix(1);
        return name;
    }

    Status readJoint(int parent) {
        if (file_.joints.size() >= limits_.maxJoints) {
            return makeError(ErrorCode::LimitExceeded, place_, fmt::format("more than {} joints", limits_.maxJoints));
        }
        bool braceSeen = false;
        BvhJoint joint;
        joint.name = readName(braceSeen);
        joint.parent = parent;
        if (joint.name.empty()) return bad("expected a joint name, found none");
        if (!isJointName(joint.name)) return expected("a joint name without line end or brace", joint.name);
        file_.joints.push_back(std::move(joint));
        return openBlock(braceSeen, {.joint = static_cast<int>(file_.joints.size()) - 1});
    }
    Status readEndSite(int parent) {
        bool braceSeen = false;
        const std::string_view name = readName(braceSeen); // "Site", or "Site tip"
        if (!equalIgnoringCase(name.substr(0, 4), "Site")) return expected("\"Site\" after \"End\"", name);
        return openBlock(braceSeen, {.joint = parent, .endSite = true, .hasChannels = true});
    }

    Status readOffset(Block& block) {
        if (block.hasOffset) return bad("a second OFFSET in one block");
        glm::vec3 offset(0.0f);
        for (int axis = 0; axis < 3; ++axis) {
            const std::string_view word = nextWord();
            const auto number = parseFloat(word);
            if (!number || !std::isfinite(*number)) return expected("three finite numbers after OFFSET", word);
            offset[axis] = *number;
        }
        BvhJoint& joint = file_.joints[static_cast<std::size_t>(block.joint)];
        if (block.endSite) {
            joint.endSites.push_back(offset);
        } else {
            joint.offset = offset;
        }
        block.hasOffset = true;
        return {};
    }
    Status readChannels(Block& block) {
        if (block.hasChannels) return bad("a second CHANNELS in one block");
        const std::string_view countWord = nextWord();
        const auto count = parseUnsigned(countWord);
        if (!count || *count > kMaxChannelsPerJoint) {
            return expected(fmt::format("a number of channels from 0 to {}", kMaxChannelsPerJoint), countWord);
        }
        BvhJoint& joint = file_.joints[static_cast<std::size_t>(block.joint)];
        joint.firstChannel = file_.channelCount;
        for (std::uint64_t i = 0; i < *count; ++i) {
            const std::string_view word = nextWord();
            const auto* const name = std::find_if(kChannelNames.begin(), kChannelNames.end(),
                                                  [&](std::string_view n) { return equalIgnoringCase(n, word); });
            if (name == kChannelNames.end()) return expected("a channel such as Xposition or Zrotation", word);
            joint.channels.push_back(static_cast<BvhChannel>(name - kChannelNames.begin()));
        }
        file_.channelCount += joint.channels.size();
        block.hasChannels = true;
        return {};
    }

    /// Up to and including MOTION.
    Status readHierarchy() {
        for (;;) {
            const std::string_view word = nextWord();
            if (blocks_.empty()) {
                if (equalIgnoringCase(word, "ROOT")) {
                    ARS_TRY_STATUS(readJoint(-1));
                } else if (equalIgnoringCase(word, "MOTION") && !file_.joints.empty()) {
                    return {};
                } else {
                    return expected(file_.joints.empty() ? "ROOT" : "ROOT or MOTION", word);
                }
            } else {
                ARS_TRY_STATUS(readBlockWord(word));
            }
        }
    }
    Status readBlockWord(std::string_view word) {
        Block& block = blocks_.back();
        if (equalIgnoringCase(word, "OFFSET")) return readOffset(block);
        if (!block.endSite && equalIgnoringCase(word, "CHANNELS")) return readChannels(block);
        if (!block.hasOffset) return expected("OFFSET", word);
        if (!block.hasChannels) return expected("CHANNELS", word);
        if (word == "}") {
            blocks_.pop_back();
            return {};
        }
        if (block.endSite) return expected("} after the OFFSET of an end site", word);
        if (equalIgnoringCase(word, "JOINT")) return readJoint(block.joint);
        if (equalIgnoringCase(word, "End")) return readEndSite(block.joint);
        return expected("JOINT, End Site or }", word);
    }

    /// "Frames: 344", "Frame Time: .0333"; the colon may stand alone or be missing.
    Result<std::string_view> readField(std::string_view first, std::string_view second) {
        std::string_view found = nextWord();
        const std::size_t length = first.size();
        if (!equalIgnoringCase(found.substr(0, length), first)) return expected(first, found);
        std::string_view rest = found.substr(length);
        if (!second.empty()) {
            found = rest.empty() ? nextWord() : rest;
            if (!equalIgnoringCase(found.substr(0, second.size()), second)) return expected(second, found);
            rest = found.substr(second.size());
        }
        if (rest.empty()) rest = nextWord();
        if (!rest.empty() && rest.front() == ':') rest.remove_prefix(1);
        if (rest.empty()) rest = nextWord();
        return rest;
    }
    Status readMotionHeader() {
        ARS_TRY(const std::string_view framesWord, readField("Frames", ""));
        const auto frames = parseUnsigned(framesWord);
        if (!frames) return expected("a number of frames", framesWord);
        if (*frames > limits_.maxElements ||
            *frames * sizeof(float) > limits_.maxBytes / std::max<std::size_t>(1, file_.channelCount)) {
            return makeError(ErrorCode::LimitExceeded, place_,
                             fmt::format("{} frames of {} numbers, the limit is {} frames and {} bytes", *frames,
                                         file_.channelCount, limits_.maxElements, limits_.maxBytes));
        }
        file_.frameCount = static_cast<std::size_t>(*frames);
        ARS_TRY(const std::string_view timeWord, readField("Frame", "Time"));
        const auto time = parseDouble(timeWord);
        if (!time || !std::isfinite(*time) || *time <= 0) return expected("a frame time above 0 s", timeWord);
        file_.frameTimeS = *time;
        return {};
    }

    /// "frame 3, joint "hip", Xrotation"
    std::string valueName(std::size_t index) const {
        const std::size_t channel = index % file_.channelCount;
        for (const BvhJoint& joint : file_.joints) {
            if (channel < joint.firstChannel || channel >= joint.firstChannel + joint.channels.size()) continue;
            return fmt::format("frame {}, joint {}, {}", index / file_.channelCount, quotedFound(joint.name),
                               bvhChannelName(joint.channels[channel - joint.firstChannel]));
        }
        return fmt::format("frame {}", index / file_.channelCount);
    }
    Status readFrames() {
        const std::size_t count = file_.frameCount * file_.channelCount;
        // A number takes at least two bytes, so what the file can hold bounds what is reserved for it.
        file_.values.reserve(std::min(count, scanner_.remaining() / 2 + 1));
        for (std::size_t i = 0; i < count; ++i) {
            const std::string_view word = nextWord();
            if (word.empty()) {
                return bad(fmt::format("the file ends in frame {}, expected {} frames of {} numbers",
                                       i / file_.channelCount, file_.frameCount, file_.channelCount));
            }
            const auto number = parseFloat(word);
            if (!number || !std::isfinite(*number)) {
                return expected(fmt::format("a finite number for {}", valueName(i)), word);
            }
            file_.values.push_back(*number);
        }
        const std::string_view word = nextWord();
        if (!word.empty()) {
            return expected(
                fmt::format("the end of the file after {} frames of {} numbers", file_.frameCount, file_.channelCount),
                word);
        }
        return {};
    }

    TextScanner scanner_;
    const ReadLimits& limits_;
    std::string place_;
    std::vector<Block> blocks_;
    BvhFile file_;
};

Error invalid(std::string place, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(place), std::move(message));
}

Status checkJoint(const BvhFile& file, std::size_t index) {
    const BvhJoint& joint = file.joints[index];
    const std::string place = fmt::format("joint {} {}", index, quotedFound(joint.name));
    if (!isJointName(joint.name)) {
        return invalid(place, "a name must have a character and no line end or brace");
    }
    if (joint.parent < -1 || joint.parent >= static_cast<int>(index)) {
        return invalid(place, fmt::format("parent {} does not come before its child", joint.parent));
    }
    if (joint.firstChannel > file.channelCount || joint.channels.size() > file.channelCount - joint.firstChannel ||
        joint.channels.size() > kMaxChannelsPerJoint) {
        return invalid(place, fmt::format("channels {} to {} of {} numbers a frame", joint.firstChannel,
                                          joint.firstChannel + joint.channels.size(), file.channelCount));
    }
    for (int axis = 0; axis < 3; ++axis) {
        bool finite = std::isfinite(joint.offset[axis]);
        for (const glm::vec3& site : joint.endSites) finite = finite && std::isfinite(site[axis]);
        if (!finite) return invalid(place, "an offset is not finite");
    }
    return {};
}

/// Writes joints depth first and notes in which order.
class BvhFormatter {
public:
    explicit BvhFormatter(const BvhFile& file) : file_(file), children_(file.joints.size()) {
        for (std::size_t i = 0; i < file.joints.size(); ++i) {
            if (file.joints[i].parent >= 0) children_[static_cast<std::size_t>(file.joints[i].parent)].push_back(i);
        }
    }
    std::string format() {
        text_ = "HIERARCHY\n";
        for (std::size_t i = 0; i < file_.joints.size(); ++i) {
            if (file_.joints[i].parent < 0) writeTree(i);
        }
        append("MOTION\nFrames: {}\nFrame Time: {}\n", file_.frameCount, file_.frameTimeS);
        for (std::size_t frame = 0; frame < file_.frameCount; ++frame) writeFrame(frame);
        return std::move(text_);
    }

private:
    template <typename... Args>
    void append(fmt::format_string<Args...> pattern, Args&&... args) {
        fmt::format_to(std::back_inserter(text_), pattern, std::forward<Args>(args)...);
    }
    void writeOffset(const std::string& indent, const glm::vec3& offset) {
        append("{}OFFSET {} {} {}\n", indent, offset.x, offset.y, offset.z);
    }
    void openJoint(std::size_t index, std::size_t depth) {
        const BvhJoint& joint = file_.joints[index];
        const std::string outer(depth, '\t'), inner(depth + 1, '\t');
        append("{}{} {}\n{}{{\n", outer, depth == 0 ? "ROOT" : "JOINT", joint.name, outer);
        writeOffset(inner, joint.offset);
        append("{}CHANNELS {}", inner, joint.channels.size());
        for (const BvhChannel channel : joint.channels) append(" {}", bvhChannelName(channel));
        text_ += '\n';
        for (const glm::vec3& site : joint.endSites) {
            append("{}End Site\n{}{{\n", inner, inner);
            writeOffset(inner + '\t', site);
            append("{}}}\n", inner);
        }
        order_.push_back(index);
    }
    /// Without recursion: a chain of joints may be as long as the skeleton.
    void writeTree(std::size_t root) {
        struct Open {
            std::size_t joint;
            std::size_t nextChild = 0;
        };
        std::vector<Open> open{{root}};
        openJoint(root, 0);
        while (!open.empty()) {
            Open& top = open.back();
            if (top.nextChild < children_[top.joint].size()) {
                const std::size_t child = children_[top.joint][top.nextChild++];
                openJoint(child, open.size());
                open.push_back({child});
            } else {
                open.pop_back();
                append("{}}}\n", std::string(open.size(), '\t'));
            }
        }
    }
    void writeFrame(std::size_t frame) {
        const std::span<const float> values = file_.frame(frame);
        bool first = true;
        for (const std::size_t index : order_) {
            const BvhJoint& joint = file_.joints[index];
            for (const float value : values.subspan(joint.firstChannel, joint.channels.size())) {
                append("{}{}", first ? "" : " ", value);
                first = false;
            }
        }
        text_ += '\n';
    }

    const BvhFile& file_;
    std::vector<std::vector<std::size_t>> children_;
    std::vector<std::size_t> order_;
    std::string text_;
};

} // namespace

std::string_view bvhChannelName(BvhChannel channel) { return kChannelNames[static_cast<std::size_t>(channel)]; }

int BvhFile::find(std::string_view name) const {
    const auto found = std::find_if(joints.begin(), joints.end(), [&](const BvhJoint& j) { return j.name == name; });
    return found == joints.end() ? -1 : static_cast<int>(found - joints.begin());
}

Result<BvhFile> parseBvh(std::span<const std::byte> bytes, const ReadLimits& limits) {
    return BvhParser(bytes, limits).parse();
}

Result<BvhFile> readBvh(const std::filesystem::path& path, const ReadLimits& limits) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path, limits));
    Result<BvhFile> file = parseBvh(bytes, limits);
    if (!file) return atPlace(std::move(file).error(), path.string());
    return file;
}

Status checkBvh(const BvhFile& file) {
    if (file.joints.empty()) return invalid("", "a BVH file needs at least one joint");
    std::size_t channels = 0;
    for (std::size_t i = 0; i < file.joints.size(); ++i) {
        ARS_TRY_STATUS(checkJoint(file, i));
        channels += file.joints[i].channels.size();
    }
    if (channels != file.channelCount) {
        return invalid("", fmt::format("the joints have {} channels, a frame has {}", channels, file.channelCount));
    }
    if (file.values.size() != file.frameCount * file.channelCount) {
        return invalid("", fmt::format("{} numbers, expected {} frames of {}", file.values.size(), file.frameCount,
                                       file.channelCount));
    }
    if (!std::isfinite(file.frameTimeS) || file.frameTimeS <= 0) {
        return invalid("", fmt::format("frame time {} s, expected one above 0", file.frameTimeS));
    }
    for (std::size_t i = 0; i < file.values.size(); ++i) {
        if (!std::isfinite(file.values[i])) {
            return invalid(fmt::format("frame {}", i / file.channelCount),
                           fmt::format("number {} is {}", i % file.channelCount, file.values[i]));
        }
    }
    return {};
}

Result<std::string> formatBvh(const BvhFile& file) {
    ARS_TRY_STATUS(checkBvh(file));
    return BvhFormatter(file).format();
}

Status writeBvh(const std::filesystem::path& path, const BvhFile& file) {
    Result<std::string> text = formatBvh(file);
    if (!text) return atPlace(std::move(text).error(), path.string());
    return writeFileAtomic(path, *text);
}

} // namespace ars
