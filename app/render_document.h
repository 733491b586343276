#pragma once

#include "app/render.h"
#include "engine/frame/rest_avatar.h"
#include "engine/light/prefilter.h"
#include "engine/rig/motion.h"
#include "engine/scene/document.h"

#include <string>

namespace ars::app {

/// One frame of `ars render` in its ordinary form, whose parts are named on the command line.
struct RenderedFrame {
    const RenderOptions* options = nullptr;
    RestAvatarOptions rest;
    const FrameInputs* inputs = nullptr;
    PartRadii initialRadii = initialPartRadii(); ///< what the studio's reset returns to
    ToneParams tone;
    const Skeleton* skeleton = nullptr;
    float soleHeightM = 0.0f;
    std::size_t surfels = 0;
    Device device;
    LightQuality lightQuality = LightQuality::Exact;
    const Motion* motion = nullptr; ///< that `frame` is one of; null: a single pose
    std::size_t frame = 0;
    std::size_t number = 0; ///< of the frame in the motion's file
};

/// The document that the studio opens to show the same picture: files by absolute path, the camera as the free one (of
/// a capture: as its dataset camera), the pose as it was rendered.
Document documentOfFrame(const RenderedFrame& frame);

/// It as text, with what is no part of it under "picture".
std::string renderedDocument(const RenderedFrame& frame);

} // namespace ars::app
