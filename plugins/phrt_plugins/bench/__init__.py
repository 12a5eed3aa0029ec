"""The comparison of heuristics: `phrt bench`, and `compare` for Python. docs/bench.md is its manual."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from phrt_plugins.bench.api import CompareError, compare

__all__ = ["CompareError", "compare"]


def __getattr__(name: str) -> Any:
    # Imported when first asked for: whoever reads results needs none of what renders them.
    if name in __all__:
        from phrt_plugins.bench import api

        return getattr(api, name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
