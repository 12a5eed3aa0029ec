"""Replay: render again with the decisions of a recorded run.

The same items are asked for, in the same order and as many pixels of them as were traced, however fast this machine is. With
the same scene, size, options and G-buffer producer the picture is the recorded one bit for bit; with others (more samples, another
fallback) it shows what the same decisions give there.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phrt.errors import OptionError, PhrtWarning, did_you_mean
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Request
from phrt.recording.config import base, resolved_config
from phrt.recording.folder import plain
from phrt.recording.rows import view_of
from phrt.recording.run import Run, as_arrays, read_run, spans
from phrt.registry.auto import DEFAULT_EFFECTS
from phrt.scene import Scene

if TYPE_CHECKING:
    from phrt.frame import FrameResult
    from phrt.renderer import Renderer

COLUMNS = ("step", "sample", "object", "effect", "pixel_count", "traced_pixels", "order")
RENDER_OPTIONS = ("gbuffer", "tracer", "effects", "aa", "history", "group_by")
"""What `replay` takes over from the recorded configuration."""


@dataclass(frozen=True)
class Recorded:
    """What was traced in one sample: rows by order. objects, effects: text; pixels, seen: (k,) int64."""

    objects: list[str]
    effects: list[str]
    pixels: np.ndarray
    seen: np.ndarray


class Replay(Heuristic):
    """Asks for what a recorded run traced. It needs no budget, and must not be given one.

    run: what `read_run` returned, or its folder. Call `check` before the first frame: it says what does not fit.
    """

    def __init__(self, run: Run | str | Path) -> None:
        self.run = run if isinstance(run, Run) else read_run(run)
        self._traced = traced_items(self.run)
        self._requests: Iterator[Request] = iter(())
        self._warned = False
        units = self.run.frames.column("budget_unit").to_pylist() if self.run.frames.num_rows else []
        self._units = units
        self.recorded_unit = "none"
        """Of the budget that the frame was recorded within."""
        # Then the recorded frames did without values of earlier ones, and so do these.
        everything = self.run.config["heuristic"]["traces_everything"]
        self.traces_everything = bool(everything) and all(unit == "none" for unit in units)

    def check(self, renderer: Renderer, frames: Iterable[int] = ()) -> None:
        """Raises OptionError where `renderer` cannot render this run: other objects, size or samples, effects that are missing, a
        budget; or where one of `frames` was not recorded. Warns of what makes the pictures differ from the recorded ones."""
        check_frames(self.run, frames)
        check_renderer(self.run, renderer)
        if different := differences(self.run, renderer):
            warnings.warn(
                f"the pictures will not be those of '{self.run.folder}': {'; '.join(different)}",
                PhrtWarning,
                stacklevel=2,
            )

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        step = self.run.step_of(context.frame_index)
        self.recorded_unit = self._units[step]
        recorded = self._traced.get((step, context.sample))
        self._requests = iter(())
        if recorded is None:
            return
        rows = rows_of(recorded, candidates, [entry.path for entry in context.world.scene.objects])
        there = rows >= 0
        self._compare(recorded, candidates, rows, there, context.frame_index)
        pairs = zip(rows[there].tolist(), recorded.pixels[there].tolist(), strict=True)
        self._requests = iter([Request(item, pixels=pixels) for item, pixels in pairs])

    def next(self, remaining: float) -> Request | None:
        return next(self._requests, None)

    def _compare(
        self, recorded: Recorded, candidates: Candidates, rows: np.ndarray, there: np.ndarray, frame: int
    ) -> None:
        """Warn, once, of a frame that sees something else than the recorded one did."""
        same = there.copy()
        same[there] = candidates.pixel_count[rows[there]] == recorded.seen[there]
        if same.all() or self._warned:
            return
        self._warned = True
        row = int(np.flatnonzero(~same)[0])
        now = int(candidates.pixel_count[rows[row]]) if there[row] else 0
        warnings.warn(
            f"frame {frame} does not see what was recorded: {recorded.effects[row]} of '{recorded.objects[row]}' had "
            f"{recorded.seen[row]} pixels and has {now}; {int((~same).sum())} of {len(same)} traced items differ",
            PhrtWarning,
            stacklevel=2,
        )


def replay(
    run: Run | str | Path, scene: Scene, frames: Iterable[int] | None = None, **options: Any
) -> Iterator[FrameResult]:
    """Render the frames of a recorded run again, each from where it was seen, in the order in which they were recorded.

    scene   : the recorded one, as `phrt.load_scene` returns it
    frames  : which; by default all. With history a picture needs those before it: they are rendered, too, and not given
    options : of `Renderer`, over those recorded: `threads`, `tracer`, `effects`, ...

    Raises OptionError as `Replay.check`.
    """
    from phrt.renderer import Renderer

    decides = Replay(run)
    config = decides.run.config
    chosen = decides.run.numbers.tolist() if frames is None else list(frames)
    check_frames(decides.run, chosen)
    numbers = with_those_before(decides.run, chosen)
    given = {"size": tuple(config["size"])} | recorded_options(config, scene) | options
    with Renderer(scene, heuristic=decides, budget="none", **given) as renderer:
        decides.check(renderer, chosen)
        for number in numbers:
            row = decides.run.frame(number)
            frame = renderer.render(row["time"], frame_index=number, camera=view_of(row["view"], renderer.size))
            if number in chosen:
                yield frame


def with_those_before(run: Run, frames: Iterable[int]) -> list[int]:
    """`frames`, recorded ones, in the order in which they were recorded; with those that their pictures came from."""
    wanted = set(frames)
    numbers = list(dict.fromkeys(run.numbers.tolist()))
    if not run.config["history"]:
        return [number for number in numbers if number in wanted]
    last = max((place for place, number in enumerate(numbers) if number in wanted), default=-1)
    return numbers[: last + 1]


def recorded_options(config: dict[str, Any], scene: Scene) -> dict[str, Any]:
    """Options of `Renderer` that a recorded configuration holds. Effects that were off then are off."""
    found = {name: config[name] for name in RENDER_OPTIONS if name in config and not isinstance(config[name], dict)}
    found |= {name: config[name]["name"] for name in ("gbuffer", "tracer")}
    found["effects"] = {name: {"enabled": False} for name in (*DEFAULT_EFFECTS, *scene.settings.effects)} | {
        name: {key: value for key, value in values.items() if key != "layer"}
        for name, values in config["effects"].items()
    }
    return found


def traced_items(run: Run) -> dict[tuple[int, int], Recorded]:
    """What was traced, by step and sample, in the order in which it was asked for."""
    table = as_arrays(run.read_candidates(COLUMNS))
    if not table:
        return {}
    kept = np.flatnonzero(table["traced_pixels"] > 0)
    kept = kept[np.lexsort([table["order"][kept], table["sample"][kept], table["step"][kept]])]
    table = {name: values[kept] for name, values in table.items()}
    if not len(kept):
        return {}
    new = (np.diff(table["step"]) != 0) | (np.diff(table["sample"]) != 0)
    return {
        (int(table["step"][rows[0]]), int(table["sample"][rows[0]])): Recorded(
            table["object"][rows].tolist(),
            table["effect"][rows].tolist(),
            table["traced_pixels"][rows].astype(np.int64),
            table["pixel_count"][rows].astype(np.int64),
        )
        for rows in np.split(np.arange(len(kept)), np.flatnonzero(new) + 1)
    }


def rows_of(recorded: Recorded, candidates: Candidates, paths: list[str]) -> np.ndarray:
    """(k,) int64: which candidate each recorded item is now; -1 where there is none."""
    pairs = zip(candidates.object_id.tolist(), candidates.effect.tolist(), strict=True)
    place = {
        (paths[object_id - 1], candidates.effect_names[effect]): row for row, (object_id, effect) in enumerate(pairs)
    }
    items = zip(recorded.objects, recorded.effects, strict=True)
    return np.array([place.get(item, -1) for item in items], np.int64)


def check_frames(run: Run, frames: Iterable[int]) -> None:
    """Raises OptionError where one of `frames` was not recorded."""
    missing = np.setdiff1d(np.array(list(frames), np.int64), run.numbers)
    if len(missing):
        raise OptionError(
            f"'{run.folder}' cannot be replayed: frames {spans(missing)} were not recorded, only {spans(run.numbers) or 'none'}"
            if len(missing) > 1
            else f"'{run.folder}' cannot be replayed: frame {missing[0]} was not recorded, only {spans(run.numbers) or 'none'}"
        )


def check_renderer(run: Run, renderer: Renderer) -> None:
    """Raises OptionError where `renderer` cannot render what was recorded."""
    config, here = run.config, f"'{run.folder}' cannot be replayed"
    paths = [entry.path for entry in renderer.scene.objects]
    for entry in config["scene"]["objects"]:
        if entry["path"] not in paths:
            raise OptionError(
                f"{here}: it was recorded with the scene '{config['scene']['name']}', whose object '{entry['path']}' is not "
                f"in '{renderer.scene.name}'.{did_you_mean(entry['path'], paths)}"
            )
    if list(renderer.size) != config["size"]:
        width, height = config["size"]
        raise OptionError(f"{here}: it was recorded at {width}x{height}, not at {renderer.size[0]}x{renderer.size[1]}")
    if renderer.aa != config["aa"]:
        raise OptionError(f"{here}: it was recorded with aa {config['aa']}, not {renderer.aa}")
    names = [base(effect.name) for effect in renderer.effects]
    for name in config["effects"]:
        if name not in names:
            raise OptionError(f"{here}: it was recorded with the effect '{name}', which is not enabled here")
    if renderer.budget.kind != "none":
        raise OptionError(f"{here} within a budget of {renderer.budget}: what is traced is as it was recorded")


def differences(run: Run, renderer: Renderer) -> list[str]:
    """What of `renderer` makes its pictures differ from the recorded ones, as "shadows.samples was 4 and is 1"."""
    before, now = run.config, plain(resolved_config(renderer))
    found: list[str] = []

    def compare(name: str, was: object, is_now: object) -> None:
        if was != is_now:
            found.append(f"{name} was {was} and is {is_now}")

    for name in sorted({*before["effects"], *now["effects"]}):
        was, is_now = before["effects"].get(name), now["effects"].get(name)
        if was is None or is_now is None:
            compare(name, "off" if was is None else "on", "off" if is_now is None else "on")
            continue
        for key in sorted({*was, *is_now}):
            compare(f"{name}.{key}", was.get(key), is_now.get(key))
    compare("gbuffer", before["gbuffer"]["name"], now["gbuffer"]["name"])
    compare("situation", before["scene"]["situation"], now["scene"]["situation"])
    compare("exposure", before["scene"]["exposure"], now["scene"]["exposure"])
    for name in ("history", "group_by"):
        compare(name, before.get(name), now.get(name))
    return found
