#include "engine/scene/frame_worker.h"

#include "engine/frame/framing.h"
#include "engine/frame/light_source.h"
#include "engine/frame/rest_avatar.h"
#include "engine/scene/frame_renderer.h"

#include "tests/support/slow_evaluator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <mutex>

namespace ars {
namespace {

constexpr std::chrono::seconds kPatience{60};

/// The open body with few surfels and a coarse light, made once.
struct Scene {
    std::shared_ptr<const AvatarAsset> avatar;
    std::shared_ptr<const LightAsset> light;
};

const Scene& scene() {
    static const Scene made = [] {
        Scene result;
        RestAvatarOptions options;
        options.maxSurfels = 6000;
        auto avatar = std::make_shared<AvatarAsset>();
        avatar->evaluator = restAvatarFromFile("open", options).value();
        result.avatar = avatar;
        auto light = std::make_shared<LightAsset>();
        light->source = std::make_shared<LightSource>(
            filterLight("studio", readLight("studio").value(), {}, LightQuality::Draft, 64).value());
        result.light = light;
        return result;
    }();
    return made;
}

FrameRequest request(int width = 96, int height = 128) {
    FrameRequest result;
    result.avatar = scene().avatar;
    result.light = scene().light;
    result.inputs.pose = restPose(kSmplxJointCount);
    result.inputs.camera =
        orbitCamera(boundsOf(scene().avatar->evaluator->mesh().mesh.positions), 20, 5, 30, width, height);
    result.inputs.occlusion.screenSpace.adaptive = OcclusionAdaptive::Off;
    result.buffers = {BufferId::Beauty, BufferId::AmbientOcclusion, BufferId::Normal};
    return result;
}

/// Every frame that a worker delivers, in order.
class Recorder {
public:
    Recorder()
        : worker({}, [this] {
              const std::lock_guard lock(mutex_);
              if (const auto frame = current_ ? current_->latest() : nullptr) frames_.push_back(frame);
          }) {
        const std::lock_guard lock(mutex_);
        current_ = &worker;
    }
    std::vector<std::shared_ptr<const Frame>> frames() {
        const std::lock_guard lock(mutex_);
        return frames_;
    }
    /// Submits and waits until it stands.
    std::shared_ptr<const Frame> complete(const FrameRequest& wanted) {
        worker.submit(wanted);
        EXPECT_TRUE(worker.waitUntilIdle(kPatience));
        const auto error = worker.takeError();
        EXPECT_FALSE(error) << error->describe();
        return worker.latest();
    }
    /// Submits and waits for the first frame that answers.
    std::shared_ptr<const Frame> first(const FrameRequest& wanted) {
        const std::uint64_t number = worker.submit(wanted);
        for (int i = 0; i < 60000; ++i) {
            for (const auto& frame : frames()) {
                if (frame->request == number) return frame;
            }
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
        ADD_FAILURE() << "no frame came";
        return nullptr;
    }

private:
    std::mutex mutex_;
    std::vector<std::shared_ptr<const Frame>> frames_;
    FrameWorker* current_ = nullptr;

public:
    FrameWorker worker; // last: its thread calls into the members above
};

bool ran(const Frame& frame, FrameStage stage) { return frame.stages[static_cast<std::size_t>(stage)].ran; }

TEST(FrameWorker, TheFullFrameIsWhatThePipelineRenders) {
    const FrameRequest wanted = request();
    Recorder recorder;
    const auto frame = recorder.complete(wanted);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->quality, FrameQuality::Full);
    EXPECT_EQ(frame->occlusionShare, 1.0f);
    EXPECT_TRUE(sameInputs(frame->inputs, wanted.inputs)) << "a full frame says what was asked for";
    auto pipeline = FramePipeline::create(wanted.avatar->evaluator);
    (*pipeline)->setLight(wanted.light->source->filtered);
    ASSERT_TRUE((*pipeline)->render(wanted.inputs, wanted.buffers).ok());
    for (const BufferId id : {BufferId::Beauty, BufferId::AmbientOcclusion, BufferId::Normal, BufferId::Opacity}) {
        const Image direct = (*pipeline)->picture(id).value();
        const Image* shown = frame->picture(id);
        ASSERT_TRUE(shown) << bufferInfo(id).name;
        ASSERT_EQ(shown->pixels.size(), direct.pixels.size());
        for (std::size_t i = 0; i < direct.pixels.size(); ++i) {
            // Refining adds the directions in another order.
            ASSERT_NEAR(shown->pixels[i], direct.pixels[i], 1e-4f) << bufferInfo(id).name;
        }
    }
    EXPECT_TRUE(frame->picture(BufferId::Depth)) << "depth always comes along";
    EXPECT_FALSE(frame->picture(BufferId::Albedo)) << "what nobody wants is not copied";
    const Image& occlusion = *frame->picture(BufferId::AmbientOcclusion);
    const Image& opacity = *frame->picture(BufferId::Opacity);
    EXPECT_EQ(opacity.pixels.front(), 0.0f);
    EXPECT_EQ(occlusion.pixels.front(), 0.0f) << "nothing is where nothing is";
    EXPECT_EQ(frame->surfelMeans->size(), wanted.avatar->evaluator->rig().weights.pointCount());
    EXPECT_EQ(frame->jointWorld.size(), static_cast<std::size_t>(kSmplxJointCount));
    EXPECT_FALSE(frame->surfels);
    EXPECT_FALSE(frame->parts);
}

TEST(FrameWorker, AtRestThePictureBecomesFinerUntilItIsFull) {
    FrameRequest wanted = request();
    wanted.inputs.occlusion.screenSpace.adaptive = OcclusionAdaptive::Both;
    Recorder recorder;
    recorder.complete(wanted);
    const auto frames = recorder.frames();
    ASSERT_GE(frames.size(), 2u);
    for (std::size_t i = 0; i + 1 < frames.size(); ++i) {
        EXPECT_EQ(frames[i]->quality, FrameQuality::Refining);
        EXPECT_LT(frames[i]->occlusionShare, frames[i + 1]->occlusionShare);
    }
    EXPECT_EQ(frames.back()->quality, FrameQuality::Full);
    EXPECT_LT(frames.front()->occlusionShare, 0.2f) << "the first picture does not wait for the last";
    EXPECT_EQ(recorder.worker.rates().frames, frames.size());
    EXPECT_TRUE(recorder.worker.idle());
}

TEST(FrameWorker, TheSameRequestCostsNothing) {
    const FrameRequest wanted = request();
    Recorder recorder;
    recorder.complete(wanted);
    const auto frames = recorder.frames().size();
    const std::uint64_t number = recorder.worker.latest()->request;
    EXPECT_EQ(recorder.worker.submit(wanted), number);
    EXPECT_TRUE(recorder.worker.idle());
    EXPECT_EQ(recorder.frames().size(), frames);
    FrameRequest other = wanted;
    other.inputs.radii[0] *= 0.5f;
    EXPECT_EQ(recorder.worker.submit(other), number + 1);
}

TEST(FrameWorker, DraftsPoseTheLastSurfelsAndRestEvaluatesThem) {
    const auto slow = std::make_shared<test::SlowEvaluator>(scene().avatar->evaluator, std::chrono::milliseconds(60));
    auto avatar = std::make_shared<AvatarAsset>();
    avatar->evaluator = slow;
    FrameRequest wanted = request();
    wanted.avatar = avatar;
    wanted.buffers = {BufferId::Normal};
    Recorder recorder;
    const auto before = recorder.complete(wanted);
    EXPECT_EQ(slow->evaluations, 1);
    wanted.moving = true;
    wanted.inputs.pose.rotations[0] = quatFromAxisAngle({0, 1.0f, 0});
    const auto draft = recorder.first(wanted);
    EXPECT_EQ(draft->quality, FrameQuality::Draft) << "old surfels are not the full picture, whatever its size";
    EXPECT_FALSE(ran(*draft, FrameStage::Evaluate));
    EXPECT_EQ(slow->evaluations, 1);
    // Turned about the vertical, every surfel keeps its height.
    ASSERT_EQ(draft->surfelMeans->size(), before->surfelMeans->size());
    EXPECT_NEAR((*draft->surfelMeans)[100].y, (*before->surfelMeans)[100].y, 1e-5f);
    EXPECT_GT(glm::distance((*draft->surfelMeans)[100], (*before->surfelMeans)[100]), 1e-4f);
    wanted.moving = false;
    const auto full = recorder.complete(wanted);
    EXPECT_EQ(slow->evaluations, 2);
    EXPECT_EQ(full->quality, FrameQuality::Full);
    EXPECT_NEAR((*full->surfelMeans)[100].y, (*before->surfelMeans)[100].y + 0.01f, 1e-5f);
}

TEST(FrameWorker, WhatIsHeldStillBecomesFull) {
    FrameRequest wanted = request();
    wanted.moving = true;
    Recorder recorder;
    const auto frame = recorder.complete(wanted);
    EXPECT_EQ(frame->quality, FrameQuality::Full);
    EXPECT_NE(recorder.frames().front()->quality, FrameQuality::Full);
}

TEST(FrameWorker, OvertakenRequestsAreNeverStarted) {
    const auto slow = std::make_shared<test::SlowEvaluator>(scene().avatar->evaluator, std::chrono::milliseconds(100));
    auto avatar = std::make_shared<AvatarAsset>();
    avatar->evaluator = slow;
    FrameRequest wanted = request();
    wanted.avatar = avatar;
    Recorder recorder;
    std::uint64_t last = 0;
    for (int i = 0; i < 40; ++i) {
        wanted.inputs.pose.rotations[0] = quatFromAxisAngle({0, 0.01f * static_cast<float>(i), 0});
        last = recorder.worker.submit(wanted);
    }
    EXPECT_EQ(last, 40u);
    ASSERT_TRUE(recorder.worker.waitUntilIdle(kPatience));
    EXPECT_EQ(recorder.worker.latest()->request, last);
    EXPECT_LE(slow->evaluations, 3) << "one under way, perhaps one more, and the last";
}

TEST(FrameWorker, AFirstDraftIsHalfTheSizeAndItsPicturesFitItsCamera) {
    FrameRequest wanted = request(151, 201);
    wanted.moving = true;
    Recorder recorder;
    const auto frame = recorder.first(wanted);
    EXPECT_EQ(frame->quality, FrameQuality::Draft);
    EXPECT_EQ(frame->inputs.camera.width, 76);
    EXPECT_EQ(frame->inputs.camera.height, 101);
    EXPECT_NEAR(frame->inputs.camera.fx, wanted.inputs.camera.fx * 76 / 151, 1e-9);
    for (const auto& [id, picture] : frame->pictures) {
        EXPECT_EQ(picture->width, 76) << bufferInfo(id).name;
        EXPECT_EQ(picture->height, 101) << bufferInfo(id).name;
    }
    EXPECT_NE(frame->inputs.occlusion.screenSpace.quality, OcclusionQuality::Full);
}

TEST(FrameWorker, ATurnedLightStaysAtFullSizeAndQuality) {
    FrameRequest wanted = request();
    Recorder recorder;
    recorder.complete(wanted);
    wanted.moving = true;
    wanted.inputs.placement.rotationDeg = 25.0f;
    const auto frame = recorder.first(wanted);
    EXPECT_EQ(frame->quality, FrameQuality::Full);
    EXPECT_EQ(frame->inputs.camera, wanted.inputs.camera);
    EXPECT_EQ(frame->inputs.placement.rotationDeg, 25.0f);
    EXPECT_FALSE(ran(*frame, FrameStage::Splat));
    EXPECT_FALSE(ran(*frame, FrameStage::Occlude));
    EXPECT_TRUE(ran(*frame, FrameStage::Shade));
}

TEST(FrameWorker, AFrameThatSomebodyHoldsNeverChanges) {
    FrameRequest wanted = request();
    Recorder recorder;
    const auto held = recorder.complete(wanted);
    const std::vector<float> before = held->picture(BufferId::Beauty)->pixels;
    for (int i = 1; i < 8; ++i) {
        wanted.inputs.pose.rotations[16] = quatFromAxisAngle({0, 0, -0.1f * static_cast<float>(i)});
        wanted.moving = i % 2 == 0;
        recorder.first(wanted);
    }
    ASSERT_TRUE(recorder.worker.waitUntilIdle(kPatience));
    EXPECT_EQ(held->picture(BufferId::Beauty)->pixels, before);
    EXPECT_NE(recorder.worker.latest()->picture(BufferId::Beauty)->pixels, before);
}

TEST(FrameWorker, AFailedRequestIsSaidOnceAndTheLastGoodFrameStays) {
    FrameRequest wanted = request();
    Recorder recorder;
    const auto good = recorder.complete(wanted);
    FrameRequest bad = wanted;
    bad.inputs.camera.fx = -1.0;
    recorder.worker.submit(bad);
    ASSERT_TRUE(recorder.worker.waitUntilIdle(kPatience));
    const auto error = recorder.worker.takeError();
    ASSERT_TRUE(error);
    EXPECT_EQ(error->code, ErrorCode::InvalidArgument);
    EXPECT_FALSE(recorder.worker.takeError());
    EXPECT_EQ(recorder.worker.latest(), good);
    bad = wanted;
    bad.avatar = nullptr;
    recorder.worker.submit(bad);
    ASSERT_TRUE(recorder.worker.waitUntilIdle(kPatience));
    EXPECT_TRUE(recorder.worker.takeError());
    wanted.inputs.radii[3] *= 0.9f;
    EXPECT_EQ(recorder.complete(wanted)->quality, FrameQuality::Full) << "and the next one goes well";
}

TEST(FrameWorker, WithoutALightThereAreNoShadedBuffers) {
    FrameRequest wanted = request();
    wanted.light = nullptr;
    Recorder recorder;
    const auto frame = recorder.complete(wanted);
    EXPECT_FALSE(frame->picture(BufferId::Beauty));
    EXPECT_TRUE(frame->picture(BufferId::Normal));
    EXPECT_EQ(frame->quality, FrameQuality::Full);
}

TEST(FrameWorker, EveryBufferOfTheCatalogueCanBeSeen) {
    FrameRequest wanted = request();
    wanted.surfels = true;
    wanted.buffers.clear();
    for (const BufferInfo& info : bufferCatalogue()) wanted.buffers.push_back(info.id);
    Recorder recorder;
    const auto frame = recorder.complete(wanted);
    for (const BufferInfo& info : bufferCatalogue()) {
        ASSERT_TRUE(frame->picture(info.id)) << info.name;
        EXPECT_EQ(frame->picture(info.id)->channels, info.channels()) << info.name;
    }
    ASSERT_TRUE(frame->surfels);
    EXPECT_EQ(frame->surfels->count(), frame->surfelMeans->size());
    EXPECT_EQ(frame->surfels->means, *frame->surfelMeans);
}

TEST(FrameWorker, ThePartsHaveTheirColours) {
    FrameRequest wanted = request(192, 256);
    wanted.parts = true;
    Recorder recorder;
    const auto frame = recorder.complete(wanted);
    ASSERT_TRUE(frame->parts);
    const Image& parts = *frame->parts;
    ASSERT_EQ(parts.channels, 3);
    EXPECT_EQ(parts.pixels[0] + parts.pixels[1] + parts.pixels[2], 0.0f);
    // At joints two parts blend; a third of the way to the next joint belongs to the first.
    const auto colorAt = [&](const char* joint, const char* next) {
        const auto at = [&](const char* name) {
            return glm::dvec3(frame->jointWorld[static_cast<std::size_t>(smplxJointIndex(name))][3]);
        };
        const glm::dvec3 place = glm::mix(at(joint), at(next), 0.35);
        const glm::dvec2 pixel = frame->inputs.camera.project(frame->inputs.camera.toCamera(place));
        const int row = static_cast<int>(pixel.y), column = static_cast<int>(pixel.x);
        return glm::vec3(parts.at(row, column, 0), parts.at(row, column, 1), parts.at(row, column, 2));
    };
    const auto expectPart = [&](const char* joint, const char* next, BodyPart part) {
        const glm::vec3 color = colorAt(joint, next);
        const auto& colors = bodyPartColors();
        std::size_t nearest = 0;
        for (std::size_t i = 0; i < colors.size(); ++i) {
            if (glm::distance(color, colors[i]) < glm::distance(color, colors[nearest])) nearest = i;
        }
        EXPECT_EQ(nearest, static_cast<std::size_t>(part)) << joint;
    };
    expectPart("head", "jaw", BodyPart::Head);
    expectPart("spine2", "spine3", BodyPart::Torso);
    expectPart("left_middle2", "left_middle3", BodyPart::Hand);
    expectPart("left_elbow", "left_wrist", BodyPart::Elbow);
    expectPart("right_knee", "right_ankle", BodyPart::Knee);
    // Nothing changed where nothing moved: the picture is the same one.
    FrameRequest turned = wanted;
    turned.inputs.placement.rotationDeg = 10.0f;
    EXPECT_EQ(recorder.complete(turned)->parts, frame->parts);
}

TEST(FrameWorker, ComparisonMethodsAreDraftedWithFewerRaysAndEndInFull) {
    FrameRequest wanted = request(64, 80);
    wanted.inputs.occlusion.method = OcclusionMethod::MeshRays;
    wanted.inputs.occlusion.meshRays.rays = 128;
    Recorder recorder;
    const auto full = recorder.complete(wanted);
    EXPECT_EQ(full->quality, FrameQuality::Full);
    EXPECT_EQ(full->inputs.occlusion.meshRays.rays, 128);
    wanted.moving = true;
    wanted.inputs.pose.rotations[16] = quatFromAxisAngle({0, 0, -0.5f});
    const auto draft = recorder.first(wanted);
    EXPECT_NE(draft->quality, FrameQuality::Full);
    EXPECT_EQ(draft->inputs.occlusion.method, OcclusionMethod::MeshRays);
    EXPECT_LT(draft->inputs.occlusion.meshRays.rays, 128);
    EXPECT_LT(draft->occlusionShare, 1.0f);
    wanted.moving = false;
    EXPECT_EQ(recorder.complete(wanted)->inputs.occlusion.meshRays.rays, 128);
}

TEST(DraftLevels, AreAsFineAsTheTimeAllowsAndDoNotFlicker) {
    using Times = std::array<double, kDraftLevelCount>;
    EXPECT_EQ(chooseDraftLevel(Times{-1, -1, -1, -1, -1}, 0), kFirstDraftLevel) << "nothing is known";
    EXPECT_EQ(chooseDraftLevel(Times{5, 3, 2, 1, 1}, kFirstDraftLevel), 0);
    const double close = 0.9 * kDraftBudgetMs;
    EXPECT_EQ(chooseDraftLevel(Times{close, close / 2, close / 4, close / 8, close / 16}, 0), 0) << "stays";
    EXPECT_EQ(chooseDraftLevel(Times{close, close / 2, close / 4, close / 8, close / 16}, 2), 1)
        << "does not come back before there is room";
    const double slow = 3.0 * kDraftBudgetMs;
    EXPECT_EQ(chooseDraftLevel(Times{slow, slow / 2, slow / 4, slow / 8, slow / 16}, 0), 2);
    EXPECT_EQ(chooseDraftLevel(Times{900, 800, 700, 600, 500}, 0), kDraftLevelCount - 1) << "nothing fits";
}

} // namespace
} // namespace ars
