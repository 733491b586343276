#pragma once

#include "engine/io/npz.h"
#include "engine/metrics/image_metrics.h"
#include "tests/support/test_data.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace ars::test {

/// What other packages say (metrics_compare.py).
class MetricsAnswers {
public:
    MetricsAnswers() {
        auto file = readNpz(sourceFolder() / "tests/unit/metrics/fixtures/metrics_answers.npz");
        EXPECT_TRUE(file.ok()) << file.error().describe();
        if (file.ok()) file_ = std::move(file).value();
    }

    double number(const std::string& key) const {
        const auto array = file_.find(key);
        EXPECT_TRUE(array.ok()) << key;
        return array.ok() ? array.value()->toDouble().value().front() : 0.0;
    }
    /// (height, width) or (height, width, channels).
    Picture picture(const std::string& key) const {
        const auto array = file_.find(key);
        EXPECT_TRUE(array.ok()) << key;
        if (!array.ok()) return {};
        const Array& a = *array.value();
        return {a.as<float>().data(), static_cast<int>(a.shape[1]), static_cast<int>(a.shape[0]),
                a.shape.size() > 2 ? static_cast<int>(a.shape[2]) : 1};
    }

private:
    NpzFile file_;
};

/// One channel of a picture as a picture of its own.
struct Channel1 {
    std::vector<float> values;
    int width, height;

    Channel1(Picture picture, int channel) : width(picture.width), height(picture.height) {
        for (std::size_t p = 0; p < picture.pixelCount(); ++p) values.push_back(picture.pixel(p)[channel]);
    }
    Picture view() const { return {values.data(), width, height, 1}; }
};

inline double valueOf(const Result<double>& result) {
    EXPECT_TRUE(result.ok()) << result.error().describe();
    return result.ok() ? result.value() : -1e300;
}

inline std::string complaintOf(const Result<double>& result) { return result.ok() ? "" : result.error().describe(); }

} // namespace ars::test
