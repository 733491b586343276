#include "ui/studio_state.h"

#include "engine/core/log.h"

#include <imgui_internal.h>

#include <algorithm>
#include <ctime>

namespace ars::ui {
namespace {

/// A modal window in the middle that is as wide as reads well.
bool beginDialog(const char* title, float widthLetters) {
    if (!ImGui::IsPopupOpen(title)) ImGui::OpenPopup(title);
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    const float width = std::min(ImGui::GetFontSize() * widthLetters, viewport->Size.x * 0.92f);
    ImGui::SetNextWindowPos(viewport->GetCenter(), ImGuiCond_Always, {0.5f, 0.5f});
    ImGui::SetNextWindowSize({width, 0}, ImGuiCond_Always);
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(ImGui::GetFontSize() * 1.1f, ImGui::GetFontSize()));
    constexpr ImGuiWindowFlags kFlags = ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoCollapse |
                                        ImGuiWindowFlags_NoMove | ImGuiWindowFlags_NoSavedSettings;
    const bool open = ImGui::BeginPopupModal(title, nullptr, kFlags);
    ImGui::PopStyleVar();
    return open;
}

void endDialog(bool done) {
    if (done) ImGui::CloseCurrentPopup();
    ImGui::EndPopup();
}

/// Places `count` buttons of one width at the right end of the line.
float beginButtons(int count) {
    const float width = ImGui::GetFontSize() * 7.5f;
    const float all =
        width * static_cast<float>(count) + ImGui::GetStyle().ItemSpacing.x * static_cast<float>(count - 1);
    ImGui::Dummy({0, ImGui::GetFontSize() * 0.4f});
    ImGui::SetCursorPosX(std::max(ImGui::GetCursorPosX(), ImGui::GetContentRegionMax().x - all));
    return width;
}

bool primaryButton(const char* label, float width) {
    ImGui::PushStyleColor(ImGuiCol_Text, accentColor());
    const bool pressed = ImGui::Button(label, {width, 0});
    ImGui::PopStyleColor();
    return pressed;
}

bool escapePressed() { return ImGui::IsKeyPressed(ImGuiKey_Escape, false); }
bool enterPressed() { return ImGui::IsKeyPressed(ImGuiKey_Enter, false); }

std::string timeText(std::chrono::system_clock::time_point time) {
    const std::time_t seconds = std::chrono::system_clock::to_time_t(time);
    std::tm local{};
    localtime_r(&seconds, &local);
    char text[32];
    return std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M", &local) ? text : "";
}

} // namespace

bool Studio::State::dialogOpen() const { return !errors.empty() || unsavedBefore || !recoveries.empty() || aboutOpen; }

void Studio::State::drawDialogs() {
    // One at a time, the one that must be answered first.
    if (!errors.empty())
        drawErrors();
    else if (unsavedBefore)
        drawUnsaved();
    else if (!recoveries.empty())
        drawRecovery();
    else if (aboutOpen)
        drawAbout();
    drawPreferences();
}

void Studio::State::drawErrors() {
    const Notice& notice = errors.front();
    const std::string title = (notice.title.empty() ? "Something went wrong" : notice.title) + "###Error";
    if (!beginDialog(title.c_str(), 34)) return;
    ImGui::PushTextWrapPos(0.0f);
    ImGui::TextUnformatted(notice.text.c_str());
    if (!notice.hint.empty()) {
        ImGui::Dummy({0, ImGui::GetFontSize() * 0.2f});
        ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
        ImGui::TextUnformatted(notice.hint.c_str());
        ImGui::PopStyleColor();
    }
    if (errors.size() > 1) ImGui::TextColored(mutedColor(), "%zu more after this", errors.size() - 1);
    ImGui::PopTextWrapPos();
    const float width = beginButtons(2);
    if (ImGui::Button("Copy", {width, 0})) {
        const std::string all =
            fmt::format("{}\n{}{}{}", notice.title, notice.text, notice.hint.empty() ? "" : "\n", notice.hint);
        ImGui::SetClipboardText(all.c_str());
    }
    help(context, "Puts the text on the clipboard");
    ImGui::SameLine();
    const bool done = primaryButton("OK", width) || escapePressed() || enterPressed();
    if (done) errors.pop_front();
    endDialog(done);
}

void Studio::State::guardUnsaved(const std::string& before, std::function<void()> then) {
    if (!session.editor().modified()) {
        then();
        return;
    }
    unsavedBefore = before;
    afterUnsaved = std::move(then);
}

void Studio::State::drawUnsaved() {
    if (!beginDialog("Unsaved changes###Unsaved", 32)) return;
    const std::filesystem::path& path = session.projectPath();
    ImGui::TextWrapped("%s has changes that are not saved.", path.empty() ? "This project" : path.filename().c_str());
    ImGui::TextColored(mutedColor(), "%s", unsavedBefore->c_str());
    const float width = beginButtons(3);
    bool done = ImGui::Button("Cancel", {width, 0}) || escapePressed();
    std::function<void()> next;
    ImGui::SameLine();
    if (ImGui::Button("Discard", {width, 0})) {
        next = afterUnsaved;
        done = true;
    }
    help(context, "Goes on without saving; the changes are lost");
    ImGui::SameLine();
    if (primaryButton("Save", width)) {
        next = [this, then = afterUnsaved] { save(then); };
        done = true;
    }
    if (done) {
        unsavedBefore.reset();
        afterUnsaved = nullptr;
    }
    endDialog(done);
    if (next) next();
}

