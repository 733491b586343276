#include "engine/core/file.h"
#include "engine/rig/body_model.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace ars {
namespace {

std::filesystem::path fixture(const std::string& name) {
    return test::sourceFolder() / "tests/unit/rig/fixtures" / name;
}

// ---------------------------------------------------------------------------------------------- a small body by hand

/// Eight vertices at the corners of a cube, all of joint 0; joint j lies at vertex j % 8.
NpzFile cubeArrays() {
    NpzFile file;
    std::vector<float> corners, weights(8 * 55, 0.0f), regressor(55 * 8, 0.0f), shapes(8 * 3 * 20, 0.0f);
    for (std::size_t v = 0; v < 8; ++v) {
        for (std::size_t c = 0; c < 3; ++c) corners.push_back((v >> c) & 1 ? 1.0f : -1.0f);
        weights[v * 55] = 1.0f;
        for (std::size_t k = 0; k < 20; ++k) shapes[(v * 3 + k % 3) * 20 + k] = static_cast<float>(k + 1);
    }
    std::vector<std::int64_t> tree, faces = {0, 1, 2, 5, 6, 7};
    for (std::size_t j = 0; j < 55; ++j) regressor[j * 8 + j % 8] = 1.0f;
    for (int j = 0; j < 55; ++j) tree.push_back(smplxJointParent(j));
    for (int j = 0; j < 55; ++j) tree.push_back(j);
    file.arrays["v_template"] = Array::fromFloats({8, 3}, corners);
    file.arrays["f"] = Array::fromInts({2, 3}, faces);
    file.arrays["weights"] = Array::fromFloats({8, 55}, weights);
    file.arrays["J_regressor"] = Array::fromFloats({55, 8}, regressor);
    file.arrays["kintree_table"] = Array::fromInts({2, 55}, tree);
    file.arrays["shapedirs"] = Array::fromFloats({8, 3, 20}, shapes);
    file.arrays["posedirs"] = Array::fromFloats({8, 3, 486}, std::vector<float>(8 * 3 * 486, 0.0f));
    return file;
}

Array shapesOfWidth(std::size_t width) {
    std::vector<float> values(8 * 3 * width);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i % width);
    return Array::fromFloats({8, 3, width}, values);
}

std::string errorOf(const NpzFile& file) {
    const auto body = bodyModelFromArrays(file);
    return body.ok() ? "no error" : body.error().describe();
}

void expectMessage(const NpzFile& file, std::initializer_list<const char*> parts) {
    const std::string message = errorOf(file);
    for (const char* part : parts) EXPECT_NE(message.find(part), std::string::npos) << message;
}

TEST(BodyModel, SmallBodyIsReadAsWritten) {
    const auto body = bodyModelFromArrays(cubeArrays());
    ASSERT_TRUE(body.ok()) << body.error().describe();
    EXPECT_EQ(body->vertexCount(), 8u);
    EXPECT_EQ(body->triangles, (std::vector<glm::uvec3>{{0, 1, 2}, {5, 6, 7}}));
    EXPECT_EQ(body->shapeCount, 10);
    EXPECT_EQ(body->expressionCount, 10);
    EXPECT_TRUE(body->poseDirs.empty()); // all zero
    EXPECT_EQ(body->parents[0], -1);
    EXPECT_EQ(body->jointNames[15], "head");
    EXPECT_EQ(body->handMeanLeft, std::vector<float>(45, 0.0f));
    EXPECT_TRUE(body->handComponentsLeft.empty());
    // Direction k moves the axis k % 3 by k + 1: shape 1 is y by 2, expression 0 (direction 10) is y by 11.
    const std::vector<glm::vec3> moved = shapedVertices(*body, {{0.0f, 1.0f}, {0.5f}});
    for (std::size_t v = 0; v < 8; ++v) {
        EXPECT_EQ(moved[v], body->templateVertices[v] + glm::vec3(0.0f, 2.0f + 5.5f, 0.0f));
    }
}

