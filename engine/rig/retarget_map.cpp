#include "engine/core/file.h"
#include "engine/rig/joint_names.h"
#include "engine/rig/retarget.h"
#include "engine/rig/retarget_joints.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <map>
#include <new>

namespace ars {
namespace {

using nlohmann::json;

/// Joints without which a transfer makes no sense.
constexpr std::array kNeeded{"pelvis",        "left_hip",       "right_hip",  "left_knee",  "right_knee",
                             "left_shoulder", "right_shoulder", "left_elbow", "right_elbow"};
constexpr int kBodyJoints = 22;
constexpr std::size_t kMaxMapBytes = 1 << 20;

Error badMap(std::string place, std::string message) {
    return makeError(ErrorCode::BadFile, std::move(place), std::move(message));
}

Result<std::vector<std::string>> parseChain(const std::string& place, const json& value) {
    std::vector<std::string> chain;
    if (value.is_string())
        chain.push_back(value.get<std::string>());
    else if (value.is_array()) {
        for (const json& name : value) {
            if (!name.is_string()) return badMap(place, "expected joint names, found " + std::string(name.type_name()));
            chain.push_back(name.get<std::string>());
        }
    } else
        return badMap(place, "expected a joint name or a list of them, found " + std::string(value.type_name()));
    return chain;
}

Result<std::string> parseText(const json& object, const char* key) {
    const auto found = object.find(key);
    if (found == object.end()) return std::string();
    if (!found->is_string()) return badMap(key, "expected text, found " + std::string(found->type_name()));
    return found->get<std::string>();
}

Result<RetargetMap> parseMapObject(const json& object) {
    if (!object.is_object()) return badMap("", "expected a JSON object, found " + std::string(object.type_name()));
    RetargetMap map;
    ARS_TRY(map.name, parseText(object, "name"));
    ARS_TRY(map.about, parseText(object, "about"));
    ARS_TRY(const std::string up, parseText(object, "up"));
    if (!up.empty()) {
        auto axis = parseUpAxis(up);
        if (!axis) return badMap("up", axis.error().message);
        map.up = *axis;
    }
    if (const auto unit = object.find("metres_per_unit"); unit != object.end()) {
        if (!unit->is_number())
            return badMap("metres_per_unit", "expected a number, found " + std::string(unit->type_name()));
        map.metresPerUnit = unit->get<double>();
        if (!(map.metresPerUnit > 1e-9 && map.metresPerUnit < 1e9)) {
            return badMap("metres_per_unit", fmt::format("expected a positive length, found {}", map.metresPerUnit));
        }
    }
    const auto joints = object.find("joints");
    if (joints == object.end() || !joints->is_object()) return badMap("joints", "expected an object of joint names");
    for (const auto& [name, value] : joints->items()) {
        const int joint = smplxJointIndex(name);
        if (joint < 0) return badMap("joints", fmt::format("\"{}\" is no SMPL-X joint", name));
        ARS_TRY(map.joints[static_cast<std::size_t>(joint)], parseChain("joints." + name, value));
    }
    return map;
}

int countMapped(const MappedJoints& mapped, int begin, int end) {
    int count = 0;
    for (int j = begin; j < end; ++j) count += mapped.first[static_cast<std::size_t>(j)] >= 0;
    return count;
}

std::vector<std::string> missingNeeded(const MappedJoints& mapped) {
    std::vector<std::string> missing;
    for (const char* name : kNeeded) {
        if (mapped.first[static_cast<std::size_t>(smplxJointIndex(name))] < 0) missing.emplace_back(name);
    }
    return missing;
}

std::string joined(const std::vector<std::string>& words, std::size_t most) {
    std::string text;
    for (std::size_t i = 0; i < words.size() && i < most; ++i) text += (i ? ", " : "") + words[i];
    return words.size() > most ? text + " ..." : text;
}

} // namespace

std::string comparableJointName(std::string_view name) {
    const std::size_t space = name.find_last_of(":|");
    if (space != std::string_view::npos && space + 1 < name.size()) name.remove_prefix(space + 1);
    std::string plain;
    for (const char c : name) {
        const auto byte = static_cast<unsigned char>(c);
        if (byte >= 128)
            plain += c; // names in other scripts stay as they are
        else if (std::isalnum(byte))
            plain += static_cast<char>(std::tolower(byte));
    }
    constexpr std::string_view kMixamo = "mixamorig";
    if (plain.starts_with(kMixamo) && plain.size() > kMixamo.size()) {
        std::size_t cut = kMixamo.size();
        while (cut < plain.size() && std::isdigit(static_cast<unsigned char>(plain[cut]))) ++cut;
        plain.erase(0, cut);
    }
    return plain;
}

MappedJoints resolveMap(const RetargetMap& map, const Skeleton& source) {
    std::map<std::string, int> exact, comparable; // the first of a name counts
    for (int j = 0; j < source.jointCount(); ++j) {
        const std::string& name = source.names[static_cast<std::size_t>(j)];
        exact.emplace(name, j);
        comparable.emplace(comparableJointName(name), j);
    }
    const auto find = [&](const std::string& name) {
        // "Eye_L" must not become "__Eye_L", a helper joint before it.
        if (const auto found = exact.find(name); found != exact.end()) return found->second;
        const auto found = comparable.find(comparableJointName(name));
        return found == comparable.end() ? -1 : found->second;
    };
    MappedJoints mapped;
    mapped.first.fill(-1);
    mapped.last.fill(-1);
    for (std::size_t j = 0; j < map.joints.size(); ++j) {
        for (const std::string& name : map.joints[j]) {
            const int joint = find(name);
            if (joint < 0) continue;
            if (mapped.first[j] < 0) mapped.first[j] = joint;
            mapped.last[j] = joint;
        }
    }
    return mapped;
}

Status checkMapped(const MappedJoints& mapped, const std::string& mapName, const Skeleton& source) {
    const std::vector<std::string> missing = missingNeeded(mapped);
    if (missing.empty()) return {};
    return makeError(
        ErrorCode::NotFound, "",
        fmt::format("the joint map \"{}\" finds no {} among the joints {}; another map can be given as a file", mapName,
                    joined(missing, 9), joined(source.names, 12)));
}

Result<RetargetMap> parseRetargetMap(std::span<const std::byte> text) {
    if (text.size() > kMaxMapBytes) {
        return makeError(ErrorCode::LimitExceeded, "",
                         fmt::format("a joint map of {} bytes, the limit is {}", text.size(), kMaxMapBytes));
    }
    const char* begin = reinterpret_cast<const char*>(text.data());
    try {
        const json object = json::parse(begin, begin + text.size());
        return parseMapObject(object);
    } catch (const std::bad_alloc&) {
        return makeError(ErrorCode::OutOfMemory, "", fmt::format("no memory for a joint map of {} bytes", text.size()));
    } catch (const std::exception& error) {
        return badMap("", fmt::format("expected JSON: {}", error.what()));
    }
}

Result<RetargetMap> readRetargetMap(const std::filesystem::path& path) {
    ARS_TRY(const std::vector<std::byte> bytes, readFile(path));
    auto map = parseRetargetMap(bytes);
    if (!map) return atPlace(std::move(map).error(), path.string());
    if (map->name.empty()) map->name = path.stem().string();
    return map;
}

Result<std::vector<RetargetMap>> readRetargetMaps() {
    ARS_TRY(const std::filesystem::path resources, resourceFolder());
    std::vector<std::filesystem::path> paths;
    std::error_code error;
    for (std::filesystem::directory_iterator entry(resources / "retarget", error), end; !error && entry != end;
         entry.increment(error)) {
        if (entry->path().extension() == ".json") paths.push_back(entry->path());
    }
    if (error) return makeError(ErrorCode::Io, (resources / "retarget").string(), error.message());
    std::sort(paths.begin(), paths.end());
    std::vector<RetargetMap> maps;
    for (const std::filesystem::path& path : paths) {
        ARS_TRY(RetargetMap map, readRetargetMap(path));
        maps.push_back(std::move(map));
    }
    return maps;
}

RetargetMap recognisedMap(const Skeleton& source) {
    RetargetMap map;
    map.name = "recognised names";
    for (const std::string& name : source.names) {
        const int joint = smplxJointForName(name);
        if (joint < 0) continue;
        auto& chain = map.joints[static_cast<std::size_t>(joint)];
        if (chain.empty()) chain.push_back(name); // parents come first, so this is the nearest to the root
    }
    return map;
}

Result<RetargetMap> chooseRetargetMap(const Skeleton& source, std::span<const RetargetMap> maps) {
    const RetargetMap recognised = recognisedMap(source);
    const RetargetMap* best = &recognised;
    int bestScore = -1;
    const auto consider = [&](const RetargetMap& map) {
        const MappedJoints mapped = resolveMap(map, source);
        const int body = countMapped(mapped, 0, kBodyJoints);
        // Recognition guesses at fingers and toes; a map that somebody wrote leaves out what should not be moved.
        const int rest = &map == &recognised ? 0 : countMapped(mapped, kBodyJoints, kSmplxJointCount);
        const int score = (missingNeeded(mapped).empty() ? 10000 : 0) + 100 * body + rest;
        if (score <= bestScore) return;
        bestScore = score;
        best = &map;
    };
    for (const RetargetMap& map : maps) consider(map);
    consider(recognised); // last: on a tie the written map stays
    ARS_TRY_STATUS(checkMapped(resolveMap(*best, source), best->name, source));
    return *best;
}

} // namespace ars
