"""Contract: how the kit says which rule a plugin breaks and in which case, and how it makes the plugins it checks."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from operator import methodcaller
from typing import Any, TypeVar

from pydantic import BaseModel

from phrt.errors import OptionError
from phrt.registry.descriptors import Options, Plugin
from phrt.registry.manager import RegisteredPlugin, describe, get_registry, import_factory
from phrt.registry.options import validate_options

R = TypeVar("R")

Given = str | Plugin | Callable[..., Any]
"""What is checked: the name of a registered plugin, a descriptor, or a class or function that takes the options."""


class BrokenContract(AssertionError):
    """A plugin does not keep its contract. The message names the plugin, the rule and the case."""


BROKEN_BY_THE_PLUGIN = methodcaller("errisinstance", BrokenContract)
"""As `__tracebackhide__` of the kit's modules: pytest then shows a plugin's author the author's test, and the rule."""
__tracebackhide__ = BROKEN_BY_THE_PLUGIN


class Contract:
    """Of one plugin, called `title` in messages."""

    def __init__(self, title: str) -> None:
        self.title = title

    def holds(self, condition: object, rule: str, case: object = "") -> None:
        """Raises BrokenContract that names the rule and the case where `condition` is false."""
        if not condition:
            raise BrokenContract(self.message(rule, case))

    def message(self, rule: str, case: object) -> str:
        return f"{self.title} breaks its contract: {rule}" + (f" [{case}]" if str(case) else "")

    def call(self, call: str, function: Callable[[], R], case: object = "") -> R:
        """What `function` returns; `call` is what the plugin does in it. Raises BrokenContract where it raises."""
        try:
            return function()
        except BrokenContract:
            raise
        except Exception as error:
            raise BrokenContract(self.message(f"{call} raised {describe(error)}", case)) from error


class Maker:
    """Makes fresh plugins of one kind, with the same options each time.

    options: a mapping for a name or a descriptor; for a class, an instance of its options' model.
    Raises PluginError and OptionError as the registry does, OptionError for options that a class cannot be given.
    """

    def __init__(self, kind: str, given: Given, options: Mapping[str, object] | BaseModel | None) -> None:
        registry = get_registry()
        if isinstance(given, str):
            given = registry.get(kind, given)
        if isinstance(given, Plugin):
            self.title = f"{kind} '{given.name}'"
            self._options: BaseModel = validate_options(self.title, given.options, options or {})
            self._factory = import_factory(self.title, RegisteredPlugin(given, kind, given.name, "registered", ""))
            return
        self.title = f"{kind} {getattr(given, '__name__', given)!s}"
        if not (options is None or isinstance(options, BaseModel)):
            raise OptionError(f"{self.title}: options must be an instance of its options' model, not {options!r}")
        self._options, self._factory = options or Options(), given

    @property
    def contract(self) -> Contract:
        return Contract(self.title)

    def takes(self, dependency: str) -> bool:
        """Has the factory a parameter of this name?"""
        return dependency in inspect.signature(self._factory).parameters

    def __call__(self, **dependencies: object) -> Any:
        """A new one. Raises BrokenContract where it cannot be made."""
        return self.contract.call("making it", lambda: self._factory(self._options, **dependencies))
