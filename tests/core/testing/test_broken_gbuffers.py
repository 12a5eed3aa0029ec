"""The kit finds what a G-buffer producer does wrong. Each broken one is the producer by primary rays with one thing changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from phrt.camera import CameraView
from phrt.channels import GBuffer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.tracer import Tracer
from phrt.registry import Options, get_registry
from phrt.testing import check_gbuffer
from phrt.workers import Workers
from phrt.world import Changes, World


class Wrapped(GBufferProducer):
    """Passes everything on; `spoil` changes what comes out."""

    spoil: Callable[[GBuffer], None] = staticmethod(lambda buffer: None)  # type: ignore[assignment]

    def __init__(self, options: Options, *, tracer: Tracer, workers: Workers) -> None:
        self.inner: GBufferProducer = get_registry().create("gbuffer", "raycast", tracer=tracer, workers=workers)

    def build(self, world: World) -> None:
        self.inner.build(world)

    def update(self, world: World, changes: Changes) -> None:
        self.inner.update(world, changes)

    def render(self, view: CameraView, **how: Any) -> GBuffer:
        buffer = self.inner.render(view, **how)
        buffer.arrays = {name: array.copy() for name, array in buffer.arrays.items()}
        type(self).spoil(buffer)
        return buffer

    def close(self) -> None:
        self.inner.close()


def spoiled(change: Callable[[GBuffer], None]) -> type[Wrapped]:
    return type(change.__name__, (Wrapped,), {"spoil": staticmethod(change)})


def in_doubles(buffer: GBuffer) -> None:
    buffer.arrays["depth"] = buffer.depth.astype(np.float64)


def without_motion(buffer: GBuffer) -> None:
    buffer.arrays.pop("motion", None)


def upside_down(buffer: GBuffer) -> None:
    buffer.arrays["base_color"] = np.ascontiguousarray(buffer.base_color[::-1])


def distance_for_depth(buffer: GBuffer) -> None:
    buffer.depth[:] *= np.float32(1.02)


def normals_of_triangles(buffer: GBuffer) -> None:
    buffer.arrays["normal_world"] = buffer.normal_geometric_world.copy()


def background_at_the_far_plane(buffer: GBuffer) -> None:
    buffer.depth[buffer.object_id == 0] = 1e4


def motion_the_other_way(buffer: GBuffer) -> None:
    buffer.motion[:] *= -1


def objects_from_zero(buffer: GBuffer) -> None:
    buffer.object_id[buffer.object_id > 1] -= 1


def with_nan(buffer: GBuffer) -> None:
    buffer.roughness[0, 0] = np.nan


class NeverHides(Wrapped):
    def render(self, view: CameraView, **how: Any) -> GBuffer:
        return super().render(view, **(how | {"hidden": None}))


class ForgetsJitter(Wrapped):
    def render(self, view: CameraView, **how: Any) -> GBuffer:
        return super().render(view.with_jitter(0.0, 0.0), **how)


class BuildsAgain(Wrapped):
    """Instead of an update, which forgets where things were."""

    def update(self, world: World, changes: Changes) -> None:
        self.inner.build(world)


class PointsInAnyOrder(Wrapped):
    def points(self, view: CameraView, pixels: np.ndarray, **how: Any) -> Any:
        return super().points(view, np.sort(pixels), **how)


BROKEN: list[tuple[Any, str]] = [
    (spoiled(in_doubles), r"channel 'depth' is float64\(64, 64\), expected float32"),
    (spoiled(without_motion), "the channels asked for are there; missing: motion"),
    (spoiled(upside_down), "a texture is not turned or mirrored"),
    (spoiled(distance_for_depth), "depth is 2, the distance along -Z"),
    (spoiled(normals_of_triangles), "channel 'normal_world' is up to"),
    (spoiled(background_at_the_far_plane), "channel 'depth' is inf on the background"),
    (spoiled(motion_the_other_way), r"channel 'motion' is up to"),
    (spoiled(objects_from_zero), "channel 'object_id' differs at"),
    (spoiled(with_nan), "channel 'roughness' holds NaN or infinity"),
    (NeverHides, "differs at|hidden objects are not there"),
    (ForgetsJitter, r"channel '\w+' (is up to|differs).*with jitter"),
    (BuildsAgain, "motion.*an object and the camera moved"),
    (PointsInAnyOrder, "`points` give the same 'position' as a whole picture"),
]


@pytest.mark.parametrize(("broken", "says"), BROKEN, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_producer_is_found(broken: type[GBufferProducer], says: str) -> None:
    with pytest.raises(AssertionError, match=f"gbuffer {broken.__name__} breaks its contract: .*({says})"):
        check_gbuffer(broken)
