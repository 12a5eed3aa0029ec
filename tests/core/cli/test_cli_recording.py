"""`phrt render --record --overlay --replay` and `phrt explain`, as a user types them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cli_kit
import numpy as np
import pytest
from cli_kit import Outcome
from PIL import Image

from phrt.recording import read_run

SPHERES = str(Path(__file__).resolve().parents[3] / "scenes" / "spheres.yaml")
OPTIONS = ("--gbuffer", "raycast", "--heuristic", "selection_graph", "--budget", "3000rays")


def render(output: Path, *arguments: str) -> Outcome:
    return cli_kit.phrt("render", SPHERES, "-o", str(output), *arguments)


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of frames 2 to 4 at 64x36, recorded in `run` below it."""
    folder = tmp_path_factory.mktemp("walk")
    arguments = (*OPTIONS, "--size", "64x36", "--frames", "2:5", "--record", str(folder / "run"))
    done = render(folder / "f_%d.png", *arguments)
    assert done.code == 0, done.said
    return folder


# --record


def test_record_says_where_and_keeps_every_frame(walk: Path, tmp_path: Path) -> None:
    done = render(tmp_path / "x.png", "--size", "32x18", "--record", str(tmp_path / "runs" / "x"))
    assert done.code == 0
    assert f"recorded in {tmp_path / 'runs' / 'x'}" in done.said
    run = read_run(walk / "run")
    assert run.numbers.tolist() == [2, 3, 4]
    assert run.frames.column("time").to_pylist() == pytest.approx([2 / 30, 3 / 30, 4 / 30])
    assert run.config["heuristic"]["name"] == "selection_graph"
    assert run.about["settings"]["frames"] == "2:5"
    assert all(len(readings) > 2 for readings in run.frames.column("clock").to_pylist())


def test_json_names_the_run(tmp_path: Path) -> None:
    done = render(tmp_path / "x.png", "--size", "32x18", "--record", str(tmp_path / "run"), "--json")
    assert json.loads(done.printed)["record"] == str(tmp_path / "run")


def test_a_run_is_not_overwritten_by_accident(walk: Path, tmp_path: Path) -> None:
    target = tmp_path / "run"
    arguments = ("--size", "32x18", "--record", str(target))
    assert render(tmp_path / "x.png", *arguments).code == 0
    (tmp_path / "x.png").unlink()
    done = render(tmp_path / "x.png", *arguments)
    assert done.code == 2
    assert done.errors == [f"error: cannot record into '{target}': it holds a run already (--overwrite replaces it)"]
    assert not (tmp_path / "x.png").exists(), "said before anything is rendered"
    assert render(tmp_path / "x.png", *arguments, "--overwrite").code == 0


