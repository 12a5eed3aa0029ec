"""`phrt`: the command line, and what happens to errors in it (policy: phrt/errors.py)."""

from __future__ import annotations

import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from phrt.cli.analyze import analyze
from phrt.cli.console import escape, messages, terminal, tidy_warnings
from phrt.cli.doctor import doctor
from phrt.cli.explain import explain
from phrt.cli.new import new
from phrt.cli.options import PluginOption
from phrt.cli.plugins import plugins_app
from phrt.cli.render import render
from phrt.cli.schema import schema
from phrt.errors import InputError, PhrtError, PluginError
from phrt.registry.manager import RegisteredPlugin, describe

OUR_FAULT, INPUT_WRONG, INTERRUPTED = 1, 2, 130


class CommandsAndPlugins(TyperGroup):
    """The built-in commands, and those of plugins: looked for only when no built-in one is meant."""

    def list_commands(self, ctx: Any) -> list[str]:
        from phrt.registry import get_registry

        return [*super().list_commands(ctx), *get_registry().names("command")]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        built_in = super().get_command(ctx, cmd_name)
        if built_in is not None:
            return built_in
        from phrt.registry import get_registry

        registry = get_registry()
        if cmd_name not in registry.names("command"):
            return None
        try:
            return command_of(registry.find("command", cmd_name), registry.create("command", cmd_name))
        except PluginError as error:
            return failing_command(cmd_name, error)


def command_of(entry: RegisteredPlugin, made: Any) -> Any:
    """The command of a typer application that a plugin made; what another package's raises names it. Raises PluginError where typer
    cannot use it."""
    title = f"command '{entry.name}' of {entry.source}"
    try:
        command = typer.main.get_command(made)
    except (Exception, SystemExit) as error:
        raise PluginError(f"{title} is broken: {describe(error)}") from error
    invoke = command.invoke

    def named(context: Any) -> Any:
        try:
            return invoke(context)
        except (PhrtError, MemoryError, OSError):
            raise
        except Exception as error:
            if type(error).__module__.partition(".")[0] in ("typer", "click"):
                # Wrong usage, or the end of a command.
                raise
            raise PluginError(f"{title} failed: {describe(error)}") from error

    if entry.origin != "built-in":
        # Click's commands have nothing to hook into: their class is whatever the plugin's typer made.
        command.invoke = named  # type: ignore[assignment, method-assign]
    return command


def failing_command(name: str, error: PluginError) -> Any:
    """A command that says why it cannot run: `phrt --help` lists it, and only using it is an error."""
    stand_in = typer.Typer(rich_markup_mode=None)

    @stand_in.command(name, help="Cannot be used here.", context_settings={"ignore_unknown_options": True})
    def fail(arguments: Annotated[list[str] | None, typer.Argument(hidden=True)] = None) -> None:
        raise error

    return typer.main.get_command(stand_in)


app = typer.Typer(
    name="phrt",
    cls=CommandsAndPlugins,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("render")(render)
app.command("analyze")(analyze)
app.command("explain")(explain)
app.add_typer(plugins_app, name="plugins")
app.command("new")(new)
app.command("doctor")(doctor)
app.command("schema")(schema)


def _version(value: bool) -> None:
    if value:
        import phrt

        typer.echo(f"phrt {phrt.__version__}")
        raise typer.Exit()


@app.callback()
def phrt(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
    plugin: PluginOption = None,
) -> None:
    """Hybrid rendering: rasterize everything, ray trace only what pays. --plugin before COMMAND can bring the command."""


def main(arguments: list[str] | None = None) -> None:
    """Run `phrt` and leave with its exit code: 0 done, 2 the input is wrong, 1 our fault, 130 interrupted."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: list[str]) -> int:
    """Run `phrt` with `arguments` and return its exit code; errors become messages on standard error."""
    terminal.debug, terminal.quiet = False, False
    terminal.warned.clear()
    terminal.plugins.clear()
    with tidy_warnings():
        try:
            code = leaving_code(arguments)
            # Only now does what was printed meet a reader that may have left.
            sys.stdout.flush()
            return code
        except InputError as error:
            return complain(str(error), INPUT_WRONG)
        except KeyboardInterrupt:
            return complain("interrupted", INTERRUPTED)
        except BrokenPipeError:
            return silence_output()
        except MemoryError as error:
            return complain(f"not enough memory: {error}", OUR_FAULT)
        except Exception as error:
            advice = "" if terminal.debug else " (--debug shows where)"
            return complain(f"internal error: {type(error).__name__}: {error}{advice}", OUR_FAULT)


def leaving_code(arguments: list[str]) -> int:
    """Run the command, and return the code that it leaves with."""
    try:
        app(arguments)
    except SystemExit as leaving:
        if isinstance(leaving.code, str):
            return complain(leaving.code, OUR_FAULT)
        return leaving.code or 0
    return 0


def complain(text: str, code: int) -> int:
    """Print an error on standard error, with the traceback when `--debug` asks for it; return `code`."""
    if terminal.debug:
        import traceback

        traceback.print_exc()
    messages().print(f"[red]error:[/red] {escape(text)}" if code != INTERRUPTED else text)
    return code


def silence_output() -> int:
    """Whoever read standard output has left: let nothing be written to it any more, not even at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0
