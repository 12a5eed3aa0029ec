"""The kit finds what a metric does wrong. Each broken one is a sound one with one thing changed."""

from __future__ import annotations

from typing import Any

import needs
import numpy as np
import pytest

from phrt.interfaces.metric import Column, Metric, RunFrames, Shot
from phrt.registry import Options
from phrt.testing import check_metric

OFF = Column("off", "mean difference of the displays", "", "lower")
SPENT = Column("spent", "mean time of a frame", "ms", "lower", scope="run")


class Sound(Metric):
    columns: tuple[Any, ...] = (OFF, SPENT)

    def __init__(self, options: Options) -> None:
        self.seen = 0

    def of_shot(self, shot: Shot) -> dict[str, Any]:
        return {"off": float(np.abs(shot.display.astype(float) - shot.reference_display).mean())}

    def of_run(self, frames: RunFrames) -> dict[str, Any]:
        return {"spent": float(np.mean(frames.columns["clock_ms"]))}


class NoColumns(Sound):
    columns = ()


class OddlyNamed(Sound):
    columns = (Column("Mean off!", "odd", "", "lower"), SPENT)


class TheSameTwice(Sound):
    columns = (OFF, OFF, SPENT)


class NoSuchStatistic(Sound):
    columns = (Column("off", "odd", "", "lower", "median"), SPENT)  # type: ignore[arg-type]


class JustTexts(Sound):
    columns = ("off", "spent")


class AnotherColumn(Sound):
    def of_shot(self, shot: Shot) -> dict[str, Any]:
        return super().of_shot(shot) | {"of": 1.0}


class ColumnsOfRunsInShots(Sound):
    def of_shot(self, shot: Shot) -> dict[str, Any]:
        return super().of_shot(shot) | {"spent": 1.0}


class JustANumber(Sound):
    def of_shot(self, shot: Shot) -> dict[str, Any]:
        return super().of_shot(shot)["off"]  # type: ignore[no-any-return]


class AnArray(Sound):
    def of_run(self, frames: RunFrames) -> dict[str, Any]:
        return {"spent": np.asarray(frames.columns["clock_ms"])}


class InfiniteWhenEqual(Sound):
    columns = (Column("off", "as PSNR", "dB", "higher"), SPENT)

    def of_shot(self, shot: Shot) -> dict[str, Any]:
        off = super().of_shot(shot)["off"]
        return {"off": float("inf") if off == 0 else 20 * np.log10(255 / off)}


class UndefinedWhenEqual(Sound):
    def of_shot(self, shot: Shot) -> dict[str, Any]:
        off = super().of_shot(shot)["off"]
        return {"off": off if off else float("nan")}


class TheWrongWayRound(Sound):
    columns = (Column("off", "said to be better when higher", "", "higher"), SPENT)


class BlackensThePicture(Sound):
    def of_shot(self, shot: Shot) -> dict[str, Any]:
        shot.image[:] = 0
        return super().of_shot(shot)


class CountsItsCalls(Sound):
    def of_shot(self, shot: Shot) -> dict[str, Any]:
        self.seen += 1
        return {"off": super().of_shot(shot)["off"] * (1 + self.seen)}


class CannotBePickled(Sound):
    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.measure = lambda shot: 0.0


class NeedsAChangeablePixel(Sound):
    def of_shot(self, shot: Shot) -> dict[str, Any]:
        return {"off": float(shot.display[shot.changeable].min()) * 0}


class NeedsTwoFrames(Sound):
    def of_run(self, frames: RunFrames) -> dict[str, Any]:
        return {"spent": float(np.diff(frames.columns["clock_ms"]).max())}


BROKEN: list[tuple[Any, str]] = [
    (NoColumns, "it has at least one column"),
    (
        OddlyNamed,
        "columns are named in lower case with underscores, and not frame, oracle_share, parts_share, relevance_share",
    ),
    (TheSameTwice, "no two columns have one name: off, off, spent"),
    (NoSuchStatistic, "`statistic` is one of mean, .*, not 'median'"),
    (JustTexts, "columns are Column objects, not 'off'"),
    (AnotherColumn, "of_shot returns columns of scope 'shot' only, not of"),
    (ColumnsOfRunsInShots, "of_shot returns columns of scope 'shot' only, not spent"),
    (JustANumber, "of_shot returns a mapping by column, not [0-9.]+"),
    (AnArray, "column 'spent' is a number, not array"),
    (InfiniteWhenEqual, "column 'off' of a picture that equals its reference is inf"),
    (UndefinedWhenEqual, "column 'off' of a picture that equals its reference is nan"),
    (TheWrongWayRound, "column 'off' of a picture that equals its reference, 0, is not worse than"),
    (BlackensThePicture, "of_shot does not change what it is given"),
    (CountsItsCalls, "of_shot keeps nothing from one call to the next: called again"),
    (CannotBePickled, "pickling it raised"),
    (NeedsAChangeablePixel, "of_shot raised ValueError: zero-size array.*no pixel changeable"),
    (NeedsTwoFrames, "of_run raised ValueError: zero-size array.*one frame"),
]


def test_the_sound_one_passes() -> None:
    check_metric(Sound)


@pytest.mark.parametrize(("broken", "says"), BROKEN, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_metric_is_found(broken: type[Metric], says: str) -> None:
    needs.package("pyarrow")
    with pytest.raises(AssertionError, match=f"metric {broken.__name__} breaks its contract: .*({says})"):
        check_metric(broken)


def test_a_column_by_which_a_picture_may_beat_its_reference_is_named() -> None:
    check_metric(TheWrongWayRound, beyond=("off",))
