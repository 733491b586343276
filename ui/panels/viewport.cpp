#include "engine/scene/evaluate.h"
#include "ui/studio.h"
#include "ui/viewport/backdrop.h"
#include "ui/viewport/comparison.h"
#include "ui/viewport/layout.h"
#include "ui/viewport/legend.h"
#include "ui/viewport/magnifier.h"
#include "ui/viewport/marks.h"
#include "ui/viewport/navigation.h"
#include "ui/viewport/painter.h"
#include "ui/viewport/posing.h"
#include "ui/viewport/probe_state.h"
#include "ui/viewport/rings.h"
#include "ui/viewport/spheres.h"
#include "ui/viewport/toolbar.h"
#include "ui/widgets.h"

#include <imgui_internal.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::ui {

namespace {

/// Numbers of tiles for the painter; those of buffers follow from kBufferTiles on.
enum Tile { kMainTile, kOtherTile, kPlainTile, kDifferenceTile, kFlipTile, kBufferTiles = 16 };

constexpr double kBlinkS = 0.6;
constexpr float kClickPixels = 4.0f;
constexpr float kAbsoluteMaximum = 0.25f; ///< errors that have the map's last colour
constexpr float kSquaredMaximum = 0.0625f;

class ViewportPanel : public Panel {
public:
    const char* id() const override { return "viewport"; }
    const char* title() const override { return "Viewport"; }
    const char* help() const override { return "The avatar: drag limbs, turn the camera, look at every buffer"; }
    bool padded() const override { return false; }
    void draw(StudioContext& context) override;

private:
    // --- what is shown
    void askForFrames(StudioContext& context, const ViewportLayout& layout);
    TileContent content(StudioContext& context, BufferId buffer, bool overlays);
    void paintMain(StudioContext& context, const ViewportLayout& layout);
    void paintOther(StudioContext& context, const ViewportLayout& layout);
    void paintDifference(StudioContext& context, const PictureArea& area);
    void paintThumbnails(StudioContext& context, const ViewportLayout& layout);
    void drawTileWidgets(StudioContext& context, const ViewportLayout& layout);
    void drawTexture(ImTextureRef texture, const PictureArea& area, float from = 0.0f, float to = 1.0f) const;
    void drawNumbers(StudioContext& context, const PictureView& view);
    std::string mainLabel(const StudioContext& context) const;

    // --- what the mouse does
    PictureView viewOf(StudioContext& context, const PictureArea& area) const;
    void interact(StudioContext& context, const ViewportLayout& layout);
    void press(const ViewportInput& input);
    void dragSplit(const ViewportInput& input, const PictureArea& area);
    void clickBackground(const ViewportInput& input);
    void cancelAll(Session& session);
    bool toolDragged() const {
        return navigation_.dragging() || limbs_.held() || rings_.dragging() || spheres_.dragging() ||
               legend_.dragging() || split_.active();
    }
    void probeUnder(const ViewportInput& input);

