"""pydantic's findings in the scene's words: place, what was given, what is allowed, did you mean."""

from __future__ import annotations

from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from phrt.description.problems import ELSEWHERE, Problems, listed
from phrt.description.values import Value
from phrt.errors import did_you_mean

ModelT = TypeVar("ModelT", bound=BaseModel)

_WANTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "list_type": "a list",
    "tuple_type": "a list of numbers",
    "dict_type": "a mapping",
    "mapping_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "finite_number": "a finite number",
    "int_from_float": "a whole number",
}


def validated(model: type[ModelT], value: Value, path: str, problems: Problems) -> ModelT | None:
    """`value` as a `model`, or None with every fault added to `problems`."""
    try:
        return model.model_validate(value.plain())
    except ValidationError as error:
        for fault in error.errors(include_url=False):
            _add(model, value, path, dict(fault), problems)
        return None


def _add(model: type[BaseModel], value: Value, path: str, fault: dict[str, Any], problems: Problems) -> None:
    location = tuple(fault["loc"])
    kind = fault["type"]
    inside = tuple(step for step in location if step != "[key]")
    mark = value.mark_of(inside)
    where = _spelled(inside)
    if kind == "extra_forbidden":
        allowed = _keys_at(model, inside[:-1])
        unknown = str(inside[-1])
        holder = f" in '{_spelled(inside[:-1])}'" if inside[:-1] else ""
        message = f"unknown key '{unknown}'{holder}; allowed: {listed(allowed)}.{did_you_mean(unknown, allowed)}"
        problems.add(mark, path, ELSEWHERE.get(unknown, message) if path.startswith("/") else message)
    elif kind == "missing":
        if inside and isinstance(inside[-1], int):
            problems.add(mark, path, f"'{_spelled(inside[:-1])}' has too few entries: entry {inside[-1]} is missing")
        else:
            problems.add(mark, path, f"the key '{where}' is missing")
    elif kind == "literal_error":
        allowed = [part.strip().strip("'") for part in str(fault["ctx"]["expected"]).replace(" or ", ", ").split(", ")]
        given = fault["input"]
        problems.add(
            mark,
            path,
            f"{where}: given {_shown(given)}; allowed: {', '.join(allowed)}.{did_you_mean(str(given), allowed)}",
        )
    elif kind == "value_error":
        problems.add(mark, path, f"{where}: {fault['ctx']['error']}" if where else str(fault["ctx"]["error"]))
    else:
        wanted = _WANTED.get(kind)
        message = f"wanted {wanted}" if wanted else _lowered(fault["msg"])
        problems.add(mark, path, f"{where or 'the prim'}: given {_shown(fault['input'])}; {message}")


def _keys_at(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Attribute names allowed in the part of `model` at `location`."""
    current: type[BaseModel] = model
    for step in location:
        if isinstance(step, int) or step not in current.model_fields:
            continue
        nested = _model_in(current.model_fields[step].annotation)
        if nested is None:
            break
        current = nested
    return list(current.model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The first pydantic model inside a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in get_args(annotation) if (found := _model_in(part)) is not None), None)


def _spelled(location: tuple[int | str, ...]) -> str:
    """("keys", 0, "time") as keys[0].time."""
    text = ""
    for step in location:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else str(step)
    return text


def _shown(given: Any) -> str:
    """A value in a message, cut where long."""
    text = f"'{given}'" if isinstance(given, str) else "nothing" if given is None else repr(given)
    return text if len(text) <= 80 else text[:77] + "..."


def _lowered(message: str) -> str:
    return message[:1].lower() + message[1:]
