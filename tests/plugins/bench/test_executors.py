"""Executors: every task ends once, a dead worker is one task's error, and nobody outlives the caller."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import needs
import pytest
from executor_kit import Job, Told, meetings, reason, results, work

from phrt.errors import OptionError
from phrt.workers import usable_cores
from phrt_plugins.bench.executors import Executor, make_executor
from phrt_plugins.bench.executors.base import ByKey
from phrt_plugins.bench.executors.local import LocalExecutor

pytestmark = pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system pins no processes")
KIT = Path(__file__).parents[2]


def alive(process: int) -> bool:
    """Does the process run? One that ended and was not waited for does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(condition: Callable[[], bool], seconds: float = 30.0) -> bool:
    """Did it come true in time?"""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


# --- who is next ----------------------------------------------------------------------------------------------------


def taken(waiting: ByKey[Job], last: str | None, held: tuple[str, ...] = ()) -> str | None:
    job = waiting.next_for(last, held)
    return None if job is None else job.name


def test_a_worker_goes_on_with_its_key_then_takes_one_that_nobody_has_then_helps_out() -> None:
    waiting = ByKey([Job(key, f"{key}{n}") for key, count in (("a", 4), ("b", 2), ("c", 1)) for n in range(count)])
    assert taken(waiting, "b") == "b0"
    assert taken(waiting, None, ("a",)) == "b1", "b is the first that is not held"
    assert taken(waiting, "b", ("a",)) == "c0"
    assert taken(waiting, "c", ("a",)) == "a0", "nothing is free, and a has most left to do"
    assert len(waiting) == 3
    assert [taken(waiting, "a") for _ in range(4)] == ["a1", "a2", "a3", None]


# --- local ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def timed() -> Iterator[LocalExecutor]:
    with LocalExecutor(timing=True, jobs=4) as made:
        yield made


@pytest.fixture(scope="module")
def many() -> Iterator[LocalExecutor]:
    with LocalExecutor(timing=False, jobs=2) as made:
        yield made


def test_tasks_that_measure_time_run_one_after_the_other_with_all_cores(timed: LocalExecutor) -> None:
    assert (timed.jobs, timed.threads) == (1, None)
    found = results(timed, [Job("a", f"t{n}", value=n) for n in range(3)])
    assert [found[f"t{n}"].value for n in range(3)] == [0, 1, 2]
    assert {told.process for told in found.values()} == {found["t0"].process} != {os.getpid()}
    assert all(len(told.cores) == usable_cores() for told in found.values())
    assert found["t2"].before[-2:] == ("t0", "t1"), "the worker keeps what it has between tasks"


def test_other_tasks_run_at_the_same_time_each_on_a_core_of_its_own(many: LocalExecutor, tmp_path: Path) -> None:
    assert (many.jobs, many.threads) == (2, 1)
    found = results(many, meetings(tmp_path, "ab", 3))
    assert all(told.value for told in found.values()), "they met"
    for key in "ab":
        mine = [found[f"{key}{n}"] for n in range(3)]
        assert {told.process for told in mine} == {mine[0].process}, "tasks of a key go to the same worker"
        assert len(mine[0].cores) == 1
    one, other = found["a0"], found["b0"]
    assert one.process != other.process
    assert usable_cores() == 1 or one.cores != other.cores


def test_what_a_task_raises_is_its_own_error(timed: LocalExecutor) -> None:
    jobs = [Job("a", "bad", "raise", "mondays"), Job("a", "exits", "exit"), Job("a", "good", value=7)]
    found = results(timed, jobs)
    assert reason(found["bad"], "raised") == "ValueError: bad does not like mondays"
    assert "in work" in found["bad"].details
    assert reason(found["exits"], "raised") == "SystemExit: 3"
    assert found["good"].value == 7


