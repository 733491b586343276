#version 450 core
// How far two pictures that are shown differ, as colours of a map.
in vec2 screen;
out vec4 color;

uniform sampler2D first;
uniform sampler2D second;
uniform sampler1D colorMap; // sRGB-encoded
uniform bool squared;       // else absolute
uniform float maximum;      // error that has the map's last colour

void main() {
    // Targets have row 0 at the bottom.
    vec2 place = vec2(screen.x, 1.0 - screen.y);
    vec3 d = texture(first, place).rgb - texture(second, place).rgb;
    vec3 e = squared ? d * d : abs(d);
    float t = clamp((e.r + e.g + e.b) / (3.0 * maximum), 0.0, 1.0);
    float size = float(textureSize(colorMap, 0));
    color = vec4(texture(colorMap, t * ((size - 1.0) / size) + 0.5 / size).rgb, 1.0);
}
