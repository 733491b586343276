// Broken captures: one clear sentence that names the file, what was expected and what was found, before anything is
// learned from them.
#include "engine/capture/capture.h"

#include "engine/io/npz.h"
#include "engine/io/zip.h"
#include "tests/support/test_data.h"
#include "tests/unit/capture/synthetic_capture.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <functional>

namespace ars::test {
namespace {
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Broken {
    std::string name;
    CaptureKind kind = CaptureKind::AvatarRex;
    std::function<void(const SyntheticCapture&, const fs::path&)> breakIt;
    ErrorCode code = ErrorCode::BadFile;
    std::vector<std::string> words; ///< of the sentence, in order
};

/// Changes the second camera of the calibration.
std::function<void(const SyntheticCapture&, const fs::path&)> withCamera(std::function<void(Json&)> change) {
    return [change](const SyntheticCapture& what, const fs::path& folder) {
        Json json = calibrationJson(what);
        change(json[what.cameraName(1)]);
        writeBytes(folder / what.calibrationFile(), json.dump());
    };
}

/// Gives the second camera of the calibration another name.
std::function<void(const SyntheticCapture&, const fs::path&)> withName(std::string name) {
    return [name](const SyntheticCapture& what, const fs::path& folder) {
        const Json json = calibrationJson(what);
        Json changed;
        for (const auto& [key, camera] : json.items()) changed[key == what.cameraName(1) ? name : key] = camera;
        writeBytes(folder / what.calibrationFile(), changed.dump());
    };
}

std::function<void(const SyntheticCapture&, const fs::path&)> withCsv(std::string from, std::string to) {
    return [from, to](const SyntheticCapture& what, const fs::path& folder) {
        std::string text = calibrationCsv(what);
        text.replace(text.find(from), from.size(), to);
        writeBytes(folder / what.calibrationFile(), text);
    };
}

void truncate(const fs::path& path) { fs::resize_file(path, fs::file_size(path) / 2); }

/// What numpy writes for an array of Python objects.
void writeObjectNpz(const fs::path& path) {
    std::string header = "{'descr': '|O', 'fortran_order': False, 'shape': (4, 3), }";
    header.resize(118, ' ');
    header.back() = '\n';
    const std::string npy = std::string("\x93NUMPY\x01\x00\x76\x00", 10) + header + "\x80\x04.";
    std::ofstream stream(path, std::ios::binary);
    ZipWriter zip(
        [&](std::span<const std::byte> bytes) -> Status {
            stream.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
            return {};
        },
        false, false);
    const std::span<const std::byte> piece = std::as_bytes(std::span(npy));
    ASSERT_TRUE(zip.add("global_orient.npy", std::span(&piece, 1)).ok());
    ASSERT_TRUE(zip.finish().ok());
}

std::vector<Broken> brokenCaptures() {
    using Rex = const SyntheticCapture&;
    std::vector<Broken> all;
    const auto add = [&](std::string name, auto breakIt, ErrorCode code, std::vector<std::string> words) {
        all.push_back({std::move(name), CaptureKind::AvatarRex, breakIt, code, std::move(words)});
    };
    const auto addOf = [&](CaptureKind kind, std::string name, auto breakIt, ErrorCode code,
                           std::vector<std::string> words) {
        all.push_back({std::move(name), kind, breakIt, code, std::move(words)});
    };
    add("NoCalibration", [](Rex, const fs::path& f) { fs::remove(f / "calibration_full.json"); },
        ErrorCode::Unsupported,
        {"has no calibration", "calibration_full.json (AvatarReX)", "calibration.csv (ActorsHQ)"});
    add("CalibrationIsNoJson", [](Rex, const fs::path& f) { writeBytes(f / "calibration_full.json", "{\"a\": ["); },
        ErrorCode::BadFile, {"calibration_full.json", "is no sound JSON", "column"});
    add("NoCameras", [](Rex, const fs::path& f) { writeBytes(f / "calibration_full.json", "{}"); }, ErrorCode::BadFile,
        {"calibration_full.json", "the calibration has no camera"});
    add("WrongKey", withCamera([](Json& c) { c["Kmat"] = c["K"], c.erase("K"); }), ErrorCode::BadFile,
        {"calibration_full.json", "camera \"22010714\"", "K is missing"});
    add("CameraNameLeadsOut", withName("../elsewhere"), ErrorCode::BadFile,
        {"calibration_full.json", "\"../elsewhere\" is no camera name, expected the name of a folder"});
    add("CameraNameIsThePlaceItself", withName("."), ErrorCode::BadFile, {"\".\" is no camera name"});
    addOf(CaptureKind::THuman4, "THuman4CameraNameIsAPath", withName("/etc"), ErrorCode::BadFile,
          {"calibration.json", "\"/etc\" is no camera name"});
    addOf(CaptureKind::ActorsHq, "ActorsHqCameraNameIsThePlaceItself", withCsv("Cam002", "."), ErrorCode::BadFile,
          {"4x/calibration.csv", "line 3", "\".\" is no camera name"});
    add("ShortMatrix", withCamera([](Json& c) { c["R"] = {1, 0, 0, 0, 1, 0, 0, 0}; }), ErrorCode::BadFile,
        {"camera \"22010714\"", "R has 8 numbers, expected 9 (row-major 3x3)"});
    add("NoRotation", withCamera([](Json& c) { c["R"] = {2, 0, 0, 0, 1, 0, 0, 0, 1}; }), ErrorCode::BadFile,
        {"camera \"22010714\"", "R is no rotation"});
    add("TinyFocalLength", withCamera([](Json& c) { c["K"] = {0.9, 0, 20, 0, 0.9, 28, 0, 0, 1}; }), ErrorCode::BadFile,
        {"camera \"22010714\"", "a focal length of 0.9 pixels cannot belong to a picture of 40 x 56"});
    add("HugeFocalLength", withCamera([](Json& c) { c["K"] = {1e9, 0, 20, 0, 1e9, 28, 0, 0, 1}; }), ErrorCode::BadFile,
        {"camera \"22010714\"", "a focal length of 1e+09 pixels cannot belong to a picture of 40 x 56"});
    add("FarPrincipalPoint", withCamera([](Json& c) { c["K"] = {50, 0, 20000, 0, 50, 28, 0, 0, 1}; }),
        ErrorCode::BadFile, {"camera \"22010714\"", "the principal point (20000, 28) lies far outside the picture"});
    add("NegativeFocalLength", withCamera([](Json& c) { c["K"] = {-50, 0, 20, 0, 50, 28, 0, 0, 1}; }),
        ErrorCode::BadFile, {"camera \"22010714\"", "focal lengths in K must be positive, found -50 and 50"});
    add("Millimetres", withCamera([](Json& c) { c["T"] = {0.0, 300.0, 3000.0}; }), ErrorCode::BadFile,
        {"camera \"22010714\"", "m from the person, expected up to 100 m; is T in metres?"});
    add("CameraToWorld", withCamera([](Json& c) { c["T"] = {0.0, 0.0, -3.0}; }), ErrorCode::BadFile,
        {"camera \"22010714\"",
         "the person is behind the camera in every frame; R and T must take the world to the camera"});
    add("OneLensCoefficient", withCamera([](Json& c) { c["distCoeff"] = {0.1}; }), ErrorCode::BadFile,
        {"calibration_full.json", "camera \"22010714\"", "distCoeff has 1 numbers, expected 4, 5, 8, 12 or 14"});
    add("CameraWithoutFolder", [](Rex w, const fs::path& f) { fs::remove_all(f / w.cameraName(2)); },
        ErrorCode::BadFile, {"22010712", "holds no picture of camera \"22010712\", expected names like 00000000.jpg"});
    add("CameraWithoutPictures",
        [](Rex w, const fs::path& f) {
            for (int frame = 0; frame < 4; ++frame) fs::remove(f / w.picture(0, frame));
        },
        ErrorCode::BadFile, {"22010716", "holds no picture of camera \"22010716\""});
    add("NoPicturesAtAll",
        [](Rex w, const fs::path& f) {
            std::string missing;
            for (int camera = 0; camera < 3; ++camera) {
                for (int frame = 0; frame < 4; ++frame) missing += w.picture(camera, frame).string() + "\n";
            }
            writeBytes(f / "missing_img_files.txt", missing);
        },
        ErrorCode::BadFile, {"holds no picture; expected", "22010716/00000000.jpg"});
    add("CameraWithoutMasks", [](Rex w, const fs::path& f) { fs::remove_all(f / w.cameraName(1) / "mask"); },
        ErrorCode::BadFile,
        {"22010714/mask/pha", "has no mask of 22010714/00000000.jpg, and that picture has no alpha"});
    add("MaskOfAnotherSize",
        [](Rex w, const fs::path& f) {
            writePicture(f / w.mask(2, 1), filledImage(20, 28, 1, 1.0f, ColorSpace::Data));
        },
        ErrorCode::InvalidArgument,
        {"22010712/mask/pha/00000001.jpg", "the mask has 20 x 28 pixels, its picture 40 x 56"});
    add("PictureOfAnotherSize",
        [](Rex w, const fs::path& f) {
            writePicture(f / w.picture(1, 3), filledImage(20, 28, 3, 1.0f, ColorSpace::Srgb));
        },
        ErrorCode::BadFile, {"22010714/00000003.jpg", "has 20 x 28 pixels, the calibration says 40 x 56"});
    add("TruncatedPicture", [](Rex w, const fs::path& f) { truncate(f / w.picture(1, 2)); }, ErrorCode::BadFile,
        {"22010714/00000002.jpg", "is truncated: the JPEG has no end"});
    add("EmptyMask", [](Rex w, const fs::path& f) { fs::resize_file(f / w.mask(0, 3), 0); }, ErrorCode::BadFile,
        {"22010716/mask/pha/00000003.jpg", "is empty, expected a picture"});
    add("PictureIsText", [](Rex w, const fs::path& f) { writeBytes(f / w.picture(0, 0), "<html>not found</html>"); },
        ErrorCode::BadFile, {"22010716/00000000.jpg", "is no JPEG or PNG picture"});
    add("NoPoses", [](Rex, const fs::path& f) { fs::remove(f / "smpl_params.npz"); }, ErrorCode::NotFound,
        {"smpl_params.npz", "is not there; a capture needs the SMPL-X pose of every frame"});
    add("FewerPosesThanFrames",
        [](Rex, const fs::path& f) { ASSERT_TRUE(writeSmplParams(f / "smpl_params.npz", syntheticMotion(2)).ok()); },
        ErrorCode::BadFile, {"smpl_params.npz", "has 2 poses (0 to 1), the pictures go from number 0 to 3"});
    add("ObjectArray", [](Rex, const fs::path& f) { writeObjectNpz(f / "smpl_params.npz"); }, ErrorCode::Unsupported,
        {"smpl_params.npz", "global_orient", "object"});
    add("OtherKeys",
        [](Rex, const fs::path& f) {
            Array poses;
            poses.shape = {4, 87};
            poses.bytes.resize(4 * 87 * sizeof(float));
            ASSERT_TRUE(writeNpz(f / "smpl_params.npz", {{"Rh", poses}, {"Th", poses}}).ok());
        },
        ErrorCode::BadFile, {"smpl_params.npz", "Rh"});
    add("PosesAreTruncated", [](Rex, const fs::path& f) { truncate(f / "smpl_params.npz"); }, ErrorCode::BadFile,
        {"smpl_params.npz"});
    addOf(CaptureKind::THuman4, "THuman4WithoutImages", [](Rex, const fs::path& f) { fs::remove_all(f / "images"); },
          ErrorCode::BadFile, {"images/cam00", "holds no picture of camera \"cam00\""});
    addOf(CaptureKind::THuman4, "THuman4WrongKey", withCamera([](Json& c) { c.erase("imgSize"); }), ErrorCode::BadFile,
          {"calibration.json", "camera \"cam01\"", "imgSize is missing"});
    addOf(CaptureKind::ActorsHq, "ActorsHqWithoutCameras",
          [](Rex, const fs::path& f) { writeBytes(f / "4x/calibration.csv", ""); }, ErrorCode::BadFile,
          {"4x/calibration.csv", "the calibration has no camera"});
    addOf(CaptureKind::ActorsHq, "ActorsHqWithoutColumn", withCsv("tx,ty", "tx,tj"), ErrorCode::BadFile,
          {"4x/calibration.csv", "line 1", "the column ty is missing"});
    addOf(CaptureKind::ActorsHq, "ActorsHqWithoutPictures",
          [](Rex, const fs::path& f) { fs::remove_all(f / "4x/rgbs"); }, ErrorCode::BadFile,
          {"holds no picture; expected", "rgbs/Cam001/Cam001_rgb000000.jpg"});
    addOf(CaptureKind::ActorsHq, "ActorsHqTruncatedMask", [](Rex w, const fs::path& f) { truncate(f / w.mask(1, 0)); },
          ErrorCode::BadFile, {"masks/Cam002/Cam002_mask000000.png", "is truncated: the PNG has no end"});
    addOf(CaptureKind::ActorsHq, "ActorsHqWithoutPoses",
          [](Rex, const fs::path& f) { fs::remove(f / "smpl_params.npz"); }, ErrorCode::NotFound,
          {"smpl_params.npz", "is not there"});
    return all;
}

void expectSentence(const Error& error, const std::vector<std::string>& words) {
    const std::string sentence = error.describe();
    EXPECT_EQ(sentence.find('\n'), std::string::npos) << sentence;
    EXPECT_LT(sentence.size(), 400u) << sentence;
    std::size_t at = 0;
    for (const std::string& word : words) {
        const std::size_t found = sentence.find(word, at);
        EXPECT_NE(found, std::string::npos) << "\"" << word << "\" in: " << sentence;
        if (found != std::string::npos) at = found + word.size();
    }
}

TEST(BrokenCapture, EachSaysWhatIsWrongInOneSentence) {
    for (const Broken& broken : brokenCaptures()) {
        SCOPED_TRACE(broken.name);
        SyntheticCapture what;
        what.kind = broken.kind;
        const TemporaryFolder folder;
        writeCapture(what, folder.path());
        ASSERT_TRUE(openCapture(folder.path()).ok());
        broken.breakIt(what, folder.path());
        const auto capture = openCapture(folder.path());
        ASSERT_FALSE(capture.ok());
        EXPECT_EQ(errorCodeName(capture.error().code), errorCodeName(broken.code));
        expectSentence(capture.error(), broken.words);
    }
}

TEST(CameraName, IsTheNameOfAFolder) {
    for (const std::string& name : {std::string("22010708"), std::string("Cam001"), std::string("front left"),
                                    std::string("kamera\xc3\xa4"), std::string("..."), std::string("a..b")}) {
        EXPECT_TRUE(checkCameraName(name).ok()) << name;
    }
    for (const std::string& name :
         {std::string(), std::string("."), std::string(".."), std::string("../x"), std::string("a/b"), std::string("/"),
          std::string("a\\b"), std::string("a\0b", 3), std::string("a\nb"), std::string("\x7f")}) {
        const Status status = checkCameraName(name);
        ASSERT_FALSE(status.ok()) << name;
        expectSentence(status.error(), {"is no camera name"});
    }
}

TEST(BrokenCapture, AFolderMustBeOne) {
    const TemporaryFolder folder;
    writeBytes(folder / "file", "hello");
    fs::create_directory_symlink(folder / "loop", folder / "loop");
    const auto file = openCapture(folder / "file");
    ASSERT_FALSE(file.ok());
    EXPECT_EQ(file.error().code, ErrorCode::InvalidArgument);
    expectSentence(file.error(), {"/file", "is a file, expected the folder of a multi-view capture"});
    const auto nothing = openCapture(folder / "nothing");
    ASSERT_FALSE(nothing.ok());
    EXPECT_EQ(nothing.error().code, ErrorCode::NotFound);
    expectSentence(nothing.error(), {"/nothing", "there is no such folder"});
    const auto loop = openCapture(folder / "loop");
    ASSERT_FALSE(loop.ok());
    EXPECT_EQ(loop.error().code, ErrorCode::Io);
    expectSentence(loop.error(), {"/loop", "cannot be opened"});
}

/// Opens as somebody who is not the superuser, for whom every folder is open.
Result<Capture> openAsNobody(const fs::path& folder) {
    constexpr uid_t kNobody = 65534;
    const uid_t self = ::geteuid();
    if (self == 0 && ::seteuid(kNobody) != 0) notRun("this user cannot become another one");
    auto capture = openCapture(folder);
    if (self == 0 && ::seteuid(self) != 0) std::abort();
    return capture;
}

TEST(BrokenCapture, AnUnreadableFolderIsSaidToBeOne) {
    SyntheticCapture what;
    const TemporaryFolder folder;
    fs::permissions(folder.path(), fs::perms::owner_all | fs::perms::group_read | fs::perms::group_exec);
    writeCapture(what, folder / "capture");
    fs::permissions(folder / "capture", fs::perms::none);
    const auto closed = openAsNobody(folder / "capture");
    const fs::perms open = fs::perms::owner_all | fs::perms::group_read | fs::perms::group_exec;
    fs::permissions(folder / "capture", open);
    ASSERT_FALSE(closed.ok());
    EXPECT_EQ(closed.error().code, ErrorCode::Io);
    expectSentence(closed.error(), {"/capture", "cannot be opened", "ermission"});
    for (const auto& entry : fs::recursive_directory_iterator(folder / "capture")) fs::permissions(entry.path(), open);
    const auto readable = openAsNobody(folder / "capture");
    ASSERT_TRUE(readable.ok()) << readable.error().describe();
    fs::permissions(folder / "capture" / what.cameraName(1), fs::perms::none);
    const auto camera = openAsNobody(folder / "capture");
    fs::permissions(folder / "capture" / what.cameraName(1), open);
    ASSERT_FALSE(camera.ok());
    expectSentence(camera.error(), {"/22010714", "cannot be opened", "ermission"});
}

TEST(BrokenCapture, TheFolderAboveNamesTheCapturesInIt) {
    SyntheticCapture what;
    const TemporaryFolder folder;
    writeCapture(what, folder / "one");
    writeCapture(what, folder / "two");
    const auto above = openCapture(folder.path());
    ASSERT_FALSE(above.ok());
    expectSentence(above.error(), {"has no calibration", "captures inside it: one, two"});
}

TEST(BrokenCapture, AViewThatBreaksLaterNamesItsFile) {
    SyntheticCapture what;
    const TemporaryFolder folder;
    writeCapture(what, folder.path());
    const auto capture = openCapture(folder.path());
    ASSERT_TRUE(capture.ok());
    truncate(folder.path() / what.picture(0, 0));
    fs::remove(folder.path() / what.mask(1, 1));
    writePicture(folder.path() / what.mask(2, 2), filledImage(10, 10, 1, 1.0f, ColorSpace::Data));
    const auto broken = readView(*capture, {0, 0});
    ASSERT_FALSE(broken.ok());
    expectSentence(broken.error(), {"22010716/00000000.jpg"});
    const auto gone = readView(*capture, {1, 1});
    ASSERT_FALSE(gone.ok());
    EXPECT_EQ(gone.error().code, ErrorCode::NotFound);
    expectSentence(gone.error(), {"22010714/mask/pha/00000001.jpg"});
    const auto small = readView(*capture, {2, 2});
    ASSERT_FALSE(small.ok());
    EXPECT_EQ(small.error().code, ErrorCode::InvalidArgument);
    expectSentence(small.error(),
                   {"22010712/mask/pha/00000002.jpg", "the mask has 10 x 10 pixels, its picture 40 x 56"});
    const auto nowhere = readView(*capture, {7, 0});
    ASSERT_FALSE(nowhere.ok());
    expectSentence(nowhere.error(), {"there is no view of camera 7 and frame 0; there are 3 cameras and 4 frames"});
    const auto options = readView(*capture, {0, 1}, {.scale = 9});
    ASSERT_FALSE(options.ok());
    expectSentence(options.error(), {"picture scale: must lie in [1, 8], found 9"});
}

} // namespace
} // namespace ars::test
