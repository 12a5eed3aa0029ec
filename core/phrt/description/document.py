"""The top level of a scene file, and its JSON Schema."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from phrt.description.fields import Described, Text
from phrt.description.prims import AnyPrim

FORMAT_VERSION = 1


class Variant(Described):
    """Opinions that hold while a variant is selected."""

    meaning: str = Field("", description="What the variant is for.")
    prims: dict[str, AnyPrim] = Field(
        default_factory=dict, description="Prims that exist only in this variant, or are given more attributes."
    )
    over: dict[str, dict[str, Any]] = Field(default_factory=dict, description="Attributes of existing prims, by path.")


class Document(Described):
    """A scene file."""

    phrt: Literal[1] = Field(1, description="Version of the format.")
    name: Text | None = Field(None, description="Name of the scene; default the file's.")
    sublayers: list[Text] = Field(
        default_factory=list,
        description="Scene files whose opinions are weaker than this file's; earlier ones are stronger.",
    )
    prims: dict[str, AnyPrim] = Field(default_factory=dict, description="Prims by name or by path.")
    over: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="Attributes of prims that a sublayer or a reference brings, by path."
    )
    variants: dict[str, Variant] = Field(
        default_factory=dict, description="Named sets of opinions (situations), stronger than all of this file."
    )
    variant: Text = Field("default", description="The variant that is selected when none is asked for.")


def schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of scene files."""
    result = Document.model_json_schema()
    result["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    result["title"] = "PHRT scene"
    return result
