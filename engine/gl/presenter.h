#pragma once

#include "engine/core/camera.h"
#include "engine/core/image_view.h"
#include "engine/frame/buffer_catalogue.h"
#include "engine/gl/shader.h"
#include "engine/gl/texture.h"
#include "engine/light/environment.h"
#include "engine/rig/pose.h"
#include "engine/shade/tone.h"

#include <map>
#include <memory>
#include <span>
#include <string>
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

/// A picture brought into textures, ready to be shown in any way.
class ShownPicture {
public:
    /// The picture in host memory: the buffer (1, 3 or 4 channels), the opacity it was splatted with (empty: opaque
    /// everywhere), and depth to hide overlays behind (may be empty). InvalidArgument when sizes differ.
    Status set(ImageView<const float> picture, ImageView<const float> opacity, ImageView<const float> depth);
    bool empty() const { return picture_.empty(); }
    int width() const { return picture_.width(); }
    int height() const { return picture_.height(); }

private:
    friend class Presenter;
    Texture picture_, opacity_, depth_;
    int channels_ = 0;
    /// Where opacity exceeds 0, with a margin for interpolation, as shares of the sides: nothing else is drawn.
    glm::vec2 low_{0.0f}, high_{1.0f};
};

/// Stage 8: draws a buffer with its colour map, background and overlays into whatever frame buffer is bound. All calls
/// need the context current in which it was made. Tone curves and colour maps are tables filled by the engine's own
/// functions, so that a window shows what files hold (within 3/255).
class Presenter {
public:
    static Result<std::unique_ptr<Presenter>> create();

    /// The picture that draw() without one shows; see ShownPicture::set.
    Status setPicture(ImageView<const float> picture, ImageView<const float> opacity, ImageView<const float> depth) {
        return own_.set(picture, opacity, depth);
    }
    void setEnvironment(const Environment& environment);

    /// Fills the viewport (x, y from the lower left, in pixels) with the picture. `camera` is the one of the picture;
    /// it is resized to the viewport for backdrop, grid and lines. InvalidArgument where no picture was set.
    Status draw(const PresentSettings& settings, const Camera& camera, std::span<const OverlayLine> lines, int x, int y,
                int width, int height) {
        return draw(own_, settings, camera, lines, x, y, width, height);
    }
    Status draw(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                std::span<const OverlayLine> lines, int x, int y, int width, int height);
    /// The background alone, without grid.
    Status drawBackground(const PresentSettings& settings, const Camera& camera, int x, int y, int width, int height);
    /// Grid and lines over what is drawn already; `picture` hides them with its depth.
    void drawOverlays(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                      std::span<const OverlayLine> lines, int x, int y, int width, int height);
    /// Lays a picture of sRGB colours over what is drawn, as strongly as it is opaque times `strength`.
    Status tint(const ShownPicture& picture, float strength, int x, int y, int width, int height);
    /// Makes the bound target black with white dots and lines where nothing of `picture` lies more than `biasM` before
    /// them; they do not add up where they overlap.
    void drawMask(const ShownPicture& picture, const Camera& camera, std::span<const OverlayLine> lines, float biasM,
                  int width, int height);
    /// Lays a colour (sRGB-encoded, straight alpha) over what is drawn where a mask of drawMask is white and `picture`
    /// is opaque.
    Status tintMask(const ShownPicture& picture, const RenderTarget& mask, const glm::vec4& color, int x, int y,
                    int width, int height);
    /// The mean over channels of |a - b| or (a - b)^2 of two targets of any size, `maximum` having the last colour.
    Status drawDifference(const RenderTarget& first, const RenderTarget& second, bool squared, float maximum,
                          ColorMap map, int x, int y, int width, int height);

private:
    explicit Presenter(Shader grid, Shader line);
    /// The shader of one kind of picture over one kind of background, compiled when it is first needed.
    Result<const Shader*> shader(const std::string& fragment, const std::string& definitions);
    Result<const Shader*> presentShader(int kind, bool premultiplied, const PresentSettings& settings);
    void updateTables(const PresentSettings& settings);
    void setColorMap(ColorMap map);
    void prepare(const Shader& shader, const PresentSettings& settings, const Camera& camera) const;
    Status fillBackground(const PresentSettings& settings, const Camera& camera, const glm::ivec4& area,
                          const glm::ivec4& hole);
    Status drawPicture(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                       const glm::ivec4& area);
    void drawGrid(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                  const glm::ivec4& area);
    void drawLines(const ShownPicture& picture, std::span<const OverlayLine> lines, const Camera& camera, float behind,
                   float biasM, bool premultiplied);

    Shader grid_, line_;
    std::map<std::string, Shader> shaders_; ///< by file and definitions
    ShownPicture own_;
    Texture nothing_, opaque_, environment_, colorMap_, srgbTable_, toneTable_;
    ColorMap colorMapIn_ = ColorMap::Gray;
    ToneCurve curveIn_ = ToneCurve::None;
    struct VertexArray;
    std::shared_ptr<VertexArray> vertices_;
};

} // namespace ars
