"""Plugins that are not installed: a module by name, or a single Python file (`--plugin`)."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from phrt.errors import PluginError
from phrt.registry.manager import describe, get_registry


def register_source(source: str) -> None:
    """Import `source`, a module name or the path of a .py file, and register it.

    In a file, `__name__` is the module its factories are found under: `factory=f"{__name__}:MyClass"`.
    Raises PluginError naming `source` and the cause.
    """
    is_file = source.endswith(".py") or "/" in source
    try:
        module = import_file(Path(source)) if is_file else importlib.import_module(source)
    except PluginError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"plugin '{source}' cannot be imported: {describe(error)}") from error
    try:
        get_registry().register(module, owner=source)
    except PluginError as error:
        raise PluginError(f"plugin '{source}': {error}") from error


def import_file(path: Path) -> ModuleType:
    """The module in file `path`, importable afterwards under its own name. Raises PluginError where it is no file."""
    if not path.is_file():
        raise PluginError(f"plugin file '{path}' does not exist")
    name = f"phrt_local_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"plugin file '{path}' is not a Python file (.py)")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
