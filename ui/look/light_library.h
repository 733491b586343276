#pragma once

#include "ui/look/controls.h"
#include "ui/look/picture_cache.h"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace ars::ui {

/// A sky that a click gives.
struct SkyPreset {
    const char* name;
    float elevationDeg, azimuthDeg, turbidity;
};
std::span<const SkyPreset> skyPresets();

/// The lights to choose from: built-in studios and skies, files opened lately, and the files beside the current one,
/// each with a thumbnail. A click swaps the light; the document holds which it is.
class LightLibrary {
public:
    void draw(StudioContext& context);

    /// The picture files of a folder that are lights by their ending (.exr, .hdr), sorted; at most `most`.
    static std::vector<std::filesystem::path> lightFiles(const std::filesystem::path& folder, std::size_t most = 200);

private:
    struct Folder {
        std::filesystem::path path;
        std::vector<std::filesystem::path> files;
    };

    void drawStudios(StudioContext& context);
    void drawSkies(StudioContext& context);
    void drawLearned(StudioContext& context);
    void drawFiles(StudioContext& context);
    /// A picture with its name below it; true when it was clicked.
    bool card(StudioContext& context, const std::string& id, const std::string& label, const std::string& tooltip,
              bool current, const PictureCache::Shown& thumbnail);
    void listFolder(Session& session, const std::filesystem::path& folder);

    PictureCache thumbnails_;
    float cardWidth_ = 0.0f;
    std::shared_ptr<Folder> folder_ = std::make_shared<Folder>(); ///< filled beside
};

} // namespace ars::ui
