"""What is written on an overlay: names of objects, the legend, and the budget bar."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from phrt.frame import FrameResult

SMALLEST_LABELLED = 0.002
"""Share of the picture that an object covers at least to have its name written."""
SMALLEST_PICTURE = (160, 90)
"""Smaller ones get colours only: nothing would be legible."""
WHITE, DARK = (255, 255, 255), (12, 12, 14)


@dataclass(frozen=True)
class Bar:
    """The budget bar. taken, allowed: in `unit`, allowed +inf without a budget; parts: (name, share of `taken`)."""

    taken: float
    allowed: float
    unit: str
    rays_share: float

    @property
    def text(self) -> str:
        limit = f" of {amount(self.allowed, self.unit)}" if math.isfinite(self.allowed) else ", no budget"
        return f"{amount(self.taken, self.unit)}{limit}"


def annotate(pixels: np.ndarray, frame: FrameResult, effect: str) -> np.ndarray:
    """(H, W, 3) uint8: `pixels` with names, legend and budget bar. Pictures below 160x90 are returned as they are."""
    from PIL import Image, ImageDraw

    height, width = pixels.shape[:2]
    if width < SMALLEST_PICTURE[0] or height < SMALLEST_PICTURE[1]:
        return pixels
    picture = Image.fromarray(pixels)
    draw = ImageDraw.Draw(picture, "RGBA")
    size = max(9, round(height / 33))
    taken = [legend(draw, size, effect), budget_bar(draw, size, (width, height), budget_of(frame))]
    names(draw, max(8, round(height / 38)), frame, taken)
    return np.asarray(picture)


def font(size: int) -> Any:
    """Pillow's own font, so that pictures are the same on every machine."""
    from PIL import ImageFont

    return ImageFont.load_default(size)


