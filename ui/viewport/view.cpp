#include "ui/viewport/view.h"

#include "ui/studio.h"
#include "ui/widgets.h"

#include <fmt/format.h>

#include <cmath>

namespace ars::ui {

namespace {

/// Drafts are shown so long after the last move of a drag: a mouse that rests sees the full picture, button down or
/// not.
constexpr double kDraftsS = 0.25;

} // namespace

void Gesture::begin(Session& session, std::string_view name) {
    static std::uint64_t number = 0;
    if (active_) end(session);
    text_ = fmt::format("viewport.{}.{}", name, ++number);
    active_ = true;
    complained_ = false;
}

void Gesture::run(StudioContext& context, std::string_view command, const Arguments& arguments) {
    if (active_) keepInteracting(kDraftsS);
    const Status done = context.session.run(command, arguments, active_ ? text_ : std::string{});
    if (done.ok() || complained_) return;
    complained_ = active_;
    context.studio.toast(done.error().describe());
}

void Gesture::end(Session& session) {
    if (!active_) return;
    active_ = false;
    session.endGesture();
}

void Gesture::cancel(Session& session) {
    if (!active_) return;
    session.cancelGesture();
    end(session);
}

glm::ivec2 framePixel(const ViewportInput& input) {
    const Camera& frame = input.frame->inputs.camera;
    const Camera& view = input.view.camera;
    // Through the cameras, since the picture may be narrower or wider than the area that shows it.
    const double x = (input.mouse.x - input.view.origin.x - view.cx) / view.fx * frame.fx + frame.cx;
    const double y = (input.mouse.y - input.view.origin.y - view.cy) / view.fy * frame.fy + frame.cy;
    return {static_cast<int>(std::floor(x)), static_cast<int>(std::floor(y))};
}

ImVec4 inkColor(Ink ink) {
    switch (ink) {
    case Ink::Muted:
        return {0.72f, 0.725f, 0.735f, 1.0f};
    case Ink::Accent:
        return {0.95f, 0.65f, 0.35f, 1.0f};
    case Ink::Text:
        break;
    }
    return {0.925f, 0.928f, 0.935f, 1.0f};
}

ImVec4 plateColor() { return {0.06f, 0.062f, 0.068f, 0.8f}; }

ImVec2 drawPlate(ImDrawList* list, const ImVec2& place, const ImVec2& anchor, const char* text, Ink ink, float scale) {
    const ImVec2 inside = ImGui::CalcTextSize(text);
    const ImVec2 margin(7.0f * scale, 3.5f * scale);
    const ImVec2 size(inside.x + 2 * margin.x, inside.y + 2 * margin.y);
    // Whole pixels keep the glyphs sharp.
    const ImVec2 low(std::floor(place.x - anchor.x * size.x), std::floor(place.y - anchor.y * size.y));
    list->AddRectFilled(low, ImVec2(low.x + size.x, low.y + size.y), ImGui::GetColorU32(plateColor()), 4.0f * scale);
    list->AddText(ImVec2(low.x + margin.x, low.y + margin.y), ImGui::GetColorU32(inkColor(ink)), text);
    return size;
}

} // namespace ars::ui
