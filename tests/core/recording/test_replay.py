"""Replay: the recorded decisions again, and with them the recorded picture, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_kit import SIZE, quietly, record, renderer_of, three_things
from scene_kit import LAMBERT, Stage, at, ball

import phrt
from phrt.errors import OptionError, PhrtWarning
from phrt.frame import MASK_HISTORY, REDUCED, FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Request
from phrt.recording import Replay, read_run, replay

FRAMES = 4


def traced(frame: FrameResult) -> dict[tuple[int, str], tuple[int, int]]:
    """Order and traced pixels by object and effect, of what was traced."""
    d, c = frame.decisions, frame.decisions.candidates
    rows = np.flatnonzero(d.chosen)
    rank = {int(row): place for place, row in enumerate(rows[np.argsort(d.order[rows])])}
    return {
        (int(c.object_id[row]), c.effect_names[c.effect[row]]): (rank[int(row)], int(d.traced_pixels[row]))
        for row in rows
    }


def assert_same(frames: list[FrameResult], again: list[FrameResult]) -> None:
    assert len(frames) == len(again)
    for was, now in zip(frames, again, strict=True):
        assert now.index == was.index
        assert now.time == was.time
        np.testing.assert_array_equal(now.image, was.image)
        for name, mask in was.masks.items():
            np.testing.assert_array_equal(now.masks[name], mask, err_msg=name)
        for name, layer in was.layers.items():
            np.testing.assert_array_equal(now.layers[name], layer, err_msg=name)
        assert traced(now) == traced(was)


CASES: dict[str, dict[str, Any]] = {
    "graph": {"heuristic": "selection_graph", "budget": "2500rays"},
    "time": {"heuristic": "selection_graph", "budget": "rays:1ms"},
    "uniform": {"heuristic": "uniform", "budget": "2000rays"},
    "random": {"heuristic": "random", "budget": "2000rays"},
    "everything": {"heuristic": "all_trace"},
    "nothing": {"heuristic": "raster_only"},
    "samples": {"heuristic": "random", "budget": "4000rays", "aa": 2},
    "objects": {"heuristic": "selection_graph", "budget": "2500rays", "group_by": "object"},
    "lights": {"heuristic": "random", "budget": "2500rays", "group_by": "object_effect_light"},
    "soft": {"heuristic": "random", "budget": "2500rays", "effects": {"shadows": {"samples": 3}}},
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("threads", [1, 3])
def test_the_recorded_picture_comes_again_bit_for_bit(tmp_path: Path, case: str, threads: int) -> None:
    frames = record(tmp_path / "run", FRAMES, **CASES[case])
    assert_same(frames, list(replay(tmp_path / "run", three_things(), threads=threads)))


def test_items_cut_at_any_pixel_come_again(tmp_path: Path) -> None:
    class Greedy(Heuristic):
        """Asks for everything, but for a strange number of pixels."""

        def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
            self._left = [Request(item, pixels=101 + 7 * item) for item in range(len(candidates))]

        def next(self, remaining: float) -> Request | None:
            return self._left.pop() if self._left else None

    frames = record(tmp_path / "run", 3, heuristic=Greedy(), size=(320, 180))
    assert {int(reason) for frame in frames for reason in frame.decisions.reason} == {REDUCED}
    assert {pixels % 4 for frame in frames for _, pixels in traced(frame).values()} > {0}
    assert_same(frames, list(replay(tmp_path / "run", three_things(), threads=1)))


def test_some_frames_alone(tmp_path: Path) -> None:
    frames = record(tmp_path / "run", FRAMES, heuristic="random", budget="2000rays")
    assert_same([frames[1], frames[3]], list(replay(tmp_path / "run", three_things(), [3, 1])))


def test_values_of_earlier_frames_come_again_also_for_some_frames_alone(tmp_path: Path) -> None:
    from phrt.camera import CameraView, look_at
    from phrt.recording import Recorder

    with (
        renderer_of(heuristic="random", budget="700rays") as renderer,
        Recorder(tmp_path / "run", renderer) as recorder,
    ):
        frames = []
        for number in range(6):
            view = CameraView(*SIZE, look_at((0.1 * number, 1.0, 4.0), (0, 0, 0)), (0.6, 0.35))
            frames.append(renderer.render(number / 30, camera=view))
            recorder.add(frames[-1])
    assert any((mask == MASK_HISTORY).any() for mask in frames[5].masks.values())
    assert_same(frames, list(replay(tmp_path / "run", three_things(), threads=1)))
    assert_same([frames[2], frames[5]], list(replay(tmp_path / "run", three_things(), [2, 5])))


def test_a_view_of_ones_own_is_recorded(tmp_path: Path) -> None:
    from phrt.camera import CameraView, look_at
    from phrt.recording import Recorder

    view = CameraView(*SIZE, look_at((1, 2, 3), (0, 0, 0)), (0.5, 0.3))
    with renderer_of(budget="2000rays") as renderer, Recorder(tmp_path / "run", renderer) as recorder:
        was = renderer.render(0.5, camera=view)
        recorder.add(was)
    assert_same([was], list(replay(tmp_path / "run", three_things())))


def test_the_same_decisions_under_other_options_are_told(tmp_path: Path) -> None:
    frames = record(tmp_path / "run", 2, heuristic="random", budget="2000rays")
    options = {"effects": {"shadows": {"samples": 5}}}
    with pytest.warns(PhrtWarning, match=r"pictures will not be those of '.*run': shadows.samples was 0 and is 5"):
        again = list(replay(tmp_path / "run", three_things(), **options))
    assert [traced(frame) for frame in again] == [traced(frame) for frame in frames]


def test_a_frame_that_sees_something_else_is_told_once(tmp_path: Path) -> None:
    record(tmp_path / "run", 3)
    scene = three_things()
    scene.nodes[scene.objects[2].node].matrix[0, 3] += 0.4
    message = (
        r"frame 0 does not see what was recorded: \w+ of '/World/.*' had \d+ pixels and has \d+; \d+ of 4 traced items"
    )
    with pytest.warns(PhrtWarning, match=message) as warned:
        list(replay(tmp_path / "run", scene))
    assert len(warned) == 1


def test_an_object_that_is_hidden_now_is_told_and_left_out(tmp_path: Path) -> None:
    record(tmp_path / "run", 1)
    scene = three_things()
    scene.nodes[scene.objects[2].node].matrix[2, 3] = 50.0
    with pytest.warns(PhrtWarning, match="does not see what was recorded"):
        (frame,) = replay(tmp_path / "run", scene)
    assert 3 not in {object_id for object_id, _ in traced(frame)}


def test_another_scene_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "run", 1)
    other = Stage().add("/World/Flor", ball(), LAMBERT, at()).light("point", at(0, 2, 0), intensity=1.0)
    scene = other.camera((0, 0, 4), (0, 0, 0)).scene
    with pytest.raises(
        OptionError, match=r"recorded with the scene 'test', whose object '/World/Floor' is not in 'test'.*"
    ):
        list(replay(tmp_path / "run", scene))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (32, 18)}, "it was recorded at 64x36, not at 32x18"),
        ({"aa": 4}, "it was recorded with aa 1, not 4"),
        (
            {"effects": {"shadows": {"enabled": False}}},
            "it was recorded with the effect 'shadows', which is not enabled here",
        ),
    ],
)
def test_what_cannot_be_replayed_is_refused(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    record(tmp_path / "run", 1)
    with pytest.raises(OptionError, match=f"'.*run' cannot be replayed: {message}"):
        list(replay(tmp_path / "run", three_things(), **options))


def test_a_budget_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "run", 1)
    decides = Replay(tmp_path / "run")
    with (
        renderer_of(heuristic=decides, budget="100rays") as renderer,
        pytest.raises(OptionError, match="within a budget of 100rays"),
    ):
        decides.check(renderer)


def test_frames_that_were_not_recorded_are_refused_before_anything_is_rendered(tmp_path: Path) -> None:
    record(tmp_path / "run", 3)
    with pytest.raises(OptionError, match="frame 7 was not recorded, only 0 to 2"):
        next(replay(tmp_path / "run", three_things(), [1, 7]))
    with pytest.raises(OptionError, match="frames 7 to 8 were not recorded, only 0 to 2"):
        next(replay(tmp_path / "run", three_things(), [1, 7, 8]))


def test_effects_that_were_off_are_off_again(tmp_path: Path) -> None:
    frames = record(tmp_path / "run", 2, effects={"shadows": {"enabled": False}})
    assert_same(frames, list(replay(tmp_path / "run", three_things())))


def test_a_run_that_was_cut_short_can_be_replayed(tmp_path: Path) -> None:
    from phrt.recording import Recorder

    with renderer_of(heuristic="random", budget="700rays") as renderer:
        recorder = Recorder(tmp_path / "run", renderer)
        frames = [renderer.render(number / 30) for number in range(2)]
        for frame in frames:
            recorder.add(frame)
        assert read_run(tmp_path / "run").cut_short
        assert_same(frames, list(replay(tmp_path / "run", three_things())))
        recorder.close()


def test_a_replay_can_be_recorded_and_holds_the_same_decisions(tmp_path: Path) -> None:
    from phrt.recording import Recorder

    record(tmp_path / "run", 2, heuristic="random", budget="2000rays")
    decides = Replay(tmp_path / "run")
    with renderer_of(heuristic=decides) as renderer, Recorder(tmp_path / "again", renderer) as recorder:
        for number in range(2):
            recorder.add(renderer.render(number / 30))
    first, again = read_run(tmp_path / "run"), read_run(tmp_path / "again")
    for number in range(2):
        np.testing.assert_array_equal(again.items(number)["traced_pixels"], first.items(number)["traced_pixels"])
    assert again.config["heuristic"]["class"] == "phrt.recording.replay:Replay"


def test_an_unrecorded_frame_traces_nothing_and_says_so(tmp_path: Path) -> None:
    record(tmp_path / "run", 1)
    with phrt.Renderer(three_things(), size=SIZE, gbuffer="raycast", heuristic=Replay(tmp_path / "run")) as renderer:
        frame = quietly(renderer.render, 0.0, frame_index=9)
    assert not frame.decisions.chosen.any()
