"""scenes/benchmarks/smoke.yaml: every decision of every frame is what it was, on every machine.

smoke_decisions.txt has a line per cell and frame, and in it a sign per candidate, by effect and object: `#` traced, `.` not.
Only rays take time there, so a line that changed means that a rule changed, a scene, or what effects trace.
Where that was meant, write the file anew, look at the difference, and commit it:

    .venv/bin/python tests/plugins/bench/test_smoke_decisions.py --write

Processors round differently, so that a ray more or less hits something here and there. Scenes and budgets were chosen so that this
changes no decision: the file is the same with kernels compiled for this processor and for any x86-64 one. Budgets are of rays for
that: times of a clock of rays are fitted, one ray more changes the fit, and with it what `gain` decides next.
Writing tells how many lines change when the budget is a thousandth smaller or larger: a measure of how near the file is to others.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from pathlib import Path

import pytest

from phrt_plugins.bench.results import BenchRun

ROOT = Path(__file__).resolve().parents[3]
CONFIG = ROOT / "scenes" / "benchmarks" / "smoke.yaml"
EXPECTED = Path(__file__).with_name("smoke_decisions.txt")


def run_smoke(folder: Path, *arguments: str) -> BenchRun:
    """The run of smoke.yaml without what decides nothing: oracle, most metrics, pictures."""
    from phrt.cli import main as cli

    fixed = ["--set", "oracle=false", "--set", "metrics=[error]", "--set", "pictures=0", "--quiet"]
    output = ["-o", str(folder / "run"), "--cache", str(folder / "cache")]
    with contextlib.redirect_stdout(io.StringIO()):
        code = cli.run(["bench", str(CONFIG), *output, *fixed, *arguments])
    assert code == 0
    return BenchRun.read(folder / "run")


def decisions(run: BenchRun) -> dict[str, str]:
    """Sign per candidate by "scene budget label frame"."""
    found: dict[str, str] = {}
    for cell in run.cells:
        table = run.candidates(cell, ["frame", "chosen"]).to_pydict()
        for frame, chosen in zip(table["frame"], table["chosen"], strict=True):
            key = f"{cell.scene} {cell.budget} {cell.label} {frame}"
            found[key] = found.get(key, "") + ("#" if chosen else ".")
    return found


def read_expected() -> dict[str, str]:
    lines = EXPECTED.read_text(encoding="utf-8").splitlines()
    return dict(line.rsplit(" ", 1) for line in lines if line and not line.startswith("#"))


@pytest.fixture(scope="module")
def smoke(tmp_path_factory: pytest.TempPathFactory) -> BenchRun:
    return run_smoke(tmp_path_factory.mktemp("smoke"))


def test_every_decision_is_what_it_was(smoke: BenchRun) -> None:
    found, expected = decisions(smoke), read_expected()
    assert list(found) == list(expected)
    changed = [f"{key}\n  was {expected[key]}\n  is  {found[key]}" for key in found if found[key] != expected[key]]
    assert not changed, f"{len(changed)} of {len(found)} frames decide otherwise:\n" + "\n".join(changed[:20])


def test_contestants_decide_differently(smoke: BenchRun) -> None:
    """Signs that were all alike would compare nothing."""
    by_label: dict[str, str] = {}
    for key, signs in decisions(smoke).items():
        label = key.split()[2]
        by_label[label] = by_label.get(label, "") + signs
    assert len(set(by_label.values())) == len(by_label) == 5
    assert "#" not in by_label.pop("raster_only")
    assert all("#" in signs and "." in signs for signs in by_label.values())


def write() -> None:
    """Write the file anew, and say how near to other decisions it is."""
    found = decided()
    text = [
        "# Written by: .venv/bin/python tests/plugins/bench/test_smoke_decisions.py --write",
        "# scene, budget, contestant, frame; a sign per candidate: # traced, . not",
    ]
    EXPECTED.write_text(
        "\n".join([*text, *(f"{key} {signs}" for key, signs in found.items())]) + "\n", encoding="utf-8"
    )
    print(f"{len(found)} lines to {EXPECTED}")
    for budget in ("2497rays", "2503rays"):
        other = decided("--set", f"budgets=['{budget}']")
        changed = sum(signs != found[key.replace(budget, "2500rays")] for key, signs in other.items())
        print(f"with {budget}: {changed} of {len(other)} lines differ")


def decided(*arguments: str) -> dict[str, str]:
    with tempfile.TemporaryDirectory() as folder:
        return decisions(run_smoke(Path(folder), *arguments))


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    write()
