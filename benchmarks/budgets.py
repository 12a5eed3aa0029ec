"""Rows 6 to 8: what every heuristic makes of a budget, in time and in the picture, on the reference scene and its path.

`docs/benchmarks.md` defines each figure; `contest.py` renders the frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from contest import Contest, Entrant, Rules
from fallbacks import BEST, PAPER
from rich.table import Table
from rows import Row, row

from phrt.budget import Budget

RULES: dict[int, tuple[Rules, ...]] = {
    6: (Rules("row 6: half the rays", "hard", None, PAPER, history=False),),
    7: (Rules("row 7: rich, 50 ms", "rich", Budget(50.0, "frame_ms"), BEST, history=True),),
    8: (
        Rules("row 8: hard, 33 ms", "hard", Budget(33.0, "frame_ms"), BEST, history=True),
        Rules("row 8, for context: hard, 50 ms", "hard", Budget(50.0, "frame_ms"), BEST, history=True),
    ),
}
"""The contests of a row; the first one is held to its bars."""

ORDER = ("all_trace", "raster_only", "random", "round_robin", "uniform", "greedy_relevance", "greedy_ratio")
"""How tables begin; the others follow as the registry has them."""


def in_table_order(names: Sequence[str]) -> list[str]:
    """`names`, the simple ones first."""
    return [*(name for name in ORDER if name in names), *(name for name in names if name not in ORDER)]


@dataclass(frozen=True)
class Standing:
    """How one entrant did; times in ms, shares 0..1.

    fps: 1000 / mean frame time. misses: share of frames over the frame budget, NaN without one. overrun_*: how much the ray
    phase passed its own budget, in its unit (`overrun_unit`); overrun_past_wave: worst of that less the frame's longest
    wave. flips: items that were traced in one of two consecutive frames and not in the other, a frame; flipped_area: their
    share of the pixels of all. error_*: |predicted - actual| / actual of a frame's rays or ms, by cost model, median and
    90th percentile over the frames; item_error_*: of every traced item. heuristic_ms, scheduler_ms: medians.
    flip, ssim: means over the pictures that were kept; flip_p95: of the worst twentieth.
    """

    heuristic: str
    frames: int
    fps: float
    frame_p50: float
    frame_p95: float
    frame_p99: float
    frame_mean: float
    misses: float
    overrun_worst: float
    overrun_p99: float
    overrun_past_wave: float
    overrun_unit: str
    rays: float
    candidates: float
    chosen: float
    flip: float
    flip_p95: float
    ssim: float
    flips: float
    flipped_area: float
    heuristic_ms: float
    scheduler_ms: float
    error_paper_p50: float
    error_paper_p90: float
    error_measured_p50: float
    error_measured_p90: float
    error_rays_p50: float
    error_rays_p90: float
    item_error_paper_p50: float
    item_error_paper_p90: float
    item_error_measured_p50: float
    item_error_measured_p90: float


def standing(entrant: Entrant, budget: Budget) -> Standing:
    """The figures of one entrant. The reference has no budget and no quality."""
    samples = entrant.samples
    frame, overrun = samples["frame_ms"], samples["overrun"]
    p50, p95, p99 = np.percentile(frame, (50, 95, 99)).tolist()
    framed = budget.kind == "frame_ms" and bool(entrant.quality)
    flip = np.array([found.flip for found in entrant.quality])
    errors: dict[str, float] = {}
    for model in ("paper", "measured", "rays"):
        errors |= _percentiles(f"error_{model}", samples[f"error_{model}"])
    for model in ("paper", "measured"):
        errors |= _percentiles(f"item_error_{model}", np.concatenate(samples.item_errors[model]))
    means = {name: float(samples[name].mean()) for name in ("rays", "candidates", "chosen", "flips", "flipped_area")}
    return Standing(
        heuristic=entrant.name,
        frames=len(frame),
        fps=1e3 / float(frame.mean()),
        frame_p50=p50,
        frame_p95=p95,
        frame_p99=p99,
        frame_mean=float(frame.mean()),
        misses=float((frame > budget.amount).mean()) if framed else math.nan,
        overrun_worst=float(overrun.max()),
        overrun_p99=float(np.percentile(overrun, 99)),
        overrun_past_wave=float((overrun - samples["longest_wave_ms"]).max()) if budget.kind != "rays" else math.nan,
        overrun_unit="rays" if budget.kind == "rays" else "ms",
        flip=float(flip.mean()) if len(flip) else math.nan,
        flip_p95=float(np.percentile(flip, 95)) if len(flip) else math.nan,
        ssim=float(np.mean([found.ssim for found in entrant.quality])) if len(flip) else math.nan,
        heuristic_ms=float(np.median(samples["heuristic_ms"])),
        scheduler_ms=float(np.median(samples["scheduler_ms"])),
        **means,
        **errors,
    )


def _percentiles(name: str, values: np.ndarray) -> dict[str, float]:
    """Median and 90th percentile of what is not NaN; NaN where nothing is left."""
    known = values[~np.isnan(values)]
    p50, p90 = np.percentile(known, (50, 90)).tolist() if len(known) else (math.nan, math.nan)
    return {f"{name}_p50": p50, f"{name}_p90": p90}


def standings(contest: Contest) -> list[Standing]:
    """Of the reference, then of every heuristic."""
    return [standing(entrant, contest.budget) for entrant in contest.entrants]


def best(found: Sequence[Standing]) -> Standing:
    """The heuristic with the least mean FLIP; the reference is none."""
    return min(found[1:], key=lambda entry: entry.flip)


def contest_rows(number: int, contest: Contest) -> list[Row]:
    """What row `number` is held to."""
    found = standings(contest)
    return {6: _rays_rows, 7: _rich_rows, 8: _hard_rows}[number](contest, found)


def _rays_rows(contest: Contest, found: Sequence[Standing]) -> list[Row]:
    by_name = {entry.heuristic: entry.flip for entry in found[1:]}
    rows = []
    for name in ("raster_only", "random", "greedy_ratio", "selection_graph", "gain"):
        if name in by_name:
            limit = 0.04 if name == "gain" else None
            rows.append(row(6, f"half the rays, mean FLIP: {name}", "", [by_name[name]], "<=", limit, digits=4))
    if {"gain", "selection_graph"} <= by_name.keys():
        ratio = by_name["gain"] / by_name["selection_graph"]
        rows.append(row(6, "  gain / selection_graph", "", [ratio], "<=", 0.5))
    return rows


def _share_row(number: int, found: Sequence[Standing], winner: Standing) -> Row:
    """What stands behind the other figures: a heuristic that had no time for rays meets some bars, too."""
    share = winner.rays / found[0].rays * 100 if found[0].rays else 0.0
    return row(number, "  its rays, of all-trace's", "%", [share], ">=", None)


def _rich_rows(contest: Contest, found: Sequence[Standing]) -> list[Row]:
    winner = best(found)
    ratio = found[0].frame_mean / winner.frame_mean
    return [
        row(7, f"rich, 50 ms: all-trace / {winner.heuristic}, frame times", "", [ratio], ">=", 4.0),
        row(7, f"  mean FLIP of {winner.heuristic}, the best", "", [winner.flip], "<=", 0.06, digits=4),
        row(7, "  its frames over budget", "%", [winner.misses * 100], "<=", None),
        _share_row(7, found, winner),
    ]


def _hard_rows(contest: Contest, found: Sequence[Standing]) -> list[Row]:
    winner = best(found)
    late = winner.misses * 100
    past = max(winner.overrun_past_wave, 0.0)
    return [
        row(8, f"hard, 33 ms: frames over budget, {winner.heuristic}", "%", [late], "<=", 1.0),
        row(8, "  worst ray-phase overrun", "ms", [winner.overrun_worst], "<=", None),
        row(8, "  the same less one wave", "ms", [past], "<=", 2.0),
        row(8, f"  mean FLIP of {winner.heuristic}, the best", "", [winner.flip], "<=", 0.05, digits=4),
        _share_row(8, found, winner),
    ]


def as_json(contest: Contest) -> dict[str, Any]:
    """The contest as plain values, with every frame's samples."""
    return {
        "name": contest.rules.name,
        "variant": contest.rules.variant,
        "budget": str(contest.budget),
        "effects": contest.rules.effects,
        "history": contest.rules.history,
        "frames": contest.path.frames,
        "pictures_compared": len(contest.rivals[0].quality) if contest.rivals else 0,
        "warnings": contest.warnings,
        "standings": [_plain(asdict(entry)) for entry in standings(contest)],
        "stages_mean_ms": {entrant.name: stage_means(entrant) for entrant in contest.entrants},
        "samples": {
            entrant.name: {name: [_number(v) for v in column] for name, column in entrant.samples.columns.items()}
            for entrant in contest.entrants
        },
    }


