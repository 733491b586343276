#version 450 core
in vec4 shade;
in vec2 along;
out vec4 color;

uniform sampler2D depth; // camera z of the avatar, 0 where there is none
uniform vec2 pixels;
uniform float behind;    // strength of what lies inside or behind the avatar, [0,1]
uniform float halfWidth;

void main() {
    vec2 screen = vec2(gl_FragCoord.x, pixels.y - gl_FragCoord.y) / pixels;
    float edge = clamp(halfWidth + 0.5 - abs(along.x), 0.0, 1.0);
    float front = texture(depth, screen).r;
    float visible = front > 0.0 && front < along.y ? behind : 1.0;
    color = vec4(shade.rgb, shade.a * edge * visible);
}
