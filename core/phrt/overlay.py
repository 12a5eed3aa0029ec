"""Overlay: a frame's picture, tinted by what was ray traced, with names, a legend and the budget.

    pixels = phrt.overlay.overlay(frame)                  all effects together
    pixels = phrt.overlay.overlay(frame, "reflections")   one of them

Of one effect, a pixel is TRACED where its item was traced whole, PARTLY where its item was traced in part (gaps are filled from
traced neighbours or an earlier frame), EARLIER where values of an earlier frame stand in, and SKIPPED where the effect
applies and its fallback shows. Of all effects together it is TRACED where all that apply were traced, SKIPPED where none
brought anything, EARLIER where none is missing but some are of an earlier frame, and PARTLY otherwise. Pixels to which no
effect applies stay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phrt.errors import OptionError, did_you_mean
from phrt.frame import MASK_FALLBACK, MASK_HISTORY, MASK_NONE
from phrt.output.tonemap import to_8bit

if TYPE_CHECKING:
    from phrt.frame import FrameResult

ALL = "all"
UNTOUCHED, TRACED, PARTLY, EARLIER, SKIPPED = range(5)
"""What a pixel is."""
COLORS = np.array([[0, 0, 0], [40, 170, 70], [235, 195, 30], [60, 120, 235], [210, 50, 45]], np.uint8)
"""(5, 3) sRGB. Traced and skipped differ in lightness too, for those who cannot tell red from green."""
STRENGTH = np.array([0.0, 0.45, 0.5, 0.5, 0.5], np.float32)
"""(5,) share of the tint in a pixel."""
LABELS = ("", "traced", "partly traced", "earlier frame", "skipped", "mandatory")
HATCH_PERIOD = 9
"""Pixels from one line of the hatching to the next, at 360 rows."""


def overlay(frame: FrameResult, effect: str | None = None, *, tone_map: str = "neutral") -> np.ndarray:
    """(H, W, 3) uint8 sRGB: the picture of `frame`, tinted. effect: one effect's name; None or "all" for all together.

    Items have an outline, mandatory ones are hatched. Raises OptionError for an effect that the frame has not.
    """
    from phrt.output.annotate import annotate

    kinds = pixel_kinds(frame, effect)
    pixels = tinted(to_8bit(frame.image, tone_map), kinds)
    hatch(pixels, mandatory_pixels(frame, effect))
    outline(pixels, frame.gbuffer.object_id)
    return annotate(pixels, frame, effect or ALL)


def chosen_effects(known: list[str], effect: str | None) -> list[str]:
    """Those of `known` that `effect` names: one, with "shadows" all of "shadows@LIGHT", with "all" or None every one.

    Raises OptionError where there is none.
    """
    if effect in (None, ALL):
        return known
    chosen = [name for name in known if effect in (name, name.partition("@")[0])]
    if not chosen:
        allowed = list(dict.fromkeys([ALL, *(name.partition("@")[0] for name in known)]))
        raise OptionError(
            f"overlay of '{effect}': allowed are {', '.join(allowed)}.{did_you_mean(str(effect), allowed)}"
        )
    return chosen


def pixel_kinds(frame: FrameResult, effect: str | None = None) -> np.ndarray:
    """(H, W) uint8: UNTOUCHED, TRACED, PARTLY, EARLIER or SKIPPED. Raises OptionError for an unknown effect."""
    each = [effect_kinds(frame, name) for name in chosen_effects(list(frame.effect_layers), effect)]
    return together(each) if each else np.zeros(frame.image.shape[:2], np.uint8)


def effect_kinds(frame: FrameResult, effect: str) -> np.ndarray:
    """(H, W) uint8, what the pixels are to one effect."""
    items = items_of(frame, effect)
    object_id = frame.gbuffer.object_id
    mask = frame.masks[frame.effect_layers[effect]]
    kinds = np.where(mask == MASK_HISTORY, np.uint8(EARLIER), np.uint8(TRACED))
    kinds[items.partial[object_id]] = PARTLY
    kinds[mask == MASK_FALLBACK] = SKIPPED
    # A fallback of `none` leaves no mark. Where nothing of an item that was not traced whole shows another, that is what it took;
    # elsewhere the effect does not apply to such pixels.
    marks = np.zeros(len(items.exists), bool)
    marks[object_id[mask == MASK_FALLBACK]] = True
    bare = items.exists & ~items.whole & ~marks
    kinds[mask == MASK_NONE] = UNTOUCHED
    kinds[(mask == MASK_NONE) & bare[object_id]] = SKIPPED
    return kinds


@dataclass(frozen=True)
class Items:
    """The items of an effect by object, (N + 1,) bool each: is there one, was it traced whole, in part, is it mandatory."""

    exists: np.ndarray
    whole: np.ndarray
    partial: np.ndarray
    mandatory: np.ndarray


def items_of(frame: FrameResult, effect: str) -> Items:
    """The items that trace `effect`: its own, or those of all effects together."""
    candidates, decisions = frame.decisions.candidates, frame.decisions
    mine = [index for index, name in enumerate(candidates.effect_names) if name in (effect, ALL)]
    rows = np.flatnonzero(np.isin(candidates.effect, mine))
    objects = candidates.object_id[rows]
    exists, begun, lacking, mandatory = (np.zeros(frame.world.object_count + 1, bool) for _ in range(4))
    exists[objects] = True
    begun[objects[decisions.chosen[rows]]] = True
    lacking[objects[~is_whole(frame)[rows]]] = True
    mandatory[objects[candidates.mandatory[rows]]] = True
    return Items(exists, exists & ~lacking, begun & lacking, mandatory)


def is_whole(frame: FrameResult) -> np.ndarray:
    """(n,) bool: was every pixel of the item traced?"""
    return np.asarray(frame.decisions.traced_pixels >= frame.decisions.candidates.pixel_count)


def together(each: list[np.ndarray]) -> np.ndarray:
    """(H, W) uint8, several effects' kinds as one; the rule is on top of this file."""
    some = {kind: np.any([kinds == kind for kinds in each], axis=0) for kind in (TRACED, PARTLY, EARLIER, SKIPPED)}
    kinds = np.full(each[0].shape, PARTLY, np.uint8)
    brought = some[TRACED] | some[PARTLY] | some[EARLIER]
    kinds[some[EARLIER] & ~some[SKIPPED] & ~some[PARTLY]] = EARLIER
    kinds[some[SKIPPED] & ~brought] = SKIPPED
    kinds[some[TRACED] & ~(some[PARTLY] | some[EARLIER] | some[SKIPPED])] = TRACED
    kinds[~brought & ~some[SKIPPED]] = UNTOUCHED
    return kinds


