#include "ui/look/buffer_range.h"

#include "ui/studio.h"

#include <implot.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace ars::ui {

namespace {

constexpr int kBins = 64;
constexpr double kPauseS = 0.3; ///< between two counts
constexpr int kCountedWidth = 240, kCountedHeight = 180;

bool hasRange(const BufferInfo& info) { return info.kind == BufferKind::Scalar || info.kind == BufferKind::Place; }

void setRange(StudioContext& context, const BufferInfo& info, double minimum, double maximum) {
    // A range of no width shows nothing; the one that is not moved gives way.
    if (maximum - minimum < 1e-5) maximum = minimum + 1e-5;
    runFromWidget(context, "view.range",
                  {{"buffer", std::string(info.name)}, {"minimum", minimum}, {"maximum", maximum}});
}

/// The catalogue's range for directions and colours that have none of their own.
std::pair<float, float> axisOf(const Document& document, const BufferInfo& info) {
    if (info.kind == BufferKind::Direction) return {-1.0f, 1.0f};
    if (!hasRange(info)) return {0.0f, 1.0f};
    return shownRange(document, info.id);
}

constexpr std::array<ColorMap, 5> kMaps{ColorMap::Gray, ColorMap::Viridis, ColorMap::Magma, ColorMap::Turbo,
                                        ColorMap::Signed};

/// A button that shows the colours of a map from left to right.
bool mapButton(ColorMap map, bool active, ImVec2 size, float scale) {
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    const std::string name(colorMapName(map));
    const bool clicked = ImGui::InvisibleButton(name.c_str(), size);
    ImDrawList* draw = ImGui::GetWindowDrawList();
    constexpr int kSteps = 16;
    for (int i = 0; i < kSteps; ++i) {
        const auto color = [&](int k) {
            const glm::vec3 c = mapColor(map, static_cast<float>(k) / kSteps);
            return ImGui::GetColorU32(ImVec4(c.x, c.y, c.z, 1.0f));
        };
        const float left = corner.x + size.x * static_cast<float>(i) / kSteps;
        const float right = corner.x + size.x * static_cast<float>(i + 1) / kSteps;
        draw->AddRectFilledMultiColor(ImVec2(left, corner.y), ImVec2(right, corner.y + size.y), color(i), color(i + 1),
                                      color(i + 1), color(i));
    }
    ImVec4 line = active ? accentColor() : ImGui::GetStyleColorVec4(ImGuiCol_Border);
    if (!active && ImGui::IsItemHovered()) line = ImGui::GetStyleColorVec4(ImGuiCol_Text);
    draw->AddRect(corner, ImVec2(corner.x + size.x, corner.y + size.y), ImGui::GetColorU32(line), 0.0f, 0,
                  (active ? 2.0f : 1.0f) * scale);
    return clicked;
}

void drawMaps(StudioContext& context, const BufferInfo& info) {
    const ColorMap current =
        context.document().view.buffers[static_cast<std::size_t>(info.id)].colorMap.value_or(info.colorMap);
    rowLabel("Colour map", "How numbers become colours.");
    ImGui::PushID("Colour map");
    const float gap = 4.0f * context.scale;
    const float width = (ImGui::GetContentRegionAvail().x - gap * (kMaps.size() - 1)) / kMaps.size();
    for (std::size_t i = 0; i < kMaps.size(); ++i) {
        if (i > 0) ImGui::SameLine(0.0f, gap);
        const std::string name(colorMapName(kMaps[i]));
        if (mapButton(kMaps[i], kMaps[i] == current, ImVec2(width, ImGui::GetFrameHeight()), context.scale)) {
            runFromWidget(context, "view.color_map", {{"buffer", std::string(info.name)}, {"map", name}});
        }
        help(context, name.c_str());
    }
    ImGui::PopID();
}

void plotChannel(const BufferHistogram& histogram, int channel, float peak) {
    const std::vector<float>& shares = histogram.shares[static_cast<std::size_t>(channel)];
    if (shares.empty()) return;
    const double width = static_cast<double>(histogram.high - histogram.low) / static_cast<double>(shares.size());
    std::vector<double> places, heights;
    for (std::size_t i = 0; i < shares.size(); ++i) {
        places.push_back(static_cast<double>(histogram.low) + (static_cast<double>(i) + 0.5) * width);
        // A picture that is mostly one flat colour would push everything else to the floor.
        heights.push_back(std::sqrt(static_cast<double>(shares[i] / peak)));
    }
    constexpr std::array<ImVec4, 3> colors{
        {{0.90f, 0.36f, 0.33f, 0.55f}, {0.42f, 0.75f, 0.42f, 0.55f}, {0.40f, 0.58f, 0.95f, 0.55f}}};
    ImPlotSpec spec;
    spec.FillColor = histogram.channels == 1 ? mutedColor() : colors[static_cast<std::size_t>(channel)];
    spec.LineColor = ImVec4(0, 0, 0, 0);
    ImPlot::PlotBars(fmt::format("##{}", channel).c_str(), places.data(), heights.data(),
                     static_cast<int>(places.size()), width, spec);
}

/// The range as two lines over the histogram.
void dragRange(StudioContext& context, const BufferInfo& info) {
    const auto [minimum, maximum] = shownRange(context.document(), info.id);
    double low = static_cast<double>(minimum), high = static_cast<double>(maximum);
    const float thickness = 1.5f * context.scale;
    if (ImPlot::DragLineX(0, &low, accentColor(), thickness) && low < high) setRange(context, info, low, high);
    if (ImPlot::DragLineX(1, &high, accentColor(), thickness) && low < high) setRange(context, info, low, high);
}

} // namespace

