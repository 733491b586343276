// The viewport: its geometry against closed forms, and what a person's mouse does in it through the test engine.
#include "engine/scene/evaluate.h"
#include "ui/viewport/backdrop.h"
#include "ui/viewport/comparison.h"
#include "ui/viewport/layout.h"
#include "ui/viewport/marks.h"
#include "ui/viewport/painter.h"
#include "ui/viewport/picking.h"
#include "ui/viewport/probe.h"
#include "ui/viewport/view.h"

#include "tests/unit/ui/look_support.h"

#include <imgui_internal.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

namespace ars::ui {
namespace {

Skeleton bodySkeleton() { return smplxSkeleton(std::vector<glm::vec3>(kSmplxJointCount)); }

TEST(ViewportPicking, AGrabbedSegmentDragsItsFarEnd) {
    const Skeleton skeleton = bodySkeleton();
    const struct {
        const char *skin, *dragged, *name;
    } expected[] = {{"left_hip", "left_knee", "Left thigh"},
                    {"right_knee", "right_ankle", "Right shin"},
                    {"left_ankle", "left_ankle", "Left foot"},
                    {"right_shoulder", "right_elbow", "Right upper arm"},
                    {"left_elbow", "left_wrist", "Left forearm"},
                    {"right_wrist", "right_wrist", "Right hand"},
                    {"spine2", "spine3", "Chest"},
                    {"head", "head", "Head"},
                    {"neck", "head", "Neck"},
                    {"pelvis", "pelvis", "Pelvis"},
                    {"left_index1", "left_index2", "Left index1"},
                    {"left_index3", "left_index3", "Left index3"}};
    for (const auto& row : expected) {
        const int joint = skeleton.find(row.skin);
        ASSERT_GE(joint, 0) << row.skin;
        EXPECT_EQ(skeleton.names[static_cast<std::size_t>(draggedJoint(skeleton, joint))], row.dragged) << row.skin;
        EXPECT_EQ(segmentName(skeleton, joint), row.name);
    }
    // Nobody's skin is without a handle, on any rig.
    Skeleton other;
    other.names = {"hips", "upper", "lower", "end", "side"};
    other.parents = {-1, 0, 1, 2, 0};
    other.restPositions.resize(5);
    EXPECT_EQ(draggedJoint(other, 1), 2);
    EXPECT_EQ(draggedJoint(other, 3), 3);
    EXPECT_EQ(draggedJoint(other, 0), 0);
    EXPECT_EQ(draggedJoint(other, -1), -1);
}

TEST(ViewportPicking, APixelOfTheBodyNamesItsPointAndJoint) {
    Frame frame;
    frame.inputs.camera = lookAtCamera({0, 1, 3}, {0, 1, 0}, 40, 64, 48);
    auto depth = std::make_shared<Image>(), opacity = std::make_shared<Image>();
    for (auto* image : {depth.get(), opacity.get()}) {
        image->width = 64;
        image->height = 48;
        image->channels = 1;
        image->pixels.assign(64 * 48, 0.0f);
    }
    depth->at(10, 20, 0) = 2.5f;
    opacity->at(10, 20, 0) = 1.0f;
    frame.pictures[BufferId::Depth] = depth;
    frame.pictures[BufferId::Opacity] = opacity;
    frame.jointWorld = {glm::mat4(1.0f), glm::mat4(1.0f)};
    frame.jointWorld[1][3] = glm::vec4(0, 1.2f, 0.5f, 1);
    const auto hit = bodyAt(frame, 20, 10);
    ASSERT_TRUE(hit.has_value());
    EXPECT_NEAR(frame.inputs.camera.toCamera(hit->world).z, 2.5, 1e-6);
    const glm::dvec2 back = frame.inputs.camera.project(frame.inputs.camera.toCamera(hit->world));
    EXPECT_NEAR(back.x, 20.5, 1e-6);
    EXPECT_NEAR(back.y, 10.5, 1e-6);
    EXPECT_EQ(hit->joint, 1) << "without surfels the nearest joint";
    EXPECT_FALSE(bodyAt(frame, 21, 10).has_value()) << "an empty pixel";
    EXPECT_FALSE(bodyAt(frame, -1, 10).has_value());
    EXPECT_FALSE(bodyAt(frame, 20, 48).has_value());
}

TEST(ViewportView, ScreenAndWorldAreInverse) {
    const PictureView view{ImVec2(100, 50), ImVec2(320, 240), lookAtCamera({1, 1.5, 3}, {0, 1, 0}, 35, 320, 240)};
    for (const glm::dvec3 point : {glm::dvec3(0, 1, 0), glm::dvec3(0.4, 1.6, -0.3), glm::dvec3(-0.5, 0.2, 0.4)}) {
        const auto at = view.toScreen(point);
        ASSERT_TRUE(at.has_value());
        const glm::dvec3 back = view.pointAt(*at, view.depthOf(point));
        EXPECT_NEAR(glm::distance(back, point), 0.0, 1e-5);
        EXPECT_NEAR(glm::dot(view.rayTo(*at), glm::normalize(point - view.camera.centerWorld())), 1.0, 1e-9);
    }
    EXPECT_FALSE(view.toScreen({2, 2, 6}).has_value()) << "behind the eye";
}

TEST(ViewportLayouts, TilesFillTheRegionWithoutOverlap) {
    ViewSection view;
    for (const ImVec2 size : {ImVec2(700, 560), ImVec2(1900, 900), ImVec2(420, 800)}) {
        for (const ViewLayout kind :
             {ViewLayout::Single, ViewLayout::SideBySide, ViewLayout::Strip, ViewLayout::Grid}) {
            view.layout = kind;
            const ViewportLayout layout = arrange(view, {ImVec2(10, 20), size}, 1.0f);
            std::vector<PictureArea> areas;
            for (const ThumbnailArea& tile : layout.thumbnails) areas.push_back(tile.area);
            if (kind != ViewLayout::Grid) areas.push_back(layout.main);
            if (layout.other.size.x > 0) areas.push_back(layout.other);
            double covered = 0.0;
            for (std::size_t i = 0; i < areas.size(); ++i) {
                const PictureArea& a = areas[i];
                EXPECT_GE(a.origin.x, 10.0f);
                EXPECT_GE(a.origin.y, 20.0f);
                EXPECT_LE(a.origin.x + a.size.x, 10.0f + size.x + 0.5f);
                EXPECT_LE(a.origin.y + a.size.y, 20.0f + size.y + 0.5f);
                EXPECT_GE(a.size.x, 30.0f);
                covered += a.size.x * a.size.y;
                for (std::size_t j = 0; j < i; ++j) {
                    const PictureArea& b = areas[j];
                    const bool apart = a.origin.x >= b.origin.x + b.size.x || b.origin.x >= a.origin.x + a.size.x ||
                                       a.origin.y >= b.origin.y + b.size.y || b.origin.y >= a.origin.y + a.size.y;
                    EXPECT_TRUE(apart) << "tiles " << i << " and " << j;
                }
            }
            EXPECT_GT(covered, 0.85 * size.x * size.y) << EnumWords<ViewLayout>::words[static_cast<std::size_t>(kind)];
        }
    }
}

TEST(ViewportComparison, AFileIsAveragedWhereItShrinksAndEmptyOutsideItsRectangle) {
    Image picture;
    picture.width = 40;
    picture.height = 20;
    picture.channels = 3;
    picture.space = ColorSpace::Srgb;
    for (int row = 0; row < 20; ++row) {
        for (int column = 0; column < 40; ++column) {
            // A linear slope: its mean over any box is its value in the middle.
            picture.pixels.push_back(static_cast<float>(column + 0.5) / 40);
            picture.pixels.push_back(static_cast<float>(row + 0.5) / 20);
            picture.pixels.push_back((row + column) % 2 ? 1.0f : 0.0f);
        }
    }
    const PixelRect rect{6, 2, 10, 5}; // four by four pixels into one
    const Image fitted = fittedPicture(picture, rect, 24, 10);
    ASSERT_EQ(fitted.channels, 4);
    for (int row = 0; row < 10; ++row) {
        for (int column = 0; column < 24; ++column) {
            const bool inside = column >= 6 && column < 16 && row >= 2 && row < 7;
            EXPECT_NEAR(fitted.at(row, column, 3), inside ? 1.0f : 0.0f, 1e-5);
            if (!inside) continue;
            EXPECT_NEAR(fitted.at(row, column, 0), (column - 6 + 0.5) / 10, 0.02);
            EXPECT_NEAR(fitted.at(row, column, 1), (row - 2 + 0.5) / 5, 0.02);
            EXPECT_NEAR(fitted.at(row, column, 2), 0.5, 1e-4) << "a chessboard becomes grey";
        }
    }
}

TEST(ViewportBackdrop, HalvingKeepsTheMean) {
    Environment environment;
    environment.picture.width = 64;
    environment.picture.height = 32;
    environment.picture.channels = 3;
    double sum = 0.0;
    for (int i = 0; i < 64 * 32 * 3; ++i) {
        environment.picture.pixels.push_back(static_cast<float>((i * 37) % 101));
        sum += environment.picture.pixels.back();
    }
    const Environment half = halvedEnvironment(environment, 16);
    EXPECT_EQ(half.picture.width, 16);
    EXPECT_EQ(half.picture.height, 8);
    double mean = 0.0;
    for (const float value : half.picture.pixels) mean += value;
    EXPECT_NEAR(mean / (16 * 8 * 3), sum / (64 * 32 * 3), 1e-3);
}

TEST(ViewportThumbnails, SparserPicturesAreNotSmallerThanTheyAreShown) {
    Image picture;
    picture.width = 100;
    picture.height = 60;
    picture.channels = 1;
    picture.pixels.assign(6000, 2.5f);
    const Image thumbnail = sparserPicture(picture, 30, 20);
    EXPECT_EQ(thumbnail.width, 33);
    EXPECT_EQ(thumbnail.height, 20);
    for (const float value : thumbnail.pixels) EXPECT_EQ(value, 2.5f);
    EXPECT_EQ(sparserPicture(picture, 90, 60).width, 100);
}

TEST(ViewportProbes, NumbersAreThoseOfTheFrame) {
    Frame frame;
    frame.inputs.camera = lookAtCamera({0, 1, 3}, {0, 1, 0}, 40, 8, 6);
    for (const BufferInfo& info : bufferCatalogue()) {
        auto picture = std::make_shared<Image>();
        picture->width = 8;
        picture->height = 6;
        picture->channels = info.channels();
        for (int i = 0; i < 48 * picture->channels; ++i) {
            picture->pixels.push_back(static_cast<float>(i) + 0.25f * static_cast<float>(info.id));
        }
        frame.pictures[info.id] = picture;
    }
    const ViewportProbe probe = probeFrame(frame, 5, 4);
    ASSERT_TRUE(probe.inside && probe.covered);
    ASSERT_EQ(probe.values.size(), static_cast<std::size_t>(kBufferCount));
    for (std::size_t i = 0; i < probe.values.size(); ++i) {
        const ProbeValue& value = probe.values[i];
        EXPECT_EQ(value.buffer, bufferCatalogue()[i].id);
        for (int c = 0; c < value.channels; ++c) {
            EXPECT_EQ(value.values[static_cast<std::size_t>(c)], frame.picture(value.buffer)->at(4, 5, c));
        }
    }
    EXPECT_FALSE(probeFrame(frame, 8, 0).inside);
    EXPECT_EQ(probeText({BufferId::Depth, 1, {3.14159f}}), "3.142");
    EXPECT_EQ(probeText({BufferId::Normal, 3, {0.5f, -0.25f, -1.0f}}), " 0.500  -0.250  -1.000");
}

TEST(ViewportBadges, SayWhichQualityIsOnTheScreen) {
    Frame frame;
    frame.inputs.camera.width = 480;
    frame.inputs.camera.height = 360;
    frame.quality = FrameQuality::Draft;
    EXPECT_EQ(qualityText(frame), "draft 480x360");
    frame.quality = FrameQuality::Refining;
    frame.occlusionShare = 0.35f;
    EXPECT_EQ(qualityText(frame), "refining 35 %");
    frame.quality = FrameQuality::Full;
    EXPECT_EQ(qualityText(frame), "full");
    auto light = std::make_shared<LightAsset>();
    light->quality = LightQuality::Draft;
    frame.light = light;
    EXPECT_NE(qualityText(frame).find("draft light"), std::string::npos);
}

/// The window with a small avatar, and a hand that works in its picture.
class ViewportTest : public test::PanelTest {
protected:
    void SetUp() override {
        open("viewport", "Viewport");
        if (HasFatalFailure()) return;
        run("view.grid", {{"enabled", false}});
        settle();
        entriesBefore_ = entries();
        before_ = document();
    }
    void run(const char* command, const Arguments& arguments) {
        const Status done = session().run(command, arguments);
        ASSERT_TRUE(done.ok()) << command << ": " << done.error().describe();
    }
    void settle() { ASSERT_TRUE(studio_.window().settle(60.0)) << "the picture does not come to rest"; }

