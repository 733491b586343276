#include "tests/parity/path_tracing.h"

#include "engine/capture/calibration.h"
#include "engine/frame/display.h"
#include "engine/frame/light_source.h"
#include "engine/frame/rest_avatar.h"
#include "engine/io/exr.h"
#include "engine/io/image_file.h"
#include "engine/io/png.h"
#include "engine/metrics/image_metrics.h"
#include "engine/rig/motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ars::test {
namespace fs = std::filesystem;
namespace {

constexpr float kExposure = 0.7f;            // capture/casual/metadata.json
constexpr float kBackground = 0.2140411405f; // linear, the capture's grey

struct Material {
    const char* name;
    float roughness; ///< constant over the material, so it tells them apart
};
constexpr Material kMaterials[] = {{"skin", 0.45f}, {"shirt", 0.8f}, {"trousers", 0.7f},
                                   {"shoes", 0.3f}, {"hair", 0.5f},  {"eyes", 0.25f}};

Result<Image> readTruth(const fs::path& camera, const char* buffer, int index) {
    const fs::path path = camera / "gt" / buffer / fmt::format("{:08}.exr", index);
    auto image = readImageFile(path);
    if (!image) return atPlace(image.error(), path.string());
    return image;
}

Result<TruePicture> readTruePicture(const fs::path& folder, const CalibratedCamera& camera, const Motion& motion,
                                    int index) {
    TruePicture truth;
    truth.name = fmt::format("{} {} {}", folder.filename().string(), camera.name, index);
    truth.camera = camera.camera;
    truth.pose = motion.frames[static_cast<std::size_t>(index)];
    const fs::path pictures = folder / camera.name;
    ARS_TRY(truth.color, readTruth(pictures, "color", index));
    ARS_TRY(truth.albedo, readTruth(pictures, "albedo", index));
    ARS_TRY(truth.roughness, readTruth(pictures, "roughness", index));
    ARS_TRY(truth.occlusion, readTruth(pictures, "ao", index));
    ARS_TRY(truth.normal, readTruth(pictures, "normal", index));
    ARS_TRY(truth.depth, readTruth(pictures, "depth", index));
    const glm::mat3 toCamera(truth.camera.rotation);
    for (std::size_t p = 0; p < truth.normal.pixels.size(); p += 3) {
        float* n = &truth.normal.pixels[p];
        const glm::vec3 turned = toCamera * glm::vec3(n[0], n[1], n[2]);
        for (int c = 0; c < 3; ++c) n[c] = turned[c];
    }
    return truth;
}

/// Numbers of many pictures, one after the other, seen as one picture of one row.
struct Pool {
    std::vector<float> a, b;
    Picture first(int channels) const { return {a.data(), static_cast<int>(a.size()) / channels, 1, channels}; }
    Picture second(int channels) const { return {b.data(), static_cast<int>(b.size()) / channels, 1, channels}; }
    void add(float x, float y) {
        a.push_back(x);
        b.push_back(y);
    }
};

/// The picture as the capture's cameras would store it, before rounding.
glm::vec3 developed(const float* rgba) {
    glm::vec3 color;
    for (int c = 0; c < 3; ++c) {
        const float linear = rgba[c] + (1.0f - rgba[3]) * kBackground;
        color[c] = linearToSrgb(std::clamp(linear, 0.0f, 1.0f));
    }
    return color;
}

const char* materialOf(float roughness) {
    for (const Material& material : kMaterials) {
        if (std::abs(roughness - material.roughness) < 0.004f) return material.name;
    }
    return nullptr; // a pixel on the border of two
}

void writeSheet(const fs::path& path, const std::vector<Image>& pictures);

/// One picture's row for the page: truth above, ours below.
void writePage(const fs::path& folder, const TruePicture& truth, const FramePipeline& pipeline) {
    DisplaySettings display;
    display.tone.backgroundRed = display.tone.backgroundGreen = display.tone.backgroundBlue = kBackground;
    Image opacity = truth.depth;
    for (std::size_t p = 0; p < opacity.pixels.size(); ++p) opacity.pixels[p] = truth.color.pixels[4 * p + 3];
    Image beauty = truth.color;
    for (std::size_t i = 0; i < beauty.pixels.size(); ++i) {
        if (i % 4 != 3) beauty.pixels[i] *= kExposure;
    }
    std::vector<Image> rows;
    const BufferId ids[] = {BufferId::Beauty, BufferId::Albedo, BufferId::Normal, BufferId::AmbientOcclusion,
                            BufferId::Depth};
    const Image* truths[] = {&beauty, &truth.albedo, &truth.normal, &truth.occlusion, &truth.depth};
    display.range = std::pair{2.0f, 3.4f};
    const auto ours = pipeline.picture(BufferId::Opacity);
    for (int side = 0; side < 2; ++side) {
        for (int i = 0; i < 5; ++i) {
            DisplaySettings one = display;
            if (ids[i] != BufferId::Depth) one.range.reset();
            const auto picture = side == 0 ? Result<Image>(*truths[i]) : pipeline.picture(ids[i]);
            const auto shown = picture ? displayPicture(ids[i], *picture, side == 0 ? opacity : *ours, one) : picture;
            if (shown) rows.push_back(*shown);
        }
    }
    std::string file = truth.name;
    std::replace(file.begin(), file.end(), ' ', '_');
    writeSheet(folder / (file + ".png"), rows);
}

/// Five columns, two rows.
void writeSheet(const fs::path& path, const std::vector<Image>& pictures) {
    if (pictures.size() != 10) return;
    const int width = pictures[0].width, height = pictures[0].height;
    Image sheet;
    sheet.width = 5 * width;
    sheet.height = 2 * height;
    sheet.channels = 3;
    sheet.space = ColorSpace::Srgb;
    sheet.pixels.resize(static_cast<std::size_t>(sheet.width) * static_cast<std::size_t>(sheet.height) * 3);
    for (std::size_t i = 0; i < pictures.size(); ++i) {
        const int x0 = static_cast<int>(i % 5) * width, y0 = static_cast<int>(i / 5) * height;
        for (int y = 0; y < height; ++y) {
            for (int x = 0; x < width; ++x) {
                for (int c = 0; c < 3; ++c) sheet.at(y0 + y, x0 + x, c) = pictures[i].at(y, x, c);
            }
        }
    }
    const Status written = writePng(path, sheet);
    if (!written) fmt::print(stderr, "{}\n", written.error().describe());
}

/// Everything that is measured, over all pictures.
struct Pools {
    Pool mask, depth, normal, albedo, roughness;
    double worstIou = 1.0;
    std::map<std::string, Pool> normalByMaterial, occlusionByMaterial;
    std::map<std::string, Pool> occlusion, shaded;
    Pool unoccluded, unoccludedShaded, ceiling, ceilingUnoccluded, trueOcclusion;
};

bool inTrueMask(const TruePicture& truth, std::size_t p) { return truth.color.pixels[4 * p + 3] > 0.5f; }

void addShaded(Pool& pool, const TruePicture& truth, const Image& beauty) {
    for (std::size_t p = 0; p < truth.depth.pixels.size(); ++p) {
        if (!inTrueMask(truth, p)) continue;
        float expected[4];
        for (std::size_t c = 0; c < 4; ++c) expected[c] = truth.color.pixels[4 * p + c] * (c < 3 ? kExposure : 1.0f);
        const glm::vec3 x = developed(expected), y = developed(&beauty.pixels[4 * p]);
        for (int c = 0; c < 3; ++c) pool.add(x[c], y[c]);
    }
}

Status addGeometry(Pools& pools, const TruePicture& truth, const FramePipeline& pipeline) {
    ARS_TRY(const Image opacity, pipeline.picture(BufferId::Opacity));
    ARS_TRY(const Image depth, pipeline.picture(BufferId::Depth));
    ARS_TRY(const Image normal, pipeline.picture(BufferId::Normal));
    ARS_TRY(const Image albedo, pipeline.picture(BufferId::Albedo));
    ARS_TRY(const Image roughness, pipeline.picture(BufferId::Roughness));
    Pool mask;
    for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
        mask.add(inTrueMask(truth, p) ? 1.0f : 0.0f, opacity.pixels[p] > 0.5f ? 1.0f : 0.0f);
        if (!inTrueMask(truth, p) || !(opacity.pixels[p] > 0.5f) || !(truth.depth.pixels[p] > 0.0f)) continue;
        pools.depth.add(truth.depth.pixels[p], depth.pixels[p]);
        pools.roughness.add(truth.roughness.pixels[p], roughness.pixels[p]);
        const char* material = materialOf(truth.roughness.pixels[p]);
        for (std::size_t c = 0; c < 3; ++c) {
            pools.normal.add(truth.normal.pixels[3 * p + c], normal.pixels[3 * p + c]);
            pools.albedo.add(truth.albedo.pixels[3 * p + c], albedo.pixels[3 * p + c]);
            if (material)
                pools.normalByMaterial[material].add(truth.normal.pixels[3 * p + c], normal.pixels[3 * p + c]);
        }
    }
    ARS_TRY(const double iou, maskIntersectionOverUnion(mask.first(1), mask.second(1)));
    pools.worstIou = std::min(pools.worstIou, iou);
    pools.mask.a.insert(pools.mask.a.end(), mask.a.begin(), mask.a.end());
    pools.mask.b.insert(pools.mask.b.end(), mask.b.begin(), mask.b.end());
    return {};
}

