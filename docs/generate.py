"""Writes what comes from the code into the pages of the documentation: PAGES, all that have room for it.

    .venv/bin/python docs/generate.py            rewrite what changed
    .venv/bin/python docs/generate.py --check    change nothing; leave with 1 where a page is out of date

A page holds it between `<!-- generated: NAME -->` and `<!-- end -->`; the rest is written by hand.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from functools import partial
from inspect import cleandoc
from pathlib import Path

import numpy as np
from cli_tables import Row, commands, rows, usage
from docstrings import as_markdown
from pydantic import BaseModel

from phrt import errors
from phrt.channels import CHANNELS, Channel
from phrt.interfaces.effect import LayerSpec
from phrt.interfaces.metric import Column
from phrt.registry import Plugin, get_registry, hookspecs
from phrt.registry.manager import KINDS, RegisteredPlugin, hook_name, import_factory
from phrt.registry.options import option_rows
from phrt_plugins.bench.config import BenchConfig, HeuristicEntry, PathTraced, SceneEntry

DOCS = Path(__file__).resolve().parent
PAGES = sorted(str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md") if "<!-- generated: " in page.read_text())
BLOCK = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

KIND_TITLES = {
    "gbuffer": "G-buffer producers",
    "tracer": "Tracers",
    "effect": "Effects",
    "heuristic": "Heuristics",
    "loader": "Loaders",
    "metric": "Metrics",
    "command": "Commands",
}


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; bars in cells are escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def number(value: float | int) -> str:
    """A clear value as a reader would write it."""
    if value == 0xFFFFFFFF:
        return "0xFFFFFFFF"
    return "+inf" if value == np.inf else f"{value:g}"


def shape(channel: Channel) -> str:
    return "(H, W)" if channel.components == 1 else f"(H, W, {channel.components})"


def channels() -> str:
    """One row a G-buffer channel."""
    rows = [
        (f"`{c.name}`", np.dtype(c.dtype).name, shape(c), c.space_unit, number(c.clear), c.meaning)
        for c in CHANNELS.values()
    ]
    return table(("channel", "dtype", "shape", "space, unit", "clear", "meaning"), rows)


def built_in(kind: str) -> list[RegisteredPlugin]:
    """The plugins that PHRT ships, so that the page is the same wherever others are installed."""
    return [entry for entry in get_registry().plugins(kind) if entry.origin == "built-in"]


def layers() -> str:
    """One row a layer, with the effect that writes it."""
    rows = []
    for entry in built_in("effect"):
        effect = import_factory(f"effect '{entry.name}'", entry)
        spec: LayerSpec = effect.writes
        rows.append(
            (f"`{spec.name}`", f"`{entry.name}`", f"{spec.components or 'L'}", number(spec.clear), spec.meaning)
        )
    return table(("layer", "effect", "components", "clear", "meaning"), rows)


def metrics() -> str:
    """One row a column of a metric that ships."""
    rows = []
    for entry in built_in("metric"):
        columns: tuple[Column, ...] = import_factory(f"metric '{entry.name}'", entry).columns
        rows += [
            (f"`{c.name}`", f"`{entry.name}`", c.scope, c.unit or "1", c.better, c.statistic, c.summary)
            for c in columns
        ]
    return table(("column", "metric", "scope", "unit", "better", "over frames", "meaning"), rows)


def options() -> str:
    """Every option of every plugin that ships, by kind."""
    parts = []
    for kind in KINDS:
        entries = built_in(kind)
        if entries:
            parts.append(f"## {KIND_TITLES[kind]}\n")
            parts += [plugin_options(entry) for entry in entries]
    return "\n" + "\n".join(parts) + "\n"


def plugin_options(entry: RegisteredPlugin) -> str:
    """A plugin's heading, summary and options."""
    rows = [(f"`{r.name}`", r.allowed, r.default, r.unit, r.meaning) for r in option_rows(entry.plugin.options)]
    body = table(("option", "allowed", "default", "unit", "meaning"), rows) if rows else "No options.\n"
    return f"### {entry.kind} `{entry.name}`\n\n{entry.plugin.summary}\n\n{body}"


