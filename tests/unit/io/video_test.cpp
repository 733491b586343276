#include "engine/io/video.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstring>

namespace ars {
namespace {

std::vector<std::uint8_t> plainFrame(int width, int height, std::array<std::uint8_t, 3> color) {
    std::vector<std::uint8_t> frame;
    for (int i = 0; i < width * height; ++i) frame.insert(frame.end(), color.begin(), color.end());
    return frame;
}

Status writePlain(const std::filesystem::path& path, int width, int height, int frames) {
    VideoFormat options;
    options.width = width;
    options.height = height;
    options.framesPerSecond = 30;
    options.metadata["comment"] = "a \"quoted\" comment = with; signs";
    ARS_TRY(VideoWriter writer, VideoWriter::open(path, options));
    for (int i = 0; i < frames; ++i) ARS_TRY_STATUS(writer.add(plainFrame(width, height, {200, 60, 20})));
    return writer.finish();
}

TEST(Video, FramesSizeRateAndMetadataComeBackThroughFfprobe) {
    const test::TemporaryFolder folder;
    const auto path = folder / "film.mp4";
    const Status written = writePlain(path, 65, 47, 12);
    ASSERT_TRUE(written.ok()) << written.error().describe();
    const auto probe = runProcess({"ffprobe", "-v", "error", "-count_frames", "-show_entries",
                                   "stream=width,height,nb_read_frames,r_frame_rate,color_space:format_tags=comment",
                                   "-of", "json", path.string()});
    ASSERT_TRUE(probe.ok());
    const auto json = nlohmann::json::parse(probe->output);
    const auto& stream = json["streams"][0];
    EXPECT_EQ(stream["width"], 66) << "odd sides are padded by one";
    EXPECT_EQ(stream["height"], 48);
    EXPECT_EQ(stream["nb_read_frames"], "12");
    EXPECT_EQ(stream["r_frame_rate"], "30/1");
    EXPECT_EQ(stream["color_space"], "bt709");
    EXPECT_EQ(json["format"]["tags"]["comment"], "a \"quoted\" comment = with; signs");
}

TEST(Video, ColoursSurviveTheCodec) {
    const test::TemporaryFolder folder;
    const auto path = folder / "film.mp4";
    ASSERT_TRUE(writePlain(path, 64, 48, 3).ok());
    const auto raw =
        runProcess({"ffmpeg", "-v", "error", "-i", path.string(), "-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1"});
    ASSERT_TRUE(raw.ok());
    ASSERT_EQ(raw->output.size(), 3u * 64 * 48 * 3);
    const int expected[3] = {200, 60, 20};
    for (int c = 0; c < 3; ++c) {
        const auto value = static_cast<std::uint8_t>(raw->output[static_cast<std::size_t>(3 * (24 * 64 + 32) + c)]);
        EXPECT_NEAR(value, expected[c], 4) << "4:2:0 and limited range cost a little; a wrong matrix costs more";
    }
}

TEST(Video, AnInterruptedFilmLeavesNothing) {
    const test::TemporaryFolder folder;
    {
        VideoFormat options;
        options.width = options.height = 32;
        auto writer = VideoWriter::open(folder / "film.mp4", options);
        ASSERT_TRUE(writer.ok());
        EXPECT_TRUE(writer->add(plainFrame(32, 32, {1, 2, 3})).ok());
    }
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Video, WrongSizesAreRefused) {
    const test::TemporaryFolder folder;
    VideoFormat options;
    EXPECT_EQ(VideoWriter::open(folder / "film.mp4", options).error().code, ErrorCode::InvalidArgument);
    options.width = options.height = 32;
    options.framesPerSecond = NAN;
    EXPECT_EQ(VideoWriter::open(folder / "film.mp4", options).error().code, ErrorCode::InvalidArgument);
    options.framesPerSecond = 25;
    auto writer = VideoWriter::open(folder / "film.mp4", options);
    ASSERT_TRUE(writer.ok());
    EXPECT_EQ(writer->add(plainFrame(16, 32, {1, 2, 3})).error().code, ErrorCode::InvalidArgument);
}

} // namespace
} // namespace ars