void BufferRange::follow(const Document& document, const std::shared_ptr<const Frame>& frame) {
    const BufferId buffer = document.view.buffer;
    const auto around = axisOf(document, bufferInfo(buffer));
    const Image* picture = frame ? frame->picture(buffer) : nullptr;
    const Image* opacity = frame ? frame->picture(BufferId::Opacity) : nullptr;
    if (buffer != buffer_) histogram_ = {};
    if (!picture || !opacity) return;
    const bool same =
        buffer == buffer_ && frame->request == request_ && frame->quality == quality_ && around == around_;
    const double now = ImGui::GetTime();
    if (same || (buffer == buffer_ && time_ >= 0.0 && now - time_ < kPauseS)) return;
    histogram_ = histogramOf(thinnedPicture(*picture, kCountedWidth, kCountedHeight),
                             thinnedPicture(*opacity, kCountedWidth, kCountedHeight), around, kBins);
    buffer_ = buffer;
    request_ = frame->request;
    quality_ = frame->quality;
    around_ = around;
    time_ = now;
}

void BufferRange::drawHistogram(StudioContext& context) {
    if (!ImPlot::GetCurrentContext()) return;
    const BufferInfo& info = bufferInfo(context.document().view.buffer);
    constexpr ImPlotFlags flags = ImPlotFlags_CanvasOnly | ImPlotFlags_NoInputs | ImPlotFlags_NoFrame;
    ImPlot::PushStyleVar(ImPlotStyleVar_PlotPadding, ImVec2(0.0f, 2.0f * context.scale));
    ImPlot::PushStyleColor(ImPlotCol_PlotBg, ImGui::GetStyleColorVec4(ImGuiCol_FrameBg));
    if (ImPlot::BeginPlot("##Histogram", ImVec2(-1.0f, 84.0f * context.scale), flags)) {
        float peak = 1e-6f;
        for (const auto& shares : histogram_.shares) {
            for (const float share : shares) peak = std::max(peak, share);
        }
        const auto low = static_cast<double>(histogram_.low), high = static_cast<double>(histogram_.high);
        ImPlot::SetupAxes(nullptr, nullptr, ImPlotAxisFlags_NoDecorations, ImPlotAxisFlags_NoDecorations);
        ImPlot::SetupAxesLimits(low, high, 0.0, 1.05, ImPlotCond_Always);
        for (int c = 0; c < histogram_.channels; ++c) plotChannel(histogram_, c, peak);
        if (hasRange(info)) dragRange(context, info);
        ImPlot::EndPlot();
    }
    ImPlot::PopStyleColor();
    ImPlot::PopStyleVar();
    help(context,
         fmt::format("How often each value of {} occurs on the body (heights are square roots).", info.label).c_str());
}

void BufferRange::drawRange(StudioContext& context) {
    const BufferInfo& info = bufferInfo(context.document().view.buffer);
    if (info.kind == BufferKind::LinearColor) {
        commandRow(context, "view.exposure", "ev", "Exposure",
                   static_cast<double>(context.document().view.tone.exposureEv));
    }
    if (!hasRange(info)) return;
    auto [minimum, maximum] = shownRange(context.document(), info.id);
    rowLabel("Range", "What becomes the first and the last colour.");
    float range[2] = {minimum, maximum};
    const std::string format = info.unit.empty() ? "%.3f" : fmt::format("%.3f {}", info.unit);
    if (ImGui::DragFloat2("##Range", range, 0.005f, 0.0f, 0.0f, format.c_str())) {
        if (range[0] != minimum) range[1] = std::max(range[1], range[0] + 1e-4f);
        if (range[1] != maximum) range[0] = std::min(range[0], range[1] - 1e-4f);
        setRange(context, info, range[0], range[1]);
    }
    help(context, "What becomes the first and the last colour; drag, or Ctrl+click to type.", nullptr,
         fmt::format("catalogue: {:g} .. {:g} {}", info.minimum, info.maximum, info.unit).c_str());
    const float share = shareOfRow(2);
    const bool counted = histogram_.counted > 0 && buffer_ == info.id;
    ImGui::BeginDisabled(!counted);
    if (ImGui::Button("Fit to picture", ImVec2(share, 0.0f))) {
        setRange(context, info, histogram_.percentile1, histogram_.percentile99);
    }
    ImGui::EndDisabled();
    help(context, "From the darkest to the brightest percent of what is seen now.");
    ImGui::SameLine();
    commandButton(context, "Default range", "view.reset_range", "The range of the catalogue.",
                  {{"buffer", std::string(info.name)}}, share);
    if (info.kind == BufferKind::Scalar) drawMaps(context, info);
}

void BufferRange::draw(StudioContext& context) {
    const BufferInfo& info = bufferInfo(context.document().view.buffer);
    follow(context.document(), context.session.frame());
    ImGui::TextUnformatted(std::string(info.label).c_str());
    help(context, std::string(info.help).c_str());
    std::string facts(info.symbol);
    if (!info.unit.empty()) facts += fmt::format("{}{}", facts.empty() ? "" : ", ", info.unit);
    facts += fmt::format("{}{} {}", facts.empty() ? "" : ", ", info.channels(),
                         info.channels() == 1 ? "channel" : "channels");
    ImGui::SameLine();
    ImGui::TextColored(mutedColor(), "%s", facts.c_str());
    help(context, std::string(info.help).c_str());
    drawHistogram(context);
    drawRange(context);
}

} // namespace ars::ui
