#pragma once

#include "tests/unit/ui/small_trained_avatar.h"
#include "tests/unit/ui/studio_driver.h"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

namespace ars::ui::test {

/// An opened avatar that counts what is asked of its networks.
class CountedNetworks final : public AvatarEvaluator {
public:
    /// @param least  time that an evaluation takes at least: networks that follow every step of a drag leave no draft
    CountedNetworks(std::shared_ptr<AvatarEvaluator> inner, std::chrono::milliseconds least)
        : inner_(std::move(inner)), least_(least) {}
    const AvatarRig& rig() const override { return inner_->rig(); }
    const TemplateMesh& mesh() const override { return inner_->mesh(); }
    std::string description() const override { return inner_->description(); }
    bool dependsOnPose() const override { return inner_->dependsOnPose(); }
    bool colorsDependOnView() const override { return inner_->colorsDependOnView(); }
    bool sameSurfels(const Pose& a, const Pose& b) const override { return inner_->sameSurfels(a, b); }
    Status evaluate(const Pose& pose, const Camera* view, Surfels& surfels) override {
        const auto begun = std::chrono::steady_clock::now();
        if (!last_ || !sameSurfels(*last_, pose))
            ++poses;
        else if (view)
            ++views;
        last_ = pose;
        ARS_TRY_STATUS(inner_->evaluate(pose, view, surfels));
        std::this_thread::sleep_until(begun + least_);
        return {};
    }

    std::atomic<int> poses{0}; ///< whole evaluations
    std::atomic<int> views{0}; ///< those of another view of the same pose: the level that sees the view alone

private:
    std::shared_ptr<AvatarEvaluator> inner_;
    std::chrono::milliseconds least_;
    std::optional<Pose> last_;
};

/// How two pictures of one buffer differ.
struct BufferChange {
    std::size_t covered = 0; ///< pixels where either shows something of the avatar
    std::vector<std::size_t> pixels;
    double share() const { return covered ? static_cast<double>(pixels.size()) / static_cast<double>(covered) : 0.0; }
};

inline BufferChange changeOf(const Frame& before, const Frame& after, BufferId id) {
    BufferChange change;
    const Image &a = *before.picture(id), &b = *after.picture(id);
    const Image &coverA = *before.picture(BufferId::Opacity), &coverB = *after.picture(BufferId::Opacity);
    if (a.pixels.size() != b.pixels.size()) {
        ADD_FAILURE() << bufferInfo(id).name << ": pictures of two sizes";
        return change;
    }
    const auto channels = static_cast<std::size_t>(a.channels);
    for (std::size_t pixel = 0; pixel < coverA.pixels.size(); ++pixel) {
        change.covered += coverA.pixels[pixel] > 0.0f || coverB.pixels[pixel] > 0.0f;
        // Bits, not values: nothing may even be computed anew in another order.
        if (std::memcmp(&a.pixels[channels * pixel], &b.pixels[channels * pixel], channels * sizeof(float)) != 0) {
            change.pixels.push_back(pixel);
        }
    }
    return change;
}

/// Frames that came while something was done, and how long they took.
struct FrameTimes {
    explicit FrameTimes(std::shared_ptr<const Frame> now) : last(std::move(now)) {}

    /// True where this frame is a new one.
    bool look(const std::shared_ptr<const Frame>& frame) {
        if (frame == last) return false;
        last = frame;
        const bool draftLight = frame->light && frame->light->quality == LightQuality::Draft;
        if (frame->quality == FrameQuality::Draft || draftLight) drafts.push_back(frame);
        return true;
    }
    void print(const char* act) const {
        std::vector<double> ms;
        for (const auto& draft : drafts) ms.push_back(draft->totalMs);
        std::sort(ms.begin(), ms.end());
        std::printf("%s:", act);
        if (ms.empty()) {
            std::printf(" no draft, every frame was full;");
        } else {
            const Camera& size = drafts.back()->inputs.camera;
            std::printf(" %zu drafts, best %.0f ms, half below %.0f ms, worst %.0f ms, the last of %dx%d;", ms.size(),
                        ms.front(), ms[ms.size() / 2], ms.back(), size.width, size.height);
        }
        std::printf(" full %dx%d %.0f ms after the hand;", last->inputs.camera.width, last->inputs.camera.height,
                    fullMs);
        for (const StageReport& stage : last->stages)
            std::printf(" %s %.0f", std::string(frameStageName(stage.stage)).c_str(), stage.milliseconds);
        std::printf(" ms\n");
        std::fflush(stdout);
    }

    std::shared_ptr<const Frame> last;
    std::vector<std::shared_ptr<const Frame>> drafts;
    double fullMs = 0.0; ///< from the end of the act until everything stands
};

} // namespace ars::ui::test
