// Pictures of any device in a texture: the way of copying everywhere, the shared way where a GPU draws and computes.
#include "engine/gl/context.h"
#include "engine/gl/device_texture.h"
#include "engine/gl/opengl.h"

#include "tests/support/devices.h"

#include <gtest/gtest.h>

#include <cstring>
#include <random>

namespace ars {
namespace {

std::vector<float> readBack(const Texture& texture) {
    std::vector<float> values(static_cast<std::size_t>(texture.width()) * static_cast<std::size_t>(texture.height()) *
                              4);
    glGetTextureImage(texture.name(), 0, GL_RGBA, GL_FLOAT, static_cast<GLsizei>(values.size() * sizeof(float)),
                      values.data());
    return values;
}

std::vector<float> randomPicture(int width, int height, int channels) {
    std::mt19937 random(static_cast<unsigned>(width + channels));
    std::uniform_real_distribution<float> number(-5.0f, 5.0f);
    std::vector<float> values(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                              static_cast<std::size_t>(channels));
    for (float& value : values) value = number(random);
    return values;
}

/// A texture reads as R 0 0 1 with one channel, as RGBA with more, the missing alpha 1.
void expectSame(const std::vector<float>& picture, int channels, const std::vector<float>& read) {
    for (std::size_t p = 0; p < read.size() / 4; ++p) {
        for (std::size_t c = 0; c < 4; ++c) {
            const auto count = static_cast<std::size_t>(channels);
            const float expected = c < count ? picture[p * count + c] : c == 3 ? 1.0f : 0.0f;
            ASSERT_EQ(read[4 * p + c], expected) << "pixel " << p << ", channel " << c;
        }
    }
}

TEST(DeviceTexture, ShowsPicturesOfEveryDeviceBitForBit) {
    for (const Device& device : test::devicesUnderTest()) {
        const auto context = HeadlessContext::create(device);
        ASSERT_TRUE(context.ok()) << context.error().describe();
        for (const bool allowInterop : {true, false}) {
            DeviceTexture texture((*context)->info(), allowInterop);
            // Sizes and channels in a row: storage is kept, replaced, kept.
            const struct {
                int width, height, channels;
            } shapes[] = {{33, 17, 1}, {33, 17, 1}, {33, 17, 3}, {64, 48, 4}, {33, 17, 1}};
            for (const auto& shape : shapes) {
                const std::vector<float> picture = randomPicture(shape.width, shape.height, shape.channels);
                auto buffer = PixelBuffer::allocate(device, shape.width, shape.height, shape.channels, "test");
                ASSERT_TRUE(buffer.ok()) << buffer.error().describe();
                ASSERT_TRUE(uploadBuffer(buffer->memory(), std::as_bytes(std::span(picture))).ok());
                const Status shown = texture.show(std::as_const(*buffer).view(), device);
                ASSERT_TRUE(shown.ok()) << shown.error().describe();
                expectSame(picture, shape.channels, readBack(texture.texture()));
            }
            const bool copied = device.kind == DeviceKind::Host || !allowInterop;
            if (copied) {
                EXPECT_EQ(texture.path(), DeviceTexture::Path::Copy);
            }
            if (device.kind == DeviceKind::Cuda && allowInterop) {
                // Whether a card shares its memory with OpenGL is the driver's choice; that it was tried is ours.
                std::printf("%s drawn by %s: %s %s\n", deviceName(device).c_str(), (*context)->info().renderer.c_str(),
                            texture.path() == DeviceTexture::Path::Interop ? "shared" : "copied",
                            texture.note().c_str());
                const bool sameCard = (*context)->info().cudaDevice == device.index;
                EXPECT_EQ(texture.path(), sameCard ? DeviceTexture::Path::Interop : DeviceTexture::Path::Copy);
                EXPECT_EQ(texture.note().empty(), sameCard);
            }
        }
    }
}

TEST(DeviceTexture, RefusesWhatIsNoPicture) {
    const auto context = HeadlessContext::create();
    ASSERT_TRUE(context.ok()) << context.error().describe();
    DeviceTexture texture((*context)->info());
    const float values[8] = {};
    EXPECT_FALSE(texture.show({values, 2, 2, 2}, Device{}).ok()) << "two channels";
    EXPECT_FALSE(texture.show({}, Device{}).ok()) << "nothing";
    EXPECT_EQ(texture.path(), DeviceTexture::Path::None);
}

} // namespace
} // namespace ars
