"""References that are path traced: by a tracer that makes its pictures up, so that nothing has to be installed for these tests."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_kit import phrt
from run_bench_kit import bench, cells, results, table, write_config

from phrt.errors import OptionError, PluginError
from phrt.output.tonemap import to_8bit
from phrt_plugins.bench import estimate as estimate_module
from phrt_plugins.bench import paths as paths_module
from phrt_plugins.bench import run as run_module
from phrt_plugins.bench.checks import checked_plan
from phrt_plugins.bench.estimate import Cost, Estimate
from phrt_plugins.bench.inline import InlineExecutor
from phrt_plugins.bench.leaderboard import leaderboard, verdict
from phrt_plugins.bench.plan import Setup
from phrt_plugins.bench.reading import read_config
from phrt_plugins.bench.references import References, reference_key
from phrt_plugins.bench.results import BenchRun
from phrt_plugins.bench.scenes import open_renderer
from phrt_plugins.bench.summary import read_summary

TRACERS = Path(__file__).resolve().parents[2] / "made_up_tracers.py"
REFERENCE = {"tracer": "made_up", "samples": 32, "max_depth": 5}


@pytest.fixture(scope="module", autouse=True)
def here() -> Iterator[None]:
    """Tasks run in this process, and the made-up tracers are gone afterwards."""
    from phrt.registry import get_registry

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_module, "make_executor", lambda *arguments, **options: InlineExecutor())
        yield
    get_registry()._forget(str(TRACERS))


def write(folder: Path, reference: Any = REFERENCE, **changes: Any) -> Path:
    """A config with a path-traced reference by a made-up tracer; the config's path."""
    given = {} if reference is None else {"reference": reference}
    return write_config(folder, plugins=[str(TRACERS)], **given, **changes)


def setup_of(folder: Path, reference: Any = REFERENCE, **changes: Any) -> Setup:
    return checked_plan(read_config(write(folder, reference, **changes))).setups[0]


# The config


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "reference: nobody",
            "config.yaml:4: reference: given 'nobody'; allowed: all_trace, or {tracer: NAME} for path tracing",
        ),
        ("reference: {tracer: plain}", "config.yaml:4: reference.tracer: tracer 'plain' cannot path trace."),
        (
            "reference: {tracer: embree}",
            "config.yaml:4: reference.tracer: tracer 'embree' cannot path trace. The package phrt-mitsuba",
        ),
        ("reference: {tracer: mitsub}", "config.yaml:4: reference.tracer: there is no tracer 'mitsub'. Known: "),
        (
            "reference: {tracer: elsewhere}",
            "config.yaml:4: reference.tracer: tracer 'elsewhere' is not available here: no such card",
        ),
        (
            "reference: {tracer: made_up, samples: 0}",
            "config.yaml:4: reference.samples: given 0; input should be greater",
        ),
        (
            "reference: {tracer: made_up, depth: 3}",
            "config.yaml:4: unknown key 'depth' in 'reference'; allowed: tracer, samples",
        ),
        ("reference: {samples: 3}", "the key 'reference.tracer' is missing"),
    ],
)
def test_a_wrong_reference_is_named_before_anything_runs(tmp_path: Path, line: str, said: str) -> None:
    write(tmp_path)
    path = tmp_path / "config.yaml"
    path.write_text(f"name: least\nscenes: [balls.yaml]\nheuristics: [gain]\n{line}\nplugins: [{TRACERS}]\n")
    with pytest.raises(OptionError) as told:
        checked_plan(read_config(path))
    assert said in str(told.value)


def test_all_trace_is_the_default_and_changes_nothing(tmp_path: Path) -> None:
    plain, said = setup_of(tmp_path, None), setup_of(tmp_path, "all_trace")
    assert plain == said
    assert plain.reference is None
    assert read_config(write(tmp_path, None)).config.model_dump(mode="json")["reference"] == "all_trace"
    other = setup_of(tmp_path)
    assert other.id != plain.id
    assert other.id[:-6] == plain.id[:-6]


def test_ids_do_not_hang_on_the_version_and_keys_do(tmp_path: Path) -> None:
    setup = setup_of(tmp_path)
    block = setup.blocks()[0]
    assert setup.reference is not None
    assert setup.reference.version == "made up 1"
    assert "tracer/made_up" in setup.plugins
    keys = {reference_key(setup_of(tmp_path, None), block), reference_key(setup, block)}
    for change in ({"samples": 33}, {"max_depth": 6}, {"version": "made up 2"}, {"tracer": "plain"}):
        keys.add(reference_key(replace(setup, reference=replace(setup.reference, **change)), block))
    assert len(keys) == 6
    assert setup_of(tmp_path, REFERENCE | {"samples": 33}).id != setup.id


