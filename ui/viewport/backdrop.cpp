#include "ui/viewport/backdrop.h"

#include "engine/core/parallel.h"

namespace ars::ui {

struct BackdropSource::Work {
    std::shared_ptr<const LightAsset> light;
    std::shared_ptr<const Environment> result;
};

Environment halvedEnvironment(const Environment& environment, int width) {
    Environment result = environment;
    while (result.picture.width > width && result.picture.width % 2 == 0 && result.picture.height % 2 == 0) {
        const Image& from = result.picture;
        Image half;
        half.width = from.width / 2;
        half.height = from.height / 2;
        half.channels = from.channels;
        half.space = from.space;
        half.pixels.resize(static_cast<std::size_t>(half.width) * static_cast<std::size_t>(half.height) *
                           static_cast<std::size_t>(half.channels));
        parallelFor(
            static_cast<std::size_t>(half.height),
            [&](std::size_t row) {
                const int y = static_cast<int>(row);
                for (int x = 0; x < half.width; ++x) {
                    for (int c = 0; c < half.channels; ++c) {
                        half.at(y, x, c) = 0.25f * (from.at(2 * y, 2 * x, c) + from.at(2 * y, 2 * x + 1, c) +
                                                    from.at(2 * y + 1, 2 * x, c) + from.at(2 * y + 1, 2 * x + 1, c));
                    }
                }
            },
            32);
        result.picture = std::move(half);
    }
    return result;
}

std::shared_ptr<const Environment> BackdropSource::environment(StudioContext& context,
                                                               const std::shared_ptr<const LightAsset>& light) {
    if (!light || !light->source) return nullptr;
    if (light->source->environment.picture.width <= kMaxBackdropWidth) {
        return {light->source, &light->source->environment};
    }
    if (ready_ && ready_->light->source == light->source) return ready_->result;
    if (!running_) {
        auto work = std::make_shared<Work>(Work{light, nullptr});
        running_ = work;
        context.session.start(
            "Preparing the backdrop",
            [work](const ProgressFunction&) -> Status {
                work->result = std::make_shared<const Environment>(
                    halvedEnvironment(work->light->source->environment, kMaxBackdropWidth));
                return {};
            },
            [this, work, alive = std::weak_ptr<int>(alive_)](const Status& status) {
                if (alive.expired()) return;
                running_.reset();
                if (status.ok()) ready_ = work;
            },
            true);
    }
    return ready_ ? ready_->result : nullptr;
}

} // namespace ars::ui
