"""`phrt new`: a package for a plugin of one's own, ready to install, change and test; or a scene to begin with."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from phrt.cli.console import say
from phrt.cli.options import DebugOption, PluginOption, QuietOption

TRY = {
    "heuristic": "phrt render SCENE -o out.png --heuristic {name} --budget 20000rays",
    "effect": "phrt render SCENE -o out.png --effect {name}.enabled=true",
    "tracer": "phrt render SCENE -o out.png --size 64x36 --tracer {name}",
    "metric": 'phrt bench CONFIG -o out      # with "metrics: [{name}]" in CONFIG',
}
"""How a plugin of each kind is used."""


def new(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="heuristic, effect, tracer, metric or scene.")],
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="What configs call it: lower case, digits, underscores; nearest_first, say."
        ),
    ],
    folder: Annotated[
        Path, typer.Option("--dir", metavar="DIR", help="Where folder phrt-NAME, or NAME.yaml, is made.")
    ] = Path(),
    plugin: PluginOption = None,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Write a package for a plugin of your own: folder phrt-NAME with a class that works and its options (phrt_NAME.py), tests
    that pass, a pyproject.toml and a README. Or a scene: NAME.yaml, and NAME_bench.yaml, which compares heuristics on it.

    For example: phrt new heuristic nearest_first; cd phrt-nearest-first; pip install -e .; then change phrt_nearest_first.py.
    """
    from phrt.cli.template import SCENE, write_new

    written = write_new(kind, name, folder)
    if kind == SCENE:
        scene, config = (shlex.quote(str(path)) for path in written)
        say(f"{scene}: a scene; {config}: a benchmark on it. Next:")
        say(f"  phrt render {scene} -o {name}.png")
        say(f"  phrt bench {config} -o out/{name}")
        return
    (target,) = written
    say(f"{target}: a package with the {kind} '{name}'. Next:")
    say(f"  cd {shlex.quote(str(target))}")
    say('  pip install -e ".[test]"')
    say(f"  {TRY[kind].format(name=name)}")
    say("  pytest")
    say("`phrt new scene room` writes a scene, where there is none yet.")
