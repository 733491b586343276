#include "ui/theme.h"

#include "engine/core/log.h"
#include "ui/widgets.h"

#include <filesystem>

namespace ars::ui {
namespace {

bool gIcons = false;

/// What the distributions' packages install, the preferred first.
constexpr const char* kTextFonts[] = {
    "/usr/share/fonts/truetype/roboto/unhinted/RobotoTTF/Roboto-Regular.ttf",
    "/usr/share/fonts/truetype/roboto/unhinted/Roboto-Regular.ttf",
    "/usr/share/fonts/opentype/inter/Inter-Regular.otf",
    "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf",
};
constexpr const char* kMonospacedFonts[] = {
    "/usr/share/fonts/truetype/jetbrains-mono/JetBrainsMono-Regular.ttf",
    "/usr/share/fonts/truetype/dejavu/DejaVuSansMono.ttf",
};
constexpr const char* kIconFonts[] = {
    "/usr/share/fonts/truetype/materialdesignicons-webfont/materialdesignicons-webfont.ttf",
    "/usr/share/fonts-materialdesignicons-webfont/fonts/materialdesignicons-webfont.ttf",
};

template <std::size_t Count>
const char* firstThatExists(const char* const (&files)[Count]) {
    std::error_code ignored;
    for (const char* file : files) {
        if (std::filesystem::is_regular_file(file, ignored)) return file;
    }
    return nullptr;
}

ImVec4 gray(float value, float alpha = 1.0f) { return {value, value, value, alpha}; }

/// The neutral greys of a theme, from the window's ground to text. Nothing but the accent has a hue, so that colours in
/// the picture are judged against none.
struct Palette {
    ImVec4 ground, panel, raised, frame, frameHovered, frameActive, border, text, muted, accent, good, bad;
};

const Palette& palette(Theme theme) {
    static const Palette dark{gray(0.082f),
                              gray(0.122f),
                              gray(0.155f),
                              gray(0.182f),
                              gray(0.225f),
                              gray(0.262f),
                              gray(0.055f),
                              gray(0.875f),
                              gray(0.585f),
                              {0.93f, 0.62f, 0.31f, 1.0f},
                              {0.50f, 0.75f, 0.50f, 1.0f},
                              {0.93f, 0.43f, 0.39f, 1.0f}};
    static const Palette light{gray(0.740f),
                               gray(0.905f),
                               gray(0.965f),
                               gray(0.820f),
                               gray(0.780f),
                               gray(0.735f),
                               gray(0.680f),
                               gray(0.105f),
                               gray(0.385f),
                               {0.75f, 0.37f, 0.02f, 1.0f},
                               {0.13f, 0.47f, 0.16f, 1.0f},
                               {0.74f, 0.13f, 0.10f, 1.0f}};
    return theme == Theme::Dark ? dark : light;
}

Theme gTheme = Theme::Dark;

ImVec4 faded(ImVec4 color, float alpha) {
    color.w *= alpha;
    return color;
}

void applyColors(const Palette& p, ImGuiStyle& style) {
    const ImVec4 none = gray(0.0f, 0.0f);
    ImVec4* colors = style.Colors;
    const auto set = [&](std::initializer_list<int> which, const ImVec4& color) {
        for (int index : which) colors[index] = color;
    };
    set({ImGuiCol_Text, ImGuiCol_InputTextCursor}, p.text);
    set({ImGuiCol_TextDisabled}, p.muted);
    set({ImGuiCol_WindowBg}, p.panel);
    set({ImGuiCol_ChildBg, ImGuiCol_BorderShadow, ImGuiCol_ScrollbarBg, ImGuiCol_TableRowBg}, none);
    set({ImGuiCol_PopupBg}, p.raised);
    set({ImGuiCol_Border, ImGuiCol_Separator, ImGuiCol_TableBorderStrong, ImGuiCol_TableBorderLight}, p.border);
    set({ImGuiCol_FrameBg, ImGuiCol_Button}, p.frame);
    set({ImGuiCol_FrameBgHovered, ImGuiCol_ButtonHovered}, p.frameHovered);
    set({ImGuiCol_FrameBgActive, ImGuiCol_ButtonActive}, p.frameActive);
    set({ImGuiCol_TitleBg, ImGuiCol_TitleBgActive, ImGuiCol_TitleBgCollapsed, ImGuiCol_DockingEmptyBg,
         ImGuiCol_MenuBarBg, ImGuiCol_TableHeaderBg},
        p.ground);
    set({ImGuiCol_ScrollbarGrab, ImGuiCol_ResizeGrip}, p.frameHovered);
    set({ImGuiCol_ScrollbarGrabHovered, ImGuiCol_ResizeGripHovered}, p.frameActive);
    set({ImGuiCol_ScrollbarGrabActive, ImGuiCol_ResizeGripActive}, p.muted);
    set({ImGuiCol_Header}, p.frame);
    set({ImGuiCol_HeaderHovered}, p.frameHovered);
    set({ImGuiCol_HeaderActive}, p.frameActive);
    set({ImGuiCol_Tab, ImGuiCol_TabDimmed}, p.ground);
    set({ImGuiCol_TabHovered}, p.frameHovered);
    set({ImGuiCol_TabSelected, ImGuiCol_TabDimmedSelected}, p.panel);
    set({ImGuiCol_TabSelectedOverline}, p.accent);
    set({ImGuiCol_TabDimmedSelectedOverline}, none);
    set({ImGuiCol_TableRowBgAlt}, faded(p.text, 0.03f));
    set({ImGuiCol_TreeLines}, p.frameActive);
    // The accent marks what is chosen or being changed, nothing else.
    set({ImGuiCol_CheckMark, ImGuiCol_SliderGrabActive, ImGuiCol_SeparatorActive, ImGuiCol_PlotLines,
         ImGuiCol_PlotHistogram, ImGuiCol_TextLink, ImGuiCol_DragDropTarget, ImGuiCol_UnsavedMarker,
         ImGuiCol_NavCursor},
        p.accent);
    set({ImGuiCol_SliderGrab}, faded(p.accent, 0.55f)); // the number below stays readable
    set({ImGuiCol_CheckboxSelectedBg}, p.frame);
    set({ImGuiCol_SeparatorHovered, ImGuiCol_PlotLinesHovered, ImGuiCol_PlotHistogramHovered}, faded(p.accent, 0.6f));
    set({ImGuiCol_TextSelectedBg, ImGuiCol_DockingPreview}, faded(p.accent, 0.35f));
    set({ImGuiCol_DragDropTargetBg}, faded(p.accent, 0.10f));
    set({ImGuiCol_NavWindowingHighlight}, faded(p.text, 0.7f));
    set({ImGuiCol_NavWindowingDimBg, ImGuiCol_ModalWindowDimBg}, gray(0.0f, 0.45f));
}

} // namespace

Fonts loadFonts() {
    Fonts fonts;
    ImFontAtlas& atlas = *ImGui::GetIO().Fonts;
    atlas.Clear();
    if (const char* file = firstThatExists(kTextFonts)) fonts.text = atlas.AddFontFromFileTTF(file, kTextSize);
    if (!fonts.text) {
        fonts.notes.emplace_back(
            "no text font under /usr/share/fonts (package fonts-roboto-unhinted): Dear ImGui's own");
        fonts.text = atlas.AddFontDefault();
    }
    if (const char* file = firstThatExists(kIconFonts)) {
        ImFontConfig config;
        config.MergeMode = true;
        config.GlyphOffset.y = 2.0f; // centres the icons on the text's capitals
        fonts.icons = atlas.AddFontFromFileTTF(file, kTextSize * 1.07f, &config) != nullptr;
    }
    if (!fonts.icons) {
        fonts.notes.emplace_back("no icon font (package fonts-materialdesignicons-webfont): words instead of icons");
    }
    if (const char* file = firstThatExists(kMonospacedFonts)) {
        fonts.monospaced = atlas.AddFontFromFileTTF(file, kTextSize * 0.93f);
    }
    if (!fonts.monospaced) fonts.monospaced = fonts.text;
    for (const std::string& note : fonts.notes) logInfo("fonts: {}", note);
    gIcons = fonts.icons;
    return fonts;
}

bool haveIcons() { return gIcons; }

void applyTheme(Theme theme, float scale) {
    gTheme = theme;
    ImGuiStyle style;
    style.WindowPadding = {10, 8};
    style.FramePadding = {7, 4};
    style.ItemSpacing = {7, 5};
    style.ItemInnerSpacing = {6, 4};
    style.CellPadding = {6, 3};
    style.IndentSpacing = 16;
    style.ScrollbarSize = 12;
    style.GrabMinSize = 5;
    style.WindowBorderSize = 0;
    style.ChildBorderSize = 0;
    style.PopupBorderSize = 1;
    style.FrameBorderSize = 0;
    style.TabBorderSize = 0;
    style.TabBarBorderSize = 0;
    style.TabBarOverlineSize = 2;
    style.WindowRounding = 5;
    style.ChildRounding = 4;
    style.FrameRounding = 4;
    style.PopupRounding = 5;
    style.GrabRounding = 3;
    style.TabRounding = 4;
    style.ScrollbarRounding = 6;
    style.DockingSeparatorSize = 3;
    style.WindowMenuButtonPosition = ImGuiDir_None;
    style.SeparatorTextBorderSize = 1;
    style.SeparatorTextPadding = {0, 4};
    style.SeparatorTextAlign = {0.0f, 0.5f};
    style.WindowTitleAlign = {0.0f, 0.5f};
    style.DisabledAlpha = 0.45f;
    style.HoverStationaryDelay = 0.25f;
    style.HoverDelayNormal = 0.6f;
    applyColors(palette(theme), style);
    style.ScaleAllSizes(scale);
    style.FontSizeBase = kTextSize;
    style.FontScaleMain = scale;
    ImGui::GetStyle() = style;
}

ImVec4 accentColor() { return palette(gTheme).accent; }
ImVec4 mutedColor() { return palette(gTheme).muted; }
ImVec4 goodColor() { return palette(gTheme).good; }
ImVec4 badColor() { return palette(gTheme).bad; }

} // namespace ars::ui
