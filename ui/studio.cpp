#include "ui/studio.h"

#include "ui/studio_state.h"

#include <imgui_internal.h>

#include <algorithm>

namespace ars::ui {

Studio::State::State(Studio& owner, Session& s, Settings& given)
    : studio(owner), session(s), settings(given), context{s, given, owner, 1.0f}, fonts(loadFonts()),
      panels(makePanels()), recoveries(s.recoveries()) {
    actions = makeActions(*this);
    layoutWanted = settings.layout.empty();
    if (!layoutWanted) ImGui::LoadIniSettingsFromMemory(settings.layout.c_str(), settings.layout.size());
}

void Studio::State::setScale(float scale) {
    const float total = scale * settings.textScale;
    if (total == appliedScale && settings.theme == appliedTheme) return;
    appliedScale = total;
    appliedTheme = settings.theme;
    context.scale = total;
    if (!layoutWanted && settings.layoutScale != total) scaleLayout(total / settings.layoutScale);
    settings.layoutScale = total;
    applyTheme(settings.theme, total);
}

Panel* Studio::State::find(const std::string& id) {
    for (const auto& panel : panels) {
        if (id == panel->id()) return panel.get();
    }
    return nullptr;
}

void Studio::State::drawPanels() {
    for (const auto& panel : panels) {
        if (!studio.isOpen(panel->id())) continue;
        bool open = true, close = false;
        const float size = ImGui::GetFontSize();
        ImGui::SetNextWindowSize({size * 24, size * 28}, ImGuiCond_FirstUseEver);
        ImGui::SetNextWindowSizeConstraints({size * 8, size * 4}, {FLT_MAX, FLT_MAX});
        if (!panel->padded()) ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(0, 0));
        if (frontPanel == panel->id()) ImGui::SetNextWindowFocus();
        // Tabs without close buttons leave room for their names; a right click closes them.
        const ImGuiWindow* known = ImGui::FindWindowByName(panel->title());
        const bool docked = known && known->DockIsActive;
        const bool visible = ImGui::Begin(panel->title(), docked ? nullptr : &open,
                                          ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoFocusOnAppearing);
        if (!panel->padded()) ImGui::PopStyleVar();
        if (docked && ImGui::BeginPopupContextItem("Tab")) {
            close = ImGui::MenuItem("Close");
            ImGui::EndPopup();
        } else if (docked) {
            help(context, panel->help());
        }
        if (visible) panel->draw(context);
        if (visible && std::string_view(panel->id()) == "viewport") drawHint();
        ImGui::End();
        if (!open || close) studio.setOpen(panel->id(), false);
    }
    frontPanel.clear();
}

void Studio::State::takeNotices() {
    for (Notice& notice : session.takeNotices()) {
        if (notice.kind == Notice::Kind::Error) {
            errors.push_back(notice);
        } else {
            const std::string text = notice.title.empty() ? notice.text : notice.title;
            toasts.push_back({text, notice.kind, ImGui::GetTime() + 4.0});
        }
        notices.push_back(std::move(notice));
    }
    constexpr std::size_t kKept = 200;
    if (notices.size() > kKept) notices.erase(notices.begin(), notices.end() - kKept);
}

void Studio::State::draw(float scale) {
    setScale(scale);
    takeNotices();
    checkSaved();
    if (!shortcuts.recording() && !palette.isOpen()) {
        if (const std::string called = pressedShortcut(actions, settings); !called.empty()) invoke(called);
    }
    beginWidgets(context);
    drawMenuBar();
    drawStatusBar();
    drawDockSpace();
    drawPanels();
    endWidgets(context);
    palette.draw(context);
    shortcuts.draw(context);
    drawDialogs();
    chooser.draw(context);
    drawToasts();
    keepLayout();
}

void Studio::State::invoke(const std::string& id) {
    for (const Action& action : actions) {
        if (action.id != id) continue;
        if (!action.enabled || action.enabled(context)) action.run(context);
        return;
    }
    const CommandVariant* variant = findVariant(id);
    const std::string commandId = variant ? id.substr(0, id.find('/')) : id;
    const Command* command = findCommand(commandId);
    if (!command) {
        studio.showError("Nothing is called like that", fmt::format("There is no command or action \"{}\".", id));
        return;
    }
    const bool asks = std::any_of(command->arguments.begin(), command->arguments.end(),
                                  [](const CommandArgument& argument) { return argument.required; });
    if (asks && !variant) {
        palette.openFor(*command);
        return;
    }
    const Status status = session.run(commandId, variant ? variant->arguments : Arguments::object());
    const std::string& label = variant ? variant->label : command->label;
    if (!status) studio.showError(fmt::format("{} is not possible", label), status.error().describe());
}

Studio::Studio(Session& session, Settings& settings) : state_(std::make_unique<State>(*this, session, settings)) {}
Studio::~Studio() = default;

void Studio::draw(float scale) { state_->draw(scale); }

void Studio::drop(const std::vector<std::filesystem::path>& files) {
    for (const std::filesystem::path& file : files) state_->open(file);
}

void Studio::ask(FileQuestion question) { state_->chooser.ask(state_->context, std::move(question)); }

void Studio::showError(const std::string& title, const std::string& text, const std::string& hint) {
    const Notice notice{Notice::Kind::Error, title, text, hint};
    state_->errors.push_back(notice);
    state_->notices.push_back(notice);
}

void Studio::toast(const std::string& text) {
    const double until = ImGui::GetTime() + 4.0;
    for (State::Toast& shown : state_->toasts) {
        if (shown.text != text) continue;
        shown.until = until; // a drag against a limit says it once
        return;
    }
    state_->toasts.push_back({text, Notice::Kind::Note, until});
    state_->notices.push_back({Notice::Kind::Note, text, {}, {}});
}

void Studio::openPalette() { state_->palette.open(); }
void Studio::invoke(const std::string& id) { state_->invoke(id); }
const std::vector<Action>& Studio::actions() const { return state_->actions; }
Panel* Studio::panel(const std::string& id) { return state_->find(id); }

bool Studio::isOpen(const std::string& panelId) const {
    const auto known = state_->settings.panels.find(panelId);
    if (known != state_->settings.panels.end()) return known->second;
    const Panel* panel = state_->find(panelId);
    return panel && panel->openByDefault();
}

void Studio::setOpen(const std::string& panelId, bool open) {
    state_->settings.panels[panelId] = open;
    if (open) state_->frontPanel = panelId;
}

void Studio::resetLayout() {
    state_->settings.panels.clear();
    state_->layoutWanted = true;
}

void Studio::rememberLayout() {
    if (state_->layoutWanted) return; // nothing was drawn since the start or the last reset
    ImGui::GetIO().WantSaveIniSettings = true;
    state_->keepLayout();
}

bool Studio::quit() const { return state_->quit; }

void Studio::requestQuit() {
    state_->guardUnsaved("Quit", [this] { state_->quit = true; });
}

const std::vector<Notice>& Studio::notices() const { return state_->notices; }
WindowTimings& Studio::timings() { return state_->timings; }

bool Studio::animating() const {
    return !state_->toasts.empty() || !state_->session.jobs().empty() || state_->chooser.isOpen() ||
           state_->afterSave != nullptr;
}

ImFont* Studio::monospaced() const { return state_->fonts.monospaced; }
ImFont* Studio::icons() const { return state_->fonts.icons ? state_->fonts.text : nullptr; }

} // namespace ars::ui
