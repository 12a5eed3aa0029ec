"""What the building is made of: columns, arcades, vaults, walls, balustrades, roofs, floors, each round its origin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from phrt_plugins.loaders import shapes
from phrt_plugins.loaders.atrium_plan import BAY, OPENING, STEP, VAULT, WALL
from phrt_plugins.loaders.shapes import Array, Part, box, lathe, translation

Profile = list[tuple[float, float]]


class Detail:
    """How many segments round things get: `of(n)` is n at detail 1, never below 6, a multiple of 2."""

    def __init__(self, detail: float) -> None:
        self.detail = detail

    def of(self, segments: int) -> int:
        return max(6, 2 * round(segments * self.detail / 2))


def ring_profile(radius: float, low: float, high: float, steps: int = 3) -> Profile:
    """The outer half of a torus moulding between two heights, bulging from `radius`."""
    half = (high - low) / 2
    angle = np.linspace(-np.pi / 2, np.pi / 2, steps)
    return [(radius + half * float(np.cos(a)), low + half + half * float(np.sin(a))) for a in angle]


def fluted_shaft(radius: float, low: float, high: float, flutes: int, detail: Detail) -> Part:
    """A tapering shaft with `flutes` hollows that fade out at both ends."""
    per_flute = 3 if detail.detail >= 0.6 else 2
    height = np.array([low, low + 0.1, (low + high) / 2, high - 0.1, high])
    depth = np.array([0.0, 1.0, 1.0, 1.0, 0.0])
    along = (height - low) / (high - low)
    taper = radius * (1.0 - 0.15 * along**1.6)
    phase = np.arange(flutes * per_flute + 1) % per_flute / per_flute
    hollow = 0.08 * np.sqrt(np.clip(1 - (2 * phase - 1) ** 2, 0, 1))
    return shapes.turned(taper * (1 - hollow[:, None] * depth), height, "limestone", crease_degrees=45.0)


def capital(radius: float, low: float, high: float, width: float, detail: Detail) -> list[Part]:
    """A bell of two rows of leaves under a square abacus."""
    slab = 0.13
    segments = detail.of(18)
    angle = np.arange(segments + 1) % segments / segments * shapes.TAU
    along = np.linspace(0.0, 1.0, 7)
    bell = radius + (width / 2 - radius) * along**2.4
    leaf = np.where(along < 0.5, np.sin(np.pi * along / 0.5), np.sin(np.pi * (along - 0.5) / 0.5))
    wave = np.where(along < 0.5, np.cos(4 * angle)[:, None], -np.cos(4 * angle)[:, None])
    bulge = 0.035 * leaf * (0.6 + 0.4 * wave)
    necking = lathe(
        [(radius, low), *ring_profile(radius, low, low + 0.06), (radius, low + 0.06)], segments, "limestone"
    )
    top = high - slab
    return [
        necking,
        shapes.turned(bell + bulge, low + 0.06 + along * (top - low - 0.06), "limestone", crease_degrees=70.0),
        box("limestone", (width + 0.04, 0.05, width + 0.04), (0, top + 0.025, 0)),
        box("limestone", (width + 0.12, slab - 0.05, width + 0.12), (0, high - (slab - 0.05) / 2, 0)),
    ]


def attic_base(radius: float, low: float, detail: Detail) -> list[Part]:
    """A square plinth, torus, hollow, torus. 0.34 high."""
    segments = detail.of(18)
    y = low + 0.12
    profile: Profile = [(0.0, y - 0.02), (radius * 1.2, y - 0.02), *ring_profile(radius * 1.24, y, y + 0.09)]
    profile += [(radius * 1.2, y + 0.1), (radius * 1.12, y + 0.13), (radius * 1.14, y + 0.15)]
    profile += [*ring_profile(radius * 1.1, y + 0.15, y + 0.21), (radius, y + 0.22)]
    return [
        box("limestone", (radius * 3.0, 0.12, radius * 3.0), (0, low + 0.06, 0)),
        lathe(profile, segments, "limestone"),
    ]


def lower_column(height: float, detail: Detail) -> list[Part]:
    """A fluted column with base and leaf capital; the foot is the origin."""
    radius = 0.23
    return [
        *attic_base(radius, 0.0, detail),
        fluted_shaft(radius, 0.33, height - 0.6, 20, detail),
        *capital(radius * 0.85, height - 0.6, height, 0.52, detail),
    ]


def upper_column(height: float, detail: Detail) -> list[Part]:
    """A plain round column on a pedestal as high as the balustrade."""
    radius, pedestal = 0.17, 0.95
    shaft = [
        (radius * (1 - 0.14 * t**1.6), pedestal + 0.3 + t * (height - pedestal - 0.7)) for t in np.linspace(0, 1, 4)
    ]
    return [
        box("limestone", (0.5, 0.14, 0.5), (0, 0.07, 0)),
        box("limestone", (0.42, pedestal - 0.24, 0.42), (0, pedestal / 2, 0)),
        box("limestone", (0.5, 0.1, 0.5), (0, pedestal - 0.05, 0)),
        *attic_base(radius, pedestal, Detail(detail.detail * 0.7)),
        lathe(shaft, detail.of(18), "marble_white"),
        *capital(radius * 0.86, height - 0.4, height, 0.54, Detail(detail.detail * 0.67)),
    ]


def arcade_arch(height: float, detail: Detail) -> list[Part]:
    """One bay of arcade from the springing upwards: a pierced wall and a stepped archivolt. Origin at the springing."""
    outline, triangles = shapes.arched_outline(BAY, height, OPENING, 0.0, detail.of(14))
    inner, middle, outer = OPENING - 0.04, OPENING + 0.14, OPENING + 0.24
    half, step = WALL / 2 + 0.07, WALL / 2 + 0.035
    profile = [(inner, -half), (inner, half), (middle, half), (middle, step), (outer, step)]
    profile += [(outer, -step), (middle, -step), (middle, -half), (inner, -half)]
    archivolt = shapes.arc_sweep(np.array(profile), detail.of(14), "voussoirs")
    keystone = shapes.prism(
        [
            (-half - 0.05, OPENING - 0.1),
            (half + 0.05, OPENING - 0.1),
            (half + 0.08, outer + 0.1),
            (-half - 0.08, outer + 0.1),
        ],
        0.24,
        "limestone",
    )
    return [shapes.extrude(outline, triangles, WALL, "stone_blocks"), archivolt, keystone]


def groin_vault(spring: float, top: float, detail: Detail) -> list[Part]:
    """One bay's vault with the transverse arch on its -X side; its middle is x = 0, z = -BAY / 2, the floor y = 0."""
    n = detail.of(10)
    turn = np.linspace(-1.0, 1.0, n + 1) * np.pi / 2
    across = VAULT * np.sin(turn)
    x, z = np.meshgrid(across, across, indexing="ij")
    y = spring + VAULT * np.cos(np.minimum(np.abs(turn)[:, None], np.abs(turn)[None, :]))
    web = np.stack([x, y, z], axis=-1)
    middle = (turn[:-1] + turn[1:]) / 2
    flip = middle[:, None] * middle[None, :] < 0
    ceiling = shapes.grid(web, "plaster", uv=np.stack([x, z], axis=-1), crease_degrees=16.0, flip_diagonal=flip)
    parts = [ceiling, *vault_hull(web, top)]
    rib = [(OPENING, -0.2), (OPENING, 0.2), (VAULT + 0.05, 0.2), (VAULT + 0.05, -0.2), (OPENING, -0.2)]
    arch = shapes.arc_sweep(np.array(rib), detail.of(20), "limestone").placed(shapes.turn_y(np.pi / 2))
    parts.append(arch.placed(translation(-BAY / 2, spring, 0)))
    return shapes.placed(parts, translation(0, 0, -BAY / 2))


