"""Tasks for executors: what a worker process can find by import."""

from __future__ import annotations

import os
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phrt_plugins.bench.executors import Executor, TaskError

KEPT: list[str] = []
"""Names of the tasks that this process has done."""


@dataclass(frozen=True)
class Job:
    """What `work` is to do: `action` with `value`."""

    key: str
    name: str
    action: str = "tell"
    value: Any = None


@dataclass(frozen=True)
class Told:
    """What a worker says of itself, and the jobs it did before."""

    process: int
    thread: int
    cores: tuple[int, ...]
    before: tuple[str, ...]
    value: Any = None


class Stubborn:
    """Cannot be pickled."""

    def __reduce__(self) -> Any:
        raise TypeError("no copies")


class Fragile:
    """Can be pickled, but not read again."""

    def __reduce__(self) -> Any:
        return int, ("no number",)


def work(job: Job) -> Any:
    """Do `job`, in whatever process this is."""
    before = tuple(KEPT)
    KEPT.append(job.name)
    match job.action:
        case "raise":
            raise ValueError(f"{job.name} does not like {job.value}")
        case "exit":
            raise SystemExit(3)
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "sleep":
            time.sleep(job.value)
        case "note":
            Path(job.value).write_text(str(os.getpid()))
            time.sleep(600)
        case "stubborn":
            return Stubborn()
        case "fragile":
            return Fragile()
    value = meet(Path(job.value), job.key) if job.action == "meet" else job.value
    return Told(os.getpid(), threading.get_ident(), tuple(sorted(os.sched_getaffinity(0))), before, value)


def meetings(folder: Path, keys: str, count: int) -> list[Job]:
    """Jobs of which those with the same number are there at the same time, so that no worker gets ahead of the others."""
    return [Job(key, f"{key}{n}", "meet", str(folder / str(n))) for n in range(count) for key in keys]


def meet(folder: Path, name: str) -> bool:
    """Is somebody else at work at the same time? Waits for it for a while."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).touch()
    until = time.monotonic() + 20
    while time.monotonic() < until:
        if len(list(folder.iterdir())) > 1:
            return True
        time.sleep(0.01)
    return False


def results(executor: Executor, jobs: list[Job]) -> dict[str, Any]:
    """By name of the job what came of it; every one has ended once."""
    found: dict[str, Any] = {}

    def done(job: Job, result: Any) -> None:
        assert job.name not in found
        found[job.name] = result

    executor.run(work, jobs, done=done)
    assert set(found) == {job.name for job in jobs}
    return found


def reason(result: Any, kind: str) -> str:
    """Of an error of this kind."""
    assert isinstance(result, TaskError), result
    assert result.kind == kind
    assert "\n" not in result.reason
    return result.reason