def keys(model: type[BaseModel]) -> str:
    """One row a key of a config."""
    rows = [(f"`{row.name}`", row.default, row.meaning) for row in option_rows(model)]
    return table(("key", "default", "meaning"), rows)


def hooks() -> str:
    """Every hook with what it is for, and what its descriptor says beyond those of all kinds."""
    return "\n" + "\n".join(hook(kind, descriptor) for kind, descriptor in KINDS.items()) + "\n"


def hook(kind: str, descriptor: type[Plugin]) -> str:
    """A hook's heading, its docstring, its descriptor and what that adds to `Plugin`."""
    name = hook_name(kind)
    added = [field.name for field in fields(descriptor) if field.name not in Plugin.__dataclass_fields__]
    own = f" with {', '.join(f'`{each}`' for each in added)}" if added else ""
    more = re.sub(r"^Makes .*?\.(\s+|$)", "", described(descriptor), flags=re.DOTALL)
    parts = [
        f"### `{name}`",
        cleandoc(getattr(hookspecs, name).__doc__),
        f"Returns a list of `{descriptor.__name__}`{own}.",
        more,
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


def described(descriptor: type[Plugin]) -> str:
    """A descriptor's docstring, its fields as a list."""
    return as_markdown(cleandoc(descriptor.__doc__ or ""), [field.name for field in fields(descriptor)])


def descriptor() -> str:
    """What descriptors of every kind say."""
    return f"\n{described(Plugin)}\n\n"


def error_classes() -> list[type[BaseException]]:
    """The errors and warnings of PHRT, bases first."""
    return [each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, BaseException)]


def error_table() -> str:
    """One row an error."""
    found = [
        (f"`{e.__name__}`", f"`{e.__base__.__name__}`", " ".join(cleandoc(e.__doc__).split())) for e in error_classes()
    ]
    return table(("class", "is a", "raised when"), found)


def called(row: Row) -> str:
    """An argument or option as it is typed, with what follows it."""
    return ", ".join(map(code, row.names)) + (f" {code(row.value)}" if row.value else "")


def code(text: str) -> str:
    """As code, where there is any."""
    return f"`{text}`" if text not in ("", "required") else text


def command_block(path: str) -> str:
    """How a command is called, what it does, and its arguments and options."""
    command = commands()[path]
    found = [(called(row), code(row.default), row.meaning) for row in rows(command)]
    head = ("argument, option", "default", "meaning")
    return f"\n```text\n{usage(path, command)}\n```\n\n{cleandoc(command.help)}\n\n{table(head, found)}\n"


TABLES: dict[str, Callable[[], str]] = {
    "channels": channels,
    "layers": layers,
    "metrics": metrics,
    "options": options,
    "bench": partial(keys, BenchConfig),
    "bench_scenes": partial(keys, SceneEntry),
    "bench_heuristics": partial(keys, HeuristicEntry),
    "bench_reference": partial(keys, PathTraced),
    "descriptor": descriptor,
    "hooks": hooks,
    "errors": error_table,
}
TABLES |= {path.replace(" ", "_"): partial(command_block, path) for path in commands()}


def refreshed(text: str) -> str:
    """A page's text with every generated block made anew."""
    return BLOCK.sub(lambda match: match[1] + TABLES[match[2]]() + match[3], text)


def main(arguments: list[str]) -> int:
    stale = [page for page in PAGES if refreshed((DOCS / page).read_text()) != (DOCS / page).read_text()]
    for page in stale:
        print(f"{page} is {'out of date' if '--check' in arguments else 'rewritten'}")
        if "--check" not in arguments:
            (DOCS / page).write_text(refreshed((DOCS / page).read_text()))
    return 1 if stale and "--check" in arguments else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
