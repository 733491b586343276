#include "engine/gl/shader.h"

#include "engine/core/file.h"
#include "engine/gl/opengl.h"

#include <glm/gtc/type_ptr.hpp>

#include <utility>

namespace ars {

namespace {

Result<GLuint> compile(GLenum stage, const std::string& file, const std::string& definitions) {
    ARS_TRY(const std::filesystem::path resources, resourceFolder());
    ARS_TRY(const std::string source, readTextFile(resources.parent_path() / "shaders" / file));
    const GLuint shader = glCreateShader(stage);
    // The version must stay the first line.
    const std::size_t body = source.find('\n') + 1;
    const std::string version = source.substr(0, body);
    const char* texts[] = {version.c_str(), definitions.c_str(), source.c_str() + body};
    glShaderSource(shader, 3, texts, nullptr);
    glCompileShader(shader);
    GLint done = GL_FALSE;
    glGetShaderiv(shader, GL_COMPILE_STATUS, &done);
    if (done) return shader;
    char words[2048] = "";
    glGetShaderInfoLog(shader, sizeof(words), nullptr, words);
    glDeleteShader(shader);
    return makeError(ErrorCode::Internal, file, fmt::format("the OpenGL driver does not compile it: {}", words));
}

} // namespace

Result<Shader> Shader::load(const std::string& vertexFile, const std::string& fragmentFile,
                            const std::string& definitions) {
    ARS_TRY(const GLuint vertex, compile(GL_VERTEX_SHADER, vertexFile, definitions));
    const Result<GLuint> fragment = compile(GL_FRAGMENT_SHADER, fragmentFile, definitions);
    if (!fragment) {
        glDeleteShader(vertex);
        return fragment.error();
    }
    Shader shader;
    shader.program_ = glCreateProgram();
    glAttachShader(shader.program_, vertex);
    glAttachShader(shader.program_, *fragment);
    glLinkProgram(shader.program_);
    glDeleteShader(vertex);
    glDeleteShader(*fragment);
    GLint done = GL_FALSE;
    glGetProgramiv(shader.program_, GL_LINK_STATUS, &done);
    if (done) return shader;
    char words[2048] = "";
    glGetProgramInfoLog(shader.program_, sizeof(words), nullptr, words);
    return makeError(ErrorCode::Internal, fragmentFile, fmt::format("the OpenGL driver does not link it: {}", words));
}

Shader::Shader(Shader&& other) noexcept : program_(std::exchange(other.program_, 0)) {}

Shader& Shader::operator=(Shader&& other) noexcept {
    std::swap(program_, other.program_);
    return *this;
}

Shader::~Shader() {
    if (program_) glDeleteProgram(program_);
}

void Shader::use() const { glUseProgram(program_); }

void Shader::set(const char* name, int value) const {
    glProgramUniform1i(program_, glGetUniformLocation(program_, name), value);
}
void Shader::set(const char* name, float value) const {
    glProgramUniform1f(program_, glGetUniformLocation(program_, name), value);
}
void Shader::set(const char* name, const glm::vec2& value) const {
    glProgramUniform2fv(program_, glGetUniformLocation(program_, name), 1, glm::value_ptr(value));
}
void Shader::set(const char* name, const glm::vec3& value) const {
    glProgramUniform3fv(program_, glGetUniformLocation(program_, name), 1, glm::value_ptr(value));
}
void Shader::set(const char* name, const glm::vec4& value) const {
    glProgramUniform4fv(program_, glGetUniformLocation(program_, name), 1, glm::value_ptr(value));
}
void Shader::set(const char* name, const glm::mat3& value) const {
    glProgramUniformMatrix3fv(program_, glGetUniformLocation(program_, name), 1, GL_FALSE, glm::value_ptr(value));
}

} // namespace ars
