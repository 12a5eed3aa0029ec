"""What only the raycast producer does: some pixels of a view, and motion that counts from whole views."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from phrt.channels import CHANNELS
from phrt.testing.worlds import SIZE, at, front_view, quad, world_of
from phrt_backends.gbuffers.raycast import RaycastProducer
from phrt_backends.gbuffers.raycast_options import RaycastOptions
from phrt_backends.options import NumpyOptions
from phrt_backends.tracers.numpy_bvh import NumpyTracer

SOME = np.array([5, 3, SIZE * SIZE - 1, SIZE * 7 + 2], np.int32)
STEP = front_view(world_from_view=at(0.25, 0.0, 2.0))


@pytest.fixture
def producer() -> Iterator[RaycastProducer]:
    world = world_of([(quad(), at())])
    tracer = NumpyTracer(NumpyOptions())
    tracer.build(world)
    made = RaycastProducer(RaycastOptions(chunk_pixels=64), tracer=tracer)
    made.build(world)
    yield made
    made.close()
    tracer.close()


def spoil(producer: RaycastProducer) -> None:
    """Leave in the producer's buffers what no object has: a partial view may not read it."""
    gbuffer = producer.render(front_view())
    for array in gbuffer.arrays.values():
        array.fill(0xFFFFFF)


def test_some_pixels_are_those_of_the_whole_view(producer: RaycastProducer) -> None:
    producer.render(front_view())
    whole = {name: array.copy() for name, array in producer.render(STEP).arrays.items()}
    producer.build(producer._world)
    spoil(producer)
    some = producer.render(STEP, pixels=SOME)
    for name in CHANNELS:
        expected = whole[name].reshape(SIZE * SIZE, -1)[SOME]
        assert np.array_equal(some.flat(name).reshape(SIZE * SIZE, -1)[SOME], expected), name
    assert np.abs(some.flat("motion")[SOME]).max() > 0.1


def test_motion_counts_from_the_last_whole_view_with_motion(producer: RaycastProducer) -> None:
    producer.render(front_view())
    expected = producer.render(STEP).motion.copy()
    producer.build(producer._world)
    producer.render(front_view())
    producer.render(front_view(world_from_view=at(0.5, 0.0, 2.0)), channels=("depth",))
    producer.render(front_view(world_from_view=at(0.5, 0.0, 2.0)), pixels=SOME)
    assert np.abs(expected).max() > 0.1
    assert np.array_equal(producer.render(STEP).motion, expected)
