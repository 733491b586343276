#include "engine/scene/setting_groups.h"

#include "engine/core/parameter_ranges.h"

namespace ars {
namespace {

/// A group of the struct that `find` gives (of a const or a mutable document).
template <typename Struct, typename Find, typename Check>
SettingGroup group(std::string name, std::string label, const ParameterTable<Struct>& table, Find find, Check check) {
    SettingGroup result;
    result.name = name;
    result.label = std::move(label);
    result.infos = table.infos();
    result.values = [&table, find](const Document& document) {
        std::vector<ParameterValue> values;
        for (const ParameterInfo& info : table.infos()) values.push_back(table.get(find(document), info.name).value());
        return values;
    };
    result.set = [&table, find, check, name](Document& document, std::string_view row, ParameterValue value) -> Status {
        Struct changed = find(document);
        if (auto set = table.set(changed, row, std::move(value)); !set) return atPlace(std::move(set).error(), name);
        if (auto sound = check(changed); !sound) return atPlace(std::move(sound).error(), name);
        find(document) = changed;
        return {};
    };
    return result;
}

template <typename Struct, typename Find>
SettingGroup group(std::string name, std::string label, const ParameterTable<Struct>& table, Find find) {
    return group(std::move(name), std::move(label), table, find, [](const Struct&) { return Status(); });
}

std::vector<SettingGroup> allGroups() {
    return {
        group("rest", "Surfels of the rest pose", restAvatarParameters(),
              [](auto& d) -> auto& { return d.avatar.rest; }),
        group("splat", "Splatting", splatParameters(), [](auto& d) -> auto& { return d.occlusion.splat; }),
        group("posing", "Posing of surfels", poseSurfelsParameters(),
              [](auto& d) -> auto& { return d.occlusion.posing; }),
        group(
            "occlusion", "Screen-space occlusion", occlusionParameters(),
            [](auto& d) -> auto& { return d.occlusion.settings.screenSpace; }, validateOcclusionParams),
        group("mesh_rays", "Rays against the mesh", meshOcclusionParameters(),
              [](auto& d) -> auto& { return d.occlusion.settings.meshRays; }),
        group("rasterised", "Rasterised visibility", rasterisedVisibilityParameters(),
              [](auto& d) -> auto& { return d.occlusion.settings.rasterised; }),
        group("baked", "Baked visibility", bakedVisibilityParameters(),
              [](auto& d) -> auto& { return d.occlusion.settings.baked; }),
        group("shading", "Shading", shadingParameters(), [](auto& d) -> auto& { return d.occlusion.shading; }),
        group("tone", "Exposure and tone", toneParameters(), [](auto& d) -> auto& { return d.view.tone; }),
        group("sky", "Sky", skyParameters(), [](auto& d) -> auto& { return d.light.sky; }),
        group("studio", "Studio", studioParameters(), [](auto& d) -> auto& { return d.light.studio; }),
    };
}

} // namespace

const ParameterTable<ShadingParams>& shadingParameters() {
    using S = ShadingParams;
    using enum ParameterTier;
    static const ParameterTable<ShadingParams> table{
        {"occlude", &S::occlude, {}, "", Basic, "Darkens light by ambient occlusion [O]."},
        {"occlude_specular", &S::occludeSpecular, {}, "", Basic, "Occlusion darkens reflections as well."},
        {"f0", &S::f0, {0, 1}, "", Advanced, "Reflectance of every surface when seen head-on [F0]."},
    };
    return table;
}

const std::vector<SettingGroup>& settingGroups() {
    static const std::vector<SettingGroup> groups = allGroups();
    return groups;
}

const SettingGroup* findSettingGroup(std::string_view name) {
    for (const SettingGroup& group : settingGroups()) {
        if (group.name == name) return &group;
    }
    return nullptr;
}

} // namespace ars
