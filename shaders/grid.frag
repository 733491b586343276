#version 450 core
// The floor y = 0 as a grid of metres and tenths, hidden by the avatar and fading with distance.
in vec2 screen;
out vec4 color;

uniform sampler2D depth;          // camera z of the avatar, 0 where there is none
uniform mat3 screenToWorld;       // (screen.xy, 1) to a world direction whose camera z is 1
uniform vec3 eye;
uniform vec3 gridColor;           // sRGB-encoded
uniform vec3 xColor;
uniform vec3 zColor;

float lines(vec2 place, float spacing) {
    vec2 cells = place / spacing;
    vec2 width = fwidth(cells);
    vec2 distance = abs(fract(cells - 0.5) - 0.5) / max(width, 1e-6);
    // Lines closer than a few pixels would shimmer: they fade away.
    float visible = 1.0 - smoothstep(0.15, 0.5, max(width.x, width.y));
    return (1.0 - clamp(min(distance.x, distance.y), 0.0, 1.0)) * visible;
}

void main() {
    vec3 direction = screenToWorld * vec3(screen, 1.0);
    float t = -eye.y / direction.y; // camera z of the floor
    vec2 place = eye.xz + t * direction.xz;
    float strength = 0.55 * lines(place, 1.0) + 0.25 * lines(place, 0.1);
    vec2 axis = abs(place) / max(fwidth(place), vec2(1e-6));
    vec3 shown = gridColor;
    if (axis.y < 1.0) { shown = xColor; strength = max(strength, 0.8 * (1.0 - axis.y)); }
    if (axis.x < 1.0) { shown = zColor; strength = max(strength, 0.8 * (1.0 - axis.x)); }
    float hidden = texture(depth, screen).r;
    if (!(t > 0.0) || (hidden > 0.0 && hidden < t)) strength = 0.0;
    strength *= exp(-0.12 * length(place)) * smoothstep(0.0, 0.04, abs(direction.y));
    color = vec4(shown, strength);
}
