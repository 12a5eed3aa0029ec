"""Columns of a run's tables as arrays, row by row of its frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from phrt.interfaces.metric import RunFrames

PRIMARY = "rays_primary"


def ray_phase_rays(frames: RunFrames) -> np.ndarray:
    """(n,) float64, rays of each frame but the primary ones."""
    kinds = [name for name in frames.columns if name.startswith("rays_") and name != PRIMARY]
    return np.sum([numbers(frames, kind) for kind in kinds], axis=0) if kinds else np.zeros(len(frames))


def numbers(frames: RunFrames, name: str) -> np.ndarray:
    """(n,) float64, a column of the frames table. Raises ValueError where there is none."""
    if name not in frames.columns:
        raise ValueError(f"the frames table has no column '{name}'")
    return np.asarray(frames.columns[name], np.float64)


def candidates_by_frame(frames: RunFrames, columns: Sequence[str]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The candidates of all frames, sorted by frame: (m,) which row of the frames table each belongs to, and (m,) arrays by
    column; text comes as int64 codes, equal where the text is.

    Raises ValueError where a frame's number occurs twice, or a candidate's frame is not in the frames table.
    """
    table = frames.candidates(["frame", *columns])
    numbered = np.asarray(frames.columns["frame"], np.int64)
    known, first = np.unique(numbered, return_index=True)
    if len(known) != len(numbered):
        raise ValueError("two frames have the same number, so that their candidates cannot be told apart")
    wanted = array_of(table, "frame")
    places = np.minimum(np.searchsorted(known, wanted), max(len(known) - 1, 0))
    if len(wanted) and (not len(known) or (known[places] != wanted).any()):
        raise ValueError("there are candidates of frames that are not in the frames table")
    rows = first[places] if len(wanted) else np.zeros(0, np.intp)
    order = np.argsort(rows, kind="stable")
    return rows[order], {name: array_of(table, name)[order] for name in columns}


def array_of(table: Any, name: str) -> np.ndarray:
    """(m,) a column of a pyarrow table; text as int64 codes."""
    if name not in table.column_names:
        raise ValueError(f"the candidates table has no column '{name}'")
    column = table.column(name)
    if str(column.type) in ("string", "large_string"):
        column = column.dictionary_encode()
    if str(column.type).startswith("dictionary"):
        # Every recording, and so every block of a run, has a dictionary of its own.
        pieces = column.unify_dictionaries().chunks
        codes = [np.asarray(piece.indices.to_numpy(zero_copy_only=False), np.int64) for piece in pieces]
        return np.concatenate(codes) if codes else np.zeros(0, np.int64)
    return np.asarray(column.to_numpy())
