#pragma once

#include "engine/gl/texture.h"
#include "engine/io/image.h"
#include "engine/scene/session.h"

#include <imgui.h>

#include <functional>
#include <map>
#include <memory>
#include <string>

namespace ars::ui {

/// For ImGui::Image and draw lists.
inline ImTextureRef textureOf(const Texture& texture) { return ImTextureRef(static_cast<ImTextureID>(texture.name())); }

/// Small pictures that are made beside the window, at most two at a time, and kept as textures. Main thread only, with
/// the window's OpenGL context current; `make` runs on a thread of its own and must own what it uses.
class PictureCache {
public:
    using Make = std::function<Result<Image>(const ProgressFunction&)>; ///< sRGB-encoded, 3 or 4 channels

    struct Shown {
        const Texture* texture = nullptr; ///< null while it is made, or where it failed
        std::string error;                ///< "" unless it failed
    };
    /// The picture of this key; asks for it where it is not there yet.
    Shown get(Session& session, const std::string& key, const Make& make);
    /// How many are made or waiting to be.
    int pending() const;

private:
    struct Entry {
        bool started = false;
        bool done = false;
        Image image; ///< until it is on the graphics card
        Texture texture;
        std::string error;
    };
    /// Shared with the work beside, which may end after the panel.
    struct State {
        std::map<std::string, Entry> entries;
        int running = 0;
    };
    std::shared_ptr<State> state_ = std::make_shared<State>();
};

} // namespace ars::ui
