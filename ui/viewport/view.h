#pragma once

#include "engine/core/camera.h"
#include "engine/scene/frame_worker.h"
#include "ui/panel.h"

#include <glm/glm.hpp>
#include <imgui.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace ars::ui {

/// Where a picture lies on the screen, and the camera that sees it there: world to screen and back.
struct PictureView {
    ImVec2 origin; ///< upper left corner, screen pixels
    ImVec2 size;
    Camera camera; ///< its picture has this size

    bool contains(const ImVec2& p) const {
        return p.x >= origin.x && p.y >= origin.y && p.x < origin.x + size.x && p.y < origin.y + size.y;
    }
    /// Nothing for points behind the eye.
    std::optional<ImVec2> toScreen(const glm::dvec3& world) const {
        const glm::dvec3 p = camera.toCamera(world);
        if (!(p.z > 1e-3)) return std::nullopt;
        const glm::dvec2 at = camera.project(p);
        return ImVec2(origin.x + static_cast<float>(at.x), origin.y + static_cast<float>(at.y));
    }
    double depthOf(const glm::dvec3& world) const { return camera.toCamera(world).z; }
    /// The point under a place of the screen at a depth (camera z).
    glm::dvec3 pointAt(const ImVec2& p, double depthM) const {
        return camera.toWorld(depthM * camera.ray(p.x - origin.x, p.y - origin.y));
    }
    /// Direction of the ray, unit length, world.
    glm::dvec3 rayTo(const ImVec2& p) const { return glm::normalize(pointAt(p, 1.0) - camera.centerWorld()); }
    /// Metres per pixel at a depth.
    double metresPerPixel(double depthM) const { return depthM / camera.fy; }
};

/// What every tool of the viewport gets in a window frame.
struct ViewportInput {
    StudioContext& context;
    const PictureView& view;
    std::shared_ptr<const Frame> frame; ///< what is shown; may be null
    ImVec2 mouse;
    bool hovered = false; ///< the mouse is over the picture and over nothing before it
    float scale = 1.0f;   ///< pixels per design pixel
};

/// The frame's pixel under the mouse; may lie outside of it.
glm::ivec2 framePixel(const ViewportInput& input);

/// A drag in the picture: the commands that it runs are one undo entry, and frames may be drafts until it ends.
class Gesture {
public:
    bool active() const { return active_; }
    void begin(Session& session, std::string_view name);
    /// Errors become a toast, once per gesture.
    void run(StudioContext& context, std::string_view command, const Arguments& arguments);
    void end(Session& session);
    /// Takes back what it did.
    void cancel(Session& session);

private:
    bool active_ = false;
    bool complained_ = false;
    std::string text_;
};

/// Inks of text over the picture. They and the plate below them are the same in every theme, as the picture is: a
/// contrast of at least 4.5 (WCAG 2.1, 1.4.3) whatever the picture's colours.
enum class Ink { Text, Muted, Accent };
ImVec4 inkColor(Ink ink);
ImVec4 plateColor(); ///< blended over the picture

/// Draws text on a quiet dark plate that can be read over any picture. `anchor` in [0, 1] says which point of the plate
/// lies at `place`. Returns its size.
ImVec2 drawPlate(ImDrawList* list, const ImVec2& place, const ImVec2& anchor, const char* text, Ink ink, float scale);

} // namespace ars::ui
