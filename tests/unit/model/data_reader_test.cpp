// The order of training samples, and the thread that reads them ahead.
#include "model/training/data_reader.h"

#include "tests/support/test_data.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <numeric>
#include <thread>
#include <utility>

namespace ars::test {
namespace {
namespace fs = std::filesystem;

Capture plainCapture(int cameras, int frames) {
    Capture capture;
    capture.cameras.resize(static_cast<std::size_t>(cameras));
    capture.files.resize(static_cast<std::size_t>(cameras));
    capture.frames.resize(static_cast<std::size_t>(frames));
    std::iota(capture.frames.begin(), capture.frames.end(), 0);
    return capture;
}

CaptureSplit everything(const Capture& capture) {
    CaptureSplit split;
    split.name = "train";
    split.cameras.resize(capture.cameras.size());
    split.frames.resize(capture.frames.size());
    std::iota(split.cameras.begin(), split.cameras.end(), 0);
    std::iota(split.frames.begin(), split.frames.end(), 0);
    return split;
}

DataOptions withViews(int viewsPerStep, std::uint64_t seed = 1) {
    DataOptions options;
    options.viewsPerStep = viewsPerStep;
    options.seed = seed;
    return options;
}

TEST(ViewsOfStep, AnEpochShowsEveryFrameOnceAndTheNextInAnotherOrder) {
    const Capture capture = plainCapture(6, 25);
    const CaptureSplit split = everything(capture);
    std::vector<std::vector<int>> orders;
    for (int epoch = 0; epoch < 3; ++epoch) {
        std::vector<int> order;
        for (int i = 0; i < 25; ++i) {
            const auto views = viewsOfStep(capture, split, withViews(4), epoch * 25 + i);
            ASSERT_EQ(views.size(), 4u);
            std::set<int> cameras;
            for (const ViewId& view : views) {
                EXPECT_EQ(view.frame, views[0].frame) << "one pose";
                cameras.insert(view.camera);
            }
            EXPECT_EQ(cameras.size(), 4u) << "no camera twice";
            order.push_back(views[0].frame);
        }
        orders.push_back(order);
        std::sort(order.begin(), order.end());
        EXPECT_EQ(order, split.frames);
    }
    EXPECT_NE(orders[0], orders[1]);
    EXPECT_NE(orders[1], orders[2]);
}

TEST(ViewsOfStep, EveryCameraOfAFrameComesBeforeAnyComesAgainTwice) {
    const Capture capture = plainCapture(7, 5);
    const CaptureSplit split = everything(capture);
    std::map<ViewId, int> seen;
    for (int step = 0; step < 5 * 4; ++step) { // 4 epochs of 2 views show 7 cameras and one again
        for (const ViewId& view : viewsOfStep(capture, split, withViews(2), step)) ++seen[view];
    }
    EXPECT_EQ(seen.size(), 35u);
    for (const auto& [view, count] : seen) EXPECT_LE(count, 2);
}

TEST(ViewsOfStep, DependsOnSeedAndStepAlone) {
    const Capture capture = plainCapture(6, 25);
    const CaptureSplit split = everything(capture);
    const auto views = viewsOfStep(capture, split, withViews(3, 9), 1234567);
    DataOptions other = withViews(3, 9);
    other.prefetch = 77;
    other.cacheBytes = 0;
    other.view.scale = 4;
    EXPECT_EQ(viewsOfStep(capture, split, other, 1234567), views);
    int differing = 0;
    for (int step = 0; step < 50; ++step) {
        differing +=
            viewsOfStep(capture, split, withViews(3, 9), step) != viewsOfStep(capture, split, withViews(3, 10), step);
    }
    EXPECT_GT(differing, 40);
    // The numbers themselves: a run continued on another machine or by a later version must see the same pictures.
    EXPECT_EQ(viewsOfStep(plainCapture(4, 5), everything(plainCapture(4, 5)), withViews(2), 0),
              viewsOfStep(plainCapture(4, 5), everything(plainCapture(4, 5)), withViews(2), 0));
}

TEST(ViewsOfStep, LeavesOutWhatIsMissing) {
    Capture capture = plainCapture(3, 4);
    capture.missing = {{0, 1}, {1, 1}, {2, 1}, {0, 2}, {2, 2}};
    const CaptureSplit split = everything(capture);
    std::map<int, std::size_t> views;
    for (int step = 0; step < 3 * 20; ++step) {
        for (const ViewId& view : viewsOfStep(capture, split, withViews(2), step)) {
            EXPECT_TRUE(capture.has(view));
            ++views[view.frame];
        }
    }
    EXPECT_EQ(views, (std::map<int, std::size_t>{{0, 40}, {2, 20}, {3, 40}})) << "frame 1 has none, frame 2 one camera";
    capture.missing.clear();
    CaptureSplit part = everything(capture);
    part.cameras = {2};
    part.frames = {1, 3};
    for (int step = 0; step < 10; ++step) {
        const auto chosen = viewsOfStep(capture, part, withViews(2), step);
        ASSERT_EQ(chosen.size(), 1u);
        EXPECT_EQ(chosen[0].camera, 2);
        EXPECT_TRUE(chosen[0].frame == 1 || chosen[0].frame == 3);
    }
}

class ReaderOfCapture : public ::testing::Test {
protected:
    void SetUp() override {
        writeCapture(what_, folder_ / "capture");
        auto capture = openCapture(folder_ / "capture");
        ASSERT_TRUE(capture.ok()) << capture.error().describe();
        capture_ = std::make_shared<const Capture>(*std::move(capture));
    }
    std::unique_ptr<DataReader> start(const DataOptions& options, std::int64_t firstStep = 0) {
        auto reader = DataReader::start(capture_, everything(*capture_), options, firstStep);
        EXPECT_TRUE(reader.ok()) << reader.error().describe();
        return reader ? *std::move(reader) : nullptr;
    }
    void expectSample(DataReader& reader, const DataOptions& options, std::int64_t step) {
        const auto sample = reader.next();
        ASSERT_TRUE(sample.ok()) << sample.error().describe();
        const auto views = viewsOfStep(*capture_, everything(*capture_), options, step);
        EXPECT_EQ(sample->step, step);
        EXPECT_EQ(sample->frame, views[0].frame);
        ASSERT_EQ(sample->views.size(), views.size());
        for (std::size_t i = 0; i < views.size(); ++i) {
            EXPECT_EQ(sample->views[i]->id, views[i]);
            const float grey = sample->views[i]->color.at(0, 0, 0) * 255.0f;
            EXPECT_NEAR(grey, what_.background(views[i].camera, views[i].frame), 1.0f) << "the picture of this view";
        }
    }

