"""Recorder: writes a run folder while frames are rendered."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TextIO

from phrt.clock import RecordingClock
from phrt.errors import PhrtWarning
from phrt.frame import FrameResult
from phrt.recording.arrow import import_arrow
from phrt.recording.config import heuristic_name, machine, resolved_config, versions
from phrt.recording.folder import (
    SCHEMA_VERSION,
    TABLES,
    begin_folder,
    check_folder,
    parquet_path,
    stream_path,
    write_about,
    write_end,
)
from phrt.recording.rows import CandidateRows, FrameRows
from phrt.recording.stream import TableStream, stream_batches, write_parquet

if TYPE_CHECKING:
    from phrt.renderer import Renderer


def check_recording(path: str | Path, *, overwrite: bool = False) -> None:
    """Can a run be recorded into `path`? Changes nothing. Raises OptionError: pyarrow is missing, or the folder is taken."""
    import_arrow()
    check_folder(Path(path), overwrite)


class Recorder:
    """Records every frame that is given to `add` into the folder `path`.

    renderer  : whose frames they are; its configuration goes into run.json
    settings  : further settings to keep in run.json, such as a command line's
    overwrite : replace a run that is in the folder

    A frame is on its way to the disk when `add` returns, so that killing the process loses at most the frame in flight; a crash of
    the whole system may lose more. Use it as a context manager: leaving it turns the streams into Parquet. When writing
    fails, as on a full disk, one PhrtWarning says so, recording ends, and rendering goes on.

    Warnings between frames are recorded with the frame that follows: while it is open, `warnings.showwarning` is wrapped.

    Raises OptionError where pyarrow is missing or the folder cannot be used.
    """

    def __init__(
        self,
        path: str | Path,
        renderer: Renderer,
        *,
        settings: Mapping[str, Any] | None = None,
        overwrite: bool = False,
    ) -> None:
        import_arrow()
        self.folder = Path(path)
        self.frames = 0
        self.failed: str | None = None
        begin_folder(self.folder, overwrite)
        self._renderer = renderer
        self._about: dict[str, Any] = {
            "phrt_run": SCHEMA_VERSION,
            "state": "recording",
            "started": now(),
            "finished": None,
            "frames": None,
            "error": None,
            "faults": [],
            "config": resolved_config(renderer),
            "settings": dict(settings or {}),
            "versions": versions(),
            "machine": machine(),
        }
        self._candidates = CandidateRows([entry.path for entry in renderer.scene.objects])
        self._rows = FrameRows()
        self._heuristic = heuristic_name(renderer.heuristic)
        self._streams: dict[str, TableStream] = {}
        self._warned: list[str] = []
        self._others: Callable[..., None] | None = None
        self._closed = False
        try:
            write_about(self.folder, self._about)
            self._streams = {table: TableStream(stream_path(self.folder, table)) for table in TABLES}
        except OSError as error:
            self._fail(error)
        self._listen()

    def add(self, frame: FrameResult) -> None:
        """Record `frame`. Never raises for what the system refuses to write."""
        if self.failed is not None or self._closed:
            return
        clock = self._renderer.clock
        readings = clock.take() if isinstance(clock, RecordingClock) else []
        warned, self._warned = self._warned, []
        conditions = self._renderer.conditions
        try:
            self._note_faults()
            # The frame's row comes last: where it is, the frame is whole.
            self._streams["candidates"].write(self._candidates.batch(self.frames, frame))
            row = self._rows.batch(self.frames, frame, self._heuristic, conditions, warned, readings)
            self._streams["frames"].write(row)
        except OSError as error:
            self._fail(error)
        else:
            self.frames += 1

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(None if error is None else f"{type(error).__name__}: {error}".rstrip(": "))

    def close(self, error: str | None = None) -> None:
        """End the recording: streams become Parquet. error: why the run ended early, if it did."""
        if self._closed:
            return
        self._closed = True
        self._unlisten()
        if self.failed is not None:
            return
        try:
            self._note_faults()
            for stream in self._streams.values():
                stream.close()
            for table in TABLES:
                write_parquet(stream_batches(stream_path(self.folder, table)), parquet_path(self.folder, table))
            self._note("finished" if error is None else "ended early", error)
            # Only now is nothing lost with them.
            for table in TABLES:
                if parquet_path(self.folder, table).exists():
                    stream_path(self.folder, table).unlink(missing_ok=True)
        except OSError as refused:
            self._fail(refused)

    def _note_faults(self) -> None:
        """What plugins did wrong goes into run.json as soon as it is known: a run may end by it. Raises OSError."""
        log = self._renderer.run.faults.log
        if len(log) != len(self._about["faults"]):
            self._about["faults"] = [fault.as_row() for fault in log]
            write_about(self.folder, self._about)

    def _fail(self, error: OSError) -> None:
        """Recording ends here, with one warning; what was written stays as it is."""
        self.failed = error.strerror or str(error)
        for stream in self._streams.values():
            stream.abandon()
        self._unlisten()
        warnings.warn(
            f"recording into '{self.folder}' ended after {self.frames} frames, rendering goes on: {self.failed}",
            PhrtWarning,
            stacklevel=3,
        )
        self._note("failed", self.failed)

    def _note(self, state: str, error: str | None) -> None:
        """Say in run.json how it ended. Where that cannot be written either, the old one stays."""
        end = {"state": state, "finished": now(), "frames": self.frames, "error": error}
        try:
            write_end(self.folder, self._about, end)
        except OSError:
            if state != "failed":
                raise

    def _listen(self) -> None:
        if self.failed is None:
            self._others = warnings.showwarning
            warnings.showwarning = self._show

    def _unlisten(self) -> None:
        # Compared by value: a bound method is a new object every time.
        if self._others is not None and warnings.showwarning == self._show:
            warnings.showwarning = self._others
        self._others = None

    def _show(
        self,
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        self._warned.append(str(message))
        if self._others is not None:
            self._others(message, category, filename, lineno, file, line)


def now() -> str:
    """The time of day, UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")