void addOcclusion(Pool& pool, const TruePicture& truth, const Image& opacity, const Image& occlusion,
                  std::map<std::string, Pool>* byMaterial) {
    for (std::size_t p = 0; p < opacity.pixels.size(); ++p) {
        if (!inTrueMask(truth, p) || !(opacity.pixels[p] > 0.5f)) continue;
        pool.add(truth.occlusion.pixels[p], occlusion.pixels[p]);
        const char* material = materialOf(truth.roughness.pixels[p]);
        if (byMaterial && material) (*byMaterial)[material].add(truth.occlusion.pixels[p], occlusion.pixels[p]);
    }
}

/// What this shading and this occlusion make of the true buffers: the ceiling of everything else.
Status addCeiling(Pools& pools, const TruePicture& truth, const PrefilteredLight& light, float radiusM) {
    const int width = truth.camera.width, height = truth.camera.height;
    const auto view = [&](const Image& image) {
        return ImageView<const float>{image.pixels.data(), image.width, image.height, image.channels};
    };
    Image opacity = truth.depth;
    for (std::size_t p = 0; p < opacity.pixels.size(); ++p) opacity.pixels[p] = truth.color.pixels[4 * p + 3];
    ShadingInputs inputs;
    inputs.albedo = view(truth.albedo);
    inputs.roughness = view(truth.roughness);
    inputs.normal = view(truth.normal);
    inputs.opacity = view(opacity);
    inputs.occlusion = view(truth.occlusion);
    inputs.camera = truth.camera;
    inputs.light = light.view({0.0f, kExposure});
    Image beauty;
    beauty.width = width;
    beauty.height = height;
    beauty.channels = 4;
    beauty.pixels.resize(opacity.pixels.size() * 4);
    ShadingOutputs outputs;
    outputs.beauty = {beauty.pixels.data(), width, height, 4};
    ARS_TRY_STATUS(shade({}, {}, inputs, outputs));
    addShaded(pools.ceiling, truth, beauty);
    inputs.occlusion = {};
    ARS_TRY_STATUS(shade({}, {}, inputs, outputs));
    addShaded(pools.ceilingUnoccluded, truth, beauty);

    OcclusionInputs pictures;
    pictures.camera = truth.camera;
    pictures.depth = view(truth.depth);
    pictures.normal = view(truth.normal);
    const Image radius{
        width, height, 1, ColorSpace::Data, false, 32, std::vector<float>(truth.depth.pixels.size(), radiusM)};
    pictures.radius = view(radius);
    pictures.opacity = view(opacity);
    Image occlusion = truth.depth;
    OcclusionWorkspace workspace;
    ARS_TRY_STATUS(ambientOcclusion(bodyOcclusion(), pictures, workspace,
                                    ImageView<float>{occlusion.pixels.data(), width, height, 1}));
    addOcclusion(pools.trueOcclusion, truth, opacity, occlusion, nullptr);
    return {};
}

