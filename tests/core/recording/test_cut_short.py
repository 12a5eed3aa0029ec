"""A run that was cut short is readable up to its last whole frame: killed processes, full disks, half-written files."""

from __future__ import annotations

import errno
import io
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest
from recording_kit import quietly, record, renderer_of

from phrt.errors import PhrtWarning
from phrt.recording import Recorder, read_run
from phrt.recording import folder as folders
from phrt.recording import stream as streams
from phrt.recording.folder import parquet_path, stream_path

PROJECT = Path(__file__).resolve().parents[3]
LOOP = """
import sys
from dataclasses import replace
from pathlib import Path
sys.path.insert(0, {tests!r})
from recording_kit import renderer_of
from phrt.recording import Recorder
with renderer_of(heuristic="selection_graph", budget="3000rays") as renderer:
    frame = renderer.render()
    recorder = Recorder(sys.argv[1], renderer)
    for number in range(int(sys.argv[2])):
        recorder.add(replace(frame, index=number))
        print(number, flush=True)
    print("closing", flush=True)
    recorder.close()
    print("closed", flush=True)
"""


def start(folder: Path, frames: int) -> subprocess.Popen[str]:
    """A process that records `frames` frames into `folder` and says the number of each that is recorded."""
    code = LOOP.format(tests=str(PROJECT / "tests"))
    command = [sys.executable, "-c", code, str(folder), str(frames)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, bufsize=1)


def killed(process: subprocess.Popen[str], after: str, wait_s: float) -> int:
    """Kill -9 `wait_s` seconds after the process said `after`; the last frame that it had said to be recorded."""
    assert process.stdout is not None
    said = []
    for line in process.stdout:
        said.append(line.strip())
        if said[-1] == after:
            break
    time.sleep(wait_s)
    os.kill(process.pid, signal.SIGKILL)
    said += [line.strip() for line in process.stdout.read().splitlines()]
    process.wait()
    process.stdout.close()
    return max(int(line) for line in said if line.isdigit())


def whole_frames(folder: Path) -> int:
    """How many frames can be read; each of them must be whole."""
    run = read_run(folder)
    counts = run.frames.column("candidates").to_pylist() if run.frames.num_rows else []
    assert run.numbers.tolist() == list(range(len(counts)))
    steps = np.asarray(run.candidates.column("step").to_numpy()) if counts else np.zeros(0, int)
    assert np.bincount(steps, minlength=len(counts)).tolist() == counts
    return len(counts)


@pytest.mark.parametrize(("after", "wait_s"), [("0", 0.0), ("50", 0.003), ("400", 0.0171)])
def test_a_killed_process_loses_at_most_the_frame_in_flight(tmp_path: Path, after: str, wait_s: float) -> None:
    last = killed(start(tmp_path / "run", 10**9), after, wait_s)
    found = whole_frames(tmp_path / "run")
    # What it had said was recorded, and perhaps one more that it could not say any more.
    assert found - (last + 1) in (0, 1)
    assert "its process was ended" in str(read_run(tmp_path / "run").cut_short)


@pytest.mark.parametrize("wait_s", [0.0, 0.01, 0.04])
def test_a_process_that_is_killed_while_it_finishes_loses_nothing(tmp_path: Path, wait_s: float) -> None:
    assert killed(start(tmp_path / "run", 300), "closing", wait_s) == 299
    assert whole_frames(tmp_path / "run") == 300


def test_a_killed_render_leaves_a_run_that_explains_itself(tmp_path: Path) -> None:
    run, output = tmp_path / "run", tmp_path / "frame_%04d.png"
    options = ["--size", "64x36", "--frames", "0:9999", "--budget", "2000rays", "--record", str(run)]
    command = [sys.executable, "-m", "phrt.cli", "render", str(PROJECT / "scenes" / "spheres.yaml"), "-o", str(output)]
    process = subprocess.Popen([*command, *options], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 120
        while not (output.parent / "frame_0005.png").exists():
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.01)
    finally:
        process.kill()
        process.wait()
    assert whole_frames(run) >= 6
    assert read_run(run).items(5)["reason"].tolist().count("selected") > 0


