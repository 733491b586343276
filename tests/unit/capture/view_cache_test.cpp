// Views come out of the cache as they went in; the cache is bounded and may be deleted at any moment.
#include "engine/capture/view_cache.h"

#include "tests/support/test_data.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <thread>

namespace ars::test {
namespace {
namespace fs = std::filesystem;

class CacheOfCapture : public ::testing::Test {
protected:
    void SetUp() override {
        writeCapture(what_, folder_ / "capture");
        reopen();
    }
    void reopen() {
        auto capture = openCapture(folder_ / "capture");
        ASSERT_TRUE(capture.ok()) << capture.error().describe();
        capture_ = std::make_shared<const Capture>(*std::move(capture));
    }
    std::unique_ptr<ViewCache> open(ViewCache::Options options) {
        auto cache = ViewCache::open(capture_, std::move(options));
        EXPECT_TRUE(cache.ok()) << cache.error().describe();
        return cache ? *std::move(cache) : nullptr;
    }
    ViewCache::Options onDisk() const {
        ViewCache::Options options;
        options.memoryBytes = 0;
        options.folder = folder_ / "cache";
        return options;
    }
    std::vector<fs::path> files() const {
        std::vector<fs::path> found;
        std::error_code ignored;
        for (const auto& entry : fs::directory_iterator(folder_ / "cache", ignored)) found.push_back(entry.path());
        return found;
    }
    /// Reads a view and compares it with what the files say.
    void expectRight(ViewCache& cache, ViewId id, const ViewOptions& options = {}) {
        const auto view = cache.read(id);
        ASSERT_TRUE(view.ok()) << view.error().describe();
        const auto expected = readView(*capture_, id, options);
        ASSERT_TRUE(expected.ok());
        EXPECT_EQ((*view)->id, id);
        EXPECT_EQ((*view)->camera, expected->camera);
        EXPECT_EQ((*view)->color.pixels, expected->color.pixels);
        EXPECT_EQ((*view)->mask.pixels, expected->mask.pixels);
        EXPECT_EQ((*view)->band.pixels, expected->band.pixels);
    }

