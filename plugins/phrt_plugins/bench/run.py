"""A benchmark from its plan to its summary, for the command and for Python."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from phrt.cli.console import say
from phrt.errors import PhrtError
from phrt_plugins.bench.estimate import Estimate, spoken
from phrt_plugins.bench.executors import Executor, make_executor
from phrt_plugins.bench.inline import InlineExecutor
from phrt_plugins.bench.plan import STAGES, Plan
from phrt_plugins.bench.plugin_code import check_reachable
from phrt_plugins.bench.progress import RunProgress
from phrt_plugins.bench.reading import ConfigFile
from phrt_plugins.bench.runner import BenchRunner
from phrt_plugins.bench.store import Store
from phrt_plugins.bench.worker import Work


@dataclass
class Outcome:
    """What came of a benchmark. cells: ids; failures: by cell; problems: of setups; time: as in bench.json; and two texts."""

    cells: list[str]
    failures: dict[str, dict[str, Any]]
    problems: list[dict[str, str]]
    time: dict[str, float]
    leaderboard: str = ""
    verdict: str = ""


def run_bench(
    file: ConfigFile,
    plan: Plan,
    work: Work,
    *,
    resume: bool = False,
    retry_failed: bool = False,
    executor: str | Executor = "local",
    jobs: int | None = None,
    estimate: Estimate | None = None,
) -> Outcome:
    """Run `plan` into the folder of `work`, and sum it up.

    executor: "local", "dask://host:port", or one that is the caller's to close; estimate: is said first where it is given

    Raises OptionError where the folder cannot be used, and for an executor that is none. Cells that fail are in the outcome.
    """
    store = Store(work.root)
    # The folder is looked at before a lock is put into it.
    runner = BenchRunner(file, plan, store, work)
    runner.check_folder(resume)
    with ExitStack() as closing:
        made = executor
        if not isinstance(made, Executor):
            made = make_executor(made, timing=file.config.clock is None, jobs=jobs)
            closing.callback(made.close)
        if not isinstance(made, InlineExecutor):
            check_reachable(runner.plugins(), work.plugins)
        with store.locked():
            runner.begin(resume=resume, retry_failed=retry_failed)
            runner.work = replace(runner.work, threads=made.threads)
            tasks = [task for stage in STAGES for task in runner.remaining(stage)]
            if estimate is not None and tasks:
                estimate.measure(tasks)
                say(f"{len(plan.cells)} cells, {len(tasks)} tasks, about {spoken(estimate.total(tasks, made.jobs))}")
            with RunProgress(tasks, estimate) as progress:
                runner.run(made, progress.ended)
            closing.close()
            outcome = Outcome([cell.id for cell in plan.cells], runner.failures, runner.problems, runner.time())
            _sum_up(store, outcome, work.strict)
    return outcome


def _sum_up(store: Store, outcome: Outcome, strict: bool) -> None:
    """Write the summary, and put the leaderboard and the verdict into `outcome`. What cannot be summed up is a problem of its own:
    everything that was rendered is there."""
    from phrt_plugins.bench.leaderboard import leaderboard, verdict
    from phrt_plugins.bench.results import BenchRun
    from phrt_plugins.bench.summary import read_summary, summarise
    from phrt_plugins.bench.tables import text

    try:
        summarise(store.root, strict=strict)
        boards = leaderboard(read_summary(store.root), BenchRun.read(store.root))
        outcome.leaderboard, outcome.verdict = text(boards), verdict(boards)
    except (PhrtError, OSError) as error:
        outcome.problems.append({"setup": "all", "stage": "summary", "reason": str(error)})
