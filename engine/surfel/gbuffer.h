#pragma once

#include "engine/core/image_view.h"

#include <array>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string_view>

namespace ars {

/// What splatting can write. Opacity is always written. All but opacity are divided by it where it exceeds
/// kMinOpacity and are 0 elsewhere; Normal and Bone are camera space and of unit length there.
enum class Channel : std::uint8_t {
    Opacity,     ///< 1: 1 - T
    Depth,       ///< 1: camera z, metres
    Normal,      ///< 3: camera space, faces the camera (z < 0)
    Position,    ///< 3: world space, metres; the camera ray at Depth
    Radiance,    ///< 3: sRGB-encoded
    Albedo,      ///< 3: linear
    Roughness,   ///< 1
    Radius,      ///< 1: metres
    RadiusPlus,  ///< 1: metres
    RadiusMinus, ///< 1: metres
    Importance,  ///< 1: [0, 1]
    Bone,        ///< 3: camera space
};
inline constexpr int kChannelCount = 12;
/// Below this opacity a pixel is empty: every other channel is 0 there.
inline constexpr float kMinOpacity = 1e-3f;

/// Layer name in EXR files ("radius_plus") and floats per pixel of a channel.
std::string_view channelName(Channel channel);
int channelWidth(Channel channel);
/// By layer name.
std::optional<Channel> channelFromName(std::string_view name);

/// A set of channels.
class ChannelSet {
public:
    constexpr ChannelSet() = default;
    constexpr ChannelSet(std::initializer_list<Channel> channels) {
        for (const Channel channel : channels) add(channel);
    }
    constexpr void add(Channel channel) {
        bits_ = static_cast<std::uint16_t>(bits_ | (1u << static_cast<unsigned>(channel)));
    }
    constexpr void remove(Channel channel) {
        bits_ = static_cast<std::uint16_t>(bits_ & ~(1u << static_cast<unsigned>(channel)));
    }
    constexpr bool has(Channel channel) const { return (bits_ >> static_cast<unsigned>(channel)) & 1u; }
    constexpr bool includes(const ChannelSet& other) const { return (bits_ & other.bits_) == other.bits_; }
    constexpr ChannelSet united(const ChannelSet& other) const {
        ChannelSet result;
        result.bits_ = static_cast<std::uint16_t>(bits_ | other.bits_);
        return result;
    }
    constexpr bool operator==(const ChannelSet&) const = default;

private:
    std::uint16_t bits_ = 0;
};

/// All that a viewer looks at: everything but R+ and R-.
inline constexpr ChannelSet kViewingChannels{
    Channel::Opacity, Channel::Depth,     Channel::Normal, Channel::Position,   Channel::Radiance,
    Channel::Albedo,  Channel::Roughness, Channel::Radius, Channel::Importance, Channel::Bone};

/// The pictures that splatting wrote, all of one size on one device. Absent channels are empty.
struct GBuffer {
    std::array<PixelBuffer, kChannelCount> pictures;
    ChannelSet channels;

    PixelBuffer& operator[](Channel channel) { return pictures[static_cast<std::size_t>(channel)]; }
    const PixelBuffer& operator[](Channel channel) const { return pictures[static_cast<std::size_t>(channel)]; }
    int width() const { return (*this)[Channel::Opacity].width(); }
    int height() const { return (*this)[Channel::Opacity].height(); }
};

} // namespace ars
