#include "ui/look/light_rows.h"

#include "engine/io/image.h"
#include "engine/light/studio.h"
#include "ui/look/light_map.h"
#include "ui/studio.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace ars::ui {

namespace {

void setSky(StudioContext& context, const char* name, double value) {
    runFromWidget(context, "settings.set", {{"group", "sky"}, {"name", name}, {"value", value}});
}

void setSun(StudioContext& context, const SunPosition& sun) {
    const auto rounded = [](double degrees) { return std::round(degrees * 100.0) / 100.0; };
    setSky(context, "sun_elevation", rounded(sun.elevationDeg));
    setSky(context, "sun_azimuth", rounded(wrappedDegrees(sun.azimuthDeg)));
}

std::string clockText(double hours) {
    const int minutes = static_cast<int>(std::lround(hours * 60.0)) % (24 * 60);
    return fmt::format("{:02d}:{:02d}", minutes / 60, minutes % 60);
}

std::string dayText(int day) {
    constexpr std::array<int, 12> lengths{31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
    constexpr std::array<const char*, 12> names{"January", "February", "March",     "April",   "May",      "June",
                                                "July",    "August",   "September", "October", "November", "December"};
    std::size_t month = 0;
    while (month < 11 && day > lengths[month]) day -= lengths[month++];
    return fmt::format("{} {}", day, names[month]);
}

/// Ranges in which a slider is a joy; values beyond them get the table's whole range.
ParameterInfo comfortable(ParameterInfo info, const ParameterValue& value) {
    static const std::map<std::string, ParameterRange> ranges{
        {"azimuth", {-180, 180}}, {"distance", {0.3, 8}}, {"width", {0.05, 4}},
        {"height", {0.05, 4}},    {"intensity", {0, 5}},  {"temperature", {2000, 12000}},
    };
    const auto found = ranges.find(info.name);
    const double* number = std::get_if<double>(&value);
    if (found != ranges.end() && number && *number >= found->second.minimum && *number <= found->second.maximum) {
        info.range = found->second;
    }
    return info;
}

ImVec4 lampColor(const StudioLamp& lamp) {
    const glm::dvec3 color =
        blackBodyColor(lamp.temperatureK) * glm::dvec3(lamp.tintRed, lamp.tintGreen, lamp.tintBlue);
    const double peak = std::max({color.x, color.y, color.z, 1e-6});
    const auto encoded = [&](double linear) { return linearToSrgb(static_cast<float>(linear / peak)); };
    return {encoded(color.x), encoded(color.y), encoded(color.z), 1.0f};
}

void lampList(StudioContext& context, int& selected) {
    const std::vector<StudioLamp> lamps = context.document().light.studio.lamps;
    selected = std::clamp(selected, 0, std::max(0, static_cast<int>(lamps.size()) - 1));
    const float swatch = ImGui::GetTextLineHeight();
    for (int i = 0; i < static_cast<int>(lamps.size()); ++i) {
        const StudioLamp& lamp = lamps[static_cast<std::size_t>(i)];
        ImGui::PushID(i);
        const ImVec2 corner = ImGui::GetCursorScreenPos();
        const float indent = swatch + ImGui::GetStyle().ItemInnerSpacing.x;
        ImGui::SetNextItemAllowOverlap();
        ImGui::SetCursorPosX(ImGui::GetCursorPosX() + indent);
        const std::string values =
            fmt::format("{:.0f}°, {:.0f}°, {:.1f} m", lamp.azimuthDeg, lamp.elevationDeg, lamp.distanceM);
        const float valuesWidth = ImGui::CalcTextSize(values.c_str()).x;
        const float room = ImGui::GetContentRegionAvail().x;
        const std::string name = fitted(lamp.name, room - valuesWidth - 2.0f * ImGui::GetStyle().ItemSpacing.x, false);
        if (ImGui::Selectable(fmt::format("{}###Lamp", name).c_str(), i == selected)) selected = i;
        help(context, "Select the lamp to see its settings; drag it in the panorama above.");
        ImDrawList* draw = ImGui::GetWindowDrawList();
        draw->AddCircleFilled(ImVec2(corner.x + 0.5f * swatch, corner.y + 0.5f * swatch), 0.36f * swatch,
                              ImGui::GetColorU32(lampColor(lamp)));
        draw->AddText(ImVec2(corner.x + indent + room - valuesWidth, corner.y), ImGui::GetColorU32(mutedColor()),
                      values.c_str());
        ImGui::PopID();
    }
    if (lamps.empty()) hint("No lamps: the body stands in the light of the room alone.");
    if (iconButton(icon::kAdd, "Add lamp")) {
        runFromWidget(context, "light.add_lamp", Arguments::object());
        selected = static_cast<int>(context.document().light.studio.lamps.size()) - 1;
    }
    help(context, "A new soft box in front of the body.");
    sameLineIfFits(buttonWidth("Remove lamp") + swatch);
    ImGui::BeginDisabled(lamps.empty());
    if (iconButton(icon::kDelete, "Remove lamp")) runFromWidget(context, "light.remove_lamp", {{"index", selected}});
    ImGui::EndDisabled();
    help(context, "Takes the selected lamp away.");
}

void lampRow(StudioContext& context, int index, const ParameterInfo& info, ParameterValue value) {
    if (!parameterRow(context, comfortable(info, value), value)) return;
    runFromWidget(context, "light.lamp", {{"index", index}, {"name", info.name}, {"value", argumentOf(value)}});
}

void lampRows(StudioContext& context, int index) {
    const auto& lamps = context.document().light.studio.lamps;
    if (index < 0 || index >= static_cast<int>(lamps.size())) return;
    const StudioLamp lamp = lamps[static_cast<std::size_t>(index)];
    const auto& table = studioLampParameters();
    ImGui::PushID("lamp");
    for (const ParameterInfo& info : table.infos()) {
        if (info.tier == ParameterTier::Basic) lampRow(context, index, info, table.get(lamp, info.name).value());
    }
    if (ImGui::TreeNodeEx("More", ImGuiTreeNodeFlags_SpanAvailWidth)) {
        for (const ParameterInfo& info : table.infos()) {
            if (info.tier != ParameterTier::Basic) lampRow(context, index, info, table.get(lamp, info.name).value());
        }
        ImGui::TreePop();
    }
    ImGui::PopID();
}

} // namespace

void skyRows(StudioContext& context, SunPlace& place) {
    const SkyParams& sky = context.document().light.sky;
    const SunHour now = nearestSunHour(place, {sky.sunElevationDeg, sky.sunAzimuthDeg});
    double hours = now.hours;
    rowLabel("Time of day", "Solar time: at 12:00 the sun stands highest.");
    const double dayStart = 0.0, dayEnd = 23.98;
    const std::string format = (now.errorDeg > 2.0 ? "about " : "") + clockText(hours);
    if (ImGui::SliderScalar("###Time of day", ImGuiDataType_Double, &hours, &dayStart, &dayEnd, format.c_str(),
                            ImGuiSliderFlags_AlwaysClamp | ImGuiSliderFlags_NoInput)) {
        setSun(context, sunPosition(place.latitudeDeg, place.dayOfYear, hours));
    }
    help(context, "Moves the sun along its way on this day. \"about\" stands where the sun was put where it never is.");
    int day = place.dayOfYear;
    rowLabel("Day", "Day of the year: decides how high the sun climbs.");
    if (ImGui::SliderInt("###Day", &day, 1, 366, dayText(day).c_str(),
                         ImGuiSliderFlags_AlwaysClamp | ImGuiSliderFlags_NoInput)) {
        place.dayOfYear = day;
        setSun(context, sunPosition(place.latitudeDeg, place.dayOfYear, now.hours));
    }
    help(context, "Moves the sun to where it stands at this time on another day.");
    auto latitude = static_cast<float>(place.latitudeDeg);
    rowLabel("Latitude", "Where on earth, degrees north.");
    if (ImGui::SliderFloat("###Latitude", &latitude, -90.0f, 90.0f, "%.0f°", ImGuiSliderFlags_AlwaysClamp)) {
        place.latitudeDeg = static_cast<double>(latitude);
        setSun(context, sunPosition(place.latitudeDeg, place.dayOfYear, now.hours));
    }
    help(context, "Where on earth the sun is seen from: 0 the equator, 90 the north pole.");
    parameterRows(context, "sky", skyParameters(), context.document().light.sky);
}

void studioRows(StudioContext& context, int& lamp) {
    lampList(context, lamp);
    lampRows(context, lamp);
    if (ImGui::TreeNodeEx("Room", ImGuiTreeNodeFlags_SpanAvailWidth)) {
        parameterRows(context, "studio", studioParameters(), context.document().light.studio);
        ImGui::TreePop();
    }
}

} // namespace ars::ui
