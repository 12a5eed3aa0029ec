"""What stands and hangs in the atrium: fountain, vases, plants, drapes, lanterns, each round its own origin."""

from __future__ import annotations

import numpy as np

from phrt_plugins.loaders import shapes
from phrt_plugins.loaders.atrium_architecture import Detail, ring_profile
from phrt_plugins.loaders.shapes import TAU, Array, Part, box, lathe, smooth_path, translation


def fountain_basin(detail: Detail) -> list[Part]:
    """A round basin with a moulded rim, 1.5 m across the radius."""
    profile = [(0.0, 0.0), (1.56, 0.0), (1.56, 0.08), (1.42, 0.12), (1.36, 0.2), (1.36, 0.34), (1.42, 0.42)]
    profile += [*ring_profile(1.46, 0.42, 0.54), (1.28, 0.54), (1.24, 0.5), (1.22, 0.14), (0.0, 0.14)]
    return [lathe(profile, detail.of(64), "marble_white", 40.0)]


def fountain_water(detail: Detail) -> list[Part]:
    """The still water of the basin."""
    return [lathe([(0.0, 0.2), (1.23, 0.2), (1.23, 0.42), (0.0, 0.42)], detail.of(64), "water", 40.0)]


def fountain_bowl(detail: Detail) -> list[Part]:
    """The stem and upper bowl, with a bronze ball."""
    profile = [
        (0.0, 0.1),
        (0.34, 0.1),
        (0.34, 0.2),
        (0.22, 0.3),
        (0.13, 0.42),
        (0.11, 0.62),
        (0.17, 0.76),
        (0.1, 0.9),
        (0.1, 1.02),
    ]
    profile += [
        (0.2, 1.08),
        (0.45, 1.16),
        (0.62, 1.28),
        (0.68, 1.38),
        (0.7, 1.42),
        (0.64, 1.42),
        (0.6, 1.36),
        (0.4, 1.24),
        (0.0, 1.2),
    ]
    water = lathe([(0.0, 1.22), (0.61, 1.22), (0.61, 1.385), (0.0, 1.385)], detail.of(32), "water", 40.0)
    stem = lathe(
        [(0, 1.2), (0.08, 1.2), (0.05, 1.4), (0.09, 1.5), (0.05, 1.56), (0, 1.56)], detail.of(20), "marble_white"
    )
    ball = shapes.sphere(0.16, detail.of(24), "gold").placed(translation(0, 1.69, 0))
    return [lathe(profile, detail.of(32), "marble_white", 45.0), water, stem, ball]


def vase(detail: Detail, slim: bool) -> list[Part]:
    """A turned terracotta jar, or a slim marble urn."""
    if slim:
        belly = [(0.06, 0.12), (0.07, 0.18), (0.2, 0.38), (0.24, 0.58), (0.17, 0.74), (0.09, 0.84)]
        foot, rim = [(0, 0), (0.15, 0), (0.15, 0.05)], [(0.16, 0.95), (0.13, 0.95), (0.06, 0.86), (0, 0.85)]
    else:
        belly = [(0.22, 0.04), (0.34, 0.28), (0.38, 0.46), (0.33, 0.64), (0.25, 0.72)]
        foot, rim = [(0, 0), (0.2, 0)], [(0.31, 0.8), (0.31, 0.84), (0.26, 0.84), (0.2, 0.74), (0, 0.72)]
    line = np.column_stack([np.array(belly), np.zeros(len(belly))])
    curve = smooth_path(line, 9)[:, :2]
    profile = np.concatenate([np.array(foot, dtype=np.float64), curve, np.array(rim, dtype=np.float64)])
    return [lathe(profile, detail.of(14), "marble_white" if slim else "terracotta", 50.0)]


def potted_plant(detail: Detail, random: np.random.Generator) -> list[Part]:
    """An agave in a terracotta pot: arching leaves with a fold along the middle."""
    pot = [(0, 0), (0.22, 0), (0.3, 0.36), (0.34, 0.36), (0.34, 0.44), (0.28, 0.44), (0.26, 0.38), (0.0, 0.38)]
    earth = lathe([(0.0, 0.36), (0.27, 0.36), (0.27, 0.4), (0.0, 0.4)], detail.of(20), "earth", 40.0)
    parts = [lathe(pot, detail.of(24), "terracotta", 40.0), earth]
    steps = np.linspace(0.0, 1.0, 7)
    for leaf in range(22):
        turn, rise = leaf * 2.39996 + random.uniform(-0.2, 0.2), 1.35 - 1.1 * (leaf / 22) ** 1.3
        length = random.uniform(0.65, 0.95)
        bend = rise - 1.1 * steps * (1.2 - rise / 1.6)
        step = length / 6
        out = 0.04 + np.concatenate([[0.0], np.cumsum(np.cos(bend[:-1]) * step)])
        up = 0.4 + np.concatenate([[0.0], np.cumsum(np.sin(bend[:-1]) * step)])
        width = 0.065 * np.sqrt(np.clip(np.sin(np.pi * (0.12 + 0.88 * steps)), 0.0, 1.0))
        width[-1] = 0.0
        across = np.array([-1.0, 0.0, 1.0])[:, None] * width
        fold = np.array([0.4, 0.0, 0.4])[:, None] * width
        blade = np.stack([across, up + fold, np.broadcast_to(out, across.shape)], axis=-1)
        parts.append(shapes.grid(blade[::-1], "leaf", crease_degrees=20.0).placed(shapes.turn_y(turn)))
    return parts