Result<OcclusionSettings> settingsOf(const std::string& method) {
    OcclusionSettings settings;
    if (method == "body") return settings;
    if (method == "reference") {
        settings.screenSpace = referenceOcclusion();
        return settings;
    }
    const auto& words = EnumWords<OcclusionMethod>::words;
    for (std::size_t i = 0; i < words.size(); ++i) {
        if (method != words[i]) continue;
        settings.method = static_cast<OcclusionMethod>(i);
        return settings;
    }
    return makeError(ErrorCode::InvalidArgument, "method", method);
}

Result<Comparison> summarise(const Pools& pools, Comparison result) {
    result.pixels = pools.depth.a.size();
    result.worstMaskIou = pools.worstIou;
    ARS_TRY(result.maskIou, maskIntersectionOverUnion(pools.mask.first(1), pools.mask.second(1)));
    ARS_TRY(result.depthMedianM, medianAbsoluteError(pools.depth.first(1), pools.depth.second(1)));
    ARS_TRY(const AngularError normals, angularError(pools.normal.first(3), pools.normal.second(3)));
    result.normalMeanDeg = normals.meanDeg;
    result.normalMedianDeg = normals.medianDeg;
    ARS_TRY(result.albedoMae, meanAbsoluteError(pools.albedo.first(3), pools.albedo.second(3)));
    ARS_TRY(result.roughnessMae, meanAbsoluteError(pools.roughness.first(1), pools.roughness.second(1)));
    double missing = 0, extra = 0, inside = 0;
    for (std::size_t p = 0; p < pools.mask.a.size(); ++p) {
        missing += pools.mask.a[p] > pools.mask.b[p];
        extra += pools.mask.a[p] < pools.mask.b[p];
        inside += pools.mask.a[p];
    }
    result.maskMissing = missing / inside;
    result.maskExtra = extra / inside;
    for (const auto& [material, pool] : pools.normalByMaterial) {
        ARS_TRY(const AngularError error, angularError(pool.first(3), pool.second(3)));
        result.normalMeanDegByMaterial[material] = error.meanDeg;
    }
    for (const auto& [material, pool] : pools.occlusionByMaterial) {
        ARS_TRY(result.occlusionMaeByMaterial[material], meanAbsoluteError(pool.first(1), pool.second(1)));
    }
    for (const auto& [method, pool] : pools.occlusion) {
        OcclusionScore& score = result.methods[method];
        ARS_TRY(score.meanAbsoluteError, meanAbsoluteError(pool.first(1), pool.second(1)));
        // O = 1 everywhere has none.
        const auto correlation = pearsonCorrelation(pool.first(1), pool.second(1));
        score.correlation = correlation ? *correlation : 0.0;
        const Pool& shaded = pools.shaded.at(method);
        ARS_TRY(score.psnr, peakSignalToNoise(shaded.first(3), shaded.second(3)));
    }
    const auto psnr = [](const Pool& pool) { return peakSignalToNoise(pool.first(3), pool.second(3)); };
    ARS_TRY(result.unoccludedMae, meanAbsoluteError(pools.unoccluded.first(1), pools.unoccluded.second(1)));
    ARS_TRY(result.unoccludedPsnr, psnr(pools.unoccludedShaded));
    ARS_TRY(result.ceilingPsnr, psnr(pools.ceiling));
    ARS_TRY(result.ceilingUnoccludedPsnr, psnr(pools.ceilingUnoccluded));
    ARS_TRY(result.trueBuffersMae, meanAbsoluteError(pools.trueOcclusion.first(1), pools.trueOcclusion.second(1)));
    ARS_TRY(result.trueBuffersCorrelation,
            pearsonCorrelation(pools.trueOcclusion.first(1), pools.trueOcclusion.second(1)));
    return result;
}

