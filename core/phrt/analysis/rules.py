"""Rules: what an object is by its materials, and what its measured changes mean for its importance and its effects."""

from __future__ import annotations

import numpy as np

from phrt.scene import Scene
from phrt.world import World

KIND_FACTORS = {"mirror": 2.0, "glass": 2.0, "glossy": 1.25, "rough": 1.0, "unlit": 0.25}
"""Importance by rule of what no probe of the scene shows, and of nothing like it either. Kinds, the most telling first: an
object is of the first kind that any of its materials is of."""

MIRROR_ROUGHNESS, GLOSSY_ROUGHNESS = 0.1, 0.4
"""Below the first a metal shows what is around it, below the second a surface has a highlight with a shape."""

SMALL = 0.002
"""Of the scene's extent; smaller objects count half by rule."""

LEAST_FACTOR, LARGEST_FACTOR = 0.25, 4.0
EVIDENCE_PIXELS = 200.0
"""A measured factor counts as much as the rule's when it was seen at so many pixels."""

INVISIBLE_MEAN, INVISIBLE_PEAK = 0.1 / 255, 1.5 / 255
"""An effect that changes its pixels less than this, on average and anywhere, in the 8-bit picture, changes nothing."""
LEAST_PROBES, LEAST_PIXELS = 3, 100
"""What must have been seen of an object before an effect is ruled out."""


def kinds_of(world: World) -> list[str]:
    """The kind of every object, background first (rough)."""
    materials = world.materials
    smooth = materials["roughness"] < MIRROR_ROUGHNESS
    metal = materials["metallic"] > 0.5
    textured = materials["metallic_roughness_texture"] >= 0
    by_kind = {
        "mirror": metal & smooth & ~textured,
        "glass": materials["transmission"] > 0.5,
        "glossy": (materials["roughness"] < GLOSSY_ROUGHNESS) | (metal & textured),
        "rough": materials["unlit"] == 0,
    }
    kinds = ["unlit"] * (world.object_count + 1)
    for kind in reversed(by_kind):
        lit = by_kind[kind] & (materials["unlit"] == 0)
        for row in np.flatnonzero(world.object_has(lit)):
            kinds[int(row)] = kind
    return kinds


def rule_factors(world: World, kinds: list[str]) -> np.ndarray:
    """(N + 1,) float64 of importance by rule alone: by kind, and half of it for small objects."""
    low, high = world.object_bounds()
    scene_low, scene_high = world.bounds()
    extent = np.linalg.norm((high - low).astype(np.float64), axis=1)
    small = extent < SMALL * float(np.linalg.norm((scene_high - scene_low).astype(np.float64)))
    return np.array([KIND_FACTORS[kind] for kind in kinds]) * np.where(small, 0.5, 1.0)


def measured_factors(total_change: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(N + 1,) float64 of importance by measurement, NaN for objects without pixels: the square root of what tracing changes at a
    pixel of the object over what it changes at a pixel of the picture, within `LEAST_FACTOR` to `LARGEST_FACTOR`.

    Per pixel, because V counts the area already. Ours: the root, so that K does not outweigh V, and a measurement on a few
    frames does not outweigh everything.
    """
    whole = float(pixels.sum())
    mean = float(total_change[pixels > 0].sum()) / whole if whole > 0 else 0.0
    change = np.divide(total_change, pixels, out=np.full(len(pixels), np.nan), where=pixels > 0)
    if mean <= 0:
        return np.where(pixels > 0, 1.0, np.nan)
    return np.clip(np.sqrt(change / mean), LEAST_FACTOR, LARGEST_FACTOR)


def factors(measured: np.ndarray, pixels: np.ndarray, rule: np.ndarray, kinds: list[str], scene: Scene) -> np.ndarray:
    """(N + 1,) float64: measurement where there is enough of it, else what is like the object, else the rule.

    What is like an object is what has its kind and shares a tag with it, or at least has its kind; the weight of
    a measurement is pixels / (pixels + EVIDENCE_PIXELS).
    """
    expected = _expected(measured, rule, kinds, scene)
    weight = pixels / (pixels + EVIDENCE_PIXELS)
    return np.where(pixels > 0, weight * np.nan_to_num(measured) + (1 - weight) * expected, expected)


def _expected(measured: np.ndarray, rule: np.ndarray, kinds: list[str], scene: Scene) -> np.ndarray:
    """(N + 1,) float64: the mean factor of what was seen and is like each object, else the rule's."""
    groups: dict[tuple[str, ...], list[float]] = {}
    for row, entry in enumerate(scene.objects, start=1):
        if not np.isnan(measured[row]):
            for key in [(kinds[row],), *((kinds[row], tag) for tag in entry.tags)]:
                groups.setdefault(key, []).append(float(measured[row]))
    expected = rule.copy()
    for row, entry in enumerate(scene.objects, start=1):
        alike = [groups[key] for tag in entry.tags if (key := (kinds[row], tag)) in groups]
        alike = alike or ([groups[(kinds[row],)]] if (kinds[row],) in groups else [])
        if alike:
            expected[row] = float(np.mean([np.mean(values) for values in alike]))
    return expected


def changes_nothing(
    seen: np.ndarray, effect_pixels: np.ndarray, change: np.ndarray, peak: np.ndarray, marked: np.ndarray
) -> np.ndarray:
    """(N + 1, E) bool: seen often enough in probes, and never changed by the effect so that anybody could see it, nor given
    anything by it: a good fallback that hides the difference in a small picture may not do so in a large one.

    seen (N + 1,) probes; effect_pixels, change, peak, marked (N + 1, E): see `Findings`.
    """
    enough = (seen[:, None] >= LEAST_PROBES) & (effect_pixels >= LEAST_PIXELS)
    mean = np.divide(change, effect_pixels, out=np.zeros_like(change), where=effect_pixels > 0)
    return enough & (mean < INVISIBLE_MEAN) & (peak < INVISIBLE_PEAK) & (marked == 0)
