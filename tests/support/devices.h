#pragma once

#include "engine/core/buffer.h"
#include "tests/support/test_data.h"

#include <cstdio>
#include <vector>

namespace ars::test {

/// Every device that a test of an operator runs on, printed once per test; says NOT RUN for CUDA where there is none.
inline std::vector<Device> devicesUnderTest() {
    std::vector<Device> devices = availableDevices();
    bool cuda = false;
    std::printf("devices:");
    for (const Device& device : devices) {
        std::printf(" %s", deviceName(device).c_str());
        cuda = cuda || device.kind == DeviceKind::Cuda;
    }
    std::printf("\n");
    if (!cuda) {
        // Not a matter of test data: a machine without a GPU passes even where data are required.
        const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
        std::printf("NOT RUN: %s.%s on CUDA: no CUDA device\n", info ? info->test_suite_name() : "",
                    info ? info->name() : "");
    }
    std::fflush(stdout);
    return devices;
}

} // namespace ars::test
