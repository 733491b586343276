#include "engine/core/log.h"
#include "ui/panel.h"
#include "ui/studio.h"
#include "ui/widgets.h"

#include <fmt/format.h>

#include <algorithm>

namespace ars::ui {
namespace {

constexpr std::size_t kLogLines = 200;

/// What goes on beside the window, what the program had to say, and the end of its log.
class JobsPanel : public Panel {
public:
    const char* id() const override { return "jobs"; }
    const char* title() const override { return "Jobs"; }
    const char* help() const override { return "Work beside the window, messages, and the log"; }

    void draw(StudioContext& context) override {
        jobs(context);
        if (!ImGui::BeginTabBar("Words")) return;
        if (ImGui::BeginTabItem("Messages")) {
            messages(context);
            ImGui::EndTabItem();
        }
        if (ImGui::BeginTabItem("Log")) {
            log(context);
            ImGui::EndTabItem();
        }
        ImGui::EndTabBar();
    }

private:
    static void jobs(StudioContext& context) {
        const std::vector<JobStatus> all = context.session.jobs();
        if (all.empty()) {
            ImGui::TextColored(mutedColor(), "Nothing is going on beside the window.");
            return;
        }
        const float size = ImGui::GetFontSize();
        for (const JobStatus& job : all) {
            ImGui::PushID(static_cast<int>(job.id));
            const float fraction =
                job.fraction >= 0 ? static_cast<float>(job.fraction) : -1.0f * static_cast<float>(ImGui::GetTime());
            const std::string share = job.fraction >= 0 ? fmt::format("{:.0f} %", 100 * job.fraction) : "";
            ImGui::ProgressBar(fraction, {size * 9, 0}, share.c_str());
            ImGui::SameLine();
            if (job.cancellable && toolButton(icon::kClose, "Cancel. Stops this work")) context.session.cancel(job.id);
            if (job.cancellable) ImGui::SameLine();
            ImGui::AlignTextToFramePadding();
            ImGui::TextUnformatted(job.title.c_str());
            ImGui::SameLine();
            ImGui::TextColored(mutedColor(), "%s", job.what.c_str());
            ImGui::PopID();
        }
    }

    static ImVec4 colorOf(Notice::Kind kind) {
        switch (kind) {
        case Notice::Kind::Done:
            return goodColor();
        case Notice::Kind::Note:
            return mutedColor();
        case Notice::Kind::Error:
            return badColor();
        }
        return mutedColor();
    }

    static void messages(StudioContext& context) {
        ImGui::BeginChild("Messages");
        const std::vector<Notice>& notices = context.studio.notices();
        if (notices.empty()) ImGui::TextColored(mutedColor(), "No messages so far.");
        for (std::size_t i = notices.size(); i-- > 0;) {
            const Notice& notice = notices[i];
            const float size = ImGui::GetFontSize();
            const ImVec2 corner = ImGui::GetCursorScreenPos();
            const ImVec2 center{corner.x + size * 0.3f, corner.y + ImGui::GetTextLineHeight() * 0.5f};
            ImGui::GetWindowDrawList()->AddCircleFilled(center, size * 0.2f, ImGui::GetColorU32(colorOf(notice.kind)));
            ImGui::Dummy({size * 0.6f, ImGui::GetTextLineHeight()});
            ImGui::SameLine();
            ImGui::PushTextWrapPos(0.0f);
            ImGui::TextUnformatted(notice.title.c_str());
            ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
            if (!notice.text.empty()) ImGui::TextUnformatted(notice.text.c_str());
            if (!notice.hint.empty()) ImGui::TextUnformatted(notice.hint.c_str());
            ImGui::PopStyleColor();
            ImGui::PopTextWrapPos();
        }
        ImGui::EndChild();
    }

    void log(StudioContext& context) {
        if (iconButton(icon::kCopy, "Copy")) {
            std::string all;
            for (const LogRecord& record : recentLog()) {
                all += fmt::format("{:9.3f} {:<7} {}\n", record.timeS, logLevelName(record.level), record.text);
            }
            ImGui::SetClipboardText(all.c_str());
        }
        ars::ui::help(context, "The whole log, for a report");
        ImGui::BeginChild("Lines", {0, 0}, 0, ImGuiWindowFlags_HorizontalScrollbar);
        ImGui::PushFont(context.studio.monospaced(), 0.0f);
        const std::vector<LogRecord> records = recentLog(kLogLines);
        for (const LogRecord& record : records) {
            const ImVec4 color = record.level >= LogLevel::Error     ? badColor()
                                 : record.level == LogLevel::Warning ? accentColor()
                                                                     : mutedColor();
            ImGui::TextColored(color, "%9.3f", record.timeS);
            ImGui::SameLine();
            ImGui::TextUnformatted(record.text.c_str());
        }
        ImGui::PopFont();
        const std::uint64_t newest = records.empty() ? 0 : records.back().index;
        if (newest != seen_) ImGui::SetScrollHereY(1.0f);
        seen_ = newest;
        ImGui::EndChild();
    }

    std::uint64_t seen_ = 0; ///< newest line that was scrolled to
};

} // namespace

std::unique_ptr<Panel> makeJobsPanel() { return std::make_unique<JobsPanel>(); }

} // namespace ars::ui
