"""From outside: a scene that asks for it, the command line, candidates, overlay, explanation."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

import phrt
from phrt.cli import main as cli
from phrt.overlay import SKIPPED, TRACED, overlay, pixel_kinds

SCENE = """
phrt: 1
name: Ball
prims:
  Materials:
    children:
      Ground: {type: Material, base_color: 0.5, roughness: 1.0, specular: 0.0}
      Glass: {type: Material, roughness: 0.0, transmission: 1.0, ior: 1.5, thickness: 1.0}
  Ground: {type: Plane, size: [8, 8], material: /Materials/Ground}
  Ball: {type: Sphere, radius: 0.5, subdivision: 4, material: /Materials/Glass, xform: {translate: [0, 0.9, 0]}}
  Lamp: {type: SphereLight, intensity: 40, radius: 0.02, xform: {translate: [1, 4, 1]}}
  Eye: {type: Camera, fov: 50, xform: {translate: [0, 1.5, 4], rotate: [-14, 0, 0]}}
  Settings: {type: RenderSettings, size: [64, 36], effects: {caustics: {photons_per_pixel: 8, smoothing: 3}}}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "ball.yaml"
    path.write_text(SCENE)
    return path


def run(*arguments: str) -> tuple[int, str, str]:
    """`phrt ARGUMENTS` in this process: exit code, standard output, standard error."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.run(list(arguments))
    return code, out.getvalue(), err.getvalue()


def test_a_scene_asks_for_it_and_its_items_are_candidates(scene: Path) -> None:
    with phrt.Renderer(phrt.load_scene(scene), gbuffer="raycast", threads=2, strict=True) as renderer:
        frame = renderer.render()
        assert [effect.name for effect in renderer.effects][-1] == "caustics"
    candidates = frame.decisions.candidates
    mine = np.flatnonzero(np.array(candidates.effect_names)[candidates.effect] == "caustics")
    paths = [frame.world.scene.objects[number - 1].path for number in candidates.object_id[mine]]
    assert paths == ["/Ground"]
    assert candidates.predicted_cost[mine] == pytest.approx(8 * 4 * candidates.pixel_count[mine], rel=0.01)
    assert frame.decisions.rays[mine].sum() == frame.rays["caustics"] > 0
    assert frame.layers["caustics"].max() > 5 * np.median(frame.layers["caustics"])


def test_a_scene_switches_it_object_by_object(tmp_path: Path) -> None:
    path = tmp_path / "off.yaml"
    path.write_text(
        SCENE.replace("material: /Materials/Ground}", "material: /Materials/Ground, effects: {caustics: never}}")
    )
    with phrt.Renderer(phrt.load_scene(path), gbuffer="raycast", threads=2, strict=True) as renderer:
        frame = renderer.render()
    assert not frame.layers["caustics"].any()
    assert "caustics" not in {frame.decisions.candidates.effect_names[e] for e in frame.decisions.candidates.effect}


def test_an_option_out_of_range_is_refused_with_what_is_allowed(scene: Path, tmp_path: Path) -> None:
    code, _, said = run("render", str(scene), "-o", str(tmp_path / "a.png"), "--effect", "caustics.max_depth=0")
    assert code == 2
    assert "effect 'caustics'" in said
    assert "allowed: int >= 1 <= 64" in said


def test_overlay_and_explain_know_it(scene: Path, tmp_path: Path) -> None:
    record = tmp_path / "run"
    code, _, said = run(
        "render", str(scene), "-o", str(tmp_path / "a.png"), "--budget", "3000rays", "--heuristic", "greedy_relevance",
        "--record", str(record), "--overlay", "--layers", str(tmp_path / "layers"), "--effect", "caustics.fallback=none",
    )  # fmt: skip
    assert code == 0, said
    assert (tmp_path / "layers" / "layer_caustics.png").exists()
    code, printed, said = run(
        "explain", str(record), "--frame", "0", "--object", "/Ground", "--effect", "caustics", "--json"
    )
    assert code == 0, said
    (effect,) = json.loads(printed)["effects"]
    assert effect["effect"] == "caustics"
    assert effect["item"]["predicted_rays"]["value"] > 0


def test_the_overlay_shows_where_it_was_traced(scene: Path) -> None:
    kinds = {}
    for heuristic in ("all_trace", "raster_only"):
        with phrt.Renderer(
            phrt.load_scene(scene), gbuffer="raycast", threads=2, strict=True, heuristic=heuristic,
            effects={"caustics": {"fallback": "none"}},
        ) as renderer:  # fmt: skip
            frame = renderer.render()
        ground = frame.gbuffer.object_id == 1
        kinds[heuristic] = set(np.unique(pixel_kinds(frame, "caustics")[ground]).tolist())
        assert overlay(frame, "caustics").shape == (36, 64, 3)
    assert kinds == {"all_trace": {TRACED}, "raster_only": {SKIPPED}}


def test_the_plugin_has_a_manual_page() -> None:
    code, printed, said = run("plugins", "show", "caustics")
    assert code == 0, said
    assert "photons_per_pixel" in printed
    assert "metres" in printed
