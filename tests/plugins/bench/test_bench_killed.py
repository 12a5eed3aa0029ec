"""Killed at any moment and resumed, a run ends as one that was never killed; what was finished is never rendered again.

PHRT_BENCH_KILLS says how many times a run is killed; 2 by default.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from run_bench_kit import results, write_config

KILLS = int(os.environ.get("PHRT_BENCH_KILLS", "2"))
START_S = 0.5
"""Before that nothing but imports happens."""


@dataclass(frozen=True)
class Undisturbed:
    """A run that nobody killed. seconds: what it took; files: in its folder at the end."""

    config: Path
    results: dict[str, str]
    seconds: float
    files: int


def start(config: Path, run: Path, cache: Path, *more: str) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        "phrt.cli",
        "bench",
        str(config),
        "-o",
        str(run),
        "--cache",
        str(cache),
        "-q",
        *more,
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def ended(process: subprocess.Popen[str]) -> None:
    said, _ = process.communicate(timeout=300)
    assert process.returncode == 0, said


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    folder = tmp_path_factory.mktemp("undisturbed")
    config = write_config(folder, budgets=["half", "900rays"], block=3, oracle=True)
    began = time.perf_counter()
    ended(start(config, folder / "run", folder / "cache"))
    seconds = time.perf_counter() - began
    return Undisturbed(config, results(folder / "run"), seconds, files_in(folder / "run"))


def files_in(run: Path) -> int:
    return sum(len(names) for _, _, names in os.walk(run))


def finished_blocks(run: Path) -> dict[Path, int]:
    """The folders that are said to be whole, and the time their measures were written."""
    folders = [p for p in run.glob("cells/*/block-*") if not p.name.endswith(".part")]
    folders += [p for p in run.glob("references/*/block-*") if not p.name.endswith(".part")]
    return {path: (path / "measures.parquet").stat().st_mtime_ns for path in folders}


def kill_at(process: subprocess.Popen[str], run: Path, moment: float, files: int | None) -> bool:
    """Kill -9 after `moment` seconds, or, where `files` is given, as soon as there are so many in the folder. False where the
    process ended before."""
    began = time.perf_counter()
    while process.poll() is None:
        if files is not None and files_in(run) >= files:
            break
        if files is None and time.perf_counter() - began >= moment:
            break
        time.sleep(0.0005)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    return process.returncode == -signal.SIGKILL


def test_killed_at_random_moments_it_ends_the_same(undisturbed: Undisturbed, tmp_path: Path) -> None:
    moments = random.Random(4)
    killed, rounds = 0, 0
    run, cache = tmp_path / "run-0", tmp_path / "cache-0"
    while killed < KILLS:
        # Half of the moments are by the clock, half by what is on the disk: in the middle of writing.
        by_files = moments.random() < 0.5
        files = files_in(run) + moments.randint(1, undisturbed.files // 3) if by_files else None
        before = finished_blocks(run)
        process = start(undisturbed.config, run, cache, "--resume")
        if kill_at(process, run, moments.uniform(START_S, undisturbed.seconds), files):
            killed += 1
        else:
            assert process.returncode == 0
        whole = finished_blocks(run)
        assert before.items() <= whole.items(), "a finished block was rendered again"
        kept = {path: hashed for path, hashed in results(run).items() if ".part" not in path}
        wrong = [
            path for path, hashed in kept.items() if path in undisturbed.results and undisturbed.results[path] != hashed
        ]
        assert wrong == []
        if process.returncode == 0:
            assert results(run) == undisturbed.results
            rounds += 1
            run, cache = tmp_path / f"run-{rounds}", tmp_path / f"cache-{rounds}"
    before = finished_blocks(run)
    ended(start(undisturbed.config, run, cache, "--resume"))
    assert results(run) == undisturbed.results
    assert before.items() <= finished_blocks(run).items()
    assert not list(run.rglob("*.part"))


def test_interrupted_by_hand_it_says_so(undisturbed: Undisturbed, tmp_path: Path) -> None:
    import json

    run = tmp_path / "run"
    process = start(undisturbed.config, run, tmp_path / "cache")
    while process.poll() is None and not list(run.glob("cells/*/block-000")):
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert json.loads((run / "bench.json").read_text())["state"] == "ended early"
    assert not list(run.rglob("*.part"))
    ended(start(undisturbed.config, run, tmp_path / "cache", "--resume"))
    assert results(run) == undisturbed.results
    assert json.loads((run / "bench.json").read_text())["state"] == "finished"
