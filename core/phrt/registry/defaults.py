"""What is used when nobody names a plugin, and why: for tables and manual pages."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass
from typing import Any

from phrt.errors import PluginError
from phrt.registry.auto import DEFAULT_EFFECTS, DEFAULT_HEURISTIC, Choice, choose_gbuffer, choose_tracer
from phrt.registry.manager import RegisteredPlugin, Registry


@dataclass(frozen=True)
class Defaults:
    """gbuffer, tracer: what `auto` stands for here; files: loaders by the suffix that they read."""

    gbuffer: Choice
    tracer: Choice
    files: dict[str, str]

    @classmethod
    def find(cls, registry: Registry) -> Defaults:
        """As things are now. Raises nothing: where there is no default, its name is empty and the reason says why."""
        suffixes = {each for entry in registry.plugins("loader") for each in getattr(entry.plugin, "suffixes", ())}
        files = {suffix: _loader(registry, suffix) for suffix in sorted(suffixes)}
        return cls(_choice(choose_gbuffer, registry), _choice(choose_tracer, registry), files)

    def use_of(self, entry: RegisteredPlugin) -> str:
        """When `entry` is used without being named: "yes", "auto", for files of some suffixes; empty for never."""
        if entry.kind in ("gbuffer", "tracer"):
            return "auto" if self._auto(entry.kind).name == entry.name else ""
        if entry.kind == "loader":
            return " ".join(
                each for each in getattr(entry.plugin, "suffixes", ()) if self.files.get(each) == entry.name
            )
        fixed = {"effect": DEFAULT_EFFECTS, "heuristic": (DEFAULT_HEURISTIC,)}
        return "yes" if entry.name in fixed.get(entry.kind, ()) else ""

    def reason_of(self, entry: RegisteredPlugin) -> str:
        """Why `entry` is used without being named; empty where it is not."""
        use = self.use_of(entry)
        if not use:
            return ""
        if entry.kind in ("gbuffer", "tracer"):
            return f"yes, `auto` is {entry.name} here: {self._auto(entry.kind).reason}"
        if entry.kind == "loader":
            return f"yes, for files that end in {use}"
        return (
            f"yes, where no other {entry.kind} is named"
            if entry.kind == "heuristic"
            else "yes, unless it is switched off"
        )

    def lines(self, kinds: Collection[str] | None = None) -> list[str]:
        """For people: what is used for each of `kinds`, by default all, and why."""
        loaders = dict.fromkeys(filter(None, self.files.values()))
        read = {name: " ".join(suffix for suffix, by in self.files.items() if by == name) for name in loaders}
        said = {
            "gbuffer": f"gbuffer: {self.gbuffer.name or 'none'}: {self.gbuffer.reason}",
            "tracer": f"tracer: {self.tracer.name or 'none'}: {self.tracer.reason}",
            "effect": f"effects: {', '.join(DEFAULT_EFFECTS)}: a fixed list, which no package changes",
            "heuristic": f"heuristic: {DEFAULT_HEURISTIC}: fixed, where neither scene nor command names another",
            "loader": "loaders, by a file's ending: " + "; ".join(f"{name} {ends}" for name, ends in read.items()),
        }
        return [line for kind, line in said.items() if kinds is None or kind in kinds]

    def as_json(self) -> dict[str, Any]:
        """As plain data."""
        fixed = {"effects": list(DEFAULT_EFFECTS), "heuristic": DEFAULT_HEURISTIC, "files": self.files}
        return {"gbuffer": asdict(self.gbuffer), "tracer": asdict(self.tracer)} | fixed

    def _auto(self, kind: str) -> Choice:
        return self.gbuffer if kind == "gbuffer" else self.tracer


def _choice(choose: Callable[[Registry], Choice], registry: Registry) -> Choice:
    try:
        return choose(registry)
    except PluginError as error:
        return Choice("", str(error))


def _loader(registry: Registry, suffix: str) -> str:
    """Who reads files of `suffix`; empty where that is not settled."""
    try:
        found = registry.loader_for(suffix)
    except PluginError:
        return ""
    return found.name if found is not None else ""
