"""Recordings: what a run decided, frame by frame, in a folder; reading it, explaining it, and rendering it again.

    with phrt.Renderer(scene, budget="50ms") as renderer, Recorder("runs/walk", renderer) as recorder:
        recorder.add(renderer.render(time=0.5))
    run = read_run("runs/walk")

Needs pyarrow (the extra `record`), which is imported when it is first used. docs/recording.md has every column.
"""

from __future__ import annotations

from phrt.recording.recorder import Recorder
from phrt.recording.replay import Replay, replay
from phrt.recording.run import Run, read_run

__all__ = ["Recorder", "Replay", "Run", "read_run", "replay"]
