"""Cost memory: what rays cost in the last run on this machine, so that the next one does not begin with a guess.

One small JSON file in the user's cache folder (`PHRT_CACHE` names another). It is a convenience: where it cannot be read
or written, a run simply begins without it.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from phrt.errors import OptionError
from phrt.machine import machine_name
from phrt.output.files import complete_file

KEPT_RUNS = 64
"""Runs that are remembered; the oldest are forgotten."""
LARGEST_FILE = 1 << 20
FORMAT = 1

Coefficients = dict[str, dict[str, float]]


def cache_folder() -> Path:
    """Where PHRT keeps what it may lose: PHRT_CACHE, else the system's place for caches."""
    if given := os.environ.get("PHRT_CACHE"):
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "phrt"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "phrt"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "phrt"


def run_key(scene: str, tracer: str, threads: int) -> str:
    """What makes costs comparable: the machine, the tracer and its threads, and the scene."""
    return f"{machine_name()} | {tracer} x{threads} | {scene}"


class CostMemory:
    """What a renderer begins its runs with, read once, and what it leaves for the next one, written once.

    key: as of `run_key`; None remembers nothing.
    """

    def __init__(self, key: str | None) -> None:
        self._key = key
        self._found: Coefficients | None = None
        self._learnt: Coefficients = {}

    def known(self) -> Coefficients:
        """What earlier renderers left, as it was when this was first asked for: no run begins with what another one learnt here."""
        if self._found is None:
            self._found = recall(self._key) if self._key else {}
        return self._found

    def keep(self, coefficients: Coefficients) -> None:
        """A run is over that measured `coefficients`: those of the last one count."""
        self._learnt = coefficients

    def write(self) -> None:
        """Leave what was kept, if anything was."""
        if self._key and self._learnt:
            remember(self._key, self._learnt)


def recall(key: str) -> Coefficients:
    """By effect name what `CostModels.warm` takes; empty where nothing is known."""
    entry = _read().get(key, {})
    effects = entry.get("effects") if isinstance(entry, dict) else None
    if not isinstance(effects, dict):
        return {}
    return {str(name): values for name, values in effects.items() if _is_sound(values)}


def remember(key: str, coefficients: Mapping[str, Mapping[str, float]]) -> None:
    """Keep `coefficients` for the next run. Another process may do so at the same time: the later one wins."""
    runs = _read()
    runs[key] = {"time": time.time(), "effects": {name: dict(values) for name, values in coefficients.items()}}
    newest = sorted(runs.items(), key=lambda run: -_written(run[1]))[:KEPT_RUNS]
    path = cache_folder() / "costs.json"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with complete_file(path) as temporary:
            temporary.write_text(json.dumps({"phrt_costs": FORMAT, "runs": dict(newest)}, indent=1))
    except (OSError, OptionError):
        return


def _read() -> dict[str, object]:
    path = cache_folder() / "costs.json"
    try:
        if path.stat().st_size > LARGEST_FILE:
            return {}
        found = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict) or found.get("phrt_costs") != FORMAT or not isinstance(found.get("runs"), dict):
        return {}
    return dict(found["runs"])


def _written(run: object) -> float:
    """Seconds since 1970."""
    written = run.get("time") if isinstance(run, dict) else None
    return float(written) if isinstance(written, (int, float)) else 0.0


def _is_sound(values: object) -> bool:
    """Are these coefficients that a fit may begin with?"""
    return (
        isinstance(values, dict)
        and set(values) == {"ms_per_item", "ms_per_ray"}
        and all(isinstance(v, (int, float)) and math.isfinite(v) and 0 <= v < 1e6 for v in values.values())
    )
