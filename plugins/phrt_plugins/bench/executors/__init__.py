"""Executors: where the tasks of a comparison run."""

from __future__ import annotations

from phrt.errors import OptionError
from phrt_plugins.bench.executors.base import Executor, Keyed, TaskError

__all__ = ["Executor", "Keyed", "TaskError", "make_executor"]


def make_executor(where: str = "local", *, timing: bool, jobs: int | None = None) -> Executor:
    """The executor that `where` names: "local", or "dask://host:port" for an existing Dask cluster.

    timing: do the tasks measure time? Then one runs at a time on each machine, with all its cores; else one on each core.
    jobs  : tasks at a time, for "local"; by default as above. Timing tasks run one at a time whatever it says.
    Raises OptionError for another `where`, for a cluster that does not answer, and where `distributed` is not installed.
    """
    if where == "local":
        from phrt_plugins.bench.executors.local import LocalExecutor

        return LocalExecutor(timing=timing, jobs=jobs)
    if where.startswith("dask://"):
        from phrt_plugins.bench.executors.cluster import ClusterExecutor

        return ClusterExecutor(where, timing=timing)
    raise OptionError(f"the executor is '{where}', allowed: local, dask://host:port")
