#pragma once

#include "engine/core/camera.h"
#include "engine/core/image_view.h"
#include "engine/frame/buffer_catalogue.h"
#include "engine/gl/shader.h"
#include "engine/gl/texture.h"
#include "engine/light/environment.h"
#include "engine/rig/pose.h"
#include "engine/shade/tone.h"

#include <memory>
#include <span>
#include <vector>

namespace ars {

enum class Backdrop { Color, Checkerboard, Environment };

/// How a buffer is shown.
struct PresentSettings {
    BufferId buffer = BufferId::Beauty;
    float minimum = 0.0f; ///< range of scalars and places, in the buffer's unit
    float maximum = 1.0f;
    ColorMap colorMap = ColorMap::Gray;
    ToneParams tone; ///< exposure and curve of light, and the background colour (display-linear)
    Backdrop backdrop = Backdrop::Color;
    EnvironmentPlacement placement; ///< of the environment behind the avatar
    float backdropBlur = 0.0f;      ///< 0 sharp ... 1 the whole sphere's average
    bool smooth = true;             ///< interpolate between pixels where the picture is enlarged
    bool grid = false;              ///< floor grid
    glm::vec3 gridColor{0.55f, 0.56f, 0.58f};
};

/// The range, colour map and background that the catalogue proposes.
PresentSettings defaultPresentSettings(BufferId buffer);

/// A straight line in the world that is drawn over the picture.
struct OverlayLine {
    glm::vec3 begin; ///< world, metres
    glm::vec3 end;
    glm::vec4 color; ///< sRGB-encoded, straight alpha
    float widthPixels = 2.0f;
};

/// Bones of a posed skeleton as lines, and a dot for every joint; face and finger joints get thinner ones.
std::vector<OverlayLine> skeletonLines(const Skeleton& skeleton, std::span<const glm::mat4> jointWorld,
                                       const glm::vec4& color);

/// Stage 8: draws a buffer with its colour map, background and overlays into whatever frame buffer is bound. All calls
/// need the context current in which it was made. Tone curves and colour maps are tables filled by the engine's own
/// functions, so that a window shows what files hold (within 3/255).
class Presenter {
public:
    static Result<std::unique_ptr<Presenter>> create();

    /// The picture to show, in host memory: the buffer, the opacity it was splatted with, and depth to hide overlays
    /// behind (may be empty). InvalidArgument when sizes differ.
    Status setPicture(ImageView<const float> picture, ImageView<const float> opacity, ImageView<const float> depth);
    void setEnvironment(const Environment& environment);

    /// Fills the viewport (x, y from the lower left, in pixels) with the picture. `camera` is the one of the picture;
    /// it is resized to the viewport for backdrop, grid and lines. InvalidArgument where no picture was set.
    Status draw(const PresentSettings& settings, const Camera& camera, std::span<const OverlayLine> lines, int x, int y,
                int width, int height);

private:
    Presenter(Shader present, Shader grid, Shader line);
    void updateTables(const PresentSettings& settings);
    void drawPicture(const PresentSettings& settings, const Camera& camera);
    void drawGrid(const PresentSettings& settings, const Camera& camera);
    void drawLines(std::span<const OverlayLine> lines, const Camera& camera);

    Shader present_, grid_, line_;
    Texture picture_, opacity_, depth_, environment_, colorMap_, srgbTable_, toneTable_;
    ColorMap colorMapIn_ = ColorMap::Gray;
    ToneCurve curveIn_ = ToneCurve::None;
    int pictureChannels_ = 0;
    struct VertexArray;
    std::shared_ptr<VertexArray> vertices_;
};

} // namespace ars
