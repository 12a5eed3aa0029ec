"""The atrium's statues, made of lathes, tubes and twisted sections, each round its own foot."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phrt_plugins.loaders import shapes
from phrt_plugins.loaders.atrium_architecture import Detail
from phrt_plugins.loaders.shapes import TAU, Part, box, lathe, smooth_path, translation

PLINTH = 0.75
"""Height of a statue's plinth."""


def plinth() -> list[Part]:
    """A square plinth with moulded foot and top."""
    return [
        box("marble_polished", (0.86, 0.12, 0.86), (0, 0.06, 0)),
        box("limestone", (0.66, PLINTH - 0.22, 0.66), (0, PLINTH / 2 + 0.01, 0)),
        box("marble_polished", (0.8, 0.1, 0.8), (0, PLINTH - 0.05, 0)),
    ]


def robed_figure(detail: Detail, sway: float) -> list[Part]:
    """A standing figure in a falling robe, one arm bent, leaning by `sway` (-1..1)."""
    n, m = detail.of(56), detail.of(20)
    angle = np.arange(n + 1) % n / n * TAU
    t = np.linspace(0.0, 1.0, m + 1)
    y = 1.52 * t
    width = np.interp(
        t, [0, 0.08, 0.35, 0.58, 0.68, 0.86, 0.93, 1.0], [0.36, 0.33, 0.27, 0.235, 0.19, 0.26, 0.21, 0.07]
    )
    depth = np.interp(
        t, [0, 0.08, 0.35, 0.58, 0.68, 0.86, 0.93, 1.0], [0.31, 0.29, 0.235, 0.2, 0.145, 0.17, 0.13, 0.065]
    )
    fold = 0.11 * np.clip(1.15 - 1.3 * t, 0.0, 1.0)
    phase = angle[:, None] * 11 + 2.2 * np.sin(angle[:, None] * 2 + 3 * t) + sway * 4 * t
    ripple = 1 + fold * (np.abs(np.sin(phase / 2)) - 0.55) + 0.25 * fold * np.sin(5 * angle[:, None] + 6 * t)
    lean = sway * 0.09 * np.sin(np.pi * t * 1.4)
    x = lean + width * ripple * np.cos(angle)[:, None]
    z = -depth * ripple * np.sin(angle)[:, None]
    points = np.stack([x, np.broadcast_to(y, x.shape), z], axis=-1)
    points = np.concatenate([np.broadcast_to([lean[0], 0.0, 0.0], (n + 1, 1, 3)), points], axis=1)
    shoulder = float(lean[round(0.86 * m)])
    top = float(lean[-1])
    neck = np.array([(top, 1.46, 0.0), (top, 1.56, 0.01), (top + 0.01 * sway, 1.66, 0.02)])
    head = shapes.sphere(0.13, detail.of(18), "marble_white", (0.82, 1.15, 0.95)).placed(
        translation(top + 0.02 * sway, 1.72, 0.025)
    )
    hair = shapes.sphere(0.1, detail.of(12), "marble_white", (1.0, 0.9, 1.0)).placed(
        translation(top + 0.02 * sway, 1.76, -0.07)
    )
    side = 1.0 if sway >= 0 else -1.0
    bent = np.array(
        [
            (0.22, 1.32, 0.0),
            (0.3, 1.2, 0.01),
            (0.33, 1.06, 0.04),
            (0.28, 1.0, 0.14),
            (0.15, 1.03, 0.22),
            (0.05, 1.1, 0.23),
        ]
    )
    hanging = np.array(
        [(-0.22, 1.32, 0.0), (-0.31, 1.18, 0.0), (-0.34, 1.0, 0.03), (-0.34, 0.85, 0.06), (-0.32, 0.72, 0.08)]
    )
    arms = []
    for path in (bent, hanging):
        path = smooth_path(path * [side, 1, 1] + [shoulder, 0, 0], 12)
        thick = np.linspace(0.075, 0.04, len(path))
        arms.append(shapes.tube(path, thick, detail.of(10), "marble_white"))
    robe = shapes.grid(points, "marble_white", crease_degrees=55.0)
    base = lathe([(0, 0), (0.4, 0), (0.4, 0.05), (0, 0.05)], detail.of(32), "marble_white")
    return [base, robe, shapes.tube(neck, 0.065, detail.of(14), "marble_white"), head, hair, *arms]


