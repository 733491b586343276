#include "engine/light/environment.h"

#include "engine/core/parallel.h"
#include "engine/io/image_file.h"
#include "engine/light/cube_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <system_error>

namespace ars {
namespace {

constexpr std::array<std::array<const char*, 2>, 6> kFaceNames{
    {{"px", "posx"}, {"nx", "negx"}, {"py", "posy"}, {"ny", "negy"}, {"pz", "posz"}, {"nz", "negz"}}};
constexpr std::array<const char*, 5> kEndings{"exr", "hdr", "png", "jpg", "jpeg"};
constexpr float kBrightestHalf = 65504.0f;

Error badPicture(std::string message) { return makeError(ErrorCode::BadFile, "environment", std::move(message)); }

Status checkPicture(const Image& image) {
    if (image.width < 1 || image.height < 1 || image.channels < 1 || image.channels > 4) {
        return makeError(ErrorCode::InvalidArgument, "environment",
                         fmt::format("{}x{} with {} channels, expected a picture with 1 to 4", image.width,
                                     image.height, image.channels));
    }
    const std::size_t expected = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height) *
                                 static_cast<std::size_t>(image.channels);
    if (image.pixels.size() == expected) return {};
    return makeError(ErrorCode::InvalidArgument, "environment",
                     fmt::format("{} numbers, expected {} for {}x{} with {} channels", image.pixels.size(), expected,
                                 image.width, image.height, image.channels));
}

/// Three linear channels; alpha is dropped, grey repeated, sRGB decoded (which is noted).
Result<Image> linearColor(Image image, std::vector<std::string>& notes) {
    if (image.space == ColorSpace::Srgb) {
        notes.push_back(fmt::format("{}-bit sRGB picture: decoded to linear light, highlights above white are missing",
                                    image.sourceBits));
        ARS_TRY(image, convertColorSpace(std::move(image), ColorSpace::Linear));
    }
    image.space = ColorSpace::Linear;
    if (image.channels == 3) return image;
    Image color = image;
    color.channels = 3;
    color.premultiplied = false;
    const std::size_t count = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
    const std::size_t stride = static_cast<std::size_t>(image.channels);
    color.pixels.resize(3 * count);
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t c = 0; c < 3; ++c) color.pixels[3 * i + c] = image.pixels[i * stride + (stride >= 3 ? c : 0)];
    }
    return color;
}

/// Makes every number finite and not negative, and says how many were not.
void sanitise(Image& image, std::vector<std::string>& notes) {
    std::size_t nan = 0, negative = 0, infinite = 0;
    float largest = 0.0f;
    for (const float v : image.pixels) {
        if (std::isnan(v)) {
            ++nan;
        } else if (v < 0.0f) {
            ++negative;
        } else if (std::isinf(v)) {
            ++infinite;
        } else {
            largest = std::max(largest, v);
        }
    }
    if (nan + negative + infinite == 0) return;
    if (!(largest > 0.0f)) largest = kBrightestHalf;
    for (float& v : image.pixels) {
        if (!(v >= 0.0f)) v = 0.0f;
        if (std::isinf(v)) v = largest;
    }
    const auto note = [&](std::size_t count, std::string_view what, const std::string& became) {
        if (count > 0)
            notes.push_back(fmt::format("{} of {} numbers {}: set to {}", count, image.pixels.size(), what, became));
    };
    note(nan, "are not numbers (NaN)", "0");
    note(negative, "are negative", "0");
    note(infinite, "are infinite", fmt::format("{:.6g}", largest));
}

/// Where a face lies in a picture of all six: its upper left corner in faces.
struct FacePlace {
    int column, row;
    bool upsideDown = false;
};

struct CubeLayout {
    int columns, rows;
    std::array<FacePlace, 6> faces;
};

constexpr std::array<CubeLayout, 4> kCubeLayouts{{
    {4, 3, {{{2, 1}, {0, 1}, {1, 0}, {1, 2}, {1, 1}, {3, 1}}}},
    {3, 4, {{{2, 1}, {0, 1}, {1, 0}, {1, 2}, {1, 1}, {1, 3, true}}}},
    {6, 1, {{{0, 0}, {1, 0}, {2, 0}, {3, 0}, {4, 0}, {5, 0}}}},
    {1, 6, {{{0, 0}, {0, 1}, {0, 2}, {0, 3}, {0, 4}, {0, 5}}}},
}};

const CubeLayout* layoutOf(const Image& image) {
    for (const CubeLayout& layout : kCubeLayouts) {
        if (image.width % layout.columns == 0 && image.height % layout.rows == 0 &&
            image.width / layout.columns == image.height / layout.rows) {
            return &layout;
        }
    }
    return nullptr;
}

void copyFace(const Image& from, int left, int top, bool upsideDown, CubeMap& cube, int face) {
    const int n = cube.size;
    for (int row = 0; row < n; ++row) {
        for (int column = 0; column < n; ++column) {
            const int y = upsideDown ? n - 1 - row : row, x = upsideDown ? n - 1 - column : column;
            for (int c = 0; c < 3; ++c) cube.texel(face, row, column)[c] = from.at(top + y, left + x, c);
        }
    }
}

Result<Image> latLongOfCube(const CubeMap& cube) {
    if (4 * cube.size > kMaxEnvironmentWidth) {
        return makeError(
            ErrorCode::LimitExceeded, "environment",
            fmt::format("cube faces of {} pixels, at most {} are taken", cube.size, kMaxEnvironmentWidth / 4));
    }
    return latLongFromCube(cube, 4 * cube.size, 2 * cube.size);
}

