#pragma once

#include "engine/core/error.h"

#include <glm/glm.hpp>

#include <string>

namespace ars {

/// A linked pair of shaders from the folder `shaders`, which lies beside `resources`.
class Shader {
public:
    /// NotFound names the missing file; Internal holds the compiler's words with the file's name.
    /// @param definitions  lines put before both sources ("#define KIND 3\n"): what is constant there costs nothing per
    ///                     pixel, while a uniform's branches are all computed by software renderers
    static Result<Shader> load(const std::string& vertexFile, const std::string& fragmentFile,
                               const std::string& definitions = {});
    Shader(Shader&& other) noexcept;
    Shader& operator=(Shader&& other) noexcept;
    ~Shader();

    void use() const;
    // Uniforms that the compiler removed are passed over.
    void set(const char* name, int value) const;
    void set(const char* name, bool value) const { set(name, value ? 1 : 0); }
    void set(const char* name, float value) const;
    void set(const char* name, const glm::vec2& value) const;
    void set(const char* name, const glm::vec3& value) const;
    void set(const char* name, const glm::vec4& value) const;
    void set(const char* name, const glm::mat3& value) const;

private:
    Shader() = default;
    unsigned program_ = 0;
};

} // namespace ars
