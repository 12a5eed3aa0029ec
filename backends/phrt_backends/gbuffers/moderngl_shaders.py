"""GLSL of the deferred pass. One source; `#define`s say which features a material needs, and the compiler drops
what the requested channels do not use."""

from __future__ import annotations

from phrt_backends.gbuffers.moderngl_layout import CODE_TAG, Layout, output_declarations, output_statements

SAMPLERS = {
    "base_color_texture": "BASE_COLOR_MAP",
    "metallic_roughness_texture": "METALLIC_ROUGHNESS_MAP",
    "normal_texture": "NORMAL_MAP",
    "emissive_texture": "EMISSIVE_MAP",
    "transmission_texture": "TRANSMISSION_MAP",
    "occlusion_texture": "OCCLUSION_MAP",
}
"""Texture slots in the order of their texture units and of `uv_rows`; each is drawn when its feature is defined."""

VERTEX = """#version 330 core
{defines}
uniform mat4 clip_from_world;
uniform vec4 depth_row;
in vec3 in_position;
in vec3 in_normal;
in vec2 in_uv0;
in uint in_row;
out vec3 v_position;
out vec3 v_normal;
out vec2 v_uv0;
flat out uint v_row;
#ifdef ORTHOGRAPHIC
out float v_depth;
#endif
#ifdef UV1
in vec2 in_uv1;
out vec2 v_uv1;
#endif
#ifdef COLORS
in vec4 in_color;
out vec4 v_color;
#endif
#ifdef NORMAL_MAP
in vec4 in_tangent;
out vec3 v_tangent;
flat out float v_hand;
#endif

void main() {{
    gl_Position = clip_from_world * vec4(in_position, 1.0);
    v_position = in_position;
    v_normal = in_normal;
    v_uv0 = in_uv0;
    v_row = in_row;
#ifdef ORTHOGRAPHIC
    v_depth = dot(depth_row, vec4(in_position, 1.0));
#endif
#ifdef UV1
    v_uv1 = in_uv1;
#endif
#ifdef COLORS
    v_color = in_color;
#endif
#ifdef NORMAL_MAP
    v_tangent = in_tangent.xyz;
    v_hand = in_tangent.w;
#endif
}}
"""

