#pragma once

#include "engine/gl/presenter.h"
#include "engine/gl/surfel_discs.h"
#include "engine/scene/frame_worker.h"

#include <imgui.h>

#include <map>
#include <memory>
#include <optional>
#include <vector>

namespace ars::ui {

/// A picture with everything that decides how it looks. Pictures are held, so that an equal pointer is an equal
/// picture.
struct TileContent {
    std::shared_ptr<const Image> picture;
    std::shared_ptr<const Image> opacity;                 ///< null: opaque everywhere
    std::shared_ptr<const Image> depth;                   ///< hides overlays; may be null
    std::shared_ptr<const Image> parts;                   ///< laid over it; may be null
    std::shared_ptr<const Surfels> discs;                 ///< drawn instead of the picture; may be null
    std::shared_ptr<const std::vector<OverlayLine>> mask; ///< dots of what is to be marked; may be null
    std::shared_ptr<const Environment> environment;       ///< of the backdrop; may be null
    glm::vec4 maskColor{0.0f};
    float partsStrength = 0.4f;
    PresentSettings settings;
    Camera camera; ///< of the picture
    std::vector<OverlayLine> lines;
    bool thumbnail = false; ///< a sparser copy of the picture will do
};

/// Draws pictures into textures that Dear ImGui shows, each only when something about it changed: a window frame in
/// which nothing moves costs no drawing here. Everything on the thread of the OpenGL context.
class Painter {
public:
    Painter();
    ~Painter();

    /// What prevents drawing (no shader folder, no OpenGL 4.5); nothing when all is well.
    const std::optional<Error>& failure() const { return failure_; }

    /// Texture of a tile with `width` x `height` pixels; null texture where it cannot be drawn. Tiles are known by
    /// number; those not asked for over some frames are forgotten.
    ImTextureRef paint(int tile, const TileContent& content, int width, int height);
    /// What the tile shows since it was painted last; null before.
    ImTextureRef last(int tile);
    /// The error between two tiles that were painted before, without overlays.
    ImTextureRef paintDifference(int tile, int first, int second, bool squared, float maximum, ColorMap map, int width,
                                 int height);
    /// Once per window frame.
    void newFrame();
    /// Draws all there is once, for nobody: drivers translate a shader when it is first drawn with, and the tone
    /// curve's table takes as long as some frames. `shaded` and `data`: settings of a picture of colours and of one of
    /// numbers.
    void warmUp(const PresentSettings& shaded, const PresentSettings& data);

    /// How much was really drawn in the last frame, for the performance panel and tests.
    struct Work {
        int tilesDrawn = 0;
        int uploads = 0;
        double milliseconds = 0.0; ///< of this thread
    };
    const Work& work() const { return work_; }

private:
    struct Tile;
    Tile& tileOf(int number, int width, int height);
    Status upload(Tile& tile, const TileContent& content, int width, int height);
    Status draw(Tile& tile, const TileContent& content, int width, int height);
    void bringEnvironment(const TileContent& content);

    std::optional<Error> failure_;
    std::unique_ptr<Presenter> presenter_;
    std::unique_ptr<SurfelDiscs> discs_;
    std::shared_ptr<const Surfels> discsIn_;
    std::shared_ptr<const Environment> environmentIn_;
    std::map<int, std::unique_ptr<Tile>> tiles_;
    std::uint64_t frame_ = 0;
    Work work_, running_;
};

/// Every k-th pixel of a picture (the mean of four around it), so that its sides are not below the wanted ones.
Image sparserPicture(const Image& picture, int width, int height);

} // namespace ars::ui