    ImRect picture() {
        ImRect rect;
        act([&](ImGuiTestContext* context) { rect = context->ItemInfo("Picture").RectFull; });
        return rect;
    }
    PictureView view() {
        const ImRect rect = picture();
        const int width = static_cast<int>(rect.GetWidth()), height = static_cast<int>(rect.GetHeight());
        return {rect.Min, rect.GetSize(), resizedCamera(session().frame()->inputs.camera, width, height)};
    }
    glm::dvec3 jointPlace(const char* name) {
        const std::shared_ptr<const Frame> frame = session().frame();
        const int joint = frame->avatar->evaluator->rig().skeleton.find(name);
        return glm::dvec3(frame->jointWorld.at(static_cast<std::size_t>(joint))[3]);
    }
    /// Press, move in steps, release.
    void drag(const ImVec2& from, const ImVec2& by, ImGuiMouseButton button = ImGuiMouseButton_Left) {
        act([&](ImGuiTestContext* context) {
            context->MouseMoveToPos(from);
            context->Yield(2);
            context->MouseDown(button);
            for (int i = 1; i <= 6; ++i) {
                context->MouseMoveToPos(
                    ImVec2(from.x + by.x * static_cast<float>(i) / 6, from.y + by.y * static_cast<float>(i) / 6));
                context->Yield();
            }
            context->MouseUp(button);
            context->Yield(2);
        });
    }
    std::size_t newEntries() { return entries() - entriesBefore_; }

