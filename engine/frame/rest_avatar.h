#pragma once

#include "engine/core/limits.h"
#include "engine/core/parameters.h"
#include "engine/core/progress.h"
#include "engine/frame/avatar_evaluator.h"

#include <cstdint>
#include <memory>
#include <string>

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
};
const ParameterTable<RestAvatarOptions>& restAvatarParameters();

/// Surfels straight from a skinned mesh, textured or not: the avatar that needs no network.
///
/// Its canonical pose is the mesh's own rest pose (AvatarRig::canonical holds identities), so that posed surfels lie
/// where posedTemplate puts the surface, but for the inset and a difference of second order in the triangles' size.
/// Albedo is base colour texture (bilinear, decoded from sRGB, averaged over a spacing) x factor x vertex colour, 0.5
/// grey without any; roughness is factor x green of the texture; radiance is sRGB(albedo). Metal is not looked at.
///
/// The defaults are for pictures in which a person is some 400 pixels tall; docs/math/posing.md, Silhouettes.
class RestAvatar : public AvatarEvaluator {
public:
    /// InvalidArgument for options out of range, a mesh without triangles or area, with numbers that are not finite, or
    /// whose weights do not fit; BadFile for a texture that cannot be decoded, naming material and picture.
    static Result<std::unique_ptr<RestAvatar>> create(TemplateMesh mesh, const RestAvatarOptions& options = {},
                                                      const ProgressFunction& progress = {});

    const AvatarRig& rig() const override { return rig_; }
    const TemplateMesh& mesh() const override { return mesh_; }
    std::string description() const override;
    bool dependsOnPose() const override { return false; }
    bool colorsDependOnView() const override { return false; }
    /// Copies the constant surfels; pose and view are not looked at.
    Status evaluate(const Pose& pose, const Camera* view, Surfels& surfels) override;

    /// The constant surfels themselves.
    const Surfels& surfels() const { return surfels_; }
    /// What was left out or guessed, one sentence each (a picture without bytes, a material without colour).
    const std::vector<std::string>& notes() const { return notes_; }

private:
    RestAvatar() = default;
    TemplateMesh mesh_;
    AvatarRig rig_;
    Surfels surfels_;
    std::vector<std::string> notes_;
};

/// "open" (the open body), a body file (SMPL-X npz) or a template of any kind that readTemplate knows; files without
/// weights get those of the open body. Errors as the readers', with the path.
Result<std::unique_ptr<RestAvatar>> restAvatarFromFile(const std::string& source, const RestAvatarOptions& options = {},
                                                       const ProgressFunction& progress = {},
                                                       const ReadLimits& limits = defaultReadLimits());

} // namespace ars
