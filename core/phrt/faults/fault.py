"""A fault of a plugin, as data, and as an error."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import Any

from phrt.errors import PluginError
from phrt.registry.origins import origin_of

CAUGHT = (Exception, SystemExit)
"""What a plugin's call may end with and the program goes on."""

NAMED = ("effect", "metric")
"""Kinds whose plugins say their name, also those that were made without the registry."""


@dataclass(frozen=True)
class Fault:
    """What a plugin did wrong.

    kind, name: of the plugin; of one that was made without the registry, what it calls itself or its class
    package   : who brought it, "phrt-nearest 1.0" or "built-in"; empty for one that was made without the registry
    cause     : "failed in trace(): RuntimeError: the cable came off"
    done      : what was done about it: "it is switched off, and its pixels take the fallback"; empty where the run ends with it
    frame     : number of the frame in the making; None outside of one
    """

    kind: str
    name: str
    package: str
    cause: str
    done: str = ""
    frame: int | None = None

    @property
    def title(self) -> str:
        """ "effect 'caustics' of phrt-caustics 0.1.0"."""
        quoted = f"'{self.name}'" if self.package or self.kind in NAMED else self.name
        return f"{self.kind} {quoted}" + (f" of {self.package}" if self.package not in ("", "built-in") else "")

    def __str__(self) -> str:
        return f"{self.title} {self.cause}" + (f"; {self.done}" if self.done else "")

    def as_row(self) -> dict[str, Any]:
        """As run.json holds it."""
        return {**vars(self), "message": str(self)}


class PluginFailure(PluginError):
    """A plugin failed, and nothing can stand in for it, or nothing should (`strict`). fault: what is known."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(str(fault))
        self.fault = fault


class Nonsense(ValueError):
    """A plugin returned what it must not. given, wanted: in words, for "returned GIVEN from trace(), expected WANTED"."""

    def __init__(self, given: str, wanted: str) -> None:
        super().__init__(f"returned {given}, expected {wanted}")
        self.given, self.wanted = given, wanted


def fault_of(kind: str, plugin: Any, cause: str, done: str = "") -> Fault:
    """The fault of `plugin`, an object that the registry made or anybody else."""
    entry = origin_of(plugin)
    if entry is not None:
        return Fault(kind, entry.name, entry.source, cause, done)
    name = type(plugin).__name__
    if kind in NAMED:
        # One that cannot even say its name is its class.
        with contextlib.suppress(Exception):
            name = str(plugin.name)
    return Fault(kind, name, "", cause, done)


def raised(call: str, error: BaseException) -> str:
    """The cause of a fault that is an exception. call: "trace()"."""
    if isinstance(error, Nonsense):
        return f"returned {error.given} from {call}, expected {error.wanted}"
    return f"failed in {call}: {type(error).__name__}: {error}".rstrip(": ").replace("\n", " ")


def failure(kind: str, plugin: object, call: str, error: BaseException, done: str = "") -> PluginFailure:
    """The error that says that `plugin` failed in `call` by `error`; or the failure of another plugin that `error` came of."""
    if (other := culprit(error)) is not None:
        return PluginFailure(replace(other.fault, done=done))
    return PluginFailure(fault_of(kind, plugin, raised(call, error), done))


def culprit(error: BaseException | None) -> PluginFailure | None:
    """The failure of a plugin that `error` is, or came of: an effect whose rays fail is not to blame for it."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        if isinstance(error, PluginFailure):
            return error
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return None
