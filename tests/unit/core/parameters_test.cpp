#include "engine/core/parameters.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace ars {

enum class Kernel { Gaussian, RaySplat };
template <>
struct EnumWords<Kernel> {
    static constexpr std::array<std::string_view, 2> words{"gaussian", "ray_splat"};
};

namespace {

struct Params {
    float thicknessM = 0.25f;
    int directions = 128;
    bool median = false;
    Kernel kernel = Kernel::Gaussian;
    std::string preset = "body";
    bool operator==(const Params&) const = default;
};

const ParameterTable<Params>& table() {
    static const ParameterTable<Params> rows{
        {"thickness", &Params::thicknessM, {0.01, 2}, "m", ParameterTier::Advanced, "Depth that a surface hides"},
        {"directions", &Params::directions, {1, 8192}, "", ParameterTier::Basic, "Directions a pixel looks in"},
        {"median", &Params::median, {}, "", ParameterTier::Expert, "Filter the positions first"},
        {"kernel", &Params::kernel, {}, "", ParameterTier::Basic, "How a surfel covers pixels"},
        {"preset", &Params::preset, {}, "", ParameterTier::Basic, "Where the numbers came from"},
    };
    return rows;
}

TEST(Parameters, DefaultsStandOnceInTheStruct) {
    EXPECT_EQ(std::get<double>(table().infos()[0].defaultValue), 0.25);
    EXPECT_EQ(std::get<std::string>(table().infos()[3].defaultValue), "gaussian");
    EXPECT_EQ(table().infos()[3].typeName(), "choice");
    EXPECT_EQ(table().infos()[1].typeName(), "int");
}

TEST(Parameters, JsonRoundTripIsIdentity) {
    Params changed{0.5f, 64, true, Kernel::RaySplat, "mine"};
    Params back;
    ASSERT_TRUE(table().fromJson(back, table().toJson(changed)).ok());
    EXPECT_EQ(back, changed);
}

TEST(Parameters, WhatPeopleTypeIsCheckedAgainstTheRow) {
    Params params;
    ASSERT_TRUE(table().setText(params, "thickness", "1").ok());
    ASSERT_TRUE(table().setText(params, "median", "on").ok());
    ASSERT_TRUE(table().setText(params, "kernel", "ray_splat").ok());
    EXPECT_EQ(params, (Params{1.0f, 128, true, Kernel::RaySplat, "body"}));

    EXPECT_EQ(table().setText(params, "thickness", "3").error().describe(),
              "thickness: expected float in [0.01 .. 2] m, found 3");
    EXPECT_EQ(table().setText(params, "directions", "12.5").error().describe(),
              "directions: expected int in [1 .. 8192], found \"12.5\"");
    EXPECT_EQ(table().setText(params, "kernel", "disc").error().describe(),
              "kernel: expected one of gaussian, ray_splat, found \"disc\"");
    EXPECT_FALSE(table().setText(params, "thickness", "nan").ok());
    EXPECT_FALSE(table().setText(params, "thickness", "0.5x").ok());
    EXPECT_EQ(table().setText(params, "thicknes", "1").error().describe(),
              "thicknes: there is no parameter of this name; did you mean thickness?");
    EXPECT_EQ(params.thicknessM, 1.0f) << "a refused value must change nothing";
}

TEST(Parameters, AWrongKeyChangesNothingAndStrangersAreReported) {
    Params params;
    const auto wrong = nlohmann::json::parse(R"({"directions": 64, "thickness": "thick"})");
    EXPECT_FALSE(table().fromJson(params, wrong).ok());
    EXPECT_EQ(params, Params{});
    std::vector<std::string> unknown;
    const auto newer = nlohmann::json::parse(R"({"directions": 64, "fog": 1})");
    ASSERT_TRUE(table().fromJson(params, newer, &unknown).ok());
    EXPECT_EQ(params.directions, 64);
    EXPECT_EQ(unknown, std::vector<std::string>{"fog"});
    EXPECT_FALSE(table().fromJson(params, nlohmann::json::array()).ok());
}

TEST(Parameters, HelpNamesEveryRowWithUnitAndRange) {
    const std::string help = describeParameters(table().infos());
    EXPECT_NE(help.find("thickness   float 0.25 m [0.01 .. 2]"), std::string::npos) << help;
    EXPECT_NE(help.find("choice gaussian (gaussian|ray_splat)"), std::string::npos) << help;
}

} // namespace
} // namespace ars
