"""Executor: runs the tasks of a comparison somewhere else, in worker processes here or on a cluster, and hands back what they gave.

A worker lives as long as the executor and may keep things between tasks in its modules, an open renderer say: tasks with the same
`key` go to the same worker where possible.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import Generic, Literal, Protocol, Self, TypeVar


class Keyed(Protocol):
    """A task: anything that can be pickled and says what it needs. Tasks of one `key` share what a worker keeps."""

    @property
    def key(self) -> str: ...


@dataclass(frozen=True)
class TaskError:
    """A task that gave no result. The others go on.

    kind   : "raised", it raised; "died", its worker ended in the middle (killed, out of memory); "refused", what was sent or
             given back cannot be pickled
    reason : one line: "OptionError: budget is ..."
    details: the traceback where there is one, else empty
    """

    kind: Literal["raised", "died", "refused"]
    reason: str
    details: str = ""


T = TypeVar("T", bound=Keyed)
R = TypeVar("R")


class Executor(ABC):
    """Contract: `run` any number of times, then `close`; a context manager. Used from one thread.

    jobs   : how many tasks run at the same time
    threads: how many threads a task should use; None for as many as its worker may run on
    """

    jobs: int
    threads: int | None

    @abstractmethod
    def run(self, function: Callable[[T], R], tasks: Iterable[T], *, done: Callable[[T, R | TaskError], None]) -> None:
        """`function` of every task, in a worker; `done(task, result)` as each ends, in the caller's thread, in any order.

        function: found by import, so at the top level of a module; tasks and results must be picklable.
        Returns when all have ended. What `done` raises, and KeyboardInterrupt, ends the workers and is raised.
        """

    @abstractmethod
    def close(self) -> None:
        """End the workers. Nothing can be run after it; closing again does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class ByKey(Generic[T]):
    """Tasks that wait: `next_for` prefers those of the key that a worker had last, else of a key that nobody has."""

    def __init__(self, tasks: Iterable[T]) -> None:
        self._waiting: dict[str, list[T]] = {}
        for task in tasks:
            self._waiting.setdefault(task.key, []).append(task)

    def __len__(self) -> int:
        return sum(map(len, self._waiting.values()))

    def next_for(self, last_key: str | None, held: Iterable[str] = ()) -> T | None:
        """The next task for a worker that did `last_key`, others being busy with the keys `held`; None when there is none.

        Without one of its own it takes from the first key that is not held, else from the key with most left to do.
        """
        if not self._waiting:
            return None
        busy = set(held)
        free = [key for key in self._waiting if key not in busy]
        key = last_key if last_key in self._waiting else None
        if key is None:
            key = free[0] if free else max(self._waiting, key=lambda name: len(self._waiting[name]))
        tasks = self._waiting[key]
        task = tasks.pop(0)
        if not tasks:
            del self._waiting[key]
        return task