Result<Image> latLongOf(Image image, std::vector<std::string>& notes) {
    const int w = image.width, h = image.height;
    if (w == 2 * h || (w == 1 && h == 1)) return image;
    if (const CubeLayout* layout = layoutOf(image)) {
        CubeMap cube(w / layout->columns);
        for (int face = 0; face < 6; ++face) {
            const FacePlace place = layout->faces[static_cast<std::size_t>(face)];
            copyFace(image, place.column * cube.size, place.row * cube.size, place.upsideDown, cube, face);
        }
        return latLongOfCube(cube);
    }
    if (2 * w >= 3 * h && 2 * w <= 5 * h) {
        notes.push_back(fmt::format("{}x{} is not 2:1: stretched over the whole sphere", w, h));
        return image;
    }
    return badPicture(
        fmt::format("{}x{} is no environment: expected 2:1 (latitude-longitude), 4:3 or 3:4 (cross of cube "
                    "faces), 6:1 or 1:6 (strip of cube faces)",
                    w, h));
}

/// The file of a face in a folder, or an empty path.
std::filesystem::path faceFile(const std::filesystem::path& folder, std::size_t face) {
    for (const char* name : kFaceNames[face]) {
        for (const char* ending : kEndings) {
            std::filesystem::path file = folder / (std::string(name) + "." + ending);
            std::error_code ignored;
            if (std::filesystem::is_regular_file(file, ignored)) return file;
        }
    }
    return {};
}

Result<Environment> readFaces(const std::filesystem::path& folder, const ReadLimits& limits) {
    std::vector<Image> faces;
    for (std::size_t face = 0; face < 6; ++face) {
        const std::filesystem::path file = faceFile(folder, face);
        if (file.empty()) {
            return makeError(
                ErrorCode::NotFound, folder.string(),
                fmt::format("no file for cube face {0}, expected {0}.exr (or hdr, png, jpg) beside px nx py "
                            "ny pz nz",
                            kFaceNames[face][0]));
        }
        auto image = readImageFile(file, limits);
        if (!image) return std::move(image).error();
        faces.push_back(*std::move(image));
    }
    auto environment = environmentFromFaces(faces);
    if (!environment) return atPlace(std::move(environment).error(), folder.string());
    return environment;
}

} // namespace

Result<Environment> environmentFromImage(Image image) {
    ARS_TRY_STATUS(checkPicture(image));
    if (image.width > 6 * kMaxEnvironmentWidth || image.height > 6 * kMaxEnvironmentWidth) {
        return makeError(
            ErrorCode::LimitExceeded, "environment",
            fmt::format("{}x{} pixels, at most {} wide are taken", image.width, image.height, kMaxEnvironmentWidth));
    }
    Environment environment;
    ARS_TRY(Image color, linearColor(std::move(image), environment.notes));
    sanitise(color, environment.notes);
    ARS_TRY(environment.picture, latLongOf(std::move(color), environment.notes));
    if (environment.picture.width > kMaxEnvironmentWidth) {
        return makeError(
            ErrorCode::LimitExceeded, "environment",
            fmt::format("{} pixels wide, at most {} are taken", environment.picture.width, kMaxEnvironmentWidth));
    }
    return environment;
}

Result<Environment> environmentFromFaces(const std::vector<Image>& faces) {
    if (faces.size() != 6) {
        return makeError(ErrorCode::InvalidArgument, "environment",
                         fmt::format("{} cube faces, expected 6", faces.size()));
    }
    Environment environment;
    CubeMap cube;
    for (std::size_t face = 0; face < 6; ++face) {
        const Image& image = faces[face];
        const char* name = kFaceNames[face][0];
        auto checked = checkPicture(image);
        if (!checked) return atPlace(std::move(checked).error(), name);
        if (image.width != image.height || image.width != faces[0].width) {
            return makeError(ErrorCode::BadFile, name,
                             fmt::format("{}x{} pixels, expected a square of {} like {}", image.width, image.height,
                                         faces[0].width, kFaceNames[0][0]));
        }
        if (4 * static_cast<long>(image.width) > kMaxEnvironmentWidth) {
            return makeError(
                ErrorCode::LimitExceeded, name,
                fmt::format("{} pixels a side, at most {} are taken", image.width, kMaxEnvironmentWidth / 4));
        }
        if (face == 0) cube = CubeMap(image.width);
        std::vector<std::string> notes;
        ARS_TRY(Image color, linearColor(image, notes));
        sanitise(color, notes);
        for (const std::string& note : notes) environment.notes.push_back(fmt::format("{}: {}", name, note));
        copyFace(color, 0, 0, false, cube, static_cast<int>(face));
    }
    ARS_TRY(environment.picture, latLongOfCube(cube));
    return environment;
}

Result<Environment> readEnvironment(const std::filesystem::path& path, const ReadLimits& limits) {
    std::error_code ignored;
    if (std::filesystem::is_directory(path, ignored)) return readFaces(path, limits);
    ARS_TRY(Image image, readImageFile(path, limits));
    auto environment = environmentFromImage(std::move(image));
    if (!environment) return atPlace(std::move(environment).error(), path.string());
    return environment;
}

Environment uniformEnvironment(float radiance, int width) {
    Environment environment;
    environment.picture.width = std::max(2, width);
    environment.picture.height = environment.picture.width / 2;
    environment.picture.channels = 3;
    environment.picture.pixels.assign(3 * static_cast<std::size_t>(environment.picture.width) *
                                          static_cast<std::size_t>(environment.picture.height),
                                      radiance);
    return environment;
}

} // namespace ars