# The pictures


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> tuple[Setup, Any, Any]:
    """A setup, and the references of its first block, path traced and all-trace."""
    folder = tmp_path_factory.mktemp("traced")
    setup = setup_of(folder)
    with open_renderer(setup, base=True) as renderer:
        mine = References(folder / "cache").make(setup, setup.blocks()[0], lambda: renderer)
        usual = References(folder / "cache").make(setup_of(folder, None), setup.blocks()[0], lambda: renderer)
    return setup, mine, usual


def test_what_is_compared_with_is_path_traced(traced: tuple[Setup, Any, Any]) -> None:
    setup, mine, usual = traced
    assert sorted(mine) == sorted(usual) == [0, 1, 2, 3]
    for number, picture in mine.items():
        x = np.arange(64, dtype=np.float32) / 64
        np.testing.assert_allclose(picture.image[10, :, 0], x, atol=1e-3)
        np.testing.assert_allclose(picture.image[..., 2], setup.path.time(number) + 0.32, atol=1e-3)
        np.testing.assert_array_equal(picture.display[20, 5], to_8bit(picture.image, setup.tone_map)[20, 5])
        assert np.abs(picture.image - usual[number].image).max() > 0.1


def test_what_a_decision_can_change_is_still_told_by_tracing(traced: tuple[Setup, Any, Any]) -> None:
    _, mine, usual = traced
    for number in (1, 3):
        assert 0.01 < mine[number].changeable.mean() < 0.99
        np.testing.assert_array_equal(mine[number].changeable, usual[number].changeable)
        np.testing.assert_array_equal(mine[number].traced_display, usual[number].display)
        np.testing.assert_array_equal(mine[number].floor_display, usual[number].floor_display)
        np.testing.assert_array_equal(mine[number].motion, usual[number].motion)
    assert mine[0].traced_display is None


def test_another_version_is_not_taken_for_the_one_that_was_planned(tmp_path: Path) -> None:
    setup = setup_of(tmp_path)
    assert setup.reference is not None
    planned = replace(setup.reference, version="made up 0")
    with (
        pytest.raises(
            PluginError, match="not what the benchmark was planned with: here it is 'made up 1', there 'made up 0'"
        ),
        paths_module.path_tracing(planned),
    ):
        pass


