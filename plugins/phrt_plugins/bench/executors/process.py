"""A worker process of this machine: pinned to its cores, it answers one call after the other and does not outlive its parent."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection

from phrt_plugins.bench.executors.message import answer

PATIENCE_S = 5.0
"""How long a worker that was asked to end may take to tidy up."""

_PR_SET_PDEATHSIG = 1


class WorkerProcess:
    """Started with this object. key: of the task it did last. `connection` is ready when an answer is there, or the worker is gone.

    It is spawned, not forked: threads and locks of this process are no part of it.
    """

    def __init__(self, cores: Sequence[int]) -> None:
        context = multiprocessing.get_context("spawn")
        self.cores = tuple(cores)
        self.key: str | None = None
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self.cores), name="phrt-bench", daemon=True)
        self._process.start()
        # Only the worker holds its end now, so that this end is told when it dies.
        theirs.close()

    @property
    def pid(self) -> int | None:
        return self._process.pid

    def send(self, sent: bytes) -> None:
        """Raises OSError when the worker is gone."""
        self.connection.send_bytes(sent)

    def receive(self) -> bytes:
        """Raises EOFError or OSError when the worker is gone."""
        return self.connection.recv_bytes()

    def epitaph(self) -> str:
        """How it ended, once it has."""
        self._process.join(PATIENCE_S)
        code = self._process.exitcode
        if code is None:
            return "it closed its connection"
        if code < 0:
            hint = ", perhaps for want of memory" if -code == getattr(signal, "SIGKILL", None) else ""
            return f"it was ended by signal {-code}{hint}"
        return f"it ended with exit code {code}"

    def kill(self) -> None:
        """End it now, whatever it is doing."""
        self._process.kill()
        self._process.join()
        self.connection.close()

    def stop(self) -> None:
        """End it when it is idle: it may tidy up."""
        with suppress(OSError):
            self.send(b"")
            self._process.join(PATIENCE_S)
        self.kill()


def _serve(connection: Connection, cores: Sequence[int]) -> None:
    """What the process does."""
    _pin(cores)
    _die_with_parent()
    # Ctrl-C reaches everybody in the terminal; the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            sent = connection.recv_bytes()
            if not sent:
                return
            connection.send_bytes(answer(sent))
        except (EOFError, OSError):
            return


def _pin(cores: Sequence[int]) -> None:
    """Before anything counts cores: thread pools, numpy's libraries, Embree."""
    if cores and hasattr(os, "sched_setaffinity"):
        try:
            os.sched_setaffinity(0, cores)
        except OSError:  # they were taken from us since
            return


def _die_with_parent() -> None:
    """A thread waits for the parent's end; and where the kernel can be asked, it kills us even in the middle of C code."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait, name="phrt-parent", daemon=True).start()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
