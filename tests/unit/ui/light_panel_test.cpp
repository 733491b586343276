#include "engine/light/cube_map.h"
#include "engine/light/environment.h"
#include "ui/look/lat_long_picture.h"
#include "ui/look/light_library.h"
#include "ui/look/light_map.h"
#include "ui/look/sun_clock.h"

#include "tests/unit/ui/look_support.h"

#include <cmath>
#include <fstream>

namespace ars::ui {
namespace {

TEST(LightMapPlaces, FollowTheConventionOfEnvironments) {
    // docs/conventions.md: +z in the centre, +x a quarter to the left, the top row is +y.
    EXPECT_NEAR(mapPlace({0, 0}).x, 0.5, 1e-12);
    EXPECT_NEAR(mapPlace({90, 0}).x, 0.25, 1e-12);
    EXPECT_NEAR(mapPlace({-90, 0}).x, 0.75, 1e-12);
    EXPECT_NEAR(mapPlace({0, 90}).y, 0.0, 1e-12);
    // The engine's own look-up of directions, which rendering uses, says the same.
    for (double azimuth = -170; azimuth < 180; azimuth += 20) {
        for (double elevation = -80; elevation <= 80; elevation += 20) {
            const double a = azimuth * M_PI / 180, e = elevation * M_PI / 180;
            const glm::dvec2 expected =
                latLongPlace({std::cos(e) * std::sin(a), std::sin(e), std::cos(e) * std::cos(a)});
            EXPECT_NEAR(mapPlace({azimuth, elevation}).x, expected.x, 1e-9) << azimuth;
            EXPECT_NEAR(mapPlace({azimuth, elevation}).y, expected.y, 1e-9) << elevation;
            const LightAngles back = mapAngles(mapPlace({azimuth, elevation}));
            EXPECT_NEAR(back.azimuthDeg, azimuth, 1e-9);
            EXPECT_NEAR(back.elevationDeg, elevation, 1e-9);
        }
    }
}

TEST(LightMapPlaces, TheOutlineOfALampEnclosesWhatTheStudioLights) {
    StudioParams studio;
    studio.width = 256;
    studio.floorRadiance = studio.horizonRadiance = studio.ceilingRadiance = 0.0f;
    StudioLamp lamp;
    lamp.azimuthDeg = 30;
    lamp.elevationDeg = 25;
    lamp.widthM = 1.4f;
    lamp.heightM = 0.6f;
    lamp.rollDeg = 35;
    lamp.softness = 0;
    studio.lamps = {lamp};
    const auto environment = generateStudio(studio);
    ASSERT_TRUE(environment.ok());
    // The box around the lit pixels is the box around the outline, within a pixel.
    glm::dvec2 litLow(1e9), litHigh(-1e9), low(1e9), high(-1e9);
    const Image& picture = environment->picture;
    for (int row = 0; row < picture.height; ++row) {
        for (int column = 0; column < picture.width; ++column) {
            if (!(picture.at(row, column, 1) > 0)) continue;
            const glm::dvec2 place((column + 0.5) / picture.width, (row + 0.5) / picture.height);
            litLow = glm::min(litLow, place);
            litHigh = glm::max(litHigh, place);
        }
    }
    for (const LightAngles& angles : lampOutline(lamp)) {
        low = glm::min(low, mapPlace(angles));
        high = glm::max(high, mapPlace(angles));
    }
    EXPECT_NEAR(litLow.x, low.x, 1.2 / picture.width);
    EXPECT_NEAR(litHigh.x, high.x, 1.2 / picture.width);
    EXPECT_NEAR(litLow.y, low.y, 1.2 / picture.height);
    EXPECT_NEAR(litHigh.y, high.y, 1.2 / picture.height);
}

TEST(SunClock, GivesBackTheHourThatTheSunWasSetBy) {
    for (const double latitude : {-50.0, 0.0, 48.0, 70.0}) {
        for (const int day : {1, 80, 172, 300}) {
            for (double hours = 0.5; hours < 24.0; hours += 1.7) {
                const SunPlace place{latitude, day};
                const SunHour found = nearestSunHour(place, sunPosition(latitude, day, hours));
                EXPECT_NEAR(found.hours, hours, 1e-3) << latitude << " " << day;
                EXPECT_LT(found.errorDeg, 1e-3);
            }
        }
    }
}

TEST(SunClock, SaysHowFarASunIsFromAnyThatCanBe) {
    // At the equinox the sun over 48 degrees north never climbs beyond 42.
    const SunHour found = nearestSunHour({48.0, 80}, {80.0, 0.0});
    EXPECT_NEAR(found.hours, 12.0, 0.2);
    EXPECT_NEAR(found.errorDeg, 80.0 - 42.0, 1.0);
}

TEST(SmallLatLong, KeepsTheMeanOfThePicture) {
    Image picture;
    picture.width = 64;
    picture.height = 32;
    picture.channels = 3;
    for (int i = 0; i < 64 * 32 * 3; ++i) picture.pixels.push_back(static_cast<float>((i * 7919) % 101));
    const Image small = smallLatLong(picture, 16);
    ASSERT_EQ(small.width, 16);
    ASSERT_EQ(small.height, 8);
    double whole = 0, shrunk = 0;
    for (const float v : picture.pixels) whole += v;
    for (const float v : small.pixels) shrunk += v;
    EXPECT_NEAR(shrunk / small.pixels.size(), whole / picture.pixels.size(), 1e-4);
}

TEST(SmallLatLong, PreviewsShowDarkAndBrightLightsAlike) {
    for (const float radiance : {0.001f, 0.5f, 300.0f}) {
        const Environment environment = uniformEnvironment(radiance);
        const Image shown = displayLatLong(environment.picture, previewExposure(environment.picture));
        ASSERT_FALSE(shown.pixels.empty());
        EXPECT_GT(shown.pixels[0], 0.3f) << radiance;
        EXPECT_LT(shown.pixels[0], 0.7f) << radiance;
    }
    EXPECT_EQ(previewExposure(uniformEnvironment(0.0f).picture), 0.0f);
}

TEST(LightFiles, AreThePanoramasOfAFolderInOrder) {
    const ars::test::TemporaryFolder folder;
    for (const char* name : {"b.exr", "a.HDR", "person.jpg", "notes.txt"}) std::ofstream(folder / name) << "x";
    std::filesystem::create_directory(folder / "c.exr");
    const auto files = LightLibrary::lightFiles(folder.path());
    ASSERT_EQ(files.size(), 2u);
    EXPECT_EQ(files[0].filename(), "a.HDR");
    EXPECT_EQ(files[1].filename(), "b.exr");
    EXPECT_TRUE(LightLibrary::lightFiles(folder / "nowhere").empty());
}

class LightPanelTest : public test::PanelTest {
protected:
    void SetUp() override { open("light", "Light"); }
};

TEST_F(LightPanelTest, KindIsChosenByButtonsAndUndone) {
    click("Kind/Sky");
    EXPECT_EQ(document().light.kind, LightKind::Sky);
    click("Kind/Uniform");
    EXPECT_EQ(document().light.kind, LightKind::Uniform);
    session().undo();
    session().undo();
    EXPECT_EQ(document().light, newDocument().light);
}

TEST_F(LightPanelTest, DraggingThePanoramaTurnsTheLightByWhatItIsDragged) {
    const std::size_t before = entries();
    act([&](ImGuiTestContext* context) {
        const ImGuiTestItemInfo info = context->ItemInfo("Environment");
        const ImRect area = info.RectFull;
        // Low in the picture, where no lamp hangs.
        context->MouseMoveToPos(ImVec2(area.Min.x + 0.7f * area.GetWidth(), area.Max.y - 0.2f * area.GetHeight()));
        context->MouseDown();
        context->MouseMoveToPos(ImVec2(area.Min.x + 0.45f * area.GetWidth(), area.Max.y - 0.2f * area.GetHeight()));
        context->MouseUp();
    });
    // A quarter of the picture to the left is a quarter turn towards +x, the body's left.
    EXPECT_NEAR(document().light.rotationDeg, 90.0f, 2.0f);
    EXPECT_EQ(entries(), before + 1) << "a drag is one entry";
}

TEST_F(LightPanelTest, DraggingALampMovesItAroundTheBody) {
    const StudioLamp before = document().light.studio.lamps[0];
    const std::size_t history = entries();
    act([&](ImGuiTestContext* context) {
        const ImRect area = context->ItemInfo("Environment").RectFull;
        context->MouseMove("Lamp 0");
        const ImVec2 from = ImGui::GetIO().MousePos;
        context->MouseDown();
        context->MouseMoveToPos(ImVec2(from.x + area.GetWidth() / 12.0f, from.y - area.GetHeight() / 18.0f));
        context->MouseUp();
    });
    const StudioLamp after = document().light.studio.lamps[0];
    EXPECT_NEAR(after.azimuthDeg, before.azimuthDeg - 30.0f, 2.0f);
    EXPECT_NEAR(after.elevationDeg, before.elevationDeg + 10.0f, 2.0f);
    EXPECT_EQ(document().light.rotationDeg, 0.0f) << "the light itself stays";
    EXPECT_EQ(entries(), history + 1);
    session().undo();
    EXPECT_EQ(document().light.studio.lamps[0], before);
}

TEST_F(LightPanelTest, TheWheelOverALampChangesItsDistance) {
    const StudioLamp before = document().light.studio.lamps[1];
    act([](ImGuiTestContext* context) {
        context->MouseMove("Lamp 1");
        context->MouseWheelY(3.0f);
    });
    const StudioLamp after = document().light.studio.lamps[1];
    EXPECT_NE(after.distanceM, before.distanceM);
    StudioLamp expected = before;
    expected.distanceM = after.distanceM;
    EXPECT_EQ(after, expected) << "nothing else of it";
}

TEST_F(LightPanelTest, LampsAreAddedNamedAndRemoved) {
    const std::size_t lamps = document().light.studio.lamps.size();
    click("Add lamp");
    ASSERT_EQ(document().light.studio.lamps.size(), lamps + 1);
    act([](ImGuiTestContext* context) { context->ItemInputValue("lamp/Name", "kicker"); });
    EXPECT_EQ(document().light.studio.lamps.back().name, "kicker");
    click("Remove lamp");
    EXPECT_EQ(document().light.studio.lamps, newDocument().light.studio.lamps);
}

TEST_F(LightPanelTest, ACardOfTheLibrarySwapsTheLight) {
    click("studio:rim");
    EXPECT_EQ(document().light.kind, LightKind::Studio);
    EXPECT_EQ(document().light.studio, studioPreset(StudioPreset::Rim));
    const std::size_t before = entries();
    click("sky:Dusk");
    EXPECT_EQ(document().light.kind, LightKind::Sky);
    EXPECT_LT(document().light.sky.sunElevationDeg, 0.0f);
    EXPECT_EQ(entries(), before + 1) << "one click, one entry";
    session().undo();
    EXPECT_EQ(document().light.kind, LightKind::Studio);
}

TEST_F(LightPanelTest, TimeOfDayMovesTheSun) {
    click("Kind/Sky");
    act([](ImGuiTestContext* context) { context->ItemDragWithDelta("Time of day", ImVec2(-40, 0)); });
    const SkyParams& sky = document().light.sky;
    const SunHour hour = nearestSunHour({}, {sky.sunElevationDeg, sky.sunAzimuthDeg});
    EXPECT_LT(hour.errorDeg, 0.1) << "the sun stands where it can stand on that day";
}

TEST_F(LightPanelTest, AFileOpenedOnceStandsInTheLibraryWithItsNeighbours) {
    ARS_TEST_DATA_FILE(city, "hdri/city.exr");
    session().openAs(city, FileRole::Light);
    ASSERT_TRUE(studio_.waitFor([&] { return document().light.file == city.string(); }));
    EXPECT_EQ(document().light.kind, LightKind::File);
    act([](ImGuiTestContext* context) { context->Yield(3); });
    ASSERT_TRUE(studio_.waitFor([&] { return session().settled(); }));
    click("file:sunset.exr");
    ASSERT_TRUE(studio_.waitFor([&] { return document().light.file.find("sunset.exr") != std::string::npos; }));
}

TEST_F(LightPanelTest, TurntableWritesKeysOfAWholeTurn) {
    click("Turntable");
    click("Make turntable");
    const auto& keys = document().timeline.lightRotationDeg;
    ASSERT_GE(keys.size(), 2u);
    EXPECT_NEAR(std::fabs(keys.back().value - keys.front().value), 360.0f, 1e-3f);
}

} // namespace
} // namespace ars::ui
