"""The packages that compare pictures: which ones are missing here, and what to install. Imports none of them."""

from __future__ import annotations

from importlib.util import find_spec

PACKAGES = {"flip_evaluator": "flip-evaluator", "skimage": "scikit-image"}
"""What is needed, by the name that it is imported by."""


def missing_packages() -> list[str]:
    """Those of PACKAGES that are not installed, to be known before an hour of frames and not after it."""
    return [package for module, package in PACKAGES.items() if find_spec(module) is None]


def flip_reason() -> str | None:
    """None, or why FLIP cannot be computed here."""
    return _reason("flip_evaluator")


def ssim_reason() -> str | None:
    """None, or why SSIM cannot be computed here."""
    return _reason("skimage")


def _reason(module: str) -> str | None:
    if find_spec(module) is not None:
        return None
    return f"the Python package '{PACKAGES[module]}' is not installed: pip install 'phrt[bench]'"
