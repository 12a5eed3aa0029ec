"""`-D key.path=value`: one attribute of one prim, stronger than anything a file says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from phrt.description.problems import Mark
from phrt.description.values import Value, read_text, value_of
from phrt.errors import OptionError, SceneError


def parse_override(text: str) -> tuple[str, Any]:
    """("/World/Lamp.intensity", 3) of "/World/Lamp.intensity=3"; the value is read as YAML. Raises OptionError."""
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not key or ("/" in key and "." not in key.rpartition("/")[2]):
        raise OptionError(
            f"override '{text}': wanted PRIM.ATTRIBUTE=VALUE, as in /World/Lamp.intensity=3 or variant=night"
        )
    if not value.strip():
        raise OptionError(f"override '{text}': the value is missing; wanted PRIM.ATTRIBUTE=VALUE")
    try:
        return key, read_text(value, f"override {key}").plain()
    except SceneError as error:
        raise OptionError(str(error)) from None


def marked(overrides: Mapping[str, Any]) -> dict[str, Value]:
    """Overrides as values whose mark names the override."""
    return {key: value_of(value, Mark(f"override {key}")) for key, value in overrides.items()}
