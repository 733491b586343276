#include "engine/io/ply.h"
#include "engine/surfel/surfel_ply.h"
#include "tests/unit/surfel/splat_support.h"

#include <cmath>

namespace ars::test {
namespace {

TEST(SurfelPly, RoundTripKeepsEveryAttribute) {
    const TemporaryFolder folder;
    const auto path = folder / "surfels.ply";
    const Surfels s = randomSurfels(50, 2);
    ASSERT_TRUE(writeSurfelPly(path, s).ok());
    const auto back = readSurfelPly(path);
    ASSERT_TRUE(back.ok()) << back.error().describe();
    ASSERT_EQ(back->count(), s.count());
    EXPECT_EQ(back->means, s.means);
    EXPECT_EQ(back->rotations, s.rotations);
    EXPECT_EQ(back->albedos, s.albedos);
    EXPECT_EQ(back->roughnesses, s.roughnesses);
    EXPECT_EQ(back->radii, s.radii);
    EXPECT_EQ(back->importances, s.importances);
    EXPECT_TRUE(back->bones.empty());
    for (std::size_t i = 0; i < s.count(); ++i) {
        EXPECT_NEAR(back->opacities[i], s.opacities[i], 1e-6);
        for (int k = 0; k < 2; ++k) EXPECT_NEAR(back->scales[i][k] / s.scales[i][k], 1, 1e-6);
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(back->colors[i][k], s.colors[i][k], 1e-6);
    }
}

/// Numbers as another viewer reads them, computed here.
TEST(SurfelPly, ColumnsAreThoseOfOtherViewers) {
    const TemporaryFolder folder;
    Surfels s;
    addSurfel(s, {1, 2, 3}, {0, 0, 1}, 0.01, 0.02, 0.25);
    s.colors[0] = {1.0f, 0.5f, 0.0f};
    ASSERT_TRUE(writeSurfelPly(folder / "one.ply", s).ok());
    const auto file = readPly(folder / "one.ply");
    ASSERT_TRUE(file.ok());
    EXPECT_EQ(file->format, PlyFormat::BinaryLittleEndian);
    const PlyElement* vertex = file->find("vertex");
    ASSERT_NE(vertex, nullptr);
    auto value = [&](const char* name) { return vertex->column(name).value()[0]; };
    EXPECT_FLOAT_EQ(value("x"), 1);
    EXPECT_FLOAT_EQ(value("nz"), 0);
    EXPECT_FLOAT_EQ(value("opacity"), std::log(0.25f / 0.75f));
    EXPECT_FLOAT_EQ(value("scale_0"), std::log(0.01f));
    EXPECT_FLOAT_EQ(value("scale_1"), std::log(0.02f));
    EXPECT_FLOAT_EQ(value("scale_2"), std::log(1e-6f));
    EXPECT_FLOAT_EQ(value("f_dc_0"), 0.5f / 0.2820948f);
    EXPECT_FLOAT_EQ(value("f_dc_1"), 0.0f);
    EXPECT_FLOAT_EQ(value("rot_0"), 1.0f);
}

PlyFile validFile() {
    const std::vector<float> a{0.1f, 0.2f}, one{1, 1}, zero{0, 0};
    PlyFile file;
    file.elements.push_back(plyColumns("vertex", {{"x", a},
                                                  {"y", a},
                                                  {"z", a},
                                                  {"rot_0", one},
                                                  {"rot_1", zero},
                                                  {"rot_2", zero},
                                                  {"rot_3", zero},
                                                  {"scale_0", a},
                                                  {"scale_1", a},
                                                  {"opacity", a},
                                                  {"f_dc_0", a},
                                                  {"f_dc_1", a},
                                                  {"f_dc_2", a}}));
    return file;
}

std::string readError(const std::function<void(PlyElement&)>& change) {
    const TemporaryFolder folder;
    PlyFile file = validFile();
    change(file.elements[0]);
    EXPECT_TRUE(writePly(folder / "x.ply", file).ok());
    const auto result = readSurfelPly(folder / "x.ply");
    EXPECT_FALSE(result.ok());
    if (result.ok()) return "";
    EXPECT_EQ(result.error().code, ErrorCode::BadFile);
    return result.error().describe();
}

void removeProperty(PlyElement& element, const std::string& name) {
    std::erase_if(element.properties, [&](const PlyProperty& p) { return p.name == name; });
}

PlyProperty& property(PlyElement& element, const std::string& name) {
    return *std::find_if(element.properties.begin(), element.properties.end(),
                         [&](const PlyProperty& p) { return p.name == name; });
}

TEST(SurfelPly, WrongFilesAreNamed) {
    const TemporaryFolder folder;
    ASSERT_TRUE(writePly(folder / "ok.ply", validFile()).ok());
    const auto sound = readSurfelPly(folder / "ok.ply");
    ASSERT_TRUE(sound.ok()) << sound.error().describe();
    EXPECT_TRUE(sound->albedos.empty());
    EXPECT_EQ(sound->colors.size(), 2u);

    auto has = [](const std::string& text, const std::string& part) {
        EXPECT_NE(text.find(part), std::string::npos) << text;
    };
    has(readError([](PlyElement& e) { removeProperty(e, "rot_2"); }), "rot_2");
    has(readError([](PlyElement& e) { removeProperty(e, "scale_1"); }), "scale_1");
    has(readError([](PlyElement& e) { removeProperty(e, "f_dc_1"); }), "f_dc_1");
    has(readError([](PlyElement& e) { e.name = "point"; }), "vertex");
    has(readError([](PlyElement& e) { property(e, "y").values[1] = std::nan(""); }), "y");
    has(readError([](PlyElement& e) { property(e, "rot_0").values[1] = 0; }), "quaternion");
    has(readError([](PlyElement& e) { property(e, "scale_0").values[1] = 200; }), "scale_0");
    has(readError([](PlyElement& e) {
            e.properties.push_back(property(e, "x"));
            e.properties.back().name = "albedo_0";
        }),
        "albedo_1");
    EXPECT_EQ(readSurfelPly(folder / "none.ply").error().code, ErrorCode::NotFound);
}

TEST(SurfelPly, WriterRefusesWhatHasNoLogarithm) {
    const TemporaryFolder folder;
    Surfels s = randomSurfels(3, 1);
    s.scales[2].x = 0;
    const Status status = writeSurfelPly(folder / "x.ply", s);
    ASSERT_FALSE(status.ok());
    EXPECT_NE(status.error().describe().find("surfel 2"), std::string::npos) << status.error().describe();
    s.scales.pop_back();
    EXPECT_EQ(writeSurfelPly(folder / "x.ply", s).error().code, ErrorCode::InvalidArgument);
}

TEST(SurfelPly, OpacitiesOfZeroAndOneStayFinite) {
    const TemporaryFolder folder;
    Surfels s = randomSurfels(2, 1);
    s.opacities = {0.0f, 1.0f};
    ASSERT_TRUE(writeSurfelPly(folder / "x.ply", s).ok());
    const auto back = readSurfelPly(folder / "x.ply");
    ASSERT_TRUE(back.ok());
    EXPECT_NEAR(back->opacities[0], 0, 2e-6);
    EXPECT_NEAR(back->opacities[1], 1, 2e-6);
}

} // namespace
} // namespace ars::test
