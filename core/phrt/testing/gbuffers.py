"""check_gbuffer: the rules of `phrt.interfaces.gbuffer.GBufferProducer`, pixel by pixel against the numpy tracer's primary rays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydantic import BaseModel

from phrt.camera import CameraView, look_at
from phrt.channels import CHANNELS, GBuffer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.tracer import Tracer
from phrt.kernels.arrays import SurfaceArrays, surface_arrays
from phrt.model import Image, Material, TextureRef
from phrt.registry.auto import FALLBACK_GBUFFER
from phrt.registry.manager import get_registry
from phrt.testing.contract import BROKEN_BY_THE_PLUGIN, BrokenContract, Given, Maker
from phrt.testing.tracers import ORACLE
from phrt.testing.worlds import at, four_colors, front_view, half_covered, quad, sphere, world_of
from phrt.workers import Workers
from phrt.world import World

__tracebackhide__ = BROKEN_BY_THE_PLUGIN

OTHER_OBJECT, OTHER_TRIANGLE = 0.01, 0.02
"""Share of pixels where rasterizing and tracing may see something else: edges between objects, and between triangles."""


@dataclass(frozen=True)
class Tolerance:
    """How far a channel may be from the oracle's where both see the same triangle: everywhere by `most`, or, where textures are
    filtered by different footprints, by `most` in all but a share `exempt` of the pixels and by `mean` on average."""

    most: float
    exempt: float = 0.0
    mean: float = np.inf


TEXTURED = Tolerance(0.05, exempt=0.1, mean=0.02)
TOLERANCES = {name: Tolerance(1e-5) for name in CHANNELS} | {
    "depth": Tolerance(5e-3),
    "position_world": Tolerance(5e-3),
    "uv": Tolerance(5e-3),
    "motion": Tolerance(2e-2, exempt=0.01, mean=2e-2),
    **dict.fromkeys(("normal_world", "base_color", "metallic", "roughness", "transmission", "occlusion"), TEXTURED),
    "emissive": Tolerance(0.1, exempt=0.1, mean=0.04),
    **dict.fromkeys(("object_id", "material_id", "primitive_id"), Tolerance(0.0)),
}


def check_gbuffer(gbuffer: Given, options: Mapping[str, object] | BaseModel | None = None) -> None:
    """Put a G-buffer producer through its contract. Raises BrokenContract naming the rule and the case.

    gbuffer: the name of a registered one, a descriptor, or a class that takes `options`; with a parameter `tracer` it is given
             one, and with `workers` threads, as the descriptor's `needs_tracer` asks for
    """
    make = Maker("gbuffer", gbuffer, options)
    for check in CHECKS:
        make.contract.call(check.__name__.strip("_").replace("_", " "), partial(check, make))


def busy_world() -> World:
    """Spheres and quads in many materials: textured, masked, mirrored, glowing, glass, moved out of centre, one inside out."""
    noise = np.random.default_rng(11).integers(0, 255, (4, 4, 4), dtype=np.uint8).repeat(32, axis=0).repeat(32, axis=1)
    images = [Image("noise", noise), four_colors(), half_covered()]
    materials = [
        Material(base_color_texture=TextureRef(0), normal_texture=TextureRef(0), normal_scale=0.3),
        Material(double_sided=True, alpha_mode="MASK", base_color_texture=TextureRef(2, nearest=True, scale=(4, 1))),
        Material(metallic=0.9, roughness=0.2, metallic_roughness_texture=TextureRef(0, wrap_s="mirror", scale=(3, 2))),
        Material(emissive=(1.0, 2.0, 0.5), transmission=0.7, alpha_mode="BLEND", base_color=(1.0, 1.0, 1.0, 0.5)),
    ]
    placed = [
        (sphere(24, 0.5), at(x=-0.7, z=-0.5)),
        (sphere(16, 0.4, 3), at(x=0.6, y=0.4, z=-1, scale=(-1, 1.5, 1))),
        (quad(1, tangents=True), at(x=0.3, y=-0.5, z=-0.4)),
        (quad(2, half=6), at(z=-3)),
    ]
    return world_of(placed, materials, images)


def small_view(**changes: object) -> CameraView:
    """As `front_view`, half as wide again as high."""
    return front_view(**({"width": 48, "height": 32, "tan_half": (0.75, 0.5)} | changes))


class _Rig:
    """A producer on a world, with the tracer and the threads it asks for, beside the oracle's picture of the same world."""

    def __init__(self, make: Maker, world: World) -> None:
        registry = get_registry()
        self.contract, self.world = make.contract, world
        self._workers = Workers(2)
        self._tracer: Tracer = registry.create("tracer", ORACLE)
        self._tracer.build(world)
        has = {"tracer": self._tracer, "workers": self._workers}
        self.producer = make(**{name: thing for name, thing in has.items() if make.takes(name)})
        self.oracle: GBufferProducer = registry.create("gbuffer", FALLBACK_GBUFFER, **has)
        self.contract.holds(
            isinstance(self.producer, GBufferProducer), "it is a phrt.interfaces.gbuffer.GBufferProducer"
        )
        for each in (self.producer, self.oracle):
            each.build(world)

    def close(self) -> None:
        for each in (self.producer, self.oracle, self._tracer, self._workers):
            each.close()

    def move(self, object_id: int, matrix: np.ndarray) -> None:
        """As a frame does it."""
        self.world.set_object_matrix(object_id, matrix)
        changes = self.world.advance(0.0)
        for each in (self._tracer, self.producer, self.oracle):
            each.update(self.world, changes)

    def render(self, view: CameraView, case: str, **how: Any) -> GBuffer:
        """One picture, valid by the table of channels wherever it will be looked at."""
        buffer = self.producer.render(view, **how)
        missing = sorted(set(how.get("channels", CHANNELS)) - set(buffer.arrays))
        self.contract.holds(not missing, f"the channels asked for are there; missing: {', '.join(missing)}", case)
        if "pixels" in how:
            return buffer
        try:
            buffer.validate()
        except (ValueError, KeyError) as error:
            raise BrokenContract(
                self.contract.message(f"a G-buffer is as the table of channels says: {error}", case)
            ) from error
        return buffer

    def compare(self, view: CameraView, case: str, **how: Any) -> GBuffer:
        """Every channel against the oracle's; returns the picture."""
        got, wanted = self.render(view, case, **how), self.oracle.render(view, **how)
        for name, share in (
            ("object_id", OTHER_OBJECT),
            ("material_id", OTHER_OBJECT),
            ("primitive_id", OTHER_TRIANGLE),
        ):
            off = float(np.mean(got.arrays[name] != wanted.arrays[name]))
            self.contract.holds(off <= share, f"channel '{name}' differs at {off:.1%} of the pixels", case)
        background = got.object_id == 0
        for name, channel in CHANNELS.items():
            clear = (got.arrays[name][background] == channel.clear).all()
            self.contract.holds(clear, f"channel '{name}' is {channel.clear:g} on the background", case)
        same = (got.primitive_id == wanted.primitive_id) & ~background
        for name, limit in TOLERANCES.items():
            self._compare_channel(name, limit, got.arrays[name][same], wanted.arrays[name][same], case)
        return got

    def _compare_channel(self, name: str, limit: Tolerance, got: np.ndarray, wanted: np.ndarray, case: str) -> None:
        if not len(got):
            return
        off = np.abs(got.astype(np.float64) - wanted.astype(np.float64))
        most = limit.most * np.maximum(1.0, np.abs(wanted)) if name in ("depth", "position_world") else limit.most
        share, mean = float(np.mean(off > most)), float(off.mean())
        right = share <= limit.exempt and mean <= limit.mean
        self.contract.holds(
            right, f"channel '{name}' is up to {off.max():g} (on average {mean:g}) from what primary rays find", case
        )


