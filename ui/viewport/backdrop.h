#pragma once

#include "ui/viewport/view.h"

#include <memory>

namespace ars::ui {

/// The environment behind the avatar at a size that a texture takes quickly: halved, beside the window, until it is not
/// wider than kMaxBackdropWidth.
inline constexpr int kMaxBackdropWidth = 2048;

class BackdropSource {
public:
    /// Null where the light has none or while the first is being made smaller; else the newest that is ready.
    std::shared_ptr<const Environment> environment(StudioContext& context,
                                                   const std::shared_ptr<const LightAsset>& light);

private:
    struct Work;
    std::shared_ptr<Work> ready_, running_;
    std::shared_ptr<int> alive_ = std::make_shared<int>(0);
};

/// Every two by two pixels become their mean, until the picture is no wider than `width`.
Environment halvedEnvironment(const Environment& environment, int width);

} // namespace ars::ui
