"""Every command of `phrt` with its arguments and options, read off the application itself: for docs/command-line.md."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import typer

from phrt.cli.main import app
from phrt.registry import get_registry

VALUES = {int: "NUMBER", float: "NUMBER", str: "TEXT", Path: "PATH"}


@dataclass(frozen=True)
class Row:
    """An argument or an option. names: as they are typed; value: what follows one, empty for a switch; default: empty where
    there is none, "required" where one must be given."""

    names: tuple[str, ...]
    value: str
    default: str
    meaning: str
    is_argument: bool


def commands() -> dict[str, Any]:
    """Every command that ships, by what is typed: "phrt", "phrt render", "phrt plugins show", ..."""
    found = below("phrt", typer.main.get_command(app))
    for entry in get_registry().plugins("command"):
        if entry.origin == "built-in":
            made = get_registry().create("command", entry.name)
            found |= below(f"phrt {entry.name}", typer.main.get_command(made))
    return found


def below(path: str, command: Any) -> dict[str, Any]:
    """`command` and its subcommands, by what is typed."""
    found = {path: command}
    for name, child in getattr(command, "commands", {}).items():
        found |= below(f"{path} {name}", child)
    return found


def rows(command: Any) -> list[Row]:
    """Its arguments and options, in the order of the function behind it; `--help`, which all have, is not among them."""
    function = inspect.unwrap(command.callback)
    hints, given = get_type_hints(function), inspect.signature(function).parameters
    shown = [parameter for parameter in command.params if not getattr(parameter, "hidden", False)]
    return [row(each, plain_type(hints[each.name]), given[each.name].default) for each in shown if each.name in given]


def row(parameter: Any, kind: Any, default: object) -> Row:
    """One of them; `kind` is its type and `default` what the function has."""
    argument = parameter.param_type_name == "argument"
    word = parameter.metavar or (parameter.name.upper() if argument else "" if kind is bool else value_name(kind))
    names = (word,) if argument else (*parameter.opts, *parameter.secondary_opts)
    return Row(names, "" if argument else word, default_text(default, names), parameter.help or "", argument)


def plain_type(hint: Any) -> Any:
    """What one value is, of a hint that allows None or several."""
    if get_origin(hint) in (Union, UnionType):
        hint = next(part for part in get_args(hint) if part is not type(None))
    return plain_type(get_args(hint)[0]) if get_origin(hint) is list else hint


def value_name(kind: Any) -> str:
    """What stands for a value: its choices, or a word for its type."""
    if isinstance(kind, type) and issubclass(kind, Enum):
        return "|".join(str(member.value) for member in kind)
    return VALUES[kind]


def default_text(default: object, names: tuple[str, ...]) -> str:
    """A default as it would be typed; empty for a switch that is off and for what is merely not given."""
    if default is inspect.Parameter.empty:
        return "required"
    if isinstance(default, bool):
        return names[0] if default else ""
    return "" if default is None else str(default)


def usage(path: str, command: Any) -> str:
    """How it is called, in a line."""
    found = rows(command)
    arguments = [r.names[0] if r.default == "required" else f"[{r.names[0]}]" for r in found if r.is_argument]
    needed = [f"{r.names[0]} {r.value}" for r in found if not r.is_argument and r.default == "required"]
    more = any(not r.is_argument and r.default != "required" for r in found)
    follows = ["COMMAND"] if getattr(command, "commands", None) and not command.invoke_without_command else []
    return " ".join([path, *arguments, *needed, *(["[options]"] if more else []), *follows])
