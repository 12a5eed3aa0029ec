"""Arrays that are used again, and the pool of threads."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from phrt.buffers import BufferPool
from phrt.workers import Workers, chunks, usable_cores


def test_an_array_is_handed_out_again_once_nobody_holds_it() -> None:
    pool = BufferPool()
    first = pool.take((100, 3))
    address = first.ctypes.data
    del first
    assert pool.take((100, 3)).ctypes.data == address


def test_an_array_or_a_view_of_it_that_is_held_is_never_handed_out() -> None:
    pool = BufferPool()
    held = pool.take((100, 3))
    view = held.reshape(-1)[10:20]
    address = held.ctypes.data
    assert pool.take((100, 3)).ctypes.data != address
    del held
    assert all(pool.take((100, 3)).ctypes.data != address for _ in range(3))
    del view
    taken = [pool.take((100, 3)) for _ in range(2)]
    assert address in {array.ctypes.data for array in taken}


def held_bytes(pool: BufferPool) -> int:
    return sum(block.memory.nbytes for blocks in pool._blocks.values() for block in blocks)


def test_what_a_caller_kept_and_let_go_is_given_back_after_a_while() -> None:
    pool = BufferPool()
    kept = [pool.take((1000, 3)) for _ in range(50)]
    other = pool.take((7, 7))
    assert held_bytes(pool) > 50 * 12000
    addresses = {pool.take((1000, 3)).ctypes.data for _ in range(600)}
    assert len(addresses) == 1
    assert held_bytes(pool) > 50 * 12000, "nothing that is held is given back"
    kept[7][:] = 7
    first = kept[7]
    del kept, other
    for _ in range(600):
        pool.take((1000, 3))
    assert held_bytes(pool) < 4 * 30000
    assert np.all(first == 7)


def test_a_steady_loop_takes_the_same_memory_for_ever() -> None:
    pool = BufferPool()
    frames: list[list[np.ndarray]] = []
    seen: set[int] = set()
    for number in range(300):
        frame = [pool.take((100, 3)) for _ in range(5)]
        if number >= 3:
            assert {array.ctypes.data for array in frame} <= seen
        seen |= {array.ctypes.data for array in frame}
        frames = [*frames[-1:], frame]
    assert len(seen) <= 15


def test_shapes_and_types_are_kept_apart() -> None:
    pool = BufferPool()
    array = pool.take((4, 2), np.uint8)
    assert (array.shape, array.dtype) == ((4, 2), np.uint8)
    assert pool.take((4, 2)).dtype == np.float32


@pytest.mark.parametrize(
    ("count", "size", "parts"), [(0, 10, 1), (1, 10, 4), (100, 7, 1), (100, 7, 4), (8192, 8192, 3), (3, 1, 8)]
)
def test_chunks_cover_everything_once_in_nearly_equal_parts(count: int, size: int, parts: int) -> None:
    pieces = chunks(count, size, parts)
    assert [i for piece in pieces for i in range(piece.start, piece.stop)] == list(range(count))
    lengths = [piece.stop - piece.start for piece in pieces]
    if count:
        assert max(lengths) - min(lengths) <= 1
        assert max(lengths) <= size
        assert len(pieces) % parts == 0 or len(pieces) == count


@pytest.mark.parametrize("threads", [1, 3])
def test_map_keeps_the_order_and_uses_its_threads(threads: int) -> None:
    workers = Workers(threads)
    barrier = threading.Barrier(threads, timeout=10)

    def meet(item: int) -> tuple[int, int]:
        barrier.wait()
        return item * item, threading.get_ident()

    results = workers.map(meet, range(6))
    workers.close()
    assert [value for value, _ in results] == [0, 1, 4, 9, 16, 25]
    assert len({thread for _, thread in results}) == threads
    assert ({thread for _, thread in results} == {threading.get_ident()}) is (threads == 1)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_exception_reaches_the_caller(threads: int) -> None:
    workers = Workers(threads)
    with pytest.raises(ZeroDivisionError):
        workers.map(lambda item: 1 // item, [1, 0, 2])
    assert workers.map(abs, [-1]) == [1]
    workers.close()


def test_by_default_there_is_a_thread_for_each_usable_core() -> None:
    workers = Workers()
    assert workers.threads == usable_cores() >= 1
    workers.close()


def test_a_worker_may_map_on_its_own_pool() -> None:
    workers = Workers(2)
    try:
        assert workers.map(lambda n: workers.map(lambda m: n * m, range(4)), range(8)) == [
            [n * m for m in range(4)] for n in range(8)
        ]
    finally:
        workers.close()


def test_everything_has_ended_when_an_exception_arrives() -> None:
    workers, ended = Workers(2), []

    def work(n: int) -> None:
        if n == 0:
            raise ValueError("first")
        ended.append(n)

    try:
        with pytest.raises(ValueError, match="first"):
            workers.map(work, range(20))
        assert sorted(ended) == list(range(1, 20))
    finally:
        workers.close()
