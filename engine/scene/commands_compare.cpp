#include "engine/scene/command_arguments.h"

#include <fmt/format.h>

namespace ars::edit {
namespace {

/// The file of a comparison is a picture's or an avatar's; its form tells.
bool namesAvatar(const std::string& file) {
    if (file.rfind("rest:", 0) == 0 || std::filesystem::path(file).extension() == ".avatar") return true;
    std::error_code ignored;
    return std::filesystem::is_directory(file, ignored); // pictures are files
}

Status setKind(Document& document, const Arguments& arguments, CommandContext&) {
    CompareSection& compare = document.view.compare;
    const auto kind = enumOf<CompareKind>(arguments, "kind");
    if (kind == CompareKind::Held && !compare.held) return unavailable("nothing is held yet (compare.hold)");
    if (kind == CompareKind::Picture && (compare.file.empty() || namesAvatar(compare.file))) {
        return unavailable("no picture to compare with has been opened (compare.picture)");
    }
    if (kind == CompareKind::Avatar && !namesAvatar(compare.file)) {
        return unavailable("no avatar to compare with has been opened (compare.avatar)");
    }
    if (kind == CompareKind::Photograph && document.camera.capture.empty()) {
        return unavailable("no capture is open (camera.open_capture)");
    }
    compare.kind = kind;
    return {};
}

Status comparePicture(Document& document, const Arguments& arguments, CommandContext&) {
    const std::string file = textOf(arguments, "file");
    ARS_TRY_STATUS(needsAbsolute(file, "file"));
    document.view.compare.file = file;
    document.view.compare.layer = textOf(arguments, "layer");
    document.view.compare.kind = CompareKind::Picture;
    return {};
}

Status compareAvatar(Document& document, const Arguments& arguments, CommandContext&) {
    const std::string source = textOf(arguments, "source");
    const std::string file = source.rfind("rest:", 0) == 0 ? source.substr(5) : source;
    const bool sound = source == "rest:open" || (std::filesystem::path(file).is_absolute() && namesAvatar(source));
    if (!sound) {
        return makeError(
            ErrorCode::InvalidArgument, "source",
            fmt::format("expected rest:open, rest:/FILE or the absolute path of a trained avatar's folder, "
                        "found \"{}\"",
                        source));
    }
    document.view.compare.file = source;
    document.view.compare.layer.clear();
    document.view.compare.kind = CompareKind::Avatar;
    return {};
}

Status hold(Document& document, const Arguments&, CommandContext&) {
    HeldLook look{document.avatar, document.pose, document.light, document.occlusion};
    CompareSection& compare = document.view.compare;
    if (!compare.held || !(*compare.held == look)) compare.held = std::make_shared<const HeldLook>(std::move(look));
    compare.kind = CompareKind::Held;
    return {};
}

} // namespace

std::vector<Command> compareCommands() {
    CommandArgument other = buffer("Which buffer.");
    other.info.name = "name";
    return {
        {.id = "compare.kind",
         .label = "Compare with",
         .group = CommandGroup::Compare,
         .help = "What stands on the other side of a comparison.",
         .arguments = {enumWord<CompareKind>("kind", "Another buffer, the held look, another avatar, a picture, or the "
                                                     "photograph of the dataset camera.")},
         .apply = setKind,
         .describe = [](const Arguments& a) { return "Compare with " + spoken(textOf(a, "kind")); }},
        {.id = "compare.buffer",
         .label = "Compare with buffer",
         .group = CommandGroup::Compare,
         .help = "Another buffer of the same frame on the other side.",
         .arguments = {other},
         .apply = [](Document& document, const Arguments& a, CommandContext&) -> Status {
             ARS_TRY(document.view.compare.buffer, bufferOf(textOf(a, "name")));
             document.view.compare.kind = CompareKind::Buffer;
             return {};
         }},
        {.id = "compare.picture",
         .label = "Compare with picture",
         .group = CommandGroup::Compare,
         .help = "A picture file on the other side: a photograph, another program's rendering, a ground truth.",
         .arguments = {text("file", "Absolute path."),
                       withDefault(text("layer", "Layer of an EXR; empty: its main picture."), std::string())},
         .apply = comparePicture},
        {.id = "compare.avatar",
         .label = "Compare with avatar",
         .group = CommandGroup::Compare,
         .help = "The same pose, camera and light with another avatar on the other side.",
         .arguments = {text("source", "rest:open, rest:/FILE or the folder of an avatar.")},
         .apply = compareAvatar},
        {.id = "compare.hold",
         .label = "Hold look",
         .group = CommandGroup::Compare,
         .help = "Keeps avatar, pose, light and occlusion as they are now, to compare later changes with.",
         .shortcut = "Ctrl+H",
         .apply = hold},
        {.id = "compare.measure",
         .label = "Error measure",
         .group = CommandGroup::Compare,
         .help = "What the difference picture shows.",
         .arguments = {enumWord<ErrorMeasure>("measure", "Absolute or squared difference, or FLIP.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.view.compare.measure = enumOf<ErrorMeasure>(a, "measure");
                 return Status();
             }},
        {.id = "compare.split",
         .label = "Move split",
         .group = CommandGroup::Compare,
         .help = "Where the line between both pictures stands.",
         .arguments = {number("position", {0, 1}, "", "0 left edge, 1 right edge.")},
         .apply =
             [](Document& document, const Arguments& a, CommandContext&) {
                 document.view.compare.splitPosition = static_cast<float>(numberOf(a, "position"));
                 return Status();
             }},
    };
}

} // namespace ars::edit
