#include "app/command_line.h"

#include "app/command.h"
#include "app/export.h"
#include "app/import.h"
#include "app/info.h"
#include "app/system_info.h"
#include "app/text.h"
#include "engine/core/log.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

namespace ars::app {
namespace {

constexpr const char* kAbout = "ARS Studio: animatable, relightable avatars of Gaussian surfels";
constexpr const char* kExitCodes = "Exit code: 0 success, 1 failure, 2 wrong usage, 128 + signal when interrupted.";

/// Everything that the arguments can set.
struct Arguments {
    InfoOptions info;
    ExportOptions exported;
    ImportOptions imported;
    OutputOptions output;
    bool measure = false;
    std::string logLevel;
};

void addOutputOptions(CLI::App& command, Arguments& arguments) {
    command.add_flag("--json", arguments.output.json, "Print results and errors as JSON on standard output")
        ->group("Output");
    command.add_flag("--quiet", arguments.output.quiet, "No progress and no notes")->group("Output");
    command.add_option("--log-level", arguments.logLevel, "Least important log lines that are shown")
        ->type_name("LEVEL")
        ->check(CLI::IsMember({"debug", "info", "warning", "error"}))
        ->group("Output");
}

void addInfo(CLI::App& app, Arguments& arguments) {
    CLI::App& command = *app.add_subcommand("info", "Say what files are, what they hold and whether they are sound");
    command.add_option("FILE", arguments.info.files,
                       "Files, or folders of captures, recognised by their content; none: this machine");
    command.add_flag("--measure", arguments.measure, "Without a FILE: also measure LibTorch's operators");
    command.add_flag("--fast", arguments.info.fast, "Read headers only: nothing is decoded and nothing called sound");
    addOutputOptions(command, arguments);
    command.footer(
        "Reads npy, npz (bodies, motions, templates, any arrays), safetensors, OpenEXR, Radiance HDR, PNG, JPEG,\n"
        "PLY, OBJ, glTF, BVH, camera calibrations and captures in AvatarReX layout; names other kinds.\n"
        "With --json: one object for one file, else a list.");
}

void addMotionOptions(CLI::App& command, std::string& map, std::string& up, double& framesPerSecond) {
    command.add_option("--fps", framesPerSecond, "Resample the motion to this rate (default: the file's own)")
        ->type_name("RATE")
        ->check(CLI::Range(1.0 / 60.0, 10000.0).description(""));
    command.add_option("--map", map, "Joint names of a BVH or glTF: a JSON file, a known map's name, or auto")
        ->type_name("FILE|NAME");
    command.add_option("--up", up, "Axis of the file that points up: auto, y, z or -y")->type_name("AXIS");
}

void addExport(CLI::App& app, Arguments& arguments) {
    ExportOptions& options = arguments.exported;
    CLI::App& command = *app.add_subcommand("export", "Write a posed body or template as OBJ, glb, PLY or npz");
    command.add_option("--body", options.body, "Body: open (the one that comes along, default) or an SMPL-X style npz")
        ->type_name("open|FILE");
    command
        .add_option("--template", options.templateFile,
                    "Clothed mesh or rig instead of a body: glb, gltf, npz, OBJ or PLY")
        ->type_name("FILE");
    command
        .add_option("--betas", options.betas,
                    "Shape coefficients with commas between them, or motion: those of the motion file")
        ->type_name("A,B,..");
    command.add_option("--expression", options.expression, "Expression coefficients with commas between them")
        ->type_name("A,B,..");
    command.add_option("--pose", options.pose, "rest (default), canonical, or a file with poses")
        ->type_name("rest|canonical|FILE");
    command.add_option("--frame", options.frame, "Frame of the pose file, from 0")->type_name("N");
    command.add_option("--motion", options.motion, "A motion: a glb gets an animation, other formats numbered files")
        ->type_name("FILE");
    command.add_option("--frames", options.frames, "Frames a to b-1 of the motion, counted after --fps")
        ->type_name("A:B");
    addMotionOptions(command, options.map, options.up, options.framesPerSecond);
    command.add_option("--out", options.out, "File to write; its ending chooses the format: .obj .glb .ply .npz")
        ->type_name("FILE")
        ->required();
    addOutputOptions(command, arguments);
    command.footer(
        "A glb keeps skeleton, weights, materials and pictures; a single pose becomes an animation of one frame.\n"
        "Motions are npz (smpl_params, AMASS), npy, BVH or glTF animations.");
}

void addImport(CLI::App& app, Arguments& arguments) {
    ImportOptions& options = arguments.imported;
    CLI::App& command = *app.add_subcommand("import", "Turn a BVH, AMASS or glTF motion into smpl_params.npz");
    command.add_option("MOTION", options.motion, "Motion file, recognised by its content")->type_name("")->required();
    command.add_option("--out", options.out, "File to write: .npz (smpl_params) or .bvh")
        ->type_name("FILE")
        ->required();
    addMotionOptions(command, options.map, options.up, options.framesPerSecond);
    command.add_option("--body", options.body, "Body that will play it: open (default) or an SMPL-X style npz")
        ->type_name("open|FILE");
    command.add_option("--frames", options.frames, "Frames a to b-1, counted after --fps")->type_name("A:B");
    command
        .add_option("--animation", options.animation, "Animation of a glTF: its name or number (default: the first)")
        ->type_name("NAME");
    command.add_option("--floor", options.floor, "Heights: keep, place (lowest point on y = 0) or auto")
        ->type_name("HOW");
    command
        .add_option("--unit", options.metresPerUnit,
                    "Metres in one unit of the file (default: leg lengths are made equal)")
        ->type_name("METRES")
        ->check(CLI::PositiveNumber.description(""));
    command.add_flag("--keep-lead-in", options.keepLeadIn, "Keep the rest pose that many recordings begin with");
    command.add_flag("--keep-position", options.keepPosition,
                     "Do not move the start of a BVH or glTF motion to the origin");
    addOutputOptions(command, arguments);
}

std::vector<std::string> commandNames(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
    return names;
}

/// What CLI11 says, as one sentence without a trailing line end or period.
std::string oneSentence(std::string text) {
    std::replace(text.begin(), text.end(), '\n', ' ');
    while (!text.empty() && (text.back() == ' ' || text.back() == '.')) text.pop_back();
    return text;
}

Error usageError(std::string place, std::string message) {
    return makeError(ErrorCode::InvalidArgument, std::move(place), std::move(message));
}

/// The first argument that nothing expects, with the option that was probably meant.
Error unexpectedArgument(const CLI::App& command, const std::string& name) {
    const std::vector<std::string> rest = command.remaining();
    const std::string word = rest.empty() ? "" : rest.front();
    if (!word.starts_with("-")) return usageError(name, fmt::format("unexpected argument \"{}\"", word));
    std::vector<std::string> options;
    for (const CLI::Option* option : command.get_options()) {
        for (const std::string& longName : option->get_lnames()) options.push_back("--" + longName);
    }
    const std::string meant = nearest(word.substr(0, word.find('=')), options);
    return usageError(
        name, fmt::format("unknown option {}{}", word, meant.empty() ? "" : fmt::format("; did you mean {}?", meant)));
}

int reportUsage(const Error& error, const std::string& command, const OutputOptions& output) {
    reportError(error, output);
    if (!output.json) fmt::print(stderr, "See: ars {}--help\n", command.empty() ? "" : command + " ");
    return kWrongUsage;
}

int runParsed(const CLI::App& app, Arguments& arguments) {
    for (LogLevel level : {LogLevel::Debug, LogLevel::Info, LogLevel::Warning, LogLevel::Error}) {
        if (arguments.logLevel == logLevelName(level)) setLogLevel(level);
    }
    arguments.info.output = arguments.exported.output = arguments.imported.output = arguments.output;
    if (app.got_subcommand("info") && arguments.info.files.empty())
        return runSystemInfo(arguments.measure, arguments.output);
    if (app.got_subcommand("info")) return runInfo(arguments.info);
    if (app.got_subcommand("export")) return runExport(arguments.exported);
    if (app.got_subcommand("import")) return runImport(arguments.imported);
    fmt::print("{}", app.help());
    return kSuccess;
}

} // namespace

int runCommandLine(const std::vector<std::string>& given) {
    Arguments arguments;
    CLI::App app{kAbout, "ars"};
    app.set_version_flag("--version", fmt::format("ars {}", ARS_VERSION), "Print the version and exit");
    app.set_help_flag("--help", "Print this help and exit");
    app.require_subcommand(0, 1);
    app.footer(fmt::format("{}\nars COMMAND --help says more about a command.", kExitCodes));
    addInfo(app, arguments);
    addExport(app, arguments);
    addImport(app, arguments);

    OutputOptions early; // before the arguments are understood
    early.json = std::find(given.begin(), given.end(), "--json") != given.end();
    const std::vector<std::string> names = commandNames(app);
    if (!given.empty() && !given[0].starts_with("-") &&
        std::find(names.begin(), names.end(), given[0]) == names.end()) {
        const std::string meant = nearest(given[0], names);
        const std::string hint =
            meant.empty() ? fmt::format("there are {}", listed(names)) : fmt::format("did you mean {}?", meant);
        return reportUsage(usageError("", fmt::format("unknown command \"{}\"; {}", printable(given[0]), hint)), "",
                           early);
    }
    try {
        app.parse(std::vector<std::string>(given.rbegin(), given.rend()));
    } catch (const CLI::ExtrasError&) {
        const auto used = app.get_subcommands();
        const std::string name = used.empty() ? "" : used.front()->get_name();
        return reportUsage(unexpectedArgument(used.empty() ? app : *used.front(), name), name, early);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) return app.exit(error);
        const auto used = app.get_subcommands();
        const std::string name = used.empty() ? "" : used.front()->get_name();
        return reportUsage(usageError(name, oneSentence(error.what())), name, early);
    }
    return runParsed(app, arguments);
}

} // namespace ars::app
