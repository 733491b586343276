#pragma once

#include "engine/scene/run_monitor.h"
#include "ui/panel.h"

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

namespace ars::ui {

/// The trainings that this window has started, each in a process of its own: they are reaped when they end, and heard
/// where they ended badly. Any number may live at a time.
class TrainingStarts {
public:
    TrainingStarts();

    /// Starts one beside the window; a failure is told as a notice. A run that is at work already is left alone.
    /// @param begun  called on the window's thread once the process lives; may outlive the caller's frame
    void start(StudioContext& context, const TrainingStart& start, std::function<void()> begun);
    /// Once per frame. True when a process has ended since the last call.
    bool update(StudioContext& context);
    /// Whether this window is starting the run, or its process, started here, lives.
    bool works(const std::filesystem::path& run) const;
    /// Whether any is being started just now.
    bool starting() const;
    /// The end of what the run's last process said that ended badly; empty: nothing.
    std::string said(const std::filesystem::path& run) const;
    void forget(const std::filesystem::path& run);

private:
    struct State; ///< shared with the work beside
    std::shared_ptr<State> state_;
};

} // namespace ars::ui