    std::unique_ptr<Painter> painter_;
    std::shared_ptr<const Frame> frame_;
    OtherSide other_;
    Comparison comparison_;
    BackdropSource backdrop_;
    Navigation navigation_;
    LimbDragging limbs_;
    JointRings rings_;
    RadiusSpheres spheres_;
    Legend legend_;
    Gesture split_;
    Magnifier magnifier_;
    std::size_t working_ = 0; ///< area that the mouse works in
    std::optional<ImVec2> backgroundPress_;
    const ComparisonNumbers* numbers_ = nullptr;
};

bool twoSided(ViewLayout layout) {
    return layout == ViewLayout::SideBySide || layout == ViewLayout::Split || layout == ViewLayout::Blink ||
           layout == ViewLayout::Difference;
}

int pixels(float length) { return std::max(1, static_cast<int>(std::lround(length))); }

void ViewportPanel::askForFrames(StudioContext& context, const ViewportLayout& layout) {
    const ViewSection& view = context.document().view;
    context.session.setViewport(pixels(layout.main.size.x), pixels(layout.main.size.y));
    std::vector<BufferId> wanted{view.buffer};
    ProbeState& probe = probeState();
    const bool all =
        probe.pinned || probe.wantedFrames > 0 || (ImGui::IsKeyDown(ImGuiKey_V) && !ImGui::GetIO().WantTextInput);
    if (probe.wantedFrames > 0) --probe.wantedFrames;
    if (all && !toolDragged() && !context.session.transport().playing) {
        for (const BufferInfo& info : bufferCatalogue()) {
            if (info.id != BufferId::RadiusPlus && info.id != BufferId::RadiusMinus) wanted.push_back(info.id);
        }
    }
    for (const ThumbnailArea& thumbnail : layout.thumbnails) wanted.push_back(thumbnail.buffer);
    if (twoSided(view.layout) && view.compare.kind == CompareKind::Buffer) wanted.push_back(view.compare.buffer);
    std::sort(wanted.begin(), wanted.end());
    wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
    context.session.setWantedBuffers(std::move(wanted));
}

TileContent ViewportPanel::content(StudioContext& context, BufferId buffer, bool overlays) {
    TileContent result;
    const auto find = [&](BufferId id) -> std::shared_ptr<const Image> {
        const auto found = frame_->pictures.find(id);
        return found == frame_->pictures.end() ? nullptr : found->second;
    };
    const Document& document = context.document();
    result.picture = find(buffer);
    result.opacity = find(BufferId::Opacity);
    result.camera = frame_->inputs.camera;
    result.settings = presentSettings(document, buffer, context.session.timeS());
    if (document.light.backdrop == BackdropKind::Environment) {
        result.environment = backdrop_.environment(context, frame_->light);
    }
    if (!overlays) return result;
    result.depth = find(BufferId::Depth);
    result.settings.grid = document.view.grid;
    if (document.view.parts) result.parts = frame_->parts;
    if (document.view.surfelDiscs) result.discs = frame_->surfels;
    result.mask = limbs_.marks();
    const ImVec4 accent = inkColor(Ink::Accent);
    result.maskColor = glm::vec4(accent.x, accent.y, accent.z, 0.2f);
    if (document.view.skeleton && frame_->avatar) {
        const Skeleton& skeleton = frame_->avatar->evaluator->rig().skeleton;
        if (frame_->jointWorld.size() == static_cast<std::size_t>(skeleton.jointCount())) {
            result.lines = skeletonLines(skeleton, frame_->jointWorld, glm::vec4(0.93f, 0.94f, 0.96f, 0.85f));
            for (OverlayLine& line : result.lines) line.widthPixels *= context.scale;
        }
    }
    return result;
}

void ViewportPanel::drawTexture(ImTextureRef texture, const PictureArea& area, float from, float to) const {
    if (texture.GetTexID() == ImTextureID_Invalid) return;
    const ImVec2 low(area.origin.x + from * area.size.x, area.origin.y);
    const ImVec2 high(area.origin.x + to * area.size.x, area.origin.y + area.size.y);
    // Rows of targets run upwards.
    const ImVec2 first = magnifier_.low(), last = magnifier_.high();
    auto across = [&](float share) { return first.x + share * (last.x - first.x); };
    ImDrawList* list = ImGui::GetWindowDrawList();
    const ImGuiPlatformIO& platform = ImGui::GetPlatformIO();
    // Enlarged pixels are squares.
    const bool squares = magnifier_.active() && platform.DrawCallback_SetSamplerNearest;
    if (squares) list->AddCallback(platform.DrawCallback_SetSamplerNearest, nullptr);
    list->AddImage(texture, low, high, ImVec2(across(from), 1.0f - first.y), ImVec2(across(to), 1.0f - last.y));
    if (squares) list->AddCallback(platform.DrawCallback_SetSamplerLinear, nullptr);
}

std::string ViewportPanel::mainLabel(const StudioContext& context) const {
    const Document& document = context.document();
    std::string text = document.view.surfelDiscs ? "Surfels as discs" : bufferLabel(document.view.buffer);
    if (document.view.layout == ViewLayout::Difference) text += " against " + other_.label;
    if (!document.camera.datasetCamera.empty()) text += "   camera " + document.camera.datasetCamera;
    return text;
}

void ViewportPanel::paintMain(StudioContext& context, const ViewportLayout& layout) {
    const ViewSection& view = context.document().view;
    const PictureArea& area = layout.main;
    ImTextureRef texture = painter_->last(kMainTile);
    const TileContent main = content(context, view.buffer, true);
    // A buffer that was chosen a moment ago is not there yet: what was shown stays until it is.
    if (main.picture) texture = painter_->paint(kMainTile, main, pixels(area.size.x), pixels(area.size.y));
    const bool otherInTurn = view.layout == ViewLayout::Blink && std::fmod(ImGui::GetTime(), 2 * kBlinkS) >= kBlinkS;
    if (view.layout == ViewLayout::Difference) return;
    if (view.layout == ViewLayout::Split) {
        drawTexture(texture, area, 0.0f, view.compare.splitPosition);
    } else if (!otherInTurn || !other_.missing.empty()) {
        drawTexture(texture, area);
    }
}

void ViewportPanel::paintOther(StudioContext& context, const ViewportLayout& layout) {
    const ViewSection& view = context.document().view;
    if (!twoSided(view.layout)) return;
    const PictureArea& area = view.layout == ViewLayout::SideBySide ? layout.other : layout.main;
    other_ = comparison_.otherSide(context, frame_, pixels(area.size.x), pixels(area.size.y));
    numbers_ = comparison_.numbers(context, frame_, other_);
    const PictureView place{area.origin, area.size, frame_->inputs.camera};
    if (!other_.content.picture) {
        if (view.layout != ViewLayout::Split) drawNotice(place, context.scale, other_.missing);
        return;
    }
    TileContent shown = other_.content;
    if (shown.settings.backdrop == Backdrop::Environment) {
        shown.environment = backdrop_.environment(context, other_.frame ? other_.frame->light : frame_->light);
    }
    shown.settings.grid = view.grid && other_.frame && view.layout != ViewLayout::Difference;
    const ImTextureRef texture = painter_->paint(kOtherTile, shown, pixels(area.size.x), pixels(area.size.y));
    if (view.layout == ViewLayout::SideBySide) drawTexture(texture, area);
    if (view.layout == ViewLayout::Split) drawTexture(texture, area, view.compare.splitPosition, 1.0f);
    if (view.layout == ViewLayout::Blink && std::fmod(ImGui::GetTime(), 2 * kBlinkS) >= kBlinkS)
        drawTexture(texture, area);
    if (view.layout == ViewLayout::Difference) paintDifference(context, area);
}

void ViewportPanel::paintDifference(StudioContext& context, const PictureArea& area) {
    const CompareSection& compare = context.document().view.compare;
    const int width = pixels(area.size.x), height = pixels(area.size.y);
    const PictureView view{area.origin, area.size, frame_->inputs.camera};
    if (compare.measure == ErrorMeasure::Flip) {
        if (!numbers_ || !numbers_->flipMap) {
            drawNotice(view, context.scale, numbers_ ? numbers_->problem : "computing FLIP");
            return;
        }
        TileContent map;
        map.picture = numbers_->flipMap;
        map.camera = resizedCamera(frame_->inputs.camera, numbers_->flipMap->width, numbers_->flipMap->height);
        map.settings = defaultPresentSettings(BufferId::Roughness); // any scalar: the map below decides
        map.settings.minimum = 0.0f;
        map.settings.maximum = 1.0f;
        map.settings.colorMap = ColorMap::Magma;
        drawTexture(painter_->paint(kFlipTile, map, width, height), area);
        drawColorBar(view, context.scale, ColorMap::Magma, "0", "1", "FLIP");
        return;
    }
    const bool squared = compare.measure == ErrorMeasure::Squared;
    const float maximum = squared ? kSquaredMaximum : kAbsoluteMaximum;
    const TileContent plain = content(context, context.document().view.buffer, false);
    if (!plain.picture) return;
    (void)painter_->paint(kPlainTile, plain, width, height);
    drawTexture(painter_->paintDifference(kDifferenceTile, kPlainTile, kOtherTile, squared, maximum, ColorMap::Magma,
                                          width, height),
                area);
    drawColorBar(view, context.scale, ColorMap::Magma, "0", fmt::format("{:.2g}", maximum),
                 squared ? "squared error" : "absolute error");
}

void ViewportPanel::paintThumbnails(StudioContext& context, const ViewportLayout& layout) {
    const bool grid = context.document().view.layout == ViewLayout::Grid;
    for (const ThumbnailArea& thumbnail : layout.thumbnails) {
        const PictureArea& area = thumbnail.area;
        const int tile = kBufferTiles + static_cast<int>(thumbnail.buffer);
        TileContent shown = content(context, thumbnail.buffer, false);
        shown.thumbnail = !grid;
        ImTextureRef texture = painter_->last(tile);
        if (shown.picture) texture = painter_->paint(tile, shown, pixels(area.size.x), pixels(area.size.y));
        drawTexture(texture, area);
    }
}

/// Names and buttons of the tiles; in a grid only the names can be pressed, the pictures are to be worked in.
void ViewportPanel::drawTileWidgets(StudioContext& context, const ViewportLayout& layout) {
    const bool grid = context.document().view.layout == ViewLayout::Grid;
    ImDrawList* list = ImGui::GetWindowDrawList();
    ImGui::PushID("Strip");
    for (const ThumbnailArea& thumbnail : layout.thumbnails) {
        const PictureArea& area = thumbnail.area;
        const BufferInfo& info = bufferInfo(thumbnail.buffer);
        const ImVec2 high(area.origin.x + area.size.x, area.origin.y + area.size.y);
        ImGui::PushFont(nullptr, ImGui::GetStyle().FontSizeBase * (grid ? 0.95f : 0.85f));
        const float margin = 5.0f * context.scale;
        std::string text = grid ? bufferLabel(thumbnail.buffer) : std::string(info.label);
        if (ImGui::CalcTextSize(text.c_str()).x + 4.0f * margin > area.size.x) {
            text = info.symbol.empty() ? std::string(info.name) : std::string(info.symbol);
        }
        const ImVec2 corner = grid ? ImVec2(area.origin.x + margin, area.origin.y + margin)
                                   : ImVec2(area.origin.x + margin, high.y - margin);
        const ImVec2 plate =
            drawPlate(list, corner, ImVec2(0, grid ? 0.0f : 1.0f), text.c_str(), Ink::Text, 0.8f * context.scale);
        ImGui::PopFont();
        ImGui::SetCursorScreenPos(grid ? corner : area.origin);
        ImGui::SetNextItemAllowOverlap();
        if (ImGui::InvisibleButton(std::string(info.label).c_str(), grid ? plate : area.size)) {
            runFromWidget(context, "view.buffer", {{"name", info.name}});
        }
        const bool hovered = ImGui::IsItemHovered();
        if (hovered && ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left)) {
            runFromWidget(context, "view.layout", {{"layout", "single"}});
        }
        ui::help(context, std::string(info.help).c_str(), std::string(info.symbol).c_str(),
                 std::string(info.unit).c_str());
        if (thumbnail.buffer == context.document().view.buffer) {
            list->AddRect(area.origin, high, ImGui::GetColorU32(inkColor(Ink::Accent)), 0.0f, 0, 1.5f * context.scale);
        } else if (hovered) {
            list->AddRect(area.origin, high, ImGui::GetColorU32(inkColor(Ink::Muted)), 0.0f, 0, 1.0f * context.scale);
        }
    }
    ImGui::PopID();
}

