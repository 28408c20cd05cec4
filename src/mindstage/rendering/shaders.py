"""Shaders of the rasterizer: shadow map, ambient occlusion, physically based surfaces, backdrop, numbers of bodies.

Surfaces are illuminated by a sun with soft shadows, by sky light with ambient occlusion, and by lamps, in linear color,
and mapped to sRGB by the shader, so that multisampling blends what the eye sees.
"""

from __future__ import annotations

__all__ = [
    "AMBIENT_OCCLUSION",
    "BACKDROP",
    "BLUR",
    "DEPTH_ONLY",
    "ITEM_COLORS",
    "ITEM_GEOMETRY",
    "ITEM_SHADOWS",
    "MAX_LAMPS",
    "NORMALS",
    "NUMBERS",
    "SURFACE",
]

MAX_LAMPS = 4

_VERSION = "#version 330\n"
_CORNERS = (
    _VERSION
    + """
out vec2 at;  // 0…1 from the lower left corner of the picture
void main() {
    at = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
    gl_Position = vec4(at * 2.0 - 1.0, 1.0, 1.0);
}
"""
)
"""One triangle that covers the picture."""

_POSITIONS = (
    _VERSION
    + """
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 5) in float number;
uniform mat4 clip_from_world;
invariant gl_Position;
out vec3 world_normal;
flat out float body_number;
void main() {
    gl_Position = clip_from_world * vec4(position, 1.0);
    world_normal = normal;
    body_number = number;
}
"""
)

DEPTH_ONLY = (_POSITIONS, _VERSION + "void main() {}\n")
"""Writes depths only."""

NORMALS = (
    _POSITIONS,
    _VERSION
    + """
in vec3 world_normal;
flat in float body_number;
out vec4 color;
void main() { color = vec4(normalize(world_normal), body_number); }
""",
)
"""Writes normals and the numbers of bodies."""

NUMBERS = (
    _POSITIONS,
    _VERSION
    + """
in vec3 world_normal;
flat in float body_number;
out vec4 color;
void main() { color = vec4(body_number, 0.0, 0.0, 1.0); }
""",
)
"""Writes the numbers of bodies."""

_RAY = """
uniform mat3 camera;  // columns: right, up and forward, scaled to the edges of the picture
uniform vec2 rise;  // the lower and the upper edge, per distance
vec3 ray(vec2 at) {
    return camera[0] * (at.x * 2.0 - 1.0) + camera[1] * mix(rise.x, rise.y, at.y) + camera[2];
}
"""

AMBIENT_OCCLUSION = (
    _CORNERS,
    _VERSION
    + _RAY
    + """
// Samples a spiral in the image plane whose size is that of a ball around the pixel, and sums how far each sample rises
// above the tangent plane ("Scalable Ambient Obscurance", McGuire et al. 2012).
in vec2 at;
out vec4 color;
uniform sampler2D depths;
uniform sampler2D normals;
uniform vec2 planes;  // near and far
uniform vec3 eye;
uniform float pixels_per_tangent;
uniform ivec2 size;
const float RADIUS = 0.35;
const int SAMPLES = 16;
float distance_at(ivec2 pixel) {
    float depth = texelFetch(depths, pixel, 0).r;
    return planes.x * planes.y / (planes.y - depth * (planes.y - planes.x));
}
vec3 point_at(ivec2 pixel) {
    return ray((vec2(pixel) + 0.5) / vec2(size)) * distance_at(pixel);
}
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    if (texelFetch(depths, pixel, 0).r >= 1.0) { color = vec4(1.0); return; }
    vec3 point = point_at(pixel);
    vec3 normal = texelFetch(normals, pixel, 0).rgb;
    if (dot(normal, point) > 0.05 * length(point)) normal = -normal;
    float reach = clamp(pixels_per_tangent * RADIUS / distance_at(pixel), 1.0, 60.0);
    float turn = float((pixel.x & 3) * 4 + (pixel.y & 3)) * (6.2831853 / 16.0);
    float total = 0.0;
    for (int number = 0; number < SAMPLES; ++number) {
        float part = (float(number) + 0.5) / float(SAMPLES);
        float angle = turn + part * 6.2831853 * 7.0;
        ivec2 other = clamp(pixel + ivec2(reach * part * vec2(cos(angle), sin(angle))), ivec2(0), size - 1);
        vec3 offset = point_at(other) - point;
        float square = dot(offset, offset);
        float rise = dot(offset, normal) - 0.01;
        total += max(1.0 - square / (RADIUS * RADIUS), 0.0) * max(rise, 0.0) * inversesqrt(square + 1e-4);
    }
    color = vec4(clamp(1.0 - 3.0 * total / float(SAMPLES), 0.0, 1.0));
}
""",
)

