#pragma once

#include "engine/scene/document.h"

#include <imgui.h>

#include <vector>

namespace ars::ui {

/// A rectangle of the screen, whole pixels.
struct PictureArea {
    ImVec2 origin;
    ImVec2 size;
};

struct ThumbnailArea {
    BufferId buffer = BufferId::Beauty;
    PictureArea area;
};

/// Where pictures lie in the viewport.
struct ViewportLayout {
    PictureArea region;                    ///< all of it
    PictureArea main;                      ///< of Grid: the tile whose size frames have
    PictureArea other;                     ///< of SideBySide; empty otherwise
    std::vector<ThumbnailArea> thumbnails; ///< of Strip and Grid
};

/// Divides the viewport. @param scale  pixels per design pixel
ViewportLayout arrange(const ViewSection& view, const PictureArea& region, float scale);

} // namespace ars::ui
