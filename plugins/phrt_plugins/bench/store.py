"""The folder of a benchmark: what is in it, what of it is done, and writing into it so that nothing is ever seen half.

A block is written into a folder whose name ends in `.part`, brought to the disk and renamed: one without `.part` is whole.
Files that change are replaced. docs/bench.md shows the layout.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from phrt.errors import OptionError
from phrt.recording.folder import plain, write_json
from phrt_plugins.bench.plan import Block

BENCH_FILE, CONFIG_FILE, LOCK_FILE, OWNER_FILE = "bench.json", "config.yaml", ".lock", ".run"
CELL_FILE, FAILED_FILE = "cell.json", "failed.json"
BENCH_VERSION = 1
SYNCED_AT_ONCE = 8
TEMPORARY = re.compile(r"\..+\.[0-9a-f]{12}\.[a-z]+")
"""Files that `phrt.output.files.temporary_beside` names."""


class Store:
    """The folder `root`, used by the command and by every worker."""

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)

    # Where

    def cell(self, cell: str) -> Path:
        return self.root / "cells" / cell

    def cell_block(self, cell: str, block: Block) -> Path:
        return self.cell(cell) / block.name

    def reference_block(self, setup: str, block: Block) -> Path:
        return self.root / "references" / setup / block.name

    def oracle_block(self, setup: str, block: Block) -> Path:
        """The Parquet file of the oracle; it is written last."""
        return self.root / "oracle" / setup / f"{block.name}.parquet"

    # Cells

    def begin_cell(self, settings: Mapping[str, Any]) -> None:
        """Write cell.json, unless it is there and says the same. Raises OSError."""
        path = self.cell(settings["id"]) / CELL_FILE
        if read_json(path) != plain(settings):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, settings)

    def fail(self, cell: str, block: Block | None, kind: str, reason: str) -> None:
        """Mark `cell` failed; a reason that is there stays. Raises OSError."""
        path = self.cell(cell) / FAILED_FILE
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, {"block": block.number if block else None, "kind": kind, "reason": reason})

    def failure(self, cell: str) -> dict[str, Any] | None:
        """Why `cell` failed; None where it did not. A file that cannot be read counts as a failure without a reason."""
        path = self.cell(cell) / FAILED_FILE
        if not path.exists():
            return None
        found = read_json(path)
        return found if isinstance(found, dict) else {"block": None, "kind": "unknown", "reason": "unknown"}

    def forgive(self, cell: str) -> None:
        """Forget that `cell` failed."""
        (self.cell(cell) / FAILED_FILE).unlink(missing_ok=True)

    # The whole

    def about(self) -> dict[str, Any] | None:
        """bench.json; None where there is none. Raises OptionError for one that is not of this version."""
        path = self.root / BENCH_FILE
        if not path.exists():
            return None
        about = read_json(path)
        if not isinstance(about, dict) or about.get("phrt_bench") != BENCH_VERSION:
            raise OptionError(f"'{self.root}' cannot be resumed: its {BENCH_FILE} is not one that this phrt writes")
        return about

    def write_about(self, about: Mapping[str, Any]) -> None:
        """Replace bench.json. Raises OSError."""
        write_json(self.root / BENCH_FILE, about)

    def is_empty(self) -> bool:
        """Is there no folder, or nothing in it but what a run that was killed at once leaves?"""
        harmless = (CONFIG_FILE,)
        return not self.root.exists() or all(
            path.name in harmless or path.name.startswith(".") for path in self.root.iterdir()
        )

    def take_over(self, token: str) -> None:
        """From now on the folder belongs to the run that is called `token`. Raises OSError."""
        (self.root / OWNER_FILE).write_text(token, encoding="utf-8")

    def belongs_to(self, token: str) -> bool:
        """Does the folder still belong to the run `token`? A worker far away may outlive its run."""
        try:
            return (self.root / OWNER_FILE).read_text(encoding="utf-8") == token
        except OSError:
            return False

    def sweep(self) -> None:
        """Remove what a run that was killed left half written. Call it while the folder is locked."""
        for path in self.root.rglob("*"):
            if path.is_dir() and path.name.endswith(".part"):
                shutil.rmtree(path, ignore_errors=True)
            elif TEMPORARY.fullmatch(path.name):
                path.unlink(missing_ok=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Nobody else may run in this folder meanwhile; a process that is killed lets go. Raises OptionError."""
        self.root.mkdir(parents=True, exist_ok=True)
        with open(self.root / LOCK_FILE, "w") as file:
            if not _lock(file):
                raise OptionError(f"'{self.root}' is in use by another `phrt bench`")
            yield


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A new folder to write into, beside `path`; renamed to `path` when the block ends well and everything is on the disk.

    Where others write the same at the same time, who is first wins. Where it does not end well, nothing is left. Raises OSError
    where the system refuses to write.
    """
    part = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
    part.mkdir(parents=True)
    try:
        yield part
        to_disk(part)
        try:
            os.rename(part, path)
        except OSError:
            if not path.is_dir():
                raise
            shutil.rmtree(part, ignore_errors=True)
        _sync(path.parent)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def to_disk(folder: Path) -> None:
    """Everything in `folder` is on the disk when this returns."""
    inside = list(folder.rglob("*"))
    # At the same time: the system then brings them to the disk in one go or two.
    with ThreadPoolExecutor(SYNCED_AT_ONCE) as pool:
        list(pool.map(_sync, [path for path in inside if path.is_file()]))
        list(pool.map(_sync, [*(path for path in inside if path.is_dir()), folder]))


def read_json(path: Path) -> Any:
    """What is in `path`; None where it is not there or cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _sync(path: Path) -> None:
    """Bring a file or a folder to the disk. Windows has no such thing for folders."""
    if os.name == "nt" and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _lock(file: IO[str]) -> bool:
    """Take the lock of `file`, until it is closed. True where the system has no such locks."""
    try:
        import fcntl
    except ImportError:
        return True
    with contextlib.suppress(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    return False
