#include "engine/rig/joint_names.h"

#include "engine/rig/skeleton.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>

namespace ars {
namespace {

bool isUpper(char c) { return c >= 'A' && c <= 'Z'; }
bool isLower(char c) { return c >= 'a' && c <= 'z'; }
bool isDigit(char c) { return c >= '0' && c <= '9'; }
char lower(char c) { return isUpper(c) ? static_cast<char>(c - 'A' + 'a') : c; }

/// Lower-case words: cut at separators, at "aB" and before the last capital of "ABc".
std::vector<std::string> splitWords(std::string_view name) {
    std::vector<std::string> words;
    bool open = false;
    for (std::size_t i = 0; i < name.size(); ++i) {
        const char c = name[i];
        if (!isUpper(c) && !isLower(c) && !isDigit(c)) {
            open = false;
            continue;
        }
        const char before = i > 0 ? name[i - 1] : ' ';
        const char after = i + 1 < name.size() ? name[i + 1] : ' ';
        if (isUpper(c) && (!isUpper(before) || isLower(after))) open = false;
        if (!open) words.emplace_back();
        words.back() += lower(c);
        open = true;
    }
    return words;
}

constexpr std::string_view kRigPrefixes[] = {"mixamorig", "mixamorig1", "mixamorig2", "def",   "org",   "mch",
                                             "bip",       "bip01",      "bip001",     "valve", "biped", "cc",
                                             "base",      "j",          "jnt",        "bone",  "f",     "c"};

template <typename Range>
bool contains(const Range& range, std::string_view word) {
    return std::find(std::begin(range), std::end(range), word) != std::end(range);
}

struct KnownBase {
    std::string_view base;
    std::string_view joint; ///< SMPL-X name, without left_/right_ where it has a side
    bool sided;
};

// Sorted by joint. A trailing number is dropped before a base is sought a second time ("upperarm02", "thigh001").
constexpr KnownBase kBases[] = {
    {"pelvis", "pelvis", false},     {"hips", "pelvis", false},
    {"hip", "pelvis", false},        {"root", "pelvis", false},
    {"spine05", "pelvis", false},    {"spine", "spine1", false},
    {"spine0", "spine1", false},     {"spine001", "spine1", false},
    {"spine1", "spine1", false},     {"spine04", "spine1", false},
    {"spine03", "spine1", false},    {"abdomen", "spine1", false},
    {"lowerback", "spine1", false},  {"torso", "spine1", false},
    {"spine002", "spine2", false},   {"spine2", "spine2", false},
    {"spine02", "spine2", false},    {"chest", "spine2", false},
    {"spine003", "spine3", false},   {"spine3", "spine3", false},
    {"spine01", "spine3", false},    {"chest2", "spine3", false},
    {"chest3", "spine3", false},     {"chest4", "spine3", false},
    {"upperchest", "spine3", false}, {"spine4", "spine3", false},
    {"spine004", "neck", false},     {"spine005", "neck", false},
    {"neck", "neck", false},         {"lowerneck", "neck", false},
    {"spine006", "head", false},     {"head", "head", false},
    {"jaw", "jaw", false},           {"hip", "hip", true},
    {"upleg", "hip", true},          {"upperleg", "hip", true},
    {"thigh", "hip", true},          {"knee", "knee", true},
    {"leg", "knee", true},           {"loleg", "knee", true},
    {"lowleg", "knee", true},        {"lowerleg", "knee", true},
    {"shin", "knee", true},          {"calf", "knee", true},
    {"ankle", "ankle", true},        {"foot", "ankle", true},
    {"toe", "foot", true},           {"toes", "foot", true},
    {"toebase", "foot", true},       {"ball", "foot", true},
    {"collar", "collar", true},      {"clavicle", "collar", true},
    {"collarbone", "collar", true},  {"shoulder01", "collar", true},
    {"shoulder", "shoulder", true},  {"shldr", "shoulder", true},
    {"arm", "shoulder", true},       {"uparm", "shoulder", true},
    {"upperarm", "shoulder", true},  {"elbow", "elbow", true},
    {"forearm", "elbow", true},      {"loarm", "elbow", true},
    {"lowarm", "elbow", true},       {"lowerarm", "elbow", true},
    {"wrist", "wrist", true},        {"hand", "wrist", true},
    {"eye", "eye_smplhf", true},     {"eyesmplhf", "eye_smplhf", true},
    {"fingers", "middle1", true},
};

struct FingerWord {
    std::string_view word;
    std::string_view finger;
};
constexpr FingerWord kFingerWords[] = {{"thumb", "thumb"},  {"index", "index"}, {"middle", "middle"},
                                       {"mid", "middle"},   {"ring", "ring"},   {"pinky", "pinky"},
                                       {"pinkie", "pinky"}, {"little", "pinky"}};
constexpr std::string_view kFingersByNumber[] = {"thumb", "index", "middle", "ring", "pinky"};

const KnownBase* findBase(std::string_view base, bool sided) {
    for (const KnownBase& known : kBases) {
        if (known.sided == sided && known.base == base) return &known;
    }
    return nullptr;
}

std::string_view withoutTrailingDigits(std::string_view text) {
    while (!text.empty() && isDigit(text.back())) text.remove_suffix(1);
    return text;
}

int sidedJoint(JointSide side, std::string_view joint) {
    return smplxJointIndex((side == JointSide::Left ? "left_" : "right_") + std::string(joint));
}

/// Which bone of a finger the rest of its name says: 1..3, or nothing (a metacarpal, a tip, another word).
std::optional<int> phalanx(std::string_view finger, std::string_view rest) {
    if (rest.empty() || rest == "proximal") return finger == "thumb" && !rest.empty() ? 2 : 1;
    if (rest == "metacarpal" && finger == "thumb") return 1;
    if (rest == "intermediate") return 2;
    if (rest == "distal") return 3;
    while (rest.size() > 1 && rest.front() == '0') rest.remove_prefix(1);
    if (rest.size() == 1 && rest[0] >= '1' && rest[0] <= '3') return rest[0] - '0';
    return std::nullopt;
}

/// MakeHuman's finger<1..5>-<1..3>, then every way of writing the finger's name and number.
int fingerJoint(std::string_view base, JointSide side) {
    if (side == JointSide::Middle) return -1;
    if (base.size() == 8 && base.substr(0, 6) == "finger" && base[6] >= '1' && base[6] <= '5' && base[7] >= '1' &&
        base[7] <= '3') {
        return sidedJoint(side, std::string(kFingersByNumber[base[6] - '1']) + base[7]);
    }
    for (const std::string_view prefix : {"hand", "finger"}) {
        if (base.substr(0, prefix.size()) == prefix) base.remove_prefix(prefix.size());
    }
    for (const FingerWord& known : kFingerWords) {
        if (base.substr(0, known.word.size()) != known.word) continue;
        const std::optional<int> bone = phalanx(known.finger, base.substr(known.word.size()));
        if (bone) return sidedJoint(side, std::string(known.finger) + std::to_string(*bone));
    }
    return -1;
}

int jointOfBase(const NormalisedJointName& name) {
    const bool sided = name.side != JointSide::Middle;
    const KnownBase* known = findBase(name.base, sided);
    // MakeHuman's toes are numbered twice ("toe2-1"); Rigify and MakeHuman cut limbs into numbered pieces.
    if (!known) known = findBase(withoutTrailingDigits(name.base), sided);
    if (!known) return fingerJoint(name.base, name.side);
    return sided ? sidedJoint(name.side, known->joint) : smplxJointIndex(known->joint);
}

/// "lhand": a side letter grown together with a known word.
void splitGrownSide(NormalisedJointName& name) {
    if (name.side != JointSide::Middle || name.base.size() < 4) return;
    const char first = name.base.front();
    if (first != 'l' && first != 'r') return;
    if (findBase(name.base, false)) return;
    const NormalisedJointName split{name.base.substr(1), first == 'l' ? JointSide::Left : JointSide::Right};
    if (jointOfBase(split) >= 0) name = split;
}

/// Takes the side out of one word ("left", "r", "lefthand"); empty when nothing is left of it.
void takeSide(std::string& word, bool atEnd, NormalisedJointName& name) {
    if (name.side != JointSide::Middle) return;
    for (const auto& [marker, side] : {std::pair{std::string_view("left"), JointSide::Left},
                                       std::pair{std::string_view("right"), JointSide::Right}}) {
        if (std::string_view(word).substr(0, marker.size()) == marker) {
            name.side = side;
            word.erase(0, marker.size());
            return;
        }
    }
    if (!atEnd || (word != "l" && word != "r")) return;
    name.side = word == "l" ? JointSide::Left : JointSide::Right;
    word.clear();
}

/// What all names of a rig together tell about those that are ambiguous alone.
struct RigNaming {
    bool shoulderIsCollar = false;
    bool footIsBall = false;
    bool spineCountsFromNothing = false; ///< Spine, Spine1, Spine2
    bool spineIsPelvis = false;          ///< Rigify: spine, spine.001, ...
    bool spineCountsUp = false;          ///< Unreal: spine_01 is the lowest; MakeHuman counts from the neck
};

RigNaming readNaming(const std::vector<NormalisedJointName>& names) {
    const auto has = [&](std::string_view base, bool sided) {
        return std::any_of(names.begin(), names.end(), [&](const NormalisedJointName& name) {
            return name.base == base && (name.side != JointSide::Middle) == sided;
        });
    };
    const bool hasPelvis = has("pelvis", false) || has("hips", false);
    RigNaming naming;
    naming.shoulderIsCollar = has("arm", true) || has("upperarm", true) || has("uparm", true);
    naming.footIsBall = has("ankle", true);
    naming.spineCountsFromNothing = has("spine", false) && has("spine1", false);
    naming.spineIsPelvis = has("spine", false) && has("spine001", false) && !hasPelvis;
    naming.spineCountsUp = has("spine01", false) && !has("spine05", false);
    return naming;
}

int jointInRig(const NormalisedJointName& name, const RigNaming& naming) {
    const auto spine = [](int number) { return smplxJointIndex("spine" + std::to_string(number)); };
    if (name.side != JointSide::Middle) {
        if (naming.shoulderIsCollar && name.base == "shoulder") return sidedJoint(name.side, "collar");
        if (naming.footIsBall && name.base == "foot") return sidedJoint(name.side, "foot");
        return jointOfBase(name);
    }
    if (naming.spineIsPelvis && name.base == "spine") return 0;
    if (naming.spineCountsFromNothing && (name.base == "spine1" || name.base == "spine2")) {
        return spine(name.base.back() - '0' + 1);
    }
    if (naming.spineCountsUp && name.base.size() == 7 && name.base.substr(0, 6) == "spine0") {
        return spine(std::clamp(name.base.back() - '0', 1, 3));
    }
    return jointOfBase(name);
}

/// MakeHuman conversions put a joint "__UpLeg_L" that never turns between a parent and "UpLeg_L".
bool isHelperName(std::string_view name) { return name.substr(0, 2) == "__"; }

} // namespace

NormalisedJointName normaliseJointName(std::string_view anyRigJointName) {
    const std::size_t colon = anyRigJointName.find_last_of(":|");
    if (colon != std::string_view::npos) anyRigJointName.remove_prefix(colon + 1);
    std::vector<std::string> words = splitWords(anyRigJointName);
    while (words.size() > 1 && contains(kRigPrefixes, words.front())) words.erase(words.begin());

    NormalisedJointName name;
    // A bone cut into pieces carries its side before the number: DEF-thigh.L.001.
    std::size_t last = words.empty() ? 0 : words.size() - 1;
    while (last > 0 && std::all_of(words[last].begin(), words[last].end(), isDigit)) --last;
    for (std::size_t i = 0; i < words.size(); ++i) takeSide(words[i], i == 0 || i == last, name);
    for (const std::string& word : words) name.base += word;
    splitGrownSide(name);
    return name;
}

int smplxJointForName(std::string_view anyRigJointName) {
    const int exact = smplxJointIndex(anyRigJointName);
    if (exact >= 0) return exact;
    if (isHelperName(anyRigJointName)) return -1;
    const NormalisedJointName name = normaliseJointName(anyRigJointName);
    RigNaming naming;
    if (anyRigJointName.substr(0, 9) == "mixamorig") {
        naming.shoulderIsCollar = naming.spineCountsFromNothing = true;
    }
    const bool rigify = anyRigJointName.substr(0, 4) == "DEF-" || anyRigJointName.substr(0, 4) == "ORG-";
    naming.spineIsPelvis = rigify;
    naming.shoulderIsCollar |= rigify;
    // Unreal writes spine_01, MakeHuman spine01.
    naming.spineCountsUp = anyRigJointName.substr(0, 7) == "spine_0";
    return jointInRig(name, naming);
}

std::vector<int> smplxJointsForNames(std::span<const std::string> names) {
    // A rig that is SMPL-X by name is taken at its word.
    const auto exact = [](const std::string& name) { return smplxJointIndex(name) >= 0; };
    const bool isSmplx = std::count_if(names.begin(), names.end(), exact) > 20;
    std::vector<NormalisedJointName> normalised;
    normalised.reserve(names.size());
    for (const std::string& name : names) normalised.push_back(normaliseJointName(name));
    const RigNaming naming = readNaming(normalised);
    std::vector<int> joints(names.size(), -1);
    for (std::size_t i = 0; i < names.size(); ++i) {
        if (isHelperName(names[i])) continue;
        joints[i] = isSmplx ? smplxJointForName(names[i]) : jointInRig(normalised[i], naming);
    }
    return joints;
}

} // namespace ars
