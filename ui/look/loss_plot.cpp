#include "ui/look/loss_plot.h"

#include "ui/look/controls.h"

#include <implot.h>

#include <algorithm>
#include <cmath>
#include <string>

namespace ars::ui {

namespace {

constexpr float kMostSmoothing = 0.995f;

/// "loss.l1" -> "l1".
std::string shortName(const std::string& name) { return name.substr(name.find('.') + 1); }

struct Line {
    const std::vector<double>* steps;
    const std::vector<double>* values;
    bool logarithmic;
};

ImPlotPoint pointOf(int index, void* data) {
    const Line& line = *static_cast<const Line*>(data);
    const auto i = static_cast<std::size_t>(index);
    const double value = (*line.values)[i];
    // A logarithm has no place for what is not positive.
    return {(*line.steps)[i], line.logarithmic && !(value > 0.0) ? std::nan("") : value};
}

void plotLine(const std::string& label, Line line, const ImVec4& color, float weight, bool legend) {
    ImPlotSpec spec;
    spec.LineColor = color;
    spec.LineWeight = weight;
    spec.Flags = ImPlotLineFlags_SkipNaN | (legend ? 0 : ImPlotItemFlags_NoLegend);
    ImPlot::PlotLineG(label.c_str(), pointOf, &line, static_cast<int>(line.steps->size()), spec);
}

} // namespace

void LossPlot::drawChoices(StudioContext& context) {
    ImGui::Checkbox("Terms", &terms_);
    ui::help(context, "Every weighted term beside the total. A click on a name in the plot hides its line.");
    ImGui::SameLine();
    ImGui::Checkbox("Log", &logarithmic_);
    ui::help(context, "Logarithmic losses: late progress is seen as well as the early one.");
    ImGui::SameLine();
    ImGui::SetNextItemWidth(std::max(4.0f * ImGui::GetFontSize(), ImGui::GetContentRegionAvail().x));
    ImGui::SliderFloat("###Smoothing", &smoothing_, 0.0f, kMostSmoothing, "smoothing %.3f",
                       ImGuiSliderFlags_AlwaysClamp);
    ui::help(context,
             "Share of what was before in a running mean over the steps; the numbers themselves stay behind it, "
             "paler. 0 shows them alone.");
}

void LossPlot::draw(StudioContext& context, const RunSnapshot& run, float height) {
    const float begin = ImGui::GetCursorPosY();
    drawChoices(context);
    const float left = std::max(6.0f * ImGui::GetFontSize(), height - (ImGui::GetCursorPosY() - begin));
    constexpr ImPlotFlags kFlags = ImPlotFlags_NoTitle | ImPlotFlags_NoMenus | ImPlotFlags_NoBoxSelect;
    if (!ImPlot::BeginPlot("###Losses", {-1, left}, kFlags)) return;
    constexpr ImPlotAxisFlags kAxis = ImPlotAxisFlags_AutoFit | ImPlotAxisFlags_NoMenus;
    // A low plot needs its height for the curves.
    const char* below = left > 10.0f * ImGui::GetFontSize() ? "step" : nullptr;
    ImPlot::SetupAxes(below, nullptr, kAxis, kAxis);
    if (logarithmic_) ImPlot::SetupAxisScale(ImAxis_Y1, ImPlotScale_Log10);
    ImPlot::SetupLegend(ImPlotLocation_NorthEast);
    const float weight = 1.5f * context.scale;
    for (std::size_t i = 0; i < run.curves.size(); ++i) {
        const RunCurve& curve = run.curves[i];
        const bool total = i == 0 && curve.name == "loss.total";
        if (!total && !terms_) continue;
        const std::string label = shortName(curve.name);
        const ImVec4 color = total ? accentColor() : ImPlot::GetColormapColor(static_cast<int>(i));
        if (smoothing_ > 0.0f) {
            ImVec4 pale = color;
            pale.w *= 0.25f;
            // Under the same label, so that a click hides both.
            plotLine(label, {&curve.steps, &curve.values, logarithmic_}, pale, context.scale, false);
            plotLine(label, {&curve.steps, &curve.smoothed, logarithmic_}, color, weight, true);
        } else {
            plotLine(label, {&curve.steps, &curve.values, logarithmic_}, color, weight, true);
        }
    }
    ImPlot::EndPlot();
}

} // namespace ars::ui
