// The window with a trained avatar: a wrist, a light, a radius and the camera each change the buffers that they should
// and not a bit of the others. ARS_TRAINED_AVATAR names the avatar (folder, run or checkpoint); without it a small one
// with untrained networks is made.
#include "tests/unit/ui/trained_studio.h"

#include "engine/io/exr.h"
#include "engine/rig/body_parts.h"
#include "ui/viewport/probe.h"
#include "ui/viewport/view.h"

#include <imgui_internal.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <set>

namespace ars::ui {
namespace {

using test::BufferChange;
using test::changeOf;
using test::CountedNetworks;
using test::FrameTimes;
using test::StudioDriver;
using Ids = std::set<BufferId>;
using FramePointer = std::shared_ptr<const Frame>;
using Clock = std::chrono::steady_clock;

constexpr double kPatienceS = 600.0; ///< never waited for, unless something hangs
constexpr double kReach = 4.0;       ///< standard deviations that a splatted surfel covers at most

/// Every picture of the program; R+ and R- belong to training.
Ids allBuffers() {
    Ids all;
    for (const BufferInfo& info : bufferCatalogue()) {
        if (info.id != BufferId::RadiusPlus && info.id != BufferId::RadiusMinus) all.insert(info.id);
    }
    return all;
}

const Ids kShaded{BufferId::Beauty, BufferId::Diffuse, BufferId::Specular};

/// One window for all tests; each begins with the avatar as it opened.
class TrainedStudio : public ::testing::Test {
protected:
    struct Shared {
        ars::test::TemporaryFolder folder;
        std::unique_ptr<StudioDriver> studio;
        std::shared_ptr<CountedNetworks> networks;
        Document opened;
        std::string failure = "the window did not open";
    };
    static std::unique_ptr<Shared>& shared() {
        static std::unique_ptr<Shared> made;
        return made;
    }
    static void SetUpTestSuite() {
        shared() = std::make_unique<Shared>();
        const char* given = std::getenv("ARS_TRAINED_AVATAR");
        const std::filesystem::path avatar =
            given ? std::filesystem::absolute(given) : shared()->folder.path() / "small.avatar";
        if (!given) {
            const Status written = ars::test::writeSmallTrainedAvatar(avatar);
            ASSERT_TRUE(written.ok()) << written.error().describe();
        }
        const auto least = std::chrono::milliseconds(given ? 0 : 30);
        setTrainedAvatarOpener([least](const std::filesystem::path& path, bool project) -> Result<OpenedTrainedAvatar> {
            ARS_TRY(OpenedTrainedAvatar opened, ars::test::openThroughPlugin(path, project));
            shared()->networks = std::make_shared<CountedNetworks>(opened.evaluator, least);
            opened.evaluator = shared()->networks;
            return opened;
        });
        shared()->studio = std::make_unique<StudioDriver>(1280, 800, shared()->folder.path() / "state");
        StudioDriver& studio = *shared()->studio;
        studio.studio().setOpen("buffers", false); // while it is seen, pictures that stand have all buffers
        ASSERT_TRUE(studio.window().settle(kPatienceS));
        studio.studio().drop({avatar});
        ASSERT_TRUE(studio.window().settle(kPatienceS));
        for (const Notice& notice : studio.studio().notices())
            EXPECT_NE(notice.kind, Notice::Kind::Error) << notice.text;
        ASSERT_EQ(studio.document().avatar.source, avatar.string());
        shared()->opened = studio.document();
        shared()->failure.clear();
        std::printf("%s: %s\n", avatar.c_str(), shared()->networks->description().c_str());
    }
    static void TearDownTestSuite() {
        shared()->studio.reset();
        setTrainedAvatarOpener({});
        shared().reset();
    }
    void SetUp() override {
        ASSERT_EQ(shared()->failure, "");
        session().replaceDocument(shared()->opened, {}, true);
        settle();
        before_ = everything();
        poses_ = networks().poses;
        views_ = networks().views;
    }

