"""References: the judged frames of a setup with everything traced, and with nothing; rendered once and kept by what they show.
Where the setup wants that, what is compared with is path traced; what tracing everything shows is kept beside it.

The name of a kept block is a digest of everything that its pictures depend on: the scene and all its files, the path, the size, the
effects, tracer, G-buffer producer, and the versions and sources of the code. What is read is checked: a file that is cut off or of
something else is rendered again.
"""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from phrt.clock import RayClock
from phrt.cost_memory import cache_folder
from phrt.errors import OptionError
from phrt.output.tonemap import to_8bit
from phrt.recording import Recorder
from phrt.recording.folder import RUN_FILE, write_json
from phrt.renderer import Renderer
from phrt_plugins.bench.content import code_digest
from phrt_plugins.bench.paths import Picture, path_tracing
from phrt_plugins.bench.pictures import ReferencePicture, halved, read_arrays, write_arrays
from phrt_plugins.bench.plan import Block, Setup, short_hash
from phrt_plugins.bench.results import read_columns
from phrt_plugins.bench.store import read_json, whole_folder

RUN_FILES = (RUN_FILE, "frames.parquet", "candidates.parquet")
ABOUT_FILE = "reference.json"
ABANDONED_S = 3600.0
"""A reference that has been written for so long is written by nobody."""
BYTES_A_PIXEL = 2 * (6 + 3) + 3 + 4
"""Of a kept frame: two pictures, linear and shown, one that is shown only, and motion."""


def default_cache() -> Path:
    return cache_folder() / "references"


def reference_key(setup: Setup, block: Block) -> str:
    """32 hexadecimal digits of all that the reference pictures of `block` depend on."""
    frames = block.pictured(setup.judge_every)
    said = {
        "content": setup.content, "simplify": setup.simplify, "camera": setup.camera, "size": setup.size,
        "effects": setup.base_effects, "tracer": setup.tracer, "gbuffer": setup.gbuffer, "tone_map": setup.tone_map,
        "frames": frames, "times": [setup.path.time(number) for number in frames],
        "judged": block.judged(setup.judge_every), "code": code_digest(), "plugins": setup.plugins,
    }  # fmt: skip
    if setup.reference is not None:
        said["paths"] = asdict(setup.reference)
    return short_hash(said, 32)


class References:
    """The kept references in folder `cache`."""

    def __init__(self, cache: Path) -> None:
        self.cache = cache

    def folder(self, setup: Setup, block: Block) -> Path:
        return self.cache / reference_key(setup, block)

    def read(self, setup: Setup, block: Block) -> dict[int, ReferencePicture] | None:
        """The pictures by number of frame; None where they are not there, or not whole."""
        key = reference_key(setup, block)
        folder = self.cache / key
        about = read_json(folder / ABOUT_FILE)
        if not isinstance(about, dict) or about.get("key") != key or not _run_is_whole(folder):
            return None
        found = {}
        judged = set(block.judged(setup.judge_every))
        for number in block.pictured(setup.judge_every):
            picture = _read_picture(folder / _file(number), f"{key} {number}", setup, number in judged)
            if picture is None:
                return None
            found[number] = picture
        return found

    def make(self, setup: Setup, block: Block, open_base: Callable[[], Renderer]) -> dict[int, ReferencePicture]:
        """The pictures: read, or rendered and kept. open_base: gives a renderer with the effects of the reference.

        Raises OSError where nothing can be kept, and what loading and rendering raise.
        """
        found = self.read(setup, block)
        if found is not None:
            return found
        self._render(setup, block, open_base())
        found = self.read(setup, block)
        if found is None:
            raise OSError(f"the reference in '{self.folder(setup, block)}' cannot be read after it was written")
        return found

    def _render(self, setup: Setup, block: Block, renderer: Renderer) -> None:
        key = reference_key(setup, block)
        final = self.cache / key
        shutil.rmtree(final, ignore_errors=True)
        self._forget_parts()
        with whole_folder(final) as part:
            with path_tracing(setup.reference) as paths:
                arrays = _everything_traced(setup, block, renderer, part / "run", paths)
            for number, floor in _nothing_traced(setup, block, renderer).items():
                arrays[number] |= floor
            for name in RUN_FILES:
                (part / "run" / name).rename(part / name)
            (part / "run").rmdir()
            for number, values in arrays.items():
                write_arrays(part / _file(number), {"key": np.array(f"{key} {number}"), **values})
            write_json(part / ABOUT_FILE, {"key": key, "setup": asdict(setup), "made": time.time()})

    def _forget_parts(self) -> None:
        """Remove what runs that were killed left behind."""
        for part in self.cache.glob("*.part"):
            with contextlib.suppress(OSError):
                if time.time() - part.stat().st_mtime > ABANDONED_S:
                    shutil.rmtree(part, ignore_errors=True)