def test_a_folder_of_other_things_is_never_recorded_into(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years")
    done = render(tmp_path / "x.png", "--record", str(tmp_path), "--overwrite")
    assert done.code == 2
    assert "it is not empty, and what is in it is no recorded run" in done.errors[0]
    assert (tmp_path / "thesis.tex").read_text() == "years"


def test_overwrite_alone_is_refused(tmp_path: Path) -> None:
    done = render(tmp_path / "x.png", "--overwrite")
    assert (done.code, done.errors) == (2, ["error: --overwrite is for --record, which was not given"])


def test_without_pyarrow_the_extra_is_named_before_the_scene_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    done = cli_kit.phrt("render", "nowhere.yaml", "-o", str(tmp_path / "x.png"), "--record", str(tmp_path / "run"))
    assert done.code == 2
    assert "recordings need pyarrow" in done.errors[0]
    assert "pip install 'phrt[record]'" in done.errors[0]
    for command in (("explain", str(tmp_path)), ("render", SPHERES, "-o", "x.png", "--replay", str(tmp_path))):
        assert "pip install 'phrt[record]'" in cli_kit.phrt(*command).errors[0]


# --overlay


def test_the_overlay_tints_what_is_written(walk: Path, tmp_path: Path) -> None:
    arguments = (*OPTIONS, "--size", "320x180", "--frames", "2:4")
    assert render(tmp_path / "plain_%d.png", *arguments).code == 0
    assert render(tmp_path / "all_%d.png", *arguments, "--overlay").code == 0
    assert render(tmp_path / "one_%d.png", *arguments, "--overlay-effect", "reflections").code == 0
    plain, tinted, one = (pixels(tmp_path / f"{name}_3.png").astype(int) for name in ("plain", "all", "one"))
    floor = (slice(150, 160), slice(20, 40))
    assert tinted[floor][..., 0].mean() > tinted[floor][..., 1].mean() + 20, "the floor is skipped: red"
    np.testing.assert_array_equal(one[floor], plain[floor], "the floor has no reflections")
    assert not np.array_equal(one, plain)


def test_an_overlay_of_what_is_not_there_is_refused(tmp_path: Path) -> None:
    done = render(tmp_path / "x.png", "--size", "32x18", "--overlay-effect", "shadow")
    assert done.code == 2
    assert done.errors == [
        "error: overlay of 'shadow': allowed are all, shadows, reflections, refractions. Did you mean 'shadows'?"
    ]
    assert not (tmp_path / "x.png").exists()
    done = render(tmp_path / "x.exr", "--overlay")
    assert done.code == 2
    assert "--overlay tints what is seen" in done.errors[0]


# --replay


def test_a_replay_writes_the_same_pictures(walk: Path, tmp_path: Path) -> None:
    done = render(tmp_path / "again_%d.png", "--replay", str(walk / "run"), "--threads", "1")
    assert (done.code, done.warnings) == (0, []), done.said
    for number in (2, 3, 4):
        np.testing.assert_array_equal(pixels(tmp_path / f"again_{number}.png"), pixels(walk / f"f_{number}.png"))


def test_a_replay_of_one_picture_takes_the_first_or_the_one_asked_for(walk: Path, tmp_path: Path) -> None:
    for number, arguments in ((2, ()), (4, ("--frames", "4"))):
        assert render(tmp_path / "x.png", "--replay", str(walk / "run"), *arguments).code == 0
        np.testing.assert_array_equal(pixels(tmp_path / "x.png"), pixels(walk / f"f_{number}.png"))


def test_a_replay_may_be_seen_as_an_overlay_and_recorded(walk: Path, tmp_path: Path) -> None:
    arguments = ("--replay", str(walk / "run"), "--record", str(tmp_path / "run"), "--overlay")
    assert render(tmp_path / "x_%d.png", *arguments).code == 0
    first, again = read_run(walk / "run"), read_run(tmp_path / "run")
    for number in (2, 3, 4):
        np.testing.assert_array_equal(again.items(number)["traced_pixels"], first.items(number)["traced_pixels"])


def test_other_options_in_a_replay_are_told(walk: Path, tmp_path: Path) -> None:
    done = render(tmp_path / "x.png", "--replay", str(walk / "run"), "--effect", "shadows.samples=4")
    assert done.code == 0
    assert len(done.warnings) == 1
    assert "the pictures will not be those of" in done.warnings[0]
    assert "shadows.samples was 0 and is 4" in done.warnings[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("--heuristic", "random"),
            "--heuristic and --replay exclude each other: what is traced is as it was recorded",
        ),
        (("-H", "seed=3"), "-H and --replay exclude each other"),
        (("--budget", "50ms"), "--budget and --replay exclude each other"),
        (("--time", "1"), "--time and --replay exclude each other"),
        (("--size", "32x18"), "it was recorded at 64x36, not at 32x18"),
        (("--frames", "4:7"), "frames 5 to 6 were not recorded, only 2 to 4"),
        (("--effect", "shadows.enabled=false"), "with the effect 'shadows', which is not enabled here"),
    ],
)
def test_what_contradicts_a_replay_is_refused(
    walk: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    done = render(tmp_path / "x_%d.png", "--replay", str(walk / "run"), *arguments)
    assert done.code == 2
    assert message in done.errors[0]
    assert list(tmp_path.iterdir()) == []


def test_a_replay_is_not_recorded_over_itself(walk: Path, tmp_path: Path) -> None:
    run = str(walk / "run")
    done = render(tmp_path / "x.png", "--replay", run, "--record", run, "--overwrite")
    assert done.code == 2
    assert "the run would be overwritten while it is read" in done.errors[0]
    assert read_run(run).numbers.tolist() == [2, 3, 4]


def test_the_replay_of_nothing_is_refused(tmp_path: Path) -> None:
    done = render(tmp_path / "x.png", "--replay", str(tmp_path / "nowhere"))
    assert (done.code, len(done.errors)) == (2, 1)
    assert "is no recorded run: there is no such folder" in done.errors[0]


def test_another_scene_cannot_be_replayed(walk: Path, tmp_path: Path) -> None:
    scene = tmp_path / "other.yaml"
    scene.write_text("prims: {/Ball: {type: Sphere, radius: 0.5}}\n")
    done = cli_kit.phrt("render", str(scene), "-o", str(tmp_path / "x.png"), "--replay", str(walk / "run"))
    assert done.code == 2
    assert "it was recorded with the scene 'Spheres', whose object '/World/Floor' is not in 'other'" in done.errors[0]


# phrt explain


def test_explain_answers_in_a_sentence_and_a_table(walk: Path) -> None:
    done = cli_kit.phrt("explain", str(walk / "run"), "--frame", "3", "--object", "mirror")
    assert (done.code, done.said) == (0, "")
    sentences = [
        line for line in done.printed.splitlines() if line.startswith("reflections of /World/Spheres/Mirror were ")
    ]
    assert len(sentences) == 1
    assert " in frame 3: " in sentences[0]
    rows = {tuple(line.split()[:2]) for line in done.printed.splitlines()}
    letters = {"A": "area", "P": "center_closeness", "D": "distance", "V": "visibility", "Q": "ray_estimate"}
    letters |= {"C": "cost", "K": "importance_factor", "S": "was_selected", "I": "persistence", "R": "relevance"}
    assert set(letters.items()) <= rows
    assert "rank among " in done.printed


def test_explain_as_json_holds_the_same(walk: Path) -> None:
    arguments = ("--frame", "3", "--object", "glass", "--effect", "refractions", "--json")
    told = json.loads(cli_kit.phrt("explain", str(walk / "run"), *arguments).printed)
    (effect,) = told["effects"]
    items = read_run(walk / "run").items(3)
    row = next(
        i for i in range(len(items["object"]))
        if (items["object"][i], items["effect"][i]) == ("/World/Spheres/Glass", "refractions")
    )  # fmt: skip
    assert (told["frame"], told["object"], told["cut_short"]) == (3, "/World/Spheres/Glass", None)
    assert effect["sentence"].startswith("refractions of /World/Spheres/Glass were ")
    assert effect["item"]["relevance"]["value"] == pytest.approx(float(items["relevance"][row]))
    assert effect["item"]["relevance"]["rank"] == 1 + int((items["relevance"] > items["relevance"][row]).sum())
    assert effect["item"]["reason"] == items["reason"][row]


def test_explain_without_an_object_lists_the_frame_in_order(walk: Path) -> None:
    done = cli_kit.phrt("explain", str(walk / "run"), "--frame", "3", "--json")
    rows = json.loads(done.printed)["items"]
    asked = [row["order"] for row in rows if row["order"] >= 0]
    assert asked == sorted(asked) == list(range(len(asked)))
    rest = [row["relevance"] for row in rows if row["order"] < 0]
    assert rest == sorted(rest, reverse=True)
    assert asked
    assert rest
    table = cli_kit.phrt("explain", str(walk / "run"), "--frame", "3").printed
    assert table.startswith("frame 3: ")
    assert "by selection_graph, budget 3000rays, " in table
    assert table.index(rows[0]["object"]) < table.index(rows[-1]["object"])


def test_explain_without_a_frame_tells_how_often(walk: Path) -> None:
    run = str(walk / "run")
    lines = json.loads(cli_kit.phrt("explain", run, "--object", "floor", "--json").printed)
    assert lines["frames"] == [2, 3, 4]
    (line,) = lines["items"]
    assert (line["object"], line["effect"], line["frames"]) == ("/World/Floor", "shadows", 3)
    table = cli_kit.phrt("explain", run).printed
    assert "3 frames recorded: 2 to 4" in table
    assert table.count("reflections") >= 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--frame", "9"), "frame 9 is not in '.*run'; recorded: 2 to 4"),
        (("--frame", "3", "--object", "miror"), "has no object 'miror'. .* Did you mean 'mirror'"),
        (("--frame", "3", "--object", "mirror", "--effect", "shade"), "has no effect 'shade': "),
        (("--frame", "3", "--effect", "shade"), "has no effect 'shade': reflections, refractions, shadows"),
        (("--effect", "shadow"), "has no effect 'shadow': .* Did you mean 'shadows'"),
    ],
)
def test_explain_refuses_what_is_not_there(walk: Path, arguments: tuple[str, ...], message: str) -> None:
    import re

    done = cli_kit.phrt("explain", str(walk / "run"), *arguments)
    assert done.code == 2
    assert re.search(message, done.errors[0])


def test_explain_says_when_the_run_was_cut_short(walk: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(walk / "run", tmp_path / "run")
    about = json.loads((tmp_path / "run" / "run.json").read_text())
    (tmp_path / "run" / "run.json").write_text(json.dumps(about | {"state": "recording"}))
    done = cli_kit.phrt("explain", str(tmp_path / "run"), "--frame", "3")
    assert done.code == 0
    assert "its process was ended, after 3 frames" in done.warnings[0]