TEST(BodyModel, ShapeDirectionsAreSplitByTheirNumber) {
    struct Case {
        std::size_t width;
        int shapes, expressions;
    };
    for (const Case& c : {Case{400, 300, 100}, Case{450, 300, 100}, Case{20, 10, 10}, Case{310, 10, 10},
                          Case{16, 10, 6}, Case{10, 10, 0}, Case{4, 4, 0}, Case{0, 0, 0}}) {
        NpzFile file = cubeArrays();
        file.arrays["shapedirs"] = shapesOfWidth(c.width);
        const auto body = bodyModelFromArrays(file);
        ASSERT_TRUE(body.ok()) << c.width << ": " << body.error().describe();
        EXPECT_EQ(body->shapeCount, c.shapes) << c.width;
        EXPECT_EQ(body->expressionCount, c.expressions) << c.width;
        EXPECT_EQ(body->expressionDirs.empty(), c.expressions == 0);
        EXPECT_TRUE(c.expressions == 0 || body->expressionDirs[0] == static_cast<float>(c.shapes)) << c.width;
        EXPECT_EQ(shapedVertices(*body, {std::vector<float>(500, 0.0f), {}}), body->templateVertices);
    }
}

TEST(BodyModel, NumbersOfOtherTypesGiveTheSameBody) {
    NpzFile file = cubeArrays();
    for (const char* key : {"v_template", "weights", "J_regressor", "shapedirs"}) {
        const Array& array = file.arrays.at(key);
        file.arrays[key] = Array::fromDoubles(array.shape, *array.toDouble());
    }
    // An unsigned tree: -1 wraps to 2^32-1.
    const std::vector<std::int64_t> tree = *file.arrays.at("kintree_table").toInt64();
    std::vector<std::uint32_t> wrapped(tree.begin(), tree.end());
    Array table;
    table.dtype = DType::U32;
    table.shape = {2, 55};
    table.bytes.assign(reinterpret_cast<const std::byte*>(wrapped.data()),
                       reinterpret_cast<const std::byte*>(wrapped.data() + wrapped.size()));
    file.arrays["kintree_table"] = table;
    const auto one = bodyModelFromArrays(cubeArrays()), two = bodyModelFromArrays(file);
    ASSERT_TRUE(one.ok() && two.ok());
    EXPECT_EQ(one->templateVertices, two->templateVertices);
    EXPECT_EQ(one->parents, two->parents);
    EXPECT_EQ(one->weights.weights, two->weights.weights);
    EXPECT_EQ(one->jointRegressor, two->jointRegressor);
    EXPECT_EQ(one->shapeDirs, two->shapeDirs);
}

TEST(BodyModel, MissingKeysAreNamed) {
    for (const char* key : {"v_template", "f", "weights", "J_regressor", "kintree_table", "shapedirs"}) {
        NpzFile file = cubeArrays();
        file.arrays.erase(key);
        expectMessage(file, {key});
    }
    NpzFile file = cubeArrays();
    file.arrays.erase("posedirs");
    EXPECT_TRUE(bodyModelFromArrays(file).ok());
}

TEST(BodyModel, WrongShapesAreNamedWithWhatWasExpected) {
    NpzFile file = cubeArrays();
    file.arrays["v_template"] = Array::fromFloats({12, 2}, std::vector<float>(24, 0.0f));
    expectMessage(file, {"v_template", "(*, 3)", "(12, 2)"});
    file = cubeArrays();
    file.arrays["v_template"] = Array::fromFloats({0, 3}, {});
    expectMessage(file, {"v_template", "no vertices"});
    file = cubeArrays();
    file.arrays["weights"] = Array::fromFloats({8, 54}, std::vector<float>(8 * 54, 1.0f));
    expectMessage(file, {"weights", "(8, 55)", "(8, 54)"});
    file = cubeArrays();
    file.arrays["posedirs"] = Array::fromFloats({8, 3, 207}, std::vector<float>(8 * 3 * 207, 1.0f));
    expectMessage(file, {"posedirs", "(8, 3, 486)", "(8, 3, 207)"});
    file = cubeArrays();
    file.arrays["J_regressor"] = Array::fromFloats({8, 55}, std::vector<float>(8 * 55, 1.0f));
    expectMessage(file, {"J_regressor", "(55, 8)", "(8, 55)"});
    file = cubeArrays();
    file.arrays["shapedirs"] = Array::fromFloats({24, 20}, std::vector<float>(480, 0.0f));
    expectMessage(file, {"shapedirs", "(24, 20)"});
    file = cubeArrays();
    file.arrays["hands_meanl"] = Array::fromFloats({12}, std::vector<float>(12, 0.0f));
    expectMessage(file, {"hands_meanl", "(45,)", "(12,)"});
    file = cubeArrays();
    file.arrays["f"] = Array::fromTexts({1, 3}, {"a", "b", "c"});
    expectMessage(file, {"f"});
}

