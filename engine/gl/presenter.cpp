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

Result<std::unique_ptr<Presenter>> Presenter::create() {
    ARS_TRY(Shader present, Shader::load("screen.vert", "present.frag"));
    ARS_TRY(Shader grid, Shader::load("screen.vert", "grid.frag"));
    ARS_TRY(Shader line, Shader::load("line.vert", "line.frag"));
    return std::unique_ptr<Presenter>(new Presenter(std::move(present), std::move(grid), std::move(line)));
}

Presenter::Presenter(Shader present, Shader grid, Shader line)
    : present_(std::move(present)), grid_(std::move(grid)), line_(std::move(line)),
      vertices_(std::make_shared<VertexArray>()) {
    const float nothing[3] = {0, 0, 0};
    environment_.uploadEnvironment({nothing, 1, 1, 3});
    depth_.upload({nothing, 1, 1, 1}, false);
    colorMap_.uploadTable(colorMapTable(colorMapIn_), 3);
    srgbTable_.uploadTable(encodingTable(), 1);
    toneTable_.uploadCubeTable(std::vector<float>(3 * 8, 0.0f), 2);
}

Status Presenter::setPicture(ImageView<const float> picture, ImageView<const float> opacity,
                             ImageView<const float> depth) {
    if (picture.width != opacity.width || picture.height != opacity.height ||
        (!depth.empty() && (depth.width != picture.width || depth.height != picture.height))) {
        return makeError(ErrorCode::InvalidArgument, "present",
                         fmt::format("picture {}x{}, opacity {}x{} and depth {}x{} differ in size", picture.width,
                                     picture.height, opacity.width, opacity.height, depth.width, depth.height));
    }
    picture_.upload(picture, true);
    opacity_.upload(opacity, true);
    pictureChannels_ = picture.channels;
    const float nothing = 0;
    depth_.upload(depth.empty() ? ImageView<const float>{&nothing, 1, 1, 1} : depth, false);
    return {};
}

void Presenter::setEnvironment(const Environment& environment) {
    environment_.uploadEnvironment({environment.picture.pixels.data(), environment.picture.width,
                                    environment.picture.height, environment.picture.channels});
}

void Presenter::updateTables(const PresentSettings& settings) {
    if (settings.colorMap != colorMapIn_) {
        colorMap_.uploadTable(colorMapTable(settings.colorMap), 3);
        colorMapIn_ = settings.colorMap;
    }
    if (settings.tone.curve != curveIn_ && settings.tone.curve != ToneCurve::None) {
        toneTable_.uploadCubeTable(curveTable(settings.tone.curve), kToneEntries);
    }
    curveIn_ = settings.tone.curve;
}

Status Presenter::draw(const PresentSettings& settings, const Camera& camera, std::span<const OverlayLine> lines, int x,
                       int y, int width, int height) {
    if (picture_.empty()) return makeError(ErrorCode::InvalidArgument, "present", "no picture was set");
    if (width < 1 || height < 1) return {}; // a minimised window
    updateTables(settings);
    glViewport(x, y, width, height);
    glDisable(GL_DEPTH_TEST);
    glDisable(GL_BLEND);
    const Camera resized = resizedCamera(camera, width, height);
    drawPicture(settings, resized);
    glEnable(GL_BLEND);
    glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    if (settings.grid) drawGrid(settings, resized);
    if (!lines.empty()) drawLines(lines, resized);
    glDisable(GL_BLEND);
    return {};
}

void Presenter::drawPicture(const PresentSettings& settings, const Camera& camera) {
    const int units = 6;
    const Texture* textures[units] = {&picture_, &opacity_, &colorMap_, &srgbTable_, &toneTable_, &environment_};
    const char* names[units] = {"picture", "opacity", "colorMap", "srgbTable", "toneTable", "environment"};
    for (int i = 0; i < units; ++i) {
        textures[i]->bind(i);
        present_.set(names[i], i);
    }
    const GLint filter = settings.smooth ? GL_LINEAR : GL_NEAREST;
    for (const Texture* texture : {&picture_, &opacity_}) {
        glTextureParameteri(texture->name(), GL_TEXTURE_MAG_FILTER, filter);
        glTextureParameteri(texture->name(), GL_TEXTURE_MIN_FILTER, filter);
    }
    const ToneParams& tone = settings.tone;
    present_.set("kind", static_cast<int>(bufferInfo(settings.buffer).kind));
    present_.set("premultiplied", pictureChannels_ == 4);
    present_.set("range", glm::vec2(settings.minimum, settings.maximum));
    present_.set("exposure", std::exp2(tone.exposureEv));
    present_.set("useToneTable", tone.curve != ToneCurve::None);
    present_.set("shaper", glm::vec2(kDarkestLog2, kBrightestLog2));
    present_.set("background", static_cast<int>(settings.backdrop));
    present_.set("backgroundLinear", glm::vec3(tone.backgroundRed, tone.backgroundGreen, tone.backgroundBlue));
    present_.set("screenToEnvironment", worldToEnvironment(settings.placement.rotationDeg) * screenToWorld(camera));
    present_.set("environmentScale", settings.placement.scale);
    const float levels = std::log2(static_cast<float>(std::max(environment_.width(), 1)));
    present_.set("environmentLod", settings.backdropBlur * levels);
    present_.set("pixels", glm::vec2(camera.width, camera.height));
    present_.use();
    glBindVertexArray(vertices_->array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
}

void Presenter::drawGrid(const PresentSettings& settings, const Camera& camera) {
    depth_.bind(0);
    grid_.set("depth", 0);
    grid_.set("screenToWorld", screenToWorld(camera));
    grid_.set("eye", glm::vec3(camera.centerWorld()));
    grid_.set("gridColor", settings.gridColor);
    grid_.set("xColor", glm::vec3(0.85f, 0.33f, 0.30f));
    grid_.set("zColor", glm::vec3(0.30f, 0.50f, 0.88f));
    grid_.use();
    glBindVertexArray(vertices_->array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
}

void Presenter::drawLines(std::span<const OverlayLine> lines, const Camera& camera) {
    depth_.bind(0);
    line_.set("depth", 0);
    line_.set("focal", glm::vec4(camera.fx, camera.fy, camera.cx, camera.cy));
    line_.set("pixels", glm::vec2(camera.width, camera.height));
    line_.set("behind", 0.45f);
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