FRAGMENT = """#version 330 core
{defines}
layout(std140) uniform Material {{
    vec4 base_color;             // linear, with alpha
    vec4 emissive_and_cutoff;    // nits; alpha cut-off
    vec4 factors;                // metallic, roughness, transmission, normal scale
    vec4 uv_rows[12];            // a slot: (m00, m01, m02, uv set), (m10, m11, m12, mirrored s + 2 * mirrored t)
    vec4 more;                   // occlusion strength
}} material;

uniform sampler2D base_color_texture;
uniform sampler2D metallic_roughness_texture;
uniform sampler2D normal_texture;
uniform sampler2D emissive_texture;
uniform sampler2D transmission_texture;
uniform sampler2D occlusion_texture;

in vec3 v_position;
in vec3 v_normal;
in vec2 v_uv0;
flat in uint v_row;
#ifdef ORTHOGRAPHIC
in float v_depth;
#endif
#ifdef UV1
in vec2 v_uv1;
#endif
#ifdef COLORS
in vec4 v_color;
#endif
#ifdef NORMAL_MAP
in vec3 v_tangent;
flat in float v_hand;
#endif

{outputs}

float inverse_depth() {{
#ifdef ORTHOGRAPHIC
    return 1.0 / v_depth;
#else
    return gl_FragCoord.w;
#endif
}}

vec2 coordinates(int slot) {{
    vec4 s = material.uv_rows[2 * slot], t = material.uv_rows[2 * slot + 1];
#ifdef UV1
    vec2 uv = s.w > 0.5 ? v_uv1 : v_uv0;
#else
    vec2 uv = v_uv0;
#endif
#ifdef UV_TRANSFORM
    uv = vec2(dot(s.xy, uv) + s.z, dot(t.xy, uv) + t.z);
#endif
    return uv;
}}

vec4 look_up(sampler2D map, int slot) {{
    vec2 uv = coordinates(slot);
#ifdef UV_MIRROR
    // Folded by hand, with the slopes of the unfolded coordinates, as no sampler of ours mirrors.
    vec2 dx = dFdx(uv), dy = dFdy(uv);
    float mirrored = material.uv_rows[2 * slot + 1].w;
    if (mirrored == 1.0 || mirrored == 3.0) uv.x = 1.0 - abs(mod(uv.x, 2.0) - 1.0);
    if (mirrored >= 2.0) uv.y = 1.0 - abs(mod(uv.y, 2.0) - 1.0);
    return textureGrad(map, uv, dx, dy);
#else
    return texture(map, uv);
#endif
}}

float tagged_code() {{
    return uintBitsToFloat({code_tag}u + (v_row + 1u) * 2u + (gl_FrontFacing ? 0u : 1u));
}}

void main() {{
    // Base colour and coverage; an alpha mask's holes are not there.
    vec4 color = material.base_color;
#ifdef BASE_COLOR_MAP
    color *= look_up(base_color_texture, 0);
#endif
#ifdef COLORS
    color *= v_color;
#endif
#ifdef ALPHA_MASK
    if (color.a < material.emissive_and_cutoff.a) discard;
#endif
    vec3 base = color.rgb;
#ifdef ALPHA_BLEND
    float alpha = color.a;
#else
    float alpha = 1.0;
#endif

    // Shading normal, on the side of the eye.
    vec3 normal = v_normal;
#ifdef NORMAL_MAP
    if (dot(v_tangent, v_tangent) > 0.0) {{
        vec3 bent = look_up(normal_texture, 2).xyz * 2.0 - 1.0;
        bent.xy *= material.factors.w;
        normal = v_tangent * bent.x + cross(normal, v_tangent) * (v_hand * bent.y) + normal * bent.z;
    }}
#endif
    normal *= inversesqrt(max(dot(normal, normal), 1e-30)) * (gl_FrontFacing ? 1.0 : -1.0);

    // The other material values.
    float metallic = material.factors.x, roughness = material.factors.y, transmission = material.factors.z;
#ifdef METALLIC_ROUGHNESS_MAP
    vec4 rough_metal = look_up(metallic_roughness_texture, 1);
    roughness *= rough_metal.g;
    metallic *= rough_metal.b;
#endif
#ifdef TRANSMISSION_MAP
    transmission *= look_up(transmission_texture, 4).r;
#endif
    float occlusion = 1.0;
#ifdef OCCLUSION_MAP
    occlusion += material.more.x * (look_up(occlusion_texture, 5).r - 1.0);
#endif
    vec3 emissive = material.emissive_and_cutoff.rgb;
#ifdef EMISSIVE_MAP
    emissive *= look_up(emissive_texture, 3).rgb;
#endif
#ifdef UNLIT
    emissive = base;
#endif

    // The unit sphere folded onto a square.
    vec2 folded = normal.xy / (abs(normal.x) + abs(normal.y) + abs(normal.z));
    if (normal.z < 0.0) {{
        folded = (1.0 - abs(folded.yx)) * vec2(folded.x < 0.0 ? -1.0 : 1.0, folded.y < 0.0 ? -1.0 : 1.0);
    }}

{statements}
}}
"""


def vertex_source(features: frozenset[str]) -> str:
    """GLSL of the vertex shader with `features` defined."""
    return VERTEX.format(defines=_defines(features))


def fragment_source(features: frozenset[str], layout: Layout) -> str:
    """GLSL of the fragment shader with `features` defined, writing the attachments of `layout`."""
    return FRAGMENT.format(
        defines=_defines(features),
        code_tag=CODE_TAG,
        outputs=output_declarations(layout),
        statements=output_statements(layout),
    )


def _defines(features: frozenset[str]) -> str:
    return "\n".join(f"#define {feature}" for feature in sorted(features))
