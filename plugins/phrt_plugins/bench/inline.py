"""An executor that does the tasks here, one after the other: for Python use, where plugins may live in a notebook."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from phrt.registry.manager import describe
from phrt_plugins.bench.executors import Executor, TaskError
from phrt_plugins.bench.executors.base import R, T


class InlineExecutor(Executor):
    """Everything in this process, with all its threads."""

    jobs = 1
    threads = None

    def run(self, function: Callable[[T], R], tasks: Iterable[T], *, done: Callable[[T, R | TaskError], None]) -> None:
        for task in tasks:
            result: R | TaskError
            try:
                result = function(task)
            except Exception as error:
                result = TaskError("raised", describe(error))
            done(task, result)

    def close(self) -> None:
        from phrt_plugins.bench.worker import release

        release()
