#include "ui/studio_state.h"
#include "ui/viewport/view.h"

#include <imgui_internal.h>

#include <algorithm>

namespace ars::ui {
namespace {

/// "draft 480x360", "refining 40 %", "full 960x720".
std::string qualityText(const Frame& frame) {
    const int width = frame.inputs.camera.width, height = frame.inputs.camera.height;
    if (frame.quality == FrameQuality::Refining) {
        return fmt::format("refining {:.0f} %  {}x{}", 100.0f * frame.occlusionShare, width, height);
    }
    return fmt::format("{} {}x{}", frameQualityName(frame.quality), width, height);
}

ImVec4 qualityColor(FrameQuality quality) {
    switch (quality) {
    case FrameQuality::Draft:
        return accentColor();
    case FrameQuality::Refining:
        return mutedColor();
    case FrameQuality::Full:
        return goodColor();
    }
    return mutedColor();
}

void dot(const ImVec4& color) {
    const float size = ImGui::GetFontSize();
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    const ImVec2 center{corner.x + size * 0.3f, corner.y + ImGui::GetFrameHeight() * 0.5f};
    ImGui::GetWindowDrawList()->AddCircleFilled(center, size * 0.24f, ImGui::GetColorU32(color), 16);
    ImGui::Dummy({size * 0.6f, ImGui::GetFrameHeight()});
    ImGui::SameLine();
}

} // namespace

void Studio::State::drawStatusBar() {
    constexpr ImGuiWindowFlags kFlags = ImGuiWindowFlags_NoScrollbar | ImGuiWindowFlags_NoSavedSettings |
                                        ImGuiWindowFlags_NoDocking | ImGuiWindowFlags_NoScrollWithMouse;
    const ImGuiStyle& style = ImGui::GetStyle();
    ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, ImVec2(style.WindowPadding.x, style.FramePadding.y * 0.5f));
    ImGui::PushStyleColor(ImGuiCol_WindowBg, ImGui::GetStyleColorVec4(ImGuiCol_MenuBarBg));
    const float height = ImGui::GetFrameHeight() + style.FramePadding.y;
    if (ImGui::BeginViewportSideBar("###Status", ImGui::GetMainViewport(), ImGuiDir_Down, height, kFlags)) {
        ImGui::AlignTextToFramePadding();
        const std::shared_ptr<const Frame> frame = session.frame();
        if (frame) {
            dot(qualityColor(frame->quality));
            ImGui::AlignTextToFramePadding();
            ImGui::PushFont(fonts.monospaced, 0.0f);
            ImGui::TextUnformatted(qualityText(*frame).c_str());
            ImGui::PopFont();
            help(context, "What the viewport shows. While something moves, pictures are computed at half size with "
                          "fewer occlusion directions (draft); at rest they become full.");
            ImGui::SameLine(0, style.ItemSpacing.x * 2);
            ImGui::PushFont(fonts.monospaced, 0.0f);
            ImGui::TextColored(mutedColor(), "%.1f ms  %.0f fps", frame->totalMs,
                               session.worker().rates().framesPerSecond);
            ImGui::PopFont();
            help(context, "Time of the last frame of the avatar, and how many were finished in the last second. The "
                          "Performance panel has every stage.");
        } else {
            dot(mutedColor());
            ImGui::TextColored(mutedColor(), "no picture yet");
        }
        const std::vector<JobStatus> jobs = session.jobs();
        const float size = ImGui::GetFontSize();
        if (!jobs.empty()) {
            const JobStatus& job = jobs.front();
            ImGui::SameLine(0, style.ItemSpacing.x * 3);
            const float fraction =
                job.fraction >= 0 ? static_cast<float>(job.fraction) : -1.0f * static_cast<float>(ImGui::GetTime());
            const std::string more = jobs.size() > 1 ? fmt::format("  +{}", jobs.size() - 1) : "";
            ImGui::AlignTextToFramePadding();
            ImGui::TextUnformatted((job.title + more).c_str());
            help(context, job.what.empty() ? "Work beside the window" : job.what.c_str());
            ImGui::SameLine();
            const float barHeight = size * 0.5f;
            ImGui::SetCursorPosY(ImGui::GetCursorPosY() + (ImGui::GetFrameHeight() - barHeight) * 0.5f);
            ImGui::ProgressBar(fraction, {size * 8, barHeight}, "");
            help(context, job.what.empty() ? "Work beside the window" : job.what.c_str());
            ImGui::SameLine();
            ImGui::SetCursorPosY(style.FramePadding.y * 0.5f);
            if (job.cancellable && toolButton(icon::kClose, "Cancel. Stops this work")) session.cancel(job.id);
        }
        const std::string hint = "F1  shortcuts      Ctrl+K  find anything";
        const float width = ImGui::CalcTextSize(hint.c_str()).x;
        const float left = ImGui::GetWindowWidth() - width - style.WindowPadding.x;
        ImGui::SameLine();
        if (ImGui::GetCursorPosX() + size * 2 < left) {
            ImGui::SetCursorPosX(left);
            ImGui::AlignTextToFramePadding();
            ImGui::TextColored(mutedColor(), "%s", hint.c_str());
        }
    }
    ImGui::End();
    ImGui::PopStyleColor();
    ImGui::PopStyleVar();
}

