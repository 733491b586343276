#pragma once

#include "engine/core/error.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace ars {

enum class DeviceKind { Host, Cuda };

/// Where memory lies and work runs.
struct Device {
    DeviceKind kind = DeviceKind::Host;
    int index = 0; ///< CUDA ordinal; 0 on the host

    bool operator==(const Device&) const = default;
};

/// "cpu", "cuda:0".
std::string deviceName(const Device& device);
/// "cpu", "cuda", "cuda:1"; InvalidArgument otherwise, Unavailable when there is no such device here.
Result<Device> parseDevice(std::string_view text);
/// The host first, then every CUDA device that answers. Never fails: no driver means host only.
std::vector<Device> availableDevices();

/// Memory of one device that knows its size and its owner.
///
/// The owner ("splat: contributor lists") is what the memory panel lists and what an out-of-memory message names.
/// Contents are uninitialised. Host memory is aligned to 64 bytes. Moves, never copies.
class Buffer {
public:
    Buffer() = default;
    /// OutOfMemory with the owner, the bytes wanted and the bytes free.
    static Result<Buffer> allocate(const Device& device, std::size_t bytes, std::string_view owner);
    Buffer(Buffer&& other) noexcept;
    Buffer& operator=(Buffer&& other) noexcept;
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    ~Buffer();

    void* data() { return data_; }
    const void* data() const { return data_; }
    std::size_t bytes() const { return bytes_; }
    const Device& device() const { return device_; }
    const std::string& owner() const { return owner_; }

    /// The contents as elements; host buffers only.
    template <typename T>
    std::span<T> as() {
        assert(device_.kind == DeviceKind::Host);
        return {static_cast<T*>(data_), bytes_ / sizeof(T)};
    }
    template <typename T>
    std::span<const T> as() const {
        assert(device_.kind == DeviceKind::Host);
        return {static_cast<const T*>(data_), bytes_ / sizeof(T)};
    }

private:
    void release() noexcept;

    void* data_ = nullptr;
    std::size_t bytes_ = 0;
    Device device_;
    std::string owner_;
};

/// Copies `bytes` between any two devices and waits until it is done.
Status copyBuffer(Buffer& destination, const Buffer& source, std::size_t bytes);
/// Host memory to a buffer, and back.
Status uploadBuffer(Buffer& destination, std::span<const std::byte> source);
Status downloadBuffer(std::span<std::byte> destination, const Buffer& source);

/// Waits until everything queued on the device is done; nothing to wait for on the host. Reports what went wrong there.
Status waitForDevice(const Device& device);

/// One owner's share of one device.
struct MemoryUse {
    std::string owner;
    Device device;
    std::uint64_t bytes = 0;     ///< now
    std::uint64_t peakBytes = 0; ///< most at any time
    std::uint64_t buffers = 0;   ///< now
};

/// Everything that Buffers hold, largest first.
std::vector<MemoryUse> memoryUse();

/// Free and total bytes of a device (the host: MemAvailable and MemTotal).
struct MemoryInfo {
    std::uint64_t freeBytes = 0;
    std::uint64_t totalBytes = 0;
};
Result<MemoryInfo> deviceMemory(const Device& device);

/// "1.9 GiB", "212 MB"-style size for messages (binary units).
std::string formatBytes(std::uint64_t bytes);

} // namespace ars