BLUR = (
    _CORNERS,
    _VERSION
    + """
// Averages over 4 x 4 pixels of similar depth, which removes the pattern of the samples.
in vec2 at;
out vec4 color;
uniform sampler2D values;
uniform sampler2D depths;
uniform vec2 planes;
uniform ivec2 size;
float distance_at(ivec2 pixel) {
    float depth = texelFetch(depths, pixel, 0).r;
    return planes.x * planes.y / (planes.y - depth * (planes.y - planes.x));
}
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float middle = distance_at(pixel), total = 0.0, weight = 0.0;
    for (int row = -2; row < 2; ++row) {
        for (int column = -2; column < 2; ++column) {
            ivec2 other = clamp(pixel + ivec2(column, row), ivec2(0), size - 1);
            float similar = abs(distance_at(other) - middle) < 0.03 * middle ? 1.0 : 0.0;
            total += similar * texelFetch(values, other, 0).r;
            weight += similar;
        }
    }
    color = vec4(weight > 0.5 ? total / weight : texelFetch(values, pixel, 0).r);
}
""",
)

_BACKDROP_COLOR = """
vec3 backdrop(vec3 direction) {  // a light gray at the horizon, a pale blue above; sRGB
    return mix(vec3(0.905, 0.912, 0.92), vec3(0.74, 0.82, 0.90), clamp(direction.z * 1.6 + 0.12, 0.0, 1.0));
}
"""

BACKDROP = (
    _CORNERS,
    _VERSION
    + _RAY
    + _BACKDROP_COLOR
    + """
in vec2 at;
out vec4 color;
void main() { color = vec4(backdrop(normalize(ray(at))), 1.0); }
""",
)

_TONE_MAPPING = """
// After Narkowicz' fit of the ACES curve, then the curve of sRGB without its linear part.
vec3 tone_mapped(vec3 light) {
    vec3 x = light * 0.72;
    vec3 mapped = clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0);
    return max(1.055 * pow(mapped, vec3(1.0 / 2.4)) - 0.055, 0.0);
}
"""