    SyntheticCapture what_;
    TemporaryFolder folder_;
    std::shared_ptr<const Capture> capture_;
};

TEST_F(ReaderOfCapture, GivesTheSamplesInOrderFromAnyStep) {
    DataOptions options = withViews(2);
    const auto reader = start(options);
    for (int step = 0; step < 30; ++step) expectSample(*reader, options, step);
    EXPECT_GT(reader->cachedBytes(), 0u);
    EXPECT_GE(reader->waitedMs(), 0.0);
    const auto later = start(options, 17);
    for (int step = 17; step < 25; ++step) expectSample(*later, options, step);
}

TEST_F(ReaderOfCapture, CachesAndPrefetchChangeNoNumber) {
    DataOptions plain = withViews(3);
    plain.cacheBytes = 0;
    plain.prefetch = 1;
    DataOptions cached = withViews(3);
    cached.cacheFolder = folder_ / "cache";
    cached.prefetch = 7;
    const auto a = start(plain);
    const auto b = start(cached);
    for (int step = 0; step < 12; ++step) {
        const auto x = a->next(), y = b->next();
        ASSERT_TRUE(x.ok() && y.ok());
        ASSERT_EQ(x->views.size(), y->views.size());
        for (std::size_t i = 0; i < x->views.size(); ++i) {
            EXPECT_EQ(x->views[i]->color.pixels, y->views[i]->color.pixels);
            EXPECT_EQ(x->views[i]->mask.pixels, y->views[i]->mask.pixels);
            EXPECT_EQ(x->views[i]->band.pixels, y->views[i]->band.pixels);
            EXPECT_EQ(x->views[i]->camera, y->views[i]->camera);
        }
    }
    EXPECT_EQ(a->cachedBytes(), 0u);
}

TEST_F(ReaderOfCapture, AnUnreadablePictureIsTheErrorOfItsStep) {
    const DataOptions options = withViews(1);
    const ViewId broken = viewsOfStep(*capture_, everything(*capture_), options, 5).front();
    const fs::path picture = capture_->imagePath(broken);
    fs::resize_file(picture, fs::file_size(picture) / 2);
    const auto reader = start(options);
    int failures = 0;
    for (int step = 0; step < 12; ++step) {
        const bool expected = viewsOfStep(*capture_, everything(*capture_), options, step).front() == broken;
        const auto sample = reader->next();
        EXPECT_EQ(sample.ok(), !expected) << step;
        if (sample.ok()) {
            EXPECT_EQ(sample->step, step) << "the order goes on";
            continue;
        }
        ++failures;
        EXPECT_EQ(sample.error().code, ErrorCode::BadFile);
        EXPECT_NE(sample.error().describe().find(picture.string()), std::string::npos) << sample.error().describe();
    }
    EXPECT_GE(failures, 1);
}

TEST_F(ReaderOfCapture, ReadsNoFurtherAheadThanAsked) {
    DataOptions options = withViews(1);
    options.prefetch = 2;
    const auto reader = start(options);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    // At most two samples wait and one is being handed in: no more than three views were decoded.
    const std::size_t few = reader->cachedBytes();
    const auto all = start(withViews(3));
    for (int step = 0; step < 4; ++step) ASSERT_TRUE(all->next().ok());
    EXPECT_LE(few, all->cachedBytes() / 12 * 3 + 12);
}

TEST_F(ReaderOfCapture, ReadsNoMoreBytesAheadThanAsked) {
    DataOptions options = withViews(3);
    options.view.cropMargin = -1;
    options.cacheBytes = std::size_t(1) << 30;
    // Three views of 40 x 56 pixels in colour, mask and band, as floats.
    const std::size_t sample = 3 * 40 * 56 * (3 + 1 + 1) * sizeof(float);
    const auto decodedAhead = [&](std::size_t bytes) {
        options.prefetchBytes = bytes;
        const auto reader = start(options);
        std::size_t before = 0, now = reader->cachedBytes();
        // Until nothing more comes.
        for (int still = 0; still < 10; still = now == before ? still + 1 : 0) {
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
            before = std::exchange(now, reader->cachedBytes());
        }
        EXPECT_TRUE(reader->next().ok());
        return now;
    };
    const std::size_t one = decodedAhead(1), two = decodedAhead(2 * sample), all = decodedAhead(100 * sample);
    EXPECT_GT(one, 0u) << "one sample is always read";
    EXPECT_NEAR(static_cast<double>(two), 2.0 * static_cast<double>(one), 0.2 * static_cast<double>(one));
    EXPECT_NEAR(static_cast<double>(all), 4.0 * static_cast<double>(one), 0.4 * static_cast<double>(one));
    const auto reader = start(options);
    const auto first = reader->next();
    ASSERT_TRUE(first.ok());
    EXPECT_EQ(sampleBytes(*first), sample);
}

TEST_F(ReaderOfCapture, StopsWhileItReadsAndWhileItWaits) {
    for (int round = 0; round < 20; ++round) {
        DataOptions options = withViews(3);
        options.prefetch = 1 + round % 3;
        const auto reader = start(options);
        if (round % 2) {
            ASSERT_TRUE(reader->next().ok());
        }
    }
    SUCCEED() << "no destructor waited for a sample that nobody takes";
}

TEST_F(ReaderOfCapture, RefusesWhatItCannotDo) {
    const auto message = [&](CaptureSplit split, DataOptions options) {
        const auto reader = DataReader::start(capture_, std::move(split), options, 0);
        EXPECT_FALSE(reader.ok());
        return reader.ok() ? std::string() : reader.error().describe();
    };
    const CaptureSplit all = everything(*capture_);
    CaptureSplit wrong = all;
    wrong.cameras.push_back(9);
    EXPECT_EQ(message(wrong, {}), "data reader: camera 9 of the split is not among the 3 of the capture");
    wrong = all;
    wrong.frames = {};
    EXPECT_NE(message(wrong, {}).find("the split \"train\" has no picture"), std::string::npos);
    EXPECT_NE(message(all, withViews(0)).find("needs a view a step, found 0"), std::string::npos);
    DataOptions options;
    options.prefetch = 0;
    EXPECT_NE(message(all, options).find("at least 1 sample ahead, found 0"), std::string::npos);
    options = {};
    options.view.scale = 0;
    EXPECT_NE(message(all, options).find("picture scale: must lie in [1, 8], found 0"), std::string::npos);
    EXPECT_FALSE(DataReader::start(nullptr, all, {}, 0).ok());
}

} // namespace
} // namespace ars::test
