#pragma once

#include "ui/settings.h"

#include <imgui.h>

#include <string>
#include <vector>

namespace ars::ui {

/// Fonts of the current Dear ImGui context. Text and icons share one font; numbers have a monospaced one.
struct Fonts {
    ImFont* text = nullptr;
    ImFont* monospaced = nullptr;   ///< the text font where none was found
    bool icons = false;             ///< whether icon characters show as icons
    std::vector<std::string> notes; ///< what was not found and what stands in for it
};

/// Loads the fonts that the distribution has under /usr/share/fonts; Dear ImGui's own where it has none.
Fonts loadFonts();
/// Whether icons show: without their font widgets use words.
bool haveIcons();

/// Height of text in design pixels.
inline constexpr float kTextSize = 15.0f;

/// Colours, spacing and sizes of the current context. @param scale  pixels per design pixel
void applyTheme(Theme theme, float scale);

/// Icons as characters of the text font, for iconButton and toolButton.
namespace icon {
inline constexpr const char* kPlay = "\xef\x90\x8a";          // play
inline constexpr const char* kPause = "\xef\x8f\xa4";         // pause
inline constexpr const char* kStop = "\xef\x93\x9b";          // stop
inline constexpr const char* kFirst = "\xef\x92\xae";         // skip-previous
inline constexpr const char* kLast = "\xef\x92\xad";          // skip-next
inline constexpr const char* kStepBack = "\xef\x92\xab";      // skip-backward
inline constexpr const char* kStepForward = "\xef\x92\xac";   // skip-forward
inline constexpr const char* kRepeat = "\xef\x91\x96";        // repeat
inline constexpr const char* kUndo = "\xef\x95\x8d";          // undo-variant
inline constexpr const char* kRedo = "\xef\x91\x8f";          // redo-variant
inline constexpr const char* kLock = "\xef\x8c\xbe";          // lock
inline constexpr const char* kUnlock = "\xef\x8d\x80";        // lock-open-outline
inline constexpr const char* kVisible = "\xef\x88\x88";       // eye
inline constexpr const char* kHidden = "\xef\x88\x89";        // eye-off
inline constexpr const char* kAdd = "\xef\x90\x95";           // plus
inline constexpr const char* kRemove = "\xef\x8d\xb4";        // minus
inline constexpr const char* kClose = "\xef\x85\x96";         // close
inline constexpr const char* kCheck = "\xef\x84\xac";         // check
inline constexpr const char* kDelete = "\xef\x87\x80";        // delete
inline constexpr const char* kCopy = "\xef\x86\x8f";          // content-copy
inline constexpr const char* kPaste = "\xef\x86\x92";         // content-paste
inline constexpr const char* kSave = "\xef\x86\x93";          // content-save
inline constexpr const char* kFolder = "\xef\x89\x8b";        // folder
inline constexpr const char* kFolderOutline = "\xef\x89\x96"; // folder-outline
inline constexpr const char* kFile = "\xef\x88\xa4";          // file-outline
inline constexpr const char* kFileImage = "\xef\x88\x9f";     // file-image
inline constexpr const char* kFileVideo = "\xef\x88\xab";     // file-video
inline constexpr const char* kRefresh = "\xef\x91\x90";       // refresh
inline constexpr const char* kReset = "\xef\x81\xaf";         // backup-restore
inline constexpr const char* kSearch = "\xef\x8d\x89";        // magnify
inline constexpr const char* kCamera = "\xef\x84\x80";        // camera
inline constexpr const char* kLens = "\xef\x84\x84";          // camera-iris
inline constexpr const char* kVideo = "\xef\x95\xa7";         // video
inline constexpr const char* kFilm = "\xef\x88\xb0";          // filmstrip
inline constexpr const char* kImage = "\xef\x8b\xa9";         // image
inline constexpr const char* kImages = "\xef\x8b\xb9";        // image-multiple
inline constexpr const char* kLightbulb = "\xef\x8c\xb5";     // lightbulb
inline constexpr const char* kSun = "\xef\x96\xa8";           // white-balance-sunny
inline constexpr const char* kExposure = "\xef\x83\x9f";      // brightness-6
inline constexpr const char* kPerson = "\xef\x8b\xa6";        // human
inline constexpr const char* kGreeting = "\xef\x99\x8a";      // human-greeting
inline constexpr const char* kBody = "\xef\x99\x8c";          // human-handsup
inline constexpr const char* kWalk = "\xef\x96\x83";          // walk
inline constexpr const char* kRotate3d = "\xef\x91\xa4";      // rotate-3d
inline constexpr const char* kRotateRight = "\xef\x91\xa7";   // rotate-right
inline constexpr const char* kRotateLeft = "\xef\x91\xa5";    // rotate-left
inline constexpr const char* kCube = "\xef\x86\xa7";          // cube-outline
inline constexpr const char* kLayers = "\xef\x8c\xa8";        // layers
inline constexpr const char* kCompare = "\xef\x86\x8a";       // compare
inline constexpr const char* kBlur = "\xef\x82\xb5";          // blur
inline constexpr const char* kGrid = "\xef\x8b\x81";          // grid
inline constexpr const char* kTiles = "\xef\x95\xb0";         // view-grid
inline constexpr const char* kStrip = "\xef\x95\xb4";         // view-quilt
inline constexpr const char* kTimer = "\xef\x94\x9b";         // timer
inline constexpr const char* kChartLine = "\xef\x84\xaa";     // chart-line
inline constexpr const char* kChartBar = "\xef\x84\xa8";      // chart-bar
inline constexpr const char* kMemory = "\xef\x8d\x9b";        // memory
inline constexpr const char* kSpeed = "\xef\x93\x85";         // speedometer
inline constexpr const char* kSettings = "\xef\x92\x93";      // settings
inline constexpr const char* kTune = "\xef\x98\xae";          // tune
inline constexpr const char* kPalette = "\xef\x8f\x98";       // palette
inline constexpr const char* kContrast = "\xef\x86\x97";      // contrast-circle
inline constexpr const char* kKey = "\xef\x8c\x86";           // key
inline constexpr const char* kKeyAdd = "\xef\x8c\x89";        // key-plus
inline constexpr const char* kKeyRemove = "\xef\x8c\x8a";     // key-remove
inline constexpr const char* kDiamond = "\xef\x87\x88";       // diamond
inline constexpr const char* kSwap = "\xef\x93\xa1";          // swap-horizontal
inline constexpr const char* kMirror = "\xef\x93\xa1";        // swap-horizontal
inline constexpr const char* kLeft = "\xef\x81\x8d";          // arrow-left
inline constexpr const char* kRight = "\xef\x81\x94";         // arrow-right
inline constexpr const char* kUp = "\xef\x81\x9d";            // arrow-up
inline constexpr const char* kDown = "\xef\x81\x85";          // arrow-down
inline constexpr const char* kExpand = "\xef\x98\x96";        // arrow-expand
inline constexpr const char* kFullscreen = "\xef\x8a\x93";    // fullscreen
inline constexpr const char* kFocus = "\xef\x86\xa4";         // crosshairs-gps
inline constexpr const char* kTarget = "\xef\x93\xbe";        // target
inline constexpr const char* kPointer = "\xef\x86\xb7";       // cursor-pointer
inline constexpr const char* kMove = "\xef\x86\xb6";          // cursor-move
inline constexpr const char* kResize = "\xef\x99\x95";        // move-resize
inline constexpr const char* kHistory = "\xef\x8b\x9a";       // history
inline constexpr const char* kClock = "\xef\x85\x90";         // clock
inline constexpr const char* kAlert = "\xef\x80\xa6";         // alert
inline constexpr const char* kAlertCircle = "\xef\x97\x96";   // alert-circle-outline
inline constexpr const char* kInfo = "\xef\x8b\xbd";          // information-outline
inline constexpr const char* kHelp = "\xef\x98\xa5";          // help-circle-outline
inline constexpr const char* kKeyboard = "\xef\x8c\x8c";      // keyboard
inline constexpr const char* kMenu = "\xef\x8d\x9c";          // menu
inline constexpr const char* kChevronRight = "\xef\x85\x82";  // chevron-right
inline constexpr const char* kChevronDown = "\xef\x85\x80";   // chevron-down
inline constexpr const char* kChevronLeft = "\xef\x85\x81";   // chevron-left
inline constexpr const char* kChevronUp = "\xef\x85\x83";     // chevron-up
inline constexpr const char* kMore = "\xef\x87\x99";          // dots-vertical
inline constexpr const char* kStar = "\xef\x93\x8e";          // star
inline constexpr const char* kStarOutline = "\xef\x93\x92";   // star-outline
inline constexpr const char* kTheme = "\xef\x94\x8e";         // theme-light-dark
inline constexpr const char* kTextSize = "\xef\x89\xbf";      // format-size
inline constexpr const char* kExport = "\xef\x88\x87";        // export
inline constexpr const char* kImport = "\xef\x8b\xba";        // import
inline constexpr const char* kUpload = "\xef\x95\x92";        // upload
inline constexpr const char* kDownload = "\xef\x87\x9a";      // download
inline constexpr const char* kOpenNew = "\xef\x8f\x8c";       // open-in-new
inline constexpr const char* kHome = "\xef\x8b\x9c";          // home
inline constexpr const char* kEarth = "\xef\x87\xa7";         // earth
inline constexpr const char* kPanorama = "\xef\x8f\x9c";      // panorama
inline constexpr const char* kRecord = "\xef\x91\x8a";        // record
inline constexpr const char* kDot = "\xef\x84\xaf";           // checkbox-blank-circle
inline constexpr const char* kRing = "\xef\x84\xb0";          // checkbox-blank-circle-outline
inline constexpr const char* kLink = "\xef\x8c\xb9";          // link-variant
inline constexpr const char* kPin = "\xef\x90\x83";           // pin
inline constexpr const char* kFilter = "\xef\x88\xb2";        // filter
inline constexpr const char* kEyedropper = "\xef\x88\x8a";    // eyedropper
inline constexpr const char* kCurve = "\xef\x95\x99";         // vector-curve
inline constexpr const char* kBone = "\xef\x82\xb9";          // bone
inline constexpr const char* kCloseCircle = "\xef\x85\x99";   // close-circle
inline constexpr const char* kConsole = "\xef\x86\x8d";       // console
inline constexpr const char* kMonitor = "\xef\x8d\xb9";       // monitor
inline constexpr const char* kList = "\xef\x89\xb9";          // format-list-bulleted
inline constexpr const char* kNew = "\xef\x88\x94";           // file
} // namespace icon

} // namespace ars::ui