    SyntheticCapture what_;
    TemporaryFolder folder_;
    std::shared_ptr<const Capture> capture_;
};

TEST_F(CacheOfCapture, ReadsEachViewOnceWhileThereIsRoom) {
    const auto cache = open({});
    for (int round = 0; round < 3; ++round) {
        for (int camera = 0; camera < 3; ++camera) {
            for (int frame = 0; frame < 4; ++frame) expectRight(*cache, {camera, frame});
        }
    }
    EXPECT_EQ(cache->counts().decoded, 12u);
    EXPECT_EQ(cache->counts().fromMemory, 24u);
    EXPECT_GT(cache->memoryBytes(), 12u * 40 * 50 * 4 / 2);
}

TEST_F(CacheOfCapture, ForgetsTheLeastRecentlyUsedWhenFull) {
    const auto big = open({});
    ASSERT_TRUE(big->read({0, 0}).ok());
    const std::size_t one = big->memoryBytes();
    ViewCache::Options options;
    options.memoryBytes = one * 5 / 2; // two fit
    const auto cache = open(options);
    for (const int frame : {0, 1, 0, 2}) expectRight(*cache, {0, frame}); // 1 goes when 2 comes
    EXPECT_LE(cache->memoryBytes(), options.memoryBytes);
    EXPECT_EQ(cache->counts().decoded, 3u);
    expectRight(*cache, {0, 0});
    EXPECT_EQ(cache->counts().decoded, 3u);
    expectRight(*cache, {0, 1});
    EXPECT_EQ(cache->counts().decoded, 4u);
    options.memoryBytes = one / 2;
    const auto none = open(options);
    expectRight(*none, {0, 0});
    EXPECT_EQ(none->memoryBytes(), 0u);
}

TEST_F(CacheOfCapture, AnotherRunFindsWhatOneKept) {
    {
        const auto cache = open(onDisk());
        for (int frame = 0; frame < 4; ++frame) expectRight(*cache, {1, frame});
        EXPECT_EQ(cache->counts().decoded, 4u);
    }
    EXPECT_EQ(files().size(), 4u);
    const auto cache = open(onDisk());
    for (int frame = 0; frame < 4; ++frame) expectRight(*cache, {1, frame});
    EXPECT_EQ(cache->counts().fromFolder, 4u);
    EXPECT_EQ(cache->counts().decoded, 0u);
}

TEST_F(CacheOfCapture, OtherOptionsCamerasAndPicturesAreOtherFiles) {
    expectRight(*open(onDisk()), {0, 0});
    ViewCache::Options scaled = onDisk();
    scaled.view.scale = 2;
    const auto other = open(scaled);
    expectRight(*other, {0, 0}, scaled.view);
    EXPECT_EQ(other->counts().decoded, 1u);
    // A picture that was exchanged.
    Image picture = filledImage(what_.width, what_.height, 3, 0.9f, ColorSpace::Srgb);
    writePicture(folder_ / "capture" / what_.picture(0, 0), picture);
    const auto exchanged = open(onDisk());
    expectRight(*exchanged, {0, 0});
    EXPECT_EQ(exchanged->counts().decoded, 1u);
    // A calibration that was corrected.
    nlohmann::ordered_json json = calibrationJson(what_);
    json[what_.cameraName(0)]["T"][0] = 0.01;
    writeBytes(folder_ / "capture" / what_.calibrationFile(), json.dump());
    reopen();
    const auto corrected = open(onDisk());
    expectRight(*corrected, {0, 0});
    EXPECT_EQ(corrected->counts().decoded, 1u);
}

TEST_F(CacheOfCapture, DamagedFilesArePassedOver) {
    {
        const auto cache = open(onDisk());
        for (int frame = 0; frame < 3; ++frame) expectRight(*cache, {0, frame});
    }
    const auto kept = files();
    ASSERT_EQ(kept.size(), 3u);
    fs::resize_file(kept[0], 100);
    {
        std::fstream stream(kept[1], std::ios::binary | std::ios::in | std::ios::out);
        stream.seekp(static_cast<std::streamoff>(fs::file_size(kept[1]) - 20));
        stream << "xyz";
    }
    fs::resize_file(kept[2], 0);
    const auto cache = open(onDisk());
    for (int frame = 0; frame < 3; ++frame) expectRight(*cache, {0, frame});
    EXPECT_EQ(cache->counts().decoded, 3u);
    const auto again = open(onDisk());
    for (int frame = 0; frame < 3; ++frame) expectRight(*again, {0, frame});
    EXPECT_EQ(again->counts().fromFolder, 3u) << "they were written anew";
}

TEST_F(CacheOfCapture, MayBeDeletedAtAnyMoment) {
    const auto cache = open(onDisk());
    expectRight(*cache, {0, 0});
    fs::remove_all(folder_ / "cache");
    expectRight(*cache, {0, 0});
    expectRight(*cache, {0, 1});
    EXPECT_EQ(cache->counts().decoded, 3u);
    EXPECT_EQ(files().size(), 2u);
}

TEST_F(CacheOfCapture, TheFolderIsBounded) {
    {
        const auto cache = open(onDisk());
        for (int frame = 0; frame < 4; ++frame) expectRight(*cache, {2, frame});
    }
    const std::uintmax_t one = fs::file_size(files().front());
    ViewCache::Options options = onDisk();
    options.folderBytes = static_cast<std::size_t>(one * 13 / 2);
    const auto cache = open(options);
    expectRight(*cache, {2, 3}); // of the earlier run, and used
    for (int frame = 0; frame < 4; ++frame) expectRight(*cache, {0, frame});
    for (int frame = 0; frame < 4; ++frame) expectRight(*cache, {1, frame});
    std::uintmax_t total = 0;
    for (const fs::path& file : files()) total += fs::file_size(file);
    EXPECT_LE(total, options.folderBytes);
    EXPECT_EQ(files().size(), 6u) << "what this run did not use made room";
    const auto after = open(onDisk());
    expectRight(*after, {2, 3});
    expectRight(*after, {0, 0});
    EXPECT_EQ(after->counts().fromFolder, 2u);
}

TEST_F(CacheOfCapture, AFolderThatCannotBeIsAnErrorAtTheStart) {
    writeBytes(folder_ / "file", "x");
    ViewCache::Options options;
    options.folder = folder_ / "file" / "cache";
    const auto cache = ViewCache::open(capture_, options);
    ASSERT_FALSE(cache.ok());
    EXPECT_EQ(cache.error().code, ErrorCode::Io);
    EXPECT_NE(cache.error().describe().find("file/cache: the cache of pictures cannot be kept here"),
              std::string::npos);
}

TEST_F(CacheOfCapture, SeveralThreadsReadTheSame) {
    const auto cache = open(onDisk());
    std::vector<std::thread> threads;
    std::atomic<int> failures{0};
    for (int t = 0; t < 4; ++t) {
        threads.emplace_back([&, t] {
            for (int i = 0; i < 24; ++i) {
                const ViewId id{(i + t) % 3, (i / 3) % 4};
                const auto view = cache->read(id);
                if (!view || (*view)->id != id) ++failures;
            }
        });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(failures, 0);
    EXPECT_EQ(files().size(), 12u);
}

} // namespace
} // namespace ars::test
