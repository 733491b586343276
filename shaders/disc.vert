#version 450 core
// A surfel as a flat disc: a square of two triangles in its tangent plane, an instance each.
layout(location = 0) in vec3 mean;      // world, metres
layout(location = 1) in vec4 rotation;  // unit quaternion w, x, y, z
layout(location = 2) in vec2 scale;     // standard deviations, metres
layout(location = 3) in vec3 discColor; // linear

uniform mat3 worldToCamera;
uniform vec3 translation;
uniform vec4 focal;     // fx, fy, cx, cy in pixels
uniform vec2 pixels;
uniform float reach;    // rim of the disc, standard deviations
uniform vec2 nearFar;   // metres

out vec2 place;         // on the disc, its rim has length 1
flat out vec3 shade;    // linear, before light
flat out vec3 normal;   // camera space

vec3 turned(vec4 q, vec3 v) { return v + 2.0 * cross(q.yzw, cross(q.yzw, v) + q.x * v); }

void main() {
    place = vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, gl_VertexID < 2 ? -1.0 : 1.0);
    vec2 onPlane = place * scale * reach;
    vec3 p = worldToCamera * (mean + turned(rotation, vec3(onPlane, 0.0))) + translation;
    normal = worldToCamera * turned(rotation, vec3(0.0, 0.0, 1.0));
    shade = discColor;
    // Clip space from the camera's numbers: x_ndc = 2 (fx x / z + cx) / W - 1, row 0 on top.
    float depth = (p.z - nearFar.x) * nearFar.y / (nearFar.y - nearFar.x);
    gl_Position = vec4((focal.x * p.x + focal.z * p.z) / pixels.x * 2.0 - p.z,
                       p.z - (focal.y * p.y + focal.w * p.z) / pixels.y * 2.0, 2.0 * depth - p.z, p.z);
    // One-sided, as splatting is: what turns away is thrown out.
    vec3 center = worldToCamera * mean + translation;
    if (dot(normal, center) >= 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}
