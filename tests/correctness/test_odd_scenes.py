"""Random scenes with odd values: whatever they hold, the picture is finite, not negative, and the same on every tracer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, box, flipped, mesh_of, need_tracer, psnr, quad, turned

from phrt.model import Material, TextureRef

EFFECTS = {"shadows": {"samples": 2}, "ambient_occlusion": {"samples": 2}, "reflections": {"samples": 2}}


def odd_material(rng: np.random.Generator, image: int) -> Material:
    """Any values in glTF's ranges, their ends more often than chance would have it."""

    def value(low: float = 0.0, high: float = 1.0) -> float:
        return float(rng.choice([low, high, rng.uniform(low, high)]))

    texture = (
        TextureRef(image, scale=(value(-3, 3), 0.0 if rng.random() < 0.1 else value(0, 5)))
        if rng.random() < 0.4
        else None
    )
    return Material(
        base_color=(value(), value(), value(), value()),
        metallic=value(),
        roughness=value(),
        specular=value(),
        ior=value(1.0, 3.0),
        transmission=value() if rng.random() < 0.5 else 0.0,
        thickness=value(0.0, 0.5),
        attenuation_color=(value(), value(), value()),
        attenuation_distance=value(1e-3, 2.0),
        emissive=(value(), value(), value()) if rng.random() < 0.2 else (0.0, 0.0, 0.0),
        alpha_mode=str(rng.choice(["OPAQUE", "OPAQUE", "MASK", "BLEND"])),  # type: ignore[arg-type]
        double_sided=bool(rng.random() < 0.5),
        unlit=bool(rng.random() < 0.1),
        base_color_texture=texture,
        metallic_roughness_texture=texture,
        transmission_texture=texture,
        occlusion_texture=texture,
    )


def odd_scene(seed: int) -> Stage:
    rng = np.random.default_rng(seed)
    made = Stage(dome=tuple(rng.uniform(0, 1, 3)) if seed % 3 else (0.0, 0.0, 0.0))
    image = made.image(rng.integers(0, 256, (5, 3, 4)))
    shapes = [ball(0.6, 2), box(), quad(), flipped(ball(0.5, 1)), mesh_of(np.zeros((3, 3)), [[0, 1, 2]])]
    for index in range(9):
        scale = np.diag([*rng.choice([-1.0, 0.3, 1.0, 2.0], 3), 1.0])
        turn = turned("y", rng.uniform(0, 360)) @ turned("x", rng.uniform(0, 360))
        matrix = at(*rng.uniform(-1.5, 1.5, 3)) @ turn @ scale
        made.add(f"/{index}", shapes[int(rng.integers(len(shapes)))], odd_material(rng, image), matrix)
    kinds: list[tuple[str, dict[str, Any]]] = [
        ("point", {"intensity": 10.0}),
        ("spot", {"intensity": 30.0, "inner_angle": 0.5, "outer_angle": 0.5}),
        ("directional", {"intensity": 2.0, "angle": 0.1}),
        ("sphere", {"intensity": 9.0, "radius": 0.7}),
        ("rect", {"intensity": 9.0, "size": (0.0, 1.0)}),
        ("point", {"intensity": 0.0, "range": 1e-3}),
    ]
    for kind, values in kinds:
        made.light(kind, at(*rng.uniform(-2, 2, 3)) @ turned("x", rng.uniform(0, 360)), **values)
    # A light on a surface, and every third eye inside the heap.
    made.light("point", made.scene.nodes[made.scene.objects[0].node].matrix.copy(), intensity=1.0)
    return made.camera((0.1, 0.2, 4.0 if seed % 3 else 0.3), (0, 0, 0))


@pytest.mark.parametrize("seed", range(12))
def test_a_random_scene_gives_a_finite_picture(seed: int) -> None:
    assert odd_scene(seed).render((32, 24), tracer="embree", effects=EFFECTS).image.shape == (24, 32, 3)
    fallbacks = {
        "shadows": {"fallback": "shadow_map", "map_size": 32},
        "reflections": {"fallback": "probe", "probe_size": 8},
        "refractions": {"fallback": "alpha"},
    }
    odd_scene(seed).render((16, 12), tracer="embree", heuristic="raster_only", effects=fallbacks)


@pytest.mark.parametrize("seed", [1, 4])
def test_all_tracers_give_the_same_picture(seed: int) -> None:
    """The same seeds give the same rays; what is left are edges that rays graze."""
    reference = odd_scene(seed).render((24, 18), tracer="numpy", effects=EFFECTS).image
    for tracer in ("embree", "open3d"):
        image = odd_scene(seed).render((24, 18), tracer=need_tracer(tracer), effects=EFFECTS).image
        assert psnr(image / 2, reference / 2) > 25
        assert (np.abs(image - reference).max(axis=-1) > 0.01).mean() < 0.05


def test_a_hall_of_mirrors_and_glass_in_glass_end() -> None:
    made = Stage(dome=(0.5, 0.5, 0.5)).add("/hall", box(4, 4, 4, inwards=True), MIRROR)
    made.add("/outer", ball(1.0, 2), GLASS).add("/inner", ball(0.9, 2), GLASS).add("/core", ball(0.4, 2), LAMBERT)
    made.light("point", at(1.5, 1.5, 1.5), intensity=5.0).camera((0, 0.3, 1.9), (0, 0, 0))
    deep = {"reflections": {"max_depth": 16}, "refractions": {"max_depth": 32}}
    assert made.render((24, 24), effects=deep).image.max() < 50
