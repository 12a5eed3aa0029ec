"""Options that are numbers say their unit, or are on the list of those that have none."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options, get_registry
from phrt.registry.options import option_rows

WITHOUT = {
    ("effect", "ambient_occlusion"): {"fallback_value"},
    ("effect", "reflections"): {"roughness_cutoff"},
    ("gbuffer", "moderngl"): {"device"},
    ("heuristic", "gain"): {"power", "optimism", "damping"},
    ("heuristic", "random"): {"seed"},
    ("loader", "atrium"): {"detail", "seed", "statues", "spheres"},
    ("loader", "simplified"): {"share"},
    ("metric", "relmse"): {"epsilon"},
}
"""Shares, factors, exponents, seeds, numbers of things that are called by the option's name."""


def test_every_number_has_a_unit_or_needs_none() -> None:
    found = {}
    for entry in get_registry().plugins():
        fields = entry.plugin.options.model_fields
        numbers = [row for row in option_rows(entry.plugin.options) if fields[row.name].annotation in (int, float)]
        if entry.origin == "built-in" and (bare := {row.name for row in numbers if not row.unit}):
            found[entry.kind, entry.name] = bare
    assert found == WITHOUT


def test_the_unit_is_part_of_the_schema_too() -> None:
    class Mine(Options):
        height: float = Field(default=2.0, json_schema_extra={"unit": "metres"}, description="How high.")
        share: float = Field(default=0.5, description="Of what.")

    assert [(row.name, row.unit) for row in option_rows(Mine)] == [("height", "metres"), ("share", "")]
    assert Mine.model_json_schema()["properties"]["height"]["unit"] == "metres"