void ViewportPanel::drawNumbers(StudioContext& context, const PictureView& view) {
    if (!twoSided(context.document().view.layout)) return;
    std::string text;
    auto row = [](const char* name, const ComparisonNumbers::Row& r) {
        auto number = [](std::optional<double> value, int digits) {
            if (!value) return std::string("-");
            return std::isinf(*value) ? std::string("equal") : fmt::format("{:.{}f}", *value, digits);
        };
        return fmt::format("{}  PSNR {} dB   SSIM {}   FLIP {}", name, number(r.psnr, 2), number(r.ssim, 4),
                           number(r.flip, 4));
    };
    if (numbers_ && !numbers_->problem.empty())
        text = numbers_->problem;
    else if (numbers_)
        text = row("picture", numbers_->whole) + "\n" + row("body     ", numbers_->mask);
    if (comparison_.measuring() && text.empty()) text = "measuring";
    if (text.empty()) return;
    // Beside the body, which stands in the middle.
    const float margin = 10.0f * context.scale;
    const ImVec2 place(view.origin.x + view.size.x - margin, view.origin.y + view.size.y - margin);
    drawPlate(ImGui::GetWindowDrawList(), place, ImVec2(1.0f, 1.0f), text.c_str(),
              comparison_.measuring() ? Ink::Muted : Ink::Text, context.scale);
}

