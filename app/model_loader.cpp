#include "app/model_loader.h"

#include <fmt/format.h>

#include <dlfcn.h>

#include <string>
#include <string_view>

namespace ars::app {
namespace {

/// The loader says "failed to map segment" of a library of 450 MB under a limit on memory (ulimit -v).
Error loadError(std::string_view said) {
    for (const std::string_view sign : {"failed to map segment", "cannot map", "annot allocate memory"}) {
        if (said.find(sign) == std::string_view::npos) continue;
        return makeError(ErrorCode::OutOfMemory, "LibTorch", fmt::format("not enough memory to load it: {}", said));
    }
    return makeError(ErrorCode::Unavailable, "LibTorch", std::string(said));
}

} // namespace

Result<ModelPlugin*> loadModel() {
    static const Result<ModelPlugin*> loaded = []() -> Result<ModelPlugin*> {
        // Found through the program's own run path: the build's lib folder, or ../lib where it is installed.
        void* library = dlopen("libars_model.so", RTLD_NOW | RTLD_LOCAL);
        if (!library) return loadError(dlerror());
        using Entry = ModelPlugin* (*)();
        const auto entry = reinterpret_cast<Entry>(dlsym(library, kModelPluginSymbol));
        if (!entry) return makeError(ErrorCode::Internal, "libars_model.so", dlerror());
        return entry();
    }();
    return loaded;
}

} // namespace ars::app
