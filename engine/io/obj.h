#pragma once

#include "engine/core/error.h"
#include "engine/core/limits.h"
#include "engine/io/mesh.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// A run of triangles under one "o" or "g" line.
struct ObjGroup {
    std::string name;
    std::size_t firstTriangle = 0;
    std::size_t triangleCount = 0;
};

/// A Wavefront OBJ file as one mesh. Vertex i is the i-th "v" line, used or not, so that body topologies keep their
/// order; where (v, vt, vn) differ between faces, further copies follow at the end and `mesh.sourceVertices` tells
/// whose they are. A file without faces is a point set.
struct ObjFile {
    TriangleMesh mesh;
    std::vector<std::string> materialLibraries; ///< the names on "mtllib" lines; the files are not read
    std::vector<ObjGroup> groups;               ///< empty groups are left out
    std::size_t sourceVertexCount = 0;          ///< number of "v" lines
};

/// Reads v (with optional w or colour), vt, vn, f (v, v/t, v//n, v/t/n; negative indices; polygons as fans), o, g,
/// usemtl, mtllib; "\" at the end of a line joins it to the next. Lines of other kinds (s, l, p, curves) are skipped.
/// Vertex colours are taken as sRGB-encoded and become linear. v of texture coordinates is flipped into glTF's top-left
/// origin. Where only some corners have texture coordinates or normals, the others get 0.
///
/// BadFile with the line: "line 12: a face names vertex 99, the file has 40".
Result<ObjFile> readObj(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<ObjFile> parseObj(std::span<const std::byte> bytes, const ReadLimits& limits = defaultReadLimits());

/// Positions, normals, texture coordinates and colours as far as the mesh has them, "usemtl" by the mesh's materials.
/// With `materialLibrary` the file refers to that .mtl; it is not written. InvalidArgument where validateMesh fails.
Status writeObj(const std::filesystem::path& path, const TriangleMesh& mesh, const std::string& materialLibrary = "");
Result<std::string> formatObj(const TriangleMesh& mesh, const std::string& materialLibrary = "");

} // namespace ars