PictureView ViewportPanel::viewOf(StudioContext& context, const PictureArea& area) const {
    const int width = pixels(area.size.x), height = pixels(area.size.y);
    PictureView view{area.origin, area.size, {}};
    if (!frame_) {
        view.camera = frameCamera(context.document(), context.session.assets(), context.session.timeS(), width, height);
        return view;
    }
    // The picture is as high as the area and in its middle (see Painter).
    const Camera& camera = frame_->inputs.camera;
    const int fitted = static_cast<int>(std::lround(static_cast<double>(camera.width) / camera.height * height));
    view.camera = resizedCamera(camera, std::abs(fitted - width) <= 2 ? width : fitted, height);
    view.camera.cx += 0.5 * (width - view.camera.width);
    view.camera.width = width;
    return magnifier_.magnified(view);
}

void ViewportPanel::probeUnder(const ViewportInput& input) {
    ViewportProbe probe;
    if (input.hovered && frame_) {
        const glm::ivec2 pixel = framePixel(input);
        probe = probeFrame(*frame_, pixel.x, pixel.y);
        if (probe.covered && limbs_.hit() && frame_->avatar) {
            const AvatarRig& rig = frame_->avatar->evaluator->rig();
            probe.joint = limbs_.hit()->joint;
            if (probe.joint >= 0 && probe.joint < rig.skeleton.jointCount()) {
                probe.jointName = rig.skeleton.names[static_cast<std::size_t>(probe.joint)];
                probe.partName = bodyPartName(rig.parts[static_cast<std::size_t>(probe.joint)]);
            }
        }
    }
    probeState().probe = std::move(probe);
}

