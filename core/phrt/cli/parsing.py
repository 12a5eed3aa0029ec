"""Text of the command line into values. Every function raises OptionError: what was given, what is allowed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from phrt.controls import checked_attention, not_negative
from phrt.errors import OptionError
from phrt.limits import MAX_PIXELS, MAX_SIDE, MOST_FRAMES


@dataclass(frozen=True)
class FrameRange:
    """Frames `first` to `stop`, `stop` not included."""

    first: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.first


def parse_size(text: str) -> tuple[int, int]:
    """ "1280x720" as (width, height) in pixels, each 1 to 16384, together at most 8192 x 8192."""
    match = re.fullmatch(r"(\d{1,6})[xX](\d{1,6})", text.strip())
    if not match:
        raise OptionError(f"--size is '{text}', expected WIDTHxHEIGHT in pixels, as in 1280x720")
    size = int(match[1]), int(match[2])
    if not all(1 <= side <= MAX_SIDE for side in size):
        raise OptionError(f"--size is '{text}', allowed: 1 to {MAX_SIDE} pixels a side")
    if size[0] * size[1] > MAX_PIXELS:
        raise OptionError(
            f"--size is '{text}', {size[0] * size[1]:,} pixels; allowed: at most {MAX_PIXELS:,} (8192x8192)"
        )
    return size


def parse_frames(text: str) -> FrameRange:
    """ "A:B" as the frames A to B - 1, "A" as frame A alone."""
    match = re.fullmatch(r"(\d{1,9})(?::(\d{1,9}))?", text.strip())
    if not match:
        raise OptionError(
            f"--frames is '{text}', expected FIRST:STOP (STOP not included), as in 0:300, or one frame, as in 20"
        )
    first = int(match[1])
    stop = int(match[2]) if match[2] else first + 1
    if not 1 <= stop - first <= MOST_FRAMES:
        raise OptionError(f"--frames is '{text}', expected FIRST below STOP and at most {MOST_FRAMES} frames")
    return FrameRange(first, stop)


def parse_value(text: str) -> object:
    """`text` as YAML would read it: 4, 0.5, true, [1, 2], none of them: text."""
    import yaml

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise OptionError(f"'{text}' is not a value: {getattr(error, 'problem', None) or error}") from error


def parse_effects(assignments: Iterable[str]) -> dict[str, dict[str, object]]:
    """Every "EFFECT.OPTION=VALUE" of `--effect`, as options by effect."""
    effects: dict[str, dict[str, object]] = {}
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        effect, dot, option = key.strip().partition(".")
        if not (equals and effect and dot and option):
            raise OptionError(f"--effect is '{assignment}', expected EFFECT.OPTION=VALUE, as in shadows.samples=4")
        effects.setdefault(effect, {})[option] = parse_value(value)
    return effects


def parse_heuristic_options(assignments: Iterable[str]) -> dict[str, object]:
    """Every "OPTION=VALUE" of `-H`."""
    return parse_assignments("-H", assignments, "OPTION=VALUE, as in seed=3")


def parse_controls(attention: list[str], view_speed: float | None, parameters: list[str]) -> dict[str, object]:
    """The controls that were given, by name: what `Renderer.control` takes."""
    given: dict[str, object] = {}
    if attention:
        factors = parse_assignments("--attention", attention, "TAG=FACTOR, as in gold=3")
        given["attention"] = checked_attention(factors, "--attention")
    if view_speed is not None:
        given["view_speed"] = not_negative("--view-speed", view_speed)
    if parameters:
        given["parameters"] = parse_assignments("--parameter", parameters, "NAME=VALUE, as in hurry=0.5")
    return given


def parse_assignments(option: str, assignments: Iterable[str], expected: str) -> dict[str, object]:
    """Every "KEY=VALUE" of `option`, values as YAML reads them."""
    values: dict[str, object] = {}
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not (equals and key.strip()):
            raise OptionError(f"{option} is '{assignment}', expected {expected}")
        values[key.strip()] = parse_value(value)
    return values


def parse_camera(text: str) -> int | str:
    """A camera's number or its path."""
    return int(text) if re.fullmatch(r"\d{1,6}", text) else text


def check_number(option: str, value: float, low: float, high: float) -> float:
    """`value`, when it is a finite number within `low` to `high`."""
    if not (math.isfinite(value) and low <= value <= high):
        raise OptionError(f"{option} is {value:g}, allowed: {low:g} to {high:g}")
    return value
