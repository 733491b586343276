#include "model/training/adam.h"

#include "engine/io/safetensors.h"

#include <ATen/ATen.h>
#include <gtest/gtest.h>

namespace ars {
namespace {

at::Tensor leaf() { return at::ones({3}).set_requires_grad(true); }

void push(const at::Tensor& tensor, double gradient) {
    at::Tensor copy = tensor;
    copy.mutable_grad() = at::full({3}, gradient);
}

TEST(Adam, ASteadyGradientMovesByTheRateFromTheFirstStepOn) {
    // Both corrected means are those of the constant: m / sqrt(v) = 1, whatever its size (Kingma and Ba 2015, Sec. 2).
    const at::Tensor x = leaf();
    Adam adam(0.9, 0.999);
    adam.addGroup("a", {{"x", x}});
    adam.setRate("a", 0.125);
    for (int step = 1; step <= 4; ++step) {
        push(x, -40.0);
        ASSERT_TRUE(adam.step().ok());
        EXPECT_NEAR(x[0].item<double>(), 1.0 + 0.125 * step, 1e-5);
    }
}

TEST(Adam, AGroupWithoutGradientsCountsNoStep) {
    const at::Tensor early = leaf(), late = leaf();
    Adam adam(0.9, 0.999);
    adam.addGroup("early", {{"early", early}});
    adam.addGroup("late", {{"late", late}});
    for (const char* group : {"early", "late"}) adam.setRate(group, 0.125);
    for (int step = 0; step < 50; ++step) {
        push(early, 1.0);
        ASSERT_TRUE(adam.step().ok());
    }
    EXPECT_EQ(late[0].item<double>(), 1.0);
    push(late, 7.0);
    ASSERT_TRUE(adam.step().ok());
    EXPECT_NEAR(late[0].item<double>(), 1.0 - 0.125, 1e-5) << "its first step";
}

TEST(Adam, GroupsThatAFileKnowsNothingOfBeginAnew) {
    const at::Tensor x = leaf();
    Adam first(0.9, 0.999);
    first.addGroup("a", {{"x", x}});
    first.setRate("a", 0.125);
    push(x, 1.0);
    ASSERT_TRUE(first.step().ok());
    SafetensorsFile file;
    first.store(file);

    const at::Tensor y = leaf();
    Adam second(0.9, 0.999);
    second.addGroup("a", {{"x", x}});
    second.addGroup("b", {{"y", y}});
    const Status loaded = second.load(file);
    ASSERT_TRUE(loaded.ok()) << loaded.error().describe();
    SafetensorsFile both;
    second.store(both);
    EXPECT_EQ(both.metadata.at("adam.a.steps"), "1");
    EXPECT_EQ(both.tensors.at("adam.x.m").bytes, file.tensors.at("adam.x.m").bytes);
    EXPECT_EQ(both.metadata.at("adam.b.steps"), "0");

    // What is there in part was damaged.
    for (const char* lost : {"adam.y.m", "adam.y.v", "adam.b.steps"}) {
        SafetensorsFile part = both;
        part.tensors.erase(lost);
        part.metadata.erase(lost);
        const Status damaged = second.load(part);
        ASSERT_FALSE(damaged.ok()) << lost;
        EXPECT_EQ(damaged.error().code, ErrorCode::BadFile);
        EXPECT_NE(damaged.error().describe().find(lost), std::string::npos) << damaged.error().describe();
    }
}

} // namespace
} // namespace ars
