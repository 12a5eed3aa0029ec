"""From what the rasterizer drew to channels: points and codes, folded normals. A pass over the picture each.

Arrays of channels that were not asked for are given with length 0 and left alone.
"""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import kernel
from phrt_backends.gbuffers.moderngl_layout import CODE_TAG

f32 = np.float32
CODE_BITS = np.uint32(CODE_TAG - 1)


@kernel
def resolve_points(
    packed, bits, eye, forward, row_object, row_primitive, row_material, code_normal,
    position, depth, object_id, primitive_id, material_id, normal,
):  # fmt: skip
    """packed (n, 4) float32: position, code; bits: the same memory as uint32; eye, forward (3,) float32.

    row_* (T + 1,) uint32 and code_normal (2 T + 2, 3) float32: what a code means, the background first.
    """
    for i in range(len(packed)):
        code = bits[i, 3] & CODE_BITS
        row = code >> np.uint32(1)
        x, y, z = packed[i, 0], packed[i, 1], packed[i, 2]
        if len(position):
            position[i, 0], position[i, 1], position[i, 2] = x, y, z
        if len(depth):
            along = (x - eye[0]) * forward[0] + (y - eye[1]) * forward[1] + (z - eye[2]) * forward[2]
            depth[i] = along if code else f32(np.inf)
        if len(object_id):
            object_id[i] = row_object[row]
        if len(primitive_id):
            primitive_id[i] = row_primitive[row]
        if len(material_id):
            material_id[i] = row_material[row]
        if len(normal):
            normal[i, 0], normal[i, 1], normal[i, 2] = code_normal[code, 0], code_normal[code, 1], code_normal[code, 2]


@kernel
def resolve_normals(packed, bits, normal, uv):
    """packed (n, 4) float32: folded normal, uv; bits (n, 4) uint32: the `point` attachment; code 0 is background."""
    for i in range(len(packed)):
        if len(uv):
            uv[i, 0], uv[i, 1] = packed[i, 2], packed[i, 3]
        if len(normal):
            x, y = packed[i, 0], packed[i, 1]
            z = f32(1.0) - abs(x) - abs(y)
            if z < f32(0.0):
                x, y = math.copysign(f32(1.0) - abs(y), x), math.copysign(f32(1.0) - abs(x), y)
            scale = f32(1.0) / math.sqrt(x * x + y * y + z * z)
            if bits[i, 3] == 0:
                scale = f32(0.0)
            normal[i, 0], normal[i, 1], normal[i, 2] = x * scale, y * scale, z * scale


@kernel
def resolve_constants(material_id, values, out):
    """out (n, m) float32: values (materials, m) of each pixel's material."""
    for i in range(len(material_id)):
        for k in range(out.shape[1]):
            out[i, k] = values[material_id[i], k]