void Studio::State::drawToasts() {
    const double now = ImGui::GetTime();
    std::erase_if(toasts, [&](const Toast& toast) { return toast.until < now; });
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    const float size = ImGui::GetFontSize();
    float bottom = viewport->WorkPos.y + viewport->WorkSize.y - size;
    for (std::size_t i = toasts.size(); i-- > 0;) {
        const Toast& toast = toasts[i];
        const float alpha = static_cast<float>(std::clamp((toast.until - now) / 0.4, 0.0, 1.0));
        ImGui::SetNextWindowPos({viewport->GetCenter().x, bottom}, ImGuiCond_Always, {0.5f, 1.0f});
        ImGui::SetNextWindowBgAlpha(0.94f * alpha);
        ImGui::PushStyleVar(ImGuiStyleVar_Alpha, alpha);
        ImGui::PushStyleColor(ImGuiCol_WindowBg, ImGui::GetStyleColorVec4(ImGuiCol_PopupBg));
        constexpr ImGuiWindowFlags kFlags = ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs |
                                            ImGuiWindowFlags_NoDocking | ImGuiWindowFlags_NoSavedSettings |
                                            ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoFocusOnAppearing;
        ImGui::Begin(fmt::format("###Toast{}", i).c_str(), nullptr, kFlags);
        ImGui::BringWindowToDisplayFront(ImGui::GetCurrentWindow());
        if (toast.kind == Notice::Kind::Done && haveIcons()) {
            ImGui::TextColored(goodColor(), "%s", icon::kCheck);
            ImGui::SameLine();
        }
        ImGui::PushTextWrapPos(std::min(size * 40, viewport->Size.x * 0.7f));
        ImGui::TextUnformatted(toast.text.c_str());
        ImGui::PopTextWrapPos();
        bottom -= ImGui::GetWindowHeight() + size * 0.4f;
        ImGui::End();
        ImGui::PopStyleColor();
        ImGui::PopStyleVar();
    }
}

/// Says what to do first, until it was done once.
void Studio::State::drawHint() {
    if (!settings.showHints) return;
    for (const Editor::HistoryLine& line : session.editor().history()) {
        if (line.commandId == "pose.drag_joint") {
            settings.showHints = false;
            return;
        }
    }
    // Beside a comparison its place belongs to the numbers.
    const ViewLayout layout = session.document().view.layout;
    if (!session.frame() || (layout != ViewLayout::Single && layout != ViewLayout::Strip)) return;
    const char* text = "Drag a hand";
    const char* more = "drag beside the body to turn the view, scroll to come closer";
    const float size = ImGui::GetFontSize();
    const ImVec2 wide = ImGui::CalcTextSize(more);
    const ImVec2 position = ImGui::GetWindowPos(), extent = ImGui::GetWindowSize();
    if (extent.x < wide.x + size * 4 || extent.y < size * 12) return;
    const ImVec2 center{position.x + extent.x * 0.5f, position.y + extent.y - size * 2.6f};
    ImDrawList& list = *ImGui::GetWindowDrawList();
    const float half = wide.x * 0.5f + size;
    list.AddRectFilled({center.x - half, center.y - size * 1.7f}, {center.x + half, center.y + size * 1.7f},
                       ImGui::GetColorU32(plateColor()), size * 0.6f);
    const ImVec2 title = ImGui::CalcTextSize(text);
    list.AddText({center.x - title.x * 0.5f, center.y - size * 1.2f}, ImGui::GetColorU32(inkColor(Ink::Text)), text);
    list.AddText({center.x - wide.x * 0.5f, center.y + size * 0.2f}, ImGui::GetColorU32(inkColor(Ink::Muted)), more);
}

} // namespace ars::ui
