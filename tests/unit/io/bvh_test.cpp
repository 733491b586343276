#include "engine/io/bvh.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <sstream>

namespace ars {
namespace {

std::span<const std::byte> asBytes(std::string_view text) { return std::as_bytes(std::span(text)); }

Result<BvhFile> parse(std::string_view text) { return parseBvh(asBytes(text)); }

void expectRefused(std::string_view text, ErrorCode code, std::string_view sentence, const ReadLimits& limits = {}) {
    const Result<BvhFile> file = parseBvh(asBytes(text), limits);
    ASSERT_FALSE(file.ok()) << "read without complaint: " << text.substr(0, 200);
    EXPECT_EQ(errorCodeName(file.error().code), errorCodeName(code)) << file.error().describe();
    EXPECT_NE(file.error().describe().find(sentence), std::string::npos) << file.error().describe();
}

const std::string kTwoJoints = "HIERARCHY\n"
                               "ROOT hip\n"
                               "{\n"
                               "  OFFSET 1 2 3\n"
                               "  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation\n"
                               "  JOINT knee\n"
                               "  {\n"
                               "    OFFSET 0 -4.5 0\n"
                               "    CHANNELS 3 Zrotation Xrotation Yrotation\n"
                               "    End Site\n"
                               "    {\n"
                               "      OFFSET 0 -1 0.25\n"
                               "    }\n"
                               "  }\n"
                               "}\n"
                               "MOTION\n"
                               "Frames: 2\n"
                               "Frame Time: 0.0333333\n"
                               "1 2 3 4 5 6 7 8 9\n"
                               "-1 -2 -3 -4 -5 -6 -7 -8 -9\n";

std::string with(std::string text, std::string_view from, std::string_view to) {
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
}

TEST(Bvh, HierarchyAndFramesAreRead) {
    const Result<BvhFile> file = parse(kTwoJoints);
    ASSERT_TRUE(file.ok()) << file.error().describe();
    ASSERT_EQ(file->joints.size(), 2u);
    EXPECT_EQ(file->joints[0].name, "hip");
    EXPECT_EQ(file->joints[0].parent, -1);
    EXPECT_EQ(file->joints[0].offset, glm::vec3(1, 2, 3));
    EXPECT_EQ(file->joints[0].channels.size(), 6u);
    EXPECT_EQ(file->joints[0].channels[3], BvhChannel::Zrotation);
    EXPECT_EQ(file->joints[1].name, "knee");
    EXPECT_EQ(file->joints[1].parent, 0);
    EXPECT_EQ(file->joints[1].offset, glm::vec3(0, -4.5f, 0));
    EXPECT_EQ(file->joints[1].firstChannel, 6u);
    EXPECT_EQ(file->joints[1].channels,
              (std::vector{BvhChannel::Zrotation, BvhChannel::Xrotation, BvhChannel::Yrotation}));
    ASSERT_EQ(file->joints[1].endSites.size(), 1u);
    EXPECT_EQ(file->joints[1].endSites[0], glm::vec3(0, -1, 0.25f));
    EXPECT_EQ(file->channelCount, 9u);
    EXPECT_EQ(file->frameCount, 2u);
    EXPECT_DOUBLE_EQ(file->frameTimeS, 0.0333333);
    EXPECT_EQ(file->frame(1)[8], -9.0f);
    EXPECT_EQ(file->find("knee"), 1);
    EXPECT_EQ(file->find("ankle"), -1);
}

TEST(Bvh, VariantsFromTheWildMeanTheSame) {
    const Result<BvhFile> plain = parse(kTwoJoints);
    ASSERT_TRUE(plain.ok());
    std::string crlf;
    for (const char c : kTwoJoints) crlf += c == '\n' ? std::string("\r\n") : std::string(1, c == ' ' ? '\t' : c);
    std::string lower = kTwoJoints;
    for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    const std::string variants[] = {
        with(crlf, "Frame\tTime", "Frame Time"),
        lower,
        with(kTwoJoints, "Frames: 2", "Frames:\t2"),
        with(kTwoJoints, "Frames: 2", "Frames : 2"),
        with(kTwoJoints, "Frames: 2", "Frames:2"),
        with(kTwoJoints, "Frame Time: 0.0333333", "Frame Time:\t.0333333"),
        with(kTwoJoints, "1 2 3 4 5 6 7 8 9\n", "1 2 3\n4 5 6 7 8 9 "),
        with(kTwoJoints, "1 2 3 4", "+1.0e0 2. 3e+00 0.4E1"),
        with(kTwoJoints, "-8 -9\n", "-8 -9"),
        with(kTwoJoints, "End Site", "End Site toe"),
        with(kTwoJoints, "ROOT hip\n{", "# a remark\nROOT hip {"),
    };
    for (const std::string& text : variants) {
        const Result<BvhFile> file = parse(text);
        ASSERT_TRUE(file.ok()) << file.error().describe() << "\n" << text;
        EXPECT_EQ(file->values, plain->values) << text;
        EXPECT_DOUBLE_EQ(file->frameTimeS, plain->frameTimeS) << text;
        EXPECT_EQ(file->joints[1].offset, plain->joints[1].offset) << text;
        EXPECT_EQ(file->joints[1].endSites, plain->joints[1].endSites) << text;
    }
}

TEST(Bvh, SeveralRootsRepeatedAndSpacedNamesAreKept) {
    const std::string one = "{ OFFSET 0 0 0 CHANNELS 1 Zrotation }\n";
    const Result<BvhFile> file =
        parse("HIERARCHY ROOT left hand\n" + one + "ROOT left hand\n" + one + "MOTION Frames: 1 Frame Time: 1 5 6");
    ASSERT_TRUE(file.ok()) << file.error().describe();
    ASSERT_EQ(file->joints.size(), 2u);
    EXPECT_EQ(file->joints[0].name, "left hand");
    EXPECT_EQ(file->joints[1].name, "left hand");
    EXPECT_EQ(file->joints[1].parent, -1);
    EXPECT_EQ(file->joints[1].firstChannel, 1u);
}

TEST(Bvh, BrokenFilesAreRefusedInOneSentence) {
    const auto refused = [](std::string_view from, std::string_view to, std::string_view sentence,
                            ErrorCode code = ErrorCode::BadFile) {
        expectRefused(with(kTwoJoints, from, to), code, sentence);
    };
    expectRefused("", ErrorCode::BadFile, "line 1: expected HIERARCHY, found the end of the file");
    expectRefused("PK\x03\x04", ErrorCode::BadFile, "expected HIERARCHY, found \"PK\\x03\\x04\"");
    refused("ROOT", "JOINT", "line 2: expected ROOT, found \"JOINT\"");
    refused("ROOT hip", "ROOT ", "line 2: expected a joint name");
    refused("ROOT hip", "ROOT h}p", "line 2: expected a joint name without line end or brace, found \"h}p\"");
    refused("hip\n{", "hip\n", "line 4: expected {, found \"OFFSET\"");
    refused("  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation\n", "",
            "line 5: expected CHANNELS, found \"JOINT\"");
    refused("OFFSET 1 2 3\n", "", "expected OFFSET, found \"JOINT\"");
    refused("OFFSET 1 2 3", "OFFSET 1 2", "line 5: expected three finite numbers after OFFSET, found \"CHANNELS\"");
    refused("OFFSET 1 2 3", "OFFSET 1 nan 3", "line 4: expected three finite numbers after OFFSET, found \"nan\"");
    refused("OFFSET 1 2 3", "OFFSET 1 2 3 OFFSET 1 2 3", "a second OFFSET");
    refused("CHANNELS 3", "CHANNELS 3000000000", "line 9: expected a number of channels from 0 to 6");
    refused("CHANNELS 3", "CHANNELS -3", "expected a number of channels from 0 to 6, found \"-3\"");
    refused("CHANNELS 3 Z", "CHANNELS 3 W", "expected a channel such as Xposition or Zrotation, found \"Wrotation\"");
    refused("    }\n  }\n}", "    }\n  }\n", "line 16: expected JOINT, End Site or }, found \"MOTION\"");
    refused("End Site", "End", "expected \"Site\" after \"End\"");
    refused("Frames: 2", "Frames: -2", "line 17: expected a number of frames, found \"-2\"");
    refused("Frames: 2", "Frames: 3", "the file ends in frame 2, expected 3 frames of 9 numbers");
    refused("Frames: 2", "Frames: 1",
            "line 20: expected the end of the file after 1 frames of 9 numbers, found \"-1\"");
    refused("Frames: 2", "Frames: 9223372036854775808", "9223372036854775808 frames", ErrorCode::LimitExceeded);
    refused("Frames: 2", "Frames: 99999999999999999999", "expected a number of frames");
    refused("Frame Time: 0.0333333", "Frame Time: 0", "expected a frame time above 0 s, found \"0\"");
    refused("Frame Time: 0.0333333", "Frame Time: inf", "expected a frame time above 0 s");
    refused("-7 -8 -9", "-7 nan -9", "a finite number for frame 1, joint \"knee\", Xrotation, found \"nan\"");
    refused("-7 -8 -9", "-7 1e99 -9", "a finite number for frame 1, joint \"knee\", Xrotation, found \"1e99\"");
    refused("-7 -8 -9", "-7 8x -9", "found \"8x\"");
}

TEST(Bvh, TruncatedAtEverySixteenthIsRefused) {
    // The last cut lies inside the last line but before its last number; a cut within the very last number cannot be
    // told from a shorter number.
    for (std::size_t k = 0; k < 16; ++k) {
        const std::string cut = kTwoJoints.substr(0, kTwoJoints.size() * k / 16);
        EXPECT_FALSE(parse(cut).ok()) << cut;
    }
}

TEST(Bvh, AMillionJointsAndDeepNestingMeetALimit) {
    std::string wide = "HIERARCHY\n";
    for (int i = 0; i < 1'000'000; ++i) wide += "ROOT a\n{OFFSET";
    expectRefused(wide, ErrorCode::BadFile, "expected {");
    wide = "HIERARCHY\n";
    for (int i = 0; i < 1'000'000; ++i) wide += "ROOT a\n{ OFFSET 0 0 0 CHANNELS 0 }\n";
    expectRefused(wide, ErrorCode::LimitExceeded, "line 8194: more than 4096 joints");
    std::string deep = "HIERARCHY\nROOT a\n{ OFFSET 0 0 0 CHANNELS 0\n";
    for (int i = 0; i < 1'000'000; ++i) deep += "JOINT a\n{ OFFSET 0 0 0 CHANNELS 0\n";
    expectRefused(deep, ErrorCode::LimitExceeded, "nested deeper than 256");
    ReadLimits small;
    small.maxBytes = 64;
    expectRefused(kTwoJoints, ErrorCode::LimitExceeded, "2 frames of 9 numbers", small);
}

TEST(Bvh, RoundTripKeepsEveryBit) {
    Result<BvhFile> file = parse(kTwoJoints);
    ASSERT_TRUE(file.ok());
    file->values[3] = 0.1f;
    file->values[4] = std::numeric_limits<float>::denorm_min();
    file->values[5] = -1.17549435e-38f;
    const Result<std::string> text = formatBvh(*file);
    ASSERT_TRUE(text.ok()) << text.error().describe();
    const Result<BvhFile> again = parse(*text);
    ASSERT_TRUE(again.ok()) << again.error().describe() << *text;
    EXPECT_EQ(again->values, file->values);
    EXPECT_EQ(again->frameTimeS, file->frameTimeS);
    ASSERT_EQ(again->joints.size(), file->joints.size());
    for (std::size_t i = 0; i < file->joints.size(); ++i) {
        EXPECT_EQ(again->joints[i].name, file->joints[i].name);
        EXPECT_EQ(again->joints[i].parent, file->joints[i].parent);
        EXPECT_EQ(again->joints[i].offset, file->joints[i].offset);
        EXPECT_EQ(again->joints[i].channels, file->joints[i].channels);
        EXPECT_EQ(again->joints[i].endSites, file->joints[i].endSites);
    }
}

TEST(Bvh, JointsInAnyOrderAreWrittenDepthFirstWithTheirNumbers) {
    BvhFile file; // a root with children b and c; the child d of b comes after c
    const auto joint = [](const char* name, int parent, std::size_t first) {
        BvhJoint j;
        j.name = name;
        j.parent = parent;
        j.channels = {BvhChannel::Xrotation};
        j.firstChannel = first;
        return j;
    };
    file.joints = {joint("a", -1, 0), joint("b", 0, 1), joint("c", 0, 2), joint("d", 1, 3)};
    file.channelCount = 4;
    file.frameCount = 1;
    file.values = {10, 11, 12, 13};
    const Result<std::string> text = formatBvh(file);
    ASSERT_TRUE(text.ok()) << text.error().describe();
    const Result<BvhFile> again = parse(*text);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(again->joints[2].name, "d");
    EXPECT_EQ(again->joints[2].parent, 1);
    EXPECT_EQ(again->values, (std::vector<float>{10, 11, 13, 12}));
}

TEST(Bvh, WhatCannotBeWrittenIsRefused) {
    const Result<BvhFile> sound = parse(kTwoJoints);
    ASSERT_TRUE(sound.ok());
    const auto refused = [&](auto&& change, std::string_view sentence) {
        BvhFile file = *sound;
        change(file);
        const Result<std::string> text = formatBvh(file);
        ASSERT_FALSE(text.ok()) << sentence;
        EXPECT_EQ(errorCodeName(text.error().code), errorCodeName(ErrorCode::InvalidArgument));
        EXPECT_NE(text.error().describe().find(sentence), std::string::npos) << text.error().describe();
    };
    refused([](BvhFile& f) { f.joints[1].parent = 1; }, "parent 1 does not come before its child");
    refused([](BvhFile& f) { f.joints[1].name = "a\nb"; }, "no line end or brace");
    refused([](BvhFile& f) { f.joints[1].firstChannel = 7; }, "channels 7 to 10 of 9");
    refused([](BvhFile& f) { f.values.pop_back(); }, "17 numbers, expected 2 frames of 9");
    refused([](BvhFile& f) { f.values[9] = std::numeric_limits<float>::infinity(); }, "frame 1: number 0 is inf");
    refused([](BvhFile& f) { f.frameTimeS = 0; }, "expected one above 0");
    refused([](BvhFile& f) { f.joints.clear(); }, "at least one joint");
}

TEST(Bvh, FileOnDiskIsNamedInErrorsAndSurvivesAFailedWrite) {
    test::TemporaryFolder folder;
    const auto path = folder / "motion.bvh";
    Result<BvhFile> file = parse(kTwoJoints);
    ASSERT_TRUE(file.ok());
    ASSERT_TRUE(writeBvh(path, *file).ok());
    const Result<BvhFile> again = readBvh(path);
    ASSERT_TRUE(again.ok()) << again.error().describe();
    EXPECT_EQ(again->values, file->values);
    file->frameTimeS = -1;
    EXPECT_FALSE(writeBvh(path, *file).ok());
    EXPECT_TRUE(readBvh(path).ok());
    std::ofstream(path) << "HIERARCHY\nfoo";
    const Result<BvhFile> broken = readBvh(path);
    ASSERT_FALSE(broken.ok());
    EXPECT_EQ(broken.error().describe(), path.string() + ": line 2: expected ROOT, found \"foo\"");
    EXPECT_EQ(errorCodeName(readBvh(folder / "none.bvh").error().code), errorCodeName(ErrorCode::NotFound));
}

/// Joints, frames and the first number of the last frame as a spreadsheet reader would find them: counted by words.
void expectWordCount(const std::filesystem::path& path) {
    const Result<BvhFile> file = readBvh(path);
    ASSERT_TRUE(file.ok()) << file.error().describe();
    std::ifstream stream(path);
    std::stringstream text;
    text << stream.rdbuf();
    std::string word;
    std::size_t joints = 0, frames = 0, sites = 0;
    std::vector<double> numbers;
    bool motion = false;
    while (text >> word) {
        if (word == "ROOT" || word == "JOINT") ++joints;
        if (word == "Site") ++sites;
        if (word == "MOTION") motion = true;
        if (motion && word == "Frames:") text >> frames;
        if (motion && word == "Time:") {
            double number = 0;
            text >> number;
            while (text >> number) numbers.push_back(number);
        }
    }
    EXPECT_EQ(file->joints.size(), joints) << path;
    EXPECT_EQ(file->frameCount, frames) << path;
    std::size_t foundSites = 0;
    for (const BvhJoint& joint : file->joints) foundSites += joint.endSites.size();
    EXPECT_EQ(foundSites, sites) << path;
    ASSERT_EQ(file->values.size(), numbers.size()) << path;
    for (std::size_t i = 0; i < numbers.size(); ++i)
        ASSERT_EQ(file->values[i], static_cast<float>(numbers[i])) << path << i;
}

TEST(Bvh, EveryMotionOfTheTestDataIsReadWhole) {
    ARS_TEST_DATA_FILE(folder, "motion");
    std::size_t files = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
        if (entry.path().extension() != ".bvh") continue;
        ++files;
        expectWordCount(entry.path());
    }
    EXPECT_EQ(files, 31u);
}

TEST(Bvh, JointAndFrameCountsOfTheTestData) {
    ARS_TEST_DATA_FILE(folder, "motion");
    const struct {
        const char* name;
        std::size_t joints, frames;
        double frameTimeS;
    } expected[] = {
        {"cmu_bvh/02_01.bvh", 43, 344, 0.00833333},    {"cmu_bvh/jumping_jacks_AnimatedDrawings.bvh", 31, 125, 0.03333},
        {"poses_bvh/benchmark.bvh", 163, 1, 0.041667}, {"poses_bvh/walk1.bvh", 75, 14, 0.041667},
        {"poses_bvh/tpose.bvh", 173, 1, 0.041667},     {"aitviewer_sample.bvh", 23, 1300, 0.025},
    };
    for (const auto& e : expected) {
        const Result<BvhFile> file = readBvh(folder / e.name);
        ASSERT_TRUE(file.ok()) << file.error().describe();
        EXPECT_EQ(file->joints.size(), e.joints) << e.name;
        EXPECT_EQ(file->frameCount, e.frames) << e.name;
        EXPECT_DOUBLE_EQ(file->frameTimeS, e.frameTimeS) << e.name;
    }
}

} // namespace
} // namespace ars
