"""In real frames: by configuration alone, recorded, explained, replayed; the same on any number of threads."""

from __future__ import annotations

import contextlib
import io
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from phrt_saliency.heuristic import Saliency
from phrt_saliency.options import SaliencyOptions

import phrt
from phrt.cli import main as cli
from phrt.clock import RayClock
from phrt.frame import FrameResult
from phrt.registry import get_registry

PACKAGE = Path(__file__).resolve().parents[1]
SIZE = (160, 90)
SCENE = """
phrt: 1
name: Red among grey
prims:
  Grey: {type: Material, base_color: [0.3, 0.3, 0.3], roughness: 1.0, specular: 0.0}
  Red: {type: Material, base_color: [0.9, 0.05, 0.05], roughness: 1.0, specular: 0.0}
  World:
    children:
      Floor: {type: Plane, size: [30, 30], material: /Grey}
      Red: {type: Sphere, radius: 0.35, subdivision: 3, material: /Red, xform: {translate: [1.6, 0.35, -1.0]}}
      Grey: {type: Sphere, radius: 0.35, subdivision: 3, material: /Grey, xform: {translate: [0.3, 0.35, 0.4]}}
      Far: {type: Sphere, radius: 0.35, subdivision: 3, material: /Grey, xform: {translate: [-1.6, 0.35, -1.0]}}
  Key: {type: SphereLight, intensity: 60, radius: 0.0, xform: {translate: [-2.0, 5.0, 4.0]}}
  Sky: {type: DomeLight, intensity: 0.5, color: [0.8, 0.8, 0.8]}
  Camera:
    type: Camera
    fov: 40
    path: {keys: [{time: 0.0, eye: [0, 1.5, 5.0], target: [0, 0.4, 0]}, {time: 1.0, eye: [1, 1.5, 5.0], target: [0, 0.4, 0]}]}
  Settings: {type: RenderSettings, size: [160, 90], fps: 10, frames: 5, heuristic: saliency}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "red.yaml"
    path.write_text(SCENE)
    return path


def run(*arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `phrt ARGUMENTS`."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.run(list(arguments))
    return code, out.getvalue(), err.getvalue()


def frames_of(scene: Path, count: int = 4, **options: Any) -> Iterator[FrameResult]:
    options = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True, "heuristic": "saliency"} | options
    with phrt.Renderer(phrt.load_scene(scene), **options) as renderer:
        for number in range(count):
            yield renderer.render(number / 10)


def shadows_in_order(frame: FrameResult) -> list[str]:
    """The objects whose shadows were asked for, in order."""
    decisions, candidates = frame.decisions, frame.decisions.candidates
    mine = np.flatnonzero((decisions.order >= 0) & (candidates.effect == candidates.effect_names.index("shadows")))
    paths = [entry.path for entry in frame.world.scene.objects]
    return [paths[candidates.object_id[row] - 1] for row in mine[np.argsort(decisions.order[mine])]]


def test_the_package_names_its_module_where_phrt_looks() -> None:
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())
    assert project["project"]["entry-points"]["phrt"] == {"saliency": "phrt_saliency.plugin"}
    assert (PACKAGE / "phrt_saliency" / "py.typed").exists()


def test_what_stands_out_is_traced_before_what_is_nearer_and_in_the_middle(scene: Path) -> None:
    (frame,) = frames_of(scene, 1)
    assert shadows_in_order(frame)[0] == "/World/Red"
    (plain,) = frames_of(scene, 1, heuristic_options={"weight": 0.0})
    assert shadows_in_order(plain)[0] == "/World/Grey"


def test_a_scene_can_ask_for_it_by_name_alone(scene: Path, tmp_path: Path) -> None:
    code, _, said = run(
        "render", str(scene), "-o", str(tmp_path / "red.png"), "--budget", "9000rays", "-H", "weight=0.7"
    )
    assert code == 0, said
    assert (tmp_path / "red.png").exists()


def test_its_page_and_options_are_shown() -> None:
    code, printed, said = run("plugins", "show", "saliency")
    assert code == 0, said
    for name in SaliencyOptions.model_fields:
        assert name in printed


def test_it_is_recorded_and_explained(scene: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    how = ("--frames", "0:2", "--budget", "9000rays", "--record", str(folder), "-H", "choose=ratio")
    code, _, said = run("render", str(scene), "-o", str(tmp_path / "f_%04d.png"), *how)
    assert code == 0, said
    code, printed, said = run("explain", str(folder), "--frame", "1", "--object", "/World/Red", "--effect", "shadows")
    assert code == 0, said
    assert "shadows of /World/Red were traced whole in frame 1" in " ".join(printed.split())
    assert "number 1 of" in " ".join(printed.split())
    assert "that saliency asked for, with score number" in " ".join(printed.split())


def test_a_run_is_replayed_to_the_same_pictures(scene: Path, tmp_path: Path) -> None:
    from phrt.recording import Recorder, replay

    options: dict[str, Any] = {"size": SIZE, "gbuffer": "raycast", "heuristic": "saliency", "budget": "9000rays"}
    made = phrt.load_scene(scene)
    with phrt.Renderer(made, **options) as renderer, Recorder(tmp_path / "run", renderer) as recorder:
        frames = []
        for number in range(3):
            frames.append(renderer.render(number / 10))
            recorder.add(frames[-1])
    for was, now in zip(frames, replay(tmp_path / "run", made), strict=True):
        np.testing.assert_array_equal(now.image, was.image)


@pytest.mark.parametrize("choose", ["levels", "ratio", "relevance"])
def test_decisions_and_pictures_are_the_same_on_any_number_of_threads(scene: Path, choose: str) -> None:
    runs = [
        list(
            frames_of(
                scene, threads=threads, budget="rays:0.9ms", clock=RayClock(100), heuristic_options={"choose": choose}
            )
        )
        for threads in (1, 3)
    ]
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one.decisions.order, other.decisions.order)
        np.testing.assert_array_equal(one.image, other.image)
    decisions = [frame.decisions for frame in runs[0]]
    assert all(each.chosen.any() for each in decisions)
    assert any((each.traced_pixels < each.candidates.pixel_count).any() for each in decisions), "the budget holds all"


@pytest.mark.parametrize("grouping", ["object", "object_effect", "object_effect_light"])
def test_every_grouping_and_sub_pixel_samples_work(scene: Path, grouping: str) -> None:
    for frame in frames_of(scene, 2, group_by=grouping, budget="12000rays", aa=2):
        assert frame.decisions.chosen.any()
        assert np.isfinite(frame.image).all()


def test_mandatory_items_come_first(scene: Path) -> None:
    scene.write_text(SCENE.replace("translate: [-1.6", "translate: [-1.7").replace(
        "Far: {type: Sphere", "Far: {effects: {shadows: always}, type: Sphere"
    ))  # fmt: skip
    (frame,) = frames_of(scene, 1)
    assert shadows_in_order(frame)[:2] == ["/World/Far", "/World/Red"]


def test_attention_counts_on_top_of_saliency(scene: Path) -> None:
    scene.write_text(SCENE.replace("Grey: {type: Sphere", "Grey: {tags: [wanted], type: Sphere"))
    with phrt.Renderer(phrt.load_scene(scene), size=SIZE, heuristic="saliency", gbuffer="raycast") as renderer:
        renderer.control(attention={"wanted": 1000})
        assert shadows_in_order(renderer.render())[0] == "/World/Grey"


def test_a_new_one_is_made_for_every_run() -> None:
    one, other = (get_registry().create("heuristic", "saliency") for _ in range(2))
    assert isinstance(one, Saliency)
    assert one is not other
