#include "tests/unit/occlusion/ambient_occlusion_scenes.h"

#include "engine/occlusion/ambient_occlusion.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

// Parameters, refinement, the triple, and bad input.

namespace ars {
namespace {

using test::devicesUnderTest;
using test::download;
using test::occlusionOf;
using test::OcclusionScene;
using test::SceneOnDevice;

TEST(OcclusionParameters, PresetsAreThoseOfTheDesign) {
    const OcclusionParams body = bodyOcclusion(), reference = referenceOcclusion();
    EXPECT_EQ(body, OcclusionParams{});
    EXPECT_EQ(body.firstStep, 1);
    EXPECT_EQ(body.lastStep, 16);
    EXPECT_EQ(body.steps, 16);
    EXPECT_FLOAT_EQ(body.thicknessM, 0.10f);
    EXPECT_FLOAT_EQ(body.biasPerRadius, -0.01f);
    EXPECT_FALSE(body.median || body.depthFactor);
    EXPECT_EQ(reference.firstStep, 8);
    EXPECT_EQ(reference.lastStep, 15);
    EXPECT_FLOAT_EQ(reference.biasM, 0.01f);
    EXPECT_FLOAT_EQ(reference.thicknessM, 0.05f);
    EXPECT_TRUE(reference.median && reference.depthFactor);
    for (const OcclusionParams& params : {body, reference}) {
        EXPECT_TRUE(validateOcclusionParams(params).ok());
        OcclusionParams read;
        EXPECT_TRUE(occlusionParameters().fromJson(read, occlusionParameters().toJson(params)).ok());
        EXPECT_EQ(read, params);
    }
    EXPECT_EQ(*occlusionPreset("reference"), reference);
    EXPECT_EQ(*occlusionPreset("body"), body);
    EXPECT_EQ(occlusionPreset("bdoy").error().code, ErrorCode::NotFound);
}

TEST(OcclusionParameters, ValuesOutOfRangeAreNamed) {
    const auto refused = [](const std::string& name, auto change) {
        OcclusionParams params;
        change(params);
        const Status status = validateOcclusionParams(params);
        ASSERT_FALSE(status.ok()) << name;
        EXPECT_EQ(status.error().code, ErrorCode::InvalidArgument);
        EXPECT_NE(status.error().describe().find(name), std::string::npos) << status.error().describe();
    };
    refused("delta", [](OcclusionParams& p) { p.delta = 0.0f; });
    refused("delta", [](OcclusionParams& p) { p.delta = std::nanf(""); });
    refused("alpha", [](OcclusionParams& p) { p.alpha = 1e9f; });
    refused("strength", [](OcclusionParams& p) { p.strength = -1.0f; });
    refused("steps", [](OcclusionParams& p) { p.steps = 65; });
    refused("last_step", [](OcclusionParams& p) { p.lastStep = 17; });
    refused("first_step", [](OcclusionParams& p) { p.firstStep = 0; });
    refused("first_step", [](OcclusionParams& p) { p.firstStep = 12, p.lastStep = 11; });
    refused("bias", [](OcclusionParams& p) { p.biasM = std::numeric_limits<float>::infinity(); });
    refused("bias_per_radius", [](OcclusionParams& p) { p.biasPerRadius = std::nanf(""); });
    refused("thickness", [](OcclusionParams& p) { p.thicknessM = 0.0f; });
    refused("thickness", [](OcclusionParams& p) { p.thicknessM = std::nanf(""); });
    refused("interactive_directions", [](OcclusionParams& p) { p.interactiveDirections = 0; });
    OcclusionParams endless;
    endless.thicknessM = std::numeric_limits<float>::infinity();
    EXPECT_TRUE(validateOcclusionParams(endless).ok());
}

TEST(OcclusionParameters, StrengthScalesTheOcclusion) {
    const OcclusionScene scene = test::capsuleBody(64);
    OcclusionParams half = bodyOcclusion(), none = bodyOcclusion();
    half.strength = 0.5f;
    none.strength = 0.0f;
    for (const Device& device : devicesUnderTest()) {
        const std::vector<float> full = occlusionOf(bodyOcclusion(), scene, device);
        const std::vector<float> weak = occlusionOf(half, scene, device), off = occlusionOf(none, scene, device);
        EXPECT_LT(*std::min_element(full.begin(), full.end()), 0.8f);
        for (std::size_t p = 0; p < full.size(); ++p) {
            ASSERT_NEAR(1.0f - weak[p], 0.5f * (1.0f - full[p]), 1e-6f);
            ASSERT_EQ(off[p], 1.0f);
        }
    }
}

TEST(OcclusionTriple, EqualsThreeSeparateMaps) {
    OcclusionScene scene = test::capsuleBody(72);
    OcclusionScene plus = scene, minus = scene;
    for (std::size_t p = 0; p < scene.pixels(); ++p) {
        scene.radius[p] = 0.05f + 0.001f * static_cast<float>(p % 200);
        plus.radius[p] = 1.05f * scene.radius[p];
        minus.radius[p] = p % 7 == 0 ? 0.0f : 0.95f * scene.radius[p];
    }
    OcclusionParams interactive = bodyOcclusion();
    interactive.quality = OcclusionQuality::Interactive;
    for (const OcclusionParams& params : {bodyOcclusion(), referenceOcclusion(), interactive}) {
        for (const Device& device : devicesUnderTest()) {
            SceneOnDevice there(scene, device);
            PixelBuffer o = there.output(), oPlus = there.output(), oMinus = there.output();
            OcclusionWorkspace workspace;
            const Status status = ambientOcclusionTriple(
                params, there.inputs(), there.upload(plus.picture(plus.radius, 1)),
                there.upload(minus.picture(minus.radius, 1)), workspace, o.view(), oPlus.view(), oMinus.view(), 3);
            ASSERT_TRUE(status.ok()) << status.error().describe();
            EXPECT_EQ(download(o), occlusionOf(params, scene, device, 3));
            EXPECT_EQ(download(oPlus), occlusionOf(params, plus, device, 3));
            EXPECT_EQ(download(oMinus), occlusionOf(params, minus, device, 3));
        }
    }
}

TEST(OcclusionRefinement, BecomesTheFullQuality) {
    const OcclusionScene scene = test::capsuleBody(64);
    OcclusionParams interactive = bodyOcclusion();
    interactive.quality = OcclusionQuality::Interactive;
    for (const Device& device : devicesUnderTest()) {
        const std::vector<float> full = occlusionOf(bodyOcclusion(), scene, device);
        const auto errorOf = [&full](const std::vector<float>& o) {
            double sum = 0.0, worst = 0.0;
            for (std::size_t p = 0; p < o.size(); ++p) {
                sum += std::fabs(o[p] - full[p]);
                worst = std::max(worst, static_cast<double>(std::fabs(o[p] - full[p])));
            }
            return std::pair(sum / static_cast<double>(o.size()), worst);
        };
        SceneOnDevice there(scene, device);
        PixelBuffer out = there.output();
        OcclusionWorkspace workspace;
        OcclusionRefinement refinement;
        EXPECT_FALSE(refinement.complete());
        ASSERT_TRUE(refinement.refine(interactive, there.inputs(), 1, workspace, out.view()).ok());
        OcclusionParams larger = interactive;
        larger.interactiveDirections = kRefinementDirections;
        EXPECT_EQ(refinement.passes(), 1 + occlusionPasses(larger));
        EXPECT_EQ(refinement.passesDone(), 1);
        const std::vector<float> first = download(out);
        EXPECT_EQ(first, occlusionOf(interactive, scene, device, 0));
        const double atFirst = errorOf(first).first;
        double atFourth = 0.0;
        while (!refinement.complete()) {
            ASSERT_TRUE(refinement.refine(interactive, there.inputs(), 1, workspace, out.view()).ok());
            if (refinement.passesDone() == 4) atFourth = errorOf(download(out)).first;
        }
        EXPECT_FLOAT_EQ(refinement.share(), 1.0f);
        const auto [mean, worst] = errorOf(download(out));
        std::printf("refinement: mean error %.5f after 1 pass, %.5f after 4, %.2g after %d\n", atFirst, atFourth, mean,
                    refinement.passes());
        EXPECT_LT(atFirst, 0.004); // empty pixels count as right
        EXPECT_LT(atFourth, 0.5 * atFirst);
        EXPECT_LT(worst, 1e-5); // the order of the sum is another
        // A call more writes the same; a stronger or weaker display does not start again.
        const std::vector<float> before = download(out);
        ASSERT_TRUE(refinement.refine(interactive, there.inputs(), 1, workspace, out.view()).ok());
        EXPECT_EQ(download(out), before);
        EXPECT_TRUE(refinement.complete());
    }
}

TEST(OcclusionRefinement, SlicesOfAnySizeEndInTheSamePicture) {
    const OcclusionScene scene = test::capsuleBody(64);
    const OcclusionParams params = bodyOcclusion();
    const std::vector<float> full = occlusionOf(params, scene, {});
    for (const auto& [bands, directions] : {std::pair{5, 256}, {64, 1024}, {1000, 1024}, {1, 512}}) {
        OcclusionWorkspace workspace;
        OcclusionRefinement refinement;
        refinement.setSlices(bands, directions);
        std::vector<float> out(scene.pixels());
        const ImageView<float> view{out.data(), scene.camera.width, scene.camera.height, 1};
        int calls = 0;
        float share = 0.0f;
        while (!refinement.complete()) {
            ASSERT_TRUE(refinement.refine(params, scene.inputs(), 1, workspace, view).ok());
            EXPECT_GT(refinement.share(), share) << "every call is a step ahead";
            share = refinement.share();
            ASSERT_LT(++calls, 5000);
        }
        EXPECT_EQ(share, 1.0f);
        const int perPass = std::min(bands, scene.camera.height);
        EXPECT_GE(calls, (refinement.passes() - 1) * perPass / 2);
        EXPECT_LE(calls, 1 + (refinement.passes() - 1) * perPass);
        for (std::size_t p = 0; p < out.size(); ++p) ASSERT_NEAR(out[p], full[p], 1e-5f);
        // Fewer bands from the middle of a pass on.
        refinement.reset();
        refinement.setSlices(7, directions);
        for (int i = 0; i < 4; ++i) ASSERT_TRUE(refinement.refine(params, scene.inputs(), 1, workspace, view).ok());
        refinement.setSlices(2, directions);
        while (!refinement.complete()) ASSERT_TRUE(refinement.refine(params, scene.inputs(), 1, workspace, view).ok());
        for (std::size_t p = 0; p < out.size(); ++p) ASSERT_NEAR(out[p], full[p], 1e-5f);
    }
}

TEST(OcclusionRefinement, StartsAgainWhenSomethingChanges) {
    OcclusionScene scene = test::capsuleBody(32);
    OcclusionParams params = bodyOcclusion();
    OcclusionWorkspace workspace;
    OcclusionRefinement refinement;
    std::vector<float> out(scene.pixels());
    const auto refine = [&](std::uint64_t version) {
        EXPECT_TRUE(refinement
                        .refine(params, scene.inputs(), version, workspace,
                                {out.data(), scene.camera.width, scene.camera.height, 1})
                        .ok());
        return refinement.passesDone();
    };
    EXPECT_EQ(refine(1), 1);
    EXPECT_EQ(refine(1), 2);
    params.strength = 0.5f;
    EXPECT_EQ(refine(1), 3);
    params.quality = OcclusionQuality::Interactive;
    EXPECT_EQ(refine(1), 4);
    EXPECT_EQ(refine(2), 1);
    EXPECT_EQ(refine(2), 2);
    params.thicknessM = 0.2f;
    EXPECT_EQ(refine(2), 1);
    EXPECT_EQ(refine(2), 2);
    scene.camera.fx += 1.0;
    EXPECT_EQ(refine(2), 1);
    EXPECT_EQ(refine(2), 2);
    scene.importance.clear();
    EXPECT_EQ(refine(2), 1);
    EXPECT_EQ(refinement.passes(), 3); // two halves of 512 directions
    EXPECT_EQ(refine(2), 2);
    refinement.reset();
    EXPECT_EQ(refine(2), 1);
}

TEST(OcclusionInput, PicturesOfOtherSizesAreNamed) {
    const OcclusionScene scene = test::capsuleBody(16);
    std::vector<float> out(scene.pixels());
    const ImageView<float> good{out.data(), 16, 16, 1};
    OcclusionWorkspace workspace;
    const auto refused = [&](const std::string& words, const OcclusionInputs& inputs, ImageView<float> target) {
        const Status status = ambientOcclusion(bodyOcclusion(), inputs, workspace, target);
        ASSERT_FALSE(status.ok()) << words;
        EXPECT_EQ(status.error().code, ErrorCode::InvalidArgument);
        EXPECT_NE(status.error().describe().find(words), std::string::npos) << status.error().describe();
    };
    OcclusionInputs inputs = scene.inputs();
    inputs.depth.height = 15;
    refused("depth picture is 16x15", inputs, good);
    inputs = scene.inputs();
    inputs.normal.channels = 1;
    refused("normal picture is 16x16 with 1", inputs, good);
    inputs = scene.inputs();
    inputs.radius = {};
    refused("no radius picture", inputs, good);
    inputs = scene.inputs();
    inputs.importance.width = 8;
    refused("importance picture is 8x16", inputs, good);
    inputs = scene.inputs();
    inputs.camera.width = 0;
    refused("camera", inputs, good);
    inputs = scene.inputs();
    inputs.camera.fx = std::nan("");
    refused("camera", inputs, good);
    inputs = scene.inputs();
    inputs.camera.rotation = glm::dmat3(0.0);
    refused("camera", inputs, good);
    refused("occlusion picture is 16x4", scene.inputs(), {out.data(), 16, 4, 1});
    refused("no occlusion picture", scene.inputs(), {});
    GBuffer empty;
    EXPECT_EQ(occlusionInputs(empty, scene.camera).error().code, ErrorCode::NotFound);
    inputs = scene.inputs();
    inputs.device = {DeviceKind::Cuda, 0};
    EXPECT_EQ(occlusionCost(bodyOcclusion(), inputs).error().code, ErrorCode::Unsupported);
}

TEST(OcclusionInput, ValuesThatMakeNoSenseGiveOneAndHarmNoOtherPixel) {
    const OcclusionScene good = test::capsuleBody(48);
    const float nan = std::nanf(""), infinite = std::numeric_limits<float>::infinity();
    OcclusionScene bad = good;
    bad.bone.assign(3 * bad.pixels(), 0.0f);
    std::vector<std::size_t> foreground, spoiled;
    for (std::size_t p = 0; p < bad.pixels(); ++p) {
        if (bad.depth[p] > 0.0f) foreground.push_back(p);
    }
    // Empty pixels get every kind of rubbish in depth; foreground pixels in what only they use.
    std::size_t kind = 0;
    for (std::size_t p = 0; p < bad.pixels(); ++p) {
        if (bad.depth[p] == 0.0f) bad.depth[p] = std::array{0.0f, -1.0f, nan, infinite, -infinite}[kind++ % 5];
    }
    for (std::size_t k = 0; k < foreground.size(); k += 9) {
        const std::size_t p = foreground[k];
        switch (k / 9 % 7) {
        case 0:
            bad.normal[3 * p] = nan;
            break;
        case 1:
            bad.normal[3 * p + 1] = infinite;
            break;
        case 2:
            bad.normal[3 * p] = bad.normal[3 * p + 1] = bad.normal[3 * p + 2] = 0.0f;
            break;
        case 3:
            bad.radius[p] = nan;
            break;
        case 4:
            bad.radius[p] = infinite;
            break;
        case 5:
            bad.radius[p] = -0.1f;
            break;
        default:
            bad.radius[p] = 0.0f;
            break;
        }
        spoiled.push_back(p);
    }
    for (const std::size_t p : {foreground[1], foreground[2], foreground[3]}) {
        bad.bone[3 * p] = p % 2 ? nan : infinite; // falls back to up, as an absent picture does
    }
    for (const Device& device : devicesUnderTest()) {
        const std::vector<float> expected = occlusionOf(bodyOcclusion(), good, device);
        const std::vector<float> o = occlusionOf(bodyOcclusion(), bad, device);
        for (const std::size_t p : spoiled) EXPECT_EQ(o[p], 1.0f);
        for (std::size_t p = 0; p < o.size(); ++p) {
            if (std::find(spoiled.begin(), spoiled.end(), p) == spoiled.end()) {
                ASSERT_EQ(o[p], expected[p]) << p;
            }
        }
    }
    // Radii beyond all measure, surfaces at the lens, tiny and huge depths: numbers in [0, 1] still.
    OcclusionScene wild = good;
    for (std::size_t k = 0; k < foreground.size(); ++k) {
        const std::size_t p = foreground[k];
        wild.radius[p] = std::array{1e-30f, 1e30f, 3.0f, 1e-4f}[k % 4];
        if (k % 11 == 0) wild.depth[p] = std::array{1e-30f, 1e-3f, 1e30f, 3e38f}[k % 4];
        wild.importance[p] = std::array{nan, infinite, -infinite, 0.5f}[k % 4];
    }
    for (OcclusionParams params : {bodyOcclusion(), referenceOcclusion()}) {
        params.delta = 0.25f;
        for (const Device& device : devicesUnderTest()) {
            for (const float v : occlusionOf(params, wild, device)) ASSERT_TRUE(v >= 0.0f && v <= 1.0f) << v;
        }
    }
}

TEST(OcclusionInput, TransparentPixelsAreEmpty) {
    OcclusionScene scene(40, 40, 60.0);
    scene.fill(0.5, [](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        depth = ray.x > 0.05 ? 1.7 : 2.0;
        normal = {0.0, 0.0, -1.0};
        return true;
    });
    std::vector<float> opacity(scene.pixels(), 1.0f);
    for (std::size_t p = 0; p < scene.pixels(); ++p) opacity[p] = scene.depth[p] < 1.8f ? 1e-4f : 1.0f;
    for (const Device& device : devicesUnderTest()) {
        const std::vector<float> solid = occlusionOf(bodyOcclusion(), scene, device);
        EXPECT_LT(*std::min_element(solid.begin(), solid.end()), 0.9f);
        SceneOnDevice there(scene, device);
        OcclusionInputs inputs = there.inputs();
        inputs.opacity = there.upload(scene.picture(opacity, 1));
        PixelBuffer out = there.output();
        OcclusionWorkspace workspace;
        ASSERT_TRUE(ambientOcclusion(bodyOcclusion(), inputs, workspace, out.view()).ok());
        for (const float v : download(out)) ASSERT_EQ(v, 1.0f);
    }
}

TEST(OcclusionInput, OnePixelPictureAndReusedWorkspace) {
    OcclusionWorkspace workspace;
    for (const int side : {1, 70, 9}) {
        OcclusionScene scene(side, side, 2.0 * side);
        scene.fill(0.2, [](const glm::dvec3&, double& depth, glm::dvec3& normal) {
            depth = 2.0;
            normal = {0.0, 0.0, -1.0};
            return true;
        });
        for (const OcclusionParams& params : {bodyOcclusion(), referenceOcclusion()}) {
            std::vector<float> out(scene.pixels(), -1.0f);
            ASSERT_TRUE(ambientOcclusion(params, scene.inputs(), workspace, {out.data(), side, side, 1}, -7).ok());
            for (const float v : out) ASSERT_TRUE(v >= 0.0f && v <= 1.0f);
        }
    }
}

} // namespace
} // namespace ars
