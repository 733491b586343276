#version 450 core
// A thick line from camera space to the screen: two triangles an instance.
layout(location = 0) in vec3 begin; // camera space
layout(location = 1) in vec3 end;
layout(location = 2) in vec4 lineColor;
layout(location = 3) in float widthPixels;

uniform vec4 focal;    // fx, fy, cx, cy in pixels
uniform vec2 pixels;   // size of the picture

out vec4 shade;
out vec2 along;        // across the line in [-1,1]; camera z

const float kNear = 0.01;

vec2 project(vec3 p) { return focal.xy * p.xy / p.z + focal.zw; }

void main() {
    vec3 a = begin, b = end;
    shade = lineColor;
    if (a.z < kNear && b.z < kNear) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
    if (a.z < kNear) a = mix(a, b, (kNear - a.z) / (b.z - a.z));
    if (b.z < kNear) b = mix(b, a, (kNear - b.z) / (a.z - b.z));
    vec2 pa = project(a), pb = project(b);
    vec2 step = pb - pa;
    vec2 direction = length(step) > 1e-4 ? normalize(step) : vec2(1.0, 0.0);
    vec2 side = vec2(-direction.y, direction.x);
    bool atEnd = gl_VertexID >= 2;
    float across = (gl_VertexID & 1) == 0 ? -1.0 : 1.0;
    float half_ = 0.5 * widthPixels + 1.0;
    vec2 p = (atEnd ? pb + direction * half_ : pa - direction * half_) + side * across * half_;
    along = vec2(across * half_, atEnd ? b.z : a.z);
    gl_Position = vec4(p.x / pixels.x * 2.0 - 1.0, 1.0 - p.y / pixels.y * 2.0, 0.0, 1.0);
}