SURFACE = (
    _VERSION
    + """
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec4 color_factor;
layout(location = 4) in vec4 material_factor;
uniform mat4 clip_from_world;
invariant gl_Position;
out vec3 plane_point;
centroid out vec3 point;
centroid out vec3 vertex_normal;
out vec2 texture_uv;
flat out vec4 base;
flat out vec4 material;
void main() {
    gl_Position = clip_from_world * vec4(position, 1.0);
    plane_point = position;
    point = position;
    vertex_normal = normal;
    texture_uv = uv;
    base = color_factor;
    material = material_factor;
}
""",
    _VERSION
    + f"const int MAX_LAMPS = {MAX_LAMPS};\n"
    + _BACKDROP_COLOR
    + _TONE_MAPPING
    + """
in vec3 plane_point;  // at the center of the pixel, which may be beside the triangle: for derivatives
centroid in vec3 point;
centroid in vec3 vertex_normal;
in vec2 texture_uv;
flat in vec4 base;  // sRGB and opacity
flat in vec4 material;  // roughness, metalness, emission, and 1 for the ground
out vec4 color;

uniform vec3 eye;
uniform vec3 to_sun;
uniform bool is_textured;
uniform bool has_relief;
uniform bool is_cut;
uniform sampler2D color_map;
uniform sampler2D surface_map;  // x and y of the normal, and roughness
uniform sampler2D occlusion_map;
uniform vec2 pixel_size;
uniform sampler2DShadow shadow_map;
uniform sampler2D shadow_depths;
uniform mat4 shadow_from_world;  // x and y in 0…1 over the map, z in meters away from the sun
uniform vec3 shadow_scale;  // extents of the map [m], and of its depths
uniform float shadow_texel;  // [m]
uniform int lamp_count;
uniform vec3 lamp_points[MAX_LAMPS];
uniform vec3 lamp_colors[MAX_LAMPS];
uniform vec4 ground;  // center, height and radius

const vec3 SKY = vec3(0.80, 0.88, 1.0);
const vec3 FLOOR_LIGHT = vec3(0.60, 0.55, 0.50);  // daylight that the floor has reflected
const float AMBIENT = 0.62;
const vec3 SUN = vec3(1.0, 0.94, 0.85) * 1.25;
const float SUN_RADIUS = 0.012;  // [rad], wider than the real one, as behind a thin haze
const float MAX_PENUMBRA = 0.06;  // [m]
const float LAMP_RADIUS = 0.25;  // [m]
const vec2 GROUND_FADE = vec2(1.1, 3.2);  // in radii of the scene
const int SHADOW_TAPS = 12;
const int BLOCKER_TAPS = 6;

vec2 spiral(float number, int count) {
    float angle = number * 2.3999632;
    return sqrt(number / float(count)) * vec2(cos(angle), sin(angle));
}

// The visible part of the sun. Depths are compared with those of the tangent plane at each tap, so that a surface casts
// no shadow on itself whatever its slope; the width of the penumbra grows with the distance of what casts the shadow
// ("Percentage-Closer Soft Shadows", Fernando 2005).
float sunlight(vec3 normal, vec3 face_normal) {
    float slope = clamp(dot(face_normal, to_sun), 0.05, 1.0);
    // Software renderers interpolate at centroids with errors of millimeters, which must not lead into the body.
    vec3 on_plane = point + face_normal * dot(plane_point - point, face_normal);
    vec3 moved = on_plane + normal * shadow_texel * (1.5 * sqrt(1.0 - slope * slope) + 0.25);
    vec3 here = (shadow_from_world * vec4(moved, 1.0)).xyz;
    if (here.x < 0.0 || here.x > 1.0 || here.y < 0.0 || here.y > 1.0) return 1.0;
    vec3 plane = mat3(shadow_from_world) * face_normal;  // scaled, of which only the direction matters
    vec3 side = vec3(plane.xy * shadow_scale.xy, plane.z);
    vec2 gradient = side.xy / min(side.z, -0.05 * length(side));  // [m] per m; z points away from the sun
    gradient = clamp(-gradient, -6.0, 6.0);
    float bias = 0.002 + shadow_texel * 0.5;
    float blockers = 0.0, gap = 0.0;
    for (int number = 0; number < BLOCKER_TAPS; ++number) {
        vec2 offset = spiral(float(number), BLOCKER_TAPS) * MAX_PENUMBRA;
        float depth = texture(shadow_depths, here.xy + offset / shadow_scale.xy).r * shadow_scale.z;
        float above = here.z + dot(gradient, offset) - bias - depth;
        if (above > 0.0) { blockers += 1.0; gap += above; }
    }
    if (blockers < 0.5) return 1.0;
    float reach = clamp(2.0 * SUN_RADIUS * gap / blockers, 0.75 * shadow_texel, MAX_PENUMBRA);
    float seen = 0.0;
    for (int number = 0; number < SHADOW_TAPS; ++number) {
        vec2 offset = spiral(float(number) + 0.5, SHADOW_TAPS) * reach;
        float depth = here.z + dot(gradient, offset) - bias;
        seen += texture(shadow_map, vec3(here.xy + offset / shadow_scale.xy, depth / shadow_scale.z));
    }
    return seen / float(SHADOW_TAPS);
}

// The normal of the relief, in the frame of the texture coordinates at this pixel ("Followup: Normal Mapping Without
// Precomputed Tangents", Schueler 2013).
vec3 relief(vec3 normal, vec2 slope) {
    vec3 dx = dFdx(plane_point), dy = dFdy(plane_point);
    vec2 ux = dFdx(texture_uv), uy = dFdy(texture_uv);
    vec3 across = cross(dy, normal), along = cross(normal, dx);
    vec3 tangent = across * ux.x + along * uy.x, bitangent = across * ux.y + along * uy.y;
    float scale = inversesqrt(max(max(dot(tangent, tangent), dot(bitangent, bitangent)), 1e-20));
    float up = sqrt(max(1.0 - dot(slope, slope), 0.0));
    return normalize((tangent * slope.x + bitangent * slope.y) * scale + normal * up);
}

void main() {
    vec3 toward = normalize(eye - point);
    vec3 normal = normalize(vertex_normal);
    vec3 face = cross(dFdx(plane_point), dFdy(plane_point));
    vec3 face_normal = dot(face, face) > 0.0 ? normalize(face) : normal;
    if (dot(face_normal, toward) < 0.0) face_normal = -face_normal;
    bool is_back = dot(normal, toward) < -0.05;
    if (is_back && is_cut) { color = vec4(vec3(0.09), 1.0); return; }
    if (is_back) normal = -normal;
    vec4 tint = base;
    float roughness = material.x;
    vec3 smooth_normal = normal;
    if (is_textured) tint *= texture(color_map, texture_uv);
    if (has_relief) {
        vec3 surface = texture(surface_map, texture_uv).rgb;
        roughness *= surface.b;
        normal = relief(normal, surface.rg * 2.0 - 1.0);
    }
    vec3 albedo = pow(tint.rgb, vec3(2.2));
    roughness = clamp(roughness, 0.08, 1.0);
    float metalness = material.y;
    float occlusion = texture(occlusion_map, gl_FragCoord.xy * pixel_size).r;

    vec3 light = mix(FLOOR_LIGHT, SKY, (normal.z + 1.0) / 2.0) * (AMBIENT * occlusion);
    float cosine = dot(normal, to_sun);
    float sun = cosine > 0.0 && dot(smooth_normal, to_sun) > 0.0 ? sunlight(smooth_normal, face_normal) : 0.0;
    light += SUN * (max(cosine, 0.0) * sun * (0.55 + 0.45 * occlusion));
    for (int number = 0; number < lamp_count; ++number) {
        vec3 offset = lamp_points[number] - point;
        float square = dot(offset, offset) + LAMP_RADIUS * LAMP_RADIUS;
        light += lamp_colors[number] * (max(dot(normal, offset) * inversesqrt(square), 0.0) / square * occlusion);
    }

    // Fresnel with roughness after Lazarov ("Getting more physical in Call of Duty: Black Ops II", 2013); the room
    // around, blurred by the roughness, has a bright ceiling, walls of medium gray and a darker floor.
    float facing = clamp(dot(normal, toward), 0.02, 1.0);
    vec3 reflectance = mix(vec3(0.04), albedo, metalness);
    float rim = 1.0 - facing;
    float rim_square = rim * rim;
    vec3 grazing = max(vec3(1.0 - roughness), reflectance);
    vec3 fresnel = mix(reflectance, grazing, rim_square * rim_square * rim);
    float up = 2.0 * facing * normal.z - toward.z;
    float room = 0.42 + 0.50 * clamp((up - 0.25) / (0.08 + 0.9 * roughness), -0.6, 1.0);
    float square = roughness * roughness;
    float power = min(2.0 / (square * square), 600.0);
    float glint = (power + 8.0) / 25.0 * pow(max(dot(normal, normalize(toward + to_sun)), 0.0), power);
    glint *= max(cosine, 0.0) * sun;
    vec3 shine = fresnel * (room * (1.0 - 0.55 * roughness * (1.0 - metalness)) + SUN * (min(glint, 4.0) * 0.5));
    vec3 diffuse = albedo * (1.0 - metalness) * light + albedo * (material.z * 1.6);
    shine *= occlusion;

    // Blended with a premultiplied color: a transparent surface reflects as much as an opaque one.
    vec3 opaque = tone_mapped(diffuse + shine);
    vec3 mirrored = tint.a < 0.995 ? tone_mapped(shine) : vec3(0.0);
    if (material.w > 0.5) {
        float radii = length(point.xy - ground.xy) / ground.w;
        opaque = mix(opaque, backdrop(-toward), smoothstep(GROUND_FADE.x, GROUND_FADE.y, radii));
    }
    color = vec4(mix(mirrored, opaque, tint.a), tint.a);
}
""",
)
"""Opaque and transparent surfaces, in the light."""