def legend(draw: Any, size: int, effect: str) -> tuple[int, int, int, int]:
    """The colours and what they mean, top left. Returns the box that it takes (left, top, right, bottom)."""
    from phrt.overlay import COLORS, LABELS

    letters = font(size)
    title = "all effects" if effect == "all" else effect
    rows = [(title, None), *((label, kind) for kind, label in enumerate(LABELS) if label)]
    step, pad = round(size * 1.35), max(3, size // 3)
    wide = max(round(letters.getlength(text)) + (0 if kind is None else step) for text, kind in rows)
    box = (pad, pad, pad * 3 + wide, pad * 2 + step * len(rows) + pad)
    draw.rectangle(box, fill=(*DARK, 175))
    for number, (text, kind) in enumerate(rows):
        left, top = pad * 2, pad * 2 + number * step
        if kind is not None:
            swatch = (left, top + 1, left + size, top + 1 + size)
            if kind < len(COLORS):
                draw.rectangle(swatch, fill=tuple(int(c) for c in COLORS[kind]))
            else:
                draw.rectangle(swatch, outline=WHITE)
                for offset in range(3, 2 * size, 4):
                    start, end = max(0, offset - size), min(offset, size)
                    draw.line((left + start, top + 1 + offset - start, left + end, top + 1 + offset - end), fill=WHITE)
            left += step
        draw.text((left, top), text, font=letters, fill=WHITE)
    return box


def budget_of(frame: FrameResult) -> Bar:
    """What the frame took against what it might take, in its budget's unit."""
    total = frame.milliseconds
    rays_ms = frame.stages.get("rays", 0.0)
    share = rays_ms / total if total > 0 else 0.0
    match frame.budget.kind:
        case "frame_ms":
            return Bar(frame.clock_ms or total, frame.budget.amount, "ms", share)
        case "ray_ms":
            return Bar(frame.decisions.ray_ms, frame.budget.amount, "ms", 1.0)
        case "rays":
            return Bar(
                float(sum(n for kind, n in frame.rays.items() if kind != "primary")), frame.budget.amount, "rays", 1.0
            )
        case _:
            return Bar(total, math.inf, "ms", share)


def amount(value: float, unit: str) -> str:
    """A number with its unit, in few characters."""
    if unit == "ms":
        return f"{value:.1f} ms"
    return f"{value / 1e6:.2f} M rays" if value >= 1e6 else f"{value / 1e3:.0f} k rays"


def budget_bar(draw: Any, size: int, picture: tuple[int, int], bar: Bar) -> tuple[int, int, int, int]:
    """Along the lower edge: what was taken, its ray phase in a lighter shade, and a mark where the budget ends. Returns its box."""
    from phrt.overlay import COLORS, SKIPPED, TRACED

    width, height = picture
    pad, letters = max(3, size // 3), font(size)
    words = round(letters.getlength("00000.0 ms of 00000.0 ms"))
    box = (pad, height - pad * 3 - size, width - pad, height - pad)
    draw.rectangle(box, fill=(*DARK, 175))
    left, right = box[0] + pad * 2 + words, box[2] - pad
    top, bottom = box[1] + pad, box[3] - pad
    full = 1.25 * max(bar.allowed if math.isfinite(bar.allowed) else 0.0, 1e-9)
    if not math.isfinite(bar.allowed):
        full = max(bar.taken, 1e-9)
    reach = left + round((right - left) * min(bar.taken / full, 1.0))
    color = tuple(int(c) for c in COLORS[TRACED if bar.taken <= bar.allowed else SKIPPED])
    draw.rectangle((left, top, max(reach, left), bottom), fill=color)
    lighter = tuple((c + 255) // 2 for c in color)
    draw.rectangle((reach - round((reach - left) * bar.rays_share), top, max(reach, left), bottom), fill=lighter)
    if math.isfinite(bar.allowed):
        mark = left + round((right - left) * bar.allowed / full)
        draw.rectangle((mark, box[1], mark + max(1, size // 8), box[3]), fill=WHITE)
    draw.text((box[0] + pad, box[1] + pad - 1), bar.text, font=letters, fill=WHITE)
    return box


def names(draw: Any, size: int, frame: FrameResult, taken: list[tuple[int, int, int, int]]) -> None:
    """Names of objects at their centres, largest object first; one that would lie on another is left out."""
    letters = font(size)
    for object_id, x, y in centres(frame.gbuffer.object_id, frame.world.object_count):
        text = frame.world.scene.objects[object_id - 1].path.rpartition("/")[2]
        left, top, right, bottom = draw.textbbox((x, y), text, font=letters, anchor="mm")
        box = (left - 2, top - 2, right + 2, bottom + 2)
        height, width = frame.gbuffer.object_id.shape
        if box[0] < 0 or box[1] < 0 or box[2] > width or box[3] > height or any(overlap(box, other) for other in taken):
            continue
        taken.append(box)
        draw.text((x, y), text, font=letters, fill=WHITE, anchor="mm", stroke_width=max(1, size // 8), stroke_fill=DARK)


def overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    """Do two boxes (left, top, right, bottom) have a pixel in common?"""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def centres(object_id: np.ndarray, count: int) -> list[tuple[int, int, int]]:
    """(object, x, y) of objects that cover enough of the picture, largest first; each point is a pixel of its object.

    object_id: (H, W); count: objects of the scene.
    """
    height, width = object_id.shape
    flat = object_id.reshape(-1).astype(np.int64)
    pixels = np.bincount(flat, minlength=count + 1)
    x = np.bincount(flat, weights=np.tile(np.arange(width), height), minlength=count + 1)
    y = np.bincount(flat, weights=np.repeat(np.arange(height), width), minlength=count + 1)
    share = np.maximum(pixels, 1)
    away = (np.tile(np.arange(width), height) - (x / share)[flat]) ** 2
    away += (np.repeat(np.arange(height), width) - (y / share)[flat]) ** 2
    nearest = np.full(count + 1, np.inf)
    np.minimum.at(nearest, flat, away)
    place = np.zeros(count + 1, np.int64)
    candidates = np.flatnonzero(away == nearest[flat])[::-1]
    place[flat[candidates]] = candidates
    large = [i for i in np.argsort(-pixels, kind="stable").tolist() if i and pixels[i] >= SMALLEST_LABELLED * len(flat)]
    return [(number, int(place[number] % width), int(place[number] // width)) for number in large]
