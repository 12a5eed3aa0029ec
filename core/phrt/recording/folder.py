"""A run folder: which files are in it, when one may be begun, and `run.json`.

While a run is recorded, `frames.arrows` and `candidates.arrows` grow (Arrow IPC streams); when it is finished they are
`frames.parquet` and `candidates.parquet`.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phrt.errors import OptionError
from phrt.output.files import temporary_beside

SCHEMA_VERSION = 1
"""Of run.json and both tables. It rises when a reader of today would misread what is written."""

RUN_FILE = "run.json"
END_FILE = "end.json"
"""How the run ended, where there was no room left to write run.json anew."""
TABLES = ("frames", "candidates")


def stream_path(folder: Path, table: str) -> Path:
    return folder / f"{table}.arrows"


def parquet_path(folder: Path, table: str) -> Path:
    return folder / f"{table}.parquet"


def is_run(folder: Path) -> bool:
    """Was a run recorded in `folder`?"""
    try:
        return "phrt_run" in json.loads((folder / RUN_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError):
        return False


def check_folder(folder: Path, overwrite: bool = False) -> None:
    """Nothing is changed. Raises OptionError unless a run can be recorded in `folder`: one that does not exist, is empty, or,
    with `overwrite`, holds a run."""
    try:
        exists = folder.exists()
        if exists and not folder.is_dir():
            raise OptionError(f"cannot record into '{folder}': it is a file, not a folder")
        filled = exists and any(folder.iterdir())
    except (OSError, ValueError) as error:
        raise OptionError(f"cannot record into '{folder}': {getattr(error, 'strerror', None) or error}") from error
    if filled and not is_run(folder):
        raise OptionError(f"cannot record into '{folder}': it is not empty, and what is in it is no recorded run")
    if filled and not overwrite:
        raise OptionError(f"cannot record into '{folder}': it holds a run already (--overwrite replaces it)")
    above = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not os.access(above, os.W_OK | os.X_OK):
        raise OptionError(f"cannot record into '{folder}': no permission to write in '{above}'")


def begin_folder(folder: Path, overwrite: bool = False) -> None:
    """Make `folder`, without the files of a run that was there. Raises OptionError as `check_folder`."""
    check_folder(folder, overwrite)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / END_FILE).unlink(missing_ok=True)
        for table in TABLES:
            stream_path(folder, table).unlink(missing_ok=True)
            parquet_path(folder, table).unlink(missing_ok=True)
    except OSError as error:
        raise OptionError(f"cannot record into '{folder}': {error.strerror or error}") from error


def write_about(folder: Path, about: Mapping[str, Any]) -> None:
    """Replace run.json by `about`, whole or not at all. Raises OSError."""
    write_json(folder / RUN_FILE, about)


def write_end(folder: Path, about: Mapping[str, Any], end: Mapping[str, Any]) -> None:
    """Write run.json with `about` and `end`; where it does not fit, `end` alone into a small file of its own. Raises OSError."""
    try:
        write_about(folder, {**about, **end})
    except OSError:
        write_json(folder / END_FILE, end)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write `values` to `path`, whole or not at all. Raises OSError."""
    temporary = temporary_beside(path)
    try:
        temporary.write_text(json.dumps(plain(values), indent=2, allow_nan=False) + "\n", encoding="utf-8")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_about(folder: Path) -> dict[str, Any]:
    """run.json, with how the run ended. Raises OptionError where there is none, and where it is not one that this version reads."""
    path = folder / RUN_FILE
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and not path.exists():
            why = "there is no such folder" if not folder.exists() else f"there is no {RUN_FILE} in it"
        else:
            why = f"{RUN_FILE} cannot be read: {error}"
        raise OptionError(f"'{folder}' is no recorded run: {why}") from error
    if not isinstance(about, dict) or "phrt_run" not in about:
        raise OptionError(f"'{folder}' is no recorded run: its {RUN_FILE} was not written by phrt")
    if about["phrt_run"] != SCHEMA_VERSION:
        raise OptionError(
            f"'{folder}' was recorded with version {about['phrt_run']} of run folders; this phrt reads version {SCHEMA_VERSION}"
        )
    with contextlib.suppress(OSError, ValueError):
        about |= json.loads((folder / END_FILE).read_text(encoding="utf-8"))
    return about


def plain(value: Any) -> Any:
    """`value` as JSON can hold it: arrays as lists, paths as text, infinities and NaN as text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)
