#pragma once

#include "engine/scene/pose_library.h"
#include "ui/panel.h"
#include "ui/pose/joint_tree_view.h"
#include "ui/pose/thumbnails.h"

#include <imgui.h>

#include <memory>
#include <string>
#include <vector>

namespace ars::ui {

/// The pose library as a grid of pictures: a click takes the pose over, the user's own can be added and deleted.
class PoseGrid {
public:
    /// @param blend  how far a pose is taken over, [0, 1]
    void draw(StudioContext& context, const PoseReading& reading, float blend);

private:
    struct Item {
        PoseLibraryEntry entry;
        Pose pose;
        std::string key;     ///< of its thumbnail
        std::string problem; ///< why it cannot be read; empty: it was
    };
    void refresh(StudioContext& context, const PoseReading& reading);
    void drawItem(StudioContext& context, const Item& item, const ImVec2& size, float blend);
    void drawSave(StudioContext& context, const PoseReading& reading);
    void drawDeletion(StudioContext& context);

    std::vector<Item> items_;
    std::vector<std::string> names_; ///< joints that the poses were read for
    std::string source_;             ///< avatar of the thumbnails' keys
    bool stale_ = true;
    int lastFrame_ = -2; ///< of Dear ImGui, when it was drawn: files may have come while it was hidden
    std::unique_ptr<Thumbnails> thumbnails_;
    std::string newName_;
    std::string deleting_;
};

} // namespace ars::ui
