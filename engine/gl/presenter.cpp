#include "engine/gl/presenter.h"

#include "engine/gl/opengl.h"
#include "engine/light/light_math.h"

#include <algorithm>
#include <cmath>

namespace ars {

namespace {

constexpr int kMapEntries = 256;
constexpr int kSrgbEntries = 1024;
constexpr int kToneEntries = 72;
/// Stops of the curve's table: from far below a display's black to where every curve is white.
constexpr float kDarkestLog2 = -11.0f;
constexpr float kBrightestLog2 = 7.0f;

std::vector<float> colorMapTable(ColorMap map) {
    std::vector<float> values;
    for (int i = 0; i < kMapEntries; ++i) {
        const glm::vec3 color = mapColor(map, static_cast<float>(i) / (kMapEntries - 1));
        values.insert(values.end(), {color.r, color.g, color.b});
    }
    return values;
}

/// The encoding over the root of its argument, where it is nearly straight.
std::vector<float> encodingTable() {
    std::vector<float> values;
    for (int i = 0; i < kSrgbEntries; ++i) {
        const float root = static_cast<float>(i) / (kSrgbEntries - 1);
        values.push_back(linearToSrgb(root * root));
    }
    return values;
}

/// What the engine's tone curve makes of every entry, decoded to display-linear light.
std::vector<float> curveTable(ToneCurve curve) {
    auto light = [](int i) {
        const float t = static_cast<float>(i) / (kToneEntries - 1);
        return std::exp2(kDarkestLog2 + t * (kBrightestLog2 - kDarkestLog2)) - std::exp2(kDarkestLog2);
    };
    std::vector<float> linear, display(static_cast<std::size_t>(kToneEntries) * kToneEntries * kToneEntries * 4);
    for (int b = 0; b < kToneEntries; ++b) {
        for (int g = 0; g < kToneEntries; ++g) {
            for (int r = 0; r < kToneEntries; ++r) linear.insert(linear.end(), {light(r), light(g), light(b)});
        }
    }
    ToneParams params;
    params.curve = curve;
    const Status done = toneMap({}, params, {linear.data(), kToneEntries, kToneEntries * kToneEntries, 3},
                                ImageView<float>{display.data(), kToneEntries, kToneEntries * kToneEntries, 4});
    assert(done.ok());
    (void)done;
    std::vector<float> values;
    for (std::size_t i = 0; i < display.size(); i += 4) {
        for (std::size_t c = 0; c < 3; ++c) values.push_back(srgbToLinear(display[i + c]));
    }
    return values;
}

/// (screen.xy in [0,1], 1) to a direction in the world whose camera z is 1.
glm::mat3 screenToWorld(const Camera& camera) {
    const glm::dmat3 toRay(glm::dvec3(camera.width / camera.fx, 0, 0), glm::dvec3(0, camera.height / camera.fy, 0),
                           glm::dvec3(-camera.cx / camera.fx, -camera.cy / camera.fy, 1));
    return glm::mat3(glm::transpose(camera.rotation) * toRay);
}

/// Drawing begins: nothing that was set before may leak in.
void begin(int x, int y, int width, int height) {
    glViewport(x, y, width, height);
    glDisable(GL_DEPTH_TEST);
    glDisable(GL_SCISSOR_TEST);
    glDisable(GL_CULL_FACE);
    glDisable(GL_BLEND);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

/// Pixels x, y, width, height of a box that is given in shares of the picture, row 0 on top, inside `area`.
glm::ivec4 boxIn(const glm::vec2& low, const glm::vec2& high, const glm::ivec4& area) {
    const glm::vec2 size(area.z, area.w);
    const glm::ivec2 first = glm::max(glm::ivec2(glm::floor(low * size)), glm::ivec2(0));
    const glm::ivec2 last = glm::min(glm::ivec2(glm::ceil(high * size)), glm::ivec2(area.z, area.w));
    return {area.x + first.x, area.y + area.w - last.y, std::max(last.x - first.x, 0), std::max(last.y - first.y, 0)};
}

/// Box of all that is not empty, with a margin of two texels.
void coveredBox(ImageView<const float> opacity, glm::vec2& low, glm::vec2& high) {
    const int width = opacity.width, height = opacity.height;
    auto rowCovered = [&](int row) {
        const float* values = opacity.at(row, 0);
        float largest = 0.0f;
        for (int column = 0; column < width; ++column) largest = std::max(largest, values[column]);
        return largest > 0.0f;
    };
    int top = 0, bottom = height;
    while (top < bottom && !rowCovered(top)) ++top;
    while (bottom > top && !rowCovered(bottom - 1)) --bottom;
    int left = width, right = 0;
    for (int row = top; row < bottom; ++row) {
        const float* values = opacity.at(row, 0);
        for (int column = 0; column < left; ++column) {
            if (values[column] > 0.0f) left = column;
        }
        for (int column = width; column > right; --column) {
            if (values[column - 1] > 0.0f) right = column;
        }
    }
    if (right <= left) {
        low = high = glm::vec2(0.0f);
        return;
    }
    const glm::vec2 size(width, height);
    low = (glm::vec2(left, top) - 2.0f) / size;
    high = (glm::vec2(right, bottom) + 2.0f) / size;
}

/// Rows of the viewport, from the lower left, in which the floor can be seen.
glm::ivec2 floorRows(const glm::mat3& screenToWorld, const glm::vec3& eye, const glm::ivec4& area) {
    // The ray's height is linear on the screen; the floor is seen where it goes towards it.
    const float sign = eye.y > 0.0f ? -1.0f : 1.0f;
    float first = 1.0f, last = 0.0f;
    for (const float u : {0.0f, 1.0f}) {
        const float top = sign * (screenToWorld * glm::vec3(u, 0, 1)).y;
        const float bottom = sign * (screenToWorld * glm::vec3(u, 1, 1)).y;
        if (top <= 0 && bottom <= 0) continue;
        const float crossing = top > 0 && bottom > 0 ? 0.0f : top / (top - bottom);
        first = std::min(first, top > 0 ? 0.0f : crossing);
        last = std::max(last, bottom > 0 ? 1.0f : crossing);
    }
    const auto row = [&](float v) { return static_cast<int>(std::floor((1.0f - v) * static_cast<float>(area.w))); };
    return {area.y + std::max(row(last) - 1, 0), area.y + std::min(row(first) + 2, area.w)};
}

void blendScreen(const Shader& shader, GLuint vertices, const glm::ivec4& box) {
    shader.use();
    glBindVertexArray(vertices);
    glEnable(GL_BLEND);
    glBlendEquation(GL_FUNC_ADD);
    glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    glEnable(GL_SCISSOR_TEST);
    glScissor(box.x, box.y, box.z, box.w);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glDisable(GL_SCISSOR_TEST);
    glDisable(GL_BLEND);
}

} // namespace

struct Presenter::VertexArray {
    GLuint array = 0;
    GLuint buffer = 0;
    VertexArray() {
        glCreateVertexArrays(1, &array);
        glCreateBuffers(1, &buffer);
        const struct {
            int size;
            std::size_t offset;
        } attributes[] = {{3, 0}, {3, 12}, {4, 24}, {1, 40}};
        for (GLuint i = 0; i < 4; ++i) {
            glEnableVertexArrayAttrib(array, i);
            glVertexArrayAttribFormat(array, i, attributes[i].size, GL_FLOAT, GL_FALSE,
                                      static_cast<GLuint>(attributes[i].offset));
            glVertexArrayAttribBinding(array, i, 0);
        }
        glVertexArrayBindingDivisor(array, 0, 1);
        glVertexArrayVertexBuffer(array, 0, buffer, 0, 44);
    }
    ~VertexArray() {
        glDeleteBuffers(1, &buffer);
        glDeleteVertexArrays(1, &array);
    }
    VertexArray(const VertexArray&) = delete;
    VertexArray& operator=(const VertexArray&) = delete;
};

PresentSettings defaultPresentSettings(BufferId buffer) {
    const BufferInfo& info = bufferInfo(buffer);
    PresentSettings settings;
    settings.buffer = buffer;
    settings.minimum = info.minimum;
    settings.maximum = info.maximum;
    settings.colorMap = info.colorMap;
    return settings;
}

std::vector<OverlayLine> skeletonLines(const Skeleton& skeleton, std::span<const glm::mat4> jointWorld,
                                       const glm::vec4& color) {
    std::vector<OverlayLine> lines;
    for (int joint = 0; joint < skeleton.jointCount(); ++joint) {
        const auto index = static_cast<std::size_t>(joint);
        const glm::vec3 place(jointWorld[index][3]);
        const int parent = skeleton.parents[index];
        const float length =
            parent < 0 ? 1.0f : glm::length(place - glm::vec3(jointWorld[static_cast<std::size_t>(parent)][3]));
        const float width = length < 0.06f ? 1.2f : 2.2f; // fingers and the face are close together
        if (parent >= 0)
            lines.push_back({glm::vec3(jointWorld[static_cast<std::size_t>(parent)][3]), place, color, width});
        lines.push_back({place, place, color, 2.6f * width});
    }
    return lines;
}

Status ShownPicture::set(ImageView<const float> picture, ImageView<const float> opacity, ImageView<const float> depth) {
    auto differs = [&](const ImageView<const float>& other) {
        return !other.empty() && (other.width != picture.width || other.height != picture.height);
    };
    if (differs(opacity) || differs(depth)) {
        return makeError(ErrorCode::InvalidArgument, "present",
                         fmt::format("picture {}x{}, opacity {}x{} and depth {}x{} differ in size", picture.width,
                                     picture.height, opacity.width, opacity.height, depth.width, depth.height));
    }
    if (picture.empty() || (picture.channels != 1 && picture.channels != 3 && picture.channels != 4)) {
        return makeError(ErrorCode::InvalidArgument, "present",
                         fmt::format("a picture of {} channels, expected 1, 3 or 4", picture.channels));
    }
    picture_.upload(picture, true);
    channels_ = picture.channels;
    const float one = 1.0f, zero = 0.0f;
    opacity_.upload(opacity.empty() ? ImageView<const float>{&one, 1, 1, 1} : opacity, true);
    depth_.upload(depth.empty() ? ImageView<const float>{&zero, 1, 1, 1} : depth, false);
    low_ = glm::vec2(0.0f);
    high_ = glm::vec2(1.0f);
    if (!opacity.empty()) coveredBox(opacity, low_, high_);
    return {};
}

Result<std::unique_ptr<Presenter>> Presenter::create() {
    ARS_TRY(Shader grid, Shader::load("screen.vert", "grid.frag"));
    ARS_TRY(Shader line, Shader::load("line.vert", "line.frag"));
    std::unique_ptr<Presenter> presenter(new Presenter(std::move(grid), std::move(line)));
    // What does not compile must be known now and not in the middle of a frame.
    ARS_TRY_STATUS([&]() -> Status {
        ARS_TRY(const Shader* shader, presenter->presentShader(0, true, PresentSettings{}));
        (void)shader;
        return {};
    }());
    return presenter;
}

Presenter::Presenter(Shader grid, Shader line)
    : grid_(std::move(grid)), line_(std::move(line)), vertices_(std::make_shared<VertexArray>()) {
    const float zeros[3] = {0, 0, 0}, one = 1.0f;
    environment_.uploadEnvironment({zeros, 1, 1, 3});
    nothing_.upload({zeros, 1, 1, 1}, false);
    opaque_.upload({&one, 1, 1, 1}, false);
    colorMap_.uploadTable(colorMapTable(colorMapIn_), 3);
    srgbTable_.uploadTable(encodingTable(), 1);
    toneTable_.uploadCubeTable(std::vector<float>(3 * 8, 0.0f), 2);
}

void Presenter::setEnvironment(const Environment& environment) {
    environment_.uploadEnvironment({environment.picture.pixels.data(), environment.picture.width,
                                    environment.picture.height, environment.picture.channels});
}

Result<const Shader*> Presenter::shader(const std::string& fragment, const std::string& definitions) {
    const std::string key = fragment + "\n" + definitions;
    auto found = shaders_.find(key);
    if (found == shaders_.end()) {
        ARS_TRY(Shader loaded, Shader::load("screen.vert", fragment, definitions));
        found = shaders_.emplace(key, std::move(loaded)).first;
    }
    return &found->second;
}

Result<const Shader*> Presenter::presentShader(int kind, bool premultiplied, const PresentSettings& settings) {
    const auto background = static_cast<int>(settings.backdrop);
    // Data does not go through the curve, but an environment behind it does.
    const bool tone =
        settings.tone.curve != ToneCurve::None && (kind == 0 || settings.backdrop == Backdrop::Environment);
    return shader("present.frag",
                  fmt::format("#define KIND {}\n#define PREMULTIPLIED {}\n#define TONE {}\n#define BACKGROUND {}\n",
                              kind, premultiplied ? 1 : 0, tone ? 1 : 0, background));
}

void Presenter::setColorMap(ColorMap map) {
    if (map == colorMapIn_) return;
    colorMap_.uploadTable(colorMapTable(map), 3);
    colorMapIn_ = map;
}

void Presenter::updateTables(const PresentSettings& settings) {
    setColorMap(settings.colorMap);
    if (settings.tone.curve == curveIn_ || settings.tone.curve == ToneCurve::None) return;
    toneTable_.uploadCubeTable(curveTable(settings.tone.curve), kToneEntries);
    curveIn_ = settings.tone.curve;
}

/// Everything of present.frag but the picture's own textures.
void Presenter::prepare(const Shader& shader, const PresentSettings& settings, const Camera& camera) const {
    const Texture* textures[] = {&colorMap_, &srgbTable_, &toneTable_, &environment_};
    const char* names[] = {"colorMap", "srgbTable", "toneTable", "environment"};
    for (int i = 0; i < 4; ++i) {
        textures[i]->bind(i + 2);
        shader.set(names[i], i + 2);
    }
    const ToneParams& tone = settings.tone;
    const glm::vec3 background(tone.backgroundRed, tone.backgroundGreen, tone.backgroundBlue);
    shader.set("range", glm::vec2(settings.minimum, settings.maximum));
    shader.set("exposure", std::exp2(tone.exposureEv));
    shader.set("shaper", glm::vec2(kDarkestLog2, kBrightestLog2));
    shader.set("backgroundLinear", background);
    shader.set("backgroundShown",
               glm::vec3(linearToSrgb(background.r), linearToSrgb(background.g), linearToSrgb(background.b)));
    shader.set("screenToEnvironment", worldToEnvironment(settings.placement.rotationDeg) * screenToWorld(camera));
    shader.set("environmentScale", settings.placement.scale);
    const float levels = std::log2(static_cast<float>(std::max(environment_.width(), 1)));
    shader.set("environmentLod", settings.backdropBlur * levels);
    shader.set("pixels", glm::vec2(camera.width, camera.height));
}

Status Presenter::draw(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                       std::span<const OverlayLine> lines, int x, int y, int width, int height) {
    if (picture.empty()) return makeError(ErrorCode::InvalidArgument, "present", "no picture was set");
    if (width < 1 || height < 1) return {}; // a minimised window
    updateTables(settings);
    begin(x, y, width, height);
    ARS_TRY_STATUS(drawPicture(picture, settings, resizedCamera(camera, width, height), {x, y, width, height}));
    drawOverlays(picture, settings, camera, lines, x, y, width, height);
    return {};
}

Status Presenter::drawBackground(const PresentSettings& settings, const Camera& camera, int x, int y, int width,
                                 int height) {
    if (width < 1 || height < 1) return {};
    updateTables(settings);
    begin(x, y, width, height);
    return fillBackground(settings, resizedCamera(camera, width, height), {x, y, width, height}, {x, y, 0, 0});
}

void Presenter::drawOverlays(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                             std::span<const OverlayLine> lines, int x, int y, int width, int height) {
    if (width < 1 || height < 1 || (!settings.grid && lines.empty())) return;
    begin(x, y, width, height);
    const Camera resized = resizedCamera(camera, width, height);
    glEnable(GL_BLEND);
    glBlendEquation(GL_FUNC_ADD);
    glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    if (settings.grid) drawGrid(picture, settings, resized, {x, y, width, height});
    if (!lines.empty()) drawLines(picture, lines, resized, 0.45f, 0.0f, false);
    glDisable(GL_BLEND);
}

Status Presenter::tint(const ShownPicture& picture, float strength, int x, int y, int width, int height) {
    if (picture.empty()) return makeError(ErrorCode::InvalidArgument, "present", "no picture was set");
    if (width < 1 || height < 1) return {};
    ARS_TRY(const Shader* shader, this->shader("tint.frag", ""));
    begin(x, y, width, height);
    picture.picture_.bind(0);
    picture.opacity_.bind(1);
    shader->set("picture", 0);
    shader->set("opacity", 1);
    shader->set("tint", glm::vec4(0, 0, 0, strength));
    blendScreen(*shader, vertices_->array, boxIn(picture.low_, picture.high_, {x, y, width, height}));
    return {};
}

void Presenter::drawMask(const ShownPicture& picture, const Camera& camera, std::span<const OverlayLine> lines,
                         float biasM, int width, int height) {
    begin(0, 0, width, height);
    glClearColor(0, 0, 0, 1);
    glClear(GL_COLOR_BUFFER_BIT);
    if (lines.empty()) return;
    glEnable(GL_BLEND);
    glBlendEquation(GL_MAX);
    drawLines(picture, lines, resizedCamera(camera, width, height), 0.0f, biasM, true);
    glBlendEquation(GL_FUNC_ADD);
    glDisable(GL_BLEND);
}

Status Presenter::tintMask(const ShownPicture& picture, const RenderTarget& mask, const glm::vec4& color, int x, int y,
                           int width, int height) {
    if (width < 1 || height < 1) return {};
    ARS_TRY(const Shader* shader, this->shader("tint.frag", "#define FROM_MASK\n"));
    begin(x, y, width, height);
    glBindTextureUnit(0, mask.texture());
    (picture.empty() ? opaque_ : picture.opacity_).bind(1);
    shader->set("picture", 0);
    shader->set("opacity", 1);
    shader->set("tint", color);
    blendScreen(*shader, vertices_->array, {x, y, width, height});
    return {};
}

Status Presenter::drawDifference(const RenderTarget& first, const RenderTarget& second, bool squared, float maximum,
                                 ColorMap map, int x, int y, int width, int height) {
    if (width < 1 || height < 1) return {};
    ARS_TRY(const Shader* shader, this->shader("difference.frag", ""));
    setColorMap(map);
    begin(x, y, width, height);
    glBindTextureUnit(0, first.texture());
    glBindTextureUnit(1, second.texture());
    colorMap_.bind(2);
    shader->set("first", 0);
    shader->set("second", 1);
    shader->set("colorMap", 2);
    shader->set("squared", squared);
    shader->set("maximum", maximum);
    shader->use();
    glBindVertexArray(vertices_->array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    return {};
}

/// Everything of `area` but `hole`, both x, y, width, height.
Status Presenter::fillBackground(const PresentSettings& settings, const Camera& camera, const glm::ivec4& area,
                                 const glm::ivec4& hole) {
    glEnable(GL_SCISSOR_TEST);
    if (settings.backdrop == Backdrop::Color) {
        const ToneParams& tone = settings.tone;
        glScissor(area.x, area.y, area.z, area.w);
        glClearColor(linearToSrgb(tone.backgroundRed), linearToSrgb(tone.backgroundGreen),
                     linearToSrgb(tone.backgroundBlue), 1.0f);
        glClear(GL_COLOR_BUFFER_BIT);
        glDisable(GL_SCISSOR_TEST);
        return {};
    }
    const Result<const Shader*> shader = presentShader(-1, false, settings);
    if (!shader) {
        glDisable(GL_SCISSOR_TEST);
        return shader.error();
    }
    prepare(**shader, settings, camera);
    (*shader)->use();
    glBindVertexArray(vertices_->array);
    const int right = hole.x + hole.z, top = hole.y + hole.w;
    const glm::ivec4 around[] = {{area.x, area.y, area.z, hole.y - area.y},
                                 {area.x, top, area.z, area.y + area.w - top},
                                 {area.x, hole.y, hole.x - area.x, hole.w},
                                 {right, hole.y, area.x + area.z - right, hole.w}};
    for (const glm::ivec4& part : around) {
        if (part.z < 1 || part.w < 1) continue;
        glScissor(part.x, part.y, part.z, part.w);
        glDrawArrays(GL_TRIANGLES, 0, 3);
    }
    glDisable(GL_SCISSOR_TEST);
    return {};
}

Status Presenter::drawPicture(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                              const glm::ivec4& area) {
    // Opacity itself is data everywhere: nothing lies behind it.
    const bool everywhere = settings.buffer == BufferId::Opacity;
    const glm::ivec4 box = everywhere ? area : boxIn(picture.low_, picture.high_, area);
    ARS_TRY_STATUS(fillBackground(settings, camera, area, box));
    if (box.z < 1 || box.w < 1) return {};
    const int kind = static_cast<int>(bufferInfo(settings.buffer).kind);
    ARS_TRY(const Shader* shader, presentShader(kind, picture.channels_ == 4, settings));
    picture.picture_.bind(0);
    (everywhere ? opaque_ : picture.opacity_).bind(1);
    shader->set("picture", 0);
    shader->set("opacity", 1);
    // At its own size every pixel is one texel, and looking at its neighbours changes nothing.
    const bool same = picture.width() == area.z && picture.height() == area.w;
    const GLint filter = settings.smooth && !same ? GL_LINEAR : GL_NEAREST;
    for (const Texture* texture : {&picture.picture_, &picture.opacity_}) {
        glTextureParameteri(texture->name(), GL_TEXTURE_MAG_FILTER, filter);
        glTextureParameteri(texture->name(), GL_TEXTURE_MIN_FILTER, filter);
    }
    prepare(*shader, settings, camera);
    shader->use();
    glBindVertexArray(vertices_->array);
    glEnable(GL_SCISSOR_TEST);
    glScissor(box.x, box.y, box.z, box.w);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glDisable(GL_SCISSOR_TEST);
    return {};
}

void Presenter::drawGrid(const ShownPicture& picture, const PresentSettings& settings, const Camera& camera,
                         const glm::ivec4& area) {
    const glm::mat3 toWorld = screenToWorld(camera);
    const glm::vec3 eye(camera.centerWorld());
    (picture.empty() ? nothing_ : picture.depth_).bind(0);
    grid_.set("depth", 0);
    grid_.set("screenToWorld", toWorld);
    grid_.set("eye", eye);
    grid_.set("gridColor", settings.gridColor);
    grid_.set("xColor", glm::vec3(0.85f, 0.33f, 0.30f));
    grid_.set("zColor", glm::vec3(0.30f, 0.50f, 0.88f));
    grid_.use();
    glBindVertexArray(vertices_->array);
    const glm::ivec2 rows = floorRows(toWorld, eye, area);
    if (rows.y <= rows.x) return;
    glEnable(GL_SCISSOR_TEST);
    glScissor(area.x, rows.x, area.z, rows.y - rows.x);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glDisable(GL_SCISSOR_TEST);
}

void Presenter::drawLines(const ShownPicture& picture, std::span<const OverlayLine> lines, const Camera& camera,
                          float behind, float biasM, bool premultiplied) {
    (picture.empty() ? nothing_ : picture.depth_).bind(0);
    line_.set("depth", 0);
    line_.set("focal", glm::vec4(camera.fx, camera.fy, camera.cx, camera.cy));
    line_.set("pixels", glm::vec2(camera.width, camera.height));
    line_.set("behind", behind);
    line_.set("bias", biasM);
    line_.set("premultiplied", premultiplied);
    line_.use();
    glBindVertexArray(vertices_->array);
    // One draw per width: the width decides the softness of the edge.
    std::vector<float> values;
    std::size_t begin = 0;
    while (begin < lines.size()) {
        std::size_t end = begin;
        values.clear();
        for (; end < lines.size() && lines[end].widthPixels == lines[begin].widthPixels; ++end) {
            const OverlayLine& line = lines[end];
            const glm::vec3 a(camera.toCamera(glm::dvec3(line.begin))), b(camera.toCamera(glm::dvec3(line.end)));
            values.insert(values.end(), {a.x, a.y, a.z, b.x, b.y, b.z, line.color.r, line.color.g, line.color.b,
                                         line.color.a, line.widthPixels});
        }
        line_.set("halfWidth", 0.5f * lines[begin].widthPixels);
        glNamedBufferData(vertices_->buffer, static_cast<GLsizeiptr>(values.size() * sizeof(float)), values.data(),
                          GL_STREAM_DRAW);
        glDrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(end - begin));
        begin = end;
    }
}

} // namespace ars
