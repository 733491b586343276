#include "ui/look/light_map.h"

#include "engine/scene/evaluate.h"
#include "ui/look/lat_long_picture.h"
#include "ui/look/picture_cache.h"
#include "ui/studio.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr int kPreviewWidth = 512;
constexpr double kNotchPauseS = 0.7; ///< between turns of the wheel that are one edit

LightAngles anglesOf(const glm::dvec3& direction) {
    return {std::atan2(direction.x, direction.z) * kDegrees,
            std::asin(std::clamp(direction.y / glm::length(direction), -1.0, 1.0)) * kDegrees};
}

double rounded(double degrees) { return std::round(degrees * 10.0) / 10.0; }

ImU32 shade(float brightness, float alpha) {
    return ImGui::GetColorU32(ImVec4(brightness, brightness, brightness, alpha));
}

void shadowedText(ImDrawList* draw, ImVec2 place, const char* text, float alpha) {
    draw->AddText(ImVec2(place.x + 1.0f, place.y + 1.0f), shade(0.0f, 0.7f * alpha), text);
    draw->AddText(place, shade(1.0f, alpha), text);
}

} // namespace

double wrappedDegrees(double degrees) { return degrees - 360.0 * std::floor((degrees + 180.0) / 360.0); }

glm::dvec2 mapPlace(const LightAngles& angles) {
    const double u = 0.5 - angles.azimuthDeg / 360.0;
    return {u - std::floor(u), 0.5 - angles.elevationDeg / 180.0};
}

LightAngles mapAngles(const glm::dvec2& place) {
    return {wrappedDegrees((0.5 - place.x) * 360.0), std::clamp((0.5 - place.y) * 180.0, -90.0, 90.0)};
}

std::vector<LightAngles> lampOutline(const StudioLamp& lamp) {
    const double azimuth = lamp.azimuthDeg / kDegrees, elevation = lamp.elevationDeg / kDegrees;
    const double roll = lamp.rollDeg / kDegrees;
    const glm::dvec3 towards(std::cos(elevation) * std::sin(azimuth), std::sin(elevation),
                             std::cos(elevation) * std::cos(azimuth));
    const glm::dvec3 level(std::cos(azimuth), 0.0, -std::sin(azimuth));
    const glm::dvec3 right = std::cos(roll) * level + std::sin(roll) * glm::cross(towards, level);
    const glm::dvec3 up = glm::cross(towards, right);
    std::vector<LightAngles> outline;
    constexpr int kPoints = 48;
    for (int i = 0; i <= kPoints; ++i) {
        const double angle = 2.0 * 3.14159265358979323846 * i / kPoints;
        double x = std::cos(angle), y = std::sin(angle);
        if (lamp.shape == LampShape::Rectangle) {
            const double reach = std::max(std::fabs(x), std::fabs(y));
            x /= reach;
            y /= reach;
        }
        outline.push_back(anglesOf(towards * static_cast<double>(lamp.distanceM) +
                                   right * (0.5 * x * static_cast<double>(lamp.widthM)) +
                                   up * (0.5 * y * static_cast<double>(lamp.heightM))));
    }
    return outline;
}

void LightMap::draw(StudioContext& context, int& lamp) {
    const EnvironmentPlacement placement = placementAt(context.document(), context.session.timeS());
    const float width = std::floor(ImGui::GetContentRegionAvail().x);
    // In a wide panel the picture would push everything else out of sight.
    const float height = std::floor(std::min(0.5f * width, 230.0f * context.scale));
    const Rectangle area{ImGui::GetCursorScreenPos(), ImVec2(width, height)};
    follow(context.session);
    upload(placement.scale > 0.0f ? std::log2(placement.scale) : -16.0f);

    ImGui::SetNextItemAllowOverlap();
    ImGui::InvisibleButton("Environment", area.size);
    dragLight(context, area, placement.rotationDeg);
    help(context, "The light around the body as a panorama. Drag it to turn the light; drag the sun or a lamp to move "
                  "it; the wheel over a lamp changes its distance. The camera stands where its sign is.");
    ImDrawList* drawList = ImGui::GetWindowDrawList();
    const ImVec2 end(area.corner.x + area.size.x, area.corner.y + area.size.y);
    drawList->PushClipRect(area.corner, end, true);
    drawPicture(context, area, placement.rotationDeg);
    drawCompass(context, area);
    drawCamera(context, area);
    const LightSection& light = context.document().light;
    if (light.kind == LightKind::Sky) dragSun(context, area, placement.rotationDeg);
    if (light.kind == LightKind::Studio) {
        // A copy: a drag changes the document that is walked through.
        const int count = static_cast<int>(light.studio.lamps.size());
        for (int i = 0; i < count; ++i) dragLamp(context, area, placement.rotationDeg, i, lamp);
    }
    drawList->PopClipRect();
    drawList->AddRect(area.corner, end, ImGui::GetColorU32(ImGuiCol_Border), 2.0f * context.scale);
    ImGui::SetCursorScreenPos(ImVec2(area.corner.x, end.y + ImGui::GetStyle().ItemSpacing.y));
    ImGui::Dummy(ImVec2(0.0f, 0.0f));
}

