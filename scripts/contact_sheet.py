"""Renders every glTF file under a folder and puts the pictures on one sheet, with names.

What cannot be rendered gets a red tile with the reason, and the exit status is 1. Example::

    python scripts/contact_sheet.py /path/to/scenes/gltf -o contact_sheet.png --size 320x240
"""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import phrt
from phrt.output.images import write_png
from phrt.output.tonemap import to_8bit

SUFFIXES = (".gltf", ".glb")
CAPTION = 18
"""Height of a tile's name, pixels."""
MARGIN = 6


@dataclass(frozen=True)
class Tile:
    """A model on the sheet. pixels (H, W, 3) uint8; failure: why there is no picture; warnings: what it lacks."""

    name: str
    pixels: np.ndarray
    failure: str | None = None
    warnings: tuple[str, ...] = ()


def find_models(folder: Path) -> list[Path]:
    """Every glTF file below `folder`, by name. Raises OptionError when there is none."""
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    if not found:
        raise phrt.OptionError(f"{folder}: no {' or '.join(SUFFIXES)} file below it")
    return found


def render_tile(path: Path, name: str, size: tuple[int, int], aa: int, heuristic: str, gbuffer: str = "auto") -> Tile:
    """The model framed and lit by default, or with its own camera; a red tile where that fails."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", phrt.PhrtWarning)
        try:
            scene = phrt.load_scene(path)
            with phrt.Renderer(scene, size=size, heuristic=heuristic, aa=aa, gbuffer=gbuffer) as renderer:
                image = renderer.render(time=0.0).image
        except Exception as error:  # the sheet shows whatever went wrong, and goes on
            return Tile(name, failure_picture(size, error), f"{type(error).__name__}: {error}")
    if not np.isfinite(image).all():
        return Tile(name, failure_picture(size, "NaN or Inf in the picture"), "NaN or Inf in the picture")
    notes = tuple(str(w.message) for w in caught if issubclass(w.category, phrt.PhrtWarning))
    return Tile(name, to_8bit(image, "neutral"), warnings=notes)


def failure_picture(size: tuple[int, int], reason: object) -> np.ndarray:
    """(H, W, 3) uint8: the reason on red."""
    picture = Image.new("RGB", size, (120, 20, 20))
    columns = max(10, size[0] // 7)
    lines = textwrap.wrap(str(reason), columns)[: max(1, size[1] // 14)]
    ImageDraw.Draw(picture).multiline_text(
        (6, 6), "\n".join(lines), fill=(255, 255, 255), font=ImageFont.load_default()
    )
    return np.asarray(picture)


def make_sheet(tiles: list[Tile], columns: int) -> np.ndarray:
    """(H, W, 3) uint8: the tiles in rows, each over its name; an asterisk marks pictures with warnings."""
    height, width = tiles[0].pixels.shape[:2]
    rows = -(-len(tiles) // columns)
    step_x, step_y = width + MARGIN, height + CAPTION + MARGIN
    sheet = Image.new("RGB", (columns * step_x + MARGIN, rows * step_y + MARGIN), (32, 32, 36))
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default()
    for index, tile in enumerate(tiles):
        x, y = MARGIN + index % columns * step_x, MARGIN + index // columns * step_y
        sheet.paste(Image.fromarray(np.ascontiguousarray(tile.pixels[..., :3])), (x, y))
        color = (255, 110, 100) if tile.failure else (230, 230, 230)
        draw.text(
            (x + 2, y + height + 2), shortened(tile.name, width // 6) + (" *" if tile.warnings else ""), color, font
        )
    return np.asarray(sheet)


def shortened(name: str, length: int) -> str:
    """The end of a name that is too long: it tells files apart."""
    return name if len(name) <= length else "..." + name[3 - length :]


def tile_name(path: Path, folder: Path) -> str:
    """The path below the folder, in ASCII, which the built-in font has."""
    return path.relative_to(folder).as_posix().encode("ascii", "replace").decode()


def parse_size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"'{text}' is not a size; allowed: WIDTHxHEIGHT, as 320x240")
    return int(width), int(height)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Render every glTF file under a folder onto one sheet.")
    parser.add_argument("folder", type=Path, help="where the glTF files are")
    parser.add_argument("-o", "--output", type=Path, default=Path("contact_sheet.png"), help="the sheet, a PNG")
    parser.add_argument("--size", type=parse_size, default=(320, 240), help="of each picture, WIDTHxHEIGHT")
    parser.add_argument("--columns", type=int, default=6, help="pictures in a row")
    parser.add_argument("--aa", type=int, default=4, help="samples per pixel")
    parser.add_argument("--heuristic", default="all_trace", help="who decides what is traced")
    parser.add_argument("--gbuffer", default="auto", help="who finds what is seen: raycast, moderngl, auto")
    parser.add_argument("--only", default="", help="only files whose path contains this text")
    options = parser.parse_args(arguments)
    try:
        models = [path for path in find_models(options.folder) if options.only in path.as_posix()]
        if not models:
            raise phrt.OptionError(f"--only '{options.only}': no file's path contains it")
    except phrt.InputError as error:
        print(error, file=sys.stderr)
        return 2
    tiles = []
    for number, path in enumerate(models, start=1):
        started = time.perf_counter()
        name = tile_name(path, options.folder)
        tile = render_tile(path, name, options.size, options.aa, options.heuristic, options.gbuffer)
        tiles.append(tile)
        state = tile.failure or f"{time.perf_counter() - started:.1f} s"
        print(f"[{number}/{len(models)}] {tile.name}: {state}", file=sys.stderr)
        for note in tile.warnings:
            print(f"    warning: {note}", file=sys.stderr)
    write_png(options.output, make_sheet(tiles, max(1, options.columns)))
    failed = [tile for tile in tiles if tile.failure]
    print(f"{options.output}: {len(tiles) - len(failed)} pictures, {len(failed)} failures", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
