"""The comparison for Python: `compare`."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phrt.errors import PhrtError
from phrt_plugins.bench.checks import checked_plan, plugin_source
from phrt_plugins.bench.executors import Executor
from phrt_plugins.bench.inline import InlineExecutor
from phrt_plugins.bench.reading import config_of
from phrt_plugins.bench.references import default_cache
from phrt_plugins.bench.run import run_bench
from phrt_plugins.bench.worker import Work

if TYPE_CHECKING:
    import pandas

Entry = str | Mapping[str, Any]


class CompareError(PhrtError):
    """Some cells of a comparison failed; the message has each with its reason, and says where the others are."""


def compare(
    scene: str | PathLike[str] | Mapping[str, Any] | Sequence[Entry],
    heuristics: Sequence[Entry],
    *,
    budgets: str | Sequence[str] = "none",
    frames: str | None = None,
    size: str | tuple[int, int] | Sequence[str] = "640x360",
    folder: str | PathLike[str] | None = None,
    resume: bool = False,
    executor: str | Executor | None = None,
    cache: str | PathLike[str] | None = None,
    **config: Any,
) -> pandas.DataFrame:
    """Compare `heuristics` on `scene` and return the summary: a row per contestant and metric, with 95 % intervals.

    scene     : a scene file, or entries of `scenes` of a config
    heuristics: names, or entries of `heuristics` of a config: {"heuristic": "gain", "label": "calm", "options": {...}}
    budgets   : "50ms", "rays:20ms", "200000rays", "half", "none", or several
    frames    : "A:B" of the scene's; by default all
    folder    : where everything is kept, as `phrt bench` does; by default in a folder that is gone afterwards
    resume    : go on with what is in `folder`
    executor  : "local" for other processes, "dask://host:port"; by default this process, where a notebook's plugins are known
    cache     : where references are kept
    config    : any other key of a config, such as clock={"rays": 100}, repeats=3, metrics=["flip"], oracle=True

    Raises OptionError for what cannot be, and CompareError where cells fail; `folder` then holds what was done.
    """
    scenes = [scene] if isinstance(scene, (str, PathLike, Mapping)) else list(scene)
    sizes = [size] if isinstance(size, str) else ["x".join(map(str, size))] if isinstance(size, tuple) else list(size)
    values: dict[str, Any] = {
        "name": "compare",
        "scenes": [_scene_entry(entry, frames) for entry in scenes],
        "heuristics": [dict(entry) if isinstance(entry, Mapping) else entry for entry in heuristics],
        "budgets": [budgets] if isinstance(budgets, str) else list(budgets),
        "sizes": sizes,
    }
    file = config_of(values | config)
    plan = checked_plan(file)
    with ExitStack() as closing:
        root = (
            Path(folder) if folder else Path(closing.enter_context(tempfile.TemporaryDirectory(prefix="phrt-"))) / "run"
        )
        where = executor or closing.enter_context(InlineExecutor())
        sources = tuple(plugin_source(source, file.folder) for source in file.config.plugins)
        metrics = None if file.config.metrics is None else tuple(file.config.metrics)
        work = Work(str(root.absolute()), str(Path(cache or default_cache()).absolute()), metrics, sources)
        outcome = run_bench(file, plan, work, resume=resume, executor=where)
        if outcome.failures or outcome.problems:
            raise CompareError(_told(outcome.failures, outcome.problems, root if folder else None))
        return _summary(root)


def _scene_entry(entry: Any, frames: str | None) -> dict[str, Any]:
    made = dict(entry) if isinstance(entry, Mapping) else {"scene": str(entry)}
    return made | ({"frames": frames} if frames is not None else {})


def _told(failures: Mapping[str, Mapping[str, Any]], problems: Sequence[Mapping[str, str]], folder: Path | None) -> str:
    lines = [f"{cell}: {failure['reason']}" for cell, failure in failures.items()]
    lines += [f"{problem['stage']} of {problem['setup']}: {problem['reason']}" for problem in problems]
    kept = f"; the others are in '{folder}'" if folder else ""
    return f"{len(lines)} parts of the comparison failed{kept}:\n  " + "\n  ".join(lines)


def _summary(root: Path) -> pandas.DataFrame:
    import pandas

    return pandas.read_parquet(root / "summary.parquet")