void LightMap::follow(Session& session) {
    const std::shared_ptr<const LightAsset> light = session.assets().light;
    // A draft of a light is followed by the exact one under the same key: the pictures themselves are compared.
    if (!light || !light->source || light->source == picture_->shown || picture_->wanted) return;
    picture_->wanted = light->source;
    const auto made = std::make_shared<Image>();
    session.start(
        "Preview of the light",
        [made, source = light->source](const ProgressFunction&) -> Status {
            *made = smallLatLong(source->environment.picture, kPreviewWidth);
            return {};
        },
        [made, into = std::weak_ptr<Picture>(picture_)](const Status&) {
            const std::shared_ptr<Picture> picture = into.lock();
            if (!picture) return;
            picture->shown = std::move(picture->wanted);
            picture->wanted.reset();
            picture->image = std::move(*made);
            picture->exposureEv = previewExposure(picture->image);
            ++picture->version;
        },
        true);
}

void LightMap::upload(float exposureEv) {
    if (picture_->version == 0) return;
    const float exposure = picture_->exposureEv + exposureEv;
    if (shownVersion_ == picture_->version && std::fabs(exposure - shownExposure_) < 1e-3f) return;
    const Image display = displayLatLong(picture_->image, exposure);
    if (display.pixels.empty()) return;
    texture_.upload({display.pixels.data(), display.width, display.height, display.channels}, true);
    shownVersion_ = picture_->version;
    shownExposure_ = exposure;
}

void LightMap::drawPicture(const StudioContext& context, const Rectangle& area, float rotationDeg) const {
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const ImVec2 end(area.corner.x + area.size.x, area.corner.y + area.size.y);
    draw->AddRectFilled(area.corner, end, ImGui::GetColorU32(ImGuiCol_FrameBg));
    if (texture_.empty()) {
        const char* text = "Preparing the light...";
        const ImVec2 size = ImGui::CalcTextSize(text);
        draw->AddText(
            ImVec2(area.corner.x + 0.5f * (area.size.x - size.x), area.corner.y + 0.5f * (area.size.y - size.y)),
            ImGui::GetColorU32(mutedColor()), text);
        return;
    }
    // Place u of the world shows place u + rotation of the environment: two pieces, as the texture does not wrap.
    const double shift = rotationDeg / 360.0 - std::floor(rotationDeg / 360.0);
    const float seam = area.corner.x + static_cast<float>(1.0 - shift) * area.size.x;
    const auto from = static_cast<float>(shift);
    draw->AddImage(textureOf(texture_), area.corner, ImVec2(seam, end.y), ImVec2(from, 0), ImVec2(1, 1));
    draw->AddImage(textureOf(texture_), ImVec2(seam, area.corner.y), end, ImVec2(0, 0), ImVec2(from, 1));
    const float horizon = std::floor(area.corner.y + 0.5f * area.size.y);
    draw->AddLine(ImVec2(area.corner.x, horizon), ImVec2(end.x, horizon), shade(1.0f, 0.12f), context.scale);
}

void LightMap::drawCompass(const StudioContext& context, const Rectangle& area) const {
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const float bottom = area.corner.y + area.size.y;
    constexpr std::pair<float, const char*> kMarks[] = {{0.25f, "left"}, {0.5f, "front"}, {0.75f, "right"}};
    for (const auto& [u, text] : kMarks) {
        const float x = area.corner.x + u * area.size.x;
        draw->AddLine(ImVec2(x, bottom - 4.0f * context.scale), ImVec2(x, bottom), shade(1.0f, 0.8f), context.scale);
        const ImVec2 size = ImGui::CalcTextSize(text);
        shadowedText(draw, ImVec2(std::floor(x - 0.5f * size.x), bottom - size.y - 4.0f * context.scale), text, 0.8f);
    }
}