    StudioDriver& studio() { return *shared()->studio; }
    Session& session() { return studio().session(); }
    const Document& document() { return studio().document(); }
    CountedNetworks& networks() { return *shared()->networks; }
    int posesSince() { return networks().poses - poses_; }
    int viewsSince() { return networks().views - views_; }
    void settle() { ASSERT_TRUE(studio().window().settle(kPatienceS)) << "the picture does not come to rest"; }

    /// The full picture that stands, with all buffers and the posed surfels. The window then goes back to what a person
    /// looks at, so that times are those of the shaded picture alone.
    FramePointer everything() {
        pinProbe(true);
        EXPECT_TRUE(session().run("view.surfel_discs", {{"enabled", true}}).ok());
        settle();
        const FramePointer frame = session().frame();
        pinProbe(false);
        EXPECT_TRUE(session().run("view.surfel_discs", {{"enabled", false}}).ok());
        settle();
        EXPECT_EQ(frame->quality, FrameQuality::Full);
        for (const BufferId id : allBuffers()) {
            const Image* picture = frame->picture(id);
            const bool shows = picture && std::any_of(picture->pixels.begin(), picture->pixels.end(),
                                                      [](float value) { return value != 0.0f; });
            EXPECT_TRUE(shows) << bufferInfo(id).name << " shows nothing";
        }
        return frame;
    }

    /// Press, move in steps with a frame after each, release; then until everything stands.
    void drag(FrameTimes& times, const ImVec2& from, const ImVec2& by) {
        studio().act([&](ImGuiTestContext* person) {
            person->MouseMoveToPos(from);
            person->Yield(3);
            person->MouseDown();
            for (int i = 1; i <= 8; ++i) {
                const float t = static_cast<float>(i) / 8;
                person->MouseMoveToPos({from.x + by.x * t, from.y + by.y * t});
                for (int k = 0; k < 200; ++k) {
                    person->Yield();
                    if (times.look(session().frame())) break;
                    std::this_thread::sleep_for(std::chrono::milliseconds(5));
                }
            }
            posesDuring_ = posesSince();
            person->MouseUp();
            person->Yield();
        });
        stand(times);
    }
    void stand(FrameTimes& times) {
        const auto begun = Clock::now();
        const auto since = [&] { return std::chrono::duration<double>(Clock::now() - begun).count(); };
        while (!session().settled() && since() < kPatienceS) {
            studio().window().step();
            times.look(session().frame());
            std::this_thread::sleep_for(std::chrono::milliseconds(2)); // leaves the processor to the frames
        }
        times.fullMs = 1e3 * since();
        EXPECT_EQ(session().frame()->quality, FrameQuality::Full);
    }
    ImRect rectOf(const char* item) {
        ImRect rect;
        studio().act([&](ImGuiTestContext* person) {
            person->MouseMove(item);
            rect = person->ItemInfo(item).RectFull;
        });
        return rect;
    }
    std::optional<ImVec2> onScreen(const glm::dvec3& world) {
        const ImRect rect = rectOf("//Viewport/Picture");
        const PictureView view{rect.Min, rect.GetSize(),
                               resizedCamera(session().frame()->inputs.camera, static_cast<int>(rect.GetWidth()),
                                             static_cast<int>(rect.GetHeight()))};
        return view.toScreen(world);
    }
    glm::dvec3 joint(const char* name) {
        const int index = networks().rig().skeleton.find(name);
        return glm::dvec3(session().frame()->jointWorld.at(static_cast<std::size_t>(index))[3]);
    }

