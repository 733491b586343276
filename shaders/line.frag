#version 450 core
in vec4 shade;
in vec2 along;
out vec4 color;

uniform sampler2D depth; // camera z of the avatar, 0 where there is none
uniform vec2 pixels;
uniform float behind;    // strength of what lies inside or behind the avatar, [0,1]
uniform float halfWidth;
uniform bool premultiplied; // for targets that take the largest instead of blending
uniform float bias;      // how far behind the avatar still counts as before it, metres

void main() {
    vec2 screen = vec2(gl_FragCoord.x, pixels.y - gl_FragCoord.y) / pixels;
    float edge = clamp(halfWidth + 0.5 - abs(along.x), 0.0, 1.0);
    float front = texture(depth, screen).r;
    float visible = front > 0.0 && front < along.y - bias ? behind : 1.0;
    float alpha = shade.a * edge * visible;
    color = vec4(premultiplied ? shade.rgb * alpha : shade.rgb, alpha);
}
