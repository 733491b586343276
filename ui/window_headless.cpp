#include "engine/core/log.h"
#include "engine/gl/context.h"
#include "engine/gl/texture.h"
#include "engine/io/png.h"
#include "ui/studio.h"
#include "ui/window.h"
#include "ui/window_imgui.h"
#include "ui/window_timings.h"

#include <chrono>
#include <optional>
#include <thread>

namespace ars::ui {

using Clock = std::chrono::steady_clock;

/// Destroyed from the last to the first: the studio's textures while the context still lives.
struct HeadlessStudio::State {
    WindowStart start;
    Settings settings;
    std::unique_ptr<HeadlessContext> context;
    std::optional<RenderTarget> target;
    std::unique_ptr<ImGuiHost> host;
    std::optional<SettingsKeeper> keeper;
    std::unique_ptr<Session> session;
    std::unique_ptr<Studio> studio;
    Clock::time_point last = Clock::now();
    bool drawn = false; ///< the last frame is in the target

    ~State() {
        if (host) use();
        if (studio) studio->rememberLayout();
        if (keeper) keeper->flush(settings);
    }
    /// Another studio of this process may have drawn since.
    void use() {
        if (!host->use()) return;
        if (const Status current = context->makeCurrent(); !current) logError("{}", current.error().describe());
    }
};

HeadlessStudio::~HeadlessStudio() = default;

Result<std::unique_ptr<HeadlessStudio>> HeadlessStudio::create(int width, int height, const WindowStart& start) {
    std::unique_ptr<HeadlessStudio> result(new HeadlessStudio);
    result->state_ = std::make_unique<State>();
    State& state = *result->state_;
    state.start = start;
    state.settings = start.settings;
    ARS_TRY(state.context, HeadlessContext::create(start.device));
    ARS_TRY(RenderTarget target, RenderTarget::create(width, height));
    state.target.emplace(std::move(target));
    ARS_TRY(state.host, ImGuiHost::create(nullptr, true));
    state.host->setSize(width, height);
    SessionOptions options;
    options.device = start.device;
    options.stateFolder = start.stateFolder;
    options.autosave = start.settings.autosave;
    if (start.document) options.document = *start.document;
    options.lightBase = start.lightBase;
    state.keeper.emplace(start.stateFolder, readSettings(start.stateFolder));
    state.session = std::make_unique<Session>(options);
    state.studio = std::make_unique<Studio>(*state.session, state.settings);
    state.studio->drop(start.open);
    return result;
}

void HeadlessStudio::step() {
    State& state = *state_;
    state.use();
    const Clock::time_point begun = Clock::now();
    const double seconds = std::chrono::duration<double>(begun - state.last).count();
    state.last = begun;
    const auto since = [](Clock::time_point from) {
        return std::chrono::duration<float, std::milli>(Clock::now() - from).count();
    };
    WindowTimings::Parts parts;
    state.session->update(seconds);
    parts.updateMs = since(begun);
    const Clock::time_point updated = Clock::now();
    state.host->beginFrame(seconds);
    state.studio->draw(state.start.scale > 0.0f ? state.start.scale : 1.0f);
    parts.widgetsMs = since(updated);
    state.host->endFrame();
    state.host->afterSwap();
    state.drawn = false;
    state.studio->timings().add(parts);
    state.keeper->update(state.settings);
}

bool HeadlessStudio::settle(double seconds) {
    const Clock::time_point begun = Clock::now();
    int calm = 0; // the widgets that show what has settled need some frames, too
    while (std::chrono::duration<double>(Clock::now() - begun).count() < seconds) {
        step();
        calm = state_->session->settled() ? calm + 1 : 0;
        if (calm > 3) return true;
        if (calm == 0) std::this_thread::sleep_for(std::chrono::milliseconds(2)); // leaves the processor to the frames
    }
    return false;
}

Session& HeadlessStudio::session() { return *state_->session; }
Studio& HeadlessStudio::studio() { return *state_->studio; }
Settings& HeadlessStudio::settings() { return state_->settings; }
void* HeadlessStudio::testEngine() { return state_->host->testEngine(); }

std::vector<std::uint8_t> HeadlessStudio::pixels() {
    State& state = *state_;
    state.use();
    if (!state.drawn) {
        state.target->bind();
        state.host->draw(state.target->width(), state.target->height());
        state.drawn = true;
    }
    return state.target->read();
}

Status HeadlessStudio::writePicture(const std::filesystem::path& png) {
    const std::vector<std::uint8_t> bytes = pixels();
    Image image;
    image.width = state_->target->width();
    image.height = state_->target->height();
    image.channels = 3;
    image.space = ColorSpace::Srgb;
    image.sourceBits = 8;
    image.pixels.resize(static_cast<std::size_t>(image.width) * image.height * 3);
    for (std::size_t i = 0; i < image.pixels.size(); ++i) {
        image.pixels[i] = static_cast<float>(bytes[i / 3 * 4 + i % 3]) / 255.0f;
    }
    return writePng(png, image);
}

} // namespace ars::ui
