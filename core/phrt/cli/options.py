"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phrt.cli.console import terminal


def _set_debug(value: bool) -> None:
    terminal.debug = terminal.debug or value


def _set_quiet(value: bool) -> None:
    terminal.quiet = value


def _add_plugins(sources: list[str] | None) -> list[str]:
    if sources:
        from phrt.registry.local import register_source

        for source in sources:
            register_source(source)
            terminal.plugins.append(source)
    return sources or []


def check_plugins(strict: bool) -> None:
    """PluginError where plugins were left out and the command is to be `strict`."""
    if strict:
        from phrt.registry import get_registry

        get_registry().check_whole()


DebugOption = Annotated[
    bool, typer.Option("--debug", help="Show the traceback of an error.", callback=_set_debug, is_eager=True)
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="No messages but warnings and errors.", callback=_set_quiet, is_eager=True)
]
PluginOption = Annotated[
    list[str] | None,
    typer.Option(
        "--plugin",
        metavar="MODULE_OR_FILE",
        help="Also use this plugin: a module or a .py file. Runs its code. Repeatable.",
        callback=_add_plugins,
        is_eager=True,
    ),
]
StrictOption = Annotated[
    bool,
    typer.Option("--strict", help="Whatever a plugin does wrong is an error, also of one that nobody asked for."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
SceneArgument = Annotated[
    Path,
    typer.Argument(
        metavar="SCENE", help="Scene descriptor (.yaml, .json) or model file (.glb, .gltf, .obj, .ply, .stl)."
    ),
]
