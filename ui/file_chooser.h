#pragma once

#include "ui/studio.h"

#include <cstdint>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace ars::ui {

/// One entry of a folder.
struct FolderEntry {
    std::string name;
    bool folder = false;
    std::uint64_t bytes = 0;
    std::filesystem::file_time_type changed{};
};
/// Folders first, then files, by name without regard to case; hidden ones and what cannot be read are left out.
/// `error` says why nothing is listed.
struct FolderListing {
    std::filesystem::path folder;
    std::vector<FolderEntry> entries;
    std::string error;
};
FolderListing listFolder(const std::filesystem::path& folder);

/// Asks for a file: with the desktop's chooser where zenity, kdialog or the like is installed, else with one of our own
/// (also where the environment says ARS_FILE_CHOOSER=internal). Neither keeps the window waiting: folders are read
/// beside it.
class FileChooser {
public:
    FileChooser();
    ~FileChooser();
    /// A question that is still open is dropped for the new one.
    void ask(StudioContext& context, FileQuestion question);
    bool isOpen() const { return question_.has_value(); }
    void draw(StudioContext& context);

private:
    struct Desktop;
    void drawDesktop(StudioContext& context);
    void drawOwn(StudioContext& context);
    void drawPlaces(StudioContext& context);
    void drawEntries(StudioContext& context);
    void drawBottom(StudioContext& context);
    void go(const std::filesystem::path& folder);
    void pickUpListing();
    void accept(StudioContext& context, bool replacing);
    void answer(StudioContext& context, const std::filesystem::path& file);
    std::vector<const FolderEntry*> shownEntries() const;
    bool fits(const std::string& name) const;

    std::optional<FileQuestion> question_;
    std::unique_ptr<Desktop> desktop_; ///< while the desktop's chooser is open
    std::filesystem::path folder_;
    FolderListing listing_;
    std::future<FolderListing> reading_;
    std::string pathText_, name_, search_, complaint_;
    bool allFiles_ = false;
    bool appearing_ = false;
    bool confirmReplace_ = false;
};

} // namespace ars::ui
