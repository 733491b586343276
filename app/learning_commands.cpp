#include "app/learning_commands.h"

#include <CLI/CLI.hpp>

namespace ars::app {

CLI::App& addTrain(CLI::App& app, TrainOptions& options) {
    CLI::App& command = *app.add_subcommand("train", "Make an avatar from a multi-view capture, or speak to a run");
    command
        .add_option("--capture", options.capture,
                    "Folder of the capture: AvatarReX, THuman4 or ActorsHQ, as downloaded")
        ->type_name("DIR");
    command.add_option("--run", options.run, "Folder of the run: made, or gone on with by --resume")->type_name("DIR");
    command.add_option("--preset", options.preset, "paper, studio, compact (default) or tiny")->type_name("P");
    command.add_option("--body", options.body, "Body file (default: the open body)")->type_name("FILE");
    command
        .add_option("--template", options.templateFile,
                    "Mesh that the avatar is built on (default: template.npz, .glb, .ply or .obj in the capture, else "
                    "the body)")
        ->type_name("FILE");
    command.add_option("--set", options.settings, "Change a parameter; repeat for more")->type_name("NAME=VALUE");
    command.add_flag("--resume", options.resume, "Go on from the newest checkpoint, with --set under other parameters");
    command.add_flag("--help-parameters", options.helpParameters, "List every parameter of the preset");
    command.add_flag("--status", options.status, "Say what the run is doing")->group("A run that works");
    command.add_option("--request", options.request, "pause, resume, save, stop, or discard (stop and delete)")
        ->type_name("WORD")
        ->check(CLI::IsMember({"pause", "resume", "save", "stop", "discard"}).description(""))
        ->group("A run that works");
    return command;
}

CLI::App& addEval(CLI::App& app, EvalOptions& options) {
    CLI::App& command = *app.add_subcommand("eval", "Measure an avatar against photographs and ground truth");
    command.add_option("--avatar", options.avatar, "Avatar, run or checkpoint (rest:TEMPLATE.glb too)")
        ->type_name("A")
        ->required();
    command.add_option("--capture", options.capture, "Folder of the capture, or of several")
        ->type_name("DIR")
        ->required();
    command
        .add_option("--split", options.split,
                    "all, train, or a published split of the subject; by default the protocol's, else all")
        ->type_name("S");
    command.add_option("--protocol", options.protocol, "ag, heldout or masked (default)")->type_name("P");
    command.add_option("--cameras", options.cameras, "Names or indices, with commas and ranges")->type_name("LIST");
    command.add_option("--frames", options.frames, "Frames by number: A:B or A:B:STEP")->type_name("LIST");
    command
        .add_option("--light", options.light, "True light, for relit figures (default: lights/*.exr of the capture)")
        ->type_name("FILE");
    command
        .add_option("--lpips-backbone", options.lpipsBackbone,
                    "Weights of VGG16 or AlexNet (.pth of torchvision, .safetensors), for LPIPS")
        ->type_name("FILE");
    command.add_option("--lpips-heads", options.lpipsHeads, "LPIPS' own linear weights of the same network")
        ->type_name("FILE");
    command.add_option("--pictures", options.pictures, "How many views are written as pictures")->type_name("N");
    command.add_option("--out", options.out, "Folder for report.json, report.txt and pictures")
        ->type_name("DIR")
        ->required();
    return command;
}

} // namespace ars::app
