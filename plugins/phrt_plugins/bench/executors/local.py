"""local: worker processes on this machine.

Tasks that measure time run one at a time, and their worker may use every core; others run one on each core, each worker pinned to
its own. A worker that dies is an error of its task and is replaced.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from multiprocessing.connection import wait
from typing import Any

from phrt.workers import usable_cores
from phrt_plugins.bench.executors.base import ByKey, Executor, R, T, TaskError
from phrt_plugins.bench.executors.message import packed, unpacked
from phrt_plugins.bench.executors.process import WorkerProcess


class LocalExecutor(Executor):
    """timing: do tasks measure time? jobs: how many workers otherwise; by default one per core. Workers start when needed."""

    def __init__(self, *, timing: bool, jobs: int | None = None) -> None:
        cores = _cores()
        count = 1 if timing else max(1, jobs or len(cores))
        self.jobs = count
        self.threads = None if timing else 1
        self._seats = [cores] if timing else [[cores[number % len(cores)]] for number in range(count)]
        self._workers: list[WorkerProcess | None] = [None] * count
        self._closed = False

    def run(self, function: Callable[[T], R], tasks: Iterable[T], *, done: Callable[[T, R | TaskError], None]) -> None:
        if self._closed:
            raise RuntimeError("the executor was closed")
        waiting = ByKey(tasks)
        busy: dict[int, T] = {}
        try:
            while busy or len(waiting):
                for seat in range(self.jobs):
                    if seat not in busy:
                        self._employ(seat, function, waiting, busy, done)
                if busy:
                    self._gather(busy, done)
        except BaseException:
            self._kill()
            raise

    def _employ(
        self,
        seat: int,
        function: Callable[[T], R],
        waiting: ByKey[T],
        busy: dict[int, T],
        done: Callable[[T, R | TaskError], None],
    ) -> None:
        """Give the worker at `seat` its next task, if there is one."""
        others = [worker.key for n, worker in enumerate(self._workers) if worker and worker.key and n != seat]
        own = self._workers[seat]
        while (task := waiting.next_for(own.key if own else None, others)) is not None:
            sent = packed(function, task)
            if isinstance(sent, TaskError):
                done(task, sent)
                continue
            self._send(seat, sent).key = task.key
            busy[seat] = task
            return

    def _send(self, seat: int, sent: bytes) -> WorkerProcess:
        """Send to the worker at `seat`; to another one where it is not there, or died while it was idle."""
        worker = self._workers[seat]
        if worker is not None:
            try:
                worker.send(sent)
                return worker
            except OSError:
                worker.kill()
        worker = self._workers[seat] = WorkerProcess(self._seats[seat])
        with suppress(OSError):  # else it is found dead where answers are gathered
            worker.send(sent)
        return worker

    def _gather(self, busy: dict[int, T], done: Callable[[T, R | TaskError], None]) -> None:
        """Wait until somebody has an answer, or is gone."""
        seats = {worker.connection: seat for seat in busy if (worker := self._workers[seat]) is not None}
        for ready in wait(list(seats)):
            seat = seats[ready]  # type: ignore[index]
            done(busy.pop(seat), self._answer_of(seat))

    def _answer_of(self, seat: int) -> Any:
        worker = self._workers[seat]
        assert worker is not None
        try:
            return unpacked(worker.receive())
        except (EOFError, OSError):
            error = TaskError("died", f"the worker (process {worker.pid}) died: {worker.epitaph()}")
            worker.kill()
            self._workers[seat] = None
            return error

    def close(self) -> None:
        self._closed = True
        for worker in self._workers:
            if worker is not None:
                worker.stop()
        self._workers = [None] * self.jobs

    def _kill(self) -> None:
        for worker in self._workers:
            if worker is not None:
                worker.kill()
        self._workers = [None] * self.jobs


def _cores() -> list[int]:
    """Those this process may run on."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(usable_cores()))
