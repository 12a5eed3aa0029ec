"""Digests: of a scene as it was read, with everything in its files, and of the code that renders it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from phrt.recording.config import versions
from phrt.scene import Scene

PACKAGES = ("phrt", "phrt_backends", "phrt_heuristics", "phrt_plugins")
NOT_RENDERING = ("cli", "recording", "bench", "report", "metrics")
"""Folders of the packages whose code changes no picture."""


def scene_digest(scene: Scene) -> str:
    """32 hexadecimal digits of all that `scene` holds: geometry, textures, materials, lights, cameras, animation, settings. Where
    its files lie does not count."""
    hasher = hashlib.blake2b(digest_size=16)
    _feed(hasher, scene)
    return hasher.hexdigest()


@lru_cache(maxsize=1)
def code_digest() -> str:
    """32 hexadecimal digits of the versions of all packages that pictures depend on, and of the sources of this one."""
    hasher = hashlib.blake2b(digest_size=16)
    _feed(hasher, versions())
    for package in PACKAGES:
        spec = find_spec(package)
        for root in (spec.submodule_search_locations or ()) if spec else ():
            for path in sorted(Path(root).rglob("*.py")):
                inner = path.relative_to(root)
                if inner.parts[0] not in NOT_RENDERING:
                    _feed(hasher, f"{package}/{inner.as_posix()}")
                    hasher.update(path.read_bytes())
    return hasher.hexdigest()


def _feed(hasher: Any, value: Any) -> None:
    """`value` and what it is; parts are told apart by their kinds and lengths."""
    if isinstance(value, np.ndarray):
        hasher.update(f"array {value.dtype.str} {value.shape};".encode())
        hasher.update(np.ascontiguousarray(value).view(np.uint8).reshape(-1).data if value.size else b"")
    elif is_dataclass(value) and not isinstance(value, type):
        hasher.update(f"{type(value).__name__};".encode())
        for field in fields(value):
            _feed(hasher, field.name)
            _feed(hasher, getattr(value, field.name))
    elif isinstance(value, Mapping):
        hasher.update(f"mapping {len(value)};".encode())
        for key in sorted(value, key=str):
            _feed(hasher, str(key))
            _feed(hasher, value[key])
    elif isinstance(value, (list, tuple)):
        hasher.update(f"list {len(value)};".encode())
        for item in value:
            _feed(hasher, item)
    elif isinstance(value, Path):
        hasher.update(b"path;")
    else:
        text = repr(value.item() if isinstance(value, np.generic) else value).encode()
        hasher.update(f"{type(value).__name__} {len(text)};".encode() + text)
