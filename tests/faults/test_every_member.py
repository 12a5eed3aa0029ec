"""Every method and attribute of every kind of plugin fails: who did not ask is not disturbed, who asks is told, and a frame that is
begun comes out."""

from __future__ import annotations

import contextlib
import re
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from fault_kit import (
    BUILT_ANEW,
    FAULTS,
    NAME,
    NO_PICTURE,
    NO_RAYS,
    PACKAGE,
    SCENE,
    SIZE,
    Row,
    armed,
    members,
    own_producer,
    registered,
    renderer,
    step,
)
from scene_kit import psnr

from phrt import watchdog
from phrt.camera import CameraView
from phrt.errors import PhrtWarning, PluginError
from phrt.faults import PluginFailure
from phrt.faults.making import INTERFACES, make
from phrt.faults.tracer import path_traced
from phrt.frame import MASK_TRACED
from phrt.world import World

RUNNING = [row for row in FAULTS if row.kind in ("effect", "heuristic", "tracer", "gbuffer")]
FRAMES = (98, 99, 100, 101)


def rows(condition: Callable[[Row], bool]) -> Any:
    """Parametrizes a test with these rows."""
    return pytest.mark.parametrize("row", [row for row in RUNNING if condition(row)], ids=lambda row: row.id)


def at(moment: str) -> Any:
    return rows(lambda row: row.at == moment)


def begun(condition: Callable[[Row], bool]) -> Any:
    """Parametrizes a test with these rows, in frame 100; what raises also in the first frame."""
    chosen = [row for row in RUNNING if row.at == "frame" and condition(row)]
    cases = [(row, first) for row in chosen for first in (98, 100) if first == 100 or row.what == "raises"]
    return pytest.mark.parametrize(
        ("row", "first"), cases, ids=lambda value: value.id if isinstance(value, Row) else str(value)
    )


