"""Why an item was traced or not: the sentence for every reason, and where an object is not there at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_kit import decided, record, renderer_of, row_of, three_things

from phrt.errors import OptionError, PhrtWarning
from phrt.faults import Fault
from phrt.frame import REASONS, FrameResult
from phrt.interfaces.heuristic import Heuristic
from phrt.recording import Recorder, Run, read_run
from phrt.recording.reasons import amount, explain_object, find_object, over_time, rank, subject

MIRROR, GLASS, FLOOR = "/World/Balls/Mirror", "/World/Balls/Glass", "/World/Floor"
MS = {"budget": 20.0, "budget_unit": "ms", "left": 2.3}


class Chooser(Heuristic):
    """Stands for any heuristic; its name is in the sentences."""

    def begin_frame(self, candidates: Any, context: Any) -> None:
        return

    def next(self, remaining: float) -> None:
        return None


@pytest.fixture(scope="module")
def frame() -> FrameResult:
    with renderer_of(heuristic=Chooser()) as renderer:
        return replace(renderer.render(), index=42)


def run_of(folder: Path, *frames: FrameResult, scene: Any = None) -> Run:
    """A recorded run of these frames."""
    with renderer_of(scene, heuristic=Chooser()) as renderer, Recorder(folder, renderer) as recorder:
        for each in frames:
            recorder.add(each)
    return read_run(folder)


def why(folder: Path, frame: FrameResult, rows: dict[tuple[str, str], dict[str, Any]], **scalars: Any) -> str:
    """The sentence about the first of `rows`, when these were asked for."""
    made = decided(frame, {row_of(frame, *key): values for key, values in rows.items()}, **(MS | scalars))
    path, effect = next(iter(rows))
    (found,) = explain_object(run_of(folder, made), 42, path, effect)
    return found.sentence


def traced(order: int, **values: Any) -> dict[str, Any]:
    """A whole item."""
    taken = {"rays": 4000, "milliseconds": 4.9, "predicted_cost": 5.1, "relevance": 0.5}
    whole = {
        "chosen": True,
        "reason": "selected",
        "order": order,
        "passes": 4,
        "pixel_count": 200,
        "traced_pixels": 200,
    }
    return whole | taken | values


def test_selected(tmp_path: Path, frame: FrameResult) -> None:
    rows = {(GLASS, "reflections"): traced(1), (MIRROR, "reflections"): traced(0, relevance=0.9)}
    assert why(tmp_path / "run", frame, rows) == (
        f"reflections of {GLASS} were traced whole in frame 42: number 2 of 2 that Chooser asked for, with relevance "
        "number 2 of 4; predicted 5.1 ms, took 4.9 ms and 4,000 rays."
    )


def test_mandatory(tmp_path: Path, frame: FrameResult) -> None:
    rows = {(MIRROR, "reflections"): traced(0, mandatory=True)}
    assert "the item is mandatory (effects: always), number 1 of 1 that Chooser asked for" in why(
        tmp_path / "run", frame, rows
    )


def test_reduced(tmp_path: Path, frame: FrameResult) -> None:
    rows = {(MIRROR, "reflections"): traced(0, reason="reduced", passes=1, traced_pixels=50)}
    sentence = why(tmp_path / "run", frame, rows)
    assert "were traced at 25 % of the pixels in frame 42: Chooser asked for no more; number 1 of 1" in sentence


def test_cut(tmp_path: Path, frame: FrameResult) -> None:
    rows = {(MIRROR, "reflections"): traced(0, reason="cut", passes=2, traced_pixels=74)}
    assert "were cut after 37 % in frame 42 because time ran out: number 1 of 1" in why(tmp_path / "a", frame, rows)
    sentence = why(tmp_path / "b", frame, rows, budget=9000.0, budget_unit="rays")
    assert "because the rays were used up" in sentence


def test_no_fit(tmp_path: Path, frame: FrameResult) -> None:
    rows = {
        (FLOOR, "shadows"): {"reason": "no_fit", "order": 2, "predicted_cost": 12.0, "relevance": 0.7},
        (MIRROR, "reflections"): traced(0, relevance=0.9),
        (GLASS, "reflections"): traced(1),
        (GLASS, "refractions"): traced(3, relevance=0.8),
    }
    assert why(tmp_path / "run", frame, rows) == (
        f"shadows of {FLOOR} were not traced in frame 42: the item asked for 12.0 ms and about 10.2 ms were left; "
        "2 items came first, 1 of them with higher relevance."
    )


def test_no_time(tmp_path: Path, frame: FrameResult) -> None:
    rows = {
        (FLOOR, "shadows"): {"reason": "no_time", "order": 1},
        (MIRROR, "reflections"): traced(0, relevance=0.9),
    }
    assert (
        "the item was asked for as number 2, but time ran out before its turn; 1 item came first, 1 of them with higher"
        in why(tmp_path / "run", frame, rows)
    )


def test_effect_off_tells_the_error(tmp_path: Path, frame: FrameResult) -> None:
    made = decided(frame, {row_of(frame, FLOOR, "shadows"): {"reason": "effect_off"}}, **MS)
    fault = Fault(
        "effect", "shadows", "built-in", "failed in trace(): RuntimeError: the cable came off", "it is off", 40
    )
    with renderer_of(heuristic=Chooser()) as renderer, Recorder(tmp_path / "run", renderer) as recorder:
        renderer.run.faults.log.append(fault)
        recorder.add(made)
    (found,) = explain_object(read_run(tmp_path / "run"), 42, FLOOR, "shadows")
    assert found.sentence == (
        f"shadows of {FLOOR} were not traced in frame 42: the effect was switched off after an error in frame 40 ({fault})."
    )


def test_a_heuristic_that_was_switched_off_is_the_reason_from_then_on(tmp_path: Path) -> None:
    class Breaks(Chooser):
        def begin_frame(self, candidates: Any, context: Any) -> None:
            if context.frame_index == 1:
                raise ValueError("no idea")

    def break_it() -> None:
        with renderer_of(heuristic=Breaks()) as renderer, Recorder(tmp_path / "run", renderer) as recorder:
            for _ in range(3):
                recorder.add(renderer.render())

    with pytest.warns(PhrtWarning, match="no idea; it is switched off"):
        break_it()
    run = read_run(tmp_path / "run")
    sentences = [explain_object(run, number, FLOOR, "shadows")[0].sentence for number in range(3)]
    assert sentences[0].endswith("Breaks asked for nothing in this frame.")
    for sentence in sentences[1:]:
        assert (
            "the heuristic was switched off after an error in frame 1 (heuristic Breaks failed in begin_frame()"
            in sentence
        )
        assert "ValueError: no idea" in sentence


def test_not_asked_behind_the_budget(tmp_path: Path, frame: FrameResult) -> None:
    rows = {
        (FLOOR, "shadows"): {"reason": "not_asked", "predicted_cost": 5.1, "relevance": 0.7},
        (MIRROR, "reflections"): traced(0, relevance=0.9),
    }
    assert why(tmp_path / "run", frame, rows) == (
        f"shadows of {FLOOR} were not traced in frame 42: the item is behind the budget: it is predicted to take 5.1 ms, of "
        "20.0 ms 2.3 ms were left in the end, and Chooser did not ask for it; 1 item came first, 1 of them with higher relevance."
    )


def test_not_asked_although_it_would_have_fitted(tmp_path: Path, frame: FrameResult) -> None:
    rows = {
        (FLOOR, "shadows"): {"reason": "not_asked", "predicted_cost": 1.1},
        (MIRROR, "reflections"): traced(0),
    }
    sentence = why(tmp_path / "run", frame, rows)
    assert (
        "Chooser did not ask for the item, although 1.1 ms would have fitted into the 2.3 ms that were left" in sentence
    )


def test_not_asked_without_a_budget(tmp_path: Path, frame: FrameResult) -> None:
    rows = {(FLOOR, "shadows"): {"reason": "not_asked"}, (MIRROR, "reflections"): traced(0)}
    sentence = why(tmp_path / "run", frame, rows, budget=np.inf, budget_unit="none", left=np.inf)
    assert sentence.endswith("Chooser did not ask for the item; there was no budget to keep.")


def test_nothing_was_asked_for(tmp_path: Path, frame: FrameResult) -> None:
    rows: dict[tuple[str, str], dict[str, Any]] = {(FLOOR, "shadows"): {"reason": "not_asked"}}
    assert why(tmp_path / "run", frame, rows).endswith("in frame 42: Chooser asked for nothing in this frame.")


def test_nothing_was_left_for_rays(tmp_path: Path, frame: FrameResult) -> None:
    rows: dict[tuple[str, str], dict[str, Any]] = {(FLOOR, "shadows"): {"reason": "not_asked"}}
    sentence = why(tmp_path / "run", frame, rows, budget=0.0, left=0.0)
    assert "nothing of the budget of none was left for rays." in sentence


def test_what_stands_in_is_said(tmp_path: Path, frame: FrameResult) -> None:
    rows: dict[tuple[str, str], dict[str, Any]] = {
        (FLOOR, "shadows"): {"reason": "not_asked", "history_share": 0.87, "history_age": 3.25}
    }
    assert why(tmp_path / "run", frame, rows).endswith(
        "Values of earlier frames, 3.2 frames old on average, stood in at 87 % of the pixels."
    )


def test_every_reason_has_its_own_sentence(tmp_path: Path, frame: FrameResult) -> None:
    sentences = set()
    for number, reason in enumerate(REASONS):
        given = {"reason": reason, "order": -1 if reason == "not_asked" else 1}
        rows = {(FLOOR, "shadows"): given, (MIRROR, "reflections"): traced(0)}
        sentences.add(why(tmp_path / str(number), frame, rows))
    assert len(sentences) == len(REASONS)


@pytest.mark.parametrize(("group_by", "effects"), [("object", ["all"]), ("object_effect_light", ["shadows@/light0"])])
def test_other_work_items_are_found_by_their_effect(tmp_path: Path, group_by: Any, effects: list[str]) -> None:
    record(tmp_path / "run", 2, heuristic="all_trace", group_by=group_by)
    run = read_run(tmp_path / "run")
    found = explain_object(run, 1, FLOOR, "shadows")
    assert [each.effect for each in found] == effects
    assert found[0].sentence.startswith(f"{subject(effects[0], FLOOR)} traced whole in frame 1: number ")
    assert [line.effect for line in over_time(run, FLOOR, "shadows")] == effects


def test_words_of_items() -> None:
    assert subject("shadows@/Lights/Key", FLOOR) == f"shadows of {FLOOR} by the light /Lights/Key were"
    assert subject("ambient_occlusion", FLOOR) == f"ambient occlusion of {FLOOR} was"
    assert subject("all", FLOOR) == f"all effects of {FLOOR} were"


# What is not there


def test_an_object_that_is_not_visible(tmp_path: Path, frame: FrameResult) -> None:
    candidates = frame.decisions.candidates
    made = decided(frame, {}, **MS)
    floor_alone = candidates.object_id == 1
    kept = {
        name: getattr(made.decisions, name)[floor_alone]
        for name in ("chosen", "reason", "order", "passes", "traced_pixels", "rays", "milliseconds")
    }
    letters = {n: v[floor_alone] for n, v in vars(made.decisions.candidates).items() if isinstance(v, np.ndarray)}
    decisions = replace(made.decisions, candidates=replace(made.decisions.candidates, **letters), **kept)
    run = run_of(tmp_path / "run", replace(made, decisions=decisions, samples=(decisions,)))
    found = explain_object(run, 42, MIRROR, "reflections")
    assert [each.sentence for each in found] == [
        f"reflections of {MIRROR} were not traced in frame 42: the object is not visible in this frame."
    ]
    assert found[0].item is None


def test_an_effect_that_changes_nothing_on_the_material(tmp_path: Path, frame: FrameResult) -> None:
    (found,) = explain_object(run_of(tmp_path / "run", frame), 42, MIRROR, "refractions")
    assert found.sentence.endswith("in frame 42: the effect changes nothing on the object's materials.")


def test_an_effect_that_the_scene_forbids(tmp_path: Path) -> None:
    scene = three_things(effects={"reflections": "never"})
    with renderer_of(scene, heuristic=Chooser()) as renderer:
        made = replace(renderer.render(), index=42)
    (found,) = explain_object(run_of(tmp_path / "run", made, scene=scene), 42, MIRROR, "reflections")
    assert found.sentence.endswith("in frame 42: the scene forbids it (effects: reflections: never).")


def test_without_an_effect_all_are_explained(tmp_path: Path, frame: FrameResult) -> None:
    found = explain_object(run_of(tmp_path / "run", frame), 42, GLASS)
    assert [each.effect for each in found][:2] == ["reflections", "refractions"]
    assert {each.effect for each in found} == {"shadows", "reflections", "refractions"}


# Finding things


def test_an_object_is_found_by_the_end_of_its_path(tmp_path: Path, frame: FrameResult) -> None:
    run = run_of(tmp_path / "run", frame)
    for given in ("mirror", "Balls/Mirror", "/balls/mirror", MIRROR):
        assert find_object(run, given) == MIRROR


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("miror", "has no object 'miror'. It has .*Did you mean 'mirror'"),
        ("/World/Balls/Miror", f"Did you mean '{MIRROR}'"),
        ("irror", "has no object 'irror'"),
        ("", "has no object ''"),
    ],
)
def test_an_unknown_object_is_answered_with_what_is_near(
    tmp_path: Path, frame: FrameResult, given: str, message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        find_object(run_of(tmp_path / "run", frame), given)


def test_an_end_that_fits_several_is_ambiguous(tmp_path: Path, frame: FrameResult) -> None:
    run = run_of(tmp_path / "run", frame)
    run.about["config"]["scene"]["objects"].append({"path": "/Attic/Mirror"})
    with pytest.raises(OptionError, match=f"'mirror' is ambiguous: {MIRROR}, /Attic/Mirror"):
        find_object(run, "mirror")


def test_unknown_effects_and_frames_are_refused_with_what_there_is(tmp_path: Path, frame: FrameResult) -> None:
    run = run_of(tmp_path / "run", frame, replace(frame, index=43), replace(frame, index=50))
    with pytest.raises(OptionError, match=r"has no effect 'shadow': .*Did you mean 'shadows'"):
        explain_object(run, 42, MIRROR, "shadow")
    with pytest.raises(OptionError, match=r"frame 44 is not in '.*'; recorded: 42 to 43, 50"):
        explain_object(run, 44, MIRROR)


def test_an_item_over_time(tmp_path: Path, frame: FrameResult) -> None:
    row = row_of(frame, MIRROR, "reflections")
    never, whole = decided(frame, {}), decided(frame, {row: traced(0)})
    part = decided(frame, {row: traced(0, traced_pixels=50)})
    frames = [replace(each, index=n) for n, each in enumerate([never, whole, part, never, whole])]
    (line,) = over_time(run_of(tmp_path / "run", *frames), MIRROR)
    assert (line.effect, line.frames, line.traced, line.whole) == ("reflections", 5, 3, 2)
    assert (line.first, line.last, line.runs) == (1, 4, "1 to 2, 4")
    run = read_run(tmp_path / "run")
    assert {each.object for each in over_time(run)} == {MIRROR, GLASS, FLOOR}
    assert [(each.object, each.effect) for each in over_time(run, effect="refractions")] == [(GLASS, "refractions")]
    assert over_time(run, FLOOR, "refractions") == []


def test_amounts_and_ranks() -> None:
    assert [amount(5.14, "ms"), amount(0.031, "ms"), amount(12345.0, "rays")] == ["5.1 ms", "0.031 ms", "12,345 rays"]
    values = np.array([1.0, 3.0, np.nan, 3.0])
    assert [rank(values, item) for item in range(4)] == [3, 1, None, 1]
    assert rank(np.zeros(3), 1) is None