def test_what_cannot_be_sent_or_sent_back_is_its_own_error(timed: LocalExecutor) -> None:
    jobs = [Job("a", "there", value=lambda: None), Job("a", "back", "stubborn"), Job("a", "broken", "fragile")]
    found = results(timed, [*jobs, Job("a", "good", value=7)])
    assert "the task cannot be sent to a worker" in reason(found["there"], "refused")
    assert "what the task gave cannot be sent back: TypeError: no copies" in reason(found["back"], "refused")
    assert "what the task gave cannot be read: ValueError" in reason(found["broken"], "refused")
    assert found["good"].value == 7


def test_a_killed_worker_is_an_error_of_its_task_and_is_replaced(many: LocalExecutor, tmp_path: Path) -> None:
    before = results(many, meetings(tmp_path / "before", "ab", 1))
    found = results(many, [Job("a", "dies", "die"), *(Job(key, f"{key}{n}") for n in range(2) for key in "ab")])
    died = before["a0"].process
    why = f"the worker (process {died}) died: it was ended by signal 9, perhaps for want of memory"
    assert reason(found.pop("dies"), "died") == why
    assert all(isinstance(told, Told) for told in found.values()), "the others went on"
    after = results(many, meetings(tmp_path / "after", "ab", 1))
    assert len({told.process for told in after.values()} - {died}) == 2
    assert after["b0"].process == before["b0"].process or after["a0"].process == before["b0"].process


def test_a_worker_that_was_killed_while_idle_costs_no_task() -> None:
    with LocalExecutor(timing=True) as executor:
        first = results(executor, [Job("a", "one")])["one"]
        os.kill(first.process, signal.SIGKILL)
        assert until(lambda: not alive(first.process))
        assert results(executor, [Job("a", "two")])["two"].process != first.process


def test_an_error_of_the_caller_ends_the_workers_at_once() -> None:
    processes: list[int] = []

    def stop(job: Job, result: Any) -> None:
        processes.append(result.process)
        raise KeyboardInterrupt

    with LocalExecutor(timing=False, jobs=2) as executor:
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            executor.run(work, [Job("a", "quick"), Job("b", "slow", "sleep", 60)], done=stop)
        assert time.monotonic() - began < 30
        assert not alive(processes[0])
        assert results(executor, [Job("a", "again", value=1)])["again"].value == 1, "it may be used again"


def test_a_closed_executor_says_so_and_its_workers_are_gone() -> None:
    with LocalExecutor(timing=True) as executor:
        process = results(executor, [Job("a", "one")])["one"].process
    assert not alive(process)
    executor.close()
    with pytest.raises(RuntimeError, match="the executor was closed"):
        executor.run(work, [Job("a", "two")], done=lambda job, result: None)


PARENT = """
import signal
import sys
sys.path.insert(0, {kit!r})
from executor_kit import Job, work
from phrt_plugins.bench.executors import make_executor

if __name__ == "__main__":
    # Who runs the tests in the background may have had it ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    jobs = [Job("a", "busy", "note", {note!r})]
    make_executor("local", timing=True).run(work, jobs, done=print)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_busy_worker_dies_with_its_parent(how: signal.Signals, tmp_path: Path) -> None:
    script, note = tmp_path / "parent.py", tmp_path / "note"
    script.write_text(PARENT.format(kit=str(KIT), note=str(note)))
    with subprocess.Popen([sys.executable, str(script)], stderr=subprocess.DEVNULL) as parent:
        try:
            assert until(lambda: note.exists() and note.read_text() != "")
            worker = int(note.read_text())
            assert alive(worker)
            parent.send_signal(how)
            parent.wait(30)
        finally:
            parent.kill()
    assert until(lambda: not alive(worker), 10)


def test_an_executor_that_is_none_is_named() -> None:
    with pytest.raises(OptionError, match="the executor is 'slurm', allowed: local, dask://host:port"):
        make_executor("slurm", timing=True)


# --- cluster --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster of two worker processes."""
    distributed = needs.package("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address=":0", scheduler_port=0, silence_logs=50
    ) as cluster:
        yield cluster.scheduler_address.replace("tcp://", "dask://")


