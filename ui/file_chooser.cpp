#include "ui/file_chooser.h"

#include "engine/core/buffer.h"
#include "ui/widgets.h"

#include <imgui_internal.h>
#include <imgui_stdlib.h>
#include <portable_file_dialogs.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <set>

namespace ars::ui {
namespace {

namespace fs = std::filesystem;

std::string lower(std::string text) {
    for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return text;
}

fs::path homeFolder() {
    const char* home = std::getenv("HOME");
    return home && *home ? fs::path(home) : fs::path("/");
}

bool isFolder(const fs::path& path) {
    std::error_code ignored;
    return fs::is_directory(path, ignored);
}

bool desktopHasChooser() {
    const char* choice = std::getenv("ARS_FILE_CHOOSER");
    if (choice && std::string_view(choice) == "internal") return false;
    if (!std::getenv("DISPLAY") && !std::getenv("WAYLAND_DISPLAY")) return false;
    static const bool available = pfd::settings::available(); // starts processes: once
    return available;
}

std::string dateText(fs::file_time_type time) {
    const auto system = std::chrono::file_clock::to_sys(time);
    const std::time_t seconds =
        std::chrono::system_clock::to_time_t(std::chrono::time_point_cast<std::chrono::system_clock::duration>(system));
    std::tm local{};
    localtime_r(&seconds, &local);
    char text[32];
    return std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M", &local) ? text : "";
}

/// "*.exr *.hdr"
std::string pattern(const std::vector<std::string>& endings) {
    std::string text;
    for (const std::string& ending : endings) text += fmt::format("{}*{}", text.empty() ? "" : " ", ending);
    return text;
}

} // namespace

FolderListing listFolder(const fs::path& folder) {
    FolderListing listing{folder, {}, {}};
    std::error_code error;
    fs::directory_iterator iterator(folder, fs::directory_options::skip_permission_denied, error);
    for (; !error && iterator != fs::directory_iterator(); iterator.increment(error)) {
        FolderEntry entry;
        entry.name = iterator->path().filename().string();
        if (entry.name.empty() || entry.name[0] == '.') continue;
        std::error_code ignored;
        entry.folder = iterator->is_directory(ignored);
        if (!entry.folder) entry.bytes = iterator->file_size(ignored);
        if (ignored) entry.bytes = 0;
        entry.changed = iterator->last_write_time(ignored);
        listing.entries.push_back(std::move(entry));
    }
    if (error) listing.error = error.message();
    std::sort(listing.entries.begin(), listing.entries.end(), [](const FolderEntry& a, const FolderEntry& b) {
        if (a.folder != b.folder) return a.folder;
        const std::string x = lower(a.name), y = lower(b.name);
        return x != y ? x < y : a.name < b.name;
    });
    return listing;
}

/// The desktop's chooser is a process of its own.
struct FileChooser::Desktop {
    std::unique_ptr<pfd::open_file> open;
    std::unique_ptr<pfd::save_file> save;
    std::unique_ptr<pfd::select_folder> folder;
};

FileChooser::FileChooser() = default;
FileChooser::~FileChooser() = default;

void FileChooser::ask(StudioContext& context, FileQuestion question) {
    desktop_.reset();
    question_ = std::move(question);
    const auto known = context.settings.folders.find(question_->folderKey);
    folder_ =
        known != context.settings.folders.end() && isFolder(known->second) ? fs::path(known->second) : homeFolder();
    if (desktopHasChooser()) {
        desktop_ = std::make_unique<Desktop>();
        const std::string start = (folder_ / question_->suggestedName).string();
        std::vector<std::string> filters;
        if (!question_->endings.empty()) filters = {question_->title, pattern(question_->endings)};
        filters.insert(filters.end(), {"All files", "*"});
        if (question_->folder)
            desktop_->folder = std::make_unique<pfd::select_folder>(question_->title, start);
        else if (question_->saving)
            desktop_->save = std::make_unique<pfd::save_file>(question_->title, start, filters);
        else
            desktop_->open = std::make_unique<pfd::open_file>(question_->title, folder_.string() + "/", filters);
        return;
    }
    name_ = question_->suggestedName;
    search_.clear();
    complaint_.clear();
    allFiles_ = question_->endings.empty();
    confirmReplace_ = false;
    appearing_ = true;
    go(folder_);
}

void FileChooser::go(const fs::path& folder) {
    folder_ = folder.lexically_normal();
    if (!folder_.has_filename() && folder_.has_parent_path() && folder_ != folder_.root_path()) {
        folder_ = folder_.parent_path(); // without the slash at the end
    }
    pathText_ = folder_.string();
    listing_ = {folder_, {}, {}};
    search_.clear();
    complaint_.clear();
    confirmReplace_ = false;
    // An older listing that is still being read is waited for on a thread of its own, never here.
    if (reading_.valid()) {
        std::thread([old = std::move(reading_)]() mutable { old.wait(); }).detach();
    }
    std::packaged_task<FolderListing()> task([where = folder_] { return listFolder(where); });
    reading_ = task.get_future();
    std::thread(std::move(task)).detach();
}

void FileChooser::pickUpListing() {
    if (reading_.valid() && reading_.wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
        listing_ = reading_.get();
    }
}

bool FileChooser::fits(const std::string& name) const {
    if (allFiles_) return true;
    const std::string small = lower(name);
    return std::any_of(question_->endings.begin(), question_->endings.end(),
                       [&](const std::string& ending) { return small.ends_with(ending); });
}

std::vector<const FolderEntry*> FileChooser::shownEntries() const {
    std::vector<const FolderEntry*> shown;
    const std::string wanted = lower(search_);
    for (const FolderEntry& entry : listing_.entries) {
        if (question_->folder && !entry.folder) continue;
        if (!entry.folder && !fits(entry.name)) continue;
        if (wanted.empty() || lower(entry.name).find(wanted) != std::string::npos) shown.push_back(&entry);
    }
    return shown;
}

void FileChooser::answer(StudioContext& context, const fs::path& file) {
    const FileQuestion question = std::move(*question_);
    question_.reset();
    desktop_.reset();
    if (!question.folderKey.empty()) context.settings.folders[question.folderKey] = file.parent_path().string();
    if (question.chosen) question.chosen(file);
}

void FileChooser::accept(StudioContext& context, bool replacing) {
    complaint_.clear();
    if (name_.empty()) {
        if (question_->folder)
            answer(context, folder_);
        else
            complaint_ = question_->saving ? "Type a name for the file." : "Choose a file, or type its name.";
        return;
    }
    fs::path path = fs::path(name_).is_absolute() ? fs::path(name_) : folder_ / name_;
    if (name_ == "~" || name_.starts_with("~/"))
        path = homeFolder() / fs::path(name_.substr(std::min<std::size_t>(2, name_.size())));
    if (isFolder(path)) {
        name_.clear();
        if (question_->folder)
            answer(context, path);
        else
            go(path);
        return;
    }
    if (question_->saving && !path.has_extension() && !question_->endings.empty()) path += question_->endings.front();
    std::error_code ignored;
    const bool exists = fs::exists(path, ignored);
    if (question_->folder || (!question_->saving && !exists)) {
        complaint_ = fmt::format("There is no \"{}\".", path.string());
        return;
    }
    if (question_->saving && !isFolder(path.parent_path())) {
        complaint_ = fmt::format("There is no folder \"{}\".", path.parent_path().string());
        return;
    }
    if (question_->saving && exists && !replacing) {
        confirmReplace_ = true;
        return;
    }
    answer(context, path.lexically_normal());
}

void FileChooser::draw(StudioContext& context) {
    if (!question_) return;
    if (desktop_)
        drawDesktop(context);
    else
        drawOwn(context);
}

void FileChooser::drawDesktop(StudioContext& context) {
    std::string chosen;
    bool done = false;
    if (desktop_->open && desktop_->open->ready(0)) {
        const std::vector<std::string> files = desktop_->open->result();
        chosen = files.empty() ? "" : files.front();
        done = true;
    } else if (desktop_->save && desktop_->save->ready(0)) {
        chosen = desktop_->save->result();
        done = true;
    } else if (desktop_->folder && desktop_->folder->ready(0)) {
        chosen = desktop_->folder->result();
        done = true;
    }
    if (!done) return;
    fs::path path = chosen;
    if (!chosen.empty() && question_->saving && !path.has_extension() && !question_->endings.empty()) {
        path += question_->endings.front();
    }
    if (chosen.empty()) {
        question_.reset();
        desktop_.reset();
    } else {
        answer(context, path);
    }
}

void FileChooser::drawPlaces(StudioContext& context) {
    const auto place = [&](const char* symbol, const std::string& label, const fs::path& folder) {
        const std::string text = haveIcons() ? fmt::format("{}  {}###{}", symbol, label, folder.string()) : label;
        if (ImGui::Selectable(text.c_str(), folder == folder_)) go(folder);
        help(context, folder.c_str());
    };
    place(icon::kHome, "Home", homeFolder());
    place(icon::kMonitor, "Computer", "/");
    std::set<fs::path> seen{homeFolder(), "/"};
    const auto add = [&](const fs::path& folder) {
        if (folder.empty() || seen.size() > 14 || !seen.insert(folder).second) return;
        const std::string name = folder.filename().string();
        place(icon::kFolder, name.empty() ? folder.string() : name, folder);
    };
    heading("Recent");
    for (const auto& [key, folder] : context.settings.folders) add(folder);
    for (const fs::path& file : context.session.recentFiles().files()) add(file.parent_path());
}

void FileChooser::drawEntries(StudioContext& context) {
    const float size = ImGui::GetFontSize();
    constexpr ImGuiTableFlags kFlags = ImGuiTableFlags_ScrollY | ImGuiTableFlags_RowBg;
    if (!ImGui::BeginTable("Entries", 3, kFlags, ImVec2(0, 0))) return;
    ImGui::TableSetupColumn("Name", ImGuiTableColumnFlags_WidthStretch);
    ImGui::TableSetupColumn("Size", ImGuiTableColumnFlags_WidthFixed, size * 5.5f);
    ImGui::TableSetupColumn("Changed", ImGuiTableColumnFlags_WidthFixed, size * 9.0f);
    const std::vector<const FolderEntry*> entries = shownEntries();
    fs::path next;
    bool chosen = false;
    ImGuiListClipper clipper;
    clipper.Begin(static_cast<int>(entries.size()));
    while (clipper.Step()) {
        for (int row = clipper.DisplayStart; row < clipper.DisplayEnd; ++row) {
            const FolderEntry& entry = *entries[static_cast<std::size_t>(row)];
            ImGui::TableNextRow();
            ImGui::TableNextColumn();
            const char* symbol = entry.folder ? icon::kFolder : icon::kFile;
            const std::string text = haveIcons()
                                         ? fmt::format("{}  {}###{}", symbol, entry.name, entry.name)
                                         : fmt::format("{}{}###{}", entry.name, entry.folder ? "/" : "", entry.name);
            constexpr ImGuiSelectableFlags kRow =
                ImGuiSelectableFlags_SpanAllColumns | ImGuiSelectableFlags_AllowDoubleClick;
            if (ImGui::Selectable(text.c_str(), name_ == entry.name, kRow)) {
                name_ = entry.name;
                confirmReplace_ = false;
                if (ImGui::IsMouseDoubleClicked(0) && entry.folder)
                    next = folder_ / entry.name;
                else if (ImGui::IsMouseDoubleClicked(0))
                    chosen = true;
            }
            ImGui::TableNextColumn();
            if (!entry.folder) ImGui::TextColored(mutedColor(), "%s", formatBytes(entry.bytes).c_str());
            ImGui::TableNextColumn();
            ImGui::TextColored(mutedColor(), "%s", dateText(entry.changed).c_str());
        }
    }
    ImGui::EndTable();
    if (!next.empty()) {
        name_ = question_->saving ? question_->suggestedName : "";
        go(next);
    }
    if (chosen) accept(context, false);
}

void FileChooser::drawBottom(StudioContext& context) {
    const ImGuiStyle& style = ImGui::GetStyle();
    const float size = ImGui::GetFontSize();
    ImGui::AlignTextToFramePadding();
    ImGui::TextUnformatted(question_->folder ? "Folder" : "Name");
    ImGui::SameLine();
    const bool filter = !question_->endings.empty();
    ImGui::SetNextItemWidth(filter ? -size * 11.0f - style.ItemSpacing.x : -FLT_MIN);
    if (appearing_) ImGui::SetKeyboardFocusHere();
    const bool entered =
        ImGui::InputText("###Name", &name_, ImGuiInputTextFlags_EnterReturnsTrue | ImGuiInputTextFlags_AutoSelectAll);
    help(context, "The name of a file in this folder, or a whole path");
    if (filter) {
        ImGui::SameLine();
        ImGui::SetNextItemWidth(-FLT_MIN);
        const std::string kinds = pattern(question_->endings);
        if (ImGui::BeginCombo("###Kinds", allFiles_ ? "All files" : kinds.c_str())) {
            if (ImGui::Selectable(kinds.c_str(), !allFiles_)) allFiles_ = false;
            if (ImGui::Selectable("All files", allFiles_)) allFiles_ = true;
            ImGui::EndCombo();
        }
    }
    const char* verb = question_->saving ? "Save" : "Open";
    const float buttons = size * 7.0f * 2 + style.ItemSpacing.x;
    if (!complaint_.empty())
        ImGui::TextColored(badColor(), "%s", complaint_.c_str());
    else if (confirmReplace_)
        ImGui::Text("\"%s\" exists.", fs::path(name_).filename().c_str());
    else if (reading_.valid())
        ImGui::TextColored(mutedColor(), "Reading the folder ...");
    else if (!listing_.error.empty())
        ImGui::TextColored(badColor(), "%s", listing_.error.c_str());
    else
        ImGui::TextUnformatted("");
    ImGui::SameLine(ImGui::GetContentRegionMax().x - buttons);
    if (ImGui::Button("Cancel", {size * 7.0f, 0})) question_.reset();
    if (!question_) return;
    ImGui::SameLine();
    ImGui::PushStyleColor(ImGuiCol_Text, accentColor());
    const bool pressed =
        ImGui::Button(fmt::format("{}###Accept", confirmReplace_ ? "Replace" : verb).c_str(), {size * 7.0f, 0});
    ImGui::PopStyleColor();
    if (pressed || entered) accept(context, confirmReplace_);
}

void FileChooser::drawOwn(StudioContext& context) {
    pickUpListing();
    const std::string window = question_->title + "###FileChooser";
    const float size = ImGui::GetFontSize();
    const ImGuiViewport* viewport = ImGui::GetMainViewport();
    if (appearing_) ImGui::OpenPopup(window.c_str());
    ImGui::SetNextWindowPos(viewport->GetCenter(), ImGuiCond_Always, {0.5f, 0.5f});
    ImGui::SetNextWindowSize(
        {std::min(size * 54, viewport->Size.x * 0.94f), std::min(size * 36, viewport->Size.y * 0.9f)},
        ImGuiCond_Always);
    constexpr ImGuiWindowFlags kFlags =
        ImGuiWindowFlags_NoResize | ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_NoSavedSettings;
    if (!ImGui::BeginPopupModal(window.c_str(), nullptr, kFlags)) {
        if (!appearing_) question_.reset();
        return;
    }
    if (toolButton(icon::kUp, "Up. To the folder above") && folder_.has_parent_path()) go(folder_.parent_path());
    ImGui::SameLine();
    ImGui::SetNextItemWidth(-size * 12.0f);
    if (ImGui::InputText("###Path", &pathText_, ImGuiInputTextFlags_EnterReturnsTrue)) {
        if (isFolder(pathText_))
            go(pathText_);
        else
            complaint_ = fmt::format("There is no folder \"{}\".", pathText_);
    }
    ImGui::SameLine();
    ImGui::SetNextItemWidth(-FLT_MIN);
    ImGui::InputTextWithHint("###Search", "Search", &search_);
    const float bottom = ImGui::GetFrameHeightWithSpacing() * 2 + ImGui::GetStyle().ItemSpacing.y;
    ImGui::BeginChild("Places", {size * 10.0f, -bottom});
    drawPlaces(context);
    ImGui::EndChild();
    ImGui::SameLine();
    ImGui::BeginChild("Folder", {0, -bottom});
    drawEntries(context);
    ImGui::EndChild();
    if (question_) drawBottom(context);
    appearing_ = false;
    if (question_ && ImGui::IsKeyPressed(ImGuiKey_Escape, false)) question_.reset();
    if (!question_) ImGui::CloseCurrentPopup();
    ImGui::EndPopup();
}

} // namespace ars::ui
