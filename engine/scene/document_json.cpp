#include "engine/scene/json_archive.h"
#include "engine/scene/project.h"

#include <fmt/format.h>

#include <algorithm>

namespace ars {
namespace detail {
namespace {

// Bounds of what a file may say; commands are stricter.
constexpr std::size_t kMaxKeys = 2'000'000;
constexpr std::size_t kMaxJoints = 4096;
constexpr std::size_t kMaxCoefficients = 1024;
constexpr std::size_t kMaxLamps = 64;
constexpr std::size_t kMaxStrip = 64;
constexpr NumberRange kAnyNumber{-1e9, 1e9}; ///< metres, seconds, degrees, coefficients
constexpr NumberRange kUnit{0.0, 1.0};
constexpr NumberRange kStops{-64.0, 64.0};
constexpr NumberRange kRadius{0.0, 10.0};

constexpr std::array<std::string_view, 5> kColorMapWords{"gray", "viridis", "magma", "turbo", "signed"};

std::span<const std::string_view> bufferWords() {
    static const std::vector<std::string_view> words = [] {
        std::vector<std::string_view> names;
        for (const BufferInfo& info : bufferCatalogue()) names.push_back(info.name);
        return names;
    }();
    return words;
}

template <typename Node, typename Enum>
void describeWord(Node&& node, Enum& value) {
    node.word(value, std::span<const std::string_view>(EnumWords<std::remove_const_t<Enum>>::words));
}

template <typename Node, typename Vector>
void describeVector(Node&& node, Vector& vector, NumberRange range = kAnyNumber) {
    node.numbers(std::span(&vector.x, 3), range);
}

template <typename Node, typename Coefficients>
void describeCoefficients(Node&& node, Coefficients& values) {
    node.list(values, kMaxCoefficients, [](auto&& item, auto& value) { item.number(value, kAnyNumber); });
}

template <typename Node>
void describe(Node&& node, Ref<Node, AvatarSection> avatar) {
    if (!node.object()) return;
    auto& [source, rest, betas] = avatar;
    node.at("source").path(source);
    node.at("rest").table(restAvatarParameters(), rest);
    describeCoefficients(node.at("betas"), betas);
}

template <typename Node>
void describe(Node&& node, Ref<Node, PoseSection> section) {
    if (!node.object()) return;
    auto& [pose, useLimits, keepOrientation] = section;
    auto& [rotations, translation, expression] = pose;
    node.at("rotations").list(rotations, kMaxJoints, [](auto&& item, auto& rotation) { item.rotation(rotation); });
    describeVector(node.at("translation"), translation);
    describeCoefficients(node.at("expression"), expression);
    node.at("limits").flag(useLimits);
    node.at("keep_orientation").flag(keepOrientation);
}

template <typename Node>
void describe(Node&& node, Ref<Node, SceneCamera> camera) {
    if (!node.object()) return;
    auto& [eye, target, rollDeg, verticalFieldDeg] = camera;
    describeVector(node.at("eye"), eye);
    describeVector(node.at("target"), target);
    node.at("roll").number(rollDeg, kAnyNumber);
    node.at("field").number(verticalFieldDeg, {0.01, 179.0});
}

template <typename Node>
void describe(Node&& node, Ref<Node, float> value) {
    node.number(value, kAnyNumber);
}

template <typename Node>
void describe(Node&& node, Ref<Node, glm::vec3> value) {
    describeVector(node, value);
}

template <typename Node>
void describe(Node&& node, Ref<Node, glm::quat> value) {
    node.rotation(value);
}

template <typename Node>
void describe(Node&& node, Ref<Node, std::vector<float>> value) {
    describeCoefficients(node, value);
}

/// Whoever samples or edits a track relies on its order; a file that was written by hand may lack it.
template <typename Value>
void restoreOrder(JsonReader& node, Track<Value>& track) {
    const auto apart = [](const Key<Value>& a, const Key<Value>& b) {
        return b.timeS - a.timeS >= 0.999 * kKeyTimeTolerance;
    };
    const auto wrong =
        std::adjacent_find(track.begin(), track.end(), [&](const auto& a, const auto& b) { return !apart(a, b); });
    if (wrong == track.end()) return;
    std::stable_sort(track.begin(), track.end(), [](const auto& a, const auto& b) { return a.timeS < b.timeS; });
    Track<Value> kept;
    for (Key<Value>& key : track) {
        if (kept.empty() || apart(kept.back(), key)) {
            kept.push_back(std::move(key));
        } else {
            kept.back() = std::move(key);
        }
    }
    node.note(
        fmt::format("the keys were not in order of time or came twice; {} of {} were kept", kept.size(), track.size()));
    track = std::move(kept);
}
template <typename Value>
void restoreOrder(JsonWriter&, const Track<Value>&) {}

template <typename Node, typename AnyTrack>
void describeTrack(Node&& node, AnyTrack& track) {
    node.list(track, kMaxKeys, [](auto&& item, auto& key) {
        if (!item.object()) return;
        auto& [timeS, value, interpolation] = key;
        item.at("time").number(timeS, kAnyNumber);
        describe(item.at("value"), value);
        describeWord(item.at("interpolation"), interpolation);
    });
    restoreOrder(node, track);
}

template <typename Node>
void describe(Node&& node, Ref<Node, JointTrack> track) {
    if (!node.object()) return;
    auto& [joint, layer, keys] = track;
    node.at("joint").number(joint, {0.0, static_cast<double>(kMaxJoints - 1)});
    describeWord(node.at("layer"), layer);
    describeTrack(node.at("keys"), keys);
}

/// One track for each joint and layer, in order; keys of a second one are added to the first.
void restoreJoints(JsonReader& node, std::vector<JointTrack>& tracks) {
    const auto before = [](const JointTrack& a, const JointTrack& b) {
        return a.joint != b.joint ? a.joint < b.joint : a.layer < b.layer;
    };
    const auto wrong =
        std::adjacent_find(tracks.begin(), tracks.end(), [&](const auto& a, const auto& b) { return !before(a, b); });
    if (wrong == tracks.end()) return;
    std::stable_sort(tracks.begin(), tracks.end(), before);
    std::vector<JointTrack> kept;
    for (JointTrack& track : tracks) {
        if (kept.empty() || before(kept.back(), track)) {
            kept.push_back(std::move(track));
            continue;
        }
        kept.back().keys.insert(kept.back().keys.end(), track.keys.begin(), track.keys.end());
        restoreOrder(node, kept.back().keys);
    }
    node.note("the tracks were not in the order of their joints or came twice; they were put in order");
    tracks = std::move(kept);
}
void restoreJoints(JsonWriter&, const std::vector<JointTrack>&) {}

void restoreRange(JsonReader& node, double& startS, double& endS) {
    if (startS <= endS) return;
    node.note("the range ended before it began; both were exchanged");
    std::swap(startS, endS);
}
void restoreRange(JsonWriter&, const double&, const double&) {}

/// One member for each of the nine parts, under its name.
template <typename Node, typename Values, typename Each>
void describeParts(Node&& node, Values& values, Each each) {
    if (!node.object()) return;
    for (std::size_t part = 0; part < values.size(); ++part) {
        each(node.at(bodyPartName(static_cast<BodyPart>(part))), values[part]);
    }
}

template <typename Node>
void describe(Node&& node, Ref<Node, TimelineSection> timeline) {
    if (!node.object()) return;
    auto& [clip, clipOffsetS, startS, endS, framesPerSecond, timeS, speed, loop, autoKey, joints, root, expression,
           camera, lightRotationDeg, lightExposureEv, radii] = timeline;
    node.at("clip").path(clip);
    node.at("clip_offset").number(clipOffsetS, kAnyNumber);
    node.at("start").number(startS, kAnyNumber);
    node.at("end").number(endS, kAnyNumber);
    restoreRange(node, startS, endS);
    node.at("rate").number(framesPerSecond, {0.01, 10000.0});
    node.at("time").number(timeS, kAnyNumber);
    node.at("speed").number(speed, {-1000.0, 1000.0});
    node.at("loop").flag(loop);
    node.at("auto_key").flag(autoKey);
    node.at("joints").list(joints, 2 * kMaxJoints,
                           [](auto&& item, auto& track) { describe(std::forward<decltype(item)>(item), track); });
    restoreJoints(node, joints);
    describeTrack(node.at("root"), root);
    describeTrack(node.at("expression"), expression);
    describeTrack(node.at("camera"), camera);
    describeTrack(node.at("light_rotation"), lightRotationDeg);
    describeTrack(node.at("light_exposure"), lightExposureEv);
    describeParts(node.at("radii"), radii, [](auto&& item, auto& track) { describeTrack(item, track); });
}

template <typename Node>
void describe(Node&& node, Ref<Node, CameraSection> section) {
    if (!node.object()) return;
    auto& [camera, capture, datasetCamera, photograph] = section;
    describe(node.at("free"), camera);
    node.at("capture").path(capture);
    node.at("dataset").text(datasetCamera);
    node.at("photograph").number(photograph, {0.0, 1e9});
}

template <typename Node>
void describe(Node&& node, Ref<Node, StudioParams> studio) {
    if (!node.object()) return;
    node.table(studioParameters(), studio);
    node.at("lamps").list(studio.lamps, kMaxLamps,
                          [](auto&& item, auto& lamp) { item.table(studioLampParameters(), lamp); });
}

template <typename Node>
void describe(Node&& node, Ref<Node, LightSection> light) {
    if (!node.object()) return;
    auto& [kind, file, sky, studio, uniformRadiance, rotationDeg, exposureEv, backdrop, backdropBlur] = light;
    describeWord(node.at("kind"), kind);
    node.at("file").path(file);
    node.at("sky").table(skyParameters(), sky);
    describe(node.at("studio"), studio);
    node.at("uniform").number(uniformRadiance, {0.0, 1e6});
    node.at("rotation").number(rotationDeg, {-360.0, 360.0});
    node.at("exposure").number(exposureEv, kStops);
    describeWord(node.at("backdrop"), backdrop);
    node.at("backdrop_blur").number(backdropBlur, kUnit);
}

template <typename Node>
void describe(Node&& node, Ref<Node, OcclusionSettings> settings) {
    if (!node.object()) return;
    auto& [method, screenSpace, meshRays, rasterised, baked] = settings;
    describeWord(node.at("method"), method);
    node.at("screen_space").table(occlusionParameters(), screenSpace);
    node.at("mesh_rays").table(meshOcclusionParameters(), meshRays);
    node.at("rasterised").table(rasterisedVisibilityParameters(), rasterised);
    node.at("baked").table(bakedVisibilityParameters(), baked);
    describeVector(node.at("baked_center"), baked.centerM);
}

template <typename Node>
void describe(Node&& node, Ref<Node, ShadingParams> shading) {
    if (!node.object()) return;
    auto& [occlude, occludeSpecular, f0] = shading;
    node.at("occlude").flag(occlude);
    node.at("occlude_specular").flag(occludeSpecular);
    node.at("f0").number(f0, kUnit);
}

template <typename Node>
void describe(Node&& node, Ref<Node, OcclusionSection> occlusion) {
    if (!node.object()) return;
    auto& [radii, initial, locked, settings, posing, splat, shading] = occlusion;
    const auto metres = [](auto&& item, auto& radius) { item.number(radius, kRadius); };
    describeParts(node.at("radii"), radii, metres);
    describeParts(node.at("initial"), initial, metres);
    describeParts(node.at("locked"), locked, [](auto&& item, auto& value) { item.flag(value); });
    describe(node.at("settings"), settings);
    node.at("posing").table(poseSurfelsParameters(), posing);
    node.at("splat").table(splatParameters(), splat);
    describe(node.at("shading"), shading);
}

void describe(JsonWriter&& node, const BufferDisplay& display) {
    const auto& [range, colorMap] = display;
    node.object();
    if (range) {
        const float bounds[]{range->first, range->second};
        node.at("range").numbers(std::span<const float>(bounds), {});
    }
    if (colorMap) node.at("color_map").word(*colorMap, kColorMapWords);
}

void describe(JsonReader&& node, BufferDisplay& display) {
    if (!node.object()) return;
    auto& [range, colorMap] = display;
    if (JsonReader member = node.at("range"); member.present() && !member.isNull()) {
        float bounds[]{0.0f, 1.0f};
        member.numbers(std::span<float>(bounds), {-1e9, 1e9});
        range = {bounds[0], bounds[1]};
    }
    if (JsonReader member = node.at("color_map"); member.present() && !member.isNull()) {
        member.word(colorMap.emplace(), kColorMapWords);
    }
}

/// Only buffers that are shown in another way than the catalogue's stand in the file.
template <typename Node, typename Displays>
void describeDisplays(Node&& node, Displays& displays) {
    if (!node.object()) return;
    for (const BufferInfo& info : bufferCatalogue()) {
        auto& display = displays[static_cast<std::size_t>(info.id)];
        if (Node::kReads || !(display == BufferDisplay{})) describe(node.at(info.name), display);
    }
}

template <typename Node>
void describe(Node&& node, Ref<Node, HeldLook> look) {
    if (!node.object()) return;
    auto& [avatar, pose, light, occlusion] = look;
    describe(node.at("avatar"), avatar);
    describe(node.at("pose"), pose);
    describe(node.at("light"), light);
    describe(node.at("occlusion"), occlusion);
}

void describeHeld(JsonWriter&& node, const std::shared_ptr<const HeldLook>& held) {
    if (held) describe(std::move(node), *held);
}

void describeHeld(JsonReader&& node, std::shared_ptr<const HeldLook>& held) {
    if (!node.present() || node.isNull()) return;
    auto look = std::make_shared<HeldLook>();
    describe(std::move(node), *look);
    held = std::move(look);
}

template <typename Node>
void describe(Node&& node, Ref<Node, CompareSection> compare) {
    if (!node.object()) return;
    auto& [kind, buffer, file, layer, measure, splitPosition, held] = compare;
    describeWord(node.at("kind"), kind);
    node.at("buffer").word(buffer, bufferWords());
    node.at("file").path(file);
    node.at("layer").text(layer);
    describeWord(node.at("measure"), measure);
    node.at("split").number(splitPosition, kUnit);
    describeHeld(node.at("held"), held);
}

template <typename Node>
void describe(Node&& node, Ref<Node, ViewSection> view) {
    if (!node.object()) return;
    auto& [buffer, layout, strip, buffers, tone, compare, grid, skeleton, parts, radiusSpheres, surfelDiscs, legend,
           selectedJoint, selectedPart] = view;
    node.at("buffer").word(buffer, bufferWords());
    describeWord(node.at("layout"), layout);
    node.at("strip").list(strip, kMaxStrip, [](auto&& item, auto& id) { item.word(id, bufferWords()); });
    describeDisplays(node.at("buffers"), buffers);
    node.at("tone").table(toneParameters(), tone);
    describe(node.at("compare"), compare);
    node.at("grid").flag(grid);
    node.at("skeleton").flag(skeleton);
    node.at("parts").flag(parts);
    node.at("radius_spheres").flag(radiusSpheres);
    node.at("surfel_discs").flag(surfelDiscs);
    node.at("legend").flag(legend);
    node.at("selected_joint").number(selectedJoint, {-1.0, static_cast<double>(kMaxJoints - 1)});
    node.at("selected_part").number(selectedPart, {-1.0, static_cast<double>(kBodyPartCount - 1)});
}

template <typename Node>
void describeSections(Node& node, Ref<Node, Document> document) {
    auto& [avatar, pose, timeline, camera, light, occlusion, view] = document;
    describe(node.at("avatar"), avatar);
    describe(node.at("pose"), pose);
    describe(node.at("timeline"), timeline);
    describe(node.at("camera"), camera);
    describe(node.at("light"), light);
    describe(node.at("occlusion"), occlusion);
    describe(node.at("view"), view);
}

Status checkFormat(const Json& json) {
    const auto format = json.find("format");
    if (format == json.end() || !format->is_number_integer() || format->get<double>() < 1.0) {
        return makeError(ErrorCode::BadFile, "format",
                         fmt::format("expected {} (a project of this program), found {}", kProjectFormat,
                                     format == json.end() ? "nothing" : foundText(*format)));
    }
    if (format->get<double>() > kProjectFormat) {
        return makeError(ErrorCode::Unsupported, "format",
                         fmt::format("the project was written by a newer version of the program: its format is {}, "
                                     "this version reads up to {}",
                                     foundText(*format), kProjectFormat));
    }
    return {};
}

} // namespace
} // namespace detail

nlohmann::ordered_json documentToJson(const Document& document, const std::filesystem::path& folder) {
    detail::Json json{{"program", "ars"}, {"format", kProjectFormat}};
    detail::JsonWriter writer(json, folder);
    detail::describeSections(writer, document);
    return json;
}

Result<Document> documentFromJson(const nlohmann::ordered_json& json, const std::filesystem::path& folder,
                                  std::vector<std::string>* notes) {
    if (!json.is_object()) {
        return makeError(ErrorCode::BadFile, "",
                         fmt::format("expected a project (a JSON object), found {}", detail::foundText(json)));
    }
    ARS_TRY_STATUS(detail::checkFormat(json));
    Document document;
    detail::JsonReader::Report report{folder, {}, {}};
    {
        detail::JsonReader reader(json, report);
        reader.object();
        // Who wrote the file, and what belongs to autosaved files and to pictures.
        for (const char* key : {"program", "format", "recovery", "picture"}) reader.passOver(key);
        detail::describeSections(reader, document);
    }
    if (report.error) return std::move(*report.error);
    if (notes) notes->insert(notes->end(), report.notes.begin(), report.notes.end());
    return document;
}

} // namespace ars