void ViewportPanel::cancelAll(Session& session) {
    navigation_.cancel(session);
    limbs_.cancel(session);
    rings_.cancel(session);
    spheres_.cancel(session);
    legend_.cancel(session);
    split_.cancel(session);
    backgroundPress_.reset();
    ImGui::ClearActiveID();
}

void ViewportPanel::dragSplit(const ViewportInput& input, const PictureArea& area) {
    const ViewSection& view = input.context.document().view;
    if (view.layout != ViewLayout::Split) return;
    const float x = std::floor(area.origin.x + view.compare.splitPosition * area.size.x);
    const bool near = input.hovered && std::abs(input.mouse.x - x) < 6.0f * input.scale && !toolDragged();
    ImDrawList* list = ImGui::GetWindowDrawList();
    const ImU32 color =
        near || split_.active() ? ImGui::GetColorU32(inkColor(Ink::Accent)) : IM_COL32(235, 235, 238, 200);
    const ImVec2 top(x, area.origin.y), bottom(x, area.origin.y + area.size.y);
    const ImVec2 knob(x, area.origin.y + 0.5f * area.size.y);
    const ImU32 rim = ImGui::GetColorU32(plateColor()); // seen on white, too
    list->AddLine(top, bottom, rim, 3.5f * input.scale);
    list->AddCircleFilled(knob, 6.5f * input.scale, rim);
    list->AddLine(top, bottom, color, 1.5f * input.scale);
    list->AddCircleFilled(knob, 5.0f * input.scale, color);
    if (near || split_.active()) ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeEW);
    if (near && ImGui::IsMouseClicked(ImGuiMouseButton_Left)) split_.begin(input.context.session, "split");
    if (!split_.active()) return;
    const float position = std::clamp((input.mouse.x - area.origin.x) / area.size.x, 0.0f, 1.0f);
    if (position != view.compare.splitPosition) split_.run(input.context, "compare.split", {{"position", position}});
    if (!ImGui::IsMouseDown(ImGuiMouseButton_Left)) split_.end(input.context.session);
}

