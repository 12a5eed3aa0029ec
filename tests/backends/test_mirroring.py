"""A transform that begins or ceases to mirror while the scene runs: outsides stay outsides, whoever draws or traces."""

from __future__ import annotations

import needs
import numpy as np
import pytest

from phrt.channels import CHANNELS, GBuffer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.tracer import Tracer
from phrt.model import Material, TextureRef, Track
from phrt.registry.manager import get_registry
from phrt.testing.worlds import at, four_colors, front_view, sphere, world_of
from phrt.workers import Workers
from phrt.world import World

RIGS = ["moderngl", "raycast-numpy", "raycast-embree", "raycast-open3d"]
PLACES = [
    at(0.1, 0.0, 0.0),
    at(-0.1, 0.1, 0.0, (0.9, 0.7, 0.8)),
    at(0.2, 0.0, 0.0, (-0.9, 0.7, 0.8)),
    at(0.0, 0.2, 0.0, (0.8, -0.9, -0.7)),
    at(0.0, 0.0, 0.1, (-0.8, -0.8, -0.8)),
    at(0.0, 0.0, 0.0, (-0.7, 0.9, 0.9)),
]
"""Whether the place before mirrors, and whether this one does: no-no, no-yes, yes-no, no-yes, yes-yes."""


def textured_sphere(matrix: np.ndarray) -> World:
    """A single-sided sphere with colours and bumps by texture, and a still one beside it."""
    material = Material(base_color_texture=TextureRef(0, nearest=True), normal_texture=TextureRef(0, nearest=True))
    return world_of([(sphere(), matrix), (sphere(rings=8, radius=0.2), at(0.7, 0.7))], [material], [four_colors()])


class Rig:
    """A producer, and a tracer where it needs one."""

    def __init__(self, name: str, world: World) -> None:
        registry = get_registry()
        kind, _, tracer = name.partition("-")
        for plugin, wanted in (("gbuffer", kind), ("tracer", tracer)):
            reason = registry.find(plugin, wanted).unavailable_reason() if wanted else None
            if reason:
                needs.absent(f"{name}: {reason}")
        self.world = world
        self.tracer: Tracer | None = registry.create("tracer", tracer) if tracer else None
        dependencies = {"tracer": self.tracer, "workers": Workers(1)} if self.tracer else {}
        self.producer: GBufferProducer = registry.create("gbuffer", kind, **dependencies)
        if self.tracer:
            self.tracer.build(world)
        self.producer.build(world)

    def move(self, matrix: np.ndarray) -> tuple[int, ...]:
        self.world.set_object_matrix(1, matrix)
        return self.advance(0.0)

    def advance(self, time: float) -> tuple[int, ...]:
        changes = self.world.advance(time)
        if self.tracer:
            self.tracer.update(self.world, changes)
        self.producer.update(self.world, changes)
        return changes.turned

    def render(self) -> GBuffer:
        buffer = self.producer.render(front_view(), channels=[c for c in CHANNELS if c != "motion"])
        return GBuffer(buffer.width, buffer.height, {name: array.copy() for name, array in buffer.arrays.items()})

    def close(self) -> None:
        self.producer.close()
        if self.tracer:
            self.tracer.close()


def assert_equal(moved: GBuffer, fresh: GBuffer) -> None:
    """Equal but for a few pixels, on edges of triangles and of texels."""
    for name, array in fresh.arrays.items():
        same = np.isclose(moved.arrays[name].astype(float), array.astype(float), rtol=1e-4, atol=1e-4)
        assert same.reshape(64 * 64, -1).all(axis=1).mean() > 0.985, name


@pytest.mark.parametrize("name", RIGS)
def test_a_moved_object_looks_like_one_that_was_built_there(name: str) -> None:
    rig = Rig(name, textured_sphere(PLACES[0]))
    turned = []
    for place in PLACES[1:]:
        turned.append(rig.move(place))
        fresh = Rig(name, textured_sphere(place))
        np.testing.assert_array_equal(rig.world.triangles, fresh.world.triangles)
        here, there = rig.render(), fresh.render()
        assert_equal(here, there)
        # The outside is what is seen: a back face would be farther away, and culled.
        seen = here.object_id == 1
        assert np.count_nonzero(seen) > 500
        assert here.depth[seen].min() < 2 - 0.5 * 0.6
        fresh.close()
    assert turned == [(), (1,), (1,), (1,), ()]
    rig.close()


@pytest.mark.parametrize("name", RIGS)
def test_an_animation_may_mirror_too(name: str) -> None:
    world = textured_sphere(PLACES[1])
    values = np.array([[0.9, 0.7, 0.8], [-0.9, 0.7, 0.8]], np.float32)
    world.scene.tracks.append(Track(0, "scale", np.array([0.0, 1.0]), values, "step"))
    rig = Rig(name, World(world.scene))
    assert rig.world.moving_objects == (1,)
    assert rig.advance(1.0) == (1,)
    mirrored = PLACES[1] @ at(scale=(-1, 1, 1))
    fresh = Rig(name, textured_sphere(mirrored))
    assert_equal(rig.render(), fresh.render())
    rig.close()
    fresh.close()


def test_children_of_an_animated_node_move_with_it() -> None:
    scene = textured_sphere(PLACES[0]).scene
    scene.nodes[1].parent = 0
    scene.tracks.append(Track(0, "translation", np.array([0.0, 1.0]), np.zeros((2, 3), np.float32)))
    assert World(scene).moving_objects == (1, 2)
    scene.tracks[0] = Track(1, "translation", np.array([0.0, 1.0]), np.zeros((2, 3), np.float32))
    assert World(scene).moving_objects == (2,)
