// Which cameras and frames a use takes: texts of the command line and published settings.
#include "engine/capture/capture.h"

#include "engine/capture/published_settings.h"
#include "tests/support/test_data.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

namespace ars::test {
namespace {

/// A capture in memory; nothing of it is on a disk.
Capture plainCapture(int cameras, int frames, std::string subject = "me") {
    Capture capture;
    capture.subject = std::move(subject);
    for (int i = 0; i < cameras; ++i) {
        capture.cameras.push_back({fmt::format("{}", 22010708 + 2 * i), {}, {}});
        capture.files.emplace_back();
    }
    capture.frames.resize(static_cast<std::size_t>(frames));
    std::iota(capture.frames.begin(), capture.frames.end(), 0);
    return capture;
}

CaptureSplit splitOr(const Result<CaptureSplit>& split) {
    EXPECT_TRUE(split.ok()) << split.error().describe();
    return split ? *split : CaptureSplit{};
}

std::vector<int> range(int begin, int end) {
    std::vector<int> values(static_cast<std::size_t>(end - begin));
    std::iota(values.begin(), values.end(), begin);
    return values;
}

TEST(CaptureSplit, TextsNameCamerasAndFrames) {
    Capture capture = plainCapture(10, 30);
    capture.frames = range(100, 130);
    const auto cameras = [&](const char* text) { return splitOr(trainingSplit(capture, text)).cameras; };
    EXPECT_EQ(cameras(""), range(0, 10));
    EXPECT_EQ(cameras("0-3,8"), (std::vector<int>{0, 1, 2, 3, 8}));
    EXPECT_EQ(cameras("22010712"), (std::vector<int>{2}));
    EXPECT_EQ(cameras(" 9 , 22010708-22010712, 1"), (std::vector<int>{0, 1, 2, 9}));
    const auto frames = [&](const char* text) { return splitOr(trainingSplit(capture, "", text)).frames; };
    EXPECT_EQ(frames(""), range(0, 30));
    EXPECT_EQ(frames("102:105"), (std::vector<int>{2, 3, 4})) << "the end does not count";
    EXPECT_EQ(frames("0:2000:4"), (std::vector<int>{0, 4, 8, 12, 16, 20, 24, 28}))
        << "steps count from the first number";
    EXPECT_EQ(frames("127:"), (std::vector<int>{27, 28, 29}));
    EXPECT_EQ(frames(":102,115"), (std::vector<int>{0, 1, 15}));
    EXPECT_EQ(frames("101::14"), (std::vector<int>{1, 15, 29}));
}

TEST(CaptureSplit, ACamerasNameGoesBeforeIndices) {
    Capture capture = plainCapture(4, 2);
    capture.cameras[3].name = "1";
    capture.cameras[2].name = "left-hand";
    EXPECT_EQ(splitOr(trainingSplit(capture, "1")).cameras, (std::vector<int>{3}));
    EXPECT_EQ(splitOr(trainingSplit(capture, "left-hand")).cameras, (std::vector<int>{2}));
    EXPECT_EQ(splitOr(trainingSplit(capture, "left-hand-1")).cameras, (std::vector<int>{2, 3}));
}

TEST(CaptureSplit, WrongTextsSayWhichWord) {
    const Capture capture = plainCapture(4, 6);
    const auto message = [&](const char* cameras, const char* frames) {
        const auto split = trainingSplit(capture, cameras, frames);
        EXPECT_FALSE(split.ok()) << cameras << " " << frames;
        return split.ok() ? "" : split.error().describe();
    };
    EXPECT_EQ(message("0-2,nobody", ""),
              "\"nobody\" names no camera; there are 4 with indices 0 to 3, named \"22010708\" to \"22010714\"");
    EXPECT_NE(message("2-1", "").find("\"2-1\" names no camera"), std::string::npos);
    EXPECT_NE(message("4", "").find("\"4\" names no camera"), std::string::npos);
    EXPECT_NE(message("1,", "").find("an empty word names no camera"), std::string::npos);
    EXPECT_NE(message("", "a:b").find("found \"a:b\""), std::string::npos);
    EXPECT_NE(message("", "5:2").find("found \"5:2\""), std::string::npos);
    EXPECT_NE(message("", "0:5:0").find("found \"0:5:0\""), std::string::npos);
    EXPECT_NE(message("", "1:2:3:4").find("found \"1:2:3:4\""), std::string::npos);
    EXPECT_EQ(message("", "6:"), "no frame is in \"6:\"; there are 6, numbered 0 to 5");
    const auto split = namedSplit(capture, "held_out_cameras");
    ASSERT_FALSE(split.ok());
    EXPECT_EQ(split.error().describe(), "the capture \"me\" has no split \"held_out_cameras\"; there are train, all");
}

TEST(CaptureSplit, ASplitWithoutAnyPictureIsRefused) {
    Capture capture = plainCapture(2, 2);
    capture.missing = {{0, 1}};
    const auto split = trainingSplit(capture, "0", "1");
    ASSERT_FALSE(split.ok());
    EXPECT_EQ(split.error().message, "these cameras have no picture of these frames");
}

// Numbers of cameras and frames as the publications state them (avatar reference 5).
TEST(PublishedSettings, MatchWhatIsPublished) {
    const struct {
        const char* subject;
        int cameras, frames; ///< of the recording
        std::size_t trainingCameras, trainingFrames;
    } expected[] = {
        {"avatarrex_zzr", 16, 2001, 14, 2001},  {"avatarrex_zxc", 16, 1801, 14, 1801},
        {"avatarrex_lbn1", 16, 1901, 14, 1901}, {"avatarrex_lbn2", 16, 1871, 14, 1871},
        {"subject00", 24, 2500, 23, 2000},      {"subject01", 24, 5060, 23, 2500},
        {"subject02", 24, 3110, 24, 2115},      {"actor01", 160, 2400, 46, 2129},
        {"actor02", 160, 2400, 47, 2097},       {"actor04", 160, 2400, 47, 1301},
        {"actor05", 160, 2400, 47, 986},        {"actor07", 160, 2400, 47, 1934},
        {"actor08", 160, 2400, 47, 2311},
    };
    for (const auto& row : expected) {
        const PublishedSubject* subject = publishedSubject(row.subject);
        ASSERT_TRUE(subject) << row.subject;
        const Capture capture = plainCapture(row.cameras, row.frames, row.subject);
        const CaptureSplit split = splitOr(trainingSplit(capture));
        EXPECT_EQ(split.name, "train");
        EXPECT_EQ(split.cameras.size(), row.trainingCameras) << row.subject;
        EXPECT_EQ(split.frames.size(), row.trainingFrames) << row.subject;
        EXPECT_EQ(splitOr(namedSplit(capture, "all")).cameras.size(), static_cast<std::size_t>(row.cameras));
        // Every other split opens; held-out cameras are none of the training's.
        for (const PublishedSplit& published : subject->splits) {
            const CaptureSplit other = splitOr(namedSplit(capture, std::string(published.name)));
            EXPECT_FALSE(other.cameras.empty() || other.frames.empty()) << row.subject << " " << published.name;
            if (published.name != "held_out_cameras") continue;
            for (const int camera : other.cameras) {
                EXPECT_EQ(std::count(split.cameras.begin(), split.cameras.end(), camera), 0) << row.subject;
            }
        }
    }
    const Capture rex = plainCapture(16, 10, "avatarrex_zzr");
    EXPECT_EQ(splitOr(namedSplit(rex, "held_out_cameras")).cameras, (std::vector<int>{7, 13}));
    EXPECT_EQ(splitOr(trainingSplit(rex, "7", "3")).cameras, (std::vector<int>{7})) << "texts override";
}

TEST(PublishedSettings, SubjectsAreKnownByFolderAndCameras) {
    const auto found = [](CaptureKind kind, const char* folder, std::size_t cameras) {
        const PublishedSubject* subject = findPublishedSubject(kind, folder, cameras);
        return subject ? std::string(subject->name) : std::string();
    };
    EXPECT_EQ(found(CaptureKind::AvatarRex, "/data/avatarrex/zzr", 16), "avatarrex_zzr");
    EXPECT_EQ(found(CaptureKind::AvatarRex, "/data/AvatarReX_ZZR/", 16), "avatarrex_zzr");
    EXPECT_EQ(found(CaptureKind::AvatarRex, "/data/zzr", 12), "") << "not that recording";
    EXPECT_EQ(found(CaptureKind::THuman4, "/data/zzr", 16), "");
    EXPECT_EQ(found(CaptureKind::THuman4, "/d/subject02", 24), "subject02");
    EXPECT_EQ(found(CaptureKind::ActorsHq, "/d/ActorsHQ/Actor06/Sequence1/4x", 160), "actor06");
    EXPECT_EQ(found(CaptureKind::ActorsHq, "/d/ActorsHQ/Actor03/Sequence1/4x", 160), "");
}

TEST(PublishedSettings, ActorsListOfFramesIsRead) {
    const TemporaryFolder folder;
    Capture capture = plainCapture(160, 20, "actor06");
    capture.folder = folder.path();
    EXPECT_EQ(splitOr(trainingSplit(capture)).frames.size(), 20u) << "without the list every frame";
    writeBytes(folder / "frame_ids.txt", "3\n7\r\n19\n500\n");
    EXPECT_EQ(splitOr(trainingSplit(capture)).frames, (std::vector<int>{3, 7, 19}));
    writeBytes(folder / "frame_ids.txt", "3\nseven\n");
    const auto split = trainingSplit(capture);
    ASSERT_FALSE(split.ok());
    EXPECT_NE(split.error().describe().find("line 2: expected a frame number, found \"seven\""), std::string::npos);
}

} // namespace
} // namespace ars::test
