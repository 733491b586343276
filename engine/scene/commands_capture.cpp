#include "engine/scene/command_arguments.h"
#include "engine/scene/command_edits.h"

#include <fmt/format.h>

#include <algorithm>

namespace ars::edit {
namespace {

std::vector<std::string> cameraNames(const Document&, const CommandContext& context) {
    std::vector<std::string> names;
    if (!context.assets.capture) return names;
    for (const CalibratedCamera& camera : context.assets.capture->cameras) names.push_back(camera.name);
    return names;
}

Status hasCapture(const Document& document, const CommandContext&) {
    if (document.camera.capture.empty()) return unavailable("no capture is open");
    return {};
}

Status hasCameras(const Document& document, const CommandContext& context) {
    ARS_TRY_STATUS(hasCapture(document, context));
    if (cameraNames(document, context).empty()) return unavailable("the capture is not loaded yet");
    return {};
}

Status looksThrough(const Document& document, const CommandContext&) {
    if (document.camera.datasetCamera.empty()) return unavailable("no dataset camera is looked through");
    return {};
}

Status openCapture(Document& document, const Arguments& arguments, CommandContext&) {
    const std::string file = textOf(arguments, "file");
    ARS_TRY_STATUS(needsAbsolute(file, "file"));
    if (document.camera.capture == file) return {};
    document.camera.capture = file;
    document.camera.datasetCamera.clear();
    document.camera.photograph = 0;
    return {};
}

Status closeCapture(Document& document, const Arguments&, CommandContext& context) {
    // The view stays where it is.
    if (!document.camera.datasetCamera.empty()) writeCamera(document, context, currentCamera(document, context));
    document.camera.capture.clear();
    document.camera.photograph = 0;
    if (document.view.compare.kind == CompareKind::Photograph) document.view.compare.kind = CompareKind::Buffer;
    return {};
}

Status useCamera(Document& document, const Arguments& arguments, CommandContext&) {
    document.camera.datasetCamera = textOf(arguments, "name");
    return {};
}

/// The camera `step` places on, around the end; from the free camera the first or the last.
Status stepCamera(Document& document, const CommandContext& context, int step) {
    const std::vector<std::string> names = cameraNames(document, context);
    const auto count = static_cast<int>(names.size());
    const auto found = std::find(names.begin(), names.end(), document.camera.datasetCamera);
    int index = step > 0 ? 0 : count - 1;
    if (found != names.end()) index = (static_cast<int>(found - names.begin()) + step + count) % count;
    document.camera.datasetCamera = names[static_cast<std::size_t>(index)];
    return {};
}

Status setPhotograph(Document& document, const Arguments& arguments, CommandContext& context) {
    const int frame = wholeOf(arguments, "frame");
    const std::vector<std::string> names = cameraNames(document, context);
    const auto found = std::find(names.begin(), names.end(), document.camera.datasetCamera);
    const auto camera = static_cast<std::size_t>(found - names.begin());
    if (found != names.end() && camera < context.assets.capture->photographs.size()) {
        const std::size_t count = context.assets.capture->photographs[camera].size();
        if (count > 0 && static_cast<std::size_t>(frame) >= count) {
            return makeError(ErrorCode::InvalidArgument, "frame",
                             fmt::format("expected 0 to {}, found {}", count - 1, frame));
        }
    }
    document.camera.photograph = frame;
    return {};
}

} // namespace

std::vector<Command> captureCommands() {
    CommandArgument name = text("name", "Name of a camera in the calibration.");
    name.choices = cameraNames;
    return {
        {.id = "camera.open_capture",
         .label = "Open capture",
         .group = CommandGroup::Viewpoint,
         .help = "Takes cameras and photographs of a multi-view capture (calibration_full.json).",
         .arguments = {text("file", "Absolute path.")},
         .apply = openCapture},
        {.id = "camera.close_capture",
         .label = "Close capture",
         .group = CommandGroup::Viewpoint,
         .help = "Forgets the capture; the view stays where it is.",
         .enabled = hasCapture,
         .apply = closeCapture},
        {.id = "camera.dataset",
         .label = "Look through dataset camera",
         .group = CommandGroup::Viewpoint,
         .help = "Shows exactly what one camera of the capture sees.",
         .arguments = {name},
         .enabled = hasCameras,
         .apply = useCamera,
         .describe = [](const Arguments& a) { return "Dataset camera " + textOf(a, "name"); }},
        {.id = "camera.next_dataset",
         .label = "Next dataset camera",
         .group = CommandGroup::Viewpoint,
         .help = "The camera after this one in the calibration.",
         .shortcut = "PageDown",
         .enabled = hasCameras,
         .apply = [](Document& document, const Arguments&,
                     CommandContext& context) { return stepCamera(document, context, 1); }},
        {.id = "camera.previous_dataset",
         .label = "Previous dataset camera",
         .group = CommandGroup::Viewpoint,
         .help = "The camera before this one in the calibration.",
         .shortcut = "PageUp",
         .enabled = hasCameras,
         .apply = [](Document& document, const Arguments&,
                     CommandContext& context) { return stepCamera(document, context, -1); }},
        {.id = "camera.leave_dataset",
         .label = "Leave dataset camera",
         .group = CommandGroup::Viewpoint,
         .help = "Goes on with the free camera from where the dataset camera is.",
         .shortcut = "0",
         .enabled = looksThrough,
         .apply =
             [](Document& document, const Arguments&, CommandContext& context) {
                 writeCamera(document, context, currentCamera(document, context));
                 return Status();
             }},
        {.id = "camera.photograph",
         .label = "Photograph",
         .group = CommandGroup::Viewpoint,
         .help = "Which photograph of the dataset camera stands beside the picture.",
         .arguments = {whole("frame", {0, 1000000}, "In the order of their numbers, from 0.")},
         .enabled = hasCapture,
         .apply = setPhotograph},
    };
}

} // namespace ars::edit