def mandatory_pixels(frame: FrameResult, effect: str | None) -> np.ndarray:
    """(H, W) bool: objects with a mandatory item of `effect`, or of any."""
    objects = np.zeros(frame.world.object_count + 1, bool)
    for name in chosen_effects(list(frame.effect_layers), effect):
        objects |= items_of(frame, name).mandatory
    return objects[frame.gbuffer.object_id]


def tinted(pixels: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: `pixels` in half their colour, mixed with the colour of their kind. UNTOUCHED ones stay."""
    grey = pixels.astype(np.float32) @ np.array([0.299, 0.587, 0.114], np.float32)
    touched = (kinds != UNTOUCHED)[:, :, None]
    faded = np.where(touched, (pixels + grey[:, :, None]) / 2, pixels)
    strength = STRENGTH[kinds][:, :, None]
    mixed = faded * (1 - strength) + COLORS[kinds] * strength
    return (mixed + 0.5).astype(np.uint8)


def outline(pixels: np.ndarray, object_id: np.ndarray) -> None:
    """Darken, in place, the pixels whose right or lower neighbour belongs to another object."""
    edge = np.zeros(object_id.shape, bool)
    edge[:, :-1] |= object_id[:, 1:] != object_id[:, :-1]
    edge[:-1] |= object_id[1:] != object_id[:-1]
    pixels[edge] //= 3


def hatch(pixels: np.ndarray, mandatory: np.ndarray) -> None:
    """Light diagonal lines, in place, over `mandatory` (H, W) bool."""
    height, width = mandatory.shape
    period = max(5, round(HATCH_PERIOD * height / 360))
    across = (np.arange(width)[None, :] + np.arange(height)[:, None]) % period < max(1, period // 8)
    lines = across & mandatory
    pixels[lines] = (pixels[lines].astype(np.uint16) + 255) // 2
