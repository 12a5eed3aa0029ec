"""What loaders need beyond the base installation, asked without importing it."""

from __future__ import annotations

from importlib.util import find_spec


def simplification_unavailable() -> str | None:
    """None, or what to install for simplified meshes."""
    missing = [name for name in ("fast_simplification", "scipy") if find_spec(name) is None]
    return f"the Python package '{missing[0]}' is not installed: pip install 'phrt[bench]'" if missing else None
