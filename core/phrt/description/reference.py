"""The attribute tables of docs/scene_format.md, made from the models: `python -m phrt.description.reference FILE`
writes them between the page's markers."""

from __future__ import annotations

import re
import sys
import types
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from phrt.description.fields import BudgetText
from phrt.description.prims import (
    PRIM_TYPES,
    Animation,
    CameraKey,
    CameraPath,
    CameraPrim,
    Cone,
    Key,
    LookAt,
    MaterialPrim,
    MeshPrim,
    PrimBase,
    SphereLightPrim,
    Split,
    Texture,
    TrackKey,
    Xform,
)

BEGIN, END = "<!-- tables: begin -->\n", "<!-- tables: end -->"
PARTS: dict[str, tuple[type[BaseModel], ...]] = {
    "xform": (Xform, Animation, Key),
    "Mesh": (Split,),
    "Material": (Texture,),
    "Camera": (LookAt, CameraPath, CameraKey),
    "SphereLight": (Cone,),
    "RenderSettings": (TrackKey,),
}
"""Mappings inside prims, shown after the prim that has them."""

TITLES = {
    Xform: "xform",
    Animation: "xform.animation",
    Key: "xform.animation.keys[]",
    Split: "split",
    Texture: "*_texture",
}
TITLES |= {LookAt: "look_at", CameraPath: "path", CameraKey: "path.keys[]", Cone: "cone", TrackKey: "track[]"}
assert {MeshPrim, MaterialPrim, CameraPrim, SphereLightPrim} <= set(PRIM_TYPES.values())


def tables() -> str:
    """Markdown: what every prim may say, then each type."""
    common = set(PrimBase.model_fields) | {"children", "type"}
    out = ["### Every prim except Material and RenderSettings\n", table(PrimBase, set())]
    out += [part for model in PARTS["xform"] for part in (f"`{TITLES[model]}`\n", table(model, set()))]
    for name, model in PRIM_TYPES.items():
        out.append(f"### {name}\n")
        out.append(f"{(model.__doc__ or '').strip()}\n")
        out.append(table(model, common if issubclass(model, PrimBase) else {"type"}))
        out += [text for part in PARTS.get(name, ()) for text in (f"`{TITLES[part]}`\n", table(part, set()))]
    return "\n".join(text for text in out if text)


def table(model: type[BaseModel], without: set[str]) -> str:
    """A table of `model`'s attributes, or nothing where there are none."""
    rows = [
        f"| `{name}` | {value_text(field)} | {default_text(field)} | {field.description} |"
        for name, field in model.model_fields.items()
        if name not in without
    ]
    head = ["| attribute | value | default | meaning |", "| --- | --- | --- | --- |"]
    return "\n".join([*head, *rows, ""]) if rows else ""


def value_text(field: FieldInfo) -> str:
    annotation = Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
    return _words(annotation)


def _words(annotation: Any) -> str:
    """A type in the words of the page."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        limits = _limits(arguments[1:])
        if annotation is BudgetText:
            return "budget"
        if any(type(extra).__name__ == "WithJsonSchema" for extra in arguments[1:]):
            plain = _words(arguments[0])
            return f"number, or {plain}"
        if any(type(extra).__name__ == "_OrMode" for extra in arguments[1:]):
            return "mode, or mapping"
        return " ".join(filter(None, (_words(arguments[0]), limits)))
    if origin in (Union, types.UnionType):
        return " or ".join(_words(part) for part in arguments if part is not type(None))
    if origin is Literal:
        return ", ".join(f"`{part}`" for part in arguments)
    if origin is tuple:
        return f"{len(arguments)} x {_words(arguments[0])}"
    if origin is list:
        return f"list of {_words(arguments[0])}"
    if origin is dict:
        return f"mapping to {_words(arguments[1])}" if arguments[1] is not Any else "mapping"
    names = {float: "number", int: "whole number", bool: "`true`, `false`", str: "text", Any: "any"}
    return names.get(annotation, "mapping")


def _limits(extras: tuple[Any, ...]) -> str:
    """Ranges among a type's metadata."""
    found: list[str] = []
    for extra in extras:
        for part in getattr(extra, "metadata", None) or [extra]:
            for kind, name, sign in ((Gt, "gt", ">"), (Ge, "ge", ">="), (Lt, "lt", "<"), (Le, "le", "<=")):
                if isinstance(part, kind):
                    found.append(f"{sign} {getattr(part, name):g}")
    return ", ".join(dict.fromkeys(found))


def default_text(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    if field.default_factory is not None or field.default is None:
        return ""
    default = field.default
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, tuple):
        return f"`[{', '.join(f'{part:g}' for part in default)}]`"
    if isinstance(default, float):
        return f"`{default:g}`".replace("`inf`", "`.inf`")
    return f"`{default}`"


def with_tables(page: str) -> str:
    """`page` with fresh tables between its markers."""
    return re.sub(f"{BEGIN}.*{END}", lambda _: f"{BEGIN}\n{tables()}\n{END}", page, flags=re.DOTALL)


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
