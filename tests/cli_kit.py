"""`phrt render` in this process, for tests: exit code, messages and the linear picture."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from phrt.cli import main as cli

SIZE = (64, 36)


@dataclass(frozen=True)
class Outcome:
    """What a run left behind. channels: (H, W) float32 by EXR channel, empty without a picture."""

    code: int
    printed: str
    said: str
    channels: dict[str, np.ndarray]

    @property
    def errors(self) -> list[str]:
        return [line for line in self.said.splitlines() if line.startswith(("error: ", "Error: "))]

    @property
    def warnings(self) -> list[str]:
        return [line for line in self.said.splitlines() if line.startswith("warning: ")]

    @property
    def image(self) -> np.ndarray:
        """(H, W, 3) float32, linear."""
        return np.stack([self.channels[name] for name in "RGB"], axis=2)

    @property
    def finite(self) -> bool:
        return all(np.isfinite(plane).all() for plane in self.channels.values())


def phrt(*arguments: str) -> Outcome:
    """`phrt ARGUMENTS`, whatever it is."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = cli.run(list(arguments))
    return Outcome(code, out.getvalue(), err.getvalue(), {})


def render(scene: Path, output: Path, *arguments: str) -> Outcome:
    """`phrt render SCENE -o OUTPUT ARGUMENTS` at 64x36; the picture is read where OUTPUT is an .exr that was written."""
    output.unlink(missing_ok=True)
    done = phrt("render", str(scene), "-o", str(output), "--size", f"{SIZE[0]}x{SIZE[1]}", *arguments)
    return Outcome(done.code, done.printed, done.said, read_exr(output) if output.exists() else {})


def render_text(folder: Path, text: str, *arguments: str) -> Outcome:
    """The scene that YAML `text` describes, written into `folder`."""
    scene = folder / "scene.yaml"
    scene.write_text(text, encoding="utf-8")
    return render(scene, folder / "picture.exr", *arguments)


def read_exr(path: Path) -> dict[str, np.ndarray]:
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels, dtype=np.float32) for name, channel in file.channels().items()}
