#include "engine/surfel/gbuffer.h"

namespace ars {

namespace {
struct Row {
    std::string_view name;
    int width;
};
constexpr std::array<Row, kChannelCount> kRows{{
    {"opacity", 1},
    {"depth", 1},
    {"normal", 3},
    {"position", 3},
    {"radiance", 3},
    {"albedo", 3},
    {"roughness", 1},
    {"radius", 1},
    {"radius_plus", 1},
    {"radius_minus", 1},
    {"importance", 1},
    {"bone", 3},
}};
} // namespace

std::string_view channelName(Channel channel) { return kRows[static_cast<std::size_t>(channel)].name; }

int channelWidth(Channel channel) { return kRows[static_cast<std::size_t>(channel)].width; }

std::optional<Channel> channelFromName(std::string_view name) {
    for (std::size_t i = 0; i < kRows.size(); ++i) {
        if (kRows[i].name == name) return static_cast<Channel>(i);
    }
    return std::nullopt;
}

} // namespace ars