def _number(value: float) -> float | None:
    """JSON knows neither NaN nor infinity."""
    return round(value, 4) if math.isfinite(value) else None


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    return {name: _number(value) if isinstance(value, float) else value for name, value in values.items()}


def stage_means(entrant: Entrant) -> dict[str, float]:
    """Mean ms by stage, those of frames without it as 0; `to_8bit` at the end. They sum to the mean frame."""
    frames = len(entrant.samples["frame_ms"])
    means = {stage: round(sum(spent) / frames, 3) for stage, spent in entrant.samples.stages.items()}
    return means | {"to_8bit": round(float(entrant.samples["closing_ms"].mean()), 3)}


# --- to read ----------------------------------------------------------------------------------------------------------


def shown(value: float, digits: int = 1, percent: bool = False) -> str:
    """ "-" for NaN."""
    if math.isnan(value):
        return "-"
    return f"{value * 100:.{digits}f}%" if percent else f"{value:,.{digits}f}"


def _titled(title: str, headings: Sequence[str]) -> Table:
    made = Table(title=title, title_justify="left")
    for place, heading in enumerate(headings):
        made.add_column(heading, justify="right" if place else "left", no_wrap=True)
    return made


def speed_table(contest: Contest) -> Table:
    """Frame times, what the budget came to, and the pictures."""
    found = standings(contest)
    unit, digits = found[-1].overrun_unit, 0 if found[-1].overrun_unit == "rays" else 1
    made = _titled(
        f"{contest.rules.name}; budget {contest.budget}, {contest.path.frames} frames",
        (
            "heuristic",
            "fps",
            "p50",
            "p95",
            "p99 ms",
            "late",
            f"overrun, {unit}",
            "p99",
            "k rays",
            "FLIP",
            "p95",
            "SSIM",
        ),
    )
    for s in found:
        made.add_row(
            s.heuristic, shown(s.fps), shown(s.frame_p50), shown(s.frame_p95), shown(s.frame_p99),
            shown(s.misses, percent=True), shown(s.overrun_worst, digits), shown(s.overrun_p99, digits),
            shown(s.rays / 1e3), shown(s.flip, 4), shown(s.flip_p95, 4), shown(s.ssim, 4),
        )  # fmt: skip
    return made