def vault_hull(web: Array, top: float) -> list[Part]:
    """Sides and floor above a vault's `web` (n, n, 3), which close it to a solid with a level top."""
    rim = np.concatenate([web[:-1, 0], web[-1, :-1], web[:0:-1, -1], web[0, ::-1]])
    above = rim.copy()
    above[:, 1] = top
    sides = shapes.grid(np.stack([rim, above], axis=1)[::-1], "stone_blocks")
    center = np.broadcast_to([0.0, top, 0.0], above.shape)
    floor = shapes.grid(np.stack([above, center], axis=1)[::-1], "gallery_tiles")
    uv = floor.positions[floor.triangles][..., [0, 2]]
    return [sides, replace(floor, corner_uv=uv)]


def wall(height: float, kind: str, detail: Detail) -> list[Part]:
    """One bay of outer wall, `kind` plain, door, niche or window, its inner face at z = -BAY, with a pilaster at -X."""
    parts: list[Part] = []
    back = -BAY - WALL / 2
    if kind == "plain":
        parts.append(box("stone_blocks", (BAY, height, WALL), (0, height / 2, 0)))
    else:
        radius, spring, sill = {"door": (0.72, 2.0, 0.0), "niche": (0.62, 2.3, 0.85), "window": (0.55, 2.2, 1.1)}[kind]
        outline, triangles = shapes.arched_outline(BAY, height, radius, spring, detail.of(12), sill)
        parts.append(shapes.extrude(outline, triangles, WALL, "stone_blocks"))
        parts += opening_frame(radius, spring, sill, detail)
        parts += {"door": door_leaf, "niche": niche_shell, "window": window_bars}[kind](radius, spring, sill, detail)
    parts = shapes.placed(parts, translation(0, 0, back))
    for width, deep, low, high in ((0.42, 0.18, 0.2, 3.22), (0.5, 0.22, 0.0, 0.2), (0.54, 0.31, 3.22, 3.4)):
        high = min(high, height)
        if low < high:
            parts.append(box("limestone", (width, high - low, deep * 2), (-BAY / 2, (low + high) / 2, -BAY)))
    return parts


