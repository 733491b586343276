#version 450 core
// Shows one buffer: light through the tone curve, data through its colour map, over a background.
// Tone curves and colour maps come as tables made by the engine, so that their maths stands there alone.
// KIND (BufferKind; -1: the background alone), PREMULTIPLIED, TONE and BACKGROUND (0 colour, 1 checkerboard,
// 2 environment) are defined when it is compiled.
in vec2 screen;
out vec4 color;

uniform sampler2D picture;
uniform sampler2D opacity;
uniform sampler1D colorMap;    // sRGB-encoded
uniform sampler1D srgbTable;   // over sqrt(linear), linear in [0,1]
uniform sampler3D toneTable;   // over the shaper below, display-linear
uniform sampler2D environment; // lat-long, linear

uniform vec2 range;            // minimum, maximum of Scalar and Place
uniform float exposure;        // factor
uniform vec2 shaper;           // log2 of the least and the largest value in the table
uniform vec3 backgroundLinear;
uniform vec3 backgroundShown;  // the same, sRGB-encoded
uniform mat3 screenToEnvironment; // (screen.xy, 1) to a direction in the environment's axes
uniform float environmentScale;
uniform float environmentLod;
uniform vec2 pixels;           // of the viewport

const float kPi = 3.14159265358979;

vec3 tableCoordinates(vec3 t, float size) { return t * ((size - 1.0) / size) + 0.5 / size; }

vec3 encode(vec3 linear) {
    float size = float(textureSize(srgbTable, 0));
    vec3 t = tableCoordinates(sqrt(clamp(linear, 0.0, 1.0)), size);
    return vec3(texture(srgbTable, t.r).r, texture(srgbTable, t.g).r, texture(srgbTable, t.b).r);
}

// Scene light to display light, linear.
vec3 tone(vec3 linear) {
    vec3 exposed = max(linear * exposure, 0.0);
    if (TONE == 0) return min(exposed, 1.0);
    vec3 t = (log2(exposed + exp2(shaper.x)) - shaper.x) / (shaper.y - shaper.x);
    return texture(toneTable, tableCoordinates(clamp(t, 0.0, 1.0), float(textureSize(toneTable, 0).x))).rgb;
}

vec3 backgroundColor() {
    if (BACKGROUND == 1) {
        ivec2 cell = ivec2(screen * pixels) / 12;
        return vec3(((cell.x + cell.y) & 1) == 0 ? 0.030 : 0.016);
    }
    if (BACKGROUND == 2) {
        vec3 d = normalize(screenToEnvironment * vec3(screen, 1.0));
        vec2 uv = vec2(0.5 - atan(d.x, d.z) / (2.0 * kPi), acos(clamp(d.y, -1.0, 1.0)) / kPi);
        // The derivative of u jumps where the picture closes; a fixed level has no seam.
        return textureLod(environment, uv, environmentLod).rgb * environmentScale;
    }
    return backgroundLinear;
}

void main() {
    vec3 back = backgroundColor();
    if (KIND < 0) {
        color = vec4(BACKGROUND == 0 ? backgroundShown : encode(BACKGROUND == 2 ? tone(back) : back), 1.0);
        return;
    }
    vec4 value = texture(picture, screen);
    float covered = texture(opacity, screen).r;
    if (KIND == 0) {
        vec3 light = PREMULTIPLIED == 1 ? value.rgb : value.rgb * covered;
        // The environment is light and goes through the curve with the avatar; a chosen colour stays as chosen.
        vec3 shownLight = BACKGROUND == 2 ? tone(light + (1.0 - covered) * back)
                                          : tone(light / max(covered, 1e-6)) * covered + (1.0 - covered) * back;
        color = vec4(encode(shownLight), 1.0);
        return;
    }
    vec3 shown;
    if (KIND == 1) shown = encode(value.rgb);
    else if (KIND == 2) shown = value.rgb;
    else if (KIND == 3) shown = vec3(0.5 + 0.5 * value.x, 0.5 - 0.5 * value.y, 0.5 - 0.5 * value.z);
    else if (KIND == 4) shown = (value.rgb - range.x) / (range.y - range.x);
    else {
        float t = clamp((value.r - range.x) / (range.y - range.x), 0.0, 1.0);
        float size = float(textureSize(colorMap, 0));
        shown = isnan(value.r) ? vec3(1.0, 0.0, 1.0) : texture(colorMap, t * ((size - 1.0) / size) + 0.5 / size).rgb;
    }
    vec3 behind = BACKGROUND == 0 ? backgroundShown : encode(BACKGROUND == 2 ? tone(back) : back);
    color = vec4(mix(behind, clamp(shown, 0.0, 1.0), clamp(covered, 0.0, 1.0)), 1.0);
}
