"""What the command line says while it works: everything but results goes to standard error."""

from __future__ import annotations

import sys
import textwrap
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from phrt.errors import PhrtWarning

PROGRESS_AFTER_S = 2.0
FILE_WIDTH = 240
"""Columns of a table that no terminal shows."""


@dataclass
class Terminal:
    """What one run of the command line remembers."""

    debug: bool = False
    quiet: bool = False
    warned: list[str] = field(default_factory=list)
    """Warnings so far, each once, in order."""
    plugins: list[str] = field(default_factory=list)
    """What `--plugin` named, for commands that begin other processes."""


terminal = Terminal()


def messages() -> Console:
    """Standard error, wrapped to the terminal; plain text where it is not one."""
    return Console(stderr=True, highlight=False, soft_wrap=not sys.stderr.isatty())


def results() -> Console:
    """Standard output."""
    return Console(highlight=False, soft_wrap=True)


def line_width() -> int | None:
    """Characters of a line on standard output; None where it is read by a program."""
    return Console().width if sys.stdout.isatty() else None


def print_wrapped(text: str, indent: str = "") -> None:
    """A line on standard output, at the ends of words where it is longer than the terminal is wide; further lines begin with
    `indent`."""
    width = line_width()
    if width is not None and len(text) > width:
        spaces = text[: len(text) - len(text.lstrip())]
        wrapped = textwrap.wrap(
            text.strip(),
            width,
            initial_indent=spaces,
            subsequent_indent=indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
        text = "\n".join(wrapped)
    results().print(text, markup=False)


def print_table(table: object) -> None:
    """A rich table on standard output: as wide as the terminal, or as it likes where it is read by a program."""
    width = None if sys.stdout.isatty() else FILE_WIDTH
    Console(highlight=False, width=width).print(table, overflow="fold")


def say(text: str) -> None:
    """A line on standard error, unless `--quiet`."""
    if not terminal.quiet:
        messages().print(text, markup=False)


@contextmanager
def tidy_warnings() -> Iterator[None]:
    """Print each `PhrtWarning` once, as one line without a place in the source; leave other warnings as they are."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", PhrtWarning)
        others = warnings.showwarning

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if not issubclass(category, PhrtWarning):
                others(message, category, filename, lineno, file, line)
            elif str(message) not in terminal.warned:
                terminal.warned.append(str(message))
                messages().print(f"[yellow]warning:[/yellow] {escape(str(message))}")

        warnings.showwarning = show
        yield


def warn_of(messages: Iterable[str]) -> None:
    """Each message as a `PhrtWarning`."""
    for message in messages:
        warnings.warn(message, PhrtWarning, stacklevel=2)


def escape(text: str) -> str:
    """`text` with nothing in it that rich would take for markup."""
    from rich.markup import escape as rich_escape

    return rich_escape(text)


class DelayedProgress:
    """A progress bar on standard error that shows only when the work takes longer than two seconds.

    Where standard error is no terminal, the present step is said in one plain line instead.
    """

    def __init__(self, total: int, step: str) -> None:
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=messages(),
            transient=True,
        )
        self._task = self._bar.add_task(step, total=total)
        self._step = step
        self._lock = threading.Lock()
        self._ended = False
        self._timer = threading.Timer(PROGRESS_AFTER_S, self._show)
        self._timer.daemon = True

    def __enter__(self) -> DelayedProgress:
        if not terminal.quiet:
            self._timer.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._timer.cancel()
        with self._lock:
            self._ended = True
            if self._bar.live.is_started:
                self._bar.stop()

    def step(self, text: str) -> None:
        """What is being done now."""
        self._step = text
        self._bar.update(self._task, description=text)

    def advance(self) -> None:
        """One more of `total` is done."""
        self._bar.advance(self._task)

    def _show(self) -> None:
        with self._lock:
            if self._ended:
                return
            if self._bar.console.is_terminal:
                self._bar.start()
            else:
                task = self._bar.tasks[0]
                done = f" ({task.completed:.0f} of {task.total:.0f} done)" if task.completed else ""
                self._bar.console.print(f"{self._step} ...{done}", markup=False)
