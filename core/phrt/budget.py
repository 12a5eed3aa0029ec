"""Budget: how much ray tracing a frame may take, and how that is written."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from phrt.errors import OptionError

EXPECTED = "expected a number of rays, as in 200000rays, or none"


@dataclass(frozen=True)
class Budget:
    """What a frame's ray phase may take. rays: secondary rays, 0 or more; +inf for no limit."""

    rays: float = math.inf


UNLIMITED = Budget()


def parse_budget(given: str | Budget | None, name: str = "budget") -> Budget:
    """ "200000rays" (digits may be grouped: 200_000rays), "none" or None. 0rays is allowed and traces nothing.

    Raises OptionError that calls the option `name`.
    """
    if given is None:
        return UNLIMITED
    if isinstance(given, Budget):
        if math.isnan(given.rays) or given.rays < 0:
            raise OptionError(f"{name} is {given.rays} rays; it must be 0 or more")
        return given
    if not isinstance(given, str):
        raise OptionError(f"{name} is {given!r} without a unit, {EXPECTED}")
    text = given.strip().lower()
    if text == "none":
        return UNLIMITED
    match = re.fullmatch(r"([-+]?)([\d_]*\.?\d*(?:e[-+]?\d+)?)\s*([a-z]*)", text)
    if not match or not re.search(r"\d", match[2]):
        raise OptionError(f"{name} is '{given}', {EXPECTED}")
    sign, digits, unit = match.groups()
    if sign == "-":
        raise OptionError(f"{name} is '{given}'; it must be 0 or more, {EXPECTED}")
    if unit in ("ms", "s", "us"):
        raise OptionError(f"{name} is '{given}', but budgets of time are not available yet, {EXPECTED}")
    if unit not in ("ray", "rays"):
        raise OptionError(f"{name} is '{given}' {f'with unit {unit!r}' if unit else 'without a unit'}, {EXPECTED}")
    if not re.fullmatch(r"\d+(_\d+)*", digits) or len(digits) > 18:
        raise OptionError(f"{name} is '{given}'; rays are counted in whole numbers of at most 18 digits, {EXPECTED}")
    return Budget(float(digits))