@contextmanager
def _rig(make: Maker, world: World) -> Iterator[_Rig]:
    rig = _Rig(make, world)
    try:
        yield rig
    finally:
        rig.close()


# The rules


def _values_that_are_known(make: Maker) -> None:
    """A square that fills the picture exactly, its colours the right way up."""
    material = Material(base_color_texture=TextureRef(0, nearest=True), metallic=0.75, roughness=0.3)
    with _rig(make, world_of([(quad(), at())], [material], [four_colors()])) as rig:
        case, holds = "a square that fills the picture", rig.contract.holds
        buffer = rig.render(front_view(), case)
        holds((buffer.object_id == 1).all() and (buffer.material_id == 1).all(), "object and material are 1", case)
        holds(np.allclose(buffer.depth, 2.0, rtol=1e-5), "depth is 2, the distance along -Z", case)
        holds(np.allclose(buffer.normal_world, [0, 0, 1], atol=1e-5), "normals face the eye: (0, 0, 1)", case)
        holds(np.allclose(buffer.metallic, 0.75) and np.allclose(buffer.roughness, 0.3), "metallic and roughness", case)
        corners = buffer.base_color[[8, 8, 56, 56], [8, 56, 8, 56]]
        right = np.allclose(corners, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], atol=1e-3)
        holds(right, f"a texture is not turned or mirrored: red green / blue white, not {corners.tolist()}", case)
        holds(not buffer.motion.any(), "nothing moved before the first frame", case)