_ITEMS = (
    _VERSION
    + """
// Vertices are in the frames of items, whose poses are rows of three texels; points are relative to the eye.
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec4 color_factor;
layout(location = 4) in vec4 material_factor;
layout(location = 5) in float number;
uniform sampler2D poses;
uniform mat4 clip_from_eye;
out vec3 point;
out vec3 eye_normal;
out vec2 texture_uv;
flat out vec4 base;
flat out vec4 material;
flat out uint item;
void main() {
    int row = int(number + 0.5);
    ivec2 at = ivec2((row & 4095) * 3, row >> 12);
    vec4 x = texelFetch(poses, at, 0), y = texelFetch(poses, at + ivec2(1, 0), 0);
    vec4 z = texelFetch(poses, at + ivec2(2, 0), 0);
    vec4 local = vec4(position, 1.0);
    point = vec3(dot(x, local), dot(y, local), dot(z, local));
    eye_normal = vec3(dot(x.xyz, normal), dot(y.xyz, normal), dot(z.xyz, normal));
    gl_Position = clip_from_eye * vec4(point, 1.0);
    texture_uv = uv;
    base = color_factor;
    material = material_factor;
    item = uint(row);
}
"""
)

ITEM_SHADOWS = (_ITEMS, _VERSION + "void main() {}\n")
"""Writes depths of items only."""