def trefoil(detail: Detail, sway: float) -> list[Part]:
    """A bronze trefoil knot standing on its edge."""
    t = np.arange(detail.of(72)) / detail.of(72) * TAU
    path = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=-1)
    thick = 0.1 + 0.025 * np.cos(3 * t)
    knot = shapes.tube(path * 0.21, thick, detail.of(14), "bronze", closed=True)
    foot = lathe([(0, 0), (0.2, 0), (0.16, 0.06), (0.06, 0.1), (0.05, 0.3), (0, 0.3)], detail.of(24), "iron")
    return [foot, knot.placed(shapes.turn_y(sway)).placed(translation(0, 0.85, 0))]


def soaring_bird(detail: Detail, sway: float) -> list[Part]:
    """A slender polished form that swells and bends as it rises."""
    n, m = detail.of(24), detail.of(28)
    t = np.linspace(0.0, 1.0, m + 1)
    radius = np.interp(t, [0, 0.12, 0.2, 0.45, 0.7, 0.9, 0.97, 1.0], [0.13, 0.06, 0.055, 0.13, 0.155, 0.09, 0.045, 0.0])
    radius = np.convolve(np.pad(radius, 2, mode="edge"), np.ones(5) / 5, mode="valid") * (t < 1)
    angle = np.arange(n + 1) % n / n * TAU
    bend = 0.16 * np.sin(np.pi * t * 0.9) * (1 if sway >= 0 else -1)
    points = np.stack(
        [
            bend + radius * np.cos(angle)[:, None],
            np.broadcast_to(1.75 * t + 0.06, (n + 1, m + 1)),
            -0.8 * radius * np.sin(angle)[:, None],
        ],
        axis=-1,
    )
    points = np.concatenate([np.broadcast_to([0.0, 0.06, 0.0], (n + 1, 1, 3)), points], axis=1)
    foot = lathe([(0, 0), (0.26, 0), (0.26, 0.07), (0, 0.07)], detail.of(32), "marble_polished")
    return [foot, shapes.grid(points, "gold", crease_degrees=60.0)]


def twisted_form(detail: Detail, sway: float) -> list[Part]:
    """A rounded-square section that turns and tapers as it rises: a superquadric in motion."""
    n, m = detail.of(36), detail.of(26)
    angle = np.arange(n + 1) % n / n * TAU
    t = np.linspace(0.0, 1.0, m + 1)
    turn = TAU * 0.42 * t * (1 if sway >= 0 else -1)
    exponent = 0.55
    square_x = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** exponent
    square_z = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** exponent
    size = 0.2 + 0.07 * np.sin(TAU * t * 1.5)
    size[0] = size[-1] = 0.0
    x = size * (square_x[:, None] * np.cos(turn) - square_z[:, None] * np.sin(turn))
    z = size * (square_x[:, None] * np.sin(turn) + square_z[:, None] * np.cos(turn))
    height = 1.6 * t
    height[0], height[-1] = height[1], height[-2]
    points = np.stack([x, np.broadcast_to(height - height[0], x.shape), -z], axis=-1)
    return [shapes.grid(points, "marble_white", crease_degrees=50.0)]


def seated_rings(detail: Detail, sway: float) -> list[Part]:
    """Three interlocked stone rings."""
    parts = []
    t = np.arange(detail.of(32)) / detail.of(32) * TAU
    circle = np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=-1)
    for turn, size, height in ((sway, 0.42, 0.52), (sway + 1.2, 0.36, 0.86), (sway + 2.4, 0.3, 1.22)):
        ring = shapes.tube(circle * size, 0.1, detail.of(12), "marble_white", closed=True)
        parts.append(ring.placed(shapes.turn_y(turn)).placed(translation(0, height, 0)))
    return parts


STATUES: dict[str, Callable[[Detail, float], list[Part]]] = {
    "figure": robed_figure,
    "knot": trefoil,
    "bird": soaring_bird,
    "twist": twisted_form,
    "rings": seated_rings,
}