def opening_frame(radius: float, spring: float, sill: float, detail: Detail) -> list[Part]:
    """A raised stone frame round an arched opening, on the inner face (z = WALL / 2)."""
    face = WALL / 2
    profile = [
        (radius, -face),
        (radius, face + 0.05),
        (radius + 0.16, face + 0.05),
        (radius + 0.16, -face),
        (radius, -face),
    ]
    frame = [shapes.arc_sweep(np.array(profile), detail.of(12), "limestone").placed(translation(0, spring, 0))]
    for sign in (-1, 1):
        frame.append(
            box("limestone", (0.16, spring - sill, 0.2), (sign * (radius + 0.08), (spring + sill) / 2, face - 0.05))
        )
    if sill > 0:
        frame.append(box("limestone", (2 * radius + 0.5, 0.12, 0.3), (0, sill - 0.06, face)))
    return frame


def door_leaf(radius: float, spring: float, sill: float, detail: Detail) -> list[Part]:
    """Two wooden leaves with iron bands, recessed."""
    angle = np.linspace(0.0, np.pi, detail.of(12) + 1)
    arc = np.column_stack([radius * np.cos(angle), spring + radius * np.sin(angle)])
    outline = np.concatenate([[[-radius, sill], [radius, sill]], arc])
    count = len(outline)
    triangles = np.array([(0, i, i + 1) for i in range(1, count - 1)], dtype=np.int64)
    bands = [box("iron", (2 * radius, 0.06, 0.1), (0, y, -0.05)) for y in (0.45, 1.25, 2.0)]
    handles = [shapes.sphere(0.035, 6, "bronze").placed(translation(x, 1.05, 0.03)) for x in (-0.1, 0.1)]
    gap = box("iron", (0.02, spring + radius - sill, 0.085), (0, (spring + radius + sill) / 2, -0.05))
    return [shapes.extrude(outline, triangles, 0.08, "wood").placed(translation(0, 0, -0.05)), gap, *bands, *handles]


