"""What the commands print and write when all is well."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import needs
import numpy as np
import pytest
import typer
from PIL import Image

from phrt.cli import main as cli
from phrt.cli.doctor import PROBED_KINDS
from phrt.registry import CommandPlugin, get_registry

PROJECT = Path(__file__).resolve().parents[3]

TWO_FRAMES = """\
prims:
  /World:
    type: Xform
  /World/Ball:
    type: Sphere
    radius: 0.5
  /World/Floor:
    type: Plane
    size: [8, 8]
    xform: {translate: [0, -0.5, 0]}
  /World/Lamp:
    type: SphereLight
    radius: 0.1
    intensity: 60
    xform: {translate: [2, 3, 2]}
  /World/Eye:
    type: Camera
    xform: {translate: [0, 0.5, 4]}
"""


@pytest.fixture
def scene(tmp_path: Path) -> str:
    path = tmp_path / "scene.yaml"
    path.write_text(TWO_FRAMES)
    return str(path)


def phrt(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[str, str]:
    """Standard output and standard error of `phrt ARGUMENTS`, which must succeed."""
    code = cli.run(list(arguments))
    captured = capsys.readouterr()
    assert code == 0, captured.err
    return captured.out, captured.err


def render(capsys: pytest.CaptureFixture[str], scene: str, output: Path, *arguments: str) -> tuple[str, str]:
    return phrt(capsys, "render", scene, "-o", str(output), "--size", "32x18", *arguments)


# render


def test_render_writes_a_picture_and_says_so(capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path) -> None:
    out, err = render(capsys, scene, tmp_path / "x.png")
    picture = np.asarray(Image.open(tmp_path / "x.png"))
    assert picture.shape == (18, 32, 3)
    assert picture.std() > 5
    assert out == ""
    assert re.search(r"x\.png: 32x18, \d+ ms, [\d,]+ rays", err)


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path) -> None:
    assert render(capsys, scene, tmp_path / "x.png", "-q") == ("", "")


def test_json_reports_files_stages_and_rays(capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path) -> None:
    pattern = tmp_path / "f_%03d.png"
    out, _ = render(capsys, scene, pattern, "--frames", "3:5", "--json", "--gbuffer", "raycast")
    report = json.loads(out)
    assert report["files"] == [str(tmp_path / "f_003.png"), str(tmp_path / "f_004.png")]
    assert all(Path(name).exists() for name in report["files"])
    assert report["size"] == [32, 18]
    assert report["warnings"] == []
    assert [frame["index"] for frame in report["frames"]] == [3, 4]
    for frame in report["frames"]:
        assert frame["milliseconds"] == pytest.approx(sum(frame["stages"].values()), abs=0.02)
        assert frame["rays"]["primary"] == 32 * 18
        assert frame["rays"]["shadows"] > 0


def test_raster_only_traces_nothing_but_primary_rays(
    capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path
) -> None:
    out, _ = render(capsys, scene, tmp_path / "x.png", "--heuristic", "raster_only", "--json")
    rays = json.loads(out)["frames"][0]["rays"]
    assert sum(count for kind, count in rays.items() if kind != "primary") == 0


def test_a_budget_and_options_of_the_heuristic_reach_the_frame(
    capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path
) -> None:
    def rays(*arguments: str) -> dict[str, int]:
        out, _ = render(capsys, scene, tmp_path / "x.png", "--json", "--gbuffer", "raycast", *arguments)
        counts = json.loads(out)["frames"][0]["rays"]
        assert counts.pop("primary") == 32 * 18
        return {kind: count for kind, count in counts.items() if count}

    everything = rays()
    budget = sum(everything.values()) // 2
    some = rays("--heuristic", "random", "-H", "seed=3", "--budget", f"{budget}rays")
    assert 0 < sum(some.values()) < sum(everything.values())
    assert rays("--budget", "0rays", "--persistence", "0") == {}
    assert cli.run(["render", scene, "-o", str(tmp_path / "x.png"), "--heuristic", "random", "-H", "sed=3"]) == 2
    assert "heuristic 'random': unknown option 'sed'" in capsys.readouterr().err


def test_effects_overrides_and_exposure_reach_the_picture(
    capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path
) -> None:
    pictures = {}
    for name, arguments in {
        "plain": [],
        "no_shadows": ["--effect", "shadows.enabled=false"],
        "dark": ["--exposure", "0.25"],
        "no_light": ["-D", "/World/Lamp.intensity=0"],
        "antialiased": ["--aa", "4"],
        "aces": ["--tone-map", "aces"],
    }.items():
        render(capsys, scene, tmp_path / f"{name}.png", *arguments)
        pictures[name] = np.asarray(Image.open(tmp_path / f"{name}.png")).astype(float)
    plain = pictures.pop("plain")
    same = [name for name, picture in pictures.items() if np.array_equal(picture, plain)]
    assert not same
    assert pictures["no_shadows"].mean() > plain.mean() > pictures["dark"].mean() > pictures["no_light"].mean()


def test_an_exr_holds_the_linear_picture_and_the_layers(
    capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path
) -> None:
    import OpenEXR

    render(capsys, scene, tmp_path / "x.exr")
    with OpenEXR.File(str(tmp_path / "x.exr")) as file:
        channels = set(file.channels())
    assert {"RGB", "reflection", "visibility"} <= {name.split(".")[0] for name in channels}


def test_layers_go_into_their_folder(capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path) -> None:
    out, _ = render(capsys, scene, tmp_path / "x.png", "--layers", str(tmp_path / "layers"), "--json")
    assert (tmp_path / "layers" / "layers.exr").exists()
    assert (tmp_path / "layers" / "figure1_d_composite.png").exists()
    listed = {Path(name) for name in json.loads(out)["files"]}
    assert listed == {tmp_path / "x.png", *(tmp_path / "layers").iterdir()}


def test_a_video_holds_every_frame(capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path) -> None:
    av = needs.package("av")
    render(capsys, scene, tmp_path / "x.mp4", "--frames", "0:3")
    with av.open(str(tmp_path / "x.mp4")) as file:
        assert sum(1 for _ in file.decode(video=0)) == 3


def test_an_older_picture_survives_a_failing_render(
    capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path
) -> None:
    (tmp_path / "x.png").write_bytes(b"precious")
    assert cli.run(["render", scene, "-o", str(tmp_path / "x.png"), "--camera", "9"]) == 2
    assert (tmp_path / "x.png").read_bytes() == b"precious"
    assert sorted(os.listdir(tmp_path)) == ["scene.yaml", "x.png"]


@pytest.mark.parametrize("output", ["x.mp4", "x.exr", "f_%d.png"])
def test_a_failing_render_leaves_nothing_behind(
    capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path, output: str
) -> None:
    for wrong in (["--tracer", "embre"], ["--camera", "9"], ["--effect", "shadows.samples=-1"]):
        assert cli.run(["render", scene, "-o", str(tmp_path / output), "--frames", "1", *wrong]) == 2
    assert os.listdir(tmp_path) == ["scene.yaml"]


def test_a_plugin_file_can_be_used_at_once(capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path) -> None:
    plugin = tmp_path / "first_only.py"
    plugin.write_text(
        "from phrt.interfaces.heuristic import Heuristic\n"
        "from phrt.registry import HeuristicPlugin, hookimpl\n"
        "class FirstOnly(Heuristic):\n"
        "    def __init__(self, options): self.left = []\n"
        "    def begin_frame(self, candidates, context): self.left = [0] if len(candidates) else []\n"
        "    def next(self, remaining): return self.left.pop() if self.left else None\n"
        "@hookimpl\n"
        "def phrt_heuristics():\n"
        "    return [HeuristicPlugin('first_only', 'Traces one item.', f'{__name__}:FirstOnly')]\n"
    )
    counts = {}
    try:
        for name in ("first_only", "all_trace", "raster_only"):
            out, _ = render(capsys, scene, tmp_path / "x.png", "--plugin", str(plugin), "--heuristic", name, "--json")
            counts[name] = sum(json.loads(out)["frames"][0]["rays"].values())
    finally:
        get_registry()._forget(str(plugin))
    assert counts["raster_only"] < counts["first_only"] < counts["all_trace"]


# plugins, doctor, schema


def test_plugins_lists_every_plugin_with_its_availability(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = phrt(capsys, "plugins")
    for entry in get_registry().plugins():
        (line,) = [line for line in out.splitlines() if line.split()[:2] == [entry.kind, entry.name]]
        reason = entry.unavailable_reason()
        assert f" {'yes' if reason is None else 'no'} " in line.removesuffix(entry.plugin.summary)
        assert reason is None or f"  {entry.kind} {entry.name}: {reason}" in out


def test_plugins_as_json_can_be_filtered(capsys: pytest.CaptureFixture[str]) -> None:
    rows = json.loads(phrt(capsys, "plugins", "--kind", "loader", "--json")[0])["plugins"]
    assert {row["name"]: row["default"] for row in rows} == {
        "atrium": "",
        "gltf": ".gltf .glb",
        "mesh": ".obj .ply .stl",
        "simplified": "",
    }


def test_the_defaults_shown_are_those_the_renderer_takes(capsys: pytest.CaptureFixture[str]) -> None:
    from phrt.registry.auto import DEFAULT_EFFECTS, DEFAULT_HEURISTIC, choose_gbuffer, choose_tracer

    rows = json.loads(phrt(capsys, "plugins", "--json")[0])["plugins"]
    shown = {(row["kind"], row["name"]) for row in rows if row["default"] and row["kind"] != "loader"}
    wanted = {("gbuffer", choose_gbuffer().name), ("tracer", choose_tracer().name), ("heuristic", DEFAULT_HEURISTIC)}
    assert shown == wanted | {("effect", name) for name in DEFAULT_EFFECTS}


@pytest.mark.parametrize("entry", get_registry().plugins(), ids=lambda entry: f"{entry.kind}-{entry.name}")
def test_every_plugin_has_a_manual_page_and_shows_its_options(
    capsys: pytest.CaptureFixture[str], entry: object
) -> None:
    from phrt.cli.plugins import manual_page
    from phrt.registry import RegisteredPlugin

    assert isinstance(entry, RegisteredPlugin)
    page = manual_page(entry)
    assert len(page.splitlines()) >= 3, f"{entry.plugin.factory} opens with no manual page"
    out, _ = phrt(capsys, "plugins", "show", f"{entry.kind}/{entry.name}")
    assert page in out
    for option in entry.plugin.options.model_fields:
        assert f"  {option} = " in out


def test_doctor_tries_every_backend(capsys: pytest.CaptureFixture[str]) -> None:
    report = json.loads(phrt(capsys, "doctor", "--json")[0])
    found = {(row["kind"], row["name"]): row for row in report["backends"]}
    assert set(found) == {(kind, name) for kind in PROBED_KINDS for name in get_registry().names(kind)}
    assert found["tracer", "numpy"]["works"]
    assert found["gbuffer", "raycast"]["works"]
    for (kind, name), row in found.items():
        reason = get_registry().find(kind, name).unavailable_reason()
        assert row["works"] == (reason is None), row
    assert report["auto"]["tracer"]["reason"]
    assert report["kernel_cache"]["folder"]
    assert report["threads"] >= 1


def test_doctor_for_people_names_backends_and_what_auto_picks(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = phrt(capsys, "doctor")
    for kind in PROBED_KINDS:
        for name in get_registry().names(kind):
            assert f"{kind} {name}" in out
    assert re.search(r"^auto +gbuffer \w+: ", out, re.MULTILINE)


def test_doctor_requires(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    phrt(capsys, "doctor", "--require", "numpy,raycast")
    monkeypatch.setattr("phrt.cli.probes.probe_tracer", lambda *arguments: 1 / 0)
    assert cli.run(["doctor", "--require", "numpy"]) == 1
    out = capsys.readouterr().out
    assert "it failed its trial: ZeroDivisionError" in out
    assert "required and missing: numpy" in out
    assert cli.run(["doctor", "--require", "nunpy"]) == 2
    assert "Did you mean 'numpy'?" in capsys.readouterr().err


def test_a_tracer_with_wrong_answers_fails_its_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt.cli import probes
    from phrt.cli.doctor import check

    entry = get_registry().find("tracer", "numpy")
    assert check(get_registry(), entry, "").works
    # The triangle stands at 3 m, and the trial expects it at 2 m.
    monkeypatch.setattr(probes, "DISTANCE_M", 3.0)
    misplaced = probes.one_triangle()
    monkeypatch.undo()
    monkeypatch.setattr(probes, "one_triangle", lambda: misplaced)
    finding = check(get_registry(), entry, "")
    assert not finding.works
    assert "expected 2.0 m" in finding.note


def test_schema_of_a_plugin_is_its_options_schema(capsys: pytest.CaptureFixture[str]) -> None:
    found = json.loads(phrt(capsys, "schema", "plugin", "shadows")[0])
    assert found == get_registry().get("effect", "shadows").options.model_json_schema()


def test_schema_of_scenes_accepts_the_prims_it_documents(capsys: pytest.CaptureFixture[str]) -> None:
    found = json.loads(phrt(capsys, "schema")[0])
    assert "prims" in found["properties"]


def test_schema_of_anything_else_is_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["schema", "scenes"]) == 2
    assert "no schema for 'scenes', allowed: scene, plugin NAME. Did you mean 'scene'?" in capsys.readouterr().err


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    import phrt as package

    assert phrt(capsys, "--version")[0] == f"phrt {package.__version__}\n"


# Commands of plugins


def make_command(options: object) -> typer.Typer:
    """The factory of a command plugin."""
    made = typer.Typer()

    @made.command(help="Says hello.")
    def hello(name: str) -> None:
        print(f"hello {name}")

    return made


@pytest.fixture
def command_plugins() -> Iterator[None]:
    for name, factory in {"hello": f"{__name__}:make_command", "broken": "no_such_module_anywhere:x"}.items():
        get_registry().register(CommandPlugin(name, "", factory), owner=f"test {name}")
    yield
    for name in ("hello", "broken"):
        get_registry()._forget(f"test {name}")


@pytest.mark.usefixtures("command_plugins")
def test_a_plugin_can_bring_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert phrt(capsys, "hello", "world")[0] == "hello world\n"


@pytest.mark.usefixtures("command_plugins")
def test_a_broken_command_spoils_neither_the_help_nor_other_commands(capsys: pytest.CaptureFixture[str]) -> None:
    help_text, _ = phrt(capsys, "--help")
    assert "hello" in help_text
    assert "broken" in help_text
    assert cli.run(["broken", "x", "--y"]) == 2
    assert "command 'broken' of test broken is broken: 'no_such_module_anywhere:x'" in capsys.readouterr().err


def test_previews_of_layers_are_as_bright_as_the_picture(
    capsys: pytest.CaptureFixture[str], scene: str, tmp_path: Path
) -> None:
    folder = tmp_path / "layers"
    dark = (
        "--exposure",
        "0.25",
        "--heuristic",
        "raster_only",
        "--layers",
        str(folder),
        "--effect",
        "shadows.fallback=none",
    )
    render(capsys, scene, tmp_path / "x.png", *dark)
    pictures = [tmp_path / "x.png", folder / "figure1_a_raster.png", folder / "figure1_d_composite.png"]
    picture, raster, composite = (np.asarray(Image.open(path)).astype(int) for path in pictures)
    assert 20 < picture.max() < 250, "neither black nor clipped, or exposure would not show"
    np.testing.assert_array_equal(composite, picture)
    assert np.abs(raster - picture).max() <= 1
