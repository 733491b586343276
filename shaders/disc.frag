#version 450 core
// Opaque, lit from beside the camera so that neighbours can be told apart.
in vec2 place;
flat in vec3 shade;
flat in vec3 normal;
out vec4 color;

uniform vec3 light;    // camera space, unit length, towards the light
uniform float ambient; // [0, 1]

vec3 encode(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0);
    return mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThanEqual(x, vec3(0.0031308)));
}

void main() {
    float r = dot(place, place);
    if (r > 1.0) discard;
    float lit = ambient + (1.0 - ambient) * max(dot(normal, light), 0.0);
    // A darker rim shows where one disc ends.
    float rim = 1.0 - 0.35 * smoothstep(0.72, 1.0, r);
    color = vec4(encode(shade * lit * rim), 1.0);
}
