"""Budget: how much ray tracing a frame may take, and how that is written."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from phrt.errors import OptionError

BudgetKind = Literal["none", "rays", "ray_ms", "frame_ms"]
"""No limit; secondary rays; milliseconds of the ray phase; milliseconds of the whole frame."""

EXPECTED = "expected a frame time (50ms), a time for the ray phase (rays:20ms), a number of rays (200000rays), or none"
_TO_MS = {"us": 1e-3, "ms": 1.0, "s": 1e3}
LONGEST_MS = 3.6e6
"""An hour: whoever has more time needs no budget."""


@dataclass(frozen=True)
class Budget:
    """What a frame may take: `amount` rays or milliseconds, as `kind` says; +inf for no limit."""

    amount: float = math.inf
    kind: BudgetKind = "none"

    def __str__(self) -> str:
        """As `parse_budget` reads it."""
        match self.kind:
            case "none":
                return "none"
            case "rays":
                return f"{self.amount:.0f}rays"
            case "ray_ms":
                return f"rays:{self.amount:g}ms"
            case "frame_ms":
                return f"{self.amount:g}ms"


UNLIMITED = Budget()


def parse_budget(given: object, name: str = "budget") -> Budget:
    """ "50ms" (also frame:50ms, 0.05s) is a time for the whole frame, "rays:20ms" one for its ray phase, "200000rays" (digits
    may be grouped: 200_000rays) a number of rays, "none" and None no limit. Nothing is traced with 0rays and rays:0ms. A Budget
    is itself.

    Raises OptionError that calls the option `name`.
    """
    if given is None:
        return UNLIMITED
    if isinstance(given, Budget):
        return _checked(given, name, f"{given.amount:g} {given.kind}")
    if not isinstance(given, str):
        raise OptionError(f"{name} is {given!r} without a unit, {EXPECTED}")
    text = given.strip().lower()
    if text == "none":
        return UNLIMITED
    match = re.fullmatch(r"(?:(frame|rays):)?\s*([-+]?)(inf(?:inity)?|[\d_]*\.?\d*(?:e[-+]?\d+)?)\s*([a-z]*)", text)
    if not match or not re.search(r"\d|inf", match[3]):
        raise OptionError(f"{name} is '{given}', {EXPECTED}")
    part, sign, digits, unit = match.groups()
    if sign == "-":
        raise OptionError(f"{name} is '{given}'; it must be 0 or more, {EXPECTED}")
    if digits.startswith("inf"):
        raise OptionError(f"{name} is '{given}'; for no limit write none")
    if unit in _TO_MS:
        amount = float(digits.replace("_", "")) * _TO_MS[unit]
        return _checked(Budget(amount, "ray_ms" if part == "rays" else "frame_ms"), name, f"'{given}'")
    if unit not in ("ray", "rays") or part:
        raise OptionError(f"{name} is '{given}' {f'with unit {unit!r}' if unit else 'without a unit'}, {EXPECTED}")
    if not re.fullmatch(r"\d+(_\d+)*", digits) or len(digits) > 18:
        raise OptionError(f"{name} is '{given}'; rays are counted in whole numbers of at most 18 digits, {EXPECTED}")
    return Budget(float(digits), "rays")


def _checked(budget: Budget, name: str, given: str) -> Budget:
    """`budget`, when its amount can be kept to."""
    if budget.kind == "none":
        return UNLIMITED
    if math.isnan(budget.amount) or budget.amount < 0:
        raise OptionError(f"{name} is {given}; it must be 0 or more")
    if math.isinf(budget.amount):
        raise OptionError(f"{name} is {given}; for no limit write none")
    if budget.kind == "frame_ms" and budget.amount == 0:
        raise OptionError(f"{name} is {given}; a frame takes some time, so it must be above 0 (0rays traces nothing)")
    if budget.kind in ("ray_ms", "frame_ms") and budget.amount > LONGEST_MS:
        raise OptionError(f"{name} is {given}; allowed: at most an hour, or none")
    return budget