TEST(BodyModel, BrokenNumbersAreNamedWithTheirPlace) {
    const float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
    for (const auto& [key, at, place] :
         {std::tuple{"v_template", 7, "v_template[2,1]"}, std::tuple{"shapedirs", 61, "shapedirs[1,0,1]"},
          std::tuple{"posedirs", 487, "posedirs[0,1,1]"}, std::tuple{"J_regressor", 9, "J_regressor[1,1]"},
          std::tuple{"weights", 57, "weights[1,2]"}}) {
        for (const float bad : {nan, infinity, -infinity}) {
            NpzFile file = cubeArrays();
            file.arrays.at(key).as<float>()[static_cast<std::size_t>(at)] = bad;
            expectMessage(file, {place, "expected a finite number"});
        }
    }
    NpzFile file = cubeArrays();
    std::vector<double> huge(24, 0.0);
    huge[5] = 1e300; // finite in the file, not as float
    file.arrays["v_template"] = Array::fromDoubles({8, 3}, huge);
    expectMessage(file, {"v_template"});
}

TEST(BodyModel, IndicesOutsideAreNamed) {
    NpzFile file = cubeArrays();
    file.arrays["f"] = Array::fromInts({2, 3}, std::vector<std::int64_t>{0, 1, 2, 3, 4, 8});
    expectMessage(file, {"f[1,2]", "vertex 8", "0 to 7"});
    file.arrays["f"] = Array::fromInts({2, 3}, std::vector<std::int64_t>{0, -1, 2, 3, 4, 5});
    expectMessage(file, {"f[0,1]", "vertex -1"});
    file.arrays["f"] = Array::fromInts({2, 3}, std::vector<std::int64_t>{0, 1, 2, std::int64_t{1} << 33, 4, 5});
    expectMessage(file, {"f[1,0]", "8589934592"});
    file = cubeArrays();
    std::fill_n(file.arrays.at("weights").as<float>().begin() + 55 * 3, 55, 0.0f);
    expectMessage(file, {"weights row 3", "sum to 0"});
}

TEST(BodyModel, BrokenTreesAreNamed) {
    const auto withParent = [](std::size_t joint, std::int64_t parent) {
        NpzFile file = cubeArrays();
        std::vector<std::int64_t> tree = *file.arrays.at("kintree_table").toInt64();
        tree[joint] = parent;
        file.arrays["kintree_table"] = Array::fromInts({2, 55}, tree);
        return file;
    };
    expectMessage(withParent(4, 7), {"kintree_table", "left_knee", "cycle", "left_ankle"}); // 7's parent is 4
    expectMessage(withParent(9, 9), {"kintree_table", "spine3", "cycle through itself"});
    expectMessage(withParent(5, 20), {"kintree_table", "right_knee", "comes after it"});
    expectMessage(withParent(30, 55), {"kintree_table[0,30]", "55"});
    expectMessage(withParent(30, -1), {"kintree_table[0,30]", "-1"});
    expectMessage(withParent(30, 4294967295), {"kintree_table[0,30]"});
    EXPECT_TRUE(bodyModelFromArrays(withParent(0, 12345)).ok()); // nothing reads the root's parent
}

TEST(BodyModel, OtherBodiesAreTold) {
    NpzFile file = cubeArrays();
    file.arrays["kintree_table"] = Array::fromInts({2, 24}, std::vector<std::int64_t>(48, 0));
    expectMessage(file, {"24 joints: this is a SMPL body, expected SMPL-X with 55"});
    file.arrays["kintree_table"] = Array::fromInts({2, 52}, std::vector<std::int64_t>(104, 0));
    expectMessage(file, {"SMPL+H"});
    file.arrays["kintree_table"] = Array::fromInts({2, 1000}, std::vector<std::int64_t>(2000, 0));
    expectMessage(file, {"kintree_table", "(2, 55)", "(2, 1000)"});
}

TEST(BodyModel, PickledRegressorSaysHowToConvertIt) {
    NpzFile file = cubeArrays();
    file.arrays.erase("J_regressor");
    file.unreadable["J_regressor"] = makeError(ErrorCode::Unsupported, "J_regressor", "an object array (pickle)");
    expectMessage(file, {"J_regressor", "object array", "todense", "python3 -c"});
    // Keys that nothing reads may be unreadable.
    NpzFile other = cubeArrays();
    other.unreadable["part2num"] = makeError(ErrorCode::Unsupported, "part2num", "an object array (pickle)");
    EXPECT_TRUE(bodyModelFromArrays(other).ok());
}

// ---------------------------------------------------------------------------------------------- the smplx package

