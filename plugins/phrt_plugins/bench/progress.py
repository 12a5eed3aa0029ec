"""What `phrt bench` says while it runs: a bar with the time left on a terminal, else a line now and then; on standard error."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from phrt.cli.console import messages, say, terminal
from phrt_plugins.bench.estimate import Estimate, spoken
from phrt_plugins.bench.plan import Task

LINE_EVERY_S = 30.0
"""Where there is no terminal."""


class RunProgress:
    """Counts tasks by how long they should take. Use it as a context manager."""

    def __init__(self, tasks: Sequence[Task], estimate: Estimate | None) -> None:
        self._weights = {
            _id(task): estimate.seconds(task) if estimate else float(len(task.block.frames)) for task in tasks
        }
        self._total = sum(self._weights.values())
        self._ended = 0.0
        self._open = {_id(task): task.title for task in tasks}
        self._count, self._done = len(tasks), 0
        self._began = self._spoken = time.perf_counter()
        self._bar: Progress | None = None

    def __enter__(self) -> RunProgress:
        console = messages()
        if console.is_terminal and not terminal.quiet:
            columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
            self._bar = Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True)
            self._task = self._bar.add_task(self._now(), total=max(self._total, 1e-9))
            self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def ended(self, task: Task, said: Sequence[str]) -> None:
        """`task` has ended; what went wrong in it is said."""
        self._done += 1
        self._open.pop(_id(task), None)
        self._ended += self._weights.get(_id(task), 0.0)
        for text in said:
            if text not in terminal.warned:
                terminal.warned.append(text)
                messages().print(f"warning: {text}", markup=False)
        if self._bar is not None:
            self._bar.update(self._task, completed=self._ended, description=self._now())
        elif time.perf_counter() - self._spoken > LINE_EVERY_S:
            self._spoken = time.perf_counter()
            say(f"{self._done} of {self._count} done, {self._left()} left: {self._now()}")

    def _now(self) -> str:
        """What runs now, or, of what runs at the same time, the first."""
        return next(iter(self._open.values()), "summing up")

    def _left(self) -> str:
        """The time that is left, if it goes on as so far."""
        share = self._ended / self._total if self._total else 1.0
        return spoken((time.perf_counter() - self._began) * (1 - share) / share) if share else "an unknown time"


def _id(task: Task) -> tuple[str, str, int, int]:
    return task.stage, task.setup.id, task.repeat, task.block.number
