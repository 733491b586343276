#include "app/model_loader.h"

#include <dlfcn.h>

namespace ars::app {

Result<ModelPlugin*> loadModel() {
    static const Result<ModelPlugin*> loaded = []() -> Result<ModelPlugin*> {
        // Found through the program's own run path: the build's lib folder, or ../lib where it is installed.
        void* library = dlopen("libars_model.so", RTLD_NOW | RTLD_LOCAL);
        if (!library) return makeError(ErrorCode::Unavailable, "LibTorch", dlerror());
        using Entry = ModelPlugin* (*)();
        const auto entry = reinterpret_cast<Entry>(dlsym(library, kModelPluginSymbol));
        if (!entry) return makeError(ErrorCode::Internal, "libars_model.so", dlerror());
        return entry();
    }();
    return loaded;
}

} // namespace ars::app