@pytest.fixture
def spread(scheduler: str) -> Iterator[Executor]:
    with make_executor(scheduler, timing=False) as made:
        yield made


def test_a_clusters_workers_share_tasks_by_key_and_do_them_in_one_thread(spread: Executor, tmp_path: Path) -> None:
    assert (spread.jobs, spread.threads) == (2, 1)
    found = results(spread, meetings(tmp_path, "ab", 4))
    assert all(told.value for told in found.values()), "they met"
    assert len({told.process for told in found.values()}) == 2
    for key in "ab":
        mine = [found[f"{key}{n}"] for n in range(4)]
        assert len({(told.process, told.thread) for told in mine}) == 1


def test_on_a_cluster_timing_tasks_run_one_at_a_time_on_a_machine(scheduler: str) -> None:
    with make_executor(scheduler, timing=True) as executor:
        assert (executor.jobs, executor.threads) == (1, None)
        found = results(executor, [Job(key, key) for key in "abc"])
        assert len({told.process for told in found.values()}) == 1


def test_errors_on_a_cluster_are_those_of_their_tasks(spread: Executor) -> None:
    jobs = [Job("a", "bad", "raise", "mondays"), Job("b", "back", "stubborn"), Job("a", "there", value=lambda: None)]
    found = results(spread, [*jobs, Job("a", "good", value=7)])
    assert reason(found["bad"], "raised") == "ValueError: bad does not like mondays"
    assert "no copies" in reason(found["back"], "refused")
    assert "the task cannot be sent to a worker" in reason(found["there"], "refused")
    assert found["good"].value == 7


def test_a_worker_of_a_cluster_that_is_killed_costs_its_task_only(spread: Executor) -> None:
    found = results(spread, [Job("a", "dies", "die"), *(Job(key, f"{key}{n}") for n in range(2) for key in "bc")])
    assert "the Dask worker at tcp://" in reason(found.pop("dies"), "died")
    assert all(isinstance(told, Told) for told in found.values())


def test_a_cluster_without_workers_and_one_that_loses_its_last() -> None:
    from phrt_plugins.bench.executors.cluster import ClusterExecutor

    distributed = needs.package("distributed")
    with distributed.LocalCluster(
        n_workers=0, processes=False, protocol="tcp", dashboard_address=":0", scheduler_port=0, silence_logs=50
    ) as cluster:
        where = cluster.scheduler_address.replace("tcp://", "dask://")
        with pytest.raises(OptionError, match="has no workers; start some with 'dask worker'"):
            ClusterExecutor(where, timing=True)
        cluster.scale(1)
        cluster.wait_for_workers(1)
        with ClusterExecutor(where, timing=True, without_workers_s=0.5) as executor:
            assert results(executor, [Job("a", "one", value=1)])["one"].value == 1
            cluster.scale(0)
            found = results(executor, [Job("a", "two"), Job("b", "three")])
            assert "has no workers any more" in reason(found["two"], "died")
            assert "has no workers any more" in reason(found["three"], "died")


@pytest.mark.parametrize("where", ["dask://", "dask://here", "dask://here:port", "dask://:8786", "dask://a:1/b"])
def test_an_address_that_is_none_is_named(where: str) -> None:
    with pytest.raises(OptionError, match=f"the executor is '{where}', expected dask://host:port"):
        make_executor(where, timing=True)


def test_a_scheduler_that_does_not_answer_is_given_up() -> None:
    from phrt_plugins.bench.executors.cluster import ClusterExecutor

    needs.package("distributed")
    with pytest.raises(OptionError, match=r"no Dask scheduler answers at 'dask://127.0.0.1:1' within 0.5 s"):
        ClusterExecutor("dask://127.0.0.1:1", timing=True, patience_s=0.5)


def test_without_distributed_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(OptionError, match=r"needs the package distributed .*: pip install 'phrt\[cluster\]'"):
        make_executor("dask://127.0.0.1:8786", timing=True)