/// Where the viewer stands: light from there is frontal, light opposite to it is a rim.
void LightMap::drawCamera(StudioContext& context, const Rectangle& area) const {
    const SceneCamera camera = cameraAt(context.document(), context.session.timeS());
    const glm::dvec3 towards = camera.eye - camera.target;
    if (glm::length(towards) < 1e-6) return;
    const glm::dvec2 place = mapPlace(anglesOf(towards));
    const float x = area.corner.x + static_cast<float>(place.x) * area.size.x;
    const float y = area.corner.y + static_cast<float>(place.y) * area.size.y;
    ImDrawList* draw = ImGui::GetWindowDrawList();
    if (haveIcons()) {
        const ImVec2 size = ImGui::CalcTextSize(icon::kCamera);
        shadowedText(draw, ImVec2(std::floor(x - 0.5f * size.x), std::floor(y - 0.5f * size.y)), icon::kCamera, 0.9f);
        return;
    }
    const float arm = 5.0f * context.scale;
    for (const auto& [color, width] : {std::pair{shade(0.0f, 0.6f), 3.0f}, {shade(1.0f, 0.9f), 1.0f}}) {
        draw->AddLine(ImVec2(x - arm, y), ImVec2(x + arm, y), color, width * context.scale);
        draw->AddLine(ImVec2(x, y - arm), ImVec2(x, y + arm), color, width * context.scale);
    }
}

void LightMap::dragLight(StudioContext& context, const Rectangle& area, float rotationDeg) {
    if (ImGui::IsItemActivated()) grabbedRotation_ = rotationDeg;
    if (ImGui::IsItemHovered() || ImGui::IsItemActive()) ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeEW);
    if (!ImGui::IsItemActive()) return;
    const float moved = ImGui::GetMouseDragDelta(ImGuiMouseButton_Left, 1.0f).x;
    // Places grow to the right where azimuths fall.
    const double degrees = rounded(wrappedDegrees(grabbedRotation_ - 360.0 * moved / area.size.x));
    if (std::fabs(wrappedDegrees(degrees - rotationDeg)) < 0.05) return;
    runFromWidget(context, "light.rotate", {{"degrees", degrees}});
}

bool LightMap::handle(StudioContext& context, const Rectangle& area, const char* id, LightAngles& angles, ImU32 color,
                      bool selected, float radius) {
    const glm::dvec2 place = mapPlace(angles);
    const ImVec2 center(area.corner.x + static_cast<float>(place.x) * area.size.x,
                        area.corner.y + static_cast<float>(place.y) * area.size.y);
    const float grip = std::max(radius, 9.0f * context.scale);
    ImGui::SetCursorScreenPos(ImVec2(center.x - grip, center.y - grip));
    ImGui::SetNextItemAllowOverlap();
    ImGui::InvisibleButton(id, ImVec2(2.0f * grip, 2.0f * grip));
    const bool hovered = ImGui::IsItemHovered(), active = ImGui::IsItemActive();
    if (hovered || active) ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeAll);
    ImDrawList* draw = ImGui::GetWindowDrawList();
    draw->AddCircleFilled(center, radius, color);
    draw->AddCircle(center, radius, shade(0.0f, 0.8f), 0, 3.0f * context.scale);
    const ImU32 ring = selected || active ? ImGui::GetColorU32(accentColor()) : shade(1.0f, hovered ? 1.0f : 0.85f);
    draw->AddCircle(center, radius, ring, 0, (selected || hovered || active ? 2.0f : 1.5f) * context.scale);
    const ImVec2 mouse = ImGui::GetMousePos();
    if (ImGui::IsItemActivated()) grabOffset_ = ImVec2(center.x - mouse.x, center.y - mouse.y);
    if (!active || !ImGui::IsMouseDragging(ImGuiMouseButton_Left, 1.0f)) return false;
    const LightAngles target = mapAngles({(mouse.x + grabOffset_.x - area.corner.x) / area.size.x,
                                          (mouse.y + grabOffset_.y - area.corner.y) / area.size.y});
    angles = {rounded(target.azimuthDeg), rounded(target.elevationDeg)};
    return true;
}

