#include "model/evaluation/evaluation.h"

#include "engine/core/file.h"
#include "engine/io/png.h"
#include "engine/metrics/image_metrics.h"
#include "model/evaluation/evaluated_view.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <map>

namespace ars {
namespace fs = std::filesystem;
namespace {

using detail::AlbedoScale;
using detail::EvaluatedCapture;
using detail::Figures;
using Json = nlohmann::ordered_json;

constexpr std::array<float, 3> kWhite{1.0f, 1.0f, 1.0f};

std::string_view protocolName(EvaluationProtocol protocol) {
    switch (protocol) {
    case EvaluationProtocol::Ag:
        return "ag";
    case EvaluationProtocol::HeldOut:
        return "heldout";
    case EvaluationProtocol::Masked:
        break;
    }
    return "masked";
}

std::string_view protocolText(EvaluationProtocol protocol) {
    if (protocol == EvaluationProtocol::Masked) {
        return "pixels whose mask exceeds 128/255, the picture over the photograph's own background; full: both over "
               "white, SSIM with Gaussian windows of 11x11";
    }
    return "full: over white and through JPEG, the photograph white outside the mask, SSIM with windows of 7x7; in the "
           "mask as in the protocol masked";
}

/// Everything that the views share.
struct Evaluation {
    const EvaluatedAvatar& avatar;
    const EvaluationOptions& options;
    std::vector<EvaluatedCapture> sets;
    detail::ViewRenderer renderer;
    std::unique_ptr<PerceptualLoss> lpips; ///< none without weight files
    std::unique_ptr<PrefilteredLight> ownLight;
    std::map<fs::path, std::unique_ptr<PrefilteredLight>> trueLights;
    std::map<fs::path, CubeMap> trueCubes;
    AlbedoScale ours, photographs;

