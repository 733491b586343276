#pragma once

#include "engine/core/limits.h"
#include "engine/io/npz.h"
#include "engine/rig/pose.h"
#include "engine/rig/skinning.h"

#include <glm/glm.hpp>

#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace ars {

/// A body with SMPL-X's keys: the user's own SMPLX_*.npz or the open body that ships with the program.
///
/// Sizes are read from the arrays (V vertices, F triangles, 55 joints, S shape and E expression components); metres, y
/// up, +z front, +x the body's left, T-pose.
struct BodyModel {
    std::string name;
    std::vector<glm::vec3> templateVertices; ///< v_template (V)
    std::vector<glm::uvec3> triangles;       ///< f (F)
    std::vector<float> shapeDirs;            ///< (V,3,S) row-major
    int shapeCount = 0;
    std::vector<float> expressionDirs; ///< (V,3,E)
    int expressionCount = 0;
    std::vector<float> poseDirs;                                ///< (V,3,486), empty when all are zero
    std::vector<float> jointRegressor;                          ///< (55,V) row-major
    SkinWeights weights;                                        ///< (V)
    std::vector<int> parents;                                   ///< (55)
    std::vector<std::string> jointNames;                        ///< (55)
    std::vector<std::string> shapeNames;                        ///< (S) or empty
    std::vector<std::string> expressionNames;                   ///< (E) or empty
    std::vector<float> handMeanLeft, handMeanRight;             ///< (45) axis-angle
    std::vector<float> handComponentsLeft, handComponentsRight; ///< (45,45)

    std::size_t vertexCount() const { return templateVertices.size(); }
};

/// Shape and expression coefficients; missing ones are zero, those beyond the body's own count are ignored.
struct BodyShape {
    std::vector<float> betas;
    std::vector<float> expression;
};

/// BadFile with key, expected and found shape; numbers that are not finite, cyclic parents and indices out of range are
/// named with their place; Unsupported for SMPL and SMPL+H bodies and for a pickled (sparse) regressor, with the way to
/// convert it. Numbers of any type.
///
/// shapedirs (V,3,K) is split as the smplx package does: K >= 400 means shape 0-299 and expression 300-399, fewer mean
/// shape 0-9 and expression 10-19, as far as they exist; further directions are ignored.
Result<BodyModel> readBodyModel(const std::filesystem::path& path, const ReadLimits& limits = defaultReadLimits());
Result<BodyModel> bodyModelFromArrays(const NpzFile& file);

/// The open body of resources/bodies.
Result<BodyModel> readOpenBody();

/// v_template + shape + expression (V).
std::vector<glm::vec3> shapedVertices(const BodyModel& body, const BodyShape& shape);

/// Joints of a shaped body: J_regressor v (55).
std::vector<glm::vec3> regressJoints(const BodyModel& body, std::span<const glm::vec3> vertices);

/// Skeleton of a shaped body.
Skeleton bodySkeleton(const BodyModel& body, const BodyShape& shape);

/// Vertices with pose blend shapes added, before skinning: v_shaped + posedirs . feature(pose) (V).
std::vector<glm::vec3> poseBlendedVertices(const BodyModel& body, std::span<const glm::vec3> shaped, const Pose& pose);

/// The whole model: shape, expression, pose blend shapes, joints, skinning, translation. Posed vertices (V) in metres.
/// `posedJoints`, if given, receives (55). Pose::expression is used where shape.expression is empty.
std::vector<glm::vec3> posedVertices(const BodyModel& body, const BodyShape& shape, const Pose& pose,
                                     std::vector<glm::vec3>* posedJoints = nullptr, bool poseBlendShapes = true);

} // namespace ars
