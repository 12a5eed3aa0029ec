"""Loaders and metrics that fail: an error that names package, file and cause; a metric's columns are left out, and told once."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fault_kit import FAULTS, NAME, PACKAGE, Row, armed, registered
from metric_kit import run_of, waves

import phrt
from phrt.errors import AssetError, PhrtWarning, PluginError, SceneError
from phrt.faults import PluginFailure
from phrt.testing.metrics import shot_of as shot
from phrt_plugins.metrics.measure import make_metrics, measure_run, measure_shots

LOADERS = [row for row in FAULTS if row.kind == "loader"]
METRICS = [row for row in FAULTS if row.kind == "metric"]


def by_id(rows: list[Row]) -> Any:
    return pytest.mark.parametrize("row", rows, ids=lambda row: row.id)


# Loaders


@by_id(LOADERS)
def test_a_loader_that_fails_is_named_with_the_file_and_the_cause(row: Row, tmp_path: Path) -> None:
    model = tmp_path / "thing.faulty"
    model.write_bytes(b"anything")
    described = tmp_path / "scene.yaml"
    described.write_text("phrt: 1\nprims:\n  Thing: {type: Reference, asset: thing.faulty}\n", encoding="utf-8")
    with registered(row):
        assert phrt.load_scene(model).triangle_count == 2
        armed[0] = True
        for file in (model, described):
            with pytest.raises(SceneError) as raised:
                phrt.load_scene(file)
            said = str(raised.value)
            assert f"{model}: loader '{NAME}' of {PACKAGE} " in said
            assert re.search(row.says, said), said
            assert str(file) in said


def test_what_a_loader_says_on_purpose_is_said_as_it_is(tmp_path: Path) -> None:
    def refuses(sound: Any) -> Any:
        raise AssetError("thing.faulty: line 3: expected a number")

    model = tmp_path / "thing.faulty"
    model.write_bytes(b"anything")
    with registered(Row("loader", "load", "refuses", refuses, "", "load")):
        armed[0] = True
        with pytest.raises(AssetError, match=r"^thing.faulty: line 3: expected a number$"):
            phrt.load_scene(model)


def test_a_loader_within_another_one_is_the_one_that_is_named(tmp_path: Path) -> None:
    row = next(row for row in LOADERS if row.what == "raises")
    model = tmp_path / "thing.faulty"
    model.write_bytes(b"anything")
    described = tmp_path / "scene.yaml"
    thing = "{type: Reference, loader: simplified, asset: thing.faulty, options: {share: 0.5}}"
    described.write_text(f"phrt: 1\nprims:\n  Thing: {thing}\n", encoding="utf-8")
    with registered(row):
        armed[0] = True
        with pytest.raises(SceneError, match=f"loader '{NAME}' of {PACKAGE} failed in load"):
            phrt.load_scene(described)


# Metrics


@by_id([row for row in METRICS if row.at == "start"])
def test_a_metric_that_cannot_be_made_is_an_error_for_who_asks_and_a_warning_for_others(row: Row) -> None:
    with registered(row):
        assert [column.name for column in make_metrics([NAME])[0].columns] == ["faulty_shot", "faulty_run"]
        armed[0] = True
        named = ["flip", NAME]
        with pytest.raises(PluginError, match=f"metric '{NAME}'.*{row.says}|{row.says}.*metric '{NAME}'"):
            make_metrics(named)
        with pytest.warns(PhrtWarning, match=f"metric '{NAME}' is left out: .*{row.says}") as told:
            made = make_metrics()
        assert len(told) == 1
        assert NAME not in {metric.name for metric in made}
        assert "flip" in {metric.name for metric in made}
        with pytest.raises(PluginError, match=row.says):
            make_metrics(strict=True)


@by_id([row for row in METRICS if row.at == "measure"])
def test_a_metric_that_fails_leaves_its_columns_out_and_says_so_once(row: Row) -> None:
    shots = [shot(waves(), waves(), index=index) for index in (98, 99, 100)]
    with registered(row):
        metrics = make_metrics(["error", NAME])
        armed[0] = True
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            of_shots = measure_shots(metrics, shots)
            of_run = measure_run(metrics, run_of(range(3)))
        assert len(told) == 1
        assert re.search(f"^metric '{NAME}' of {PACKAGE} failed .*is left out.*{row.says}", str(told[0].message))
        failed, sound = ("faulty_shot", "faulty_run") if row.member == "of_shot" else ("faulty_run", "faulty_shot")
        values = of_shots | of_run
        assert np.isnan(values[failed]).all()
        assert np.all(np.asarray(values[sound]) == 1)
        assert np.isfinite(values["display_error"]).all()
        with pytest.raises(PluginFailure, match=f"^metric '{NAME}' of {PACKAGE} failed in {row.member}.*{row.says}"):
            (measure_shots(metrics, shots, strict=True), measure_run(metrics, run_of(range(3)), strict=True))
        armed[0] = False
        assert math.isfinite(measure_run(metrics, run_of(range(3)))["faulty_run"])


def test_columns_that_fail_later_name_the_metric() -> None:
    row = next(row for row in METRICS if row.member == "columns" and row.what == "raises")
    with registered(row):
        metrics = make_metrics([NAME])
        armed[0] = True
        with pytest.raises(PluginFailure, match=f"^metric '{NAME}' of {PACKAGE} {row.says}"):
            measure_shots(metrics, [])