void ViewportPanel::press(const ViewportInput& input) {
    if (!input.hovered || split_.active() || !ImGui::IsMouseClicked(ImGuiMouseButton_Left)) return;
    if (ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left) && !rings_.ready() && !spheres_.ready()) {
        navigation_.lookAt(input, limbs_.hit() ? &limbs_.hit()->world : nullptr);
        return;
    }
    if (Navigation::turnsLight())
        navigation_.beginLight(input);
    else if (ImGui::GetIO().KeyAlt)
        navigation_.beginOrbit(input);
    else if (rings_.ready())
        rings_.begin(input);
    else if (spheres_.ready())
        spheres_.begin(input);
    else if (limbs_.ready())
        limbs_.begin(input);
    else {
        navigation_.beginOrbit(input);
        backgroundPress_ = input.mouse;
    }
}

/// A click on nothing takes the selection away.
void ViewportPanel::clickBackground(const ViewportInput& input) {
    if (!backgroundPress_) return;
    const ImVec2 way(input.mouse.x - backgroundPress_->x, input.mouse.y - backgroundPress_->y);
    if (std::hypot(way.x, way.y) > kClickPixels * input.scale) backgroundPress_.reset();
    if (!backgroundPress_ || ImGui::IsMouseDown(ImGuiMouseButton_Left)) return;
    backgroundPress_.reset();
    const ViewSection& view = input.context.document().view;
    if (view.selectedJoint >= 0) (void)input.context.session.run("view.select_joint", Arguments::object());
    if (view.selectedPart >= 0) (void)input.context.session.run("view.select_part", Arguments::object());
}

/// The areas in which a person can work: one, two beside one another, or the tiles of a grid.
std::vector<PictureArea> workingAreas(const ViewportLayout& layout, bool grid) {
    std::vector<PictureArea> areas;
    if (grid) {
        for (const ThumbnailArea& tile : layout.thumbnails) areas.push_back(tile.area);
        return areas;
    }
    areas.push_back(layout.main);
    if (layout.other.size.x > 0) areas.push_back(layout.other);
    return areas;
}

void ViewportPanel::interact(StudioContext& context, const ViewportLayout& layout) {
    Session& session = context.session;
    const ImVec2 mouse = ImGui::GetIO().MousePos;
    const bool grid = context.document().view.layout == ViewLayout::Grid;
    const bool several = grid || layout.other.size.x > 0;
    const PictureArea& canvas = several ? layout.region : layout.main;
    ImGui::SetCursorScreenPos(canvas.origin);
    ImGui::SetNextItemAllowOverlap();
    ImGui::InvisibleButton("Picture", canvas.size,
                           ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                               ImGuiButtonFlags_MouseButtonMiddle);
    const bool hovered = ImGui::IsItemHovered();
    ImGui::SetItemKeyOwner(ImGuiKey_MouseWheelY);
    const std::vector<PictureArea> areas = workingAreas(layout, grid);
    if (areas.empty()) return;
    // A drag stays with the picture that it began in.
    if (!toolDragged()) {
        for (std::size_t i = 0; i < areas.size(); ++i) {
            if (PictureView{areas[i].origin, areas[i].size, {}}.contains(mouse)) working_ = i;
        }
    }
    working_ = std::min(working_, areas.size() - 1);
    const PictureView view = viewOf(context, areas[working_]);
    const bool inside = hovered && view.contains(mouse);
    const ViewportInput input{context, view, frame_, mouse, inside, context.scale};
    const PictureView mainView = viewOf(context, areas[0]);
    const ViewportInput mainInput{context, mainView, frame_, mouse, inside && working_ == 0, context.scale};

    if (toolDragged() && ImGui::IsKeyPressed(ImGuiKey_Escape, false)) cancelAll(session);
    dragSplit(mainInput, layout.main);
    const bool difference = context.document().view.layout == ViewLayout::Difference;
    if (!difference) {
        spheres_.update(mainInput, !toolDragged() && !rings_.ready());
        rings_.update(mainInput, !toolDragged());
    }
    const bool keys = Navigation::turnsLight() || ImGui::GetIO().KeyAlt;
    limbs_.hover(input, !toolDragged() && !rings_.ready() && !spheres_.ready() && !keys);
    press(input);
    limbs_.update(input);
    navigation_.update(input, limbs_.hit() ? &limbs_.hit()->world : nullptr);
    clickBackground(input);
    probeUnder(input);
    if (grid || context.document().view.layout == ViewLayout::Strip)
        magnifier_.reset();
    else if (!toolDragged())
        magnifier_.update(input, areas[working_]);
    if (!difference) magnifier_.draw(mainInput, context.document().view.buffer);

    if (!grid) legend_.draw(mainInput, context.document().view.buffer);
    drawAxes(mainInput);
    const PictureView whole{canvas.origin, canvas.size, mainView.camera};
    drawBadge({context, whole, frame_, mouse, false, context.scale});
    const bool values = probePinned() || (ImGui::IsKeyDown(ImGuiKey_V) && !ImGui::GetIO().WantTextInput);
    if (values && !toolDragged()) {
        drawProbe(input, viewportProbe());
    } else if (hovered || limbs_.held()) {
        if (limbs_.dragging())
            limbs_.drawDrag(input);
        else
            limbs_.drawName(input);
    }
    if (const std::string caption = navigation_.caption(context); !caption.empty()) {
        drawPlate(ImGui::GetWindowDrawList(), ImVec2(mouse.x, mouse.y - 12.0f * context.scale), ImVec2(0.5f, 1.0f),
                  caption.c_str(), Ink::Text, context.scale);
    }
    if (hovered && limbs_.ready() && !toolDragged()) ImGui::SetMouseCursor(ImGuiMouseCursor_Hand);
}

