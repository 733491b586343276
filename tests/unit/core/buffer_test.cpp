#include "engine/core/buffer.h"

#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <numeric>

namespace ars {
namespace {

const MemoryUse* findUse(const std::vector<MemoryUse>& uses, std::string_view owner) {
    for (const MemoryUse& use : uses) {
        if (use.owner == owner) return &use;
    }
    return nullptr;
}

TEST(Buffer, KnowsItsSizeAndOwnerAndTheBookFollows) {
    {
        auto first = Buffer::allocate({}, 1000, "test: first");
        auto second = Buffer::allocate({}, 500, "test: first");
        ASSERT_TRUE(first.ok() && second.ok());
        EXPECT_EQ(reinterpret_cast<std::uintptr_t>(first->data()) % 64, 0u);
        EXPECT_EQ(first->bytes(), 1000u);
        EXPECT_EQ(first->as<float>().size(), 250u);
        const Buffer moved = std::move(*second);
        const auto uses = memoryUse();
        ASSERT_NE(findUse(uses, "test: first"), nullptr);
        EXPECT_EQ(findUse(uses, "test: first")->bytes, 1500u);
        EXPECT_EQ(findUse(uses, "test: first")->buffers, 2u);
    }
    EXPECT_EQ(findUse(memoryUse(), "test: first")->bytes, 0u);
    EXPECT_EQ(findUse(memoryUse(), "test: first")->peakBytes, 1500u);
}

TEST(Buffer, OutOfMemoryNamesWhoAskedForHowMuch) {
    const auto buffer = Buffer::allocate({}, 1ull << 50, "splat: contributor lists");
    ASSERT_FALSE(buffer.ok());
    EXPECT_EQ(buffer.error().code, ErrorCode::OutOfMemory);
    const std::string text = buffer.error().describe();
    EXPECT_TRUE(text.starts_with("splat: contributor lists: needs 1024 TiB on cpu, ")) << text;
    EXPECT_TRUE(text.ends_with(" free")) << text;
    EXPECT_FALSE(Buffer::allocate({}, ~std::size_t{0}, "all").ok());
}

TEST(Buffer, BytesSurviveTheWayThroughEveryDevice) {
    std::string ran;
    for (const Device& device : availableDevices()) {
        ran += " " + deviceName(device);
        std::vector<std::uint32_t> numbers(10'000);
        std::iota(numbers.begin(), numbers.end(), 7u);
        auto there = Buffer::allocate(device, numbers.size() * 4, "test: round trip");
        auto other = Buffer::allocate(device, numbers.size() * 4, "test: round trip");
        ASSERT_TRUE(there.ok() && other.ok());
        ASSERT_TRUE(uploadBuffer(*there, std::as_bytes(std::span(numbers))).ok());
        ASSERT_TRUE(copyBuffer(*other, *there, there->bytes()).ok());
        std::vector<std::uint32_t> back(numbers.size());
        ASSERT_TRUE(downloadBuffer(std::as_writable_bytes(std::span(back)), *other).ok());
        EXPECT_EQ(back, numbers);
        EXPECT_FALSE(copyBuffer(*other, *there, there->bytes() + 1).ok());
        EXPECT_GT(deviceMemory(device)->totalBytes, deviceMemory(device)->freeBytes / 2);
    }
    std::printf("devices:%s\n", ran.c_str());
    if (availableDevices().size() == 1) test::notRun("the CUDA part needs a CUDA device");
}

TEST(Buffer, DevicesAreParsedOrRefusedWithAReason) {
    EXPECT_EQ(parseDevice("cpu").value(), Device{});
    EXPECT_EQ(parseDevice("gpu").error().describe(), "device: expected cpu, cuda or cuda:N, found \"gpu\"");
    EXPECT_FALSE(parseDevice("cuda:x").ok());
    EXPECT_EQ(parseDevice("cuda:99").error().code, ErrorCode::Unavailable);
}

TEST(Buffer, SizesReadWell) {
    EXPECT_EQ(formatBytes(512), "512 bytes");
    EXPECT_EQ(formatBytes(2'040'109'466), "1.9 GiB");
    EXPECT_EQ(formatBytes(222'298'112), "212 MiB");
}

} // namespace
} // namespace ars
