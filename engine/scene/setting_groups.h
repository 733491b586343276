#pragma once

#include "engine/core/parameters.h"
#include "engine/scene/document.h"
#include "engine/shade/shading.h"

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace ars {

/// Rows of the shading parameters.
const ParameterTable<ShadingParams>& shadingParameters();

/// One table of parameters inside the document, as settings.set reaches it.
struct SettingGroup {
    std::string name;  ///< "sky"
    std::string label; ///< "Sky"
    std::vector<ParameterInfo> infos;
    std::function<std::vector<ParameterValue>(const Document&)> values; ///< one for each of `infos`
    /// Sets one row and checks the whole struct. Errors as ParameterTable::set, with the rule that does not hold.
    std::function<Status(Document&, std::string_view name, ParameterValue value)> set;
};

/// rest, splat, posing, occlusion, mesh_rays, rasterised, baked, shading, tone, sky, studio.
const std::vector<SettingGroup>& settingGroups();
/// Null when there is none of this name.
const SettingGroup* findSettingGroup(std::string_view name);

} // namespace ars
