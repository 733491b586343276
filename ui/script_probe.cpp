#include "ui/script_probe.h"

#include "engine/core/file.h"
#include "engine/scene/evaluate.h"

#include <nlohmann/json.hpp>

#include <imgui.h>
#include <imgui_internal.h>

#ifdef ARS_UI_TESTS
#include <imgui_te_context.h>
#include <imgui_te_engine.h>
#include <imgui_te_internal.h>
#include <imgui_te_utils.h>
#endif

#include <map>
#include <optional>
#include <string>

namespace ars::ui {

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Frames that a widget is looked for: the engine learns of it when it is drawn next, folded ones never are.
constexpr int kFramesOfSearch = 4;

Json rectangle(const ImRect& rect) { return Json::array({rect.Min.x, rect.Min.y, rect.GetWidth(), rect.GetHeight()}); }

Json windowsJson() {
    Json windows = Json::object();
    for (const ImGuiWindow* window : GImGui->Windows) {
        if (!window->WasActive || window->Hidden) continue;
        windows[window->Name] = rectangle(window->Rect());
    }
    return windows;
}

Json frameJson(const Session& session) {
    const std::shared_ptr<const Frame> frame = session.frame();
    if (!frame) return nullptr;
    return Json{{"request", frame->request},
                {"quality", frameQualityName(frame->quality)},
                {"share", frame->occlusionShare},
                {"width", frame->inputs.camera.width},
                {"height", frame->inputs.camera.height},
                {"ms", frame->totalMs}};
}

/// Joints of the frame in the unit square of its picture, by name.
Json jointsJson(const Session& session) {
    Json joints = Json::object();
    const std::shared_ptr<const Frame> frame = session.frame();
    if (!frame || !frame->avatar) return joints;
    const Skeleton& skeleton = frame->avatar->evaluator->rig().skeleton;
    const Camera& camera = frame->inputs.camera;
    for (std::size_t j = 0; j < frame->jointWorld.size() && j < skeleton.names.size(); ++j) {
        const glm::dvec3 world(frame->jointWorld[j][3]);
        const glm::dvec3 view = camera.rotation * world + camera.translation;
        if (!(view.z > 0.0)) continue;
        joints[skeleton.names[j]] = Json::array({(camera.fx * view.x / view.z + camera.cx) / camera.width,
                                                 (camera.fy * view.y / view.z + camera.cy) / camera.height});
    }
    return joints;
}

/// How many events of pointer and keyboard have come, and how many of them the widgets have seen.
Json inputJson() {
    const ImGuiContext& context = *GImGui;
    const ImU32 given = context.InputEventsNextEventId - 1; // they count from 1
    const bool none = context.InputEventsQueue.empty();
    return Json{{"given", given}, {"taken", none ? given : context.InputEventsQueue.front().EventId - 1}};
}

} // namespace

struct ScriptProbe::State {
    fs::path folder;
    void* engine = nullptr;
    std::optional<Json> question;
    int framesLeft = 0;
    std::uint64_t answered = 0;
    std::map<std::string, ImGuiID> found; ///< of this question's paths with "**"
    std::string searched;                 ///< the one that the engine is looking for
    int searchFrames = 0;

#ifdef ARS_UI_TESTS
    ImGuiTestEngine* testEngine() const { return static_cast<ImGuiTestEngine*>(engine); }

    /// Looks for the path "//WINDOW/**/LABEL" while the next frames are drawn. False while it is under way.
    bool search(const std::string& path) {
        ImGuiTestFindByLabelTask& task = testEngine()->FindByLabelTask;
        const std::size_t stars = path.find("/**/");
        if (searched != path) {
            searched = path;
            searchFrames = kFramesOfSearch;
            task = ImGuiTestFindByLabelTask();
            task.InPrefixId = ImHashDecoratedPath(path.c_str(), path.c_str() + stars, 0);
            task.InSuffix = task.InSuffixLastItem = searched.c_str() + stars + 4;
            task.InSuffixDepth = 1;
            task.InSuffixLastItemHash = ImHashDecoratedPath(task.InSuffixLastItem, nullptr, 0);
            return false;
        }
        if (task.OutItemId == 0 && --searchFrames > 0) return false;
        found[path] = task.OutItemId;
        task = ImGuiTestFindByLabelTask();
        searched.clear();
        return true;
    }

    /// The widget's identity; nothing while it is looked for.
    std::optional<ImGuiID> identityOf(const std::string& path) {
        if (path.find("/**/") == std::string::npos) return ImHashDecoratedPath(path.c_str());
        const auto known = found.find(path);
        if (known != found.end()) return known->second;
        if (!search(path)) return std::nullopt;
        return found[path];
    }

    /// Rectangles of the widgets asked for; nothing while one is looked for.
    std::optional<Json> itemsJson(bool& missing) {
        Json items = Json::object();
        missing = false;
        for (const Json& path : question->value("items", Json::array())) {
            const std::string text = path.get<std::string>();
            items[text] = nullptr;
            if (!engine) continue;
            const std::optional<ImGuiID> id = identityOf(text);
            if (!id) return std::nullopt;
            if (*id == 0) continue;
            const ImGuiTestItemInfo* info = ImGuiTestEngine_FindItemInfo(testEngine(), *id, text.c_str());
            if (info && info->ID != 0) {
                items[text] = rectangle(info->RectClipped.GetArea() > 0 ? info->RectClipped : info->RectFull);
            } else {
                missing = true;
            }
        }
        return items;
    }
#else
    std::optional<Json> itemsJson(bool& missing) {
        missing = false;
        Json items = Json::object();
        for (const Json& path : question->value("items", Json::array())) items[path.get<std::string>()] = nullptr;
        return items;
    }
#endif

    void read() {
        const fs::path file = folder / "ask.json";
        std::error_code code;
        if (!fs::exists(file, code)) return;
        auto text = readTextFile(file);
        if (!text) return;
        Json json = Json::parse(*text, nullptr, false);
        if (json.is_discarded() || json.value("number", std::uint64_t{0}) == answered) return;
        question = std::move(json);
        framesLeft = kFramesOfSearch;
        found.clear();
    }
};

ScriptProbe::ScriptProbe(fs::path folder, void* testEngine) : state_(std::make_unique<State>()) {
    state_->folder = std::move(folder);
    state_->engine = testEngine;
}

ScriptProbe::~ScriptProbe() = default;

bool ScriptProbe::busy() const { return state_->question.has_value(); }

void ScriptProbe::update(Session& session) {
    State& state = *state_;
    if (!state.question) state.read();
    if (!state.question) return;
    bool missing = false;
    std::optional<Json> items = state.itemsJson(missing);
    if (!items || (missing && --state.framesLeft > 0)) return;

    Json answer{{"number", state.question->value("number", std::uint64_t{0})},
                {"items", std::move(*items)},
                {"windows", windowsJson()},
                {"joints", jointsJson(session)},
                {"frame", frameJson(session)},
                {"settled", session.settled()},
                {"input", inputJson()},
                {"undo", session.editor().undoLabel()},
                {"redo", session.editor().redoLabel()},
                {"history", session.editor().history().size()}};
    if (state.question->value("document", false)) answer["document"] = documentToJson(session.document());
    state.answered = answer["number"];
    state.question.reset();
    if (const Status written = writeFileAtomic(state.folder / "answer.json", answer.dump()); !written) {
        session.notify({Notice::Kind::Error, "Could not answer a script", written.error().describe(), {}});
    }
}

} // namespace ars::ui
