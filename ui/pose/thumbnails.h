#pragma once

#include "engine/gl/texture.h"
#include "engine/scene/session.h"
#include "ui/pose/pose_pictures.h"

#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace ars::ui {

/// Small pictures of poses for the library: kept as PNG in a folder, made beside the window where they are missing.
/// Belongs to the thread with the OpenGL context.
class Thumbnails {
public:
    /// @param folder  stateFolder()/thumbnails
    explicit Thumbnails(std::filesystem::path folder);

    /// Makes sure that every wish is there or under way; takes over what has been finished. Never waits.
    void update(Session& session, const std::vector<ThumbnailWish>& wishes);
    /// Null while it is not there.
    const Texture* find(const std::string& key) const;
    bool busy() const;

private:
    struct Finished;
    void adopt();

    std::filesystem::path folder_;
    std::shared_ptr<Finished> finished_;
    std::map<std::string, Texture> textures_;
    std::set<std::string> asked_; ///< never asked for twice, so that a failure does not repeat
};

} // namespace ars::ui