void ViewportPanel::draw(StudioContext& context) {
    if (!painter_) {
        painter_ = std::make_unique<Painter>();
        const Document& document = context.document();
        painter_->warmUp(presentSettings(document, BufferId::Beauty, 0.0),
                         presentSettings(document, BufferId::AmbientOcclusion, 0.0));
    }
    painter_->newFrame();
    const ImVec2 start = ImGui::GetCursorScreenPos();
    const ImVec2 room = ImGui::GetContentRegionAvail();
    const float toolbar = drawViewportToolbar(context);
    const PictureArea region{ImVec2(std::floor(start.x), std::floor(start.y + toolbar)),
                             ImVec2(std::floor(room.x), std::floor(room.y - toolbar))};
    if (region.size.x < 16.0f || region.size.y < 16.0f) return;
    const ViewportLayout layout = arrange(context.document().view, region, context.scale);
    askForFrames(context, layout);
    frame_ = context.session.frame();
    if (painter_->failure()) {
        drawNotice({layout.main.origin, layout.main.size, {}}, context.scale, painter_->failure()->describe());
        return;
    }
    ImGui::GetWindowDrawList()->AddRectFilled(region.origin,
                                              ImVec2(region.origin.x + region.size.x, region.origin.y + region.size.y),
                                              IM_COL32(14, 14, 15, 255));
    numbers_ = nullptr;
    if (frame_) {
        if (context.document().view.layout != ViewLayout::Grid) paintMain(context, layout);
        paintOther(context, layout);
    }
    if (frame_) paintThumbnails(context, layout);
    interact(context, layout);
    if (frame_) drawTileWidgets(context, layout);
    const PictureView view = viewOf(context, layout.main);
    if (!frame_) {
        const std::vector<JobStatus> jobs = context.session.jobs();
        drawNotice(view, context.scale, jobs.empty() ? "Getting ready" : jobs.front().title);
        return;
    }
    if (context.document().view.layout == ViewLayout::Grid) return;
    const bool otherInTurn = context.document().view.layout == ViewLayout::Blink &&
                             std::fmod(ImGui::GetTime(), 2 * kBlinkS) >= kBlinkS && other_.missing.empty();
    drawLabel(view, context.scale, otherInTurn ? other_.label : mainLabel(context));
    if (context.document().view.layout == ViewLayout::SideBySide) {
        drawLabel(viewOf(context, layout.other), context.scale, other_.label);
    }
    if (context.document().view.layout == ViewLayout::Split) {
        const float x = view.origin.x + context.document().view.compare.splitPosition * view.size.x;
        const std::string text = other_.missing.empty() ? other_.label : other_.label + ": " + other_.missing;
        drawPlate(ImGui::GetWindowDrawList(), ImVec2(x + 8.0f * context.scale, view.origin.y + 10.0f * context.scale),
                  ImVec2(0, 0), text.c_str(), Ink::Text, context.scale);
    }
    drawNumbers(context, view);
}

} // namespace

std::unique_ptr<Panel> makeViewportPanel() { return std::make_unique<ViewportPanel>(); }

} // namespace ars::ui
