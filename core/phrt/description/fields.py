"""Types of scene values: strict (no text for numbers), finite, and short where a short form is natural."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import AfterValidator, AllowInfNan, BaseModel, BeforeValidator, ConfigDict, Field, Strict, WithJsonSchema

from phrt.budget import parse_budget
from phrt.errors import OptionError

PRIM_NAME = re.compile(r"[^\s/.:{}\[\],'\"*&#|>%@`=]+$")
"""A prim's name: anything readable without the characters that paths, overrides and YAML use."""


class Described(BaseModel):
    """Base of every part of a scene description."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _triple(value: Any) -> Any:
    return [value, value, value] if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def _situations(value: Any) -> Any:
    return {"default": value} if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def _clean_path(value: str) -> str:
    if not value.startswith("/") or value.endswith("/") or "//" in value:
        raise ValueError("a prim path starts with '/', as in /World/Lamp")
    return value


def _not_huge(value: float) -> float:
    if abs(value) > LARGEST:
        raise ValueError(f"given {value:g}; at most {LARGEST:g} in size")
    return value


def _budget(value: Any) -> Any:
    try:
        return str(parse_budget(value))
    except OptionError as error:
        raise ValueError(str(error)) from None


LARGEST = 1e18
"""Beyond this, squares of numbers do not fit single precision."""

Real = Annotated[float, Strict(), AllowInfNan(False), AfterValidator(_not_huge)]
RealOrInf = Annotated[float, Strict()]
Flag = Annotated[bool, Strict()]
Text = Annotated[str, Field(min_length=1, max_length=4096)]
Whole = Annotated[int, Strict()]
Positive = Annotated[Real, Field(gt=0)]
NotNegative = Annotated[Real, Field(ge=0)]
Unit = Annotated[Real, Field(ge=0, le=1)]
Pair = tuple[Real, Real]
Triple = tuple[Real, Real, Real]
Quaternion = tuple[Real, Real, Real, Real]
Row = tuple[Real, Real, Real, Real]
Matrix = tuple[Row, Row, Row, Row]
BudgetText = Annotated[str, BeforeValidator(_budget), WithJsonSchema({"type": "string"})]
"""A budget, as `phrt.budget.parse_budget` reads it."""
PrimPath = Annotated[Text, AfterValidator(_clean_path)]
"""An absolute path of a prim."""

_NUMBER_OR_THREE = {
    "anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}]
}
Scale = Annotated[Triple, BeforeValidator(_triple), WithJsonSchema(_NUMBER_OR_THREE)]
"""Three numbers, or one for all three axes."""

Color = Annotated[
    tuple[NotNegative, NotNegative, NotNegative], BeforeValidator(_triple), WithJsonSchema(_NUMBER_OR_THREE)
]
"""Linear Rec.709 RGB, or one number for a grey."""

Importance = Annotated[
    dict[Text, NotNegative],
    BeforeValidator(_situations),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "number", "minimum": 0},
                {"type": "object", "additionalProperties": {"type": "number", "minimum": 0}},
            ]
        }
    ),
]
"""One number, or one per situation with `default` for the others."""
