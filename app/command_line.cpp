#include "app/command_line.h"

#include "app/avatar_source.h"
#include "app/command.h"
#include "app/export.h"
#include "app/import.h"
#include "app/info.h"
#include "app/learning_commands.h"
#include "app/light.h"
#include "app/render.h"
#include "app/stage.h"
#include "app/studio.h"
#include "app/system_info.h"
#include "app/text.h"
#include "engine/core/log.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>

namespace ars::app {
namespace {

constexpr const char* kAbout = "ARS Studio: animatable, relightable avatars of Gaussian surfels";
constexpr const char* kExitCodes = "Exit code: 0 success, 1 failure, 2 wrong usage, 128 + signal when interrupted.";

/// Everything that the arguments can set.
struct Arguments {
    InfoOptions info;
    ExportOptions exported;
    ImportOptions imported;
    RenderOptions render;
    StageOptions stage;
    LightOptions light;
    StudioOptions studio;
    TrainOptions train;
    EvalOptions eval;
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
        "PLY, OBJ, glTF, BVH, camera calibrations, captures (AvatarReX, THuman4, ActorsHQ), avatars and\n"
        "training runs; names other kinds.\n"
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

/// Which frame of --pose, which frames of --motion.
void addFrameChoice(CLI::App& command, std::size_t& poseFrame, std::string& frames) {
    command.add_option("--frame", poseFrame, "Frame of the pose file, from 0")->type_name("N");
    command.add_option("--frames", frames, "Frames a to b-1 of the motion, counted after --fps")->type_name("A:B");
}

void addExport(CLI::App& app, Arguments& arguments) {
    ExportOptions& options = arguments.exported;
    CLI::App& command =
        *app.add_subcommand("export", "Write a posed body or template as OBJ, glb, PLY or npz, or a NAME.avatar");
    command
        .add_option("--avatar", options.avatar,
                    "Instead of a mesh what a training learned: a run (its newest checkpoint), a checkpoint, an avatar")
        ->type_name("A");
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
    command.add_option("--motion", options.motion, "A motion: a glb gets an animation, other formats numbered files")
        ->type_name("FILE");
    addFrameChoice(command, options.frame, options.frames);
    addMotionOptions(command, options.map, options.up, options.framesPerSecond);
    command
        .add_option("--out", options.out,
                    "File to write; its ending chooses the format: .obj .glb .ply .npz; .avatar with --avatar")
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

void addFrameOptions(CLI::App& command, FrameOptions& options) {
    command.add_option("--device", options.device, "Where to compute: auto (default), cpu, cuda, cuda:N")
        ->type_name("D")
        ->group("Frame");
    command
        .add_option("--occlusion", options.occlusion,
                    "Ambient occlusion: body, reference, mesh_rays, rasterised, baked, off; by default as a trained "
                    "avatar was trained, else body")
        ->type_name("METHOD")
        ->group("Frame");
    command
        .add_option("--radius", options.radius,
                    "Occlusion radius in metres, one for all nine parts, or PART=METRES with commas between them")
        ->type_name("R")
        ->group("Frame");
    command.add_option("--set", options.settings, "Change a setting, e.g. occlusion.thickness=0.3; repeat for more")
        ->type_name("GROUP.NAME=VALUE")
        ->group("Frame");
}

void addLightOptions(CLI::App& command, std::string& environment, double& scale, double& rotation, int& size) {
    command
        .add_option("--env", environment,
                    "Light: EXR or HDR (lat-long or cube), a folder of six faces, sky[:ELEVATION,AZIMUTH], "
                    "studio[:PRESET], uniform (default: studio)")
        ->type_name("E")
        ->group("Light");
    command.add_option("--env-scale", scale, "Factor of the light")->type_name("S")->group("Light");
    command.add_option("--env-rotation", rotation, "Degrees about +y; positive takes +z towards +x")
        ->type_name("DEG")
        ->group("Light");
    command.add_option("--light-size", size, "Side of the cube that is filtered, a power of two (default 512)")
        ->type_name("N")
        ->check(CLI::IsMember({64, 128, 256, 512, 1024, 2048, 4096}).description(""))
        ->group("Light");
}

void addDisplayOptions(CLI::App& command, DisplayOptions& options) {
    command.add_option("--exposure", options.exposureEv, "Stops before the tone curve")
        ->type_name("EV")
        ->group("Display");
    command.add_option("--curve", options.curve, "Tone curve: none (default), aces, agx")
        ->type_name("C")
        ->group("Display");
    command.add_option("--background", options.background, "sRGB grey, or R,G,B, in [0,1] (default 0.5)")
        ->type_name("GREY|R,G,B")
        ->group("Display");
    command.add_flag("--transparent", options.transparent, "PNG with alpha instead of a background")->group("Display");
    command.add_flag("--backdrop", options.backdrop, "Put the light's picture behind the avatar")->group("Display");
}

void addRender(CLI::App& app, Arguments& arguments) {
    RenderOptions& options = arguments.render;
    CLI::App& command = *app.add_subcommand("render", "Render pictures, EXR buffers and films of an avatar");
    command
        .add_option("--avatar", options.avatar,
                    "rest:TEMPLATE (a skinned glb, a mesh, a body), rest:open, or the folder of a trained avatar, a "
                    "training run or one of its checkpoints; a project counts as --project")
        ->type_name("A");
    CLI::Option& project = *command
                                .add_option("--project", options.project,
                                            "A project of the studio, or a picture that the program made, as its "
                                            "window would show it")
                                ->type_name("FILE.ars|PICTURE")
                                ->group("Project");
    command.add_flag("--film", options.film, "The frames of the project's timeline instead of one picture")
        ->needs(&project)
        ->group("Project");
    command.add_option("--range", options.filmTimes, "Seconds of the film (default: the timeline's range)")
        ->needs(&project)
        ->type_name("START:END")
        ->group("Project");
    command.add_option("--surfels", options.surfels, "About how many surfels a rest: avatar gets")
        ->type_name("N")
        ->check(CLI::Range(1, 10000000).description(""));
    command.add_option("--pose", options.pose, "rest (default), canonical, relaxed, or a file with poses")
        ->type_name("rest|canonical|relaxed|FILE");
    command.add_option("--motion", options.motion, "A motion: npz (smpl_params, AMASS), npy, BVH or glTF")
        ->type_name("FILE");
    addFrameChoice(command, options.poseFrame, options.frames);
    addMotionOptions(command, options.map, options.up, options.framesPerSecond);
    command.add_option("--camera", options.camera, "A camera JSON, or CALIBRATION.json:NAME")
        ->type_name("FILE[:NAME]")
        ->group("Camera");
    command.add_option("--orbit", options.orbit, "Turn the camera around the avatar once in N frames")
        ->type_name("N")
        ->check(CLI::Range(1, 100000).description(""))
        ->group("Camera");
    command
        .add_option("--azimuth", options.azimuthDeg,
                    "Without --camera: where it starts; 0 sees the front, 90 the left side")
        ->type_name("DEG")
        ->group("Camera");
    command.add_option("--elevation", options.elevationDeg, "Without --camera: height above the horizon (default 8)")
        ->type_name("DEG")
        ->check(CLI::Range(-89.0, 89.0).description(""))
        ->group("Camera");
    command.add_option("--fov", options.fieldDeg, "Without --camera: opening angle from top to bottom (default 30)")
        ->type_name("DEG")
        ->check(CLI::Range(1.0, 150.0).description(""))
        ->group("Camera");
    command.add_option("--size", options.size, "Pixels (default: the camera's, or 512x512)")
        ->type_name("WxH")
        ->group("Camera");
    addLightOptions(command, options.environment, options.environmentScale, options.environmentRotationDeg,
                    options.lightSize);
    command.add_option("--env-orbit", options.environmentOrbit, "Turn the light around once in N frames")
        ->type_name("N")
        ->check(CLI::Range(1, 100000).description(""))
        ->group("Light");
    addFrameOptions(command, options.frame);
    addDisplayOptions(command, options.display);
    command.add_option("--aov", options.buffers, "Buffers to write: all, or names with commas between them")
        ->type_name("all|LIST");
    command
        .add_option(
            "--write", options.formats,
            "What to write: png, exr, buffers (a PNG each), mp4 (default: png, exr with --aov, mp4 for several frames)")
        ->type_name("LIST");
    command.add_option("--out", options.out, "Folder for the files; of a project also a file: .png .exr .mp4")
        ->type_name("DIR")
        ->required();
    addOutputOptions(command, arguments);
    // A project says all the rest itself.
    const std::vector<std::string> together{"--help",  "--film",      "--range",       "--size",   "--aov",
                                            "--write", "--out",       "--device",      "--fps",    "--json",
                                            "--quiet", "--log-level", "--transparent", "--project"};
    for (CLI::Option* option : command.get_options()) {
        if (std::find(together.begin(), together.end(), option->get_name()) == together.end()) project.excludes(option);
    }
    std::string buffers;
    for (const BufferInfo& info : bufferCatalogue())
        buffers += fmt::format("{}{}", buffers.empty() ? "" : ", ", info.name);
    command.footer(
        fmt::format("Buffers: {}.\nSettings of --set:\n{}{}", buffers, describeAvatarSettings(), describeSettings()));
}

void addStage(CLI::App& app, Arguments& arguments) {
    StageOptions& options = arguments.stage;
    CLI::App& stage = *app.add_subcommand("stage", "Run one stage of a frame alone, from file to file");
    stage.require_subcommand(1);
    const auto common = [&](CLI::App& command, const char* input, const char* help) {
        command.add_option(input, options.input, help)->type_name("")->required();
        command.add_option("--out", options.out, "EXR to write")->type_name("OUT.exr")->required();
        addOutputOptions(command, arguments);
    };
    const auto camera = [&](CLI::App& command) {
        command.add_option("--camera", options.camera, "A camera JSON, or CALIBRATION.json:NAME")
            ->type_name("FILE[:NAME]");
        addFrameOptions(command, options.frame);
    };
    CLI::App& maps = *stage.add_subcommand("maps", "Template to canonical, position and deformation-prior maps");
    common(maps, "TEMPLATE", "A template, or open for the open body");
    maps.add_option("--size", options.mapSize, "Side of a map in pixels, even (default 512)")
        ->type_name("N")
        ->check(CLI::Range(8, 4096).description(""));
    maps.add_option("--pose", options.pose, "canonical (default), rest, or a file with poses")->type_name("P");
    maps.add_option("--frame", options.poseFrame, "Frame of the pose file, from 0")->type_name("N");
    CLI::App& splat = *stage.add_subcommand("splat", "Surfels (PLY) to the G-buffer");
    common(splat, "SURFELS", "A PLY in the layout of 3D Gaussian Splatting");
    camera(splat);
    splat.add_option("--aov", options.buffers, "Buffers to write (default: all that the surfels have)")
        ->type_name("LIST");
    CLI::App& occlude = *stage.add_subcommand("occlude", "Depth, normal and radius to ambient occlusion");
    common(occlude, "BUFFERS", "EXR with depth.Z, normal.XYZ, radius.Y; optional importance.Y, bone.XYZ, opacity.Y");
    camera(occlude);
    CLI::App& shade = *stage.add_subcommand("shade", "Materials, normals and light to a picture");
    common(shade, "BUFFERS", "EXR with albedo.RGB, roughness.Y, normal.XYZ, and opacity.Y or depth.Z; optional ao.Y");
    camera(shade);
    addLightOptions(shade, options.environment, options.environmentScale, options.environmentRotationDeg,
                    options.lightSize);
}

void addLight(CLI::App& app, Arguments& arguments) {
    LightOptions& options = arguments.light;
    CLI::App& command = *app.add_subcommand("light", "Look at, convert, generate and prefilter environments");
    command
        .add_option("LIGHT", options.source,
                    "EXR or HDR (lat-long or cube), a folder of six faces, sky[:ELEVATION,AZIMUTH], studio[:PRESET]")
        ->type_name("")
        ->required();
    command.add_option("--set", options.settings, "Change a setting of sky or studio; repeat for more")
        ->type_name("NAME=VALUE");
    command.add_option("--out", options.out, "Write it: .exr, .hdr, or .png and .jpg as a preview")->type_name("FILE");
    command.add_option("--size", options.size, "Pixels of the lat-long picture")->type_name("WxH");
    command.add_option("--cube", options.cube, "Write a strip of six faces of this side instead")
        ->type_name("N")
        ->check(CLI::Range(1, 4096).description(""));
    command.add_option("--rotation", options.rotationDeg, "Degrees about +y; positive takes +z towards +x")
        ->type_name("DEG");
    command.add_option("--scale", options.scale, "Factor of the light")->type_name("S");
    command.add_option("--prefilter", options.prefilter, "Folder for the split-sum levels, irradiance and table")
        ->type_name("DIR");
    command.add_option("--light-size", options.lightSize, "Side of the cube that is filtered (default 512)")
        ->type_name("N")
        ->check(CLI::IsMember({64, 128, 256, 512, 1024, 2048, 4096}).description(""));
    command.add_option("--device", options.device, "Where to compute: auto (default), cpu, cuda, cuda:N")
        ->type_name("D");
    addOutputOptions(command, arguments);
    command.footer(describeLightSettings());
}

void addStudio(CLI::App& app, Arguments& arguments) {
    StudioOptions& options = arguments.studio;
    CLI::App& command = *app.add_subcommand("studio", "Open the window (also: ars without a command, or ars FILE)");
    command.add_option("FILE", options.files, "Files to open: a project, an avatar, a light, a motion, a picture ...")
        ->type_name("");
    command.add_option("--size", options.size, "Size of the window (default: as it was left)")->type_name("WxH");
    command.add_option("--scale", options.scale, "Size of text and widgets (default: the display's)")
        ->type_name("S")
        ->check(CLI::Range(0.5, 4.0).description(""));
    command.add_option("--device", options.device, "Where to compute: auto (default), cpu, cuda, cuda:N")
        ->type_name("D");
    command
        .add_option("--state-folder", options.stateFolder,
                    "Where settings, autosaves and recent files live (default: ~/.local/state/ars)")
        ->type_name("DIR");
    command.add_option("--timings", options.timings, "Write how long the window's frames took, as JSON, at the end")
        ->type_name("FILE");
    command.add_option("--script-probe", options.probe, "For tests: tell scripts in this folder where widgets are")
        ->type_name("DIR");
    addOutputOptions(command, arguments);
}

std::vector<std::string> commandNames(const CLI::App& app) {
    std::vector<std::string> names;
    for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
    return names;
}

/// `render --avatar NAME.ars` is `render --project NAME.ars`.
std::vector<std::string> withProjects(std::vector<std::string> given) {
    if (given.empty() || given[0] != "render") return given;
    const std::string option = "--avatar";
    for (std::size_t i = 1; i < given.size(); ++i) {
        const bool apart = given[i] == option && i + 1 < given.size();
        const std::string& value = apart ? given[i + 1] : given[i];
        if (!value.ends_with(".ars") || value.starts_with("rest:") || given[i].starts_with(option + "=rest:")) continue;
        if (apart || given[i].starts_with(option + "=")) given[i].replace(0, option.size(), "--project");
    }
    return given;
}

/// `ars FILE` is `ars studio FILE`.
std::vector<std::string> withStudio(std::vector<std::string> given, const std::vector<std::string>& commands) {
    if (given.empty() || given[0].starts_with("-")) return given;
    std::error_code ignored;
    const bool command = std::find(commands.begin(), commands.end(), given[0]) != commands.end();
    if (!command && std::filesystem::exists(given[0], ignored)) given.insert(given.begin(), "studio");
    return given;
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

int runStage(const CLI::App& stage, const StageOptions& options) {
    if (stage.got_subcommand("maps")) return runStageMaps(options);
    if (stage.got_subcommand("splat")) return runStageSplat(options);
    if (stage.got_subcommand("occlude")) return runStageOcclude(options);
    return runStageShade(options);
}

int runParsed(const CLI::App& app, Arguments& arguments) {
    for (LogLevel level : {LogLevel::Debug, LogLevel::Info, LogLevel::Warning, LogLevel::Error}) {
        if (arguments.logLevel == logLevelName(level)) setLogLevel(level);
    }
    arguments.info.output = arguments.exported.output = arguments.imported.output = arguments.output;
    arguments.render.output = arguments.stage.output = arguments.light.output = arguments.output;
    arguments.studio.output = arguments.train.output = arguments.eval.output = arguments.output;
    if (app.got_subcommand("info") && arguments.info.files.empty())
        return runSystemInfo(arguments.measure, arguments.output);
    if (app.got_subcommand("info")) return runInfo(arguments.info);
    if (app.got_subcommand("export")) return runExport(arguments.exported);
    if (app.got_subcommand("import")) return runImport(arguments.imported);
    if (app.got_subcommand("render")) return runRender(arguments.render);
    if (app.got_subcommand("light")) return runLight(arguments.light);
    if (app.got_subcommand("train")) return runTrain(arguments.train);
    if (app.got_subcommand("eval")) return runEval(arguments.eval);
    if (app.got_subcommand("stage")) return runStage(*app.get_subcommand("stage"), arguments.stage);
    if (app.got_subcommand("studio") || displayIsThere()) return runStudio(arguments.studio);
    return runTurntable(arguments.output);
}

} // namespace

int runCommandLine(const std::vector<std::string>& words) {
    Arguments arguments;
    CLI::App app{kAbout, "ars"};
    app.set_version_flag("--version", fmt::format("ars {}", ARS_VERSION), "Print the version and exit");
    app.set_help_flag("--help", "Print this help and exit");
    app.require_subcommand(0, 1);
    app.footer(fmt::format("{}\nars COMMAND --help says more about a command.", kExitCodes));
    addInfo(app, arguments);
    addExport(app, arguments);
    addImport(app, arguments);
    addRender(app, arguments);
    addStage(app, arguments);
    addLight(app, arguments);
    addStudio(app, arguments);
    addOutputOptions(addTrain(app, arguments.train), arguments);
    addOutputOptions(addEval(app, arguments.eval), arguments);

    const std::vector<std::string> names = commandNames(app);
    const std::vector<std::string> given = withProjects(withStudio(words, names));
    OutputOptions early; // before the arguments are understood
    early.json = std::find(given.begin(), given.end(), "--json") != given.end();
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