    /// Exactly these buffers differ; the share of the avatar's pixels is printed.
    void expectChanged(const char* act, const FramePointer& after, const Ids& expected) {
        std::printf("%s changes", act);
        for (const BufferId id : allBuffers()) {
            const BufferChange change = changeOf(*before_, *after, id);
            if (!change.pixels.empty())
                std::printf(" %s %.1f %%", std::string(bufferInfo(id).name).c_str(), 100 * change.share());
            EXPECT_EQ(!change.pixels.empty(), expected.contains(id)) << act << ": " << bufferInfo(id).name;
        }
        std::printf("\n");
        std::fflush(stdout);
    }
    /// Weight of the joints that `counts` has, of every surfel.
    std::vector<float> weightOf(const std::function<bool(std::size_t)>& counts) {
        const SkinWeights& weights = networks().rig().weights;
        std::vector<float> sums(weights.pointCount(), 0.0f);
        for (std::size_t i = 0; i < weights.weights.size(); ++i) {
            if (counts(weights.joints[i])) sums[i / kMaxInfluences] += weights.weights[i];
        }
        return sums;
    }

    /// Where a surfel reaches in the picture, pixels.
    struct Footprint {
        glm::dvec2 center;
        double radius;
    };
    static glm::dvec2 pixelOf(const Frame& frame, const glm::dvec3& world) {
        return frame.inputs.camera.project(frame.inputs.camera.toCamera(world));
    }
    /// Of the surfels whose weight is not 0.
    static std::vector<Footprint> footprintsOf(const Frame& frame, const std::vector<float>& weights) {
        const Camera& camera = frame.inputs.camera;
        std::vector<Footprint> footprints;
        for (std::size_t i = 0; i < weights.size(); ++i) {
            if (weights[i] == 0.0f) continue;
            const glm::dvec3 mean(frame.surfels->means[i]);
            const glm::dvec2 scale(frame.surfels->scales[i]);
            const double sigma = std::max(scale.x, scale.y) * camera.fy / camera.toCamera(mean).z;
            footprints.push_back({pixelOf(frame, mean), kReach * sigma + 4.0});
        }
        return footprints;
    }

