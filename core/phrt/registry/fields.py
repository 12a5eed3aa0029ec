"""The fields of a descriptor, checked: one that lists wrongly must not keep others from being listed."""

from __future__ import annotations

from collections.abc import Callable

from pydantic import BaseModel

from phrt.errors import PluginError
from phrt.registry.descriptors import Plugin


def check_fields(title: str, descriptor: Plugin) -> None:
    """Raises PluginError for the first field of `descriptor` that is not what it must be. title: names it."""
    for name, (fits, wanted) in WANTED.items():
        value = getattr(descriptor, name, None)
        if hasattr(descriptor, name) and not fits(value):
            raise PluginError(f"{title} has {name} {value!r:.80}; it must be {wanted}")


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_model(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, BaseModel)


def _are_texts(value: object) -> bool:
    return isinstance(value, tuple) and all(isinstance(each, str) for each in value)


def _is_whole(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_switch(value: object) -> bool:
    return isinstance(value, bool)


WANTED: dict[str, tuple[Callable[[object], bool], str]] = {
    "name": (_is_text, "text"),
    "summary": (_is_text, "a line of text"),
    "factory": (_is_text, "'module:Class'"),
    "options": (_is_model, "a class, a subclass of phrt.registry.Options"),
    "unavailable_reason": (callable, "a function that returns None or a text"),
    "order": (_is_whole, "a whole number"),
    "suffixes": (_are_texts, "a tuple of texts"),
    "needs_tracer": (_is_switch, "true or false"),
    "device": (callable, "a function that returns a Device or None"),
}
"""By field: what it must be, and that in words."""