struct Answers {
    NpzFile file;

    std::span<const float> row(const std::string& key, std::size_t frame) const {
        const Array& array = file.arrays.at(key);
        const std::size_t width = array.count() / array.shape[0];
        return array.as<float>().subspan(frame * width, width);
    }
    std::size_t frames() const { return file.arrays.at("poses").shape[0]; }
};

/// Pose and shape of one frame; hand means are added to the axis-angle numbers as smplx does.
std::pair<Pose, BodyShape> inputs(const Answers& answers, std::size_t frame, const BodyModel& body, bool addHandMeans) {
    const std::span<const float> stored = answers.row("poses", frame);
    std::vector<float> numbers(stored.begin(), stored.end());
    for (std::size_t i = 0; addHandMeans && i < 45; ++i) {
        numbers[75 + i] += body.handMeanLeft[i];
        numbers[120 + i] += body.handMeanRight[i];
    }
    Pose pose = restPose(55);
    for (std::size_t j = 0; j < 55; ++j) {
        pose.rotations[j] = quatFromAxisAngle({numbers[3 * j], numbers[3 * j + 1], numbers[3 * j + 2]});
    }
    const std::span<const float> transl = answers.row("transl", frame);
    pose.translation = {transl[0], transl[1], transl[2]};
    const std::span<const float> betas = answers.row("betas", frame), expression = answers.row("expression", frame);
    pose.expression.assign(expression.begin(), expression.end());
    return {pose, BodyShape{{betas.begin(), betas.end()}, {}}};
}

double largestDifference(std::span<const glm::vec3> found, std::span<const float> expected) {
    EXPECT_EQ(found.size() * 3, expected.size());
    double worst = 0.0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        for (std::size_t c = 0; c < 3; ++c) {
            worst = std::max(worst, std::fabs(double(found[i][static_cast<int>(c)]) - double(expected[3 * i + c])));
        }
    }
    return worst;
}

struct Worst {
    double vertices = 0.0, joints = 0.0;
};

/// Largest difference over all frames at the given vertices.
Worst compareWithSmplx(const BodyModel& body, const Answers& answers, const std::string& name,
                       const std::vector<std::size_t>& vertices, bool addHandMeans) {
    Worst worst;
    for (std::size_t frame = 0; frame < answers.frames(); ++frame) {
        const auto [pose, shape] = inputs(answers, frame, body, addHandMeans);
        std::vector<glm::vec3> joints, chosen;
        const std::vector<glm::vec3> all = posedVertices(body, shape, pose, &joints);
        for (const std::size_t v : vertices) chosen.push_back(all[v]);
        worst.vertices = std::max(worst.vertices, largestDifference(chosen, answers.row(name + "_vertices", frame)));
        worst.joints = std::max(worst.joints, largestDifference(joints, answers.row(name + "_joints", frame)));
    }
    std::printf("%s: %zu poses, largest difference %.2e m at vertices, %.2e m at joints\n", name.c_str(),
                answers.frames(), worst.vertices, worst.joints);
    return worst;
}

// smplx_compare.py made both files; 1e-5 m is the project's bound, single precision alone stays near 1e-6.
TEST(SmplxParity, GeneratedBodyOverFiftyPoses) {
    auto body = readBodyModel(fixture("generated_smplx.npz"));
    ASSERT_TRUE(body.ok()) << body.error().describe();
    EXPECT_EQ(body->poseDirs.size(), body->vertexCount() * 3 * 486);
    auto file = readNpz(fixture("smplx_answers.npz"));
    ASSERT_TRUE(file.ok()) << file.error().describe();
    const Answers answers{std::move(*file)};
    ASSERT_GE(answers.frames(), 50u);
    std::vector<std::size_t> everySecond;
    for (std::size_t v = 0; v < body->vertexCount(); v += 2) everySecond.push_back(v);
    for (const bool means : {false, true}) {
        const Worst worst =
            compareWithSmplx(*body, answers, means ? "generated_mean" : "generated_flat", everySecond, means);
        EXPECT_LT(worst.vertices, 1e-5);
        EXPECT_LT(worst.joints, 1e-5);
    }
}

