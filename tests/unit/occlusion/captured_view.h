#pragma once

#include "engine/io/exr.h"
#include "tests/support/test_data.h"
#include "tests/unit/occlusion/ambient_occlusion_scenes.h"

#include <nlohmann/json.hpp>

#include <fstream>
#include <string>
#include <vector>

namespace ars::test {

/// One path-traced picture of capture/casual_val with its true depth, normals and 0.25 m ambient occlusion.
struct CapturedView {
    OcclusionScene scene;         ///< Q is the world's up in camera space
    std::vector<float> occlusion; ///< of the path tracer
};

inline std::vector<float> exrChannels(const std::filesystem::path& path, const std::vector<std::string>& names) {
    const auto exr = readExr(path);
    if (!exr) {
        ADD_FAILURE() << exr.error().describe();
        return {};
    }
    std::vector<float> values;
    for (std::size_t k = 0; k < names.size(); ++k) {
        const ExrChannel* channel = exr->find(names[k]);
        if (!channel) {
            ADD_FAILURE() << path << " has no channel " << names[k];
            return {};
        }
        values.resize(channel->pixels.size() * names.size());
        for (std::size_t i = 0; i < channel->pixels.size(); ++i) values[i * names.size() + k] = channel->pixels[i];
    }
    return values;
}

/// @param set  the folder capture/casual_val/heldout_views or novel_poses
inline CapturedView readCapturedView(const std::filesystem::path& set, const std::string& name, int frame,
                                     float radiusM) {
    std::ifstream file(set / "calibration_full.json");
    const auto entry = nlohmann::json::parse(file).at(name);
    CapturedView view;
    Camera& camera = view.scene.camera;
    camera.width = entry.at("imgSize").at(0);
    camera.height = entry.at("imgSize").at(1);
    camera.fx = entry.at("K").at(0), camera.cx = entry.at("K").at(2);
    camera.fy = entry.at("K").at(4), camera.cy = entry.at("K").at(5);
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) camera.rotation[c][r] = entry.at("R").at(static_cast<std::size_t>(3 * r + c));
        camera.translation[r] = entry.at("T").at(static_cast<std::size_t>(r));
    }
    const auto buffer = [&](const char* kind) { return set / name / "gt" / kind / fmt::format("{:08}.exr", frame); };
    view.scene.depth = exrChannels(buffer("depth"), {"Y"});
    view.occlusion = exrChannels(buffer("ao"), {"Y"});
    const std::vector<float> world = exrChannels(buffer("normal"), {"R", "G", "B"});
    const std::size_t pixels = view.scene.pixels();
    if (world.size() != 3 * pixels || view.scene.depth.size() != pixels) return view;
    const glm::dvec3 up = camera.rotation * glm::dvec3(0.0, 1.0, 0.0);
    for (std::size_t p = 0; p < pixels; ++p) {
        const glm::dvec3 n = camera.rotation * glm::dvec3(world[3 * p], world[3 * p + 1], world[3 * p + 2]);
        for (int k = 0; k < 3; ++k) {
            view.scene.normal.push_back(static_cast<float>(n[k]));
            view.scene.bone.push_back(static_cast<float>(up[k]));
        }
    }
    view.scene.radius.assign(pixels, radiusM);
    return view;
}

/// Two cameras in each of the two sets, every `step`-th of four frames.
inline std::vector<CapturedView> readCapturedViews(const std::filesystem::path& casualVal, float radiusM,
                                                   int step = 1) {
    std::vector<CapturedView> views;
    for (const auto& [set, names] : {std::pair{"heldout_views", std::vector<std::string>{"24110013", "24110014"}},
                                     std::pair{"novel_poses", std::vector<std::string>{"24110001", "24110006"}}}) {
        for (const std::string& name : names) {
            for (int frame = 0; frame < 4; frame += step)
                views.push_back(readCapturedView(casualVal / set, name, frame, radiusM));
        }
    }
    return views;
}

/// How one occlusion agrees with another over the foreground of many pictures.
class OcclusionAgreement {
public:
    void add(double ours, double truth) {
        n_ += 1.0, x_ += ours, y_ += truth, xx_ += ours * ours, yy_ += truth * truth, xy_ += ours * truth;
        error_ += std::fabs(ours - truth), none_ += std::fabs(1.0 - truth);
    }
    void add(const std::vector<float>& ours, const CapturedView& view) {
        for (std::size_t p = 0; p < ours.size(); ++p) {
            if (view.scene.depth[p] > 0.0f) add(ours[p], view.occlusion[p]);
        }
    }
    double meanError() const { return error_ / n_; }
    double errorOfOne() const { return none_ / n_; } ///< what O = 1 gives
    double bias() const { return (x_ - y_) / n_; }
    double correlation() const { return (n_ * xy_ - x_ * y_) / std::sqrt((n_ * xx_ - x_ * x_) * (n_ * yy_ - y_ * y_)); }
    double pixels() const { return n_; }

private:
    double n_ = 0, x_ = 0, y_ = 0, xx_ = 0, yy_ = 0, xy_ = 0, error_ = 0, none_ = 0;
};

} // namespace ars::test