    std::size_t entriesBefore_ = 0;
    Document before_;
};

TEST_F(ViewportTest, ADraggedForearmTakesTheWristAlongAndIsOneUndoEntry) {
    const PictureView at = view();
    const glm::dvec3 elbow = jointPlace("left_elbow"), wrist = jointPlace("left_wrist");
    const auto from = at.toScreen(glm::mix(elbow, wrist, 0.7));
    const auto wristBefore = at.toScreen(wrist);
    ASSERT_TRUE(from && wristBefore);
    const ImVec2 by(30, -70);
    drag(*from, by);
    settle();
    const auto wristAfter = view().toScreen(jointPlace("left_wrist"));
    ASSERT_TRUE(wristAfter.has_value());
    EXPECT_NEAR(wristAfter->x - wristBefore->x, by.x, 5.0f);
    EXPECT_NEAR(wristAfter->y - wristBefore->y, by.y, 5.0f);
    EXPECT_EQ(newEntries(), 1u);
    EXPECT_TRUE(session().undo());
    EXPECT_TRUE(document() == before_);
}

TEST_F(ViewportTest, EscapeTakesADragBack) {
    const auto from = view().toScreen(glm::mix(jointPlace("left_elbow"), jointPlace("left_wrist"), 0.7));
    bool moved = false;
    // One act: at its end the test engine lets go of the mouse.
    act([&](ImGuiTestContext* context) {
        context->MouseMoveToPos(*from);
        context->Yield(2);
        context->MouseDown();
        for (int i = 1; i <= 4; ++i) {
            context->MouseMoveToPos(
                ImVec2(from->x + 10.0f * static_cast<float>(i), from->y - 15.0f * static_cast<float>(i)));
            context->Yield();
        }
        moved = !(document() == before_);
        context->KeyPress(ImGuiKey_Escape);
        context->Yield(2);
        context->MouseUp();
        context->Yield(2);
    });
    EXPECT_TRUE(moved) << "the drag did nothing";
    EXPECT_TRUE(document() == before_);
    EXPECT_EQ(newEntries(), 0u);
}

TEST_F(ViewportTest, TheMouseMovesTheCamera) {
    const ImRect rect = picture();
    const ImVec2 background(rect.Min.x + 0.12f * rect.GetWidth(), rect.Min.y + 0.25f * rect.GetHeight());
    const SceneCamera start = document().camera.camera;
    drag(background, ImVec2(80, 0));
    const SceneCamera orbited = document().camera.camera;
    EXPECT_EQ(orbited.target, start.target);
    EXPECT_NEAR(glm::distance(orbited.eye, orbited.target), glm::distance(start.eye, start.target), 1e-6);
    EXPECT_LT(orbited.eye.x, start.eye.x) << "the body turns with the hand";
    EXPECT_EQ(newEntries(), 1u);
    run("camera.set", {{"eye_x", start.eye.x},
                       {"eye_y", start.eye.y},
                       {"eye_z", start.eye.z},
                       {"target_x", start.target.x},
                       {"target_y", start.target.y},
                       {"target_z", start.target.z}});
    settle();

    // Panning: what lies at the target's depth follows the hand.
    const auto targetBefore = view().toScreen(start.target);
    drag(background, ImVec2(40, 25), ImGuiMouseButton_Middle);
    settle();
    const auto targetAfter = view().toScreen(start.target);
    EXPECT_NEAR(targetAfter->x - targetBefore->x, 40.0f, 1.0f);
    EXPECT_NEAR(targetAfter->y - targetBefore->y, 25.0f, 1.0f);

    // Looking around keeps the eye.
    const glm::dvec3 eye = document().camera.camera.eye;
    drag(background, ImVec2(30, 0), ImGuiMouseButton_Right);
    EXPECT_NEAR(glm::distance(document().camera.camera.eye, eye), 0.0, 1e-9);
    EXPECT_FALSE(document().camera.camera.target == start.target);
}

TEST_F(ViewportTest, TheWheelGoesTowardsWhatIsUnderTheCursor) {
    const glm::dvec3 hand = jointPlace("left_wrist");
    const auto at = view().toScreen(hand);
    const double distance = glm::distance(document().camera.camera.eye, hand);
    act([&](ImGuiTestContext* context) {
        context->MouseMoveToPos(*at);
        context->Yield(2);
        for (int i = 0; i < 3; ++i) {
            context->MouseWheelY(1.0f);
            context->Yield();
        }
    });
    settle();
    EXPECT_LT(glm::distance(document().camera.camera.eye, hand), 0.85 * distance);
    const auto now = view().toScreen(hand);
    EXPECT_NEAR(now->x, at->x, 4.0f);
    EXPECT_NEAR(now->y, at->y, 4.0f);
}

TEST_F(ViewportTest, AClickSelectsTheJointAndItsRingsTurnIt) {
    const auto forearm = view().toScreen(glm::mix(jointPlace("left_elbow"), jointPlace("left_wrist"), 0.5));
    act([&](ImGuiTestContext* context) {
        context->MouseMoveToPos(*forearm);
        context->Yield(2);
        context->MouseClick(ImGuiMouseButton_Left);
        context->Yield(2);
    });
    const int elbow = smplxJointIndex("left_elbow");
    EXPECT_EQ(document().view.selectedJoint, elbow);
    // The ring about the line of sight is a circle around the joint, 1.18 x 58 pixels.
    const auto center = view().toScreen(jointPlace("left_elbow"));
    const float radius = 1.18f * 58.0f;
    const float a = -2.2f, b = a + 0.5f; // radians on the screen, y down
    const std::size_t selected = entries();
    drag(ImVec2(center->x + radius * std::cos(a), center->y + radius * std::sin(a)),
         ImVec2(radius * (std::cos(b) - std::cos(a)), radius * (std::sin(b) - std::sin(a))));
    const glm::quat turned = glm::inverse(before_.pose.pose.rotations[static_cast<std::size_t>(elbow)]) *
                             document().pose.pose.rotations[static_cast<std::size_t>(elbow)];
    EXPECT_NEAR(glm::length(axisAngleFromQuat(turned)), 0.5f, 0.06f) << "radians";
    EXPECT_EQ(entries(), selected + 1);
    for (std::size_t j = 0; j < 55; ++j) {
        if (static_cast<int>(j) == elbow) continue;
        EXPECT_EQ(document().pose.pose.rotations[j], before_.pose.pose.rotations[j]) << "joint " << j;
    }
}

TEST_F(ViewportTest, TheRimOfASphereSetsThePartsRadius) {
    run("view.radius_spheres", {{"enabled", true}});
    run("view.select_part", {{"part", "elbow"}});
    settle();
    const PictureView at = view();
    const glm::dvec3 elbow = jointPlace("right_elbow");
    const auto center = at.toScreen(elbow);
    const double depth = at.depthOf(elbow);
    auto rim = [&](double radius) { return at.camera.fy * radius / std::sqrt(depth * depth - radius * radius); };
    const auto part = static_cast<std::size_t>(BodyPart::Elbow);
    const double before = document().occlusion.radii[part];
    const float from = static_cast<float>(rim(before)), to = static_cast<float>(rim(1.5 * before));
    drag(ImVec2(center->x, center->y + from), ImVec2(0, to - from));
    EXPECT_NEAR(document().occlusion.radii[part], 1.5 * before, 0.03 * before);
}

TEST_F(ViewportTest, TheLegendsEndsAreItsRange) {
    run("view.buffer", {{"name", "depth"}});
    settle();
    const auto depth = static_cast<std::size_t>(BufferId::Depth);
    EXPECT_FALSE(document().view.buffers[depth].range.has_value());
    act([](ImGuiTestContext* context) {
        const ImVec2 at = context->ItemInfo("Legend\\/Maximum").RectFull.GetCenter();
        context->MouseMoveToPos(at);
        context->MouseDown();
        context->MouseMoveToPos(ImVec2(at.x, at.y + 30));
        context->Yield();
        context->MouseUp();
    });
    ASSERT_TRUE(document().view.buffers[depth].range.has_value());
    const auto range = *document().view.buffers[depth].range;
    EXPECT_FLOAT_EQ(range.first, bufferInfo(BufferId::Depth).minimum);
    EXPECT_LT(range.second, bufferInfo(BufferId::Depth).maximum);
    EXPECT_GT(range.second, range.first);
    act([](ImGuiTestContext* context) {
        context->MouseMove("Legend\\/Maximum");
        context->MouseClick(ImGuiMouseButton_Right);
    });
    EXPECT_FALSE(document().view.buffers[depth].range.has_value());
}

/// Relative luminance of an sRGB colour, and the contrast of two (WCAG 2.1).
double luminance(const glm::dvec3& srgb) {
    const auto linear = [](double c) { return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4); };
    return 0.2126 * linear(srgb.r) + 0.7152 * linear(srgb.g) + 0.0722 * linear(srgb.b);
}

double contrast(const glm::dvec3& a, const glm::dvec3& b) {
    const double first = luminance(a), second = luminance(b);
    return (std::max(first, second) + 0.05) / (std::min(first, second) + 0.05);
}

TEST(ViewportPlates, EveryInkCanBeReadOverAnyPicture) {
    EXPECT_NEAR(contrast({0, 0, 0}, {1, 1, 1}), 21.0, 1e-9);
    EXPECT_NEAR(contrast(glm::dvec3(119 / 255.0), glm::dvec3(1)), 4.48, 0.01) << "#777 on white, as everybody says";
    const ImVec4 plate = plateColor();
    for (const Ink ink : {Ink::Text, Ink::Muted, Ink::Accent}) {
        const ImVec4 text = inkColor(ink);
        ASSERT_EQ(text.w, 1.0f);
        for (const glm::dvec3& picture : {glm::dvec3(0), glm::dvec3(0.5), glm::dvec3(1), glm::dvec3(1, 0.8, 0)}) {
            const glm::dvec3 below =
                glm::mix(picture, glm::dvec3(plate.x, plate.y, plate.z), static_cast<double>(plate.w));
            EXPECT_GE(contrast({text.x, text.y, text.z}, below), 4.5)
                << static_cast<int>(ink) << " over " << picture.r << " " << picture.g << " " << picture.b;
        }
    }
}

/// As it is drawn: the plate is the commonest colour of its part of the screen, the text what differs most from it.
TEST_F(ViewportTest, TextOverThePictureCanBeReadInBothThemes) {
    Settings& settings = studio_.window().settings();
    const Theme before = settings.theme;
    run("view.buffer", {{"name", "ao"}});
    const auto contrastIn = [&](const std::vector<std::uint8_t>& pixels, const ImRect& part) {
        const auto width = static_cast<std::size_t>(ImGui::GetIO().DisplaySize.x);
        std::map<std::array<std::uint8_t, 3>, int> colors;
        for (auto y = static_cast<std::size_t>(part.Min.y); y < static_cast<std::size_t>(part.Max.y); ++y) {
            for (auto x = static_cast<std::size_t>(part.Min.x); x < static_cast<std::size_t>(part.Max.x); ++x) {
                const std::uint8_t* p = &pixels[4 * (y * width + x)];
                ++colors[{p[0], p[1], p[2]}];
            }
        }
        const auto color = [](const auto& c) { return glm::dvec3(c[0], c[1], c[2]) / 255.0; };
        const auto plate = std::max_element(colors.begin(), colors.end(),
                                            [](const auto& a, const auto& b) { return a.second < b.second; });
        double most = 1.0;
        for (const auto& entry : colors) most = std::max(most, contrast(color(entry.first), color(plate->first)));
        return most;
    };
    for (const Theme theme : {Theme::Dark, Theme::Light}) {
        settings.theme = theme;
        for (const double ground : {0.0, 1.0}) {
            run("view.background", {{"red", ground}, {"green", ground}, {"blue", ground}});
            settle();
            ImRect whole, maximum, minimum;
            act([&](ImGuiTestContext* context) {
                whole = context->ItemInfo("Picture").RectFull;
                maximum = context->ItemInfo("Legend\\/Maximum").RectFull;
                minimum = context->ItemInfo("Legend\\/Minimum").RectFull;
            });
            const std::vector<std::uint8_t> pixels = studio_.window().pixels();
            // Without the rounded corners, through which the picture is seen.
            const auto inner = [](ImRect rect) {
                rect.Expand(-4.0f);
                return rect;
            };
            const ImRect label(whole.Min.x + 16, whole.Min.y + 14, whole.Min.x + 90, whole.Min.y + 28);
            const ImRect badge(whole.Max.x - 38, whole.Min.y + 14, whole.Max.x - 14, whole.Min.y + 28);
            const std::pair<const char*, ImRect> plates[] = {
                {"name", label}, {"quality", badge}, {"maximum", inner(maximum)}, {"minimum", inner(minimum)}};
            for (const auto& [name, part] : plates) {
                EXPECT_GE(contrastIn(pixels, part), 4.5)
                    << name << ", " << (theme == Theme::Dark ? "dark" : "light") << " theme over " << ground;
            }
        }
    }
    settings.theme = before;
}

TEST_F(ViewportTest, LAndTheMouseTurnTheLight) {
    const float before = document().light.rotationDeg;
    const ImRect rect = picture();
    act([&](ImGuiTestContext* context) {
        context->MouseMoveToPos(ImVec2(rect.Min.x + 0.15f * rect.GetWidth(), rect.GetCenter().y));
        context->KeyDown(ImGuiMod_Shift | ImGuiKey_L);
        context->MouseDown();
        context->MouseMoveToPos(ImVec2(rect.Min.x + 0.15f * rect.GetWidth() + 60, rect.GetCenter().y));
        context->Yield();
        context->MouseUp();
        context->KeyUp(ImGuiMod_Shift | ImGuiKey_L);
    });
    EXPECT_NEAR(document().light.rotationDeg - before, 30.0f, 2.0f);
    EXPECT_EQ(newEntries(), 1u);
}

TEST_F(ViewportTest, EveryLayoutShowsTheBody) {
    run("compare.buffer", {{"name", "normal"}});
    run("view.strip", {{"buffers", "beauty,albedo,normal,depth,ao"}});
    for (const std::string_view word : EnumWords<ViewLayout>::words) {
        run("view.layout", {{"layout", std::string(word)}});
        settle();
        const ImRect rect = picture();
        const std::vector<std::uint8_t> shown = studio_.window().pixels();
        // Colours in the middle column of the picture: a body is not of one colour.
        std::set<int> colors;
        const int width = static_cast<int>(ImGui::GetIO().DisplaySize.x);
        const int left = static_cast<int>(rect.Min.x), right = static_cast<int>(rect.Max.x);
        for (int y = static_cast<int>(rect.Min.y) + 60; y < static_cast<int>(rect.Max.y) - 60; y += 2) {
            for (int x = left; x < right; x += 3) {
                const std::size_t p =
                    4 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x));
                colors.insert((shown[p] << 16) | (shown[p + 1] << 8) | shown[p + 2]);
            }
        }
        EXPECT_GT(colors.size(), 60u) << word;
    }
}

