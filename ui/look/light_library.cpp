#include "ui/look/light_library.h"

#include "engine/core/file.h"
#include "engine/io/png.h"
#include "engine/light/environment.h"
#include "engine/light/sky.h"
#include "engine/light/studio.h"
#include "ui/look/lat_long_picture.h"
#include "ui/studio.h"
#include "ui/theme.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <set>
#include <system_error>

namespace ars::ui {

namespace fs = std::filesystem;

namespace {

constexpr int kCardPixels = 192;
constexpr float kCardDesignWidth = 92.0f;

Image thumbnailOf(const Environment& environment) {
    const Image small = smallLatLong(environment.picture, kCardPixels);
    return displayLatLong(small, previewExposure(small));
}

bool isLightFile(const fs::path& path) {
    std::string ending = path.extension().string();
    std::transform(ending.begin(), ending.end(), ending.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return ending == ".exr" || ending == ".hdr";
}

/// Where the thumbnail of a file is kept between runs: its name changes with the file.
fs::path storedThumbnail(const fs::path& file) {
    std::error_code failed;
    const auto size = fs::file_size(file, failed);
    const auto time = fs::last_write_time(file, failed).time_since_epoch().count();
    if (failed) return {};
    const std::size_t name = std::hash<std::string>{}(fmt::format("{} {} {}", file.string(), size, time));
    return stateFolder() / "thumbnails" / fmt::format("{:016x}.png", name);
}

Result<Image> fileThumbnail(const fs::path& file) {
    const fs::path stored = storedThumbnail(file);
    std::error_code ignored;
    if (!stored.empty() && fs::exists(stored, ignored)) {
        auto known = readPng(stored);
        if (known && known->image.channels >= 3) return std::move(known->image);
    }
    ARS_TRY(const Environment environment, readEnvironment(file));
    Image thumbnail = thumbnailOf(environment);
    // Only a convenience: where it cannot be kept, it is made again next time.
    if (!stored.empty() && !writePng(stored, thumbnail)) fs::remove(stored, ignored);
    return thumbnail;
}

bool sameSky(const SkyParams& sky, const SkyPreset& preset) {
    return std::fabs(sky.sunElevationDeg - preset.elevationDeg) < 0.05f &&
           std::fabs(sky.sunAzimuthDeg - preset.azimuthDeg) < 0.05f &&
           std::fabs(sky.turbidity - preset.turbidity) < 0.05f;
}

/// The room and lamps, whatever the size of the picture.
bool sameStudio(const StudioParams& studio, StudioPreset preset) {
    StudioParams expected = studioPreset(preset);
    expected.width = studio.width;
    return studio == expected;
}

} // namespace

std::span<const SkyPreset> skyPresets() {
    static constexpr std::array<SkyPreset, 5> presets{{{"Morning", 18.0f, 70.0f, 2.2f},
                                                       {"Noon", 62.0f, 20.0f, 2.5f},
                                                       {"Golden hour", 6.0f, -55.0f, 3.5f},
                                                       {"Dusk", -4.0f, -65.0f, 3.0f},
                                                       {"Hazy", 34.0f, 40.0f, 9.0f}}};
    return presets;
}

std::vector<fs::path> LightLibrary::lightFiles(const fs::path& folder, std::size_t most) {
    std::vector<fs::path> files;
    std::error_code failed;
    for (fs::directory_iterator entry(folder, fs::directory_options::skip_permission_denied, failed), end;
         !failed && entry != end && files.size() < most; entry.increment(failed)) {
        std::error_code ignored;
        if (entry->is_regular_file(ignored) && isLightFile(entry->path())) files.push_back(entry->path());
    }
    std::sort(files.begin(), files.end());
    return files;
}

void LightLibrary::draw(StudioContext& context) {
    const float gap = ImGui::GetStyle().ItemSpacing.x, available = ImGui::GetContentRegionAvail().x;
    const int columns =
        std::max(1, static_cast<int>((available + gap) / (kCardDesignWidth * context.scale + gap) + 0.25f));
    cardWidth_ = std::floor((available - gap * static_cast<float>(columns - 1)) / static_cast<float>(columns));
    drawStudios(context);
    drawSkies(context);
    drawLearned(context);
    drawFiles(context);
}

void LightLibrary::drawStudios(StudioContext& context) {
    hint("Studios");
    const LightSection& light = context.document().light;
    const auto& words = EnumWords<StudioPreset>::words;
    for (std::size_t i = 0; i < words.size(); ++i) {
        const auto preset = static_cast<StudioPreset>(i);
        const std::string name(words[i]);
        const auto thumbnail =
            thumbnails_.get(context.session, "studio:" + name, [preset](const ProgressFunction&) -> Result<Image> {
                StudioParams params = studioPreset(preset);
                params.width = 2 * kCardPixels;
                ARS_TRY(const Environment environment, generateStudio(params));
                return thumbnailOf(environment);
            });
        const bool current = light.kind == LightKind::Studio && sameStudio(light.studio, preset);
        if (i > 0) sameLineIfFits(cardWidth_);
        if (card(context, "studio:" + name, wordsOf(name), "Studio lamps: " + wordsOf(name), current, thumbnail)) {
            runFromWidget(context, "light.studio_preset", {{"name", name}});
        }
    }
}

void LightLibrary::drawSkies(StudioContext& context) {
    hint("Skies");
    const LightSection& light = context.document().light;
    bool first = true;
    for (const SkyPreset& preset : skyPresets()) {
        const auto thumbnail = thumbnails_.get(context.session, std::string("sky:") + preset.name,
                                               [preset](const ProgressFunction&) -> Result<Image> {
                                                   SkyParams params;
                                                   params.sunElevationDeg = preset.elevationDeg;
                                                   params.sunAzimuthDeg = preset.azimuthDeg;
                                                   params.turbidity = preset.turbidity;
                                                   params.width = 2 * kCardPixels;
                                                   ARS_TRY(const Sky sky, generateSky(params));
                                                   return thumbnailOf(sky.environment);
                                               });
        const bool current = light.kind == LightKind::Sky && sameSky(light.sky, preset);
        if (!first) sameLineIfFits(cardWidth_);
        first = false;
        const std::string tooltip =
            fmt::format("Sky: sun {:g}° above the horizon, haze {:g}", preset.elevationDeg, preset.turbidity);
        if (!card(context, std::string("sky:") + preset.name, preset.name, tooltip, current, thumbnail)) continue;
        const auto set = [](const char* name, float value) {
            return CommandCall{"settings.set", {{"group", "sky"}, {"name", name}, {"value", value}}};
        };
        const std::array<CommandCall, 4> calls{
            CommandCall{"light.kind", {{"kind", "sky"}}}, set("sun_elevation", preset.elevationDeg),
            set("sun_azimuth", preset.azimuthDeg), set("turbidity", preset.turbidity)};
        runTogether(context, "light.sky_preset", calls);
    }
}

/// The light that the avatar's training found.
void LightLibrary::drawLearned(StudioContext& context) {
    const std::shared_ptr<const AvatarAsset> avatar = context.session.assets().avatar;
    const std::string source = context.document().avatar.source;
    if (!avatar || !avatar->trained || !avatar->trained->hasLight || avatar->key != source) return;
    const LightSection& light = context.document().light;
    // A run's newest checkpoint has a light of its own: its step is in the avatar's origin.
    const auto thumbnail = thumbnails_.get(context.session, "learned:" + source + avatar->trained->origin,
                                           [source](const ProgressFunction&) -> Result<Image> {
                                               ARS_TRY(const Environment environment, trainedAvatarLight(source));
                                               return thumbnailOf(environment);
                                           });
    hint("Learned");
    const std::string name = fs::path(source).stem().string();
    const bool current = light.kind == LightKind::File && light.file == source;
    if (card(context, "learned", "Learned light of " + name, "The light that the training of " + name + " found",
             current, thumbnail)) {
        context.session.openAs(source, FileRole::Light);
    }
}

void LightLibrary::drawFiles(StudioContext& context) {
    const LightSection& light = context.document().light;
    std::vector<fs::path> files;
    std::set<fs::path> listed;
    const auto add = [&](const fs::path& path) {
        if (isLightFile(path) && listed.insert(path).second) files.push_back(path);
    };
    if (!light.file.empty()) {
        add(light.file);
        listFolder(context.session, fs::path(light.file).parent_path());
    }
    for (const fs::path& path : context.session.recentFiles().files()) add(path);
    for (const fs::path& path : folder_->files) add(path);
    hint("Files");
    if (files.empty()) {
        hint("Open an .exr or .hdr panorama, or drop one on the window: it and its neighbours appear here.");
        return;
    }
    bool first = true;
    for (const fs::path& path : files) {
        const auto thumbnail = thumbnails_.get(context.session, path.string(),
                                               [path](const ProgressFunction&) { return fileThumbnail(path); });
        const bool current = light.kind == LightKind::File && light.file == path.string();
        // A file that is no light after all (a picture of a person, a broken one) is not offered.
        if (!thumbnail.error.empty() && !current) continue;
        if (!first) sameLineIfFits(cardWidth_);
        first = false;
        if (card(context, "file:" + path.filename().string(), path.stem().string(), path.string(), current,
                 thumbnail)) {
            context.session.openAs(path, FileRole::Light);
        }
    }
}

bool LightLibrary::card(StudioContext& context, const std::string& id, const std::string& label,
                        const std::string& tooltip, bool current, const PictureCache::Shown& thumbnail) {
    const float height = std::floor(0.5f * cardWidth_), line = ImGui::GetTextLineHeight();
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    const bool clicked = ImGui::InvisibleButton(id.c_str(), ImVec2(cardWidth_, height + line + 2.0f * context.scale));
    const bool hovered = ImGui::IsItemHovered();
    help(context, thumbnail.error.empty() ? tooltip.c_str() : thumbnail.error.c_str());
    ImDrawList* draw = ImGui::GetWindowDrawList();
    const ImVec2 end(corner.x + cardWidth_, corner.y + height);
    const float round = 3.0f * context.scale;
    if (thumbnail.texture) {
        draw->AddImageRounded(textureOf(*thumbnail.texture), corner, end, ImVec2(0, 0), ImVec2(1, 1), IM_COL32_WHITE,
                              round);
    } else {
        draw->AddRectFilled(corner, end, ImGui::GetColorU32(ImGuiCol_FrameBg), round);
    }
    if (current || hovered) {
        ImVec4 color = accentColor();
        if (!current) color.w = 0.6f;
        draw->AddRect(corner, end, ImGui::GetColorU32(color), round, 0, (current ? 2.0f : 1.0f) * context.scale);
    }
    const std::string text = fitted(label, cardWidth_, true);
    const float x = corner.x + 0.5f * (cardWidth_ - ImGui::CalcTextSize(text.c_str()).x);
    draw->AddText(ImVec2(std::floor(x), end.y + 1.0f * context.scale),
                  ImGui::GetColorU32(current ? ImGui::GetStyleColorVec4(ImGuiCol_Text) : mutedColor()), text.c_str());
    return clicked;
}

void LightLibrary::listFolder(Session& session, const fs::path& folder) {
    if (folder == folder_->path) return;
    folder_->path = folder;
    const auto found = std::make_shared<std::vector<fs::path>>();
    session.start(
        "Lights of the folder",
        [found, folder](const ProgressFunction&) -> Status {
            *found = lightFiles(folder);
            return {};
        },
        [found, folder, into = std::weak_ptr<Folder>(folder_)](const Status&) {
            const std::shared_ptr<Folder> alive = into.lock();
            if (alive && alive->path == folder) alive->files = std::move(*found);
        },
        true);
}

} // namespace ars::ui
