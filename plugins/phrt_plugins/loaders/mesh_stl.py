"""STL through trimesh's low-level reader, which sees only bytes: it gets no resolver and opens nothing."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable

import numpy as np

from phrt.errors import AssetError
from phrt_plugins.loaders.mesh_normals import weld
from phrt_plugins.loaders.mesh_soup import Soup, simple_soup

HEADER_BYTES, FACET_BYTES = 84, 50

_FACET_NORMAL = re.compile(rb"facet[ \t]+normal[^\r\n]*", re.IGNORECASE)
"""Left out before parsing: facet normals are not used, and trimesh logs every one that is malformed."""


def read_stl(data: bytes, name: str, share_vertices: bool, warn: Callable[[str], None]) -> Soup:
    """The triangles of STL `data`, one part per `solid`; corners at one place become one vertex with `share_vertices`.
    Raises AssetError, beginning with `name`."""
    # Binary when the length fits: many binary files begin with "solid", too.
    if len(data) >= HEADER_BYTES:
        promised = HEADER_BYTES + FACET_BYTES * int.from_bytes(data[80:84], "little")
        if promised <= len(data) and not (_looks_ascii(data) and promised != len(data)):
            if promised < len(data):
                warn(f"{len(data) - promised} bytes after the last facet were left out")
            return _solids(data[:promised], name, share_vertices)
        if not _looks_ascii(data):
            raise AssetError(f"{name} is cut off: its header promises {promised} bytes, it has {len(data)}")
    if not _looks_ascii(data):
        raise AssetError(f"{name} is not an STL file: neither a binary header nor the word 'solid'")
    _check_ascii(data, name)
    return _solids(_FACET_NORMAL.sub(b"facet", data), name, share_vertices)


def _looks_ascii(data: bytes) -> bool:
    return data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1024]


def _check_ascii(data: bytes, name: str) -> None:
    """What trimesh would read past: a missing end, and facets that are not three vertices of three numbers."""
    text = data.lower()
    facets, ends = len(re.findall(rb"(?<!end)facet\b", text)), text.count(b"endfacet")
    vertices = len(re.findall(rb"\bvertex\b", text))
    if facets != ends or vertices != 3 * facets or b"endsolid" not in text:
        raise AssetError(
            f"{name} is cut off or malformed: {facets} facets, {ends} ends of facets, {vertices} vertices, "
            f"{'an' if b'endsolid' in text else 'no'} 'endsolid'"
        )


def _solids(data: bytes, name: str, share_vertices: bool) -> Soup:
    from trimesh.exchange.stl import load_stl

    try:
        with warnings.catch_warnings():
            # numpy announces text that is no number as a DeprecationWarning and stops reading there.
            warnings.simplefilter("error", DeprecationWarning)
            loaded = load_stl(io.BytesIO(data))
    except Exception as error:  # the library's errors for broken files are open-ended
        raise AssetError(f"{name} cannot be read as STL: {error}") from error
    solids = loaded.get("geometry", {"": loaded})
    whole = name.rpartition(".")[0] or name
    parts = [(key or whole, np.asarray(solid["vertices"], dtype=np.float64)) for key, solid in solids.items()]
    positions = np.concatenate([np.zeros((0, 3)), *(vertices for _, vertices in parts)])
    soup = simple_soup(positions, np.arange(len(positions) // 3 * 3).reshape(-1, 3), whole)
    if len(parts) > 1:
        soup.part_names = [key for key, _ in parts]
        soup.part = np.repeat(np.arange(len(parts), dtype=np.int32), [len(vertices) // 3 for _, vertices in parts])
    if share_vertices and len(positions):
        place = weld(positions)
        _, first = np.unique(place, return_index=True)
        soup.positions, soup.triangles = positions[first], place[soup.triangles]
    # The file's normals are one per facet and often zero: they say nothing that the corners do not.
    return soup
