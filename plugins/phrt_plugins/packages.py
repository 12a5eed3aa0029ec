"""The packages that built-in plugins need beyond the base installation: which are missing, and what to install. Imports none."""

from __future__ import annotations

from importlib.util import find_spec

PACKAGES = {
    "flip_evaluator": "flip-evaluator",
    "skimage": "scikit-image",
    "fast_simplification": "fast-simplification",
    "scipy": "scipy",
}
"""Names to install by, by the names that they are imported by."""


def missing_packages(*modules: str) -> list[str]:
    """Those that are not installed, to be known before an hour of frames and not after it."""
    return [PACKAGES[module] for module in modules if find_spec(module) is None]


def flip_reason() -> str | None:
    """None, or why FLIP cannot be computed here."""
    return _reason("flip_evaluator")


def ssim_reason() -> str | None:
    """None, or why SSIM cannot be computed here."""
    return _reason("skimage")


def simplification_reason() -> str | None:
    """None, or why meshes cannot be simplified here."""
    return _reason("fast_simplification", "scipy")


def _reason(*modules: str) -> str | None:
    missing = missing_packages(*modules)
    return f"the Python package '{missing[0]}' is not installed: pip install 'phrt[bench]'" if missing else None
