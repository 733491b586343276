#include "ui/timeline/transport_bar.h"

#include "ui/pose/joint_tree_view.h"
#include "ui/studio.h"
#include "ui/timeline/time_scale.h"
#include "ui/timeline/track_rows.h"
#include "ui/widgets.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {
namespace {

/// Puts widgets side by side and goes on below where no room is left.
class Flow {
public:
    Flow() : right_(ImGui::GetCursorScreenPos().x + ImGui::GetContentRegionAvail().x) {}
    /// Before a widget of this width, pixels.
    void next(float width, float gap) {
        if (!first_ && ImGui::GetItemRectMax().x + gap + width <= right_) ImGui::SameLine(0.0f, gap);
        first_ = false;
    }

private:
    float right_ = 0.0f;
    bool first_ = true;
};

struct Bar {
    StudioContext& context;
    const TimelineSection& timeline;
    Flow flow;
    float small = 0.0f; ///< between widgets that belong together
    float wide = 0.0f;  ///< between groups

    bool tool(const char* icon, const char* tooltip, bool active = false, bool group = false) {
        flow.next(ImGui::GetFrameHeight(), group ? wide : small);
        return toolButton(icon, tooltip, active);
    }
    /// Width for a text as wide as `sample`.
    float fieldWidth(const char* sample) const {
        return ImGui::CalcTextSize(sample).x + 2.0f * ImGui::GetStyle().FramePadding.x;
    }
    bool number(const char* id, const char* sample, double& value, float speed, const char* format, const char* tooltip,
                bool group = false) {
        const float width = fieldWidth(sample);
        flow.next(width, group ? wide : small);
        ImGui::SetNextItemWidth(width);
        const bool changed = ImGui::DragScalar(id, ImGuiDataType_Double, &value, speed, nullptr, nullptr, format);
        help(context, tooltip);
        return changed;
    }
};

void drawPlaying(Bar& bar, const std::vector<double>& keyTimes) {
    Session& session = bar.context.session;
    const double now = session.timeS();
    double found = 0.0;
    if (bar.tool(icon::kFirst, "To start")) seekFromWidget(bar.context, bar.timeline.startS);
    ImGui::BeginDisabled(!previousKeyTime(keyTimes, now, found));
    const double before = found;
    if (bar.tool(icon::kStepBack, "Previous key. Of any track")) seekFromWidget(bar.context, before);
    ImGui::EndDisabled();
    const bool playing = session.transport().playing;
    if (bar.tool(playing ? icon::kPause : icon::kPlay, playing ? "Pause (Space)" : "Play (Space)", playing)) {
        if (playing)
            session.pause();
        else
            session.play();
    }
    ImGui::BeginDisabled(!nextKeyTime(keyTimes, now, found));
    const double after = found;
    if (bar.tool(icon::kStepForward, "Next key. Of any track")) seekFromWidget(bar.context, after);
    ImGui::EndDisabled();
    if (bar.tool(icon::kLast, "To end")) seekFromWidget(bar.context, bar.timeline.endS);
    if (bar.tool(icon::kRepeat, "Loop. Starts again at the end of the range", bar.timeline.loop)) {
        runFromWidget(bar.context, "timeline.loop", {{"enabled", !bar.timeline.loop}});
    }
    if (bar.timeline.autoKey) ImGui::PushStyleColor(ImGuiCol_Button, badColor());
    const bool recording = bar.timeline.autoKey;
    if (bar.tool(icon::kRecord, "Auto key. Every edit becomes a key at the current time", false)) {
        runFromWidget(bar.context, "timeline.auto_key", {{"enabled", !recording}});
    }
    if (recording) {
        ImGui::PopStyleColor();
        const ImVec2 low = ImGui::GetItemRectMin();
        const ImVec2 high = ImGui::GetItemRectMax();
        ImGui::GetWindowDrawList()->AddCircleFilled(ImVec2(0.5f * (low.x + high.x), 0.5f * (low.y + high.y)),
                                                    5.0f * bar.context.scale, ImGui::GetColorU32(badColor()));
    }
}

void drawTime(Bar& bar) {
    const TimelineSection& timeline = bar.timeline;
    const double fps = timeline.framesPerSecond;
    double time = bar.context.session.timeS();
    if (bar.number("###Time", "00.000 s", time, static_cast<float>(0.5 / fps), "%.3f s", "Time, seconds", true)) {
        seekFromWidget(bar.context, time);
    }
    double frame = static_cast<double>(frameAt(bar.context.session.timeS(), fps));
    if (bar.number("###Frame", "frame 0000", frame, 0.25f, "frame %.0f", "Frame number, from 0 at 0 seconds")) {
        seekFromWidget(bar.context, std::round(frame) / fps);
    }
    double speed = timeline.speed;
    if (bar.number("###Speed", "0.00x", speed, 0.01f, "%.2fx", "Speed: how fast it plays; 1 is as recorded")) {
        runFromWidget(bar.context, "timeline.speed", {{"factor", speed}});
    }
    double start = timeline.startS;
    double end = timeline.endS;
    const bool moved =
        bar.number("###Range start", "00.00 s", start, 0.02f, "%.2f s", "Start of the range that plays", true);
    if (moved)
        runFromWidget(bar.context, "timeline.range", {{"start", std::min(start, end - 1.0 / fps)}, {"end", end}});
    if (bar.number("###Range end", "00.00 s", end, 0.02f, "%.2f s", "End of the range that plays")) {
        runFromWidget(bar.context, "timeline.range",
                      {{"start", timeline.startS}, {"end", std::max(end, timeline.startS + 1.0 / fps)}});
    }
    double rate = fps;
    if (bar.number("###Rate", "00.0 fps", rate, 0.1f, "%.4g fps", "Frames per second of keys and films")) {
        runFromWidget(bar.context, "timeline.rate", {{"fps", rate}});
    }
}

void keyMenu(StudioContext& context) {
    const auto item = [&](const char* label, const std::string& track, bool enabled = true) {
        if (ImGui::MenuItem(label, nullptr, false, enabled)) runFromWidget(context, "timeline.key", {{"track", track}});
    };
    const PoseReading reading = readPose(context);
    item("Pose", "pose");
    const std::string joint =
        reading.selected < 0 ? "Selected joint" : "Joint " + friendlyName(reading.name(reading.selected));
    item((joint + "###Selected joint").c_str(), reading.selected < 0 ? "" : "joint:" + reading.name(reading.selected),
         reading.selected >= 0);
    item("Root", "root");
    item("Expression", "expression");
    ImGui::Separator();
    item("Camera", "camera");
    item("Light rotation", "light_rotation");
    item("Light exposure", "light_exposure");
    if (ImGui::BeginMenu("Radius of")) {
        for (int part = 0; part < kBodyPartCount; ++part) {
            const std::string name(bodyPartName(static_cast<BodyPart>(part)));
            item(friendlyName(name).c_str(), "radius:" + name);
        }
        ImGui::EndMenu();
    }
    ImGui::Separator();
    item("Everything", "all");
}

void drawKeys(Bar& bar) {
    StudioContext& context = bar.context;
    if (bar.tool(icon::kKeyAdd, "Key pose. Keeps the pose on the screen as keys at the current time", false, true)) {
        runFromWidget(context, "timeline.key", {{"track", "pose"}});
    }
    bar.flow.next(ImGui::GetFrameHeight(), 0.0f);
    if (toolButton(icon::kChevronDown, "Key other. Camera, light, radii, single joints")) ImGui::OpenPopup("keys");
    if (ImGui::BeginPopup("keys")) {
        keyMenu(context);
        ImGui::EndPopup();
    }
    if (bar.tool(icon::kImport, "Open motion. A motion file becomes the clip", false, true)) {
        context.studio.invoke("file.open_motion");
    }
    if (bar.tool(icon::kExport, "Export motion. As SMPL-X numbers, BVH or glTF")) ImGui::OpenPopup("export");
    if (ImGui::BeginPopup("export")) {
        if (ImGui::MenuItem("Motion, SMPL-X numbers...")) context.studio.invoke("file.export_motion");
        if (ImGui::MenuItem("Motion, BVH...")) context.studio.invoke("file.export_bvh");
        if (ImGui::MenuItem("This pose, SMPL-X numbers...")) context.studio.invoke("file.export_pose");
        if (ImGui::MenuItem("This pose, glTF mesh...")) context.studio.invoke("file.export_gltf");
        ImGui::EndPopup();
    }
}

} // namespace

void seekFromWidget(StudioContext& context, double timeS) {
    if (context.session.transport().playing) context.session.pause();
    runFromWidget(context, "timeline.seek", {{"time", timeS}});
}

void drawTransportBar(StudioContext& context, const std::vector<double>& keyTimes) {
    Bar bar{context, context.document().timeline, Flow(), 3.0f * context.scale, 12.0f * context.scale};
    drawPlaying(bar, keyTimes);
    drawTime(bar);
    drawKeys(bar);
}

} // namespace ars::ui
