#pragma once

#include "engine/core/buffer.h"
#include "engine/core/error.h"

#include <memory>
#include <optional>
#include <string>

namespace ars {

/// An OpenGL context and what it runs on.
struct GlContextInfo {
    std::string platform; ///< "EGL device 0", "EGL surfaceless", "GLFW X11"
    std::string vendor;
    std::string renderer;          ///< "llvmpipe (LLVM 15.0.6, 256 bits)", "NVIDIA H200/PCIe/SSE2"
    std::string version;           ///< "4.5 (Core Profile) Mesa 22.3.6"
    bool software = false;         ///< drawn by the processor
    std::optional<int> cudaDevice; ///< ordinal of the CUDA device that it shares a card with, where the driver says
    std::string chosen;            ///< one sentence for the log: what was chosen and what was passed over, and why
};

/// An OpenGL 4.5 core context, of a window or of none. One thread at a time may have it current.
class GlContext {
public:
    virtual ~GlContext() = default;
    virtual Status makeCurrent() = 0;
    const GlContextInfo& info() const { return info_; }

protected:
    /// Fills in what OpenGL says of the current context.
    void describe(std::string platform);
    GlContextInfo info_;
};

/// A context without window and without X.
class HeadlessContext : public GlContext {
public:
    /// Tries the devices that EGL enumerates: the one that is the CUDA device `match` first, then hardware before
    /// software, then Mesa's surfaceless platform; makes the first that gives OpenGL 4.5 current. Unavailable lists
    /// what was tried and why each refused.
    static Result<std::unique_ptr<HeadlessContext>> create(const Device& match = {});
    ~HeadlessContext() override;
    HeadlessContext(const HeadlessContext&) = delete;
    HeadlessContext& operator=(const HeadlessContext&) = delete;

    Status makeCurrent() override;

private:
    HeadlessContext() = default;
    void* display_ = nullptr;
    void* context_ = nullptr;
};

} // namespace ars
