"""dask://host:port: the workers of an existing Dask cluster, on which PHRT is installed and the same folders are mounted.

A worker process has one of our tasks at a time, whatever its number of threads, and does them all in one thread, so that it can
keep a renderer. Of several workers on one machine only one is used for tasks that measure time. That is why tasks are handed out
here, each to one worker, instead of leaving it to Dask's scheduler. Example, on two machines that share a folder:

    dask scheduler                                     # on the first; says tcp://192.0.2.1:8786
    dask worker tcp://192.0.2.1:8786 --nthreads 1      # on both; --nworkers N as well for tasks that measure no time
    phrt bench scenes/benchmarks/standard.yaml -o shared/standard --executor dask://192.0.2.1:8786

What a worker has begun cannot be taken from it: after Ctrl-C it does its task to the end.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any, Generic
from urllib.parse import urlsplit

from phrt.errors import OptionError
from phrt.registry.manager import describe
from phrt_plugins.bench.executors.base import ByKey, Executor, R, T, TaskError
from phrt_plugins.bench.executors.message import answer, packed, unpacked

LOOK_EVERY_S = 1.0
"""How often it is asked which workers there are."""
WITHOUT_WORKERS_S = 60.0
"""How long to wait for a worker to come (back) before what is left is given up."""

_one_thread = ThreadPoolExecutor(1, thread_name_prefix="phrt-bench")


def answer_alone(sent: bytes) -> bytes:
    """On a worker: `answer`, one at a time and always in the same thread."""
    return _one_thread.submit(answer, sent).result()


class ClusterExecutor(Executor):
    """where: "dask://host:port" of the scheduler; timing: do tasks measure time?; patience_s: how long to wait for it to answer.

    Raises OptionError where `distributed` is not installed, nobody answers, or the cluster has no workers.
    """

    def __init__(
        self, where: str, *, timing: bool, patience_s: float = 10.0, without_workers_s: float = WITHOUT_WORKERS_S
    ) -> None:
        self._where = where
        self._client = _connected(where, patience_s)
        self._without_workers_s = without_workers_s
        self._timing = timing
        self.threads = None if timing else 1
        self.jobs = len(self._seats())
        if not self.jobs:
            self.close()
            raise OptionError(f"the Dask cluster at '{where}' has no workers; start some with 'dask worker'")

    def run(self, function: Callable[[T], R], tasks: Iterable[T], *, done: Callable[[T, R | TaskError], None]) -> None:
        if self._client is None:
            raise RuntimeError("the executor was closed")
        dispatch = _Dispatch(self._client, function, ByKey(tasks), done)
        seen = time.monotonic()
        try:
            while dispatch.has_more:
                try:
                    seats = self._seats()
                except Exception as error:
                    dispatch.give_up(f"the Dask scheduler at '{self._where}' is gone: {describe(error)}")
                    return
                seen = time.monotonic() if seats else seen
                if time.monotonic() - seen > self._without_workers_s:
                    dispatch.give_up(f"the Dask cluster at '{self._where}' has no workers any more")
                    return
                dispatch.mourn(seats)
                dispatch.employ(seats)
                dispatch.gather(LOOK_EVERY_S)
        except BaseException:
            dispatch.cancel()
            raise

    def close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close(timeout=5)

    def _seats(self) -> list[str]:
        """Addresses of the workers to use: all, or one of each machine where time is measured."""
        from distributed.comm import get_address_host

        addresses = sorted(self._client.nthreads())
        if not self._timing:
            return addresses
        by_machine: dict[str, str] = {}
        for address in addresses:
            by_machine.setdefault(get_address_host(address), address)
        return list(by_machine.values())


class _Dispatch(Generic[T, R]):
    """One `run`: who has which task. Answers come through a queue, from the client's threads."""

    def __init__(
        self,
        client: Any,
        function: Callable[[T], R],
        waiting: ByKey[T],
        done: Callable[[T, R | TaskError], None],
    ) -> None:
        self._client, self._function, self._waiting, self._done = client, function, waiting, done
        self._busy: dict[str, tuple[T, Any]] = {}
        self._last_key: dict[str, str] = {}
        self._ended: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()

    @property
    def has_more(self) -> bool:
        return bool(self._busy or len(self._waiting))

    def employ(self, seats: list[str]) -> None:
        """A task for everybody who has none."""
        for seat in seats:
            while seat not in self._busy:
                others = [key for other, key in self._last_key.items() if other != seat]
                task = self._waiting.next_for(self._last_key.get(seat), others)
                if task is None:
                    return
                sent = packed(self._function, task)
                if isinstance(sent, TaskError):
                    self._done(task, sent)
                    continue
                self._last_key[seat] = task.key
                future = self._client.submit(answer_alone, sent, workers=[seat], pure=False, retries=0)
                self._busy[seat] = task, future
                future.add_done_callback(lambda ended, seat=seat: self._ended.put((seat, ended)))

    def gather(self, patience_s: float) -> None:
        """Wait for an answer, and take all there are."""
        with suppress(queue.Empty):
            self._take(*self._ended.get(timeout=patience_s))
            while True:
                self._take(*self._ended.get_nowait())

    def _take(self, seat: str, future: Any) -> None:
        if seat not in self._busy or self._busy[seat][1] is not future:
            return
        task, _ = self._busy.pop(seat)
        self._done(task, _result_of(future, seat))

    def mourn(self, seats: list[str]) -> None:
        """Tasks of workers that are not there any more are over; those that came in the meantime get others."""
        for seat in [seat for seat in self._last_key if seat not in seats]:
            del self._last_key[seat]
            if seat in self._busy and not self._busy[seat][1].done():
                task, future = self._busy.pop(seat)
                future.cancel()
                self._done(task, TaskError("died", f"the Dask worker at {seat} is gone"))

    def give_up(self, reason: str) -> None:
        """Nobody is left: what was not done is an error."""
        left = [task for task, _ in self._busy.values()]
        self.cancel()
        while (task := self._waiting.next_for(None)) is not None:
            left.append(task)
        for task in left:
            self._done(task, TaskError("died", reason))

    def cancel(self) -> None:
        """What was not begun is not begun; what comes back now is not waited for."""
        for _, future in self._busy.values():
            with suppress(Exception):
                future.cancel()
        self._busy.clear()


def _result_of(future: Any, seat: str) -> Any:
    """The result of a future that has ended, or its TaskError."""
    if future.status == "finished":
        try:
            return unpacked(future.result(timeout=60))
        except Exception as error:
            return TaskError("died", f"the answer of the Dask worker at {seat} is lost: {describe(error)}")
    if future.status == "cancelled":
        return TaskError("died", f"the Dask worker at {seat} is gone")
    raised = future.exception(timeout=60)
    reason = f"on the Dask worker at {seat}: {describe(raised)}"
    return TaskError("died" if type(raised).__name__ == "KilledWorker" else "raised", reason)


def _connected(where: str, patience_s: float) -> Any:
    """A client of the scheduler that `where` names."""
    parts = urlsplit(where)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or not port or parts.path.strip("/"):
        raise OptionError(f"the executor is '{where}', expected dask://host:port, as in dask://192.0.2.1:8786")
    try:
        import distributed
    except ImportError as error:
        raise OptionError(f"'{where}' needs the package distributed ({error}): pip install 'phrt[cluster]'") from error
    host = f"[{host}]" if ":" in host else host
    try:
        return distributed.Client(f"tcp://{host}:{port}", timeout=patience_s, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise OptionError(f"no Dask scheduler answers at '{where}' within {patience_s:g} s") from error
