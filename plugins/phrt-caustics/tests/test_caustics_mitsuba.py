"""Against Mitsuba 3, an independent renderer: the light that a ball of glass throws on the ground, by its particle tracer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from caustics_kit import GLASS, RADIUS, flat

import phrt
from phrt.camera import CameraView, look_at
from phrt.model import Light, Material
from phrt.testing.worlds import at, quad, sphere, world_of
from phrt.world import World

if not os.environ.get("CI"):
    pytest.importorskip("mitsuba", reason="the independent renderer is not installed")
import mitsuba

SIZE = 64
EYE, TARGET, TAN_HALF = (0.0, 1.1, 2.6), (0.0, 0.1, 0.0), 0.45
HEIGHT = 1.3 * RADIUS
LAMP = (1.2, 3.0, 0.4)
ALBEDO = 0.02
INTENSITY = 25.0 / ALBEDO
"""Dark ground, strong light: what the lit ground sends back through the ball, which only Mitsuba counts, hardly does."""
CONE = 0.30
"""Half the angle of the lamp's cone, radians: the ball and some ground around its shadow."""
PHOTONS_A_PIXEL = 256


def ball_and_lamp() -> World:
    matrix = look_at(LAMP, (0.0, HEIGHT, 0.0))  # a camera looks along -Z, and so does a light
    lamp = Light("spot", intensity=INTENSITY, inner_angle=CONE * 0.95, outer_angle=CONE)
    placed = [(quad(0, half=4.0), flat()), (sphere(64, RADIUS, 1), at(y=HEIGHT))]
    ground = Material("ground", base_color=(ALBEDO, ALBEDO, ALBEDO, 1.0), specular=0.0)
    return world_of(placed, [ground, GLASS], lights=[(lamp, matrix)])


def view() -> CameraView:
    return CameraView(SIZE, SIZE, look_at(EYE, TARGET), (TAN_HALF, TAN_HALF))


def by_mitsuba(world: World, folder: Path) -> np.ndarray:
    """(SIZE, SIZE, 3) float32: photons from the lamp, connected to the eye; the same triangles and normals."""
    mitsuba.set_variant("scalar_rgb")
    transform = mitsuba.ScalarTransform4f
    first, count = world.first_vertex[2], world.vertex_count[2]
    mesh = mitsuba.Mesh("ball", int(count), int(world.triangle_count[2]), has_vertex_normals=True,
                        props=_glass())  # fmt: skip
    parameters = mitsuba.traverse(mesh)
    parameters["vertex_positions"] = world.positions[first : first + count].ravel().tolist()
    parameters["vertex_normals"] = world.normals[first : first + count].ravel().tolist()
    triangles = world.triangles[world.triangle_object == 2] - first
    parameters["faces"] = triangles.ravel().tolist()
    parameters.update()
    path = folder / "ball.ply"
    mesh.write_ply(str(path))
    description: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "ptracer", "max_depth": 16, "rr_depth": 100},
        "sensor": {
            "type": "perspective", "fov": float(np.degrees(2 * np.arctan(TAN_HALF))), "fov_axis": "y", "near_clip": 0.01,
            "to_world": transform().look_at(origin=EYE, target=TARGET, up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
            "sampler": {"type": "independent", "sample_count": PHOTONS_A_PIXEL},
        },
        "ground": {
            "type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90).scale(4.0),
            "bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": ALBEDO}}},
        },
        "ball": {"type": "ply", "filename": str(path), "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}},
        "lamp": {
            "type": "spot", "cutoff_angle": float(np.degrees(CONE)), "beam_width": float(np.degrees(CONE * 0.95)),
            "intensity": {"type": "rgb", "value": INTENSITY},
            "to_world": transform().look_at(origin=LAMP, target=[0, HEIGHT, 0], up=[0, 1, 0]),
        },
    }  # fmt: skip
    return np.array(mitsuba.render(mitsuba.load_dict(description)), np.float32)


def _glass() -> Any:
    properties = mitsuba.Properties()
    properties["mesh_bsdf"] = mitsuba.load_dict({"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0})
    return properties


def test_the_caustic_of_a_ball_is_mitsuba_s(tmp_path: Path) -> None:
    world = ball_and_lamp()
    effects = {"caustics": {"photons_per_pixel": 20.0}} | {
        name: {"enabled": False} for name in ("reflections", "refractions", "ambient_occlusion")
    }
    with phrt.Renderer(
        world.scene, size=(SIZE, SIZE), gbuffer="raycast", threads=2, strict=True, effects=effects, aa=16
    ) as renderer:
        frame = renderer.render(camera=view())
    reference = by_mitsuba(world, tmp_path)
    # Ground that the ball keeps direct light from: all its light is a caustic. The rim of the lamp's cone stays out.
    position = frame.gbuffer.position_world
    shadow = (frame.layers["visibility"][..., 0] == 0) & (frame.gbuffer.object_id == 1)
    shadow &= np.hypot(position[..., 0] + 0.25, position[..., 2]) < 1.0
    ours, theirs = frame.image[shadow].mean(axis=1), reference[shadow].mean(axis=1)
    assert len(ours) > 150
    assert ours.sum() == pytest.approx(theirs.sum(), rel=0.03)
    # The same shape: the brightest place, and the light inside rings around it.
    places, bright = position[shadow][:, [0, 2]], theirs > 0.5 * theirs.max()
    centre = (places * theirs[:, None])[bright].sum(axis=0) / theirs[bright].sum()
    own_bright = ours > 0.5 * ours.max()
    own_centre = (places * ours[:, None])[own_bright].sum(axis=0) / ours[own_bright].sum()
    assert np.linalg.norm(own_centre - centre) < 0.05
    distance = np.linalg.norm(places - centre, axis=1)
    for radius in (0.15, 0.3, 0.5):
        assert ours[distance < radius].sum() == pytest.approx(theirs[distance < radius].sum(), rel=0.06), radius
