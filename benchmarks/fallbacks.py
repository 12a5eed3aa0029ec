"""What stands in where nothing is traced, by rows that must not change with the effects' defaults."""

from __future__ import annotations

from collections.abc import Mapping

Fallbacks = Mapping[str, Mapping[str, object]]
"""Options by effect."""

PAPER: Fallbacks = {
    "shadows": {"fallback": "none"},
    "reflections": {"fallback": "environment"},
    "refractions": {"fallback": "environment"},
}
"""What untraced pixels get in the paper: no shadow, the environment."""

PLAIN: Fallbacks = {
    "shadows": {"fallback": "none"},
    "reflections": {"fallback": "environment"},
    "refractions": {"fallback": "alpha"},
}
"""What needs no maps: as in the paper, and what lies straight behind glass."""

BEST: Fallbacks = {
    "shadows": {"fallback": "shadow_map"},
    "reflections": {"fallback": "probe"},
    "refractions": {"fallback": "probe"},
}
"""The fallbacks that come nearest to all-trace, measured on the reference scene; before them comes history."""
