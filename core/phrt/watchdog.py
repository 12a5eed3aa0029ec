"""Watchdog: gets the frame out of a plugin's call that never returns.

One daemon thread looks now and then at how long the guarded call of each thread has been running. When it is too long, it raises
`NeverReturned` in that thread, at its next step of Python. A call that hangs inside C code cannot be reached this way.
"""

from __future__ import annotations

import ctypes
import threading
import time
from types import TracebackType
from weakref import WeakSet

PATIENCE_S = 60.0
"""How long a call may take. Generous: the first one may compile kernels."""
LOOK_EVERY_S = 0.25


class NeverReturned(BaseException):
    """Raised in a call that took too long. No Exception, so that a plugin's own handlers let it through."""


class Guard:
    """`with guard:` around a call that may hang. For one thread, not nested; costs about a microsecond."""

    def __init__(self, patience_s: float | None = None) -> None:
        self._patience = PATIENCE_S if patience_s is None else patience_s
        self._lock = threading.Lock()
        self._thread = 0
        self._began = 0.0
        self._raised = False

    def __enter__(self) -> None:
        self._thread, self._raised = threading.get_ident(), False
        self._began = time.monotonic()
        _watch(self)

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._began = 0.0
            if self._raised and kind is not NeverReturned:
                # It returned in the last moment: what was not delivered yet is taken back.
                _raise_in(self._thread, None)

    def look(self) -> None:
        """From the watching thread: has it been too long?"""
        with self._lock:
            if self._began and not self._raised and time.monotonic() - self._began > self._patience:
                self._raised = True
                _raise_in(self._thread, NeverReturned)


def _raise_in(thread: int, exception: type[BaseException] | None) -> None:
    given = ctypes.py_object(exception) if exception is not None else None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), given)


_guards: WeakSet[Guard] = WeakSet()
_started = threading.Lock()
_running = False


def _watch(guard: Guard) -> None:
    global _running
    if guard in _guards and _running:
        return
    with _started:
        _guards.add(guard)
        if not _running:
            _running = True
            threading.Thread(target=_look_around, name="phrt-watchdog", daemon=True).start()


def _look_around() -> None:
    while True:
        time.sleep(LOOK_EVERY_S)
        for guard in list(_guards):
            guard.look()
