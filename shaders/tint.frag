#version 450 core
// Lays one colour, or the colours of a picture, over what is drawn already: body parts, the limb under the cursor.
in vec2 screen;
out vec4 color;

uniform sampler2D picture;  // sRGB-encoded; of FROM_MASK its red is the strength
uniform sampler2D opacity;
uniform vec4 tint;          // FROM_MASK: the colour; else alpha alone counts

void main() {
#ifdef FROM_MASK
    color = vec4(tint.rgb, tint.a * texture(picture, vec2(screen.x, 1.0 - screen.y)).r * clamp(texture(opacity, screen).r, 0.0, 1.0));
#else
    color = vec4(texture(picture, screen).rgb, tint.a * clamp(texture(opacity, screen).r, 0.0, 1.0));
#endif
}
