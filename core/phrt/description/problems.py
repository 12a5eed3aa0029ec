"""Where something was said, and the list of what is wrong with it: all problems of a scene are reported at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from phrt.errors import SceneError

MOST_REPORTED = 20
"""Problems beyond this many are only counted."""

ELSEWHERE = {
    "plugins": "plugins: a scene is data and brings no code. Name plugins where the scene is used: --plugin MODULE_OR_FILE on "
    "the command line, `plugins:` in the config of a benchmark, or phrt.register(...) in Python"
}
"""Keys of scenes that have their place somewhere else, and what is said of them."""


@dataclass(frozen=True)
class Mark:
    """A place in a scene file, or of an override. line: 1-based, 0 where there are no lines."""

    source: str
    line: int = 0
    file: Path | None = None

    def __str__(self) -> str:
        return f"{self.source}:{self.line}" if self.line else self.source


@dataclass(frozen=True)
class Problem:
    mark: Mark
    path: str
    message: str

    def __str__(self) -> str:
        return ": ".join(part for part in (str(self.mark), self.path, self.message) if part)


class Problems:
    """Collects problems while a scene (or what else `subject` is) is read, so that one error names them all."""

    def __init__(self, subject: str = "scene") -> None:
        self._subject = subject
        self._found: list[Problem] = []

    def add(self, mark: Mark, path: str, message: str) -> None:
        problem = Problem(mark, path, message)
        if problem not in self._found:
            self._found.append(problem)

    def __len__(self) -> int:
        return len(self._found)

    def raise_if_any(self) -> None:
        """Raises SceneError with every problem on its own line, file by file and by line within a file."""
        if not self._found:
            return
        sources = list(dict.fromkeys(problem.mark.source for problem in self._found))
        ordered = sorted(self._found, key=lambda problem: (sources.index(problem.mark.source), problem.mark.line))
        if len(ordered) == 1:
            raise SceneError(str(ordered[0]))
        lines = [f"  {problem}" for problem in ordered[:MOST_REPORTED]]
        if len(ordered) > MOST_REPORTED:
            lines.append(f"  ... and {len(ordered) - MOST_REPORTED} more")
        raise SceneError(f"{len(ordered)} problems in the {self._subject}:\n" + "\n".join(lines))


def listed(names: list[str], most: int = 40) -> str:
    """Names as the "allowed" part of a message, long lists cut."""
    shown = ", ".join(names[:most])
    return f"{shown}, ... ({len(names)} in all)" if len(names) > most else shown
