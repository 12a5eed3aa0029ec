"""Loader: reads one family of model files, or makes a model from parameters, into plain data."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from phrt.model import Model

MAX_FILE_BYTES = 512 * 1024 * 1024
"""Largest file a loader reads, and the largest size anything it decompresses may have."""


@dataclass(frozen=True)
class LoadContext:
    """What a loader may use besides the file itself.

    resolve: turns a relative reference found in the file (not a data URI) into an existing path inside the asset
        roots, or raises AssetError naming the reference and what is allowed. The only way to open a second file.
    warn: reports something the picture will lack, once; message without the file's name, which is added.
    """

    resolve: Callable[[str], Path]
    warn: Callable[[str], None]


class Loader(ABC):
    """Contract: constructed from its pydantic options (the keys a descriptor gives beside `asset:`)."""

    @abstractmethod
    def load(self, path: Path, context: LoadContext) -> Model:
        """The model in `path`. Raises AssetError with file, place and reason; never runs anything a file contains."""
