"""Exit codes and messages: 0 done, 2 the input is wrong (one message, no traceback), 1 our fault."""

from __future__ import annotations

import json
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from phrt.cli import main as cli
from phrt.errors import PhrtWarning
from phrt.registry import get_registry

SCENE = str(Path(__file__).resolve().parents[3] / "scenes" / "atrium.yaml")


def phrt(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `phrt ARGUMENTS`."""
    code = cli.run(list(arguments))
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "64x"], "--size is '64x', expected WIDTHxHEIGHT"),
        (["--size", "0x10"], "allowed: 1 to 16384 pixels a side"),
        (["--size", "16384x16384"], "268,435,456 pixels; allowed: at most 67,108,864 (8192x8192)"),
        (["--frames", "3:3"], "expected FIRST below STOP"),
        (["--frames", "a:b"], "expected FIRST:STOP"),
        (["--frames", "0:2", "--time", "1"], "--time and --frames exclude each other"),
        (["--budget", "50"], "--budget is '50' without a unit, expected a frame time (50ms)"),
        (["--budget", "200000"], "--budget is '200000' without a unit"),
        (["-H", "seed"], "-H is 'seed', expected OPTION=VALUE"),
        (["--persistence", "-1"], "--persistence is -1"),
        (["--aa", "0"], "--aa is 0, allowed: 1 to 1024"),
        (["--threads", "0"], "--threads is 0, allowed: 1 to 1024"),
        (["--exposure", "nan"], "--exposure is nan, allowed: 0 to"),
        (["--time", "inf"], "--time is inf"),
        (["--effect", "shadows"], "expected EFFECT.OPTION=VALUE"),
        (["--effect", "samples=4"], "expected EFFECT.OPTION=VALUE"),
        (["--plugin", "no_such_module_anywhere"], "plugin 'no_such_module_anywhere' cannot be imported"),
    ],
)
def test_a_wrong_argument_is_told_before_the_scene_is_read(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], message: str
) -> None:
    code, out, err = phrt(capsys, "render", "no_such_scene.yaml", "-o", str(tmp_path / "x.png"), *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert message in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("output", "arguments", "message"),
    [
        ("x.jpg", [], "'.jpg' is not one of .png, .exr, .mp4"),
        ("missing/x.png", [], "does not exist"),
        ("x.png", ["--frames", "0:3"], "3 frames do not fit into"),
        ("x.png", ["--tone-map", "acs"], "Did you mean 'aces'?"),
        ("x.png", ["--situation", "no_such_variant"], "the variant 'no_such_variant' is not one of"),
        ("x.png", ["--variant", "no_such_variant"], "the variant 'no_such_variant' is not one of"),
        ("x.png", ["--heuristic", "all_trac"], "Did you mean 'all_trace'?"),
        ("x.png", ["--tracer", "embre"], "Did you mean 'embree'?"),
        ("x.png", ["--gbuffer", "opengl"], "there is no gbuffer 'opengl'. Known: moderngl, raycast."),
        ("x.png", ["--effect", "shadow.samples=2"], "Did you mean 'shadows'?"),
        ("x.png", ["--effect", "shadows.samples=-1"], "option 'samples' is -1, allowed: int >= 0"),
        ("x.png", ["--camera", "/no/camera"], "no camera '/no/camera'"),
        ("x.png", ["-D", "no_such_prim.x=1"], "neither a prim nor a render setting"),
    ],
)
def test_what_does_not_fit_the_scene_is_input_too(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, output: str, arguments: list[str], message: str
) -> None:
    code, out, err = phrt(capsys, "render", SCENE, "-o", str(tmp_path / output), "--size", "16x9", *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_a_missing_scene_is_told(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, _, err = phrt(capsys, "render", "no_such_scene.yaml", "-o", str(tmp_path / "x.png"))
    assert code == 2
    assert err.splitlines() == ["error: no_such_scene.yaml: there is no such file"]


def test_a_misspelt_command_or_option_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert phrt(capsys, "rendr")[0] == 2
    code, _, err = phrt(capsys, "render", SCENE, "--outptu", "x.png")
    assert code == 2
    assert "--output" in err


def fail(error: BaseException) -> object:
    def schema_of(*arguments: object) -> None:
        raise error

    return schema_of


def test_our_own_fault_is_one_line_and_exit_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("phrt.cli.schema.schema_of", fail(ZeroDivisionError("by zero")))
    code, out, err = phrt(capsys, "schema")
    assert (code, out) == (1, "")
    assert err.splitlines() == ["error: internal error: ZeroDivisionError: by zero (--debug shows where)"]


def test_debug_shows_the_traceback(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phrt.cli.schema.schema_of", fail(ZeroDivisionError("by zero")))
    code, _, err = phrt(capsys, "schema", "--debug")
    assert code == 1
    assert "Traceback (most recent call last)" in err
    assert "in schema_of" in err


def test_an_interrupt_is_clean(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phrt.cli.schema.schema_of", fail(KeyboardInterrupt()))
    code, out, err = phrt(capsys, "schema")
    assert (code, out) == (130, "")
    assert "Traceback" not in err


def test_a_reader_that_leaves_early_is_no_error() -> None:
    late = f"{{ sleep 0.3; {sys.executable} -W error -m phrt.cli schema plugin atrium; echo code $? >&2; }} | true"
    done = subprocess.run(["bash", "-c", late], capture_output=True, text=True, timeout=60, check=True)
    assert done.stderr in ("code 0\n", "code 1\n")


def test_warnings_are_printed_once_and_without_a_place(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def schema_of(*arguments: object) -> dict[str, object]:
        for _ in range(3):
            warnings.warn(PhrtWarning("the texture [red] is missing"), stacklevel=1)
        return {}

    monkeypatch.setattr("phrt.cli.schema.schema_of", schema_of)
    code, out, err = phrt(capsys, "schema")
    assert code == 0
    assert json.loads(out) == {}
    assert err.splitlines() == ["warning: the texture [red] is missing"]


BROKEN_HEURISTIC = """\
from phrt.interfaces.heuristic import Heuristic
from phrt.registry import HeuristicPlugin, Options, hookimpl


class Dropped(Heuristic):
    def __init__(self, options):
        pass

    def begin_frame(self, candidates, context):
        self.left = [0, {second}]

    def next(self, remaining):
        return self.left.pop(0)


@hookimpl
def phrt_heuristics():
    return [HeuristicPlugin("{name}", "Breaks at its third item.", f"{{__name__}}:Dropped", Options)]
"""


@pytest.mark.parametrize(
    ("name", "second", "message"),
    [
        ("dropped_late", "1", "failed in next(): IndexError: pop from empty list"),
        ("dropped_twice", "0", "returned item 0: not one of"),
        ("dropped_odd", "'all'", "returned 'all' from next(): expected an item's number"),
    ],
)
@pytest.mark.parametrize("strict", [False, True])
def test_a_heuristic_that_breaks_is_named_and_the_picture_comes_out_unless_strict(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str, second: str, message: str, strict: bool
) -> None:
    plugin, output = tmp_path / f"{name}.py", tmp_path / "x.png"
    plugin.write_text(BROKEN_HEURISTIC.format(name=name, second=second))
    options = ["--size", "16x9", "--plugin", str(plugin), "--heuristic", name, *["--strict"] * strict]
    try:
        code, out, err = phrt(capsys, "render", SCENE, "-o", str(output), *options)
    finally:
        get_registry()._forget(str(plugin))
    assert (code, out) == (2 if strict else 0, "")
    assert f"heuristic '{name}' of {plugin} {message}" in " ".join(err.split())
    assert "Traceback" not in err
    assert output.exists() != strict
