#pragma once

#include "engine/core/parallel.h"
#include "model/operators/surfel_operators.h"

#include <glm/gtc/matrix_transform.hpp>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace ars::test {

inline at::Tensor leaf(const at::Tensor& values) { return values.clone().requires_grad_(true); }

inline at::Tensor randomNumbers(at::IntArrayRef sizes, std::uint64_t seed, float low = 0.0f, float high = 1.0f) {
    auto generator = at::make_generator<at::CPUGeneratorImpl>(seed);
    return at::rand(sizes, generator, at::kFloat) * (high - low) + low;
}

/// Central differences of `loss` with respect to every `stride`-th number of `values`, compared with `expected`.
/// @param bound  of the difference, relative to the largest gradient of the tensor
inline void expectDifferences(const std::string& name, at::Tensor values, const at::Tensor& expected, float step,
                              double bound, const std::function<double()>& loss, std::int64_t stride = 1) {
    ASSERT_TRUE(expected.defined()) << name;
    ASSERT_EQ(values.sizes(), expected.sizes()) << name;
    const at::Tensor gradient = expected.contiguous();
    const double size = gradient.abs().max().item<double>();
    EXPECT_GT(size, 0.0) << name;
    const at::NoGradGuard guard;
    float* numbers = values.data_ptr<float>();
    for (std::int64_t i = 0; i < values.numel(); i += stride) {
        const float kept = numbers[i];
        numbers[i] = kept + step;
        const double up = loss();
        numbers[i] = kept - step;
        const double down = loss();
        numbers[i] = kept;
        EXPECT_NEAR(gradient.const_data_ptr<float>()[i], (up - down) / (2.0 * static_cast<double>(step)), bound * size)
            << name << " " << i;
    }
}

/// Sum of all pictures times fixed random weights, in double: its rounding must not show in differences.
inline double weighted(const at::Tensor& values, std::uint64_t seed) {
    return (values.to(at::kDouble) * randomNumbers(values.sizes(), seed, -1.0f, 1.0f).to(at::kDouble))
        .sum()
        .item<double>();
}
inline at::Tensor weightedTensor(const at::Tensor& values, std::uint64_t seed) {
    return (values * randomNumbers(values.sizes(), seed, -1.0f, 1.0f)).sum();
}

/// A few surfels so large that every pixel lies well inside all of them: nothing is cut off and the picture is smooth.
struct SmoothSurfels {
    static constexpr int kCount = 5, kWidth = 18, kHeight = 14;
    Camera camera = lookAtCamera({0.1, 0.05, 2.0}, {0.0, 0.0, 0.0}, 30.0, kWidth, kHeight);
    SurfelTensors surfels;

    SmoothSurfels() {
        std::mt19937 random(3);
        std::uniform_real_distribution<float> unit(-1.0f, 1.0f);
        const auto many = [&](std::int64_t width, const std::function<float(int, int)>& value) {
            at::Tensor tensor = at::empty({kCount, width}, at::kFloat);
            for (int i = 0; i < kCount; ++i) {
                for (int c = 0; c < width; ++c) tensor[i][c] = value(i, c);
            }
            return tensor.requires_grad_(true);
        };
        // Depths a tenth of a metre apart: differences never change the order.
        surfels.means =
            many(3, [&](int i, int c) { return c == 2 ? 0.1f * static_cast<float>(i) - 0.2f : 0.1f * unit(random); });
        surfels.rotations = many(4, [&](int, int c) { return c == 0 ? 1.3f : 0.2f * unit(random); });
        surfels.scales = many(2, [&](int, int) { return 0.5f + 0.1f * unit(random); });
        surfels.opacities = many(1, [&](int, int) { return 0.35f + 0.1f * unit(random); });
        surfels.colors = many(3, [&](int, int) { return 0.5f + 0.4f * unit(random); });
        surfels.albedos = many(3, [&](int, int) { return 0.5f + 0.4f * unit(random); });
        surfels.roughnesses = many(1, [&](int, int) { return 0.5f + 0.3f * unit(random); });
        surfels.radii = many(1, [&](int, int) { return 0.1f + 0.05f * unit(random); });
        surfels.radiiPlus = many(1, [&](int, int) { return 0.2f; });
        surfels.radiiMinus = many(1, [&](int, int) { return 0.05f; });
        surfels.importances = many(1, [&](int, int) { return 0.5f; });
        surfels.bones = many(3, [&](int, int c) { return c == 1 ? 1.0f : 0.1f; });
    }
};

inline constexpr ChannelSet kTrainingChannels{Channel::Opacity,     Channel::Depth,      Channel::Normal,
                                              Channel::Position,    Channel::Radiance,   Channel::Albedo,
                                              Channel::Roughness,   Channel::Radius,     Channel::RadiusPlus,
                                              Channel::RadiusMinus, Channel::Importance, Channel::Bone};