ITEM_GEOMETRY = (
    _ITEMS,
    _VERSION
    + """
in vec3 point;
in vec3 eye_normal;
flat in uint item;
uniform bool is_facing;
layout(location = 0) out float depth;
layout(location = 1) out uint number;
layout(location = 2) out vec4 normal;
void main() {
    depth = 1.0 / gl_FragCoord.w;
    number = item;
    vec3 unit = normalize(eye_normal);
    normal = vec4(is_facing && dot(unit, point) > 0.0 ? -unit : unit, 0.0);
}
""",
)
"""Writes distances along the axis of the camera, the numbers of items, and normals that face the camera."""

ITEM_COLORS = (
    _ITEMS,
    _VERSION
    + f"const int MAX_LAMPS = {MAX_LAMPS};\n"
    + _TONE_MAPPING
    + """
in vec3 point;
in vec3 eye_normal;
in vec2 texture_uv;
flat in vec4 base;  // sRGB and opacity
flat in vec4 material;  // roughness, metalness, emission
out vec4 color;
uniform bool is_textured;
uniform sampler2D color_map;
uniform sampler2DShadow shadow_map;
uniform mat4 shadow_from_eye;  // x and y in 0…1 over the map, z in meters away from the sun
uniform vec3 shadow_scale;  // extents of the map [m], and of its depths
uniform float shadow_texel;  // [m]
uniform vec3 to_sun;
uniform float sun;
uniform float sky;
uniform int lamp_count;
uniform vec3 lamp_points[MAX_LAMPS];
uniform vec3 lamp_colors[MAX_LAMPS];
const vec3 SKY = vec3(0.80, 0.88, 1.0);
const vec3 FLOOR_LIGHT = vec3(0.60, 0.55, 0.50);
const vec3 SUN = vec3(1.0, 0.94, 0.85);
const float LAMP_RADIUS = 0.25;  // [m]

float sunlight(vec3 normal, float cosine) {
    vec3 moved = point + normal * shadow_texel * (2.0 * sqrt(1.0 - cosine * cosine) + 0.5);
    vec3 here = (shadow_from_eye * vec4(moved, 1.0)).xyz;
    if (here.x < 0.0 || here.x > 1.0 || here.y < 0.0 || here.y > 1.0) return 1.0;
    return texture(shadow_map, vec3(here.xy, (here.z - 0.002 - shadow_texel) / shadow_scale.z));
}

void main() {
    vec3 toward = -normalize(point);
    vec3 normal = normalize(eye_normal);
    if (dot(normal, toward) < 0.0) normal = -normal;
    vec4 tint = base;
    if (is_textured) tint *= texture(color_map, texture_uv);
    vec3 albedo = tint.rgb * tint.rgb * (0.3 * tint.rgb + 0.7);  // near its power 2.2
    float cosine = max(dot(normal, to_sun), 0.0);
    float sun_share = cosine > 0.0 ? sunlight(normal, cosine) : 0.0;
    vec3 light = mix(FLOOR_LIGHT, SKY, (normal.z + 1.0) / 2.0) * sky + SUN * (sun * cosine * sun_share);
    for (int number = 0; number < lamp_count; ++number) {
        vec3 offset = lamp_points[number] - point;
        float square = dot(offset, offset) + LAMP_RADIUS * LAMP_RADIUS;
        light += lamp_colors[number] * (max(dot(normal, offset) * inversesqrt(square), 0.0) / square);
    }
    float square = max(material.x * material.x, 0.0064);
    float power = min(2.0 / (square * square), 600.0);
    float glint = (power + 8.0) / 25.0 * pow(max(dot(normal, normalize(toward + to_sun)), 0.0), power);
    vec3 reflectance = mix(vec3(0.04), albedo, material.y);
    vec3 shine = reflectance * (sky * (0.5 + 0.5 * normal.z) + SUN * (sun * cosine * sun_share * min(glint, 4.0)));
    vec3 diffuse = albedo * (1.0 - 0.8 * material.y) * light + albedo * (material.z * 1.6);
    vec3 opaque = tone_mapped(diffuse + shine);
    color = vec4(opaque * tint.a, tint.a);
}
""",
)
"""Items in simple light: a sun with hard shadows, the sky, and lamps."""
