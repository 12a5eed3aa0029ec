"""The conventions every module keeps, stated once.

- Space: right-handed, Y up; a camera looks down its own -Z; metres and seconds.
- Matrices: 4x4, float64 in scene description, float32 in kernels, column vectors (`world = matrix @ local`), the
  translation in the last column.
- Colour: linear Rec.709 RGB, float32, everywhere inside; sRGB only in texture files and in 8-bit output.
- Lights: point, spot and sphere lights in candela, directional lights in lux, rect lights and domes in nits (cd/m2);
  a camera's `exposure` multiplies the linear image.
- Images: row-major, pixel (0, 0) top-left, pixel centres at +0.5; `(H, W, C)`.
- `depth`: linear view-space distance along -Z in metres, +inf for background.
- Normals: world space, unit length. Rays: unit directions; a miss is t = +inf and primitive = `NO_PRIMITIVE`.
- Ids: uint32; object 0 is the background, so scene objects count from 1; material 0 is the default material.
"""

from __future__ import annotations

import numpy as np

NO_PRIMITIVE = np.uint32(0xFFFFFFFF)
"""Primitive id of a ray that hit nothing."""

DEFAULT_NEAR = 0.01
"""Near plane in metres, where a camera names none."""

RAY_BIAS = 1e-4
"""Ray origins leave a surface by this much times the largest coordinate of the origin (at least 1), along the geometric normal."""
