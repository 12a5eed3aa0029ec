"""`phrt new`: a package for a plugin of one's own, ready to install, change and test."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from phrt.cli.console import say
from phrt.cli.options import DebugOption, QuietOption

TRY = {
    "heuristic": "phrt render SCENE -o out.png --heuristic {name} --budget 200000rays",
    "effect": "phrt render SCENE -o out.png --effect {name}.enabled=true",
    "tracer": "phrt render SCENE -o out.png --size 64x36 --tracer {name}",
    "metric": 'phrt bench CONFIG -o out      # with "metrics: [{name}]" in CONFIG',
}


def new(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="heuristic, effect, tracer or metric.")],
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="What configs call it: lower case, digits, underscores; nearest_first, say."
        ),
    ],
    folder: Annotated[Path, typer.Option("--dir", metavar="DIR", help="Where folder phrt-NAME is made.")] = Path(),
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a package for a plugin of your own: folder phrt-NAME with a class that works and its options (phrt_NAME.py), tests
    that pass, a pyproject.toml and a README.

    For example: phrt new heuristic nearest_first; cd phrt-nearest-first; pip install -e .; then change phrt_nearest_first.py.
    """
    from phrt.cli.template import write_package

    target = write_package(kind, name, folder)
    say(f"{target}: a package with the {kind} '{name}'. Next:")
    say(f"  cd {shlex.quote(str(target))}")
    say('  pip install -e ".[test]"')
    say(f"  {TRY[kind].format(name=name)}")
    say("  pytest")
