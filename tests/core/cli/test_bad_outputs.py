"""What is written: an output that exists is replaced only by a complete one; wrong options name what is allowed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import needs
import numpy as np
import pytest
from cli_kit import Outcome, phrt

SCENE = """prims:
  Ball: {type: Sphere}
  Sun: {type: DistantLight}
  Cam: {type: Camera, look_at: {eye: [0, 0, 3], target: [0, 0, 0]}}
"""
OLD = b"the old picture"
NEEDS_AV = needs.all_need(None if find_spec("av") else "video needs PyAV: pip install 'phrt[video]'")
SUFFIXES = [".png", ".exr", pytest.param(".mp4", marks=NEEDS_AV)]

KILLED = """
import os, signal, sys
import PIL.Image, OpenEXR
from phrt.cli.main import run

def half(path):
    with open(path, "wb") as file:
        file.write(b"half a picture")
    os.kill(os.getpid(), signal.SIGKILL)

PIL.Image.Image.save = lambda self, path, **options: half(path)
OpenEXR.File.write = lambda self, path: half(path)
if "av" in sys.argv[1]:
    import av
    av.VideoFrame.reformat = lambda self, **options: os.kill(os.getpid(), signal.SIGKILL)
run(sys.argv[2:])
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "ball.yaml").write_text(SCENE)
    return folder / "ball.yaml"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder for outputs."""
    result = tmp_path / "out"
    result.mkdir()
    return result


def rendered(scene: Path, output: Path | str, *arguments: str) -> Outcome:
    return phrt("render", str(scene), "-o", str(output), "--size", "16x10", *arguments)


def told(done: Outcome) -> str:
    assert done.code == 2, done.said
    assert len(done.errors) == 1, done.said
    assert done.printed == ""
    assert "Traceback" not in done.said
    return done.errors[0].removeprefix("error: ")


# Old pictures


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_complete_output_replaces_the_old_one(scene: Path, folder: Path, suffix: str) -> None:
    output = folder / f"old{suffix}"
    output.write_bytes(OLD)
    assert rendered(scene, output).code == 0
    assert output.read_bytes() != OLD
    assert output.stat().st_size > 100
    assert list(folder.iterdir()) == [output]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_process_killed_while_it_writes_leaves_the_old_output(scene: Path, folder: Path, suffix: str) -> None:
    output = folder / f"old{suffix}"
    output.write_bytes(OLD)
    patched = "av" if suffix == ".mp4" else "pictures"
    command = [sys.executable, "-c", KILLED, patched, "render", str(scene), "-o", str(output), "--size", "16x10"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert output.read_bytes() == OLD


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_writer_that_fails_leaves_the_old_output_and_nothing_else(
    scene: Path, folder: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = folder / f"old{suffix}"
    output.write_bytes(OLD)

    def full_disk(*arguments: object, **options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full_disk)
    message = told(rendered(scene, output))
    assert message.startswith(f"cannot write '{output}': ")
    assert "No space left on device" in message
    assert output.read_bytes() == OLD
    assert list(folder.iterdir()) == [output]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_render_that_fails_leaves_the_old_output_and_nothing_else(
    scene: Path, folder: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = folder / f"old{suffix}"
    output.write_bytes(OLD)

    def broken(*arguments: object, **options: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("phrt.renderer.Renderer.render", broken)
    done = rendered(scene, output)
    assert done.code == 1
    assert "Traceback" not in done.said
    assert output.read_bytes() == OLD
    assert list(folder.iterdir()) == [output]


def test_a_wrong_scene_leaves_the_old_output(scene: Path, folder: Path) -> None:
    output = folder / "old.png"
    output.write_bytes(OLD)
    scene.write_text("prims: []\n")
    assert rendered(scene, output).code == 2
    assert output.read_bytes() == OLD


# Where nothing can be written


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing/x.png", "the folder '{folder}/missing' does not exist"),
        ("missing/%04d.png", "the folder '{folder}/missing' does not exist"),
        ("taken.png", "it is a folder"),
        ("file/x.png", "the folder '{folder}/file' does not exist"),
        ("x.jpg", "'.jpg' is not one of .png, .exr, .mp4, .mov, .mkv. Did you mean '.png'?"),
        ("x", "no suffix is not one of .png, .exr, .mp4, .mov, .mkv."),
        ("x" * 300 + ".png", "File name too long"),
    ],
)
def test_an_output_that_cannot_be_is_told(scene: Path, folder: Path, name: str, message: str) -> None:
    (folder / "taken.png").mkdir()
    (folder / "file").write_bytes(OLD)
    given = told(rendered(scene, folder / name))
    assert given.startswith(f"cannot write '{folder}/")
    assert message.format(folder=folder) in given
    assert sorted(path.name for path in folder.iterdir()) == ["file", "taken.png"]


def test_a_folder_without_permission_is_named(scene: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Root may write anywhere: what the system would say to others is said here.
    allowed = os.access
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != folder and allowed(path, mode))
    assert told(rendered(scene, folder / "x.png")) == (
        f"cannot write '{folder}/x.png': no permission to write in '{folder}'"
    )


def test_layers_into_a_file_are_refused_before_rendering(scene: Path, folder: Path) -> None:
    (folder / "layers").write_bytes(OLD)
    message = told(rendered(scene, folder / "x.png", "--layers", str(folder / "layers")))
    assert message == f"cannot write layers into '{folder}/layers': it is a file, not a folder"
    assert sorted(path.name for path in folder.iterdir()) == ["layers"]


def test_several_frames_do_not_overwrite_each_other(scene: Path, folder: Path) -> None:
    message = told(rendered(scene, folder / "x.png", "--frames", "0:3"))
    assert message == (
        f"3 frames do not fit into '{folder}/x.png': give a pattern, as in {folder}/x_%04d.png, or a video (.mp4)"
    )
    assert list(folder.iterdir()) == []
    assert rendered(scene, folder / "x_%04d.png", "--frames", "0:3").code == 0
    assert sorted(path.name for path in folder.iterdir()) == ["x_0000.png", "x_0001.png", "x_0002.png"]


# Options


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--size", "0x0"], "--size is '0x0', allowed: 1 to 16384 pixels a side"),
        (["--size", "-1x5"], "--size is '-1x5', expected WIDTHxHEIGHT in pixels, as in 1280x720"),
        (["--size", "axb"], "--size is 'axb', expected WIDTHxHEIGHT in pixels, as in 1280x720"),
        (["--size", "99999x99999"], "--size is '99999x99999', allowed: 1 to 16384 pixels a side"),
        (["--frames", "5:3"], "--frames is '5:3', expected FIRST below STOP and at most 1000000 frames"),
        (["--frames", "-1:3"], "--frames is '-1:3', expected FIRST:STOP"),
        (["--frames", "0:99999999"], "expected FIRST below STOP and at most 1000000 frames"),
        (["--aa", "0"], "--aa is 0, allowed: 1 to 1024"),
        (["--aa", "-4"], "--aa is -4, allowed: 1 to 1024"),
        (["--threads", "0"], "--threads is 0, allowed: 1 to 1024"),
        (["--budget=-5ms"], "--budget is '-5ms'"),
        (["--exposure=-1"], "--exposure is -1, allowed: 0 to 1e+09"),
        (["--time", "nan"], "--time is nan, allowed: -1e+06 to 1e+06"),
        (["--tone-map", "acs"], "'acs' is not one of srgb, aces, neutral. Did you mean 'aces'?"),
        (["--heuristic", "raster_onyl"], "there is no heuristic 'raster_onyl'. Known: "),
        (["--heuristic", "raster_onyl"], "Did you mean 'raster_only'?"),
        (["--tracer", "nunpy"], "Did you mean 'numpy'?"),
        (["--gbuffer", "raycst"], "Did you mean 'raycast'?"),
        (["--effect", "reflection.samples=1"], "Did you mean 'reflections'?"),
        (["--effect", "shadows.sample=1"], "unknown option 'sample'. Its options: samples, fallback"),
        (["--effect", "shadows.samples=many"], "option 'samples' is 'many', allowed: int >= 0"),
        (["--effect", "shadows.samples=!!python/name:os.system"], "'!!python/name:os.system' is not a value"),
        (["--camera", "/Can"], "no camera '/Can'; the scene has /Cam. Did you mean '/Cam'?"),
        (["--camera", "7"], "no camera number 7; the scene has 1, counted from 0"),
        (["--situation", "defalt"], "the variant 'defalt' is not one of: default. Did you mean 'default'?"),
        (["-D", "/Ball.radius=wide"], "override /Ball.radius: /Ball: radius: given 'wide'; wanted a number"),
        (["-D", "/Ball.radius=-1"], "override /Ball.radius: /Ball: radius: given -1; input should be greater than 0"),
        (["-D", "/Ball.radios=1"], "unknown key 'radios'; allowed: "),
        (["-D", "/Ball.radios=1"], "Did you mean 'radius'?"),
        (["-D", "/Bal.radius=1"], "override /Bal.radius: /Bal: over: there is no such prim. Did you mean '/Ball'?"),
        (["-D", "/Ball.radius"], "override '/Ball.radius': wanted PRIM.ATTRIBUTE=VALUE"),
        (["-D", "/Ball.radius=!!python/name:os.system 1"], "is not allowed; scene files are plain data"),
    ],
)
def test_a_wrong_option_says_what_is_allowed(scene: Path, folder: Path, arguments: list[str], message: str) -> None:
    if "--size" in arguments:
        done = phrt("render", str(scene), "-o", str(folder / "x.png"), *arguments)
    else:
        done = rendered(scene, folder / "x.png", *arguments)
    assert message in told(done)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("option", "value"), [("--aa", "x"), ("--threads", "1.5"), ("--time", "noon")])
def test_a_word_for_a_number_is_told(scene: Path, folder: Path, option: str, value: str) -> None:
    done = rendered(scene, folder / "x.png", option, value)
    assert done.code == 2
    (error,) = done.errors
    assert f"Invalid value for '{option}'" in error


@pytest.mark.parametrize("exposure", ["0", "1e9"])
def test_the_ends_of_exposure_are_pictures(scene: Path, folder: Path, exposure: str) -> None:
    from PIL import Image

    assert rendered(scene, folder / "x.png", "--exposure", exposure).code == 0
    with Image.open(folder / "x.png") as picture:
        pixels = np.asarray(picture)
    assert pixels.shape == (10, 16, 3)
    assert pixels.max() == (0 if exposure == "0" else 255)


def test_the_smallest_picture_is_a_picture(scene: Path, folder: Path) -> None:
    assert phrt("render", str(scene), "-o", str(folder / "x.png"), "--size", "1x1").code == 0
    assert (folder / "x.png").stat().st_size > 50
