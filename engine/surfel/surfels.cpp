#include "engine/surfel/surfels.h"

#include <fmt/format.h>

namespace ars {

Status checkSurfels(const Surfels& surfels) {
    const std::size_t count = surfels.count();
    auto check = [&](std::string_view name, std::size_t found, std::size_t expected, bool optional) -> Status {
        if (found == expected || (optional && found == 0)) return {};
        return makeError(ErrorCode::InvalidArgument, "surfels",
                         fmt::format("{} has {} numbers, expected {} for {} surfels", name, found, expected, count));
    };
    ARS_TRY_STATUS(check("rotations", surfels.rotations.size(), 4 * count, false));
    ARS_TRY_STATUS(check("scales", surfels.scales.size(), count, false));
    ARS_TRY_STATUS(check("opacities", surfels.opacities.size(), count, false));
    ARS_TRY_STATUS(check("colors", surfels.colors.size(), count, true));
    ARS_TRY_STATUS(check("albedos", surfels.albedos.size(), count, true));
    ARS_TRY_STATUS(check("roughnesses", surfels.roughnesses.size(), count, true));
    ARS_TRY_STATUS(check("radii", surfels.radii.size(), count, true));
    ARS_TRY_STATUS(check("radiiPlus", surfels.radiiPlus.size(), count, true));
    ARS_TRY_STATUS(check("radiiMinus", surfels.radiiMinus.size(), count, true));
    ARS_TRY_STATUS(check("importances", surfels.importances.size(), count, true));
    return check("bones", surfels.bones.size(), count, true);
}

SurfelView viewOf(const Surfels& surfels) {
    // An empty vector's data() may be non-null after a clear; absence is told by size.
    auto pointer = [](const auto& values) { return values.empty() ? nullptr : values.data(); };
    SurfelView view;
    view.count = surfels.count();
    view.means = pointer(surfels.means);
    view.rotations = pointer(surfels.rotations);
    view.scales = pointer(surfels.scales);
    view.opacities = pointer(surfels.opacities);
    view.colors = pointer(surfels.colors);
    view.albedos = pointer(surfels.albedos);
    view.roughnesses = pointer(surfels.roughnesses);
    view.radii = pointer(surfels.radii);
    view.radiiPlus = pointer(surfels.radiiPlus);
    view.radiiMinus = pointer(surfels.radiiMinus);
    view.importances = pointer(surfels.importances);
    view.bones = pointer(surfels.bones);
    return view;
}

} // namespace ars
