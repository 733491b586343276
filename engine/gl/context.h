#pragma once

#include "engine/core/error.h"

#include <memory>
#include <string>

namespace ars {

/// An OpenGL context and what it runs on.
struct GlContextInfo {
    std::string platform; ///< "EGL device 0", "EGL surfaceless"
    std::string vendor;
    std::string renderer;  ///< "llvmpipe (LLVM 15.0.6, 256 bits)", "NVIDIA H200/PCIe/SSE2"
    std::string version;   ///< "4.5 (Core Profile) Mesa 22.3.6"
    bool software = false; ///< drawn by the processor
};

/// An OpenGL 4.5 core context without window and without X. One thread at a time may have it current.
class HeadlessContext {
public:
    /// Tries the devices that EGL enumerates, hardware before software, then Mesa's surfaceless platform, and makes the
    /// first that gives OpenGL 4.5 current. Unavailable lists what was tried and why each refused.
    static Result<std::unique_ptr<HeadlessContext>> create();
    ~HeadlessContext();
    HeadlessContext(const HeadlessContext&) = delete;
    HeadlessContext& operator=(const HeadlessContext&) = delete;

    Status makeCurrent();
    const GlContextInfo& info() const { return info_; }

private:
    HeadlessContext() = default;
    void* display_ = nullptr;
    void* context_ = nullptr;
    GlContextInfo info_;
};

} // namespace ars
