// Photographs beside a calibration: which files count, in which order, and what is said when there are none.
#include "engine/scene/photographs.h"

#include "engine/core/file.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

namespace ars {
namespace {

namespace fs = std::filesystem;

void touch(const fs::path& path) { ASSERT_TRUE(writeFileAtomic(path, std::string_view("x")).ok()); }

std::vector<std::string> namesOf(const std::vector<fs::path>& paths) {
    std::vector<std::string> names;
    for (const fs::path& path : paths) names.push_back(path.filename().string());
    return names;
}

TEST(Photographs, NumbersAreTheLastDigitsOfTheName) {
    EXPECT_EQ(photographNumber("a/00000012.jpg"), 12);
    EXPECT_EQ(photographNumber("frame_7.png"), 7);
    EXPECT_EQ(photographNumber("cam2_0100_left.jpg"), 100);
    EXPECT_EQ(photographNumber("000.jpg"), 0);
    EXPECT_EQ(photographNumber("front.jpg"), std::nullopt);
    EXPECT_EQ(photographNumber("12345678901234567890.jpg"), std::nullopt);
}

TEST(Photographs, AreSortedByNumberAndMasksAreLeftOut) {
    const test::TemporaryFolder folder;
    for (const char* name : {"f10.jpg", "f9.JPG", "f2.jpeg", "f2.png", "notes.txt"}) touch(folder / "left" / name);
    touch(folder / "left" / "mask" / "f1.jpg");
    EXPECT_EQ(namesOf(photographsOf(folder.path(), "left")), (std::vector<std::string>{"f2.png", "f9.JPG", "f10.jpg"}));
}

TEST(Photographs, LieInTheImagesFolderOfOtherCaptures) {
    const test::TemporaryFolder folder;
    touch(folder / "images" / "07" / "0001.png");
    EXPECT_EQ(namesOf(photographsOf(folder.path(), "07")), std::vector<std::string>{"0001.png"});
    EXPECT_TRUE(photographsOf(folder.path(), "08").empty());
    EXPECT_TRUE(photographsOf(folder.path(), "").empty());
}

TEST(Photographs, WhatIsNotThereIsSaid) {
    CaptureAsset capture;
    capture.cameras.resize(2);
    capture.cameras[0].name = "left";
    capture.cameras[1].name = "right";
    capture.photographs = {{"left/4.jpg", "left/5.jpg"}, {}};
    EXPECT_EQ(findPhotograph(capture, "left", 1)->string(), "left/5.jpg");
    for (const int index : {-1, 2}) {
        const auto beyond = findPhotograph(capture, "left", index);
        ASSERT_FALSE(beyond.ok());
        EXPECT_EQ(beyond.error().code, ErrorCode::NotFound);
        EXPECT_NE(beyond.error().describe().find("there are 2"), std::string::npos) << beyond.error().describe();
    }
    EXPECT_NE(findPhotograph(capture, "right", 0).error().describe().find("no photographs"), std::string::npos);
    EXPECT_NE(findPhotograph(capture, "top", 0).error().describe().find("left"), std::string::npos);
}

TEST(Photographs, OfTheSharedCaptureAreAllFound) {
    ARS_TEST_DATA_FILE(calibration, "capture/casual/calibration_full.json");
    const auto capture = loadCaptureAsset(calibration.string());
    ASSERT_TRUE(capture.ok()) << capture.error().describe();
    ASSERT_EQ((*capture)->cameras.size(), 12u); // INDEX: 12 cameras x 26 frames
    for (const auto& list : (*capture)->photographs) {
        ASSERT_FALSE(list.empty());
        EXPECT_LE(list.size(), 26u);
        for (std::size_t i = 1; i < list.size(); ++i) {
            EXPECT_LT(photographNumber(list[i - 1]), photographNumber(list[i]));
        }
    }
}

} // namespace
} // namespace ars