const std::vector<BufferId> kCompared{BufferId::Beauty, BufferId::Albedo, BufferId::Roughness,
                                      BufferId::Normal, BufferId::Depth,  BufferId::AmbientOcclusion,
                                      BufferId::Opacity};

Status compareMethod(const std::string& method, const TruePicture& truth, FramePipeline& pipeline, FrameInputs inputs,
                     double pictures, Pools& pools, Comparison& result) {
    ARS_TRY(inputs.occlusion, settingsOf(method));
    ARS_TRY_STATUS(pipeline.render(inputs, kCompared));
    ARS_TRY(const Image opacity, pipeline.picture(BufferId::Opacity));
    ARS_TRY(const Image occlusion, pipeline.picture(BufferId::AmbientOcclusion));
    ARS_TRY(const Image beauty, pipeline.picture(BufferId::Beauty));
    addOcclusion(pools.occlusion[method], truth, opacity, occlusion,
                 method == "body" ? &pools.occlusionByMaterial : nullptr);
    addShaded(pools.shaded[method], truth, beauty);
    OcclusionScore& score = result.methods[method];
    score.milliseconds += pipeline.stages()[static_cast<std::size_t>(FrameStage::Occlude)].milliseconds / pictures;
    score.preparationMs += pipeline.occlusionPreparationMs() / pictures;
    return {};
}

} // namespace