void LightMap::dragSun(StudioContext& context, const Rectangle& area, float rotationDeg) {
    const SkyParams sky = context.document().light.sky;
    LightAngles angles{sky.sunAzimuthDeg + rotationDeg, sky.sunElevationDeg};
    const ImU32 color = ImGui::GetColorU32(ImVec4(1.0f, 0.86f, 0.45f, sky.sunElevationDeg > 0.0f ? 0.9f : 0.25f));
    const bool moved = handle(context, area, "Sun", angles, color, false, 6.0f * context.scale);
    if (moved) {
        const double azimuth = rounded(wrappedDegrees(angles.azimuthDeg - rotationDeg));
        const auto set = [&](const char* name, double value) {
            runFromWidget(context, "settings.set", {{"group", "sky"}, {"name", name}, {"value", value}});
        };
        if (std::fabs(angles.elevationDeg - sky.sunElevationDeg) > 0.04) set("sun_elevation", angles.elevationDeg);
        if (std::fabs(wrappedDegrees(azimuth - sky.sunAzimuthDeg)) > 0.04) set("sun_azimuth", azimuth);
    }
    help(context, fmt::format("Sun, {:.0f}° above the horizon, azimuth {:.0f}°. Drag it across the sky.",
                              sky.sunElevationDeg, sky.sunAzimuthDeg)
                      .c_str());
}

void LightMap::dragLamp(StudioContext& context, const Rectangle& area, float rotationDeg, int index, int& selected) {
    const auto& lamps = context.document().light.studio.lamps;
    if (index >= static_cast<int>(lamps.size())) return;
    const StudioLamp lamp = lamps[static_cast<std::size_t>(index)];
    const bool isSelected = index == selected;
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const ImU32 line = isSelected ? ImGui::GetColorU32(accentColor()) : shade(1.0f, 0.45f);
    ImVec2 last{};
    bool first = true;
    for (LightAngles point : lampOutline(lamp)) {
        point.azimuthDeg += rotationDeg;
        const glm::dvec2 place = mapPlace(point);
        const ImVec2 pixel(area.corner.x + static_cast<float>(place.x) * area.size.x,
                           area.corner.y + static_cast<float>(place.y) * area.size.y);
        // Not across the picture where the outline leaves on one side and comes back on the other.
        if (!first && std::fabs(pixel.x - last.x) < 0.5f * area.size.x) {
            draw->AddLine(last, pixel, line, (isSelected ? 1.5f : 1.0f) * context.scale);
        }
        last = pixel;
        first = false;
    }
    LightAngles angles{lamp.azimuthDeg + rotationDeg, lamp.elevationDeg};
    const glm::dvec3 tint = blackBodyColor(lamp.temperatureK) * glm::dvec3(lamp.tintRed, lamp.tintGreen, lamp.tintBlue);
    const double peak = std::max({tint.x, tint.y, tint.z, 1e-6});
    const auto encoded = [&](double linear) { return linearToSrgb(static_cast<float>(linear / peak)); };
    const ImU32 color = ImGui::GetColorU32(ImVec4(encoded(tint.x), encoded(tint.y), encoded(tint.z), 1.0f));
    const std::string id = fmt::format("Lamp {}", index);
    const bool moved = handle(context, area, id.c_str(), angles, color, isSelected, 5.0f * context.scale);
    if (ImGui::IsItemActivated()) selected = index;
    if (moved) {
        const double azimuth = rounded(wrappedDegrees(angles.azimuthDeg - rotationDeg));
        const auto set = [&](const char* name, double value) {
            runFromWidget(context, "light.lamp", {{"index", index}, {"name", name}, {"value", value}});
        };
        if (std::fabs(angles.elevationDeg - lamp.elevationDeg) > 0.04) set("elevation", angles.elevationDeg);
        if (std::fabs(wrappedDegrees(azimuth - lamp.azimuthDeg)) > 0.04) set("azimuth", azimuth);
    }
    help(context, fmt::format("{}, {:.2f} m away. Drag to move it around the body, turn the wheel for its distance.",
                              lamp.name, lamp.distanceM)
                      .c_str());
    wheelOverLamp(context, index);
}

void LightMap::wheelOverLamp(StudioContext& context, int index) {
    if (wheelTime_ >= 0.0 && ImGui::GetTime() - wheelTime_ > kNotchPauseS) {
        context.session.endGesture();
        wheelTime_ = -1.0;
    }
    if (!ImGui::IsItemHovered()) return;
    ImGui::SetItemKeyOwner(ImGuiKey_MouseWheelY);
    const float notches = ImGui::GetIO().MouseWheel;
    if (notches == 0.0f) return;
    const StudioLamp& lamp = context.document().light.studio.lamps[static_cast<std::size_t>(index)];
    const double distance = std::clamp(lamp.distanceM * std::pow(1.08, -notches), 0.1, 100.0);
    const Status status = context.session.run(
        "light.lamp", {{"index", index}, {"name", "distance"}, {"value", std::round(distance * 1000.0) / 1000.0}},
        fmt::format("lamp {} distance", index));
    if (!status) context.studio.toast(status.error().describe());
    keepInteracting(kNotchPauseS);
    wheelTime_ = ImGui::GetTime();
}

} // namespace ars::ui
