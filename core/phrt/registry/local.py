"""Plugins that are not installed: a module by name, or a single Python file (`--plugin`, `plugins:` of a benchmark)."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

from phrt.errors import PluginError
from phrt.registry.manager import describe, get_registry


def register_source(source: str) -> str:
    """Import `source`, a module name or the path of a .py file, and register it; the owner that its plugins have.

    In a file, `__name__` is the module its factories are found under: `factory=f"{__name__}:MyClass"`. The same source again
    replaces what it brought before: a file that was edited is read anew.
    Raises PluginError naming `source` and the cause; then everything is as it was.
    """
    try:
        module = import_file(Path(source)) if is_file_source(source) else importlib.import_module(source)
    except PluginError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(f"plugin '{source}' cannot be imported: {describe(error)}{_hint(source, error)}") from error
    owner = owner_of(source)
    try:
        get_registry().register(module, owner=owner)
    except PluginError as error:
        raise PluginError(str(error) if owner in str(error) else f"plugin '{source}': {error}") from error
    return owner


def is_file_source(source: str) -> bool:
    """Is it a path, not the name of a module?"""
    return source.endswith(".py") or "/" in source


def owner_of(source: str) -> str:
    """Whom the plugins of `source` belong to: however a file is named, it is one owner."""
    return str(Path(source).resolve()) if is_file_source(source) else source


def import_file(path: Path) -> ModuleType:
    """The module in file `path`, importable afterwards under its own name. Raises PluginError where it is no file."""
    if not path.is_file():
        raise PluginError(f"plugin file '{path}' does not exist")
    if path.suffix != ".py":
        raise PluginError(f"plugin file '{path}' is not a Python file (.py)")
    name = _module_name(path)
    loader = _FreshLoader(name, str(path.absolute()))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    before = sys.modules.get(name)
    sys.modules[name] = module
    try:
        loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        if before is not None:
            sys.modules[name] = before
        raise
    return module


class _FreshLoader(SourceFileLoader):
    """Compiles the source anew: what Python caches is told from an edited file by its size and second only."""

    def get_code(self, fullname: str) -> CodeType | None:
        path = self.get_filename(fullname)
        code: CodeType = self.source_to_code(self.get_data(path), path)
        return code


def _module_name(path: Path) -> str:
    """What the module of a file is called; two files of the same name in different folders are two modules."""
    name = f"phrt_local_{path.stem}"
    there = getattr(sys.modules.get(name), "__file__", None)
    if there is None or Path(there).resolve() == path.resolve():
        return name
    return f"{name}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:6]}"


def _hint(source: str, error: BaseException) -> str:
    """Where a module is not found: is there a file of that name here?"""
    beside = Path(f"{source.replace('.', '/')}.py")
    missing = isinstance(error, ModuleNotFoundError) and error.name == source.partition(".")[0]
    return f". There is a file {beside}: name it with its ending" if missing and beside.is_file() else ""