Result<std::vector<TruePicture>> readTruePictures(const fs::path& validation) {
    std::vector<TruePicture> pictures;
    for (const char* set : {"heldout_views", "novel_poses"}) {
        const fs::path folder = validation / set;
        ARS_TRY(const std::vector<CalibratedCamera> cameras, readCalibration(folder / "calibration_full.json"));
        ARS_TRY(const Motion motion, readMotionNpz(folder / "smpl_params.npz"));
        for (const CalibratedCamera& camera : cameras) {
            for (int index = 0; index < static_cast<int>(motion.frames.size()); ++index) {
                ARS_TRY(TruePicture picture, readTruePicture(folder, camera, motion, index));
                pictures.push_back(std::move(picture));
            }
        }
    }
    return pictures;
}

Result<Comparison> compareWithPathTracing(const fs::path& capture, const ComparisonOptions& options,
                                          const fs::path& pages) {
    ARS_TRY(const std::vector<TruePicture> truths, readTruePictures(capture / "casual_val"));
    ARS_TRY(const LightSource light,
            readLightSource((capture / "casual_val" / "lights" / "courtyard.exr").string(), options.device));
    RestAvatarOptions rest;
    rest.maxSurfels = options.surfels;
    for (const auto& [name, value] : options.rest) ARS_TRY_STATUS(restAvatarParameters().setText(rest, name, value));
    ARS_TRY(std::unique_ptr<RestAvatar> built,
            restAvatarFromFile((capture / "casual" / "template.glb").string(), rest));
    const std::shared_ptr<AvatarEvaluator> avatar = std::move(built);
    ARS_TRY(const auto pipeline, FramePipeline::create(avatar, options.device));
    pipeline->setLight(light.filtered);
    pipeline->waitForTimings(true);

    Comparison result;
    result.surfels = avatar->rig().weights.pointCount();
    Pools pools;
    const auto count = static_cast<double>(truths.size());
    for (const TruePicture& truth : truths) {
        FrameInputs inputs;
        inputs.pose = truth.pose;
        inputs.camera = truth.camera;
        inputs.radii = uniformPartRadii(options.radiusM);
        inputs.placement.scale = kExposure;
        inputs.shading.occlude = false;
        ARS_TRY_STATUS(pipeline->render(inputs, {BufferId::Beauty, BufferId::Opacity}));
        ARS_TRY(const Image plain, pipeline->picture(BufferId::Beauty));
        addShaded(pools.unoccludedShaded, truth, plain);
        inputs.shading.occlude = true;
        for (const std::string& method : options.methods) {
            ARS_TRY_STATUS(compareMethod(method, truth, *pipeline, inputs, count, pools, result));
            if (method == options.methods.front()) {
                ARS_TRY_STATUS(addGeometry(pools, truth, *pipeline));
                ARS_TRY(const Image opacity, pipeline->picture(BufferId::Opacity));
                addOcclusion(pools.unoccluded, truth, opacity,
                             {opacity.width, opacity.height, 1, ColorSpace::Data, false, 32,
                              std::vector<float>(opacity.pixels.size(), 1.0f)},
                             nullptr);
                if (!pages.empty()) writePage(pages, truth, *pipeline);
            }
        }
        // The shading of the true buffers runs on the host whatever the device.
        if (options.device.kind == DeviceKind::Host) {
            ARS_TRY_STATUS(addCeiling(pools, truth, *light.filtered, options.radiusM));
        }
    }
    return summarise(pools, std::move(result));
}

