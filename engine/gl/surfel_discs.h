#pragma once

#include "engine/core/camera.h"
#include "engine/gl/shader.h"
#include "engine/gl/texture.h"
#include "engine/surfel/surfels.h"

#include <glm/glm.hpp>

#include <cstddef>
#include <memory>

namespace ars {

/// How surfels look as discs.
struct DiscSettings {
    float reach = 1.4f;   ///< rim of a disc in standard deviations; 1.4 closes a surface as splatting shows it
    float ambient = 0.3f; ///< share of light that comes from everywhere, [0, 1]
    glm::vec3 lightView{-0.35f, -0.55f, -0.76f}; ///< towards the light, camera space
};

/// Posed surfels as opaque, lit, coloured discs with a depth test: what splatting works with, without its softness.
/// One-sided as there. All calls need the context current in which it was made.
class SurfelDiscs {
public:
    static Result<std::unique_ptr<SurfelDiscs>> create();
    ~SurfelDiscs();
    SurfelDiscs(const SurfelDiscs&) = delete;
    SurfelDiscs& operator=(const SurfelDiscs&) = delete;

    /// Brings them to the graphics card. Colours are the albedos, else the decoded radiance, else grey. InvalidArgument
    /// when array lengths differ.
    Status set(const Surfels& surfels);
    std::size_t count() const { return count_; }

    /// Draws into the bound target, which must have depth (RenderTarget::create); its depth is cleared, its colours are
    /// kept where no disc is. `camera` is resized to the viewport (x, y from the lower left).
    void draw(const Camera& camera, const DiscSettings& settings, int x, int y, int width, int height);

private:
    explicit SurfelDiscs(Shader shader);
    Shader shader_;
    unsigned array_ = 0;
    unsigned buffer_ = 0;
    std::size_t count_ = 0;
};

} // namespace ars
