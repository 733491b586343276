#pragma once

#include "engine/scene/document.h"

namespace ars::ui::test {

/// A new document with so few surfels that its pictures take no time worth waiting for.
inline Document smallDocument() {
    Document document = newDocument();
    document.avatar.rest.maxSurfels = 6000;
    return document;
}

/// Side of the lights' cubes that goes with it.
inline constexpr int kSmallLightBase = 64;

} // namespace ars::ui::test
