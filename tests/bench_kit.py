"""A small comparison as `phrt bench` leaves it on the disk, made up but believable, for tests of what reads it.

Candidates, cameras and pictures come from a small scene that is really rendered, once per heuristic and test run; frame times and
measured quality are drawn from a seed. The better of `QUALITY` is really better, frame by frame:

    folder = write_bench(tmp_path / "run")                     # finished
    folder = write_bench(tmp_path / "run", failed="random", unfinished="gain")
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import needs
import numpy as np
from recording_kit import SIZE, renderer_of

from phrt.budget import parse_budget
from phrt.clock import RayClock
from phrt.output.images import write_png
from phrt.output.tonemap import to_8bit
from phrt.recording import Recorder
from phrt.recording.config import machine, versions
from phrt.recording.folder import write_json

needs.package("pyarrow")

HEURISTICS = ("gain", "selection_graph", "raster_only")
QUALITY = {"gain": 0.035, "greedy_ratio": 0.05, "selection_graph": 0.06, "random": 0.09, "raster_only": 0.16}
"""Mean FLIP of a heuristic; 0.07 of others."""

TEMPLATE_FRAMES = 6
RAYS_A_FRAME = {"frame_ms": "2000rays", "ray_ms": "2000rays", "rays": "1000rays", "none": "none"}
"""What the template is rendered with in place of a budget of time."""


@dataclass
class Plan:
    """What a made-up run is of."""

    scenes: Sequence[str] = ("court",)
    heuristics: Sequence[str] = HEURISTICS
    budgets: Sequence[str] = ("50ms", "2000rays")
    repeats: int = 1
    blocks: int = 2
    block: int = 20
    judge_every: int = 2
    failed: str | None = None
    unfinished: str | None = None
    pictures: bool = True
    oracle: bool = True
    seed: int = 0
    quality: dict[str, float] = field(default_factory=dict)

    def frames(self, block: int) -> range:
        return range(block * self.block, (block + 1) * self.block)

    def judged(self, block: int) -> list[int]:
        return [frame for frame in self.frames(block) if frame % self.judge_every == 0]


def write_bench(folder: Path, **plan: Any) -> Path:
    """Write a run into `folder`: `plan` is a Plan's fields.

    failed, unfinished: labels; the former's cells fail in their last block, the latter's are in the middle of it
    """
    plan_ = Plan(**plan)
    cells = [
        cell_of(plan_, scene, budget, heuristic, repeat)
        for scene in plan_.scenes
        for budget in plan_.budgets
        for repeat in range(plan_.repeats)
        for heuristic in plan_.heuristics
    ]
    folder.mkdir(parents=True)
    for cell in cells:
        write_cell(folder, plan_, cell)
    for scene in plan_.scenes:
        write_references(folder, plan_, scene)
        if plan_.oracle:
            write_oracle(folder, plan_, scene)
    write_about(folder, plan_, cells)
    return folder


def write_about(folder: Path, plan: Plan, cells: list[dict[str, Any]]) -> None:
    config = {
        "name": "made_up",
        "title": "A made-up comparison",
        "scenes": [{"scene": f"{scene}.yaml", "name": scene} for scene in plan.scenes],
        "sizes": ["64x36"],
        "budgets": list(plan.budgets),
        "heuristics": list(plan.heuristics),
        "repeats": plan.repeats,
        "block": plan.block,
        "judge_every": plan.judge_every,
    }
    setups = [setup_settings(scene, plan) for scene in plan.scenes]
    about = {
        "phrt_bench": 1,
        "name": "made_up",
        "title": "A made-up comparison",
        "state": "running" if plan.unfinished else "finished",
        "config": config,
        "plan": {"setups": setups, "cells": cells, "blocks": plan.blocks},
        "versions": versions(),
        "machine": machine(),
        "started": "2026-01-01T12:00:00+00:00",
        "finished": None if plan.unfinished else "2026-01-01T12:10:00+00:00",
    }
    write_json(folder / "bench.json", about)
    (folder / "config.yaml").write_text(json.dumps(config, indent=2) + "\n")


def setup_id(scene: str) -> str:
    return f"{scene}-64x36-embree-raycast-{digest(scene)}"


def setup_settings(scene: str, plan: Plan) -> dict[str, Any]:
    last = plan.blocks * plan.block
    return {
        "id": setup_id(scene),
        "scene": scene,
        "size": list(SIZE),
        "tracer": "embree",
        "gbuffer": "raycast",
        "clock": "wall",
        "frames": [0, last],
        "fps": 30,
    }


def cell_of(plan: Plan, scene: str, budget: str, heuristic: str, repeat: int) -> dict[str, Any]:
    """cell.json."""
    parsed = parse_budget(budget)
    name = f"{scene}-64x36-{budget}-{heuristic}-r{repeat}".replace(":", "")
    return {
        "id": f"{name}-{digest(name)}",
        "setup": setup_id(scene),
        "scene": scene,
        "label": heuristic,
        "heuristic": heuristic,
        "options": {},
        "budget": budget,
        "budget_kind": parsed.kind,
        "budget_amount": parsed.amount if np.isfinite(parsed.amount) else None,
        "size": list(SIZE),
        "tracer": "embree",
        "gbuffer": "raycast",
        "clock": "wall",
        "persistence": None,
        "cost_model": "measured",
        "group_by": "object_effect",
        "history": True,
        "repeat": repeat,
    }


def write_cell(folder: Path, plan: Plan, cell: dict[str, Any]) -> None:
    place = folder / "cells" / cell["id"]
    place.mkdir(parents=True)
    write_json(place / "cell.json", cell)
    last = plan.blocks - 1
    for block in range(plan.blocks):
        if block == last and cell["label"] == plan.failed:
            reason = f"heuristic '{cell['label']}' failed in frame {plan.frames(block)[3]}: ZeroDivisionError: division by zero"
            write_json(place / "failed.json", {"block": block, "reason": reason, "kind": "PluginError"})
            continue
        unfinished = block == last and cell["label"] == plan.unfinished
        write_block(place / f"block-{block:03d}{'.part' if unfinished else ''}", plan, cell, block)


def write_block(folder: Path, plan: Plan, cell: dict[str, Any], block: int) -> None:
    """A run folder with measures and pictures."""
    template = recorded(cell["heuristic"], RAYS_A_FRAME[cell["budget_kind"]])
    folder.mkdir()
    shutil.copy(template / "run.json", folder / "run.json")
    write_frames(folder, template, plan, cell, block)
    write_candidates(folder, template, plan, cell, block)
    write_measures(folder, plan, cell, block)
    if plan.pictures:
        write_pictures(folder, template, plan, block, "frame")


def write_frames(folder: Path, template: Path, plan: Plan, cell: dict[str, Any], block: int) -> None:
    import pyarrow.parquet as parquet

    numbers, random = plan.frames(block), generator(plan, cell, block, "times")
    rows = parquet.read_table(template / "frames.parquet").to_pylist()
    amount, kind = cell["budget_amount"], cell["budget_kind"]
    goal = 0.93 * amount if kind == "frame_ms" else 38.0
    if cell["heuristic"] == "raster_only":
        goal = 24.0
    times = goal + 0.02 * goal * wander(random, len(numbers)) + random.exponential(0.01 * goal, len(numbers))
    made = []
    for step, (number, time) in enumerate(zip(numbers, times.tolist(), strict=True)):
        row = dict(rows[number % len(rows)])
        stages = dict(row["stages"])
        share = time / sum(stages.values())
        row |= {
            "step": step,
            "frame": number,
            "time": number / 30,
            "milliseconds": time,
            "clock_ms": time,
            "ray_ms": stages["rays"] * share,
            "frame_budget": cell["budget"],
            "stages": [(name, value * share) for name, value in stages.items()],
            "rays": list(row["rays"]),
        }
        if kind == "frame_ms":
            budget = 0.6 * amount
            row |= {"budget": budget, "budget_unit": "ms", "left": budget - row["ray_ms"], "deadline_ms": amount}
            row |= {"late": time > amount, "overrun_ms": max(row["ray_ms"] - budget, 0.0)}
        made.append(row)
    write_table(folder / "frames.parquet", made, parquet.read_schema(template / "frames.parquet"))


def write_candidates(folder: Path, template: Path, plan: Plan, cell: dict[str, Any], block: int) -> None:
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    table = parquet.read_table(template / "candidates.parquet")
    step, numbers = np.asarray(table.column("step")), plan.frames(block)
    rows = [np.flatnonzero(step == number % TEMPLATE_FRAMES) for number in numbers]
    counts = [len(row) for row in rows]
    table = table.take(np.concatenate(rows))
    for name, values, kind in (("step", np.arange(len(numbers)), np.int32), ("frame", np.array(numbers), np.int64)):
        column = arrow.array(np.repeat(values.astype(kind), counts))
        table = table.set_column(table.schema.get_field_index(name), name, column)
    if cell["budget_kind"] == "frame_ms":
        # What the template predicts in rays is to fit the ray phase's milliseconds as it fitted the template's rays.
        ms = np.asarray(table.column("predicted_cost")) * np.float32(capacity_of(cell["budget"]) / 2000)
        table = table.set_column(table.schema.get_field_index("predicted_cost"), "predicted_cost", arrow.array(ms))
    parquet.write_table(table, folder / "candidates.parquet")


def write_measures(folder: Path, plan: Plan, cell: dict[str, Any], block: int) -> None:
    frames = plan.judged(block)
    level = plan.quality.get(cell["label"], QUALITY.get(cell["label"], 0.07))
    if cell["budget_kind"] == "rays":
        level *= 0.9
    # What is hard to render is hard for all: difficulty belongs to the frame, noise to the cell.
    difficulty = wander(np.random.default_rng([plan.seed, code(cell["setup"]), block]), len(frames))
    noise = generator(plan, cell, block, "quality").normal(size=len(frames))
    flip = level * np.exp(0.2 * difficulty + 0.1 * noise)
    write_table(folder / "measures.parquet", {"frame": np.array(frames, np.int64), **measures_of(flip)})


def measures_of(flip: np.ndarray) -> dict[str, np.ndarray]:
    """All columns of the built-in metrics of pictures, as if they followed from FLIP (n,)."""
    previous = np.where(np.arange(len(flip)) == 0, np.nan, 1.0)
    return {
        "flip": flip,
        "flip_changeable": 1.6 * flip,
        "flip_p95": 3.0 * flip,
        "ssim": 1.0 - 1.5 * flip,
        "ssim_changeable": 1.0 - 2.2 * flip,
        "psnr": 20.0 - 20.0 * np.log10(flip),
        "psnr_changeable": 17.0 - 20.0 * np.log10(flip),
        "relmse": 0.8 * flip**2,
        "relmse_changeable": 1.5 * flip**2,
        "difference_error": 0.1 * flip,
        "compensated_difference": 0.05 * flip * previous,
        "popping": 0.9 * flip * previous,
        "display_error": 0.5 * flip,
        "display_error_changeable": 0.8 * flip,
    }


def write_references(folder: Path, plan: Plan, scene: str) -> None:
    """The all-trace reference of a scene, and the floor beside it."""
    place = folder / "references" / setup_id(scene)
    place.mkdir(parents=True)
    cell = cell_of(plan, scene, "none", "all_trace", 0)
    floor = cell_of(plan, scene, "none", "raster_only", 0)
    for block in range(plan.blocks):
        made = place / f"block-{block:03d}"
        write_block(made, plan, cell, block)
        write_measures(made, plan, floor, block)
        if plan.pictures:
            write_pictures(made, recorded("raster_only", "none"), plan, block, "floor")


def write_oracle(folder: Path, plan: Plan, scene: str) -> None:
    """Error of the floor and of the oracle, and items, for every judged frame and budget."""
    import pyarrow.parquet as parquet

    place = folder / "oracle" / setup_id(scene)
    place.mkdir(parents=True)
    items = parquet.read_table(recorded("all_trace", "none") / "candidates.parquet").to_pylist()
    for block in range(plan.blocks):
        frames = plan.judged(block)
        difficulty = wander(np.random.default_rng([plan.seed, code(setup_id(scene)), block]), len(frames))
        rows = [
            {
                "frame": frame,
                "budget": budget,
                "error_floor": 0.08 * float(np.exp(0.2 * hard)),
                "error_oracle": 0.008 * float(np.exp(0.2 * hard)),
                "error_parts": 0.004 * float(np.exp(0.2 * hard)),
                "benefit_oracle": 0.072 * float(np.exp(0.2 * hard)),
                "items": 3,
                "cost": 0.97 * capacity_of(budget),
                "capacity": capacity_of(budget),
            }
            for frame, hard in zip(frames, difficulty.tolist(), strict=True)
            for budget in plan.budgets
        ]
        write_table(place / f"block-{block:03d}.parquet", rows)
        seen = [
            {
                "frame": frame,
                "object": item["object"],
                "effect": item["effect"],
                "benefit": 1e-5 * item["traced_pixels"],
                "rays": item["rays"],
                "ms": item["milliseconds"],
                "relevance": item["relevance"],
            }
            for frame in frames
            for item in items
            if item["step"] == frame % TEMPLATE_FRAMES
        ]
        write_table(place / f"items-{block:03d}.parquet", seen)


def capacity_of(budget: str) -> float:
    """ms of the ray phase, or rays."""
    parsed = parse_budget(budget)
    return 0.6 * parsed.amount if parsed.kind == "frame_ms" else parsed.amount


def write_pictures(folder: Path, template: Path, plan: Plan, block: int, kind: str) -> None:
    """Of the first and the last judged frame of a block."""
    frames = plan.judged(block)
    (folder / "pictures").mkdir(exist_ok=True)
    for frame in dict.fromkeys((frames[0], frames[-1])):
        source = template / f"picture-{frame % TEMPLATE_FRAMES}.png"
        shutil.copy(source, folder / "pictures" / f"{kind}-{frame:06d}.png")


@lru_cache(maxsize=1)
def templates() -> tempfile.TemporaryDirectory[str]:
    """Goes when the tests are over."""
    return tempfile.TemporaryDirectory(prefix="phrt-bench-kit-", ignore_cleanup_errors=True)


@lru_cache
def recorded(heuristic: str, budget: str) -> Path:
    """A run folder of a few real frames of `heuristic`, with a picture of each."""
    folder = Path(templates().name) / f"{heuristic}-{budget}"
    with (
        renderer_of(heuristic=heuristic, budget=budget, clock=RayClock(100.0)) as renderer,
        Recorder(folder, renderer) as recorder,
    ):
        for number in range(TEMPLATE_FRAMES):
            frame = renderer.render(number / 30)
            recorder.add(frame)
            write_png(folder / f"picture-{number}.png", to_8bit(frame.image))
    return folder


def write_table(path: Path, rows: Any, schema: Any = None) -> None:
    """Write dicts, or arrays by column."""
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    table = arrow.table(rows) if isinstance(rows, dict) else arrow.Table.from_pylist(rows, schema)
    parquet.write_table(table, path)


def wander(random: np.random.Generator, count: int, memory: float = 0.8) -> np.ndarray:
    """(count,) float64: a series of variance 1 in which neighbours are alike."""
    steps = random.normal(size=count)
    steps[1:] *= np.sqrt(1 - memory**2)
    for number in range(1, count):
        steps[number] += memory * steps[number - 1]
    return steps


def generator(plan: Plan, cell: dict[str, Any], block: int, what: str) -> np.random.Generator:
    return np.random.default_rng([plan.seed, code(cell["id"]), block, code(what)])


def code(text: str) -> int:
    return int(hashlib.sha256(text.encode()).hexdigest()[:8], 16)


def digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:6]
