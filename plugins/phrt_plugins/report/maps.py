"""FLIP maps, on all cores. FLIP holds on to the interpreter, so that every core gets a process:

python -m phrt_plugins.report.maps      # a JSON line per map comes in, a data: link per line goes out
"""

from __future__ import annotations

import base64
import io
import json
import math
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from phrt.errors import OptionError
from phrt.workers import usable_cores

FEWEST_A_PROCESS = 4
"""A process takes about a second to start: maps that are as quick to make here."""
QUALITY = 90
LOSSLESS_PIXELS = 40_000
"""Small pictures show every fault."""


@dataclass(frozen=True)
class Pair:
    """Two PNGs, and how large (width, height) their map is to be."""

    reference: Path
    picture: Path
    size: tuple[int, int]


def make_maps(pairs: Sequence[Pair]) -> list[str]:
    """A data: link per pair, "" where FLIP has no answer: its package is missing, or the pictures do not fit together."""
    processes = min(usable_cores(), len(pairs) // FEWEST_A_PROCESS)
    if processes < 2:
        return [map_of(pair) for pair in pairs]
    with ThreadPoolExecutor(processes) as threads:
        parts = list(threads.map(_elsewhere, [pairs[start::processes] for start in range(processes)]))
    made = [""] * len(pairs)
    for start, part in enumerate(parts):
        made[start::processes] = part
    return made


def _elsewhere(pairs: Sequence[Pair]) -> list[str]:
    """The maps of `pairs`, made by another process. Those that it does not get to are ""."""
    command = [sys.executable, "-m", "phrt_plugins.report.maps"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    lines = (json.dumps([str(pair.reference), str(pair.picture), *pair.size]) for pair in pairs)
    done = subprocess.run(
        command, input="\n".join(lines), env=environment, stdout=subprocess.PIPE, text=True, check=False
    )
    found = done.stdout.split("\n")[: len(pairs)]
    return [*found, *[""] * (len(pairs) - len(found))]


def serve(lines: Iterable[str], out: IO[str]) -> None:
    """Answer each line with a map."""
    for line in lines:
        reference, picture, width, height = json.loads(line)
        print(map_of(Pair(Path(reference), Path(picture), (width, height))), file=out, flush=True)


def map_of(pair: Pair) -> str:
    """The map of a pair as a data: link, or "" (see `make_maps`)."""
    errors = flip_errors(read_picture(pair.reference), read_picture(pair.picture))
    return "" if errors is None else encoded(magma(errors), pair.size)


def flip_errors(reference: np.ndarray, picture: np.ndarray) -> np.ndarray | None:
    """(H, W) float32 of two (H, W, 3) uint8; None where FLIP has no answer."""
    from phrt_plugins.metrics.flip import flip_map

    try:
        return flip_map(reference, picture)
    except (ImportError, ValueError):
        return None


def read_picture(path: Path) -> np.ndarray:
    """(H, W, 3) uint8 of a PNG. Raises OptionError where it is not whole."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"))
    except OSError as error:
        raise OptionError(f"'{path}' cannot be read: {error}") from error


def size_of(path: Path) -> tuple[int, int]:
    """(width, height) of a PNG. Raises OptionError where it is none."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return image.size
    except OSError as error:
        raise OptionError(f"'{path}' cannot be read: {error}") from error


def encoded(picture: np.ndarray, size: tuple[int, int]) -> str:
    """(H, W, 3) uint8 as a data: link, made as large as `size` (width, height)."""
    from PIL import Image

    image = Image.fromarray(picture)
    if image.size != size:
        image = image.resize(size, Image.Resampling.LANCZOS)
    out = io.BytesIO()
    image.save(out, "WEBP", quality=QUALITY, method=3, lossless=math.prod(size) <= LOSSLESS_PIXELS)
    return "data:image/webp;base64," + base64.b64encode(out.getvalue()).decode("ascii")


def magma(errors: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: FLIP 0 to 1 in the colours that its authors show it in."""
    table = (magma_table() * 255 + 0.5).astype(np.uint8)
    return table[np.clip(errors * 255 + 0.5, 0, 255).astype(np.uint8)]


def magma_table() -> np.ndarray:
    """(256, 3) float64, sRGB 0 to 1."""
    from matplotlib import colormaps

    return np.asarray(colormaps["magma"](np.arange(256)))[:, :3]


def magma_stops(count: int = 9) -> str:
    """The colour bar, as stops of a CSS gradient."""
    rows = np.linspace(0, 255, count).round().astype(int)
    return ", ".join("#" + "".join(f"{round(part * 255):02x}" for part in magma_table()[row]) for row in rows)


if __name__ == "__main__":
    serve(sys.stdin, sys.stdout)
