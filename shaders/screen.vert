#version 450 core
// One triangle that covers the viewport. `screen` runs over [0,1]^2 with row 0 of pictures on top.
out vec2 screen;

void main() {
    vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    screen = vec2(corner.x, 1.0 - corner.y);
    gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0);
}