def niche_shell(radius: float, spring: float, sill: float, detail: Detail) -> list[Part]:
    """The hollow half cylinder and quarter dome behind a niche's opening, seen from +Z."""
    n = detail.of(12)
    deep = 0.75
    angle = np.linspace(np.pi, 0.0, n + 1)
    lift = np.linspace(0.0, np.pi / 2, n // 2 + 1)
    ring = np.concatenate([[1.0], np.cos(lift)])
    ring[-1] = 0.0
    height = np.concatenate([[sill], spring + radius * np.sin(lift)])
    points = np.stack(
        [
            radius * np.cos(angle)[:, None] * ring,
            np.broadcast_to(height, (n + 1, len(height))),
            WALL / 2 - radius * deep * np.sin(angle)[:, None] * ring - 0.02,
        ],
        axis=-1,
    )
    shelf = box("limestone", (2 * radius, 0.02, WALL), (0, sill + 0.01, -0.02))
    behind = box(
        "stone_blocks", (2 * radius, spring + radius - sill, 0.04), (0, (spring + radius + sill) / 2, -WALL / 2 - 0.02)
    )
    return [shapes.grid(points, "plaster", crease_degrees=60.0), shelf, behind]


def window_bars(radius: float, spring: float, sill: float, detail: Detail) -> list[Part]:
    """An iron lattice in an open window."""
    bars = [
        box("iron", (0.03, spring + radius * 0.95 - sill, 0.03), (x, (spring + radius * 0.95 + sill) / 2, -0.1))
        for x in (-0.2, 0.2)
    ]
    bars += [box("iron", (2 * radius, 0.03, 0.03), (0, y, -0.1)) for y in np.linspace(sill + 0.3, spring, 4)]
    return bars


def balustrade(detail: Detail) -> list[Part]:
    """Rails and turned balusters between two pedestals; origin on the floor in the middle of the bay."""
    clear = BAY - 0.44
    profile = [(0.05, 0.14), (0.065, 0.2), (0.035, 0.27), (0.078, 0.46), (0.035, 0.7), (0.055, 0.81)]
    segments = detail.of(8)
    count = 7
    parts = [
        box("limestone", (clear, 0.14, 0.3), (0, 0.07, 0)),
        box("limestone", (clear, 0.14, 0.34), (0, 0.88, 0)),
    ]
    for i in range(count):
        parts.append(
            lathe(profile, segments, "limestone", 70.0).placed(translation((i + 0.5) / count * clear - clear / 2))
        )
    return parts


def cornice(length: float) -> list[Part]:
    """A moulded band along the courtyard, its top at y = 0.2, its back in the arcade."""
    profile = [
        (0.0, -0.14),
        (WALL / 2 + 0.06, -0.14),
        (WALL / 2 + 0.08, -0.04),
        (WALL / 2 + 0.24, 0.08),
        (WALL / 2 + 0.24, 0.16),
        (0.0, 0.16),
    ]
    dentils = [
        box("limestone", (0.12, 0.1, 0.12), (float(x), -0.02, WALL / 2 + 0.1))
        for x in np.linspace(-length / 2 + 0.5, length / 2 - 0.5, round(length / 0.5))
    ]
    return [shapes.prism(profile, length, "limestone"), *dentils]


def roof(length: float) -> list[Part]:
    """A lean-to roof over one side, mitred at 45 degrees, its eaves in the courtyard; the ceiling below is y = 0."""
    profile = np.array([(0.55, 0.0), (0.55, 0.16), (-BAY - WALL, 1.6), (-BAY - WALL, 0.0)])
    z, y = profile[:, 0], profile[:, 1]
    half = length / 2 - z
    right, left = np.column_stack([half, y, z]), np.column_stack([-half, y, z])
    points = np.concatenate([right, left])
    slope = fan_part(points, [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6)], "terracotta")
    ends = fan_part(points, [(3, 2, 1, 0), (4, 5, 6, 7)], "terracotta")
    under = fan_part(points, [(3, 0, 4, 7)], "wood")
    return [slope, ends, under]


def fan_part(points: Array, quads: list[tuple[int, int, int, int]], material: str) -> Part:
    return Part(material, points, shapes.fan(quads))


def roof_tiles(length: float, detail: Detail) -> list[Part]:
    """Half-round cover tiles up the slope of `roof`, cut at the mitre."""
    segments = max(2, detail.of(6) // 2)
    angle = np.linspace(np.pi, 0.0, segments + 1)
    parts = []
    rise = (1.6 - 0.16) / (BAY + WALL + 0.55)
    for x in np.arange(-length / 2 - BAY, length / 2 + BAY + 0.01, 0.3):
        low_z = min(0.58, length / 2 + 0.1 - abs(float(x)))
        z = np.array([low_z, -BAY - WALL])
        y = 0.16 + rise * (0.55 - z)
        across = np.stack([float(x) + 0.09 * np.cos(angle), 0.08 * np.sin(angle)], axis=-1)
        points = np.stack(
            [np.repeat(across[:, :1], 2, 1), across[:, 1:] + y, np.broadcast_to(z, (segments + 1, 2))], axis=-1
        )
        parts.append(shapes.grid(points, "roof_tile"))
    return parts


def ceiling_beams(length: float) -> list[Part]:
    """Wooden beams across the gallery under a flat ceiling at y = 0."""
    positions = np.linspace(-length / 2 - BAY + 0.5, length / 2 + BAY - 0.5, round((length + 2 * BAY) / 0.75))
    beams = []
    for x in positions:
        inner = min(-WALL / 2, length / 2 - abs(float(x)))
        depth = inner + BAY
        if depth > 0.1:
            beams.append(box("wood", (0.16, 0.2, depth), (float(x), -0.1, inner - depth / 2)))
    return beams


def gallery_floor(length: float, corners: bool) -> list[Part]:
    """The raised ground floor of one side with its stone step; the courtyard's level is y = 0, column line at z = 0."""
    overhang = BAY if corners else 0.4
    width = length + 2 * overhang
    return [
        box("gallery_tiles", (width, STEP, BAY + WALL - 0.4), (0, STEP / 2, -0.4 - (BAY + WALL - 0.4) / 2)),
        box("limestone", (length + (0.8 if corners else -0.8), STEP, 0.8), (0, STEP / 2, 0)),
    ]
