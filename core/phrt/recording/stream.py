"""Tables as files: an Arrow IPC stream while a run is recorded, Parquet when it is finished.

A stream is readable up to its last whole batch at every moment, also after the process was killed; Parquet has its index at the
end and is not.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from phrt.output.files import temporary_beside
from phrt.recording.arrow import import_arrow

BUFFER_BYTES = 1 << 20
"""Arrow writes a batch in hundreds of small pieces; a frame becomes one or two writes."""

ROWS_A_GROUP = 65536
"""Rows of a Parquet row group: what is read to look at one frame."""


def open_file(path: Path) -> IO[bytes]:
    """A new file for a stream."""
    return open(path, "wb", buffering=BUFFER_BYTES)


class TableStream:
    """Appends record batches to one file. Every batch is handed to the system at once, so that killing the process loses none."""

    def __init__(self, path: Path) -> None:
        self._arrow = import_arrow()
        self._file = open_file(path)
        self._writer: Any = None
        self._whole = 0

    def write(self, batch: Any) -> None:
        """Append `batch`. Raises OSError; the stream then ends with the batch before."""
        try:
            if self._writer is None:
                self._writer = self._arrow.ipc.new_stream(self._file, batch.schema)
            self._writer.write_batch(batch)
            self._file.flush()
        except OSError:
            self._cut_back()
            raise
        self._whole = self._file.tell()

    def close(self) -> None:
        """End the stream. Raises OSError."""
        try:
            if self._writer is not None:
                self._writer.close()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file as it is."""
        with contextlib.suppress(OSError, ValueError):
            self._file.close()

    def _cut_back(self) -> None:
        """Leave no half batch behind, and keep what is still buffered from being written when the file is closed."""
        with contextlib.suppress(OSError, ValueError):
            os.ftruncate(self._file.fileno(), self._whole)
        raw = getattr(self._file, "raw", None)
        if raw is not None:
            with contextlib.suppress(OSError, ValueError):
                raw.close()


def stream_batches(path: Path) -> Iterator[Any]:
    """The whole record batches of the stream at `path`; one that was cut off, and what follows it, is left out."""
    arrow = import_arrow()
    if not path.exists() or path.stat().st_size == 0:
        return
    with arrow.OSFile(str(path)) as source:
        try:
            reader = arrow.ipc.open_stream(source)
            while True:
                yield reader.read_next_batch()
        except (StopIteration, EOFError, OSError, arrow.ArrowException):
            return


def write_parquet(batches: Iterator[Any], path: Path) -> bool:
    """Write `batches` to `path`, whole or not at all. False, and no file, where there are none. Raises OSError.

    Batches are gathered into row groups, so that memory stays flat however long the run was.
    """
    arrow = import_arrow()
    first = next(batches, None)
    if first is None:
        return False
    temporary = temporary_beside(path)
    try:
        with arrow.parquet.ParquetWriter(temporary, first.schema, compression="zstd") as writer:
            waiting, rows = [first], first.num_rows
            for batch in batches:
                waiting.append(batch)
                rows += batch.num_rows
                if rows >= ROWS_A_GROUP:
                    writer.write_table(joined(waiting))
                    waiting, rows = [], 0
            if rows:
                writer.write_table(joined(waiting))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return True


def joined(batches: list[Any]) -> Any:
    """One table of `batches`; dictionaries that differ are made one."""
    return import_arrow().Table.from_batches(batches).unify_dictionaries()
