#pragma once

#include "ui/panel.h"

#include <string>
#include <vector>

namespace ars::ui {

/// A list of everything that can be called, found by typing letters of its name. What a command must be told is asked
/// for step by step: choices as a list, files with the chooser, numbers and words in a field.
class CommandPalette {
public:
    void open();
    /// Straight to the questions of one command.
    void openFor(const Command& command);
    bool isOpen() const { return open_; }
    void draw(StudioContext& context);

private:
    struct Entry {
        std::string id;
        std::string text; ///< "Camera: Focus"
        std::string help;
        std::string keys;
        bool enabled = true;
        int score = 0;
    };
    std::vector<Entry> findEntries(StudioContext& context) const;
    void drawList(StudioContext& context);
    void drawQuestion(StudioContext& context);
    bool chooseFrom(const std::vector<std::string>& words, std::string& word);
    void call(StudioContext& context, const std::string& id);
    void begin(const Command& command);
    void answer(StudioContext& context, nlohmann::json value);
    const CommandArgument* question() const;
    void close();
    bool moveSelection(int count);

    bool open_ = false;
    bool appearing_ = false;
    bool scroll_ = false;
    std::string text_;
    int selected_ = 0;
    const Command* command_ = nullptr; ///< whose arguments are asked for
    std::size_t argument_ = 0;
    Arguments given_ = Arguments::object();
    std::string complaint_;
};

} // namespace ars::ui
