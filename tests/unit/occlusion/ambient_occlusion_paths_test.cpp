#include "engine/core/parallel.h"
#include "engine/occlusion/ambient_occlusion_kernels.h"
#include "tests/unit/occlusion/ambient_occlusion_oracle.h"
#include "tests/unit/occlusion/ambient_occlusion_scenes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

// The loops of every instruction set, with what they skip, against one ray after another through the shared functions.

namespace ars {
namespace {

using test::devicesUnderTest;
using test::occlusionOf;
using test::OcclusionScene;

/// O of one pixel by rayIsHidden of ambient_occlusion_math.h: nothing is skipped, nothing is in tables.
template <typename T>
T plainOcclusion(const OcclusionParams& params, const OcclusionScene& scene, int row, int column) {
    using Vec = glm::vec<3, T>;
    const int stride = scene.camera.width + 2;
    OcclusionMarch<T> march;
    march.width = scene.camera.width, march.height = scene.camera.height, march.stride = stride;
    march.fx = static_cast<T>(scene.camera.fx), march.fy = static_cast<T>(scene.camera.fy);
    march.cx = static_cast<T>(scene.camera.cx + 1.0), march.cy = static_cast<T>(scene.camera.cy + 1.0);
    march.steps = params.steps, march.firstStep = params.firstStep, march.lastStep = params.lastStep;
    march.biasM = params.biasM, march.biasPerRadius = params.biasPerRadius, march.thicknessM = params.thicknessM;
    march.depthFactor = params.depthFactor;
    const auto depthAt = [&scene](int c, int r) {
        if (c < 1 || r < 1 || c > scene.camera.width || r > scene.camera.height) return T(0);
        return static_cast<T>(scene.depth[scene.at(r - 1, c - 1)]);
    };
    static thread_local std::vector<T> padded;
    static thread_local const OcclusionScene* paddedFor = nullptr;
    static thread_local bool paddedMedian = false;
    if (paddedFor != &scene || paddedMedian != params.median) {
        padded.assign(static_cast<std::size_t>(stride) * static_cast<std::size_t>(scene.camera.height + 2),
                      emptyDepth<T>());
        for (int r = 1; r <= scene.camera.height; ++r) {
            for (int c = 1; c <= scene.camera.width; ++c) {
                const T z = filteredPosition(march, c, r, params.median, depthAt).z;
                if (z > T(kOcclusionNearest)) padded[static_cast<std::size_t>(r * stride + c)] = z;
            }
        }
        paddedFor = &scene;
        paddedMedian = params.median;
    }
    const std::size_t at = scene.at(row, column);
    const Vec position = filteredPosition(march, column + 1, row + 1, params.median, depthAt);
    OcclusionFrame<T> frame;
    const Vec normal(scene.normal[3 * at], scene.normal[3 * at + 1], scene.normal[3 * at + 2]);
    const Vec bone =
        scene.bone.empty() ? Vec(0) : Vec(scene.bone[3 * at], scene.bone[3 * at + 1], scene.bone[3 * at + 2]);
    const T radius = static_cast<T>(scene.radius[at]);
    if (!(scene.depth[at] > 0.0f) || !(position.z > T(kOcclusionNearest)) || !(radius > T(0)) ||
        !occlusionFrame(normal, bone, frame)) {
        return T(1);
    }
    const bool adaptive = params.adaptive != OcclusionAdaptive::Off && !scene.importance.empty();
    const OcclusionGrid grid = occlusionGrid(params.delta, params.alpha, adaptive ? scene.importance[at] : 0.0f,
                                             params.adaptive == OcclusionAdaptive::Azimuth);
    const OcclusionReach<T> reach = occlusionReach(march, radius, position.z);
    const Vec tangent = toHomogeneous(march, frame.tangent), bitangent = toHomogeneous(march, frame.bitangent);
    const Vec origin = toHomogeneous(march, position), pole = toHomogeneous(march, frame.normal);
    T occluded = T(0), total = T(0);
    for (int t = 0; t < grid.polarAngles; ++t) {
        const double theta = polarAngle<double>(t, grid.polarAngles);
        int hits = 0;
        for (int i = 0; i < grid.azimuths; ++i) {
            const double phi = azimuthAngle<double>(i, grid.azimuths);
            const T c = static_cast<T>(static_cast<float>(std::cos(phi))),
                    s = static_cast<T>(static_cast<float>(std::sin(phi)));
            const Vec azimuth = c * tangent + s * bitangent;
            const Vec direction = rayDirection(azimuth, pole, static_cast<T>(static_cast<float>(std::sin(theta))),
                                               static_cast<T>(static_cast<float>(std::cos(theta))));
            hits += rayIsHidden(march, padded.data(), origin, direction, reach) ? 1 : 0;
        }
        const T weight = static_cast<T>(static_cast<float>(std::cos(theta) * std::sin(theta)));
        occluded += weight * static_cast<T>(hits);
        total += weight * static_cast<T>(grid.azimuths);
    }
    return occlusionFromWeights(occluded, total, static_cast<T>(params.strength));
}

/// Everything that the vector loops treat apart: steep rims, other radii, rays that leave the picture.
OcclusionScene variedBody(int side) {
    OcclusionScene scene = test::capsuleBody(side);
    std::mt19937 random(5);
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    for (std::size_t p = 0; p < scene.pixels(); ++p) {
        scene.radius[p] = 0.02f + 0.4f * uniform(random) * uniform(random);
        scene.importance[p] *= uniform(random);
        const glm::vec3 q(uniform(random) - 0.5f, uniform(random) - 0.5f, uniform(random) - 0.5f);
        scene.bone.insert(scene.bone.end(), {q.x, q.y, q.z});
    }
    return scene;
}

std::vector<std::pair<const char*, OcclusionParams>> variants() {
    OcclusionParams open = bodyOcclusion();
    open.biasPerRadius = 0.0f;
    open.thicknessM = std::numeric_limits<float>::infinity();
    OcclusionParams ahead = bodyOcclusion(); // hidden even a little in front
    ahead.biasM = 0.004f;
    ahead.adaptive = OcclusionAdaptive::Azimuth;
    OcclusionParams many = bodyOcclusion();
    many.steps = 40, many.firstStep = 3, many.lastStep = 37;
    many.adaptive = OcclusionAdaptive::Off;
    OcclusionParams odd = bodyOcclusion();
    odd.delta = 0.11f;
    return {{"body", bodyOcclusion()}, {"reference", referenceOcclusion()},
            {"solid", open},           {"ahead", ahead},
            {"many steps", many},      {"odd counts", odd}};
}

TEST(OcclusionPaths, VectorLoopsEqualThePlainEvaluationBitForBit) {
    const OcclusionScene scene = variedBody(88);
    for (const auto& [what, params] : variants()) {
        std::vector<float> plain(scene.pixels(), 1.0f);
        parallelFor(scene.pixels(), [&, &p = params](std::size_t at) {
            plain[at] = plainOcclusion<float>(p, scene, static_cast<int>(at / 88), static_cast<int>(at % 88));
        });
        for (const cpu::NamedMarchRows& rows : cpu::availableMarchRows()) {
            cpu::setMarchRows(rows.march);
            const std::vector<float> o = occlusionOf(params, scene, Device{});
            std::size_t different = 0;
            for (std::size_t p = 0; p < o.size(); ++p) different += o[p] != plain[p] ? 1 : 0;
            EXPECT_EQ(different, 0u) << rows.name << ", " << what;
        }
        cpu::setMarchRows(nullptr);
    }
    std::printf("row loops:");
    for (const cpu::NamedMarchRows& rows : cpu::availableMarchRows()) std::printf(" %s", rows.name);
    std::printf("\n");
}

TEST(OcclusionPaths, FloatAndDoubleAgreeOnEveryDevice) {
    const OcclusionScene scene = variedBody(88);
    for (const auto& [what, params] : variants()) {
        std::vector<double> exact(scene.pixels(), 1.0);
        parallelFor(scene.pixels(), [&, &p = params](std::size_t at) {
            exact[at] = plainOcclusion<double>(p, scene, static_cast<int>(at / 88), static_cast<int>(at % 88));
        });
        for (const Device& device : devicesUnderTest()) {
            const std::vector<float> o = occlusionOf(params, scene, device);
            double sum = 0.0;
            std::size_t far = 0, count = 0;
            for (std::size_t p = 0; p < o.size(); ++p) {
                if (scene.depth[p] == 0.0f) continue;
                const double difference = std::fabs(o[p] - exact[p]);
                sum += difference, ++count;
                far += difference > 0.01 ? 1 : 0;
            }
            std::printf("%s on %s: mean %.2g, %zu of %zu pixels differ by more than 0.01\n", what,
                        deviceName(device).c_str(), sum / static_cast<double>(count), far, count);
            // Rays whose sample lies on the border of a pixel may fall to either side.
            EXPECT_LT(sum / static_cast<double>(count), 5e-4) << what;
            EXPECT_LT(far, count / 50) << what;
        }
    }
}

TEST(OcclusionPaths, ThreadsChangeNothing) {
    const OcclusionScene scene = variedBody(88);
    const int before = threadCount();
    setThreadCount(1);
    const std::vector<float> one = occlusionOf(bodyOcclusion(), scene, Device{});
    setThreadCount(5);
    const std::vector<float> five = occlusionOf(bodyOcclusion(), scene, Device{});
    setThreadCount(before);
    EXPECT_EQ(one, five);
}

TEST(OcclusionPaths, SamplesBehindTheCameraAreOutside) {
    // A radius larger than the depth: rays pass the camera plane. The plain path takes over and agrees with double.
    OcclusionScene scene(24, 24, 30.0);
    scene.fill(5.0, [](const glm::dvec3& ray, double& depth, glm::dvec3& normal) {
        depth = 0.6 + 0.3 * ray.x;
        normal = glm::normalize(glm::dvec3(0.2, 0.1, -1.0));
        return true;
    });
    OcclusionParams params = bodyOcclusion();
    params.thicknessM = 2.0f;
    for (const Device& device : devicesUnderTest()) {
        const std::vector<float> o = occlusionOf(params, scene, device);
        for (int r = 0; r < 24; ++r) {
            for (int c = 0; c < 24; ++c) {
                EXPECT_NEAR(o[scene.at(r, c)], test::oracleOcclusion(params, scene, r, c), 0.01);
            }
        }
    }
}

TEST(OcclusionPaths, SubsetsTakeEveryDirectionOnce) {
    for (const auto& [azimuths, polar] :
         {std::pair{32, 16}, {33, 17}, {48, 24}, {97, 48}, {128, 64}, {128, 16}, {4, 2}, {1024, 512}}) {
        for (const int most : {16, 64, 128, 1000}) {
            const OcclusionGrid grid{azimuths, polar};
            const OcclusionSubsets subsets = occlusionSubsets(grid, most);
            std::vector<int> taken(static_cast<std::size_t>(azimuths * polar), 0);
            for (int pass = 0; pass < subsets.count(); ++pass) {
                const OcclusionSubset subset = occlusionSubset(subsets, pass);
                int size = 0;
                for (int t = subset.row; t < polar; t += subsets.rowStride) {
                    for (int i = occlusionResidue(subsets, subset, t); i < azimuths; i += subsets.azimuthStride) {
                        ++taken[static_cast<std::size_t>(t * azimuths + i)];
                        ++size;
                    }
                }
                EXPECT_LE(size, most);
                EXPECT_GT(size, 0);
            }
            for (const int count : taken) ASSERT_EQ(count, 1) << azimuths << "x" << polar << " by " << most;
        }
    }
}

TEST(OcclusionPaths, MedianOfNineIsTheFifth) {
    // A network of exchanges that sorts every sequence of zeros and ones sorts every sequence.
    for (unsigned bits = 0; bits < 512; ++bits) {
        double values[9];
        int ones = 0;
        for (unsigned k = 0; k < 9; ++k) {
            values[k] = bits >> k & 1u;
            ones += values[k] > 0.0 ? 1 : 0;
        }
        EXPECT_EQ(medianOfNine(values), ones >= 5 ? 1.0 : 0.0) << bits;
    }
}

} // namespace
} // namespace ars
