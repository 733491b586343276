#include "engine/core/buffer.h"

#if ARS_HAVE_CUDA
#include "engine/core/buffer_cuda.h"
#endif

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <mutex>

namespace ars {
namespace {

constexpr std::size_t kHostAlignment = 64;

/// The book of who holds what, for the memory panel and for out-of-memory messages.
struct MemoryBook {
    std::mutex mutex;
    std::map<std::pair<std::string, std::pair<int, int>>, MemoryUse> uses;

    MemoryUse& entry(const Device& device, const std::string& owner) {
        MemoryUse& use = uses[{owner, {static_cast<int>(device.kind), device.index}}];
        use.owner = owner;
        use.device = device;
        return use;
    }
};

// Never destroyed: buffers of static objects may outlive it.
MemoryBook& book() {
    static auto* instance = new MemoryBook;
    return *instance;
}

Result<void*> allocateOn(const Device& device, std::size_t bytes) {
    if (device.kind == DeviceKind::Cuda) {
#if ARS_HAVE_CUDA
        return cuda::allocate(device.index, bytes);
#else
        return makeError(ErrorCode::Unavailable, deviceName(device), "this build has no CUDA");
#endif
    }
    const std::size_t rounded = (bytes + kHostAlignment - 1) / kHostAlignment * kHostAlignment;
    // Linux promises more memory than it has and then ends the program; asking first gives a sentence instead.
    if (const auto memory = deviceMemory(device); memory && rounded > memory->freeBytes) {
        return makeError(ErrorCode::OutOfMemory, "", "host memory");
    }
    void* data = rounded < bytes ? nullptr : std::aligned_alloc(kHostAlignment, rounded);
    if (!data) return makeError(ErrorCode::OutOfMemory, "", "host memory");
    return data;
}

} // namespace

std::string deviceName(const Device& device) {
    return device.kind == DeviceKind::Host ? std::string("cpu") : fmt::format("cuda:{}", device.index);
}

Result<Device> parseDevice(std::string_view text) {
    if (text == "cpu") return Device{};
    int index = 0;
    if (text.starts_with("cuda:")) {
        const std::string_view digits = text.substr(5);
        const auto [end, failure] = std::from_chars(digits.data(), digits.data() + digits.size(), index);
        if (failure != std::errc() || end != digits.data() + digits.size() || index < 0) index = -1;
    } else if (text != "cuda") {
        index = -1;
    }
    if (index < 0) {
        return makeError(ErrorCode::InvalidArgument, "device",
                         fmt::format("expected cpu, cuda or cuda:N, found \"{}\"", text));
    }
    const Device wanted{DeviceKind::Cuda, index};
    const std::vector<Device> devices = availableDevices();
    if (std::find(devices.begin(), devices.end(), wanted) == devices.end()) {
        return makeError(ErrorCode::Unavailable, deviceName(wanted),
                         fmt::format("there is no such device here ({} CUDA devices answer)", devices.size() - 1));
    }
    return wanted;
}

std::vector<Device> availableDevices() {
    std::vector<Device> devices{Device{}};
#if ARS_HAVE_CUDA
    for (int i = 0; i < cuda::deviceCount(); ++i) devices.push_back({DeviceKind::Cuda, i});
#endif
    return devices;
}

Result<Buffer> Buffer::allocate(const Device& device, std::size_t bytes, std::string_view owner) {
    Buffer buffer;
    buffer.device_ = device;
    buffer.owner_ = owner;
    if (bytes > 0) {
        Result<void*> data = allocateOn(device, bytes);
        if (!data && data.error().code == ErrorCode::OutOfMemory) {
            const Result<MemoryInfo> memory = deviceMemory(device);
            return makeError(ErrorCode::OutOfMemory, std::string(owner),
                             fmt::format("needs {} on {}, {} free", formatBytes(bytes), deviceName(device),
                                         memory ? formatBytes(memory->freeBytes) : "an unknown amount is"));
        }
        if (!data) return atPlace(std::move(data).error(), owner);
        buffer.data_ = *data;
        buffer.bytes_ = bytes;
    }
    MemoryBook& memoryBook = book();
    const std::lock_guard lock(memoryBook.mutex);
    MemoryUse& use = memoryBook.entry(device, buffer.owner_);
    use.bytes += buffer.bytes_;
    use.peakBytes = std::max(use.peakBytes, use.bytes);
    use.buffers += buffer.data_ ? 1 : 0;
    return buffer;
}

Buffer::Buffer(Buffer&& other) noexcept { *this = std::move(other); }

Buffer& Buffer::operator=(Buffer&& other) noexcept {
    if (this != &other) {
        release();
        data_ = std::exchange(other.data_, nullptr);
        bytes_ = std::exchange(other.bytes_, 0);
        device_ = other.device_;
        owner_ = std::move(other.owner_);
    }
    return *this;
}

Buffer::~Buffer() { release(); }

void Buffer::release() noexcept {
    if (!data_) return;
    if (device_.kind == DeviceKind::Host) {
        std::free(data_);
    } else {
#if ARS_HAVE_CUDA
        cuda::release(device_.index, data_);
#endif
    }
    MemoryBook& memoryBook = book();
    const std::lock_guard lock(memoryBook.mutex);
    MemoryUse& use = memoryBook.entry(device_, owner_);
    use.bytes -= bytes_;
    use.buffers -= 1;
    data_ = nullptr;
    bytes_ = 0;
}

Status copyBuffer(Buffer& destination, const Buffer& source, std::size_t bytes) {
    if (bytes > source.bytes() || bytes > destination.bytes()) {
        return makeError(ErrorCode::InvalidArgument, destination.owner(),
                         fmt::format("cannot copy {} from a buffer of {} into one of {}", formatBytes(bytes),
                                     formatBytes(source.bytes()), formatBytes(destination.bytes())));
    }
    if (bytes == 0) return {};
    if (destination.device().kind == DeviceKind::Host && source.device().kind == DeviceKind::Host) {
        std::memmove(destination.data(), source.data(), bytes);
        return {};
    }
#if ARS_HAVE_CUDA
    return cuda::copy(destination.data(), destination.device(), source.data(), source.device(), bytes);
#else
    return makeError(ErrorCode::Unavailable, destination.owner(), "this build has no CUDA");
#endif
}

Status uploadBuffer(Buffer& destination, std::span<const std::byte> source) {
    if (source.size() > destination.bytes()) {
        return makeError(ErrorCode::InvalidArgument, destination.owner(),
                         fmt::format("cannot put {} into a buffer of {}", formatBytes(source.size()),
                                     formatBytes(destination.bytes())));
    }
    if (source.empty()) return {};
    if (destination.device().kind == DeviceKind::Host) {
        std::memcpy(destination.data(), source.data(), source.size());
        return {};
    }
#if ARS_HAVE_CUDA
    return cuda::copy(destination.data(), destination.device(), source.data(), Device{}, source.size());
#else
    return makeError(ErrorCode::Unavailable, destination.owner(), "this build has no CUDA");
#endif
}

Status downloadBuffer(std::span<std::byte> destination, const Buffer& source) {
    if (destination.size() > source.bytes()) {
        return makeError(ErrorCode::InvalidArgument, source.owner(),
                         fmt::format("cannot take {} out of a buffer of {}", formatBytes(destination.size()),
                                     formatBytes(source.bytes())));
    }
    if (destination.empty()) return {};
    if (source.device().kind == DeviceKind::Host) {
        std::memcpy(destination.data(), source.data(), destination.size());
        return {};
    }
#if ARS_HAVE_CUDA
    return cuda::copy(destination.data(), Device{}, source.data(), source.device(), destination.size());
#else
    return makeError(ErrorCode::Unavailable, source.owner(), "this build has no CUDA");
#endif
}

std::vector<MemoryUse> memoryUse() {
    std::vector<MemoryUse> result;
    {
        MemoryBook& memoryBook = book();
        const std::lock_guard lock(memoryBook.mutex);
        for (const auto& [key, use] : memoryBook.uses) result.push_back(use);
    }
    std::sort(result.begin(), result.end(), [](const MemoryUse& a, const MemoryUse& b) {
        return a.bytes != b.bytes ? a.bytes > b.bytes : a.owner < b.owner;
    });
    return result;
}

Status waitForDevice(const Device& device) {
    if (device.kind == DeviceKind::Host) return {};
#if ARS_HAVE_CUDA
    return cuda::wait(device.index);
#else
    return makeError(ErrorCode::Unavailable, deviceName(device), "this build has no CUDA");
#endif
}

Result<MemoryInfo> deviceMemory(const Device& device) {
    if (device.kind == DeviceKind::Cuda) {
#if ARS_HAVE_CUDA
        return cuda::memory(device.index);
#else
        return makeError(ErrorCode::Unavailable, deviceName(device), "this build has no CUDA");
#endif
    }
    MemoryInfo info;
    std::ifstream file("/proc/meminfo");
    std::string key, unit;
    std::uint64_t kibibytes = 0;
    while (file >> key >> kibibytes) {
        if (key == "MemTotal:") info.totalBytes = kibibytes << 10;
        if (key == "MemAvailable:") info.freeBytes = kibibytes << 10;
        std::getline(file, unit);
    }
    if (info.totalBytes == 0) return makeError(ErrorCode::Unavailable, "cpu", "/proc/meminfo cannot be read");
    return info;
}

std::string formatBytes(std::uint64_t bytes) {
    constexpr std::array<std::string_view, 5> kUnits{"bytes", "KiB", "MiB", "GiB", "TiB"};
    double value = static_cast<double>(bytes);
    std::size_t unit = 0;
    while (value >= 1024.0 && unit + 1 < kUnits.size()) {
        value /= 1024.0;
        ++unit;
    }
    if (unit == 0) return fmt::format("{} bytes", bytes);
    return value < 10 ? fmt::format("{:.1f} {}", value, kUnits[unit]) : fmt::format("{:.0f} {}", value, kUnits[unit]);
}

} // namespace ars
