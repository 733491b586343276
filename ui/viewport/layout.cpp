#include "ui/viewport/layout.h"

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

constexpr float kGap = 2.0f;         ///< between pictures, design pixels
constexpr float kThumbnail = 108.0f; ///< shorter side of the strip, design pixels
constexpr float kAspect = 0.8f;      ///< width over height of a tile: a person stands upright

void arrangeStrip(ViewportLayout& layout, const std::vector<BufferId>& buffers, const PictureArea& region,
                  float scale) {
    const auto count = static_cast<float>(std::max<std::size_t>(buffers.size(), 1));
    const float gap = kGap * scale;
    const bool beside = region.size.x > 1.25f * region.size.y;
    // All of them are seen at once: the strip gets thinner rather than longer than the viewport.
    const float along = beside ? region.size.y : region.size.x;
    const float length = std::floor((along + gap) / count - gap);
    const float wanted = kThumbnail * scale;
    const float across = std::floor(std::min(wanted, beside ? length * 1.6f : length / kAspect));
    layout.main = region;
    (beside ? layout.main.size.x : layout.main.size.y) -= across + gap;
    for (std::size_t i = 0; i < buffers.size(); ++i) {
        const float at = static_cast<float>(i) * (length + gap);
        PictureArea area;
        area.origin = beside ? ImVec2(region.origin.x + region.size.x - across, region.origin.y + at)
                             : ImVec2(region.origin.x + at, region.origin.y + region.size.y - across);
        area.size = beside ? ImVec2(across, length) : ImVec2(length, across);
        layout.thumbnails.push_back({buffers[i], area});
    }
}

void arrangeGrid(ViewportLayout& layout, const std::vector<BufferId>& buffers, const PictureArea& region, float scale) {
    const int count = std::max(static_cast<int>(buffers.size()), 1);
    const float gap = kGap * scale;
    int best = 1;
    float largest = 0.0f;
    for (int columns = 1; columns <= count; ++columns) {
        const int rows = (count + columns - 1) / columns;
        const float width = (region.size.x + gap) / static_cast<float>(columns) - gap;
        const float height = (region.size.y + gap) / static_cast<float>(rows) - gap;
        const float body = std::min(width / kAspect, height); // how tall a person is in it
        if (body > largest) {
            largest = body;
            best = columns;
        }
    }
    const int rows = (count + best - 1) / best;
    const ImVec2 size(std::floor((region.size.x + gap) / static_cast<float>(best) - gap),
                      std::floor((region.size.y + gap) / static_cast<float>(rows) - gap));
    for (std::size_t i = 0; i < buffers.size(); ++i) {
        const int column = static_cast<int>(i) % best, row = static_cast<int>(i) / best;
        const ImVec2 origin(region.origin.x + static_cast<float>(column) * (size.x + gap),
                            region.origin.y + static_cast<float>(row) * (size.y + gap));
        layout.thumbnails.push_back({buffers[i], {origin, size}});
    }
    layout.main = {region.origin, size};
}

} // namespace

ViewportLayout arrange(const ViewSection& view, const PictureArea& region, float scale) {
    ViewportLayout layout;
    layout.region = layout.main = region;
    if (view.layout == ViewLayout::SideBySide) {
        const float gap = kGap * scale;
        layout.main.size.x = std::floor(0.5f * (region.size.x - gap));
        layout.other = layout.main;
        layout.other.origin.x = region.origin.x + region.size.x - layout.other.size.x;
    }
    if (view.layout == ViewLayout::Strip) arrangeStrip(layout, view.strip, region, scale);
    if (view.layout == ViewLayout::Grid) arrangeGrid(layout, view.strip, region, scale);
    return layout;
}

} // namespace ars::ui
