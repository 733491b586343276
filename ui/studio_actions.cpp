#include "ui/studio_state.h"

#include "engine/core/log.h"

#include <algorithm>

namespace ars::ui {
namespace {

using Run = std::function<void(StudioContext&)>;

/// Rounds to steps of a tenth, so that larger and smaller return to where they were.
void changeTextScale(Settings& settings, float step) {
    const float wanted = std::round((settings.textScale + step) * 10.0f) / 10.0f;
    settings.textScale = std::clamp(wanted, 0.5f, 3.0f);
}

/// To the next or previous frame of the timeline's grid.
void stepFrame(StudioContext& context, double frames) {
    const TimelineSection& timeline = context.document().timeline;
    context.session.pause();
    const double rate = timeline.framesPerSecond;
    const double now = std::round(context.document().timeline.timeS * rate);
    const double time = std::clamp((now + frames) / rate, timeline.startS, timeline.endS);
    const Status status = context.session.run("timeline.seek", {{"time", time}}, "step frames");
    if (!status) context.studio.toast(status.error().describe());
}

void seek(StudioContext& context, double time) {
    context.session.pause();
    const Status status = context.session.run("timeline.seek", {{"time", time}});
    if (!status) context.studio.toast(status.error().describe());
}

void addFileActions(Studio::State& state, std::vector<Action>& actions) {
    const auto add = [&](const char* id, const char* label, const char* help, const char* keys, Run run) {
        actions.push_back({id, label, "File", help, keys, std::move(run), nullptr});
    };
    add("file.new", "New", "Begins with the open body under three lamps", "Ctrl+N",
        [&state](StudioContext&) { state.guardUnsaved("New project", [&state] { state.session.newProject(); }); });
    add("file.open", "Open...", "Any file: projects, avatars, lights, motions, poses, captures, pictures", "Ctrl+O",
        [&state](StudioContext&) { state.askOpen(); });
    const std::tuple<const char*, const char*, const char*, FileRole> kinds[] = {
        {"file.open_project", "Open project...", "A .ars file", FileRole::Project},
        {"file.open_avatar", "Open avatar...", "A skinned glTF or a body", FileRole::Avatar},
        {"file.open_trained", "Open trained avatar...", "The folder of an avatar, a training run or a checkpoint",
         FileRole::Run},
        {"file.open_light", "Open light...", "A panorama, EXR or HDR, that lights the avatar", FileRole::Light},
        {"file.open_motion", "Open motion...", "AMASS, smpl_params, BVH or a glTF animation", FileRole::Clip},
        {"file.open_pose", "Open pose...", "A pose, or the first one of a motion", FileRole::PoseFile},
        {"file.open_capture", "Open capture...", "The cameras of a capture with their photographs", FileRole::Capture},
        {"file.open_picture", "Compare with picture...", "A photograph or an EXR beside the avatar",
         FileRole::ComparePicture},
    };
    for (const auto& kind : kinds) {
        const FileRole role = std::get<3>(kind);
        add(std::get<0>(kind), std::get<1>(kind), std::get<2>(kind), "",
            [&state, role](StudioContext&) { state.askOpenAs(role); });
    }
    add("file.save", "Save", "Writes the project", "Ctrl+S", [&state](StudioContext&) { state.save([] {}); });
    add("file.save_as", "Save as...", "Writes the project under another name", "Ctrl+Shift+S",
        [&state](StudioContext&) { state.saveAs([] {}); });
    add("file.export_pose", "Export pose...", "The pose as SMPL-X numbers (smpl_params.npz)", "",
        [&state](StudioContext&) { state.exportPose(); });
    add("file.export_motion", "Export motion...", "The timeline's poses as SMPL-X numbers (smpl_params.npz)", "",
        [&state](StudioContext&) { state.exportClip(".npz"); });
    add("file.export_bvh", "Export motion as BVH...", "The timeline's poses for other animation programs", "",
        [&state](StudioContext&) { state.exportClip(".bvh"); });
    add("file.export_gltf", "Export posed avatar as glTF...", "Mesh, skeleton and pose; opens in Blender", "",
        [&state](StudioContext&) { state.exportGltf(); });
    add("file.screenshot", "Screenshot...", "The picture in full quality: PNG, or EXR with all buffers", "F12",
        [&state](StudioContext&) { state.screenshot(); });
    add("file.film", "Film...", "The timeline as MP4; the Output panel has size and range", "Ctrl+F12",
        [&state](StudioContext&) { state.film(); });
    add("file.quit", "Quit", "Leaves the program", "Ctrl+Q", [&state](StudioContext&) { state.studio.requestQuit(); });
}

void addEditActions(Studio::State& state, std::vector<Action>& actions) {
    actions.push_back({"edit.undo", "Undo", "Edit", "Takes the last edit back", "Ctrl+Z",
                       [](StudioContext& context) { context.session.undo(); },
                       [](StudioContext& context) { return context.session.editor().canUndo(); }});
    actions.push_back({"edit.redo", "Redo", "Edit", "Does again what was taken back", "Ctrl+Shift+Z or Ctrl+Y",
                       [](StudioContext& context) { context.session.redo(); },
                       [](StudioContext& context) { return context.session.editor().canRedo(); }});
    actions.push_back({"edit.palette", "Find command...", "Edit", "Everything that can be called, by name",
                       "Ctrl+Shift+P or Ctrl+K", [&state](StudioContext&) { state.palette.open(); }, nullptr});
    actions.push_back({"edit.preferences", "Preferences...", "Edit", "Theme, text size, speeds", "Ctrl+,",
                       [&state](StudioContext&) { state.preferencesOpen = true; }, nullptr});
}

void addTransportActions(std::vector<Action>& actions) {
    const auto add = [&](const char* id, const char* label, const char* help, const char* keys, Run run) {
        actions.push_back({id, label, "Motion", help, keys, std::move(run), nullptr});
    };
    add("transport.play", "Play or pause", "Plays the timeline's range", "Space", [](StudioContext& context) {
        if (context.session.transport().playing)
            context.session.pause();
        else
            context.session.play();
    });
    add("transport.next_frame", "Next frame", "One step of the timeline's grid", "Right",
        [](StudioContext& context) { stepFrame(context, 1.0); });
    add("transport.previous_frame", "Previous frame", "One step back", "Left",
        [](StudioContext& context) { stepFrame(context, -1.0); });
    add("transport.first_frame", "To the start", "The start of the timeline's range", "Home",
        [](StudioContext& context) { seek(context, context.document().timeline.startS); });
    add("transport.last_frame", "To the end", "The end of the timeline's range", "End",
        [](StudioContext& context) { seek(context, context.document().timeline.endS); });
}

void addWindowActions(Studio::State& state, std::vector<Action>& actions) {
    const auto add = [&](const char* id, const char* label, const char* menu, const char* help, const char* keys,
                         Run run) { actions.push_back({id, label, menu, help, keys, std::move(run), nullptr}); };
    for (const auto& panel : state.panels) {
        const std::string id = panel->id();
        // The Window menu has them with check marks; the palette and keys reach them here.
        actions.push_back({"window." + id, std::string("Show ") + panel->title(), "Window", panel->help(), "",
                           [id](StudioContext& context) { context.studio.setOpen(id, true); }, nullptr});
    }
    add("window.reset_layout", "Reset layout", "Window", "All panels back to where they were at first", "",
        [&state](StudioContext&) { state.studio.resetLayout(); });
    add("window.theme", "Switch theme", "Window", "Dark or light", "", [](StudioContext& context) {
        context.settings.theme = context.settings.theme == Theme::Dark ? Theme::Light : Theme::Dark;
    });
    add("window.larger_text", "Larger text", "Window", "Text and everything with it",
        "Ctrl+=", [](StudioContext& context) { changeTextScale(context.settings, 0.1f); });
    add("window.smaller_text", "Smaller text", "Window", "Text and everything with it", "Ctrl+-",
        [](StudioContext& context) { changeTextScale(context.settings, -0.1f); });
    add("help.shortcuts", "Shortcuts", "Help", "All keys: search them, change them", "F1 or ?",
        [&state](StudioContext&) { state.shortcuts.open(); });
    add("help.hint", "Show first hint again", "Help", "\"Drag a hand\" over the viewport", "",
        [](StudioContext& context) { context.settings.showHints = true; });
    add("help.about", "About", "Help", "Version and what it runs on", "",
        [&state](StudioContext&) { state.aboutOpen = true; });
}

} // namespace

std::vector<Action> makeActions(Studio::State& state) {
    std::vector<Action> actions;
    addFileActions(state, actions);
    addEditActions(state, actions);
    addTransportActions(actions);
    addWindowActions(state, actions);
    return actions;
}

} // namespace ars::ui