def choice_table(contest: Contest) -> Table:
    """Decisions, predictions, and what deciding took."""
    errors = ("paper", "p90", "measured", "p90", "item paper", "item meas.", "rays")
    headings = ("heuristic", "items", "traced", "flips", "area", *errors, "heur. ms", "sched. ms")
    made = _titled("  decisions and predictions (errors are medians)", headings)
    for s in standings(contest):
        made.add_row(
            s.heuristic, shown(s.candidates), shown(s.chosen), shown(s.flips, 2), shown(s.flipped_area, 1, True),
            shown(s.error_paper_p50, 0, True), shown(s.error_paper_p90, 0, True),
            shown(s.error_measured_p50, 0, True), shown(s.error_measured_p90, 0, True),
            shown(s.item_error_paper_p50, 0, True), shown(s.item_error_measured_p50, 0, True),
            shown(s.error_rays_p50, 0, True), shown(s.heuristic_ms, 2), shown(s.scheduler_ms, 2),
        )  # fmt: skip
    return made


def stages_table(contest: Contest) -> Table:
    """Where the time of a frame went."""
    means = {entrant.name: stage_means(entrant) for entrant in contest.entrants}
    stages = list(dict.fromkeys(stage for found in means.values() for stage in found))
    made = _titled("  stages, ms (means)", ("heuristic", *stages))
    for name, found in means.items():
        made.add_row(name, *(shown(found.get(stage, 0.0)) for stage in stages))
    return made


def tables(contest: Contest) -> list[Table]:
    """All of a contest's."""
    return [speed_table(contest), choice_table(contest), stages_table(contest)]
