#pragma once

#include "engine/gl/texture.h"
#include "engine/light/studio.h"
#include "engine/scene/session.h"
#include "ui/look/controls.h"

#include <glm/glm.hpp>

#include <memory>
#include <string>
#include <vector>

namespace ars::ui {

/// Direction in the world as a lat-long picture shows it.
struct LightAngles {
    double azimuthDeg = 0.0;   ///< 0 is +z, in front of the body; 90 is +x, at its left
    double elevationDeg = 0.0; ///< above the horizon
};

/// Into [-180, 180).
double wrappedDegrees(double degrees);
/// Place in a lat-long picture of the world, [0, 1] from its upper left, of a direction.
glm::dvec2 mapPlace(const LightAngles& angles);
/// The other way round.
LightAngles mapAngles(const glm::dvec2& place);
/// The lamp's outline as directions of its environment, closed.
std::vector<LightAngles> lampOutline(const StudioLamp& lamp);

/// The light as it hangs around the body: the environment as a lat-long picture, turned as the document says. Dragging
/// it turns the light; the sun of a sky and the lamps of a studio are handles that are dragged themselves, the wheel
/// over a lamp changes its distance.
class LightMap {
public:
    /// @param lamp  index of the selected lamp; clicking one selects it
    void draw(StudioContext& context, int& lamp);

private:
    struct Rectangle {
        ImVec2 corner, size;
    };
    /// The current light, small and linear; made beside.
    struct Picture {
        std::shared_ptr<const LightSource> shown, wanted; ///< what `image` shows, and what is being made
        Image image;
        float exposureEv = 0.0f; ///< that brings its middle to grey
        int version = 0;
    };

    void follow(Session& session);
    void upload(float exposureEv);
    void drawPicture(const StudioContext& context, const Rectangle& area, float rotationDeg) const;
    void drawCompass(const StudioContext& context, const Rectangle& area) const;
    void drawCamera(StudioContext& context, const Rectangle& area) const;
    void dragLight(StudioContext& context, const Rectangle& area, float rotationDeg);
    void dragSun(StudioContext& context, const Rectangle& area, float rotationDeg);
    void dragLamp(StudioContext& context, const Rectangle& area, float rotationDeg, int index, int& selected);
    void wheelOverLamp(StudioContext& context, int index);
    /// A round handle at a direction. True while it is dragged: `angles` then are where it goes.
    bool handle(StudioContext& context, const Rectangle& area, const char* id, LightAngles& angles, ImU32 color,
                bool selected, float radius);

    std::shared_ptr<Picture> picture_ = std::make_shared<Picture>();
    Texture texture_;
    int shownVersion_ = 0;
    float shownExposure_ = 0.0f;
    ImVec2 grabOffset_{}; ///< from the mouse to the handle's centre
    float grabbedRotation_ = 0.0f;
    double wheelTime_ = -1.0; ///< of the last notch, while its entry in the history is open
};

} // namespace ars::ui