def _every_channel_is_what_primary_rays_find(make: Maker) -> None:
    with _rig(make, busy_world()) as rig:
        for eye, jitter in (
            ((0.0, 0.0, 2.0), (0.0, 0.0)),
            ((1.5, 1.0, 1.2), (0.3, -0.4)),
            ((-0.7, 0.0, -0.2), (-0.2, 0.1)),
        ):
            view = small_view(world_from_view=look_at(eye, (0, 0, -1)), jitter=jitter)
            rig.compare(view, f"many materials, seen from {eye} with jitter {jitter}")
        flat = small_view(orthographic=True, tan_half=(1.5, 1.0), near=0.0)
        rig.compare(flat, "many materials, orthographic")
        rig.compare(small_view(near=2.7, far=4.0), "cut by the near plane and the far plane")


def _channels_hidden_objects_and_pixels(make: Maker) -> None:
    world = busy_world()
    with _rig(make, world) as rig:
        view = small_view()
        for name in CHANNELS:
            rig.render(view, f"channel '{name}' alone", channels=(name,))
        for hidden in (~world.object_opaque, np.array([False, False, False, True, True])):
            case = f"without objects {np.flatnonzero(hidden).tolist()}"
            buffer = rig.compare(view, case, hidden=hidden)
            rig.contract.holds(not hidden[buffer.object_id].any(), "hidden objects are not there", case)
        rig.compare(view, "hidden objects are back")
        pixels = np.random.default_rng(1).permutation(view.width * view.height).astype(np.int32)[:200]
        whole = surface_arrays(rig.render(view, "pixels"))
        some = surface_arrays(rig.render(view, "pixels", pixels=pixels))
        points = rig.producer.points(view, pixels)
        for name, all_of_it, part, point in zip(SurfaceArrays._fields, whole, some, points, strict=True):
            same = np.array_equal(part[pixels], all_of_it[pixels]) and np.array_equal(point, all_of_it[pixels])
            rig.contract.holds(same, f"`render(pixels=...)` and `points` give the same '{name}' as a whole picture")


def _motion_and_moved_objects(make: Maker) -> None:
    with _rig(make, busy_world()) as rig:
        rig.compare(small_view(), "the first frame")
        rig.move(1, at(x=-0.6, y=0.1, z=-0.4))
        moved = small_view(world_from_view=look_at((0.1, 0.05, 1.9), (0, 0, 0)))
        buffer = rig.compare(moved, "an object and the camera moved")
        rig.contract.holds(np.abs(buffer.motion).max() > 1.0, "motion is counted from the frame before, in pixels")
        rig.compare(moved.with_jitter(0.2, 0.3), "nothing moved; jitter is no motion")
        rig.move(2, at(x=0.2, y=-0.2, scale=(1, 1, -1)))
        rig.compare(moved, "an object was turned inside out")


def _little_to_see(make: Maker) -> None:
    with _rig(make, world_of([])) as rig:
        rig.compare(small_view(), "an empty scene")
    with _rig(make, world_of([(quad(), at())])) as rig:
        rig.compare(front_view(width=17, height=5, tan_half=(1.7, 0.5)), "17 x 5 pixels")
        behind = small_view(world_from_view=look_at((0, 0, -2), (0, 0, 0)))
        seen = rig.compare(behind, "a single-sided square from behind").object_id.any()
        rig.contract.holds(not seen, "single-sided surfaces are not seen from behind")
        for each in (rig.producer, rig.oracle):
            each.build(rig.world)
        rig.compare(small_view(), "built again")


CHECKS: tuple[Callable[[Maker], None], ...] = (
    _values_that_are_known,
    _every_channel_is_what_primary_rays_find,
    _channels_hidden_objects_and_pixels,
    _motion_and_moved_objects,
    _little_to_see,
)
