#pragma once

#include "engine/io/npz.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <vector>

namespace ars::test {

/// An smpl_params.npz: the left elbow (joint 18) bends about y, the right knee (joint 5) about x, and the body walks
/// along z at 1 m/s, 30 frames a second.
inline void writeWalk(const std::filesystem::path& path, std::size_t frames) {
    std::vector<float> body(frames * 63, 0.0f), transl(frames * 3, 0.0f);
    for (std::size_t f = 0; f < frames; ++f) {
        const float t = static_cast<float>(f) / 30.0f;
        body[f * 63 + 17 * 3 + 1] = -0.8f * std::sin(t) * std::sin(t);
        body[f * 63 + 4 * 3] = 0.6f * std::abs(std::sin(2.0f * t));
        transl[f * 3 + 1] = 0.9f;
        transl[f * 3 + 2] = t;
    }
    const auto zeros = [&](std::size_t rows, std::size_t width) {
        return Array::fromFloats({rows, width}, std::vector<float>(rows * width, 0.0f));
    };
    const Status written = writeNpz(path, {{"betas", zeros(1, 10)},
                                           {"global_orient", zeros(frames, 3)},
                                           {"transl", Array::fromFloats({frames, 3}, transl)},
                                           {"body_pose", Array::fromFloats({frames, 63}, body)},
                                           {"jaw_pose", zeros(frames, 3)},
                                           {"expression", zeros(frames, 10)},
                                           {"left_hand_pose", zeros(frames, 45)},
                                           {"right_hand_pose", zeros(frames, 45)}});
    ASSERT_TRUE(written.ok());
}

/// The floats of one key of an npz.
inline std::vector<float> floatsOf(const std::filesystem::path& path, const char* key) {
    const auto file = readNpz(path);
    if (!file) {
        ADD_FAILURE() << file.error().describe();
        return {};
    }
    const auto array = file->find(key);
    if (!array) {
        ADD_FAILURE() << array.error().describe();
        return {};
    }
    return (*array)->toFloat().value();
}

} // namespace ars::test
