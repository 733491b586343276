#include "app/studio.h"

#include "app/avatar_source.h"
#include "app/frame_options.h"
#include "app/interrupt.h"

#if ARS_HAVE_WINDOW
#include "engine/scene/project.h"
#include "ui/settings.h"
#include "ui/window.h"
#endif

#include <cstdlib>
#include <filesystem>

namespace ars::app {

bool displayIsThere() {
#if ARS_HAVE_WINDOW
    for (const char* name : {"DISPLAY", "WAYLAND_DISPLAY"}) {
        const char* value = std::getenv(name);
        if (value && *value) return true;
    }
#endif
    return false;
}

#if ARS_HAVE_WINDOW

namespace {

Status openStudio(const StudioOptions& options) {
    offerTrainedAvatars(AvatarPrecision::Quick);
    ui::WindowStart start;
    for (const std::string& file : options.files) {
        std::error_code error;
        const std::filesystem::path path = std::filesystem::absolute(file, error);
        if (!std::filesystem::exists(path, error)) {
            return makeError(ErrorCode::NotFound, file, "there is no such file or folder");
        }
        start.open.push_back(path);
    }
    start.stateFolder = options.stateFolder.empty() ? stateFolder() : std::filesystem::path(options.stateFolder);
    start.settings = ui::readSettings(start.stateFolder);
    if (!options.size.empty()) {
        ARS_TRY(const PictureSize size, parseSize(options.size, "--size"));
        start.settings.windowWidth = size.width;
        start.settings.windowHeight = size.height;
        start.sizeGiven = true;
    }
    ARS_TRY(start.device, chooseDevice(options.device));
    start.scale = static_cast<float>(options.scale);
    start.timings = options.timings;
    start.probe = options.probe;
    start.interrupted = interruptRequested;
    return ui::runStudio(start);
}

} // namespace

int runStudio(const StudioOptions& options) {
    const Status status = openStudio(options);
    return status ? kSuccess : reportError(status.error(), options.output);
}

#else

int runStudio(const StudioOptions& options) {
    return reportError(makeError(ErrorCode::Unavailable, "studio", "this build has no window (ARS_WINDOW=OFF)"),
                       options.output);
}

#endif

} // namespace ars::app
