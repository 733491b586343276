#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/image.h"

#include <filesystem>
#include <string>
#include <vector>

namespace ars {

/// Radiance from far away as a lat-long picture: linear RGB, 3 channels, +z in the centre, +x a quarter to the left,
/// top row +y (docs/conventions.md, Environments). Every number is finite and not negative.
struct Environment {
    Image picture;
    std::vector<std::string> notes; ///< what had to be changed on the way in, one sentence each, for people to read
};

/// How an environment is hung around the scene. Changing it costs no filtering.
struct EnvironmentPlacement {
    float rotationDeg = 0.0f; ///< about +y; positive takes +z towards +x
    float scale = 1.0f;       ///< linear exposure, not negative

    bool operator==(const EnvironmentPlacement&) const = default;
};

/// Picture sides that readEnvironment takes; larger ones are refused.
inline constexpr int kMaxEnvironmentWidth = 16384;

/// Makes an environment of a decoded picture.
///
/// The layout follows from width : height. 2:1 lat-long (a single pixel, too, and any other shape that no cube has
/// between 3:2 and 5:2, with a note); 4:3 horizontal cross (+y above and -y below +z; -x +z +x -z from the left); 3:4
/// vertical cross (-z at the bottom, upside down); 6:1 or 1:6 strip in the order +x -x +y -y +z -z. Cubes become
/// lat-long of four times the face's side.
/// Alpha is dropped (premultiplied colours stay), one channel becomes grey, sRGB is decoded with a note. NaN and
/// negative numbers become 0 and infinite ones the picture's largest finite number (65,504 where there is none), with a
/// note that counts them. Black and 1x1 are valid. BadFile: a shape that is none of these; InvalidArgument:
/// pixels.size() is not what the sides say; LimitExceeded.
Result<Environment> environmentFromImage(Image image);

/// Six square pictures of one side, in the order +x -x +y -y +z -z, each laid out as cubeFaceAxes says (OpenGL's).
Result<Environment> environmentFromFaces(const std::vector<Image>& faces);

/// Reads a picture file, or a folder with six files named px nx py ny pz nz (or posx negx ...) with one of the endings
/// exr hdr png jpg jpeg. Errors of the readers, and those above; a missing face is named.
Result<Environment> readEnvironment(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());

/// A uniform environment, for tests and as the light of a new document.
Environment uniformEnvironment(float radiance, int width = 64);

} // namespace ars