void Studio::State::drawRecovery() {
    if (!beginDialog("Restore unsaved work###Recovery", 38)) return;
    const Recovery& recovery = recoveries.front();
    const std::string name = recovery.project.empty() ? "an unnamed project" : recovery.project.filename().string();
    ImGui::TextWrapped("The program ended before %s was saved. Its state of %s was kept.", name.c_str(),
                       timeText(recovery.saved).c_str());
    if (recoveries.size() > 1) ImGui::TextColored(mutedColor(), "%zu more after this", recoveries.size() - 1);
    const float width = beginButtons(3);
    bool done = ImGui::Button("Later", {width, 0});
    help(context, "Asks again at the next start");
    const bool later = done;
    ImGui::SameLine();
    const bool discard = ImGui::Button("Discard", {width, 0});
    ImGui::SameLine();
    const bool restore = primaryButton("Restore", width);
    done = done || discard || restore;
    if (done) {
        const Recovery taken = recovery;
        recoveries.erase(recoveries.begin());
        if (restore) {
            session.replaceDocument(taken.document, taken.project);
            toasts.push_back({"Restored. Save it to keep it.", Notice::Kind::Done, ImGui::GetTime() + 5.0});
        }
        if (!later) discardRecovery(taken);
    }
    endDialog(done);
}

void Studio::State::drawPreferences() {
    if (!preferencesOpen) return;
    const float size = ImGui::GetFontSize();
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    ImGui::SetNextWindowPos(viewport->GetCenter(), ImGuiCond_Appearing, {0.5f, 0.5f});
    ImGui::SetNextWindowSize({size * 28, 0}, ImGuiCond_Always);
    if (ImGui::Begin("Preferences", &preferencesOpen,
                     ImGuiWindowFlags_NoDocking | ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoSavedSettings)) {
        heading("Appearance");
        rowLabel("Theme", "Dark or light");
        int theme = settings.theme == Theme::Dark ? 0 : 1;
        if (ImGui::Combo("###Theme", &theme, "Dark\0Light\0")) settings.theme = theme == 0 ? Theme::Dark : Theme::Light;
        rowLabel("Text size", "On top of the display's own scale");
        if (editedTextScale == 0.0f) editedTextScale = settings.textScale;
        ImGui::SliderFloat("###Text size", &editedTextScale, 0.5f, 3.0f, "%.2f x", ImGuiSliderFlags_AlwaysClamp);
        // Taken over when let go: the slider would move away under the hand.
        if (ImGui::IsItemDeactivatedAfterEdit()) settings.textScale = editedTextScale;
        if (!ImGui::IsItemActive()) editedTextScale = 0.0f;
        rowLabel("Tooltips", "Explanations like this one");
        ImGui::Checkbox("###Tooltips", &settings.tooltips);
        rowLabel("First hint", "\"Drag a hand\" over the viewport until it was done once");
        ImGui::Checkbox("###First hint", &settings.showHints);
        heading("Viewport");
        rowLabel("Orbit speed", "How far the view turns when dragged");
        ImGui::SliderFloat("###Orbit speed", &settings.orbitSpeed, 0.1f, 5.0f, "%.2f x", ImGuiSliderFlags_AlwaysClamp);
        rowLabel("Fly speed", "How fast the camera flies with the keys");
        ImGui::SliderFloat("###Fly speed", &settings.flySpeed, 0.1f, 10.0f, "%.1f m/s", ImGuiSliderFlags_AlwaysClamp);
        rowLabel("Invert zoom", "Scrolling up goes away from the body");
        ImGui::Checkbox("###Invert zoom", &settings.invertZoom);
        heading("Files");
        rowLabel("Autosave", "Keeps the project every few seconds for the case of a crash; from the next start on");
        ImGui::Checkbox("###Autosave", &settings.autosave);
        const float width = beginButtons(2);
        if (ImGui::Button("Shortcuts", {width, 0})) shortcuts.open();
        ImGui::SameLine();
        if (ImGui::Button("Close", {width, 0})) preferencesOpen = false;
    }
    if (ImGui::IsWindowFocused(ImGuiFocusedFlags_RootAndChildWindows) && escapePressed()) preferencesOpen = false;
    ImGui::End();
}

void Studio::State::drawAbout() {
    if (!beginDialog("About###About", 30)) return;
    ImGui::Text("ARS Studio %s", ARS_VERSION);
    ImGui::TextWrapped("Animatable, relightable avatars of Gaussian surfels.");
    ImGui::Dummy({0, ImGui::GetFontSize() * 0.3f});
    ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
    ImGui::TextWrapped("Frames are computed on %s.", deviceName(session.worker().device()).c_str());
    ImGui::TextWrapped("Dear ImGui %s. The licences of all parts are in THIRD_PARTY.md.", IMGUI_VERSION);
    ImGui::PopStyleColor();
    const float width = beginButtons(1);
    const bool done = primaryButton("Close", width) || escapePressed();
    if (done) aboutOpen = false;
    endDialog(done);
}

} // namespace ars::ui
