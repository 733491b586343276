#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/mesh.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace ars {

enum class PlyFormat { Ascii, BinaryLittleEndian, BinaryBigEndian };
enum class PlyType { I8, U8, I16, U16, I32, U32, F32, F64 };

/// Bytes of one number.
std::size_t plyTypeBytes(PlyType type);
/// "uchar", "float"...
std::string_view plyTypeName(PlyType type);

/// One property of an element with all its numbers. Every PLY type fits a double exactly.
struct PlyProperty {
    std::string name;
    PlyType type = PlyType::F32;
    bool isList = false;
    PlyType countType = PlyType::U8;   ///< lists only
    std::vector<double> values;        ///< one per element, or all lists end to end
    std::vector<std::uint64_t> starts; ///< lists only: count + 1 positions in `values`

    /// List `index`.
    std::span<const double> list(std::size_t index) const {
        return std::span<const double>(values).subspan(starts[index], starts[index + 1] - starts[index]);
    }
};

struct PlyElement {
    std::string name;
    std::uint64_t count = 0;
    std::vector<PlyProperty> properties;

    /// Null when there is none of this name.
    const PlyProperty* find(std::string_view property) const;
    /// A scalar property as floats. NotFound with the names that exist; BadFile when it is a list, or when a number is
    /// not finite (named with its row).
    Result<std::vector<float>> column(std::string_view property) const;
};

/// Any PLY file: the elements with their properties by name. A set of Gaussian surfels is the element "vertex" with
/// the columns x y z rot_0 ... (the surfel room knows what they mean).
struct PlyFile {
    PlyFormat format = PlyFormat::BinaryLittleEndian;
    std::vector<std::string> comments;
    std::vector<PlyElement> elements;

    const PlyElement* find(std::string_view element) const;
};

/// Reads ascii, binary_little_endian and binary_big_endian files. BadFile with the header line, or with element and row
/// ("vertex 12: ..."); counts are checked against the file's length before memory is taken. Non-finite numbers are
/// kept.
Result<PlyFile> readPly(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<PlyFile> parsePly(std::span<const std::byte> bytes, const ReadLimits& limits = defaultReadLimits());

/// In the format that `file` names. InvalidArgument when columns differ in length or a number does not fit its type.
Status writePly(const std::filesystem::path& path, const PlyFile& file);
Result<std::vector<std::byte>> encodePly(const PlyFile& file);

/// One element of float columns, e.g. a Gaussian set: {{"x", xs}, {"y", ys}, ...}.
PlyElement plyColumns(std::string elementName,
                      const std::vector<std::pair<std::string, std::span<const float>>>& columns);

/// Elements "vertex" (x y z, nx ny nz, s t | u v | texture_u texture_v, red green blue alpha) and "face"
/// (vertex_indices | vertex_index) as a mesh. Polygons are cut into fans; faces with fewer than three corners are
/// dropped; a file without faces is a point set. Texture coordinates are flipped into glTF's top-left origin. Integer
/// colours are taken as sRGB-encoded and become linear, float colours as linear already. BadFile for indices out of
/// range and positions that are not finite.
Result<TriangleMesh> readPlyMesh(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<TriangleMesh> meshFromPly(const PlyFile& file);

/// The inverse: positions as float, colours as sRGB uchar, `sourceVertices` and materials are not kept.
PlyFile plyFromMesh(const TriangleMesh& mesh, PlyFormat format = PlyFormat::BinaryLittleEndian);
Status writePlyMesh(const std::filesystem::path& path, const TriangleMesh& mesh,
                    PlyFormat format = PlyFormat::BinaryLittleEndian);

} // namespace ars
