"""Which code plugins are made of that do not ship with PHRT: results are only good for the code that brought them about.

The digest of such a plugin is part of the key of what it contributes to: a heuristic's, of its cells; an effect's, a tracer's or a
G-buffer producer's, of the references, too. One that ships with PHRT has none: that is `phrt_plugins.bench.content.code_digest`.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from types import CodeType
from typing import Any

from phrt.errors import OptionError, PluginError
from phrt.registry import RegisteredPlugin, get_registry
from phrt.registry.local import owner_of, register_source
from phrt.registry.manager import import_factory

Codes = dict[str, str]
"""Digests by "kind/name"."""


def codes_of(plugins: Iterable[tuple[str, str]]) -> Codes:
    """The digests of those of `plugins`, kinds and names, that do not ship with PHRT and are known here."""
    registry = get_registry()
    known = [registry.find(kind, name) for kind, name in dict.fromkeys(plugins) if name in registry.names(kind)]
    return {f"{e.kind}/{e.name}": code_of(e) for e in known if e.origin != "built-in"}


def code_of(entry: RegisteredPlugin) -> str:
    """16 hexadecimal digits of a plugin's version and of the sources of the package, or the file, that its factory is in; of what
    is written in a notebook, of the class alone."""
    module, _, attribute = entry.plugin.factory.partition(":")
    # What the module of a single file is called depends on what else was imported.
    hasher = hashlib.blake2b(f"{attribute} {entry.version}".encode(), digest_size=8)
    sources = _sources(module)
    for name, path in sources:
        hasher.update(f"{name};".encode() + path.read_bytes())
    if not sources:
        _feed_class(hasher, import_factory(f"{entry.kind} '{entry.name}'", entry))
    return hasher.hexdigest()


def check_codes(planned: Mapping[str, str]) -> None:
    """Raises PluginError where a plugin is not, in this process, the code that it was planned with."""
    for which, code in planned.items():
        kind, _, name = which.partition("/")
        if code_of(get_registry().find(kind, name)) != code:
            raise PluginError(
                f"{kind} '{name}' is not the code that the benchmark began with: it was changed since, or this machine or "
                "process has another version"
            )


def check_reachable(used: Iterable[str], sources: Iterable[str]) -> None:
    """Raises OptionError where one of the plugins `used`, "kind/name", is known to this process alone, and not by `sources`."""
    owners = {owner_of(source) for source in sources}
    for which in used:
        kind, _, name = which.partition("/")
        entry = get_registry().find(kind, name)
        if entry.origin == "registered" and entry.owner not in owners:
            raise OptionError(
                f"{kind} '{name}' was registered in this process ({entry.owner}), and worker processes do not know it: put it "
                "into a file and name that in `plugins`, or leave out `executor`"
            )


class Registrar:
    """Registers the sources of plugins in this process, and again when a file has changed."""

    def __init__(self) -> None:
        self._seen: dict[str, bytes] = {}

    def register(self, sources: Iterable[str]) -> bool:
        """Was anything new? Raises PluginError for a source that is none."""
        new = {source: _content(source) for source in sources}
        new = {source: content for source, content in new.items() if self._seen.get(source) != content}
        for source, content in new.items():
            register_source(source)
            self._seen[source] = content
        return bool(new)


def _content(source: str) -> bytes:
    """What tells whether a source must be read again: a file's text; a module is imported only once."""
    path = Path(owner_of(source))
    return path.read_bytes() if path.is_file() else b""


def _sources(module: str) -> list[tuple[str, Path]]:
    """The files of the package that `module` is in, by their names in it; none where it has no file of its own."""
    root = module.partition(".")[0]
    if root == "__main__":
        return []
    loaded = sys.modules.get(root)
    try:
        spec = loaded.__spec__ if loaded is not None else find_spec(root)
    except (ImportError, ValueError):
        return []
    if spec is not None and spec.submodule_search_locations:
        folders = [Path(folder) for folder in spec.submodule_search_locations]
        return sorted((path.relative_to(each).as_posix(), path) for each in folders for path in each.rglob("*.py"))
    origin = Path(spec.origin) if spec is not None and spec.origin else None
    return [(origin.name, origin)] if origin is not None and origin.is_file() else []


def _feed_class(hasher: Any, factory: Any) -> None:
    """A class with those it is made from, as far as they are of the same module, or a function."""
    classes = [each for each in getattr(factory, "__mro__", ()) if each.__module__ == factory.__module__]
    members = [(name, value) for each in classes for name, value in sorted(vars(each).items())]
    for name, value in members or [("", factory)]:
        function = getattr(value, "fget", None) or getattr(value, "__func__", value)
        code = getattr(function, "__code__", None)
        if isinstance(code, CodeType):
            _feed_code(hasher, name, code)
        elif isinstance(value, (bool, int, float, str, tuple)) and not name.startswith("__"):
            hasher.update(f"{name} {value!r};".encode())


def _feed_code(hasher: Any, name: str, code: CodeType) -> None:
    """What a function does, wherever it is written."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    constants = [sorted(map(repr, c)) if isinstance(c, frozenset) else c for c in code.co_consts if c not in inner]
    hasher.update(f"{name} {code.co_names} {code.co_varnames} {constants!r};".encode() + code.co_code)
    for each in inner:
        _feed_code(hasher, each.co_name, each)