def test_a_stream_that_ends_anywhere_is_read_up_to_its_last_whole_frame(tmp_path: Path) -> None:
    with renderer_of() as renderer:
        frame = renderer.render()
        recorder = Recorder(tmp_path / "run", renderer)
        ends = {name: [0] for name in ("frames", "candidates")}
        for number in range(4):
            recorder.add(replace(frame, index=number))
            for name, found in ends.items():
                found.append(stream_path(tmp_path / "run", name).stat().st_size)
    for name, other in (("frames", "candidates"), ("candidates", "frames")):
        path = stream_path(tmp_path / "run", name)
        whole = path.read_bytes()
        lengths = {*range(0, len(whole), 97), *ends[name], *(end - 1 for end in ends[name][1:]), *range(0, 64, 3)}
        for length in sorted(lengths):
            path.write_bytes(whole[:length])
            expected = sum(end <= length for end in ends[name][1:])
            if name == "frames":
                assert whole_frames(tmp_path / "run") == expected, (name, length)
            else:
                found = read_run(tmp_path / "run").read_candidates(step=3)
                assert found.num_rows == (0 if expected < 4 else len(frame.decisions.candidates)), (name, length)
        path.write_bytes(whole)
        assert stream_path(tmp_path / "run", other).exists()
    quietly(recorder.close)


class Full(io.FileIO):
    """A file on a disk with room for `room` bytes."""

    def __init__(self, path: Path, room: int) -> None:
        super().__init__(path, "wb")
        self.room = room

    def write(self, data: Any) -> int:
        if self.room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        fits = min(len(data), self.room)
        self.room -= fits
        return super().write(memoryview(data)[:fits])


@pytest.mark.parametrize("room", [0, 100, 3000, 9000, 20000, 60000])
def test_a_full_disk_ends_the_recording_and_not_the_rendering(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    monkeypatch.setattr(streams, "open_file", lambda path: io.BufferedWriter(Full(path, room), streams.BUFFER_BYTES))
    with pytest.warns(PhrtWarning) as warned:
        frames = record(tmp_path / "run", 40)
    assert len(frames) == 40
    assert len(warned) == 1, "one warning"
    text = str(warned[0].message)
    assert re.search(r"recording into '.*run' ended after \d+ frames, rendering goes on: No space left on device", text)
    found = whole_frames(tmp_path / "run")
    assert found < 40
    assert f"after {found} frames" in text
    assert read_run(tmp_path / "run").cut_short == f"recording failed after {found} frames: No space left on device"


def test_how_it_ended_is_kept_where_only_little_room_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "open_file", lambda path: io.BufferedWriter(Full(path, 60000), streams.BUFFER_BYTES))
    whole = folders.write_json

    def small(path: Path, values: Any) -> None:
        if "config" in values and values["state"] == "failed":
            raise OSError(errno.ENOSPC, "No space left on device")
        whole(path, values)

    monkeypatch.setattr(folders, "write_json", small)
    quietly(record, tmp_path / "run", 40)
    found = whole_frames(tmp_path / "run")
    assert read_run(tmp_path / "run").cut_short == f"recording failed after {found} frames: No space left on device"
    monkeypatch.undo()
    with renderer_of() as renderer:
        Recorder(tmp_path / "run", renderer, overwrite=True).close()
    assert read_run(tmp_path / "run").cut_short is None, "nothing of the old run is left"


def test_frames_before_the_disk_was_full_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "open_file", lambda path: io.BufferedWriter(Full(path, 60000), streams.BUFFER_BYTES))
    quietly(record, tmp_path / "run", 40)
    assert whole_frames(tmp_path / "run") >= 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_device_that_is_always_full_is_no_reason_to_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path) -> IO[bytes]:
        return open("/dev/full", "wb", buffering=streams.BUFFER_BYTES)

    monkeypatch.setattr(streams, "open_file", full)
    with pytest.warns(PhrtWarning, match="ended after 0 frames, rendering goes on: No space left on device"):
        frames = record(tmp_path / "run", 2)
    assert len(frames) == 2
    assert read_run(tmp_path / "run").numbers.tolist() == []


def test_a_disk_that_is_full_at_the_end_leaves_the_streams(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> bool:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("phrt.recording.recorder.write_parquet", refuse)
    with pytest.warns(PhrtWarning, match="ended after 3 frames"):
        record(tmp_path / "run", 3)
    assert whole_frames(tmp_path / "run") == 3
    assert stream_path(tmp_path / "run", "frames").exists()
    assert not parquet_path(tmp_path / "run", "frames").exists()