TEST(SmplxParity, OpenBodyOverFiftyPoses) {
    auto body = readOpenBody();
    ASSERT_TRUE(body.ok()) << body.error().describe();
    auto file = readNpz(fixture("smplx_answers.npz"));
    ASSERT_TRUE(file.ok()) << file.error().describe();
    const Answers answers{std::move(*file)};
    const std::vector<std::int64_t> indices = *answers.file.arrays.at("open_indices").toInt64();
    const Worst worst =
        compareWithSmplx(*body, answers, "open", std::vector<std::size_t>(indices.begin(), indices.end()), false);
    EXPECT_LT(worst.vertices, 1e-5);
    EXPECT_LT(worst.joints, 1e-5);
}

TEST(SmplxParity, PoseBlendShapesCanBeSwitchedOff) {
    auto body = readBodyModel(fixture("generated_smplx.npz"));
    ASSERT_TRUE(body.ok()) << body.error().describe();
    Pose pose = restPose(55);
    pose.rotations[18] = quatFromAxisAngle({0, 0, 1});
    BodyModel without = *body;
    without.poseDirs.clear();
    EXPECT_EQ(posedVertices(*body, {}, pose, nullptr, false), posedVertices(without, {}, pose));
    EXPECT_NE(posedVertices(*body, {}, pose, nullptr, true), posedVertices(without, {}, pose));
}

// ---------------------------------------------------------------------------------------------- the open body

TEST(OpenBody, RestPoseIsTheTemplateAndRigidMotionsMoveItRigidly) {
    const auto body = readOpenBody();
    ASSERT_TRUE(body.ok()) << body.error().describe();
    std::vector<glm::vec3> joints;
    const std::vector<glm::vec3> rest = posedVertices(*body, {}, restPose(55), &joints);
    double worst = 0.0;
    for (std::size_t v = 0; v < rest.size(); ++v) {
        worst = std::max(worst, double(glm::distance(rest[v], body->templateVertices[v])));
    }
    EXPECT_LT(worst, 1e-6);
    Pose turned = restPose(55);
    turned.rotations[0] = quatFromAxisAngle({0.4f, -2.0f, 0.9f});
    turned.translation = {1, 2, 3};
    const std::vector<glm::vec3> moved = posedVertices(*body, {}, turned);
    worst = 0.0;
    for (std::size_t v = 0; v < rest.size(); ++v) {
        const glm::vec3 expected = turned.rotations[0] * (rest[v] - joints[0]) + joints[0] + turned.translation;
        worst = std::max(worst, double(glm::distance(moved[v], expected)));
    }
    EXPECT_LT(worst, 2e-6);
}

TEST(OpenBody, StandsUprightWithItsLeftAtPlusX) {
    const auto body = readOpenBody();
    ASSERT_TRUE(body.ok()) << body.error().describe();
    EXPECT_EQ(body->vertexCount(), 13380u);
    EXPECT_EQ(body->triangles.size(), 26756u);
    const Skeleton skeleton = bodySkeleton(*body, {});
    EXPECT_TRUE(validateSkeleton(skeleton).ok());
    const auto at = [&](const char* name) {
        return skeleton.restPositions[static_cast<std::size_t>(skeleton.find(name))];
    };
    EXPECT_GT(at("left_wrist").x, 0.5f);
    EXPECT_LT(at("right_wrist").x, -0.5f);
    EXPECT_GT(at("head").y, at("pelvis").y + 0.4f);
    EXPECT_GT(at("left_foot").z, at("left_ankle").z + 0.05f);               // toes point to the front
    for (const char* name : {"left_elbow", "left_wrist", "left_middle1"}) { // arms along x: a T-pose
        EXPECT_NEAR(at(name).y, at("left_shoulder").y, 0.02f) << name;
    }
    float low = 1e9f, high = -1e9f;
    for (const glm::vec3& v : body->templateVertices) {
        low = std::min(low, v.y);
        high = std::max(high, v.y);
    }
    EXPECT_NEAR(high - low, 1.748f, 0.001f);
}

TEST(OpenBody, IsItsOwnMirrorImage) {
    const auto body = readOpenBody();
    ASSERT_TRUE(body.ok()) << body.error().describe();
    const Skeleton skeleton = bodySkeleton(*body, {});
    for (int j = 0; j < 55; ++j) {
        const std::string name(smplxJointName(j));
        if (name.rfind("left_", 0) != 0) continue;
        const glm::vec3 left = skeleton.restPositions[static_cast<std::size_t>(j)];
        const glm::vec3 right =
            skeleton.restPositions[static_cast<std::size_t>(skeleton.find("right_" + name.substr(5)))];
        EXPECT_LT(glm::distance(left, right * glm::vec3(-1, 1, 1)), 1e-5f) << name;
    }
}