std::string comparisonTable(const Comparison& c) {
    std::string text =
        fmt::format("| buffer | measure | value |\n|---|---|---|\n"
                    "| mask | intersection over union, all pictures / worst | {:.4f} / {:.4f} |\n"
                    "| mask | pixels missing, pixels too many | {:.2f} %, {:.2f} % |\n"
                    "| depth | median absolute error | {:.2f} mm |\n"
                    "| normal | mean, median angle | {:.2f}, {:.2f} degrees |\n"
                    "| albedo | mean absolute error | {:.4f} |\n"
                    "| roughness | mean absolute error | {:.4f} |\n",
                    c.maskIou, c.worstMaskIou, 100 * c.maskMissing, 100 * c.maskExtra, 1000 * c.depthMedianM,
                    c.normalMeanDeg, c.normalMedianDeg, c.albedoMae, c.roughnessMae);
    for (const auto& [material, degrees] : c.normalMeanDegByMaterial) {
        const auto occlusion = c.occlusionMaeByMaterial.find(material);
        text += fmt::format("| normal of {} | mean angle | {:.2f} degrees |\n", material, degrees);
        if (occlusion == c.occlusionMaeByMaterial.end()) continue;
        text += fmt::format("| occlusion of {} (body) | mean absolute error | {:.4f} |\n", material, occlusion->second);
    }
    text += "\n| occlusion | mean absolute error | share of O = 1 | correlation | PSNR in the mask | time a picture | "
            "of it "
            "preparation |\n|---|---|---|---|---|---|---|\n";
    text += fmt::format("| off (O = 1) | {:.4f} | 1 | | {:.2f} dB | | |\n", c.unoccludedMae, c.unoccludedPsnr);
    for (const auto& [method, score] : c.methods) {
        text += fmt::format("| {} | {:.4f} | {:.2f} | {:.3f} | {:.2f} dB | {:.0f} ms | {:.0f} ms |\n", method,
                            score.meanAbsoluteError, score.meanAbsoluteError / c.unoccludedMae, score.correlation,
                            score.psnr, score.milliseconds, score.preparationMs);
    }
    text += fmt::format("| body on the true buffers | {:.4f} | {:.2f} | {:.3f} | | | |\n", c.trueBuffersMae,
                        c.trueBuffersMae / c.unoccludedMae, c.trueBuffersCorrelation);
    text += fmt::format("| the path tracer's own, true buffers | 0 | 0 | 1 | {:.2f} dB | | |\n", c.ceilingPsnr);
    text += fmt::format("| O = 1, true buffers | | | | {:.2f} dB | | |\n", c.ceilingUnoccludedPsnr);
    return text;
}

} // namespace ars::test
