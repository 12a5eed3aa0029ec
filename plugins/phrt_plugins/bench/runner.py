"""A benchmark's run: begins or resumes a folder, has the tasks done stage by stage, and keeps account of what became of them."""

from __future__ import annotations

import secrets
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from typing import Any

from phrt.errors import OptionError, PhrtWarning
from phrt.output.files import complete_file
from phrt.recording.arrow import import_arrow
from phrt.recording.config import machine, versions
from phrt.recording.folder import plain
from phrt.recording.recorder import now
from phrt_plugins.bench.content import code_digest
from phrt_plugins.bench.executors import Executor, TaskError
from phrt_plugins.bench.plan import STAGES, Plan, Stage, Task
from phrt_plugins.bench.plugin_code import codes_of
from phrt_plugins.bench.reading import ConfigFile
from phrt_plugins.bench.references import reference_rays
from phrt_plugins.bench.store import BENCH_FILE, BENCH_VERSION, CONFIG_FILE, Store
from phrt_plugins.bench.worker import Done, Failure, Work, do
from phrt_plugins.metrics.measure import all_columns, default_metrics, make_metrics

SHOWN_DIFFERENCES = 8


class BenchRunner:
    """One run of `plan` in the folder of `store`. failures: by cell, why it failed, those of earlier runs included; problems: what
    else went wrong, by setup and stage; seconds: what was spent on what."""

    def __init__(self, file: ConfigFile, plan: Plan, store: Store, work: Work) -> None:
        import_arrow()
        self.file, self.plan, self.store = file, plan, store
        self.work = replace(work, token=secrets.token_hex(8))
        self.failures: dict[str, dict[str, Any]] = {}
        self.problems: list[dict[str, str]] = []
        self.seconds: dict[str, float] = {}
        self._again: list[Task] = []
        self._about: dict[str, Any] = {}

    # Beginning

    def plugins(self) -> list[str]:
        """All that the run uses and that does not ship with PHRT, each "kind/name"."""
        used = [which for setup in self.plan.setups for which in setup.plugins]
        used += [which for cell in self.plan.cells for which in cell.plugins]
        wanted = self.file.config.metrics
        metrics = default_metrics() if wanted is None else wanted
        return list(dict.fromkeys([*used, *codes_of([("metric", name) for name in metrics])]))

    def check_folder(self, resume: bool) -> None:
        """Nothing is changed. Raises OptionError where the folder holds something else, or a run that is not to be resumed."""
        root = self.store.root
        if root.exists() and not root.is_dir():
            raise OptionError(f"cannot write into '{root}': it is a file, not a folder")
        about = self.store.about() if resume else None
        if about is None and not self.store.is_empty():
            holds = (root / BENCH_FILE).exists()
            why = (
                "it holds a benchmark already (--resume goes on with it)"
                if holds
                else "it is not empty, and holds no benchmark"
            )
            raise OptionError(f"cannot write into '{root}': {why}")

    def begin(self, *, resume: bool = False, retry_failed: bool = False) -> None:
        """Make the folder this run's. Raises OptionError as `check_folder`, and where it holds the run of another config."""
        self.check_folder(resume)
        root, about = self.store.root, self.store.about() if resume else None
        metrics = make_metrics(self.file.config.metrics, strict=self.work.strict)
        self._about = {
            "phrt_bench": BENCH_VERSION,
            "name": self.file.config.name,
            "title": self.file.config.title,
            "state": "running",
            "config": self.file.config.model_dump(mode="json"),
            "plan": self.plan.as_json(),
            "columns": [asdict(column) for column in all_columns(metrics)],
            "metrics": codes_of([("metric", metric.name) for metric in metrics]),
            "versions": versions(),
            "code": code_digest(),
            "machine": machine(),
            "started": now(),
            "finished": None,
        }
        if about is not None:
            self._check_same(about)
            self._about["started"] = about.get("started")
        try:
            root.mkdir(parents=True, exist_ok=True)
            self.store.take_over(self.work.token)
            self.store.sweep()
            self._write_config()
            self.store.write_about(self._about)
        except OSError as error:
            raise OptionError(f"cannot write into '{root}': {error.strerror or error}") from error
        for cell in self.plan.cells:
            if retry_failed:
                self.store.forgive(cell.id)
            elif (failure := self.store.failure(cell.id)) is not None:
                self.failures[cell.id] = failure

    def _check_same(self, about: Mapping[str, Any]) -> None:
        """Raises OptionError where the folder's run is of another config, or its scenes have changed."""
        mine = plain(self._about)
        differences = [
            f"{key} is {_shown(new)}, was {_shown(old)}"
            for key, old, new in different(about.get("config"), mine["config"])
        ]
        if not differences:
            then = {setup["id"]: setup for setup in (about.get("plan") or {}).get("setups", ())}
            for setup in self.plan.setups:
                was = then.get(setup.id, {})
                if was.get("content") != setup.content:
                    differences.append(f"the scene '{setup.scene}' ({setup.file}) is not what it was")
                differences += _changed_codes(was.get("plugins"), setup.plugins)
                if was.get("reference") != plain(asdict(setup))["reference"]:
                    differences.append("what path traces the reference is another version")
            differences += _changed_codes(about.get("metrics"), mine["metrics"])
        if differences:
            shown = list(dict.fromkeys(differences))
            more = f"\n  ... and {len(shown) - SHOWN_DIFFERENCES} more" if len(shown) > SHOWN_DIFFERENCES else ""
            raise OptionError(
                f"'{self.store.root}' holds the run of another config and cannot be resumed with this one:\n  "
                + "\n  ".join(shown[:SHOWN_DIFFERENCES])
                + more
            )
        changed = [name for name, old, new in different(about.get("versions"), mine["versions"])]
        if not changed and about.get("code") != mine["code"]:
            changed = ["PHRT's sources"]
        if changed:
            warnings.warn(
                f"'{self.store.root}' was begun with other versions of {', '.join(changed)}", PhrtWarning, stacklevel=3
            )

    def _write_config(self) -> None:
        text = self.file.text or _as_yaml(self.file.value.plain())
        with complete_file(self.store.root / CONFIG_FILE) as temporary:
            temporary.write_text(text, encoding="utf-8")

    # Running

    def remaining(self, stage: Stage) -> list[Task]:
        """The tasks of `stage` that are not done, and can be."""
        return [task for task in self.plan.tasks(stage) if self._is_open(task)]

    def _is_open(self, task: Task) -> bool:
        setup, block, store = task.setup, task.block, self.store
        if task.stage == "cells":
            return any(not store.cell_block(c.id, block).is_dir() for c in task.cells if c.id not in self.failures)
        if all(cell.id in self.failures for cell in self.plan.cells_of(setup.id)):
            return False
        where = store.reference_block if task.stage == "reference" else store.oracle_block
        return not where(setup.id, block).exists()

    def run(self, executor: Executor, told: Callable[[Task, list[str]], None]) -> None:
        """Do everything that remains. told: called as each task ends, with what went wrong in it."""
        with self._accounted():
            for stage in STAGES:
                if stage == "cells":
                    self._begin_cells()
                self._run_all(executor, self.remaining(stage), told)
                again, self._again = self._again, []
                self._run_all(executor, again, told)

    def _run_all(self, executor: Executor, tasks: list[Task], told: Callable[[Task, list[str]], None]) -> None:
        began = time.perf_counter()

        def done(task: Task, result: Done | TaskError) -> None:
            told(task, self._ended(task, result))

        executor.run(partial(do, self.work), tasks, done=done)
        self.seconds["working"] = self.seconds.get("working", 0.0) + time.perf_counter() - began

    @contextmanager
    def _accounted(self) -> Iterator[None]:
        """However it ends, bench.json says so."""
        state, began = "ended early", time.perf_counter()
        try:
            yield
            state = "finished"
        finally:
            self.seconds["wall"] = time.perf_counter() - began
            self.store.sweep()
            self._about |= {"state": state, "finished": now(), "problems": self.problems, "time": self.time()}
            self._about["failed"] = sorted(self.failures)
            try:
                self.store.write_about(self._about)
            except OSError as error:
                warnings.warn(f"bench.json cannot be written: {error.strerror or error}", PhrtWarning, stacklevel=3)

    def _begin_cells(self) -> None:
        """Write cell.json for every cell: what half of the rays is, is known by now."""
        halves = {setup.id: self._half_rays(setup.id) for setup in self.plan.setups}
        for cell in self.plan.cells:
            try:
                self.store.begin_cell(cell.settings(halves[cell.setup]))
            except OSError as error:
                self._fail(
                    cell.id, None, Failure(cell.id, "disk", f"cell.json cannot be written: {error.strerror or error}")
                )

    def _half_rays(self, setup: str) -> float | None:
        """Half of the mean of the rays of the setup's reference frames; None where blocks of it are missing."""
        found = next(each for each in self.plan.setups if each.id == setup)
        folders = [self.store.reference_block(setup, block) for block in found.blocks()]
        if not all(folder.is_dir() for folder in folders):
            return None
        rays = [count for folder in folders for count in reference_rays(folder)]
        return float(round(sum(rays) / len(rays) / 2))

    def _ended(self, task: Task, result: Done | TaskError) -> list[str]:
        """Note what became of `task`; what went wrong, for people."""
        if isinstance(result, TaskError):
            result = self._lost(task, result)
        for what, spent in result.seconds.items():
            self.seconds[what] = self.seconds.get(what, 0.0) + spent
        for failure in result.failures:
            cells = [failure.cell] if failure.cell else [cell.id for cell in self._of(task)]
            if task.stage == "oracle":
                self.problems.append({"setup": task.setup.id, "stage": task.stage, "reason": failure.reason})
                continue
            for cell in cells:
                self._fail(cell, task, failure)
        said = [f"{failure.cell or task.title}: {failure.reason}" for failure in result.failures]
        return [*said, *result.warned]

    def _of(self, task: Task) -> list[Any]:
        """The cells that a task stands for."""
        return list(task.cells) if task.stage == "cells" else self.plan.cells_of(task.setup.id)

    def _lost(self, task: Task, error: TaskError) -> Done:
        """A task whose worker gave no answer. Where several cells took turns it is not known whose fault it was: each is tried
        again by itself, and one that loses its worker then has failed."""
        reason = error.reason if error.kind == "raised" else f"the worker was lost: {error.reason}"
        if task.stage != "cells":
            return Done(failures=[Failure(None, error.kind, reason)])
        store = self.store
        left = [c for c in task.cells if not store.cell_block(c.id, task.block).is_dir() and not store.failure(c.id)]
        if error.kind == "died" and len(left) > 1:
            self._again += [replace(task, cells=(cell,)) for cell in left]
            return Done(warned=[f"{task.title}: {reason}; its {len(left)} cells are tried again one by one"])
        return Done(failures=[Failure(cell.id, error.kind, reason) for cell in left])

    def _fail(self, cell: str, task: Task | None, failure: Failure) -> None:
        block = task.block if task is not None and task.stage == "cells" else None
        try:
            self.store.fail(cell, block, failure.kind, failure.reason)
        except OSError as error:
            warnings.warn(f"{cell} failed, which cannot be written down: {error}", PhrtWarning, stacklevel=3)
        said = {"block": block.number if block else None, "kind": failure.kind, "reason": failure.reason}
        self.failures.setdefault(cell, self.store.failure(cell) or said)

    def time(self) -> dict[str, float]:
        """Seconds of this run by what they were spent on; `overhead_s` is all but loading, rendering, metrics and the oracle."""
        parts = {name: self.seconds.get(name, 0.0) for name in ("load", "reference", "render", "metrics", "oracle")}
        tasks, wall = self.seconds.get("total", 0.0), self.seconds.get("wall", 0.0)
        outside = max(wall - self.seconds.get("working", 0.0), 0.0)
        overhead = max(tasks - sum(parts.values()), 0.0) + outside
        found = {f"{name}_s": round(value, 3) for name, value in parts.items()}
        found |= {"overhead_s": round(overhead, 3), "overhead_share": round(overhead / max(tasks + outside, 1e-9), 4)}
        return found | {"wall_s": round(wall, 3)}


def different(old: Any, new: Any, key: str = "") -> list[tuple[str, Any, Any]]:
    """Where two pieces of plain data differ: key, old and new value."""
    if isinstance(old, dict) and isinstance(new, dict):
        names = dict.fromkeys([*old, *new])
        return [each for name in names for each in different(old.get(name), new.get(name), f"{key}.{name}".lstrip("."))]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = enumerate(zip(old, new, strict=True))
        return [each for number, (a, b) in pairs for each in different(a, b, f"{key}[{number}]")]
    return [] if old == new else [(key, old, new)]


def _changed_codes(then: Mapping[str, str] | None, now: Mapping[str, str]) -> list[str]:
    """Which plugins, "kind/name", are not made of the same code."""
    return [f"the code of {which} is not what it was" for which, code in now.items() if (then or {}).get(which) != code]


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


def _as_yaml(values: Any) -> str:
    import yaml

    return str(yaml.safe_dump(values, sort_keys=False))