TEST_F(ViewportTest, TheSplitLineIsDragged) {
    run("compare.buffer", {{"name", "normal"}});
    run("view.layout", {{"layout", "split"}});
    settle();
    const ImRect rect = picture();
    const float x = rect.Min.x + document().view.compare.splitPosition * rect.GetWidth();
    drag(ImVec2(x, rect.Min.y + 0.2f * rect.GetHeight()), ImVec2(-0.2f * rect.GetWidth(), 0));
    EXPECT_NEAR(document().view.compare.splitPosition, 0.3f, 0.01f);
}

TEST_F(ViewportTest, TheProbeShowsEveryBufferWhereItIsWanted) {
    pinProbe(true);
    const auto chest = view().toScreen(jointPlace("spine3"));
    settle();
    ViewportProbe probe;
    act([&](ImGuiTestContext* context) {
        context->MouseMoveToPos(*chest);
        context->Yield(10);
        probe = viewportProbe(); // the mouse leaves the picture when this ends
    });
    pinProbe(false);
    ASSERT_TRUE(probe.inside && probe.covered);
    EXPECT_EQ(probe.partName, "torso");
    EXPECT_GE(probe.values.size(), 14u);
    EXPECT_LT(glm::distance(glm::dvec3(probe.world), jointPlace("spine3")), 0.25);
}

TEST_F(ViewportTest, OverlaysAndDiscsAreDrawn) {
    const auto pictureNow = [&] {
        settle();
        return studio_.window().pixels();
    };
    const std::vector<std::uint8_t> plain = pictureNow();
    for (const char* command : {"view.grid", "view.skeleton", "view.parts", "view.surfel_discs"}) {
        run(command, {{"enabled", true}});
        const std::vector<std::uint8_t> shown = pictureNow();
        std::size_t changed = 0;
        for (std::size_t i = 0; i < shown.size(); i += 4) changed += shown[i] != plain[i];
        EXPECT_GT(changed, 800u) << command;
        run(command, {{"enabled", false}});
    }
}

} // namespace
} // namespace ars::ui
