#include "engine/gl/surfel_discs.h"

#include "engine/gl/opengl.h"
#include "engine/io/image.h"

#include <algorithm>
#include <vector>

namespace ars {

namespace {

/// What disc.vert reads per instance.
struct Instance {
    glm::vec3 mean;
    glm::vec4 rotation; ///< w, x, y, z
    glm::vec2 scale;
    glm::vec3 color; ///< linear
};
static_assert(sizeof(Instance) == 12 * sizeof(float));

glm::vec3 discColor(const Surfels& surfels, std::size_t i) {
    if (!surfels.albedos.empty()) return surfels.albedos[i];
    if (surfels.colors.empty()) return glm::vec3(0.4f);
    const glm::vec3& c = surfels.colors[i];
    return {srgbToLinear(c.r), srgbToLinear(c.g), srgbToLinear(c.b)};
}

constexpr float kNearM = 0.02f;
constexpr float kFarM = 100.0f;

} // namespace

Result<std::unique_ptr<SurfelDiscs>> SurfelDiscs::create() {
    ARS_TRY(Shader shader, Shader::load("disc.vert", "disc.frag"));
    return std::unique_ptr<SurfelDiscs>(new SurfelDiscs(std::move(shader)));
}

SurfelDiscs::SurfelDiscs(Shader shader) : shader_(std::move(shader)) {
    glCreateVertexArrays(1, &array_);
    glCreateBuffers(1, &buffer_);
    const struct {
        int size;
        std::size_t offset;
    } attributes[] = {{3, offsetof(Instance, mean)},
                      {4, offsetof(Instance, rotation)},
                      {2, offsetof(Instance, scale)},
                      {3, offsetof(Instance, color)}};
    for (GLuint i = 0; i < 4; ++i) {
        glEnableVertexArrayAttrib(array_, i);
        glVertexArrayAttribFormat(array_, i, attributes[i].size, GL_FLOAT, GL_FALSE,
                                  static_cast<GLuint>(attributes[i].offset));
        glVertexArrayAttribBinding(array_, i, 0);
    }
    glVertexArrayBindingDivisor(array_, 0, 1);
    glVertexArrayVertexBuffer(array_, 0, buffer_, 0, sizeof(Instance));
}

SurfelDiscs::~SurfelDiscs() {
    glDeleteBuffers(1, &buffer_);
    glDeleteVertexArrays(1, &array_);
}

Status SurfelDiscs::set(const Surfels& surfels) {
    ARS_TRY_STATUS(checkSurfels(surfels));
    std::vector<Instance> instances(surfels.count());
    for (std::size_t i = 0; i < instances.size(); ++i) {
        const float* q = &surfels.rotations[4 * i];
        instances[i] = {surfels.means[i], {q[0], q[1], q[2], q[3]}, surfels.scales[i], discColor(surfels, i)};
    }
    glNamedBufferData(buffer_, static_cast<GLsizeiptr>(instances.size() * sizeof(Instance)), instances.data(),
                      GL_DYNAMIC_DRAW);
    count_ = instances.size();
    return {};
}

void SurfelDiscs::draw(const Camera& camera, const DiscSettings& settings, int x, int y, int width, int height) {
    if (width < 1 || height < 1) return;
    const Camera resized = resizedCamera(camera, width, height);
    shader_.set("worldToCamera", glm::mat3(resized.rotation));
    shader_.set("translation", glm::vec3(resized.translation));
    shader_.set("focal", glm::vec4(resized.fx, resized.fy, resized.cx, resized.cy));
    shader_.set("pixels", glm::vec2(width, height));
    shader_.set("reach", settings.reach);
    shader_.set("nearFar", glm::vec2(kNearM, kFarM));
    shader_.set("light", glm::normalize(settings.lightView));
    shader_.set("ambient", settings.ambient);
    glViewport(x, y, width, height);
    glDisable(GL_SCISSOR_TEST);
    glDisable(GL_CULL_FACE);
    glDisable(GL_BLEND);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glClearDepth(1.0);
    glClear(GL_DEPTH_BUFFER_BIT);
    shader_.use();
    glBindVertexArray(array_);
    glDrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(count_));
    glDisable(GL_DEPTH_TEST);
}

} // namespace ars
