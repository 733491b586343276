#include "model/plugin.h"

namespace {

class Plugin final : public ars::ModelPlugin {
public:
    ars::TorchInfo initialize() override { return ars::initializeTorch(); }
    ars::TorchSpeed measureSpeed(int repetitions) override { return ars::measureTorchSpeed(repetitions); }
};

} // namespace

extern "C" ars::ModelPlugin* arsModelPlugin() {
    static Plugin plugin;
    return &plugin;
}
