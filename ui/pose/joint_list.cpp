#include "ui/pose/joint_list.h"

#include <algorithm>
#include <cctype>

namespace ars::ui {
namespace {

bool contains(std::string_view text, std::string_view part) { return text.find(part) != std::string_view::npos; }

char lower(char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); }

bool isSeparator(char c) { return !std::isalnum(static_cast<unsigned char>(c)); }

/// Whether typed[next...] fits into name[from...]; `running`: the letter before `from` was the last that fitted.
bool fits(std::string_view name, std::size_t from, std::string_view typed, std::size_t next, bool running) {
    while (next < typed.size() && isSeparator(typed[next])) ++next;
    if (next == typed.size()) return true;
    for (std::size_t i = from; i < name.size(); ++i) {
        const bool wordBegins = i == 0 || isSeparator(name[i - 1]) ||
                                (std::isdigit(static_cast<unsigned char>(name[i])) &&
                                 !std::isdigit(static_cast<unsigned char>(name[i - 1])));
        const bool continues = running && i == from;
        if ((wordBegins || continues) && lower(name[i]) == lower(typed[next]) &&
            fits(name, i + 1, typed, next + 1, true)) {
            return true;
        }
    }
    return false;
}

JointGroup groupOf(std::string_view name) {
    constexpr std::array fingers{"index", "middle", "pinky", "ring", "thumb"};
    for (const char* finger : fingers) {
        if (!contains(name, finger)) continue;
        if (contains(name, "left")) return JointGroup::LeftHand;
        if (contains(name, "right")) return JointGroup::RightHand;
    }
    if (name == "jaw" || contains(name, "eye")) return JointGroup::Face;
    return JointGroup::Body;
}

} // namespace

const char* jointGroupLabel(JointGroup group) {
    switch (group) {
    case JointGroup::Body:
        return "Body";
    case JointGroup::LeftHand:
        return "Left hand";
    case JointGroup::RightHand:
        return "Right hand";
    case JointGroup::Face:
        return "Face";
    }
    return "";
}

std::string friendlyName(std::string_view name) {
    constexpr std::string_view ending = "_smplhf";
    if (name.size() > ending.size() && name.substr(name.size() - ending.size()) == ending) {
        name.remove_suffix(ending.size());
    }
    std::string text;
    for (char c : name) {
        if (c == '_') c = ' ';
        const bool digit = std::isdigit(static_cast<unsigned char>(c)) != 0;
        if (digit && !text.empty() && std::isalpha(static_cast<unsigned char>(text.back()))) text += ' ';
        text += c;
    }
    if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
    return text;
}

bool matchesSearch(std::string_view name, std::string_view typed) { return fits(name, 0, typed, 0, false); }

JointTree jointTree(const Skeleton& skeleton) {
    JointTree tree;
    tree.nodes.resize(static_cast<std::size_t>(skeleton.jointCount()));
    for (int joint = 0; joint < skeleton.jointCount(); ++joint) {
        JointNode& node = tree.nodes[static_cast<std::size_t>(joint)];
        node.joint = joint;
        node.label = friendlyName(skeleton.names[static_cast<std::size_t>(joint)]);
        node.group = groupOf(skeleton.names[static_cast<std::size_t>(joint)]);
        const int parent = skeleton.parents[static_cast<std::size_t>(joint)];
        const bool sameGroup = parent >= 0 && tree.nodes[static_cast<std::size_t>(parent)].group == node.group;
        if (sameGroup) {
            tree.nodes[static_cast<std::size_t>(parent)].children.push_back(joint);
        } else {
            tree.beginners[static_cast<std::size_t>(node.group)].push_back(joint);
        }
    }
    return tree;
}

} // namespace ars::ui
