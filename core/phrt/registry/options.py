"""Options of plugins: checking what was given, and saying what is allowed, from the one `Field` that defines each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from phrt.errors import OptionError, did_you_mean

Model = TypeVar("Model", bound=BaseModel)

BOUNDS = (("ge", ">="), ("gt", ">"), ("le", "<="), ("lt", "<"), ("multiple_of", "a multiple of"))


@dataclass(frozen=True)
class OptionRow:
    """One option as text. allowed: type, range or choices; default: as a config writes it, "required" if none; unit: of its number,
    empty where it has none."""

    name: str
    allowed: str
    default: str
    meaning: str
    unit: str = ""


def option_rows(model: type[BaseModel]) -> list[OptionRow]:
    """Every option of `model`, in the order of definition."""
    return [
        OptionRow(name, allowed_values(field), default_text(field), field.description or "", unit_text(field))
        for name, field in model.model_fields.items()
    ]


def validate_options(title: str, model: type[Model], given: Mapping[str, object] | BaseModel) -> Model:
    """`given` as an instance of `model`. Raises OptionError: `title`, each wrong option and what is allowed."""
    if isinstance(given, model):
        return given
    try:
        return model.model_validate(given.model_dump() if isinstance(given, BaseModel) else dict(given))
    except ValidationError as error:
        problems = [explain(model, dict(problem)) for problem in error.errors(include_url=False)]
    raise OptionError(f"{title}: {problems[0]}" if len(problems) == 1 else "\n  - ".join([f"{title}:", *problems]))


def explain(model: type[BaseModel], problem: dict[str, Any]) -> str:
    """One pydantic error as: option, what was given, what is allowed."""
    path = tuple(problem["loc"])
    name = ".".join(str(part) for part in path) or "options"
    field = model.model_fields.get(str(path[0])) if path else None
    if problem["type"] == "extra_forbidden" and len(path) == 1:
        known = list(model.model_fields)
        allowed = f"Its options: {', '.join(known)}." if known else "It has no options."
        return f"unknown option '{name}'. {allowed}{did_you_mean(name, known)}"
    if problem["type"] == "missing":
        return f"option '{name}' is required" + (f" ({allowed_values(field)})" if field else "")
    if field is None:
        return f"'{name}' is wrong: {problem['msg']}"
    given = problem["input"]
    near = did_you_mean(given, choices(field.annotation)) if isinstance(given, str) else ""
    reason = f" ({problem['msg'].removeprefix('Value error, ')})" if problem["type"] == "value_error" else ""
    return f"option '{name}' is {given!r}, allowed: {allowed_values(field)}{reason}{near and '.' + near}"


def allowed_values(field: FieldInfo) -> str:
    """Type, range and choices of an option, as text: "int >= 1 <= 64", "one of: none, probe"."""
    if found := choices(field.annotation):
        return "one of: " + ", ".join(found)
    bounds = [
        f"{sign} {getattr(constraint, attribute)}"
        for constraint in field.metadata
        for attribute, sign in BOUNDS
        if getattr(constraint, attribute, None) is not None
    ]
    return " ".join([type_text(field.annotation), *bounds])


def choices(annotation: object) -> list[str]:
    """What a Literal (or an optional one) allows; empty for other types."""
    if get_origin(annotation) is Literal:
        return [str(value) for value in get_args(annotation)]
    if get_origin(annotation) in (Union, UnionType):
        return [value for part in get_args(annotation) for value in choices(part)]
    return []


def default_text(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True, validated_data={})
    return "none" if value is None else str(value)


def unit_text(field: FieldInfo) -> str:
    """The unit that `json_schema_extra={"unit": "metres"}` gives an option; empty where it has none."""
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def type_text(annotation: object) -> str:
    """A type as a config's author would say it: "float", "int, int", "text", "float or none"."""
    names = {int: "int", float: "float", str: "text", bool: "true or false", type(None): "none"}
    if isinstance(annotation, type) and annotation in names:
        return names[annotation]
    parts = get_args(annotation)
    if get_origin(annotation) in (Union, UnionType):
        return " or ".join(type_text(part) for part in parts)
    if get_origin(annotation) in (tuple, list) and parts:
        return "[" + ", ".join("..." if part is Ellipsis else type_text(part) for part in parts) + "]"
    return getattr(annotation, "__name__", str(annotation))