    FramePointer before_;
    int poses_ = 0, views_ = 0, posesDuring_ = 0;
};

TEST_F(TrainedStudio, AWristMovesItsArmAtOnceAndTheNetworksAnswerAtRest) {
    const auto from = onScreen(glm::mix(joint("left_elbow"), joint("left_wrist"), 0.8));
    ASSERT_TRUE(from);
    FrameTimes times(session().frame());
    drag(times, *from, {30, -90});
    times.print("wrist");
    EXPECT_GE(posesSince(), 1);
    EXPECT_LE(posesSince(), posesDuring_ + 1) << "at rest the networks run once";
    EXPECT_EQ(viewsSince(), 0) << "nobody looks at radiance";
    const FramePointer after = everything();
    expectChanged("wrist", after, allBuffers());

    // The skeleton moves in the arm alone.
    const Skeleton& skeleton = networks().rig().skeleton;
    std::vector<bool> moved(before_->jointWorld.size());
    const int collar = skeleton.find("left_collar");
    for (std::size_t j = 0; j < moved.size(); ++j) {
        moved[j] = before_->jointWorld[j] != after->jointWorld[j];
        int above = static_cast<int>(j);
        while (above >= 0 && above != collar) above = skeleton.parents[static_cast<std::size_t>(above)];
        EXPECT_TRUE(above == collar || !moved[j]) << skeleton.names[j] << " moved";
    }
    EXPECT_TRUE(moved[static_cast<std::size_t>(skeleton.find("left_wrist"))]);

    // A draft follows by skinning alone: not a bit of the surfels elsewhere.
    const std::vector<float> arm = weightOf([&](std::size_t j) { return moved[j]; });
    const auto evaluations = [](const Frame& frame) {
        return frame.stages[static_cast<std::size_t>(FrameStage::Evaluate)].runs;
    };
    for (const FramePointer& draft : times.drafts) {
        if (evaluations(*draft) != evaluations(*before_)) continue;
        std::size_t strays = 0, followers = 0;
        for (std::size_t i = 0; i < arm.size(); ++i) {
            const bool same = (*draft->surfelMeans)[i] == (*before_->surfelMeans)[i];
            strays += arm[i] == 0.0f && !same;
            followers += arm[i] > 0.5f && !same;
        }
        EXPECT_EQ(strays, 0u);
        EXPECT_GT(followers, 100u);
    }
    if (!std::getenv("ARS_TRAINED_AVATAR")) {
        EXPECT_FALSE(times.drafts.empty());
    }

    // At rest the networks see the whole pose and may answer anywhere, but by far less than the arm moves.
    double elsewhere = 0.0, inArm = 0.0;
    std::size_t answered = 0, others = 0, inArmCount = 0;
    for (std::size_t i = 0; i < arm.size(); ++i) {
        const double way = glm::distance(after->surfels->means[i], before_->surfels->means[i]);
        if (arm[i] == 0.0f) {
            ++others;
            answered += way > 0.0;
            elsewhere += way;
        } else if (arm[i] > 0.5f) {
            ++inArmCount;
            inArm += way;
        }
    }
    ASSERT_GT(others, 0u);
    ASSERT_GT(inArmCount, 0u);
    std::printf("wrist: arm surfels move %.1f mm in the mean, of the others %zu of %zu, %.3f mm in the mean\n",
                1e3 * inArm / static_cast<double>(inArmCount), answered, others,
                1e3 * elsewhere / static_cast<double>(others));
    EXPECT_GT(answered, 0u);
    EXPECT_LT(elsewhere / static_cast<double>(others), 0.1 * inArm / static_cast<double>(inArmCount));
}

TEST_F(TrainedStudio, AnotherLightChangesShadingAlone) {
    Image panorama;
    panorama.width = 64;
    panorama.height = 32;
    panorama.channels = 3;
    for (int row = 0; row < 32; ++row) {
        for (int column = 0; column < 64; ++column) {
            const bool lamp = std::abs(row - 10) < 3 && std::abs(column - 20) < 4;
            for (const float grey : {0.2f, 0.4f, 0.7f}) panorama.pixels.push_back(lamp ? 25.0f : grey);
        }
    }
    ExrImage exr;
    ASSERT_TRUE(addExrLayer(exr, "", panorama, "RGB", ExrPixelType::Float).ok());
    const std::filesystem::path file = shared()->folder.path() / "lamp.exr";
    ASSERT_TRUE(writeExr(file, exr).ok());

    FrameTimes times(session().frame());
    studio().studio().drop({file});
    stand(times);
    times.print("light");
    ASSERT_EQ(document().light.file, file.string());
    const FramePointer after = everything();
    expectChanged("light", after, kShaded);
    for (const BufferId id : kShaded) EXPECT_GT(changeOf(*before_, *after, id).share(), 0.9) << bufferInfo(id).name;
    EXPECT_EQ(posesSince() + viewsSince(), 0) << "the networks see no light";
}

TEST_F(TrainedStudio, AnElbowRadiusChangesOcclusionAroundTheElbowsAlone) {
    studio().studio().setOpen("occlusion", true);
    studio().window().step();
    const ImRect slider = rectOf("//Occlusion/**/##Elbow radius");
    FrameTimes times(session().frame());
    drag(times, {slider.Min.x + 0.3f * slider.GetWidth(), slider.GetCenter().y}, {0.62f * slider.GetWidth(), 0.0f});
    times.print("elbow radius");
    const auto elbow = static_cast<std::size_t>(BodyPart::Elbow);
    PartRadii radii = shared()->opened.occlusion.radii;
    EXPECT_GT(document().occlusion.radii[elbow], 1.2f * radii[elbow]);
    radii[elbow] = document().occlusion.radii[elbow];
    EXPECT_EQ(document().occlusion.radii, radii);
    const FramePointer after = everything();
    Ids expected = kShaded;
    expected.insert({BufferId::AmbientOcclusion, BufferId::Radius});
    expectChanged("elbow radius", after, expected); // importance stays: it is made of the initial radii
    EXPECT_EQ(posesSince() + viewsSince(), 0) << "the networks see no radius";

    // Of the surfels exactly those that hang on an elbow have another radius.
    const std::vector<BodyPart>& parts = networks().rig().parts;
    const std::vector<float> onElbow = weightOf([&](std::size_t j) { return parts[j] == BodyPart::Elbow; });
    const Surfels &now = *after->surfels, &then = *before_->surfels;
    EXPECT_EQ(now.means, then.means);
    EXPECT_EQ(now.importances, then.importances);
    for (std::size_t i = 0; i < now.count(); ++i) {
        if (onElbow[i] > 1e-3f) {
            ASSERT_GT(now.radii[i], then.radii[i]) << "surfel " << i;
        } else if (onElbow[i] == 0.0f) {
            ASSERT_EQ(now.radii[i], then.radii[i]) << "surfel " << i;
        }
    }
    // So of the pixels those that such surfels reach, of both arms; what follows from the radius stays within them.
    const std::vector<std::size_t> wider = changeOf(*before_, *after, BufferId::Radius).pixels;
    const std::vector<Footprint> footprints = footprintsOf(*after, onElbow);
    const glm::dvec2 leftElbow = pixelOf(*after, joint("left_elbow")),
                     rightElbow = pixelOf(*after, joint("right_elbow"));
    const auto width = static_cast<std::size_t>(after->inputs.camera.width);
    std::size_t left = 0, right = 0;
    for (const std::size_t pixel : wider) {
        const glm::dvec2 at(static_cast<double>(pixel % width) + 0.5, static_cast<double>(pixel / width) + 0.5);
        ASSERT_TRUE(std::any_of(footprints.begin(), footprints.end(),
                                [&](const Footprint& f) { return glm::distance(f.center, at) <= f.radius; }))
            << "pixel " << at.x << ", " << at.y;
        (glm::distance(at, leftElbow) < glm::distance(at, rightElbow) ? left : right) += 1;
    }
    EXPECT_GT(left, 20u);
    EXPECT_GT(right, 20u);
    const std::set<std::size_t> allowed(wider.begin(), wider.end());
    for (const BufferId id : {BufferId::AmbientOcclusion, BufferId::Beauty, BufferId::Diffuse, BufferId::Specular}) {
        for (const std::size_t pixel : changeOf(*before_, *after, id).pixels)
            ASSERT_TRUE(allowed.contains(pixel)) << bufferInfo(id).name << " at pixel " << pixel;
    }
}

TEST_F(TrainedStudio, ATurnedCameraChangesEveryPictureAndOfTheSurfelsTheirColoursAlone) {
    const ImRect picture = rectOf("//Viewport/Picture");
    FrameTimes times(session().frame());
    drag(times, {picture.Min.x + 0.08f * picture.GetWidth(), picture.GetCenter().y}, {150, 0});
    times.print("camera");
    EXPECT_EQ(document().pose, shared()->opened.pose);
    EXPECT_EQ(posesSince() + viewsSince(), 0) << "a shaded picture needs no colours of a view";
    const FramePointer after = everything();
    expectChanged("camera", after, allBuffers());
    const Surfels &now = *after->surfels, &then = *before_->surfels;
    EXPECT_EQ(now.means, then.means);
    EXPECT_EQ(now.rotations, then.rotations);
    EXPECT_EQ(now.scales, then.scales);
    EXPECT_EQ(now.opacities, then.opacities);
    EXPECT_EQ(now.albedos, then.albedos);
    EXPECT_EQ(now.roughnesses, then.roughnesses);
    EXPECT_EQ(now.radii, then.radii);
    EXPECT_EQ(now.importances, then.importances);
    EXPECT_EQ(now.bones, then.bones);
    EXPECT_EQ(now.colors != then.colors, networks().colorsDependOnView());
    EXPECT_EQ(posesSince(), 0) << "only the level that sees the view runs again";
    EXPECT_EQ(viewsSince(), networks().colorsDependOnView() ? 1 : 0);
}

} // namespace
} // namespace ars::ui