    std::size_t viewCount() const {
        std::size_t count = 0;
        for (const EvaluatedCapture& set : sets) count += set.views.size();
        return count;
    }
    const PrefilteredLight* trueLight(const EvaluatedCapture& set) const {
        const auto found = trueLights.find(set.light);
        return found == trueLights.end() ? nullptr : found->second.get();
    }
};

/// Nothing without files; what is wrong with them is said before anything is rendered.
Result<std::unique_ptr<PerceptualLoss>> openLpips(const EvaluationOptions& options) {
    if (options.lpipsBackbone.empty() && options.lpipsHeads.empty()) return std::unique_ptr<PerceptualLoss>();
    if (options.lpipsBackbone.empty() || options.lpipsHeads.empty()) {
        return makeError(ErrorCode::InvalidArgument,
                         options.lpipsBackbone.empty() ? "--lpips-backbone" : "--lpips-heads",
                         "is missing: LPIPS needs the backbone's weights and the heads'");
    }
    return readLpips(options.lpipsBackbone, options.lpipsHeads);
}

/// What LPIPS figures were computed with: names tell nothing of the weights, so the files are named too.
Json lpipsJson(const Evaluation& evaluation) {
    // Never a number that was not computed with weights.
    if (!evaluation.lpips) return nullptr;
    const std::string name = evaluation.lpips->name();
    return {{"network", name.substr(name.find('_') + 1)},
            {"backbone", evaluation.options.lpipsBackbone.string()},
            {"heads", evaluation.options.lpipsHeads.string()}};
}

Status openLights(Evaluation& evaluation) {
    if (evaluation.avatar.light) {
        auto own = detail::filteredCube(*evaluation.avatar.light);
        if (!own) return atPlace(std::move(own).error(), "the avatar's light");
        evaluation.ownLight = std::move(*own);
    }
    for (const EvaluatedCapture& set : evaluation.sets) {
        if (set.light.empty() || evaluation.trueLights.contains(set.light)) continue;
        ARS_TRY(const Environment environment, readEnvironment(set.light));
        ARS_TRY(CubeMap cube, cubeFromLatLong(environment.picture, kDefaultLightBase));
        ARS_TRY(evaluation.trueLights[set.light], detail::filteredCube(cube));
        evaluation.trueCubes[set.light] = std::move(cube);
    }
    return {};
}

Image decoded(const Image& photograph) {
    Image linear = photograph;
    linear.space = ColorSpace::Linear;
    for (float& value : linear.pixels) value = srgbToLinear(value);
    return linear;
}

/// First pass: one albedo scale per channel over all pictures, of the avatar and of the photographs themselves.
Status fitAlbedo(Evaluation& evaluation, const ProgressFunction& progress) {
    std::size_t done = 0;
    const std::size_t count = evaluation.viewCount();
    for (const EvaluatedCapture& set : evaluation.sets) {
        for (const ViewId view : set.views) {
            ARS_TRY_STATUS(reportProgress(progress, 0.3 * static_cast<double>(done++) / static_cast<double>(count),
                                          "fitting the albedo"));
            std::error_code ignored;
            if (!fs::exists(set.truthPath(view, "albedo"), ignored)) continue;
            ARS_TRY(const std::optional<detail::Photograph> photograph, readPhotograph(set, view));
            if (!photograph) continue;
            ARS_TRY(const detail::TrueBuffers truth, readTrueBuffers(set, view, photograph->view.camera));
            ARS_TRY(const Image albedo,
                    evaluation.renderer.renderAlbedo(set.capture.pose(view.frame), photograph->view.camera));
            evaluation.ours.add(albedo, *truth.albedo, photograph->mask);
            evaluation.photographs.add(decoded(photograph->view.color), *truth.albedo, photograph->mask);
        }
    }
    return {};
}

/// Pictures under the avatar's own light, and under the true one with and without the albedo's scale.
Status judgeShading(const Evaluation& evaluation, const EvaluatedCapture& set, const detail::RenderedView& ours,
                    const detail::Photograph& photograph, const detail::PictureJudge& judge, Figures& figures,
                    std::vector<Image>& pictures) {
    const Camera& camera = photograph.view.camera;
    const auto shadeAndJudge = [&](const std::string& name, const PrefilteredLight& light, float scale,
                                   const glm::vec3& albedoScale) -> Status {
        ARS_TRY(const Image shaded, evaluation.renderer.shade(ours, camera, light, scale, albedoScale));
        Image masked = detail::composedShading(shaded, photograph.background);
        ARS_TRY_STATUS(judge.judge(name, masked, detail::composedShading(shaded, kWhite), figures));
        pictures.push_back(std::move(masked));
        return {};
    };
    if (evaluation.ownLight) ARS_TRY_STATUS(shadeAndJudge("pbr", *evaluation.ownLight, 1.0f, glm::vec3(1.0f)));
    const PrefilteredLight* light = evaluation.trueLight(set);
    if (!light) return {};
    const auto exposure = static_cast<float>(set.exposure);
    if (evaluation.ours.pixels > 0)
        ARS_TRY_STATUS(shadeAndJudge("relit", *light, exposure, glm::vec3(evaluation.ours.value())));
    return shadeAndJudge("relit_unscaled", *light, exposure, glm::vec3(1.0f));
}

/// What lies where the photograph says nothing is neither right nor wrong.
void hideUnknown(const Image& unknown, Image& opacity) {
    for (std::size_t p = 0; p < unknown.pixels.size(); ++p) {
        if (unknown.pixels[p] > 0.0f) opacity.pixels[p] = 0.0f;
    }
}

struct ViewReport {
    Figures figures;
    std::optional<Image> page;
};

/// Nothing where the photograph shows nobody.
Result<std::optional<ViewReport>> evaluateView(Evaluation& evaluation, const EvaluatedCapture& set, ViewId view,
                                               bool wantPage) {
    ARS_TRY(const std::optional<detail::Photograph> read, readPhotograph(set, view));
    if (!read) return std::optional<ViewReport>();
    const detail::Photograph& photograph = *read;
    const Camera& camera = photograph.view.camera;
    ARS_TRY(const detail::TrueBuffers truth, readTrueBuffers(set, view, camera));
    ARS_TRY(detail::RenderedView ours, evaluation.renderer.render(set.capture.pose(view.frame), camera));
    hideUnknown(photograph.view.unknown, ours.opacity);
    const detail::PictureJudge judge{evaluation.options.protocol, photograph, evaluation.lpips.get()};
    ViewReport report;
    Figures& figures = report.figures;
    std::vector<Image> pictures{detail::composedRadiance(ours, photograph.background)};
    ARS_TRY_STATUS(judge.judge("radiance", pictures[0], detail::composedRadiance(ours, kWhite), figures));
    ARS_TRY_STATUS(judgeShading(evaluation, set, ours, photograph, judge, figures, pictures));
    const auto viewOfImage = [](const Image& image) {
        return ImageView<const float>{image.pixels.data(), image.width, image.height, image.channels};
    };
    ARS_TRY(const double iou, maskIntersectionOverUnion(viewOfImage(ours.opacity), viewOfImage(photograph.mask)));
    figures.emplace_back("mask_iou", iou);
    ARS_TRY_STATUS(judgeGeometry(ours, truth, photograph, figures));
    if (truth.albedo) {
        ARS_TRY_STATUS(detail::judgeAlbedo("albedo", ours.albedo, evaluation.ours.value(), *truth.albedo,
                                           photograph.mask, figures));
        ARS_TRY_STATUS(detail::judgeAlbedo("albedo_unscaled", ours.albedo, glm::dvec3(1.0), *truth.albedo,
                                           photograph.mask, figures));
        ARS_TRY_STATUS(detail::judgeAlbedo("photograph_as_albedo", decoded(photograph.view.color),
                                           evaluation.photographs.value(), *truth.albedo, photograph.mask, figures));
    }
    if (wantPage) report.page = detail::comparisonPage(photograph, ours, truth, pictures, evaluation.ours.value());
    return std::optional<ViewReport>(std::move(report));
}

/// Means over the views that have a figure, in the figures' order.
class Means {
public:
    void add(const Figures& figures) {
        for (const auto& [name, value] : figures) {
            auto found = std::find_if(rows_.begin(), rows_.end(), [&](const Row& row) { return row.name == name; });
            if (found == rows_.end()) found = rows_.insert(rows_.end(), Row{name, 0, 0});
            found->sum += value;
            ++found->count;
        }
    }
    Json json() const {
        Json result = Json::object();
        for (const Row& row : rows_) result[row.name] = row.sum / static_cast<double>(row.count);
        return result;
    }

private:
    struct Row {
        std::string name;
        double sum;
        std::size_t count;
    };
    std::vector<Row> rows_;
};

/// Which of `count` views are shown, evenly spread.
bool isShown(std::size_t index, std::size_t count, int pictures) {
    const auto wanted = std::min(static_cast<std::size_t>(std::max(pictures, 0)), count);
    if (wanted == 0) return false;
    return index * wanted / count != (index + 1) * wanted / count;
}

Json setHeader(const EvaluatedCapture& set) {
    Json json{{"name", set.name}, {"capture", set.capture.folder.string()}, {"split", set.split.name}};
    json["cameras"] = Json::array();
    for (const int camera : set.split.cameras)
        json["cameras"].push_back(set.capture.cameras[static_cast<std::size_t>(camera)].name);
    json["frames"] = Json::array();
    for (const int frame : set.split.frames)
        json["frames"].push_back(set.capture.frames[static_cast<std::size_t>(frame)]);
    if (!set.light.empty()) {
        json["true_light"] = set.light.string();
        json["exposure"] = set.exposure;
    }
    return json;
}

/// Second pass over one capture.
Result<Json> evaluateSet(Evaluation& evaluation, const EvaluatedCapture& set, std::size_t before, Means& all,
                         const ProgressFunction& progress) {
    const std::size_t count = evaluation.viewCount();
    Json json = setHeader(set);
    Means means;
    Json views = Json::array(), leftOut = Json::array();
    for (std::size_t i = 0; i < set.views.size(); ++i) {
        const std::size_t index = before + i;
        ARS_TRY_STATUS(reportProgress(progress, 0.3 + 0.7 * static_cast<double>(index) / static_cast<double>(count),
                                      fmt::format("view {} of {}", index + 1, count)));
        const bool page = !evaluation.options.outFolder.empty() && isShown(index, count, evaluation.options.pictures);
        const ViewId view = set.views[i];
        ARS_TRY(const std::optional<ViewReport> report, evaluateView(evaluation, set, view, page));
        const std::string& camera = set.capture.cameras[static_cast<std::size_t>(view.camera)].name;
        const int frame = set.capture.frames[static_cast<std::size_t>(view.frame)];
        Json row{{"camera", camera}, {"frame", frame}};
        if (!report) {
            row["reason"] = "nobody in the mask";
            leftOut.push_back(std::move(row));
            continue;
        }
        for (const auto& [name, value] : report->figures) row[name] = value;
        if (report->page) {
            const std::string name = fmt::format("pictures/{}_{}_{:08}.png", set.name, camera, frame);
            ARS_TRY_STATUS(writePng(evaluation.options.outFolder / name, *report->page));
            row["picture"] = name;
        }
        views.push_back(std::move(row));
        means.add(report->figures);
        all.add(report->figures);
    }
    json["mean"] = means.json();
    json["views"] = std::move(views);
    json["left_out"] = std::move(leftOut);
    return json;
}

Json vectorJson(const glm::dvec3& v) { return Json::array({v.x, v.y, v.z}); }

/// Of each set under its own light; of all together where they were under one, else null.
void addLightFigures(const Evaluation& evaluation, Json& report, Json& sets) {
    if (!evaluation.avatar.light || evaluation.trueCubes.empty()) return;
    std::map<fs::path, Json> correlations;
    for (const auto& [path, cube] : evaluation.trueCubes) {
        const double correlation = irradianceCorrelation(*evaluation.avatar.light, cube);
        correlations[path] = std::isfinite(correlation) ? Json(correlation) : Json(nullptr);
    }
    for (std::size_t i = 0; i < evaluation.sets.size(); ++i) {
        const auto found = correlations.find(evaluation.sets[i].light);
        if (found != correlations.end()) sets[i]["light_irradiance_correlation"] = found->second;
    }
    report["light_irradiance_correlation"] = correlations.size() == 1 ? correlations.begin()->second : Json(nullptr);
}

} // namespace

Result<Json> evaluateAvatar(const EvaluatedAvatar& avatar, const fs::path& capture, const EvaluationOptions& options,
                            const ProgressFunction& progress) {
    ARS_TRY_STATUS(reportProgress(progress, 0.0, "opening the capture"));
    ARS_TRY(auto lpips, openLpips(options));
    ARS_TRY(auto sets, detail::openEvaluatedCaptures(capture, options));
    ARS_TRY(auto renderer, detail::ViewRenderer::create(avatar));
    Evaluation evaluation{avatar, options, std::move(sets), std::move(renderer), std::move(lpips), nullptr, {}, {},
                          {},     {}};
    ARS_TRY_STATUS(openLights(evaluation));
    ARS_TRY_STATUS(fitAlbedo(evaluation, progress));

    Json report{{"avatar", avatar.name},
                {"description", avatar.evaluator->description()},
                {"capture", capture.string()},
                {"protocol", protocolName(options.protocol)},
                {"protocol_text", protocolText(options.protocol)},
                {"views", 0}};
    report["occluded"] = avatar.occlude;
    report["lpips"] = lpipsJson(evaluation);
    report["fid"] = nullptr;
    if (evaluation.ours.pixels > 0) {
        report["albedo_scale"] = vectorJson(evaluation.ours.value());
        report["photograph_scale"] = vectorJson(evaluation.photographs.value());
    }
    Means all;
    std::size_t views = 0;
    Json reports = Json::array();
    std::size_t before = 0;
    for (const EvaluatedCapture& set : evaluation.sets) {
        ARS_TRY(Json json, evaluateSet(evaluation, set, before, all, progress));
        views += json.at("views").size();
        reports.push_back(std::move(json));
        before += set.views.size();
    }
    if (views == 0) {
        return makeError(ErrorCode::BadFile, capture.string(),
                         fmt::format("expected pictures with a person in their masks, found none among {}", before));
    }
    report["views"] = views;
    report["mean"] = all.json();
    addLightFigures(evaluation, report, reports);
    report["sets"] = std::move(reports);
    if (!options.outFolder.empty()) {
        ARS_TRY_STATUS(writeFileAtomic(options.outFolder / "report.json",
                                       report.dump(2, ' ', false, Json::error_handler_t::replace) + "\n"));
        ARS_TRY_STATUS(writeFileAtomic(options.outFolder / "report.txt", evaluationTable(report)));
    }
    ARS_TRY_STATUS(reportProgress(progress, 1.0, "evaluated"));
    return report;
}

} // namespace ars
