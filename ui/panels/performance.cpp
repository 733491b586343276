#include "engine/core/buffer.h"
#include "ui/panel.h"
#include "ui/studio.h"
#include "ui/widgets.h"
#include "ui/window_timings.h"

#include <fmt/format.h>
#include <implot.h>

#include <algorithm>

namespace ars::ui {
namespace {

/// Where the time of a frame goes and who holds memory: the names and numbers that benchmarks print.
class PerformancePanel : public Panel {
public:
    const char* id() const override { return "performance"; }
    const char* title() const override { return "Performance"; }
    const char* help() const override { return "Time of every stage, window frame times, and memory"; }

    void draw(StudioContext& context) override {
        const float size = ImGui::GetFontSize();
        // Side by side where it lies below the viewport, one under the other in a narrow column.
        const float available = ImGui::GetContentRegionAvail().x;
        const bool wide = available > size * 56;
        const float width = wide ? (available - 2 * ImGui::GetStyle().ItemSpacing.x) / 3 : 0.0f;
        const auto column = [&](const char* name, auto&& content) {
            ImGui::BeginChild(name, {width, 0}, wide ? 0 : ImGuiChildFlags_AutoResizeY);
            content();
            ImGui::EndChild();
            if (wide) ImGui::SameLine();
        };
        column("Stages", [&] { stages(context); });
        column("Window", [&] { window(context); });
        column("Memory", [&] { memory(context); });
        ImGui::NewLine();
    }

private:
    static void number(StudioContext& context, const std::string& text, bool muted = false) {
        ImGui::TableNextColumn();
        ImGui::PushFont(context.studio.monospaced(), 0.0f);
        const float wide = ImGui::CalcTextSize(text.c_str()).x;
        ImGui::SetCursorPosX(ImGui::GetCursorPosX() + std::max(0.0f, ImGui::GetContentRegionAvail().x - wide));
        if (muted)
            ImGui::TextColored(mutedColor(), "%s", text.c_str());
        else
            ImGui::TextUnformatted(text.c_str());
        ImGui::PopFont();
    }

    static void name(const char* text, bool muted = false) {
        ImGui::TableNextRow();
        ImGui::TableNextColumn();
        if (muted)
            ImGui::TextColored(mutedColor(), "%s", text);
        else
            ImGui::TextUnformatted(text);
    }

    static void stages(StudioContext& context) {
        heading("Frame");
        const std::shared_ptr<const Frame> frame = context.session.frame();
        if (!frame) {
            ImGui::TextColored(mutedColor(), "No frame yet.");
            return;
        }
        const float size = ImGui::GetFontSize();
        if (!ImGui::BeginTable("Stages", 3, ImGuiTableFlags_RowBg)) return;
        ImGui::TableSetupColumn("Stage", ImGuiTableColumnFlags_WidthStretch);
        ImGui::TableSetupColumn("ms", ImGuiTableColumnFlags_WidthFixed, size * 4.5f);
        ImGui::TableSetupColumn("runs", ImGuiTableColumnFlags_WidthFixed, size * 4.5f);
        ImGui::TableHeadersRow();
        for (const StageReport& stage : frame->stages) {
            const std::string label(frameStageName(stage.stage));
            name(label.c_str(), !stage.ran);
            ars::ui::help(context, stage.ran ? "Ran for this frame" : "Its last result still held for this frame");
            number(context, fmt::format("{:.2f}", stage.milliseconds), !stage.ran);
            number(context, fmt::format("{}", stage.runs), true);
        }
        name("copy");
        ars::ui::help(context, "Bringing the pictures to host memory and to the viewport");
        number(context, fmt::format("{:.2f}", frame->copyMs));
        number(context, "");
        name("total");
        number(context, fmt::format("{:.2f}", frame->totalMs));
        number(context, "");
        ImGui::EndTable();
        const FrameWorker::Rates rates = context.session.worker().rates();
        numberText(context, fmt::format("{} {}x{}", frameQualityName(frame->quality), frame->inputs.camera.width,
                                        frame->inputs.camera.height)
                                .c_str());
        numberText(context, fmt::format("{:.1f} frames/s, {} in all", rates.framesPerSecond, rates.frames).c_str());
        numberText(context, fmt::format("on {}", deviceName(context.session.worker().device())).c_str());
        if (frame->avatar) {
            const std::string avatar = frame->avatar->evaluator->description();
            ImGui::PushStyleColor(ImGuiCol_Text, mutedColor());
            ImGui::TextWrapped("%s", avatar.c_str());
            ImGui::PopStyleColor();
        }
    }

