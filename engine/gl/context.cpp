#include "engine/gl/context.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/gl.h>

#include <algorithm>
#include <string_view>
#include <vector>

namespace ars {
namespace {

struct Candidate {
    std::string name;
    EGLDisplay display = EGL_NO_DISPLAY;
    bool software = false;
    std::optional<int> cudaDevice;
};

template <typename Function>
Function eglFunction(const char* name) {
    return reinterpret_cast<Function>(eglGetProcAddress(name));
}

bool hasExtension(const char* list, std::string_view name) {
    return list && std::string_view(list).find(name) != std::string_view::npos;
}

constexpr EGLint kCudaDeviceAttribute = 0x323A; // EGL_CUDA_DEVICE_NV of EGL_NV_device_cuda

std::optional<int> cudaOrdinal(EGLDeviceEXT device, const char* extensions) {
    const auto queryAttribute = eglFunction<PFNEGLQUERYDEVICEATTRIBEXTPROC>("eglQueryDeviceAttribEXT");
    EGLAttrib ordinal = -1;
    if (!queryAttribute || !hasExtension(extensions, "EGL_NV_device_cuda")) return std::nullopt;
    if (!queryAttribute(device, kCudaDeviceAttribute, &ordinal) || ordinal < 0) return std::nullopt;
    return static_cast<int>(ordinal);
}

/// Every display that needs no X server: the one of the wanted CUDA device, other hardware, software.
std::vector<Candidate> candidates(const Device& match) {
    std::vector<Candidate> result;
    const char* client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
    const auto getDisplay = eglFunction<PFNEGLGETPLATFORMDISPLAYEXTPROC>("eglGetPlatformDisplayEXT");
    const auto queryDevices = eglFunction<PFNEGLQUERYDEVICESEXTPROC>("eglQueryDevicesEXT");
    const auto queryDeviceString = eglFunction<PFNEGLQUERYDEVICESTRINGEXTPROC>("eglQueryDeviceStringEXT");
    if (!getDisplay) return result;
    EGLDeviceEXT devices[32];
    EGLint count = 0;
    if (queryDevices && queryDeviceString && hasExtension(client, "EGL_EXT_platform_device") &&
        queryDevices(32, devices, &count)) {
        for (EGLint i = 0; i < count; ++i) {
            const char* extensions = queryDeviceString(devices[i], EGL_EXTENSIONS);
            result.push_back({fmt::format("EGL device {}", i), getDisplay(EGL_PLATFORM_DEVICE_EXT, devices[i], nullptr),
                              hasExtension(extensions, "EGL_MESA_device_software"),
                              cudaOrdinal(devices[i], extensions)});
        }
        auto rank = [&](const Candidate& candidate) {
            if (match.kind == DeviceKind::Cuda && candidate.cudaDevice == match.index) return 0;
            return candidate.software ? 2 : 1;
        };
        std::stable_sort(result.begin(), result.end(),
                         [&](const Candidate& a, const Candidate& b) { return rank(a) < rank(b); });
    }
    if (hasExtension(client, "EGL_MESA_platform_surfaceless")) {
        result.push_back(
            {"EGL surfaceless", getDisplay(EGL_PLATFORM_SURFACELESS_MESA, nullptr, nullptr), true, std::nullopt});
    }
    return result;
}

Result<EGLContext> openContext(EGLDisplay display) {
    auto refused = [](std::string_view what) {
        return makeError(ErrorCode::Unavailable, "", fmt::format("{} (EGL error 0x{:x})", what, eglGetError()));
    };
    EGLint major = 0, minor = 0;
    if (display == EGL_NO_DISPLAY || !eglInitialize(display, &major, &minor)) return refused("cannot be initialised");
    if (!eglBindAPI(EGL_OPENGL_API)) return refused("has no desktop OpenGL");
    const EGLint configAttributes[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE, EGL_DONT_CARE, EGL_NONE};
    EGLConfig config = nullptr;
    EGLint configs = 0;
    if (!eglChooseConfig(display, configAttributes, &config, 1, &configs) || configs == 0) {
        return refused("has no configuration for OpenGL");
    }
    const EGLint contextAttributes[] = {
        EGL_CONTEXT_MAJOR_VERSION,           4,       EGL_CONTEXT_MINOR_VERSION, 5, EGL_CONTEXT_OPENGL_PROFILE_MASK,
        EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
    const EGLContext context = eglCreateContext(display, config, EGL_NO_CONTEXT, contextAttributes);
    if (context == EGL_NO_CONTEXT) return refused("refuses OpenGL 4.5 core");
    if (!eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
        eglDestroyContext(display, context);
        return refused("cannot be used without a surface");
    }
    return context;
}

std::string glText(GLenum name) {
    const GLubyte* text = glGetString(name);
    return text ? reinterpret_cast<const char*>(text) : "";
}

} // namespace

void GlContext::describe(std::string platform) {
    info_.platform = std::move(platform);
    info_.vendor = glText(GL_VENDOR);
    info_.renderer = glText(GL_RENDERER);
    info_.version = glText(GL_VERSION);
    for (const char* name : {"llvmpipe", "softpipe", "swrast", "SwiftShader"}) {
        if (info_.renderer.find(name) != std::string::npos) info_.software = true;
    }
}

Result<std::unique_ptr<HeadlessContext>> HeadlessContext::create(const Device& match) {
    std::string tried;
    for (const Candidate& candidate : candidates(match)) {
        Result<EGLContext> context = openContext(candidate.display);
        if (!context) {
            tried += fmt::format("{}{}: {}", tried.empty() ? "" : "; ", candidate.name, context.error().message);
            continue;
        }
        std::unique_ptr<HeadlessContext> result(new HeadlessContext);
        result->display_ = candidate.display;
        result->context_ = *context;
        result->info_.software = candidate.software;
        result->info_.cudaDevice = candidate.cudaDevice;
        result->describe(candidate.name);
        result->info_.chosen = fmt::format("{} ({}{}){}{}", candidate.name, result->info_.renderer,
                                           candidate.cudaDevice ? fmt::format(", cuda:{}", *candidate.cudaDevice) : "",
                                           tried.empty() ? "" : "; passed over ", tried);
        return result;
    }
    return makeError(ErrorCode::Unavailable, "OpenGL",
                     tried.empty()
                         ? std::string("EGL offers no display; install libegl1, libegl-mesa0 and libgl1-mesa-dri")
                         : fmt::format("no display gives OpenGL 4.5 without X ({})", tried));
}

HeadlessContext::~HeadlessContext() {
    eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(display_, context_);
}

Status HeadlessContext::makeCurrent() {
    if (eglBindAPI(EGL_OPENGL_API) && eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, context_)) return {};
    return makeError(ErrorCode::Unavailable, info_.platform, fmt::format("EGL error 0x{:x}", eglGetError()));
}

} // namespace ars
