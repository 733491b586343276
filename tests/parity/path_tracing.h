#pragma once

#include "engine/core/error.h"
#include "engine/frame/frame_pipeline.h"
#include "engine/io/image.h"

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace ars::test {

/// One ground-truth picture of the validation capture and what the renderer needs to make it.
struct TruePicture {
    std::string name; ///< "heldout_views 24110013 2"
    Camera camera;
    Pose pose;
    Image color;     ///< RGBA, linear, premultiplied, without exposure
    Image albedo;    ///< linear
    Image roughness; ///< 1
    Image occlusion; ///< 1, rays of 0.25 m
    Image normal;    ///< camera space (the files hold world space)
    Image depth;     ///< 1, metres
};

/// The sixteen pictures of capture/casual_val, in a fixed order.
Result<std::vector<TruePicture>> readTruePictures(const std::filesystem::path& validation);

/// What is compared: our avatar under the method's occlusion.
struct ComparisonOptions {
    int surfels = 60000; ///< more only widen the outline: each adds its 0.3 px^2 of low-pass
    std::vector<std::pair<std::string, std::string>> rest; ///< other settings of the rest avatar
    float radiusM = 0.25f;
    Device device;
    std::vector<std::string> methods; ///< body, reference, mesh_rays, rasterised, baked
};

struct OcclusionScore {
    double meanAbsoluteError = 0;
    double correlation = 0;
    double psnr = 0;          ///< of the shaded picture in the mask, dB
    double milliseconds = 0;  ///< occlusion a picture
    double preparationMs = 0; ///< tree, visibility or bake, mean over the pictures
};

struct Comparison {
    std::size_t surfels = 0;
    std::size_t pixels = 0;
    double maskIou = 0;                    ///< all pictures pooled
    double worstMaskIou = 0;               ///< of one picture
    double maskMissing = 0, maskExtra = 0; ///< share of the true mask
    double depthMedianM = 0;
    double normalMeanDeg = 0, normalMedianDeg = 0;
    double albedoMae = 0, roughnessMae = 0;
    std::map<std::string, double> normalMeanDegByMaterial;
    std::map<std::string, double> occlusionMaeByMaterial; ///< of preset body
    double unoccludedMae = 0;                             ///< what O = 1 gives
    double unoccludedPsnr = 0;
    double ceilingPsnr = 0;           ///< this shading on the true buffers
    double ceilingUnoccludedPsnr = 0; ///< the same with O = 1
    double trueBuffersMae = 0;        ///< occlusion `body` on the true depth and normals
    double trueBuffersCorrelation = 0;
    std::map<std::string, OcclusionScore> methods;
};

/// Renders every picture and compares. `pages`: where side-by-side pictures are written; empty: none.
Result<Comparison> compareWithPathTracing(const std::filesystem::path& capture, const ComparisonOptions& options,
                                          const std::filesystem::path& pages = {});

/// The tables as Markdown.
std::string comparisonTable(const Comparison& comparison);

} // namespace ars::test
