"""`--history` and `--no-history`: in a sequence under a budget, values of earlier frames show, or do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from cli_kit import phrt, read_exr

SCENES = Path(__file__).resolve().parents[3] / "scenes"


def last_picture(folder: Path, *arguments: str) -> np.ndarray:
    """The second frame of a sequence in which items take turns."""
    chosen = ("--size", "48x32", "--frames", "0:2", "--heuristic", "round_robin", "--budget", "1500rays", *arguments)
    done = phrt("render", str(SCENES / "spheres.yaml"), "-o", str(folder / "%02d.exr"), "--strict", *chosen)
    assert done.code == 0, done.said
    (*_, last) = sorted(folder.glob("*.exr"))
    channels = read_exr(last)
    return np.stack([channels[name] for name in "RGB"], axis=2)


def test_earlier_values_show_unless_they_are_switched_off(tmp_path: Path) -> None:
    pictures = {}
    for name, arguments in {"plain": [], "with": ["--history"], "without": ["--no-history"]}.items():
        (tmp_path / name).mkdir()
        pictures[name] = last_picture(tmp_path / name, *arguments)
    np.testing.assert_array_equal(pictures["plain"], pictures["with"])
    assert (np.abs(pictures["with"] - pictures["without"]) > 0.01).any()