def reference_rays(folder: Path) -> list[int]:
    """The secondary rays of every frame of the reference in run folder `folder`."""
    table = read_columns(folder / "frames.parquet", ["rays"])
    return [sum(count for kind, count in row if kind != "primary") for row in table["rays"].to_pylist()]


def _everything_traced(
    setup: Setup, block: Block, renderer: Renderer, run: Path, paths: Picture | None
) -> dict[int, dict[str, np.ndarray]]:
    """The arrays of every frame, by number; the run is recorded into `run`. paths: makes the pictures to compare with, in place of
    what tracing everything shows."""
    renderer.restart(heuristic="all_trace", history=False, clock=RayClock(), strict=True)
    judged = set(block.judged(setup.judge_every))
    arrays: dict[int, dict[str, np.ndarray]] = {}
    with Recorder(run, renderer, settings={"setup": setup.id, "reference": "all_trace"}) as recorder:
        for number in block.pictured(setup.judge_every):
            frame = renderer.render(setup.path.time(number), frame_index=number, camera=setup.camera)
            recorder.add(frame)
            # Motion looks back to the picture before that was asked for it: of the frame before, where that is of this block.
            motion = renderer.producer.render(frame.view, channels=("motion",)).arrays["motion"]
            shown = to_8bit(frame.image, setup.tone_map, pool=renderer.workers)
            arrays[number] = {"image": halved(frame.image), "display": shown}
            if paths is not None:
                image = paths(renderer.world, frame.view)
                arrays[number] = {
                    "image": halved(image), "display": to_8bit(image, setup.tone_map, pool=renderer.workers),
                    **({"traced_display": shown} if number in judged else {}),
                }  # fmt: skip
            if number in judged and number - 1 in arrays:
                arrays[number]["motion"] = motion.astype(np.float16)
    if recorder.failed is not None:
        raise OSError(recorder.failed)
    return arrays


def _nothing_traced(setup: Setup, block: Block, renderer: Renderer) -> dict[int, dict[str, np.ndarray]]:
    """The arrays of the floor of every judged frame."""
    renderer.restart(heuristic="raster_only", history=False, clock=RayClock(), strict=True)
    arrays = {}
    for number in block.judged(setup.judge_every):
        frame = renderer.render(setup.path.time(number), frame_index=number, camera=setup.camera)
        shown = to_8bit(frame.image, setup.tone_map, pool=renderer.workers)
        arrays[number] = {"floor": halved(frame.image), "floor_display": shown}
    return arrays


def _file(number: int) -> str:
    return f"frame-{number:06d}.npz"


def _run_is_whole(folder: Path) -> bool:
    """Can the tables be read, and did the run end well?"""
    about = read_json(folder / RUN_FILE)
    if not isinstance(about, dict) or about.get("state") != "finished":
        return False
    try:
        return all(read_columns(folder / name) is not None for name in RUN_FILES[1:])
    except OptionError:
        return False


def _read_picture(path: Path, key: str, setup: Setup, judged: bool) -> ReferencePicture | None:
    """One frame; None where the file is not what was written for `key`."""
    width, height = setup.size
    arrays: dict[str, Any] | None = read_arrays(path, width * height * BYTES_A_PIXEL)
    if arrays is None or "key" not in arrays or str(arrays.pop("key")) != key:
        return None
    wanted: dict[str, tuple[type, int]] = {"image": (np.float16, 3), "display": (np.uint8, 3)}
    if judged:
        wanted |= {"floor": (np.float16, 3), "floor_display": (np.uint8, 3)}
    if judged and setup.reference is not None:
        wanted["traced_display"] = (np.uint8, 3)
    if "motion" in arrays:
        wanted["motion"] = (np.float16, 2)
    if set(arrays) != set(wanted):
        return None
    for name, (kind, components) in wanted.items():
        if arrays[name].dtype != kind or arrays[name].shape != (height, width, components):
            return None
    wide = {name: array.astype(np.float32) if array.dtype == np.float16 else array for name, array in arrays.items()}
    return ReferencePicture(**wide)
