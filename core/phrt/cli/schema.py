"""`phrt schema`: JSON Schema of scene descriptors and of plugins' options, for editors and checkers."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from phrt.cli.options import DebugOption, PluginOption
from phrt.errors import OptionError, did_you_mean


def schema(
    what: Annotated[str, typer.Argument(help="scene, or plugin.")] = "scene",
    name: Annotated[str | None, typer.Argument(help="With plugin: its name, or KIND/NAME.")] = None,
    plugin: PluginOption = None,
    debug: DebugOption = False,
) -> None:
    """Print the JSON Schema of scene descriptors, or of a plugin's options."""
    print(json.dumps(schema_of(what, name), indent=2))


def schema_of(what: str, name: str | None) -> dict[str, Any]:
    """The schema asked for. Raises OptionError or PluginError where there is none."""
    if what == "scene" and name is None:
        from phrt.description import schema as scene_schema

        return scene_schema()
    if what == "plugin" and name is not None:
        from phrt.cli.plugins import find_by_name

        return find_by_name(name).plugin.options.model_json_schema()
    given = what if name is None else f"{what} {name}"
    near = did_you_mean(what, ["scene", "plugin"])
    raise OptionError(f"no schema for '{given}', allowed: scene, plugin NAME.{near}")