TEST(OpenBody, WeightRowsSumToOneAndEveryJointMovesSomething) {
    const auto body = readOpenBody();
    ASSERT_TRUE(body.ok()) << body.error().describe();
    std::vector<double> perJoint(55, 0.0);
    for (std::size_t v = 0; v < body->vertexCount(); ++v) {
        double sum = 0.0;
        for (std::size_t k = 0; k < kMaxInfluences; ++k) {
            sum += body->weights.weights[v * kMaxInfluences + k];
            perJoint[body->weights.joints[v * kMaxInfluences + k]] += body->weights.weights[v * kMaxInfluences + k];
        }
        EXPECT_NEAR(sum, 1.0, 1e-6);
    }
    for (std::size_t j = 0; j < 55; ++j) EXPECT_GT(perJoint[j], 0.5) << body->jointNames[j];
}

TEST(OpenBody, ShapeAndExpressionComponentsDoWhatTheyAreCalled) {
    const auto body = readOpenBody();
    ASSERT_TRUE(body.ok()) << body.error().describe();
    ASSERT_EQ(body->shapeNames.size(), 10u);
    ASSERT_EQ(body->expressionNames.size(), 10u);
    const auto height = [](const std::vector<glm::vec3>& vertices) {
        const auto [low, high] = std::minmax_element(vertices.begin(), vertices.end(),
                                                     [](const glm::vec3& a, const glm::vec3& b) { return a.y < b.y; });
        return high->y - low->y;
    };
    EXPECT_EQ(body->shapeNames[0], "height +5 cm");
    EXPECT_NEAR(height(shapedVertices(*body, {{1.0f}, {}})) - height(body->templateVertices), 0.05f, 1e-4f);
    for (std::size_t k = 0; k < 10; ++k) {
        std::vector<float> psi(10, 0.0f);
        psi[k] = 1.0f;
        const std::vector<glm::vec3> moved = shapedVertices(*body, {{}, psi});
        float most = 0.0f, below = 0.0f;
        for (std::size_t v = 0; v < moved.size(); ++v) {
            const float d = glm::distance(moved[v], body->templateVertices[v]);
            most = std::max(most, d);
            if (body->templateVertices[v].y < 0.45f) below = std::max(below, d); // under the collar bones
        }
        EXPECT_GT(most, 0.003f) << body->expressionNames[k];
        EXPECT_LT(most, 0.05f) << body->expressionNames[k];
        EXPECT_LT(below, 1e-3f) << body->expressionNames[k];
    }
}

TEST(OpenBody, EqualsTheReferenceBodyOfTheTestData) {
    ARS_TEST_DATA_FILE(path, "open_body.npz");
    const auto ours = readOpenBody(), theirs = readBodyModel(path);
    ASSERT_TRUE(ours.ok() && theirs.ok());
    EXPECT_EQ(ours->triangles, theirs->triangles);
    ASSERT_EQ(ours->vertexCount(), theirs->vertexCount());
    float worst = 0.0f;
    for (std::size_t v = 0; v < ours->vertexCount(); ++v) {
        worst = std::max(worst, glm::distance(ours->templateVertices[v], theirs->templateVertices[v]));
    }
    // MPFB2's targets and weights are MakeHuman's with small repairs.
    EXPECT_LT(worst, 2e-4f);
    const Skeleton a = bodySkeleton(*ours, {}), b = bodySkeleton(*theirs, {});
    for (std::size_t j = 0; j < 55; ++j) EXPECT_LT(glm::distance(a.restPositions[j], b.restPositions[j]), 1e-4f);
}

TEST(OpenBody, TruncatedFileIsRefusedAtEverySixteenth) {
    const auto folder = resourceFolder();
    ASSERT_TRUE(folder.ok());
    const auto bytes = readFile(*folder / "bodies" / "open_body.npz");
    ASSERT_TRUE(bytes.ok());
    test::TemporaryFolder temporary;
    for (std::size_t i = 0; i < 16; ++i) {
        const std::filesystem::path path = temporary / "short.npz";
        ASSERT_TRUE(writeFileAtomic(path, std::span(*bytes).first(bytes->size() * i / 16)).ok());
        const auto body = readBodyModel(path);
        ASSERT_FALSE(body.ok()) << i;
        EXPECT_NE(body.error().describe().find("short.npz"), std::string::npos) << body.error().describe();
    }
    EXPECT_EQ(readBodyModel(temporary / "none.npz").error().code, ErrorCode::NotFound);
}

} // namespace
} // namespace ars
