"""Origins: which plugin an object was made by, so that a message about it can name its package."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phrt.registry.manager import RegisteredPlugin

_origins: dict[int, RegisteredPlugin] = {}


def note_origin(made: object, entry: RegisteredPlugin) -> None:
    """`made` was made by `entry`. What cannot be referred to weakly is not noted."""
    try:
        weakref.finalize(made, _origins.pop, id(made), None).atexit = False
    except TypeError:
        return
    _origins[id(made)] = entry


def origin_of(made: object) -> RegisteredPlugin | None:
    """The plugin that `made` was made by; None where it was made without the registry."""
    return _origins.get(id(made))


def is_ours(made: object) -> bool:
    """Was it made by a built-in plugin? Then our tests have looked at what it returns."""
    entry = origin_of(made)
    return entry is not None and entry.origin == "built-in"