# A run


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `run`, judged by paths, and `usual`, by all-trace; else they are the same."""
    folder = tmp_path_factory.mktemp("finished")
    for name, reference in (("run", REFERENCE), ("usual", None)):
        config = write(folder / name, reference, oracle=True, heuristics=["gain", "selection_graph"])
        done = bench(config, folder / name / "out")
        assert done.code == 0, done.said
    return folder


def run_of(finished: Path, name: str = "run") -> Path:
    return finished / name / "out"


def test_measures_are_against_paths_and_all_trace_is_beside_them(finished: Path) -> None:
    for label in ("gain", "selection_graph"):
        for block in ("block-000", "block-002"):
            mine = table(cells(run_of(finished))[label] / block / "measures.parquet")
            usual = table(cells(run_of(finished, "usual"))[label] / block / "measures.parquet")
            assert mine["all_trace_error"] == usual["display_error"]
            assert min(mine["display_error"]) > 0.05
            assert "all_trace_error" not in usual


def test_decisions_and_budgets_are_those_of_the_other_reference(finished: Path) -> None:
    for label in ("gain", "selection_graph"):
        mine, usual = (cells(run_of(finished, name))[label] for name in ("run", "usual"))
        amounts = [json.loads((each / "cell.json").read_text())["budget_amount"] for each in (mine, usual)]
        assert amounts[0] == amounts[1] > 0
        chosen = [table(each / "block-001" / "candidates.parquet") for each in (mine, usual)]
        assert chosen[0]["traced_pixels"] == chosen[1]["traced_pixels"]


def test_shares_of_the_oracle_are_against_all_trace(finished: Path) -> None:
    shares = []
    for name in ("run", "usual"):
        rows = {(row["label"], row["metric"]): row for row in read_summary(run_of(finished, name))}
        shares.append(rows["gain", "oracle_share"]["value"])
    assert shares[0] == pytest.approx(shares[1], abs=1e-9)
    assert shares[0] > 0.2


def test_the_folder_the_summary_and_the_verdict_name_the_reference(finished: Path) -> None:
    run = BenchRun.read(run_of(finished))
    assert run.reference_name == "path tracing (made_up, 32 paths a pixel)"
    assert BenchRun.read(run_of(finished, "usual")).reference_name == "all-trace"
    assert {row["reference"] for row in read_summary(run_of(finished))} == {run.reference_name}
    assert verdict([replace(board, frames=6) for board in leaderboard(read_summary(run.folder), run)]).endswith(
        "Pictures are judged by path tracing (made_up, 32 paths a pixel)."
    )
    about = json.loads((run_of(finished) / "bench.json").read_text())
    assert about["config"]["reference"] == REFERENCE
    assert about["plan"]["setups"][0]["reference"] == {**REFERENCE, "version": "made up 1"}
    assert any((run_of(finished) / "references").rglob("frame-*.png"))


def test_resuming_finds_everything_done(finished: Path) -> None:
    before = results(run_of(finished))
    done = bench(finished / "run" / "config.yaml", run_of(finished), "--resume")
    assert done.code == 0, done.said
    assert results(run_of(finished)) == before


def test_resuming_with_another_reference_is_refused(finished: Path) -> None:
    changed = bench(finished / "run" / "config.yaml", run_of(finished), "--resume", "--set", "reference.samples=64")
    assert changed.code == 2
    assert "reference.samples is 64, was 32" in changed.said
    back = bench(finished / "run" / "config.yaml", run_of(finished), "--resume", "--set", "reference=all_trace")
    assert back.code == 2
    assert "reference is 'all_trace', was {" in back.said


def test_resuming_with_another_version_is_refused(finished: Path) -> None:
    path = run_of(finished) / "bench.json"
    text = path.read_text()
    try:
        path.write_text(text.replace("made up 1", "made up 0"))
        done = bench(finished / "run" / "config.yaml", run_of(finished), "--resume")
    finally:
        path.write_text(text)
    assert done.code == 2
    assert "what path traces the reference is another version" in done.said


def test_the_report_names_the_reference(finished: Path) -> None:
    done = phrt("report", str(run_of(finished)), "-o", str(finished / "report.html"))
    assert done.code == 0, done.said
    page = (finished / "report.html").read_text()
    assert "against path tracing (made_up, 32 paths a pixel)" in page
    assert "reference (path tracing (made_up, 32 paths a pixel))" in page
    assert "all-trace;" not in page


def test_a_picture_that_is_none_is_the_tracers_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MADE_UP_IMAGE", "nan")
    done = bench(write(tmp_path, heuristics=["gain"]), tmp_path / "run")
    assert done.code == 1
    said = " ".join(done.said.split())
    assert "tracer 'made_up' of " in said
    assert "returned a picture with NaN or infinity in it from render_paths(), expected numbers" in said


# Before a run


def test_a_dry_run_says_who_judges(tmp_path: Path) -> None:
    config = write(tmp_path)
    shown = phrt("bench", str(config), "--dry-run", "--cache", str(tmp_path / "cache"))
    assert shown.code == 0, shown.said
    assert "judged by path tracing (made_up, 32" in " ".join(shown.printed.split())
    said = json.loads(phrt("bench", str(config), "--dry-run", "--json", "--cache", str(tmp_path / "cache")).printed)
    assert said["reference"] == "path tracing (made_up, 32 paths a pixel)"
    assert not (tmp_path / "cache").exists()


def test_path_tracing_is_in_the_estimate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cost = Cost(load=2.0, floor=0.02, full=0.12, judge=0.5, rays=100_000)
    made = checked_plan(read_config(write(tmp_path)))
    monkeypatch.setattr(estimate_module, "measured_cost", lambda setup, metrics: cost)
    without = Estimate(made, tmp_path / "cache", ["error"]).total(made.tasks("reference"))
    monkeypatch.setattr(estimate_module, "measured_cost", lambda setup, metrics: replace(cost, paths=7.0))
    assert Estimate(made, tmp_path / "cache", ["error"]).total(made.tasks("reference")) - without == pytest.approx(
        3 * 4 * 7.0
    )


def test_what_a_picture_takes_is_measured_with_few_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    real = paths_module.path_tracing

    def counted(reference: Any, samples: int | None = None) -> Any:
        asked.append(samples or reference.samples)
        return real(reference, samples)

    monkeypatch.setattr(estimate_module, "path_tracing", counted)
    setup = setup_of(tmp_path)
    with open_renderer(setup) as renderer:
        frame = renderer.render(0.0)
        assert estimate_module.seconds_of_paths(renderer, setup, frame) > 0
        assert estimate_module.seconds_of_paths(renderer, setup_of(tmp_path, None), frame) == 0
    assert asked[0] == estimate_module.FEW_PATHS


def test_tasks_say_what_they_wait_for(tmp_path: Path) -> None:
    made = checked_plan(read_config(write(tmp_path)))
    assert (
        made.tasks("reference")[0].title == "balls 64x36, reference, path tracing (made_up, 32 paths a pixel), block 0"
    )
    assert asdict(made.setups[0])["reference"]["samples"] == 32
