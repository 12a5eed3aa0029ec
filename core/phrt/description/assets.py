"""Where the files of a scene may lie: its asset roots. Nothing outside them is ever opened."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from phrt.errors import AssetError

ASSETS_VARIABLE = "PHRT_ASSETS"

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://|(data|file):", re.IGNORECASE)


class MissingAssetError(AssetError):
    """The name could stand for a file inside the asset roots, but there is none."""


class AssetRoots:
    """The folder of the scene file, then `search`, then every folder in PHRT_ASSETS."""

    def __init__(self, scene_folder: Path, search: Sequence[Path] = ()) -> None:
        named = [Path(part) for part in os.environ.get(ASSETS_VARIABLE, "").split(os.pathsep) if part]
        folders = [scene_folder, *search, *named]
        self.folders = tuple(dict.fromkeys(folder.expanduser().resolve() for folder in folders))

    def find(self, asset: str, beside: Path) -> Path:
        """The file `asset`, looked for in folder `beside` and then in every root, as a resolved path inside a root.

        Raises AssetError that names the asset and the roots when it is outside of them; MissingAssetError when it is
        not there. Addresses are refused: nothing is fetched.
        """
        if "\0" in asset or not asset:
            raise AssetError(f"'{asset!r}' is not a file name")
        outside = False
        for folder in dict.fromkeys((beside, *self.folders)):
            try:
                candidate = (folder / asset).resolve()
                inside = any(candidate.is_relative_to(root) for root in self.folders)
                if inside and candidate.is_file():
                    return candidate
                outside = outside or not inside
            except (OSError, RuntimeError) as error:
                raise AssetError(f"'{asset}' cannot be looked up: {error}") from None
        roots = ", ".join(str(folder) for folder in self.folders)
        if outside:
            raise AssetError(f"'{asset}' leaves the asset roots; files must lie inside one of: {roots}")
        if _ADDRESS.match(asset):
            raise AssetError(f"'{asset[:80]}' is an address; only names of files are read, inside one of: {roots}")
        raise MissingAssetError(
            f"'{asset}' was not found; looked in: {roots}. More folders can be named in {ASSETS_VARIABLE}"
        )