/// Nine grooves, one for each part and bound to one joint of it, so that every part has pixels that its radius darkens.
/// Everything from canonical surfels to the shaded sRGB picture.
struct NineParts {
    static constexpr int kSide = 96, kAcross = 26;
    Camera camera = lookAtCamera({0.0, 0.0, 2.4}, {0.0, 0.0, 0.0}, 30.0, kSide, kSide);
    std::shared_ptr<PosingContext> context = std::make_shared<PosingContext>();
    SurfelTensors canonical;
    at::Tensor initialRadii, texels;
    OcclusionParams occlusion;
    ToneParams tone{.backgroundRed = 0.2f, .backgroundGreen = 0.3f, .backgroundBlue = 0.4f};
    SplatScratchPool pool;
    OcclusionWorkspace workspace;

    /// @param blend  share of the neighbouring part's joint in a surfel's weights
    explicit NineParts(float blend = 0.0f) {
        context->params.trainingRadii = true;
        std::vector<glm::vec3> means;
        std::vector<glm::quat> rotations;
        std::vector<float> dense;
        for (int part = 0; part < 9; ++part) {
            const glm::mat4 turn = glm::rotate(glm::mat4(1.0f), 0.02f * static_cast<float>(part), glm::vec3(0, 0, 1));
            context->matrices.push_back(turn);
            context->jointPositions.emplace_back(0.0f, 0.0f, 0.0f);
            context->parts.push_back(static_cast<BodyPart>(part));
            addPatch(part, blend, means, rotations, dense);
        }
        const auto count = static_cast<std::int64_t>(means.size());
        context->weights = std::make_shared<SkinWeights>(*sparseWeights(dense, means.size(), 9));
        canonical.means = tensorOf(std::span<const glm::vec3>(means));
        canonical.rotations = at::empty({count, 4}, at::kFloat);
        for (std::int64_t i = 0; i < count; ++i) {
            const glm::quat q = rotations[static_cast<std::size_t>(i)];
            float* to = canonical.rotations.data_ptr<float>() + 4 * i;
            to[0] = q.w, to[1] = q.x, to[2] = q.y, to[3] = q.z;
        }
        canonical.scales = at::full({count, 2}, 0.009f);
        canonical.opacities = at::full({count, 1}, 0.9f);
        canonical.albedos = randomNumbers({count, 3}, 5, 0.2f, 0.8f);
        canonical.roughnesses = at::full({count, 1}, 0.6f);
        const PartRadii radii = initialPartRadii();
        initialRadii = tensorOf(std::span<const float>(radii));
        texels = randomNumbers({6, 64, 64, 3}, 9, 0.4f, 0.9f);
        occlusion.quality = OcclusionQuality::Interactive;
        occlusion.interactiveDirections = 256;
    }

    at::Tensor occlusionOf(const at::Tensor& offsets, GBufferTensors* pictures = nullptr) {
        const SurfelTensors live = poseSurfelTensors(context, canonical, initialRadii * (1.0f + offsets));
        GBufferTensors gbuffer = splatTensors({}, live, camera, channels(), pool);
        const at::Tensor result = occlusionTensor(occlusion, gbuffer, camera, workspace, 3);
        if (pictures) *pictures = std::move(gbuffer);
        return result;
    }
    /// sRGB (kSide, kSide, 4).
    at::Tensor picture(const at::Tensor& offsets, const std::shared_ptr<LightTensors>& light) {
        GBufferTensors gbuffer;
        const at::Tensor open = occlusionOf(offsets, &gbuffer);
        return toneTensor(tone, shadeTensors({}, gbuffer, open, camera, light));
    }
    static ChannelSet channels() {
        ChannelSet set = kTrainingChannels;
        set.remove(Channel::Radiance);
        set.remove(Channel::Position);
        return set;
    }

private:
    static void addPatch(int part, float blend, std::vector<glm::vec3>& means, std::vector<glm::quat>& rotations,
                         std::vector<float>& dense) {
        const glm::vec3 center(0.36f * static_cast<float>(part % 3 - 1), 0.36f * static_cast<float>(part / 3 - 1),
                               0.0f);
        // Grooves as wide as the part's radius: a larger one meets more of the opposite wall, so that darkness grows
        // with it.
        constexpr float kSlope = 0.7f;
        const float half = std::min(bodyPartInitialRadiusM(static_cast<BodyPart>(part)), 0.15f);
        for (int i = 0; i < kAcross * kAcross; ++i) {
            const glm::vec2 at(0.3f * (static_cast<float>(i % kAcross) / (kAcross - 1) - 0.5f),
                               0.3f * (static_cast<float>(i / kAcross) / (kAcross - 1) - 0.5f));
            const float fromBottom = at.x - 2.0f * half * std::round(at.x / (2.0f * half));
            means.push_back(center + glm::vec3(at, kSlope * std::abs(fromBottom)));
            const glm::vec3 normal = glm::normalize(glm::vec3(fromBottom > 0.0f ? -kSlope : kSlope, 0.0f, 1.0f));
            rotations.push_back(glm::normalize(glm::quat(1.0f + normal.z, -normal.y, normal.x, 0.0f)));
            for (int j = 0; j < 9; ++j) {
                dense.push_back(j == part ? 1.0f - blend : (j == (part + 1) % 9 ? blend : 0.0f));
            }
        }
    }
};

} // namespace ars::test