    void window(StudioContext& context) {
        heading("Window");
        WindowTimings& timings = context.studio.timings();
        const std::vector<float> recent = timings.recentMs();
        const float size = ImGui::GetFontSize();
        // Counting through all frames costs something: twice a second is enough to read.
        if (const double now = ImGui::GetTime(); now - counted_ > 0.5) {
            counted_ = now;
            median_ = timings.percentileMs(0.5);
            slow_ = timings.percentileMs(0.99);
        }
        numberText(context, fmt::format("{:.1f} ms median, {:.1f} ms in 99 %", median_, slow_).c_str());
        numberText(context,
                   fmt::format("longest {:.1f} ms, {} frames", timings.longest().totalMs(), timings.frames()).c_str());
        ars::ui::help(context, "Longest time for which the window could not answer");
        ImGui::SameLine();
        if (ImGui::SmallButton("Reset")) timings.clear();
        ars::ui::help(context, "Begins counting anew");
        constexpr ImPlotFlags kFlags = ImPlotFlags_CanvasOnly | ImPlotFlags_NoInputs;
        const float height = std::max(size * 5, std::min(ImGui::GetContentRegionAvail().y, size * 12));
        if (recent.empty() || !ImPlot::BeginPlot("###Times", {-1, height}, kFlags)) return;
        const float top = std::max(20.0f, 1.1f * *std::max_element(recent.begin(), recent.end()));
        ImPlot::SetupAxes(nullptr, "ms", ImPlotAxisFlags_NoDecorations, ImPlotAxisFlags_NoGridLines);
        ImPlot::SetupAxesLimits(0, 240, 0, top, ImPlotCond_Always);
        ImPlot::PlotShaded("frame", recent.data(), static_cast<int>(recent.size()), 0.0, 1.0, 0.0,
                           {ImPlotProp_FillColor, accentColor(), ImPlotProp_FillAlpha, 0.35f});
        ImPlot::PlotLine("frame", recent.data(), static_cast<int>(recent.size()), 1.0, 0.0,
                         {ImPlotProp_LineColor, accentColor()});
        ImPlot::EndPlot();
    }

    void memory(StudioContext& context) {
        heading("Memory");
        if (const double now = ImGui::GetTime(); now - asked_ > 0.5) {
            asked_ = now;
            uses_ = memoryUse();
            const Result<MemoryInfo> info = deviceMemory(context.session.worker().device());
            free_ = info ? fmt::format("{} of {} free on {}", formatBytes(info->freeBytes),
                                       formatBytes(info->totalBytes), deviceName(context.session.worker().device()))
                         : std::string();
        }
        numberText(context, free_.c_str());
        const float size = ImGui::GetFontSize();
        if (!ImGui::BeginTable("Memory", 3, ImGuiTableFlags_RowBg)) return;
        ImGui::TableSetupColumn("Owner", ImGuiTableColumnFlags_WidthStretch);
        ImGui::TableSetupColumn("now", ImGuiTableColumnFlags_WidthFixed, size * 5.5f);
        ImGui::TableSetupColumn("peak", ImGuiTableColumnFlags_WidthFixed, size * 5.5f);
        ImGui::TableHeadersRow();
        for (const MemoryUse& use : uses_) {
            const std::string owner = use.device.kind == DeviceKind::Host
                                          ? use.owner
                                          : fmt::format("{} ({})", use.owner, deviceName(use.device));
            name(owner.c_str(), use.bytes == 0);
            number(context, formatBytes(use.bytes), use.bytes == 0);
            number(context, formatBytes(use.peakBytes), true);
        }
        ImGui::EndTable();
    }

    std::vector<MemoryUse> uses_;
    std::string free_;
    double asked_ = -1.0, counted_ = -1.0;
    float median_ = 0.0f, slow_ = 0.0f;
};

} // namespace

std::unique_ptr<Panel> makePerformancePanel() { return std::make_unique<PerformancePanel>(); }

} // namespace ars::ui
