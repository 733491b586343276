#include "ui/settings.h"

#include "engine/core/file.h"
#include "engine/core/log.h"

#include <nlohmann/json.hpp>

#include <algorithm>

namespace ars::ui {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kFile = "settings.json";

Json toJson(const Settings& settings) {
    Json json;
    json["theme"] = settings.theme == Theme::Dark ? "dark" : "light";
    json["text_scale"] = settings.textScale;
    json["invert_zoom"] = settings.invertZoom;
    json["fly_speed"] = settings.flySpeed;
    json["orbit_speed"] = settings.orbitSpeed;
    json["tooltips"] = settings.tooltips;
    json["show_hints"] = settings.showHints;
    json["autosave"] = settings.autosave;
    json["layout"] = settings.layout;
    json["layout_scale"] = settings.layoutScale;
    json["panels"] = settings.panels;
    json["shortcuts"] = settings.shortcuts;
    json["folders"] = settings.folders;
    json["window_width"] = settings.windowWidth;
    json["window_height"] = settings.windowHeight;
    json["maximized"] = settings.maximized;
    return json;
}

/// The value where there is one of the right kind; a setting that is broken must not take the others with it.
template <typename Value>
void take(const Json& json, const char* key, Value& value) {
    const auto found = json.find(key);
    if (found == json.end()) return;
    try {
        value = found->get<Value>();
    } catch (const nlohmann::json::exception&) {
        logWarning("{}: \"{}\" is not of the expected kind; the default is used", kFile, key);
    }
}

template <typename Value>
void takeWithin(const Json& json, const char* key, Value& value, Value minimum, Value maximum) {
    take(json, key, value);
    value = value >= minimum && value <= maximum ? value : std::clamp(value, minimum, maximum);
    if (value != value) value = minimum; // no number at all
}

Settings fromJson(const Json& json) {
    Settings settings;
    std::string theme = "dark";
    take(json, "theme", theme);
    settings.theme = theme == "light" ? Theme::Light : Theme::Dark;
    takeWithin(json, "text_scale", settings.textScale, 0.5f, 3.0f);
    take(json, "invert_zoom", settings.invertZoom);
    takeWithin(json, "fly_speed", settings.flySpeed, 0.05f, 50.0f);
    takeWithin(json, "orbit_speed", settings.orbitSpeed, 0.1f, 5.0f);
    take(json, "tooltips", settings.tooltips);
    take(json, "show_hints", settings.showHints);
    take(json, "autosave", settings.autosave);
    take(json, "layout", settings.layout);
    takeWithin(json, "layout_scale", settings.layoutScale, 0.1f, 20.0f);
    take(json, "panels", settings.panels);
    take(json, "shortcuts", settings.shortcuts);
    take(json, "folders", settings.folders);
    takeWithin(json, "window_width", settings.windowWidth, 320, 16384);
    takeWithin(json, "window_height", settings.windowHeight, 240, 16384);
    take(json, "maximized", settings.maximized);
    return settings;
}

std::string textOf(const Settings& settings) {
    // Paths may hold bytes that are no UTF-8; they must not stop the rest from being kept.
    return toJson(settings).dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

} // namespace

Settings readSettings(const std::filesystem::path& folder) {
    const std::filesystem::path file = folder / kFile;
    const Result<std::string> text = readTextFile(file);
    if (!text) {
        if (text.error().code != ErrorCode::NotFound) logWarning("settings: {}", text.error().describe());
        return {};
    }
    const Json json = Json::parse(*text, nullptr, false);
    if (json.is_object()) return fromJson(json);
    const std::filesystem::path aside = folder / "settings.broken.json";
    std::error_code error;
    std::filesystem::rename(file, aside, error);
    logWarning("{}: not a JSON object; kept as {}, the defaults are used", file.string(), aside.filename().string());
    return {};
}

Status writeSettings(const std::filesystem::path& folder, const Settings& settings) {
    return writeFileAtomic(folder / kFile, std::string_view(textOf(settings)));
}

SettingsKeeper::SettingsKeeper(std::filesystem::path folder, const Settings& current)
    : folder_(std::move(folder)), written_(textOf(current)) {}

SettingsKeeper::~SettingsKeeper() {
    if (writing_.valid()) writing_.wait();
}

void SettingsKeeper::update(const Settings& settings) {
    if (writing_.valid()) {
        if (writing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return;
        writing_.get();
    }
    std::string text = textOf(settings);
    if (text == written_) return;
    written_ = text;
    writing_ = std::async(std::launch::async, [file = folder_ / kFile, content = std::move(text)] {
        const Status status = writeFileAtomic(file, std::string_view(content));
        if (!status) logWarning("settings: {}", status.error().describe());
    });
}

void SettingsKeeper::flush(const Settings& settings) {
    if (writing_.valid()) writing_.get();
    const std::string text = textOf(settings);
    if (text == written_) return;
    written_ = text;
    const Status status = writeFileAtomic(folder_ / kFile, std::string_view(text));
    if (!status) logWarning("settings: {}", status.error().describe());
}

} // namespace ars::ui
