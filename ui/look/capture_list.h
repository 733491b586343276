#pragma once

#include "ui/look/controls.h"

#include <string>

namespace ars::ui {

/// The cameras of a capture: opening one, searching and stepping through its cameras, the photographs beside them and
/// the comparison with the picture. `search_` is what was typed; everything else stands in the document.
class CaptureList {
public:
    void draw(StudioContext& context);

private:
    void askForCapture(StudioContext& context);
    void drawCameras(StudioContext& context);
    void drawPhotograph(StudioContext& context);

    std::string search_;
    std::string shown_; ///< the camera that the list was last scrolled to
};

} // namespace ars::ui