@pytest.fixture(autouse=True)
def short_patience(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(watchdog, "PATIENCE_S", 0.1)
    yield
    armed[0] = False


@pytest.fixture(scope="module")
def producer() -> Iterator[str]:
    with own_producer() as name:
        yield name


def using(row: Row, producer: str, **options: Any) -> Any:
    """A renderer that uses the plugin of `row`; eye rays do not go through a tracer under test."""
    if row.kind == "tracer" or row.member == "points":
        options = {"gbuffer": producer} | options if row.kind == "tracer" else options
    return renderer(row, **options)


def title(row: Row) -> str:
    """How the plugin is named: its kind, name, and package."""
    return re.escape(f"{row.kind} '{NAME}' of {PACKAGE}")


def failing(row: Row, producer: str, first: int, **options: Any) -> tuple[list[Any], list[str], Any]:
    """The FRAMES, of which those from number `first` on fail; the warnings, and the run's faults."""
    frames, options = [], {"strict": False} | options
    with registered(row), warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with using(row, producer, **options) as made:
            for number in FRAMES:
                armed[0] = number >= first
                frames.append(step(made, number))
            armed[0] = row.at == "close"
        return frames, [str(each.message) for each in told], made.run.faults


# The table


@pytest.mark.parametrize("kind", [*INTERFACES])
def test_every_member_of_every_interface_has_an_injected_fault(kind: str) -> None:
    assert {row.member for row in FAULTS if row.kind == kind} == members(kind)


def test_names_of_rows_are_unique() -> None:
    names = [row.id for row in FAULTS]
    assert len(names) == len(set(names))


# Nobody asked


def test_who_does_not_ask_for_them_sees_the_same_picture_and_hears_nothing() -> None:
    with renderer() as made:
        before = step(made, 98)
    for row in {row.kind: row for row in FAULTS}.values():
        with registered(row), renderer(strict=True) as made:
            armed[0] = True
            frame = step(made, 98)
        np.testing.assert_array_equal(frame.image, before.image)


# Asked for by name


@at("start")
@pytest.mark.parametrize("strict", [False, True], ids=["", "strict"])
def test_what_fails_at_the_start_is_an_error_with_package_and_cause(row: Row, strict: bool, producer: str) -> None:
    with registered(row):
        armed[0] = True
        with pytest.raises(PluginError, match=f"{title(row)}.*{row.says}"):
            using(row, producer, strict=strict)


@at("start")
def test_what_is_sound_starts(row: Row, producer: str) -> None:
    with registered(row), using(row, producer, strict=True) as made:
        assert np.isfinite(step(made, 0).image).all()


# In a running sequence


@begun(lambda row: row.done != NO_PICTURE)
def test_the_frame_comes_out_and_the_fault_is_told_once(row: Row, first: int, producer: str) -> None:
    frames, told, faults = failing(row, producer, first)
    assert len(told) == 1
    assert re.search(f"^{title(row)} .*{row.says}.*; {re.escape(row.done)}$", told[0]), told[0]
    assert all(np.isfinite(frame.image).all() for frame in frames)
    (fault,) = faults.log
    assert (fault.kind, fault.name, fault.package, fault.frame) == (row.kind, NAME, PACKAGE, first)
    assert str(fault) == told[0]
    assert [frame.faults for frame in frames] == [(fault,) if number == first else () for number in FRAMES]


@begun(lambda row: True)
def test_with_strict_it_is_an_error_with_the_cause(row: Row, first: int, producer: str) -> None:
    with registered(row), using(row, producer, strict=True) as made:
        for number in (number for number in FRAMES if number < first):
            step(made, number)
        armed[0] = True
        with pytest.raises(PluginFailure, match=f"^{title(row)} .*{row.says}") as raised:
            step(made, first)
        armed[0] = False
    cause = raised.value.__cause__
    if row.what == "raises":
        assert (type(cause), str(cause)) == (RuntimeError, "the cable came off")
    assert raised.value.fault == made.run.faults.log[0] or made.run.faults.log[0].frame == first


@rows(lambda row: row.at == "frame" and row.done == NO_PICTURE)
def test_without_a_picture_the_frame_is_an_error_and_the_next_one_may_come(row: Row, producer: str) -> None:
    with registered(row), renderer(row) as made:
        before = step(made, 99)
        armed[0] = True
        with pytest.raises(PluginFailure, match=f"^{title(row)} .*{row.says}"):
            step(made, 100)
        assert [(fault.kind, fault.frame) for fault in made.run.faults.log] == [("gbuffer", 100)]
        armed[0] = False
        np.testing.assert_array_equal(step(made, 99).image, before.image)


@pytest.mark.parametrize("kind", ["heuristic", "tracer"])
def test_frames_without_rays_are_those_of_raster_only(kind: str, producer: str) -> None:
    row = next(row for row in RUNNING if row.kind == kind and row.at == "frame" and row.what == "raises")
    if kind == "tracer":
        row = next(row for row in RUNNING if row.done == NO_RAYS)
    frames, _, _ = failing(row, producer, 100)
    with renderer(heuristic="raster_only", gbuffer=producer if kind == "tracer" else "raycast") as made:
        plain = [step(made, number) for number in FRAMES]
    assert psnr(frames[1].image, plain[1].image) < 40
    np.testing.assert_array_equal(frames[3].image, plain[3].image)


def test_an_effect_that_fails_leaves_the_others_as_they_were(producer: str) -> None:
    row = next(row for row in RUNNING if row.member == "trace" and row.what == "raises")
    frames, _, _ = failing(row, producer, 100)
    with renderer() as made:
        sound = [step(made, number) for number in FRAMES]
    for frame, other in zip(frames, sound, strict=True):
        np.testing.assert_array_equal(frame.image, other.image)
    assert np.all(frames[1].layers["faulty_layer"][frames[1].gbuffer.object_id > 0] == 2)
    assert np.all(frames[2].layers["faulty_layer"][frames[2].gbuffer.object_id > 0] == 7)


@rows(lambda row: row.done == BUILT_ANEW)
def test_who_is_built_anew_gives_the_same_pictures(row: Row, producer: str) -> None:
    frames, _, _ = failing(row, producer, 99)
    with renderer(row=None, gbuffer=producer) as made:
        sound = [step(made, number) for number in FRAMES]
    for frame, other in zip(frames, sound, strict=True):
        # A structure that was built is not the one that was refitted.
        np.testing.assert_allclose(frame.image, other.image, rtol=1e-4, atol=1e-5)


# Where the tracer is also the eye


@rows(lambda row: row.done == NO_RAYS)
def test_a_tracer_that_fails_shadow_rays_still_sees_and_one_that_fails_eye_rays_is_the_error(row: Row) -> None:
    with registered(row), renderer(row, gbuffer="raycast") as made:
        step(made, 99)
        armed[0] = True
        if row.member == "occluded":
            with pytest.warns(PhrtWarning, match=f"{title(row)} .*{row.says}.*; {re.escape(NO_RAYS)}") as told:
                frames = [step(made, number) for number in (100, 101)]
            assert len(told) == 1
            assert not any((mask == MASK_TRACED).any() for mask in frames[1].masks.values())
        else:
            with pytest.raises(PluginFailure, match=f"^{title(row)} .*{row.says}"):
                step(made, 100)
        armed[0] = False


def test_an_effect_that_hides_what_its_rays_failed_of_is_not_believed(producer: str) -> None:
    row = next(row for row in RUNNING if row.member == "closest_hit" and row.what == "raises")
    with registered(row), renderer(row, gbuffer=producer) as made:
        shadows = next(effect for effect in made.effects if effect.name == "shadows")
        trace = shadows.trace

        def hides(frame: Any, pixels: np.ndarray) -> Any:
            sound = trace(frame, pixels)
            with contextlib.suppress(PluginError):
                frame.tracer.closest_hit(None)
            return sound

        shadows.trace = hides  # type: ignore[method-assign]
        armed[0] = True
        with pytest.warns(PhrtWarning, match=f"{title(row)} failed in closest_hit"):
            frame = step(made, 100)
        armed[0] = False
        assert not any((mask == MASK_TRACED).any() for mask in frame.masks.values())


def test_a_restart_gives_a_tracer_another_chance(producer: str) -> None:
    row = next(row for row in RUNNING if row.done == NO_RAYS)
    with registered(row), renderer(row, gbuffer=producer) as made:
        sound = step(made, 99)
        armed[0] = True
        with pytest.warns(PhrtWarning, match=NO_RAYS):
            step(made, 100)
        armed[0] = False
        made.restart(heuristic="all_trace", history=False)
        np.testing.assert_array_equal(step(made, 99).image, sound.image)
        assert made.run.faults.log == []


# At the beginning of another run, and at the end


@at("restart")
def test_what_fails_when_a_run_begins_anew(row: Row, producer: str) -> None:
    with registered(row), renderer(row) as made:
        step(made, 99)
        armed[0] = True
        with pytest.warns(PhrtWarning, match=f"{title(row)} .*{row.says}.*; {re.escape(row.done)}") as told:
            made.restart(heuristic="raster_only", history=False)
        frame = step(made, 100)
        assert len(told) == 1
        assert not frame.layers["faulty_layer"].any()
        with pytest.raises(PluginFailure, match=row.says):
            made.restart(heuristic="raster_only", history=False, strict=True)
        armed[0] = False


@at("close")
def test_what_fails_when_it_is_closed_is_told_and_everything_else_is_closed(row: Row, producer: str) -> None:
    with registered(row), using(row, producer) as made:
        step(made, 0)
        armed[0] = True
        with pytest.warns(PhrtWarning, match=f"{title(row)} .*{row.says}; {re.escape(row.done)}") as told:
            made.close()
        assert len(told) == 1
        assert [fault.frame for fault in made.run.faults.log] == [None]
        with pytest.raises(RuntimeError, match="closed"):
            made.render()


@at("close")
def test_what_fails_at_the_end_does_not_hide_what_failed_before(row: Row, producer: str) -> None:
    with registered(row), pytest.raises(ZeroDivisionError), using(row, producer, strict=True):  # noqa: PT012
        armed[0] = True
        raise ZeroDivisionError
    with registered(row), pytest.raises(PluginFailure, match=row.says), using(row, producer, strict=True):
        armed[0] = True


def test_what_was_made_before_something_cannot_be_made_is_given_back(producer: str) -> None:
    row = next(row for row in FAULTS if row.kind == "gbuffer" and row.member == "build")
    closed: list[bool] = []
    with registered(row):
        import fault_kit

        made = fault_kit.current[NAME]
        made.close = lambda self: closed.append(True)
        armed[0] = True
        with pytest.raises(PluginError, match=row.says):
            renderer(row)
    assert closed == [True]


# Path tracing


@pytest.mark.parametrize("row", [row for row in FAULTS if row.at == "paths"], ids=lambda row: row.id)
def test_a_tracer_that_cannot_path_trace_after_all_is_named(row: Row) -> None:
    world = World(SCENE)
    view: CameraView = world.view(*SIZE)
    with registered(row):
        tracer = make("tracer", NAME)
        assert path_traced(tracer, world, view, samples=1, max_depth=2).shape == (SIZE[1], SIZE[0], 3)
        armed[0] = True
        with pytest.raises(PluginFailure, match=f"^{title(row)} .*{row.says}"):
            path_traced(tracer, world, view, samples=1, max_depth=2)
        tracer.close()
