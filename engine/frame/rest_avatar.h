#pragma once

#include "engine/core/limits.h"
#include "engine/core/parameters.h"
#include "engine/core/progress.h"
#include "engine/frame/avatar_evaluator.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace ars {

/// Where a rest: avatar puts its surfels.
enum class RestSampling {
    Surface,  ///< evenly over the surface, no two closer than about the spacing
    Vertices, ///< one at every vertex of the mesh
};

template <>
struct EnumWords<RestSampling> {
    static constexpr std::array words{"surface", "vertices"};
};

struct RestAvatarOptions {
    RestSampling sampling = RestSampling::Surface;
    int maxSurfels = 60000;   ///< at most so many; Surface: about so many
    float spacingM = 0.0f;    ///< Surface: least distance of neighbours, metres; 0: from maxSurfels and the area
    float scaleFactor = 0.7f; ///< standard deviation over the distance to the three nearest neighbours
    float opacity = 0.99f;    ///< of every surfel
    float insetM = 0.0042f;   ///< surfels lie this far inside the surface, metres (docs/math/posing.md, Silhouettes)
    bool twoSided = false;    ///< a second surfel behind each, for open garments seen from inside
    int seed = 1;

    bool operator==(const RestAvatarOptions&) const = default;
};
const ParameterTable<RestAvatarOptions>& restAvatarParameters();

/// Surfels straight from a skinned mesh, textured or not: the avatar that needs no network.
///
/// Its canonical pose is the mesh's own rest pose (AvatarRig::canonical holds identities), so that posed surfels lie
/// where posedTemplate puts the surface, but for the inset and a difference of second order in the triangles' size.
/// Albedo is base colour texture (bilinear, decoded from sRGB, averaged over a spacing) x factor x vertex colour, 0.5
/// grey without any; roughness is factor x green of the texture; radiance is sRGB(albedo). Metal is not looked at.
///
/// Made of a body it takes the body's shape coefficients, and the expression of every pose moves the face's surfels;
/// joints stay those of the face without expression. Bodies' pose blend shapes are not looked at.
///
/// The defaults are for pictures in which a person is some 400 pixels tall; docs/math/posing.md, Silhouettes.
class RestAvatar : public AvatarEvaluator {
public:
    /// InvalidArgument for options out of range, a mesh without triangles or area, with numbers that are not finite, or
    /// whose weights do not fit; BadFile for a texture that cannot be decoded, naming material and picture.
    static Result<std::unique_ptr<RestAvatar>> create(TemplateMesh mesh, const RestAvatarOptions& options = {},
                                                      const ProgressFunction& progress = {});
    /// A body at a shape. Surfels sit on the same points of the skin whatever the shape.
    /// @param betas  shape coefficients; missing ones are 0, those beyond the body's own count are ignored
    /// @return errors as above; InvalidArgument for coefficients that are not finite or beyond +-kMaxShapeCoefficient
    static Result<std::unique_ptr<RestAvatar>> create(std::shared_ptr<const BodyModel> body,
                                                      const std::vector<float>& betas,
                                                      const RestAvatarOptions& options = {},
                                                      const ProgressFunction& progress = {});
    /// The same points of the skin at another shape, in a fraction of the time that create takes; the result equals
    /// create's. Unsupported where this was not made of a body.
    Result<std::unique_ptr<RestAvatar>> withShape(const std::vector<float>& betas) const;

    const AvatarRig& rig() const override { return rig_; }
    const TemplateMesh& mesh() const override { return mesh_; }
    std::string description() const override;
    /// True for bodies that have expressions.
    bool dependsOnPose() const override { return !movingSurfels_.empty(); }
    bool colorsDependOnView() const override { return false; }
    bool sameSurfels(const Pose& a, const Pose& b) const override;
    /// Copies the constant surfels and moves those of the face by the pose's expression; nothing else of pose and view
    /// is looked at. Several threads may call it at once.
    Status evaluate(const Pose& pose, const Camera* view, Surfels& surfels) override;

    /// The constant surfels themselves, without expression.
    const Surfels& surfels() const { return surfels_; }
    /// What was left out or guessed, one sentence each (a picture without bytes, a material without colour).
    const std::vector<std::string>& notes() const { return notes_; }
    /// One name for each coefficient; empty where the avatar has none.
    const std::vector<std::string>& shapeNames() const { return shapeNames_; }
    const std::vector<std::string>& expressionNames() const { return expressionNames_; }
    /// Surfels that an expression moves, increasing (the second sides of two-sided ones not counted).
    const std::vector<std::uint32_t>& movingSurfels() const { return movingSurfels_; }

private:
    RestAvatar() = default;
    struct SkinPoints; ///< where on the mesh surfels sit and what the materials say there; shared between shapes
    static Result<std::shared_ptr<const SkinPoints>>
    pointsOn(const TemplateMesh& mesh, const RestAvatarOptions& options, const ProgressFunction& progress);
    static Result<std::unique_ptr<RestAvatar>> onPoints(TemplateMesh mesh, std::shared_ptr<const SkinPoints> points,
                                                        const RestAvatarOptions& options);
    static Result<std::unique_ptr<RestAvatar>> ofBody(std::shared_ptr<const BodyModel> body,
                                                      const std::vector<float>& betas,
                                                      std::shared_ptr<const SkinPoints> points,
                                                      const RestAvatarOptions& options);
    void findMovingSurfels();

    TemplateMesh mesh_;
    AvatarRig rig_;
    Surfels surfels_;
    std::vector<std::string> notes_;
    RestAvatarOptions options_;
    std::shared_ptr<const SkinPoints> points_;
    std::vector<float> depths_;                                 ///< how far inside the surface each surfel lies, metres
    std::shared_ptr<const BodyModel> body_;                     ///< null: made of a mesh
    std::vector<std::uint32_t> movingVertices_, movingSurfels_; ///< of expressions
    std::vector<std::string> shapeNames_, expressionNames_;
};

/// Largest shape and expression coefficient that is taken, of either sign.
inline constexpr float kMaxShapeCoefficient = 100.0f;

/// What a rest: avatar is made of, read once for all its shapes and densities.
struct RestInput {
    std::shared_ptr<const BodyModel> body; ///< of "open" and body files
    TemplateMesh mesh;                     ///< of everything else
};

/// "open" (the open body), a body file (SMPL-X npz) or a template of any kind that readTemplate knows; files without
/// weights get those of the open body. Errors as the readers', with the path.
Result<RestInput> readRestInput(const std::string& source, const ProgressFunction& progress = {},
                                const ReadLimits& limits = defaultReadLimits());

/// RestAvatar::create of either.
/// @param betas  shape coefficients of bodies; not looked at for templates
Result<std::unique_ptr<RestAvatar>> makeRestAvatar(RestInput source, const std::vector<float>& betas = {},
                                                   const RestAvatarOptions& options = {},
                                                   const ProgressFunction& progress = {});

/// Both in one call. Errors with the path.
Result<std::unique_ptr<RestAvatar>> restAvatarFromFile(const std::string& source, const RestAvatarOptions& options = {},
                                                       const ProgressFunction& progress = {},
                                                       const ReadLimits& limits = defaultReadLimits(),
                                                       const std::vector<float>& betas = {});

/// Whether a file is a body (SMPL-X npz) by its keys; false for what cannot be read.
bool isBodyFile(const std::string& path, const ReadLimits& limits = defaultReadLimits());

} // namespace ars