def curtain(detail: Detail, dye: str, random: np.random.Generator, side: float) -> list[Part]:
    """Half a curtain tied back to one side of an arch: rod at y = 0, the cloth falls 3 m. `side` -1 left, 1 right."""
    n, m = detail.of(28), detail.of(10)
    u, v = np.linspace(0.0, 1.0, n + 1)[:, None], np.linspace(0.0, 1.0, m + 1)[None, :]
    tie = np.exp(-(((v - 0.62) / 0.2) ** 2))
    spread = 1.08 * (1 - 0.78 * tie) * (1 - 0.25 * v)
    x = 1.18 - spread * (1 - u) - 0.04 * tie
    phase, folds = random.uniform(0, TAU), 5.0
    amplitude = 0.05 + 0.035 * v - 0.02 * tie
    z = amplitude * np.sin(TAU * folds * u + phase + 0.5 * np.sin(3 * v + phase)) + 0.02 * np.sin(9 * v + 5 * u)
    y = -2.95 * v - 0.12 * (1 - u) * np.sin(np.pi * np.clip(v / 0.62, 0, 1)) * (v < 0.62)
    shape = np.broadcast_shapes(x.shape, y.shape, z.shape)
    points = np.stack([np.broadcast_to(side * x, shape), np.broadcast_to(y, shape), z], axis=-1)
    uv = np.stack([np.broadcast_to(u * 1.9, shape), np.broadcast_to(v * 2.95, shape)], axis=-1)
    if side < 0:
        points, uv = points[::-1], uv[::-1]
    cloth = shapes.grid(points[:, ::-1], dye, uv=uv[:, ::-1], crease_degrees=75.0)
    tie_y = -2.95 * 0.62
    band = shapes.tube(ellipse(0.16, 0.1, 12) + np.array([side * 1.03, tie_y, 0.0]), 0.025, 6, "bronze", closed=True)
    return [cloth, band]


def curtain_rod() -> list[Part]:
    """A bronze rod across an arch at y = 0 with knobs and rings."""
    rod = shapes.tube(np.array([(-1.22, 0.0, 0.0), (0.0, 0.0, 0.0), (1.22, 0.0, 0.0)]), 0.022, 8, "bronze")
    return [rod, *(shapes.sphere(0.045, 10, "bronze").placed(translation(x)) for x in (-1.2, 1.2))]


def banner(detail: Detail, dye: str, random: np.random.Generator) -> list[Part]:
    """A cloth 1.5 m wide laid over a rail (top at y = 0, middle z = 0), falling in front of the cornice."""
    n, m = detail.of(20), detail.of(10)
    fall = np.array(
        [(0.02, -0.19), (0.02, 0.0), (0.02, 0.19), (-0.06, 0.225), (-0.2, 0.25), (-0.95, 0.52), (-1.25, 0.57)]
    )
    hang = np.column_stack([np.linspace(-1.25, -3.2, m + 1)[1:], np.linspace(0.57, 0.5, m + 1)[1:]])
    line = np.concatenate([fall, hang])
    u = np.linspace(-1.0, 1.0, n + 1)[:, None]
    loose = np.clip((-line[:, 0] - 0.2) / 2.5, 0.0, 1.0)
    phase = random.uniform(0, TAU)
    wave = 0.05 * np.sin(3.5 * np.pi * u + phase) + 0.04 * np.sin(2.4 * loose + phase + u)
    x = 0.75 * u * (1 - 0.06 * np.sin(np.pi * loose))
    y = line[:, 0] - 0.35 * (1 - np.abs(u)) * loose**4
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    points = np.stack(np.broadcast_arrays(x, y, line[:, 1] + wave * loose), axis=-1)
    uv = np.stack(np.broadcast_arrays(0.75 * u, length), axis=-1)
    return [shapes.grid(points[:, ::-1], dye, uv=uv[:, ::-1], crease_degrees=75.0)]


def ellipse(half_x: float, half_z: float, count: int) -> Array:
    """(count, 3) points of a level ellipse."""
    angle = np.arange(count) / count * TAU
    return np.stack([half_x * np.cos(angle), np.zeros(count), half_z * np.sin(angle)], axis=-1)


def lantern(detail: Detail, drop: float) -> list[Part]:
    """A glowing globe under an iron cap on a chain `drop` long, hung from y = 0."""
    globe = shapes.sphere(0.14, detail.of(14), "lamp").placed(translation(0, -drop, 0))
    cap = lathe([(0, 0.1), (0.15, 0.1), (0.15, 0.13), (0.05, 0.22), (0, 0.24)], detail.of(16), "iron").placed(
        translation(0, -drop, 0)
    )
    chain = box("iron", (0.02, drop - 0.2, 0.02), (0, -(drop - 0.2) / 2, 0))
    return [globe, cap, chain]


def floor_inlay(detail: Detail, inner: float, outer: float) -> list[Part]:
    """A ring of polished dark marble, 4 mm proud of the floor."""
    return [
        lathe(
            [(inner, 0.0), (outer, 0.0), (outer, 0.004), (inner, 0.004), (inner, 0.0)], detail.of(72), "marble_polished"
        )
    ]
