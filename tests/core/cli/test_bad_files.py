"""Every real bad file, through `phrt render`: a picture with warnings, or one clear error; nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from cli_kit import phrt

TESTS = Path(__file__).resolve().parents[2]
SUFFIXES = {".gltf", ".glb", ".obj", ".ply", ".stl"}
WORKERS = 2
LONGEST_S, LARGEST_MB = 10, 1024

# What leaves no right picture: data past the end of what holds it, numbers that are none, names of what is not there.
NEVER_DRAWN = {
    "ACCESSOR_INDEX_OOB",
    "ACCESSOR_INVALID_FLOAT",
    "ACCESSOR_TOO_LONG",
    "ACCESSOR_SMALL_BYTESTRIDE",
    "BUFFER_BYTE_LENGTH_MISMATCH",
    "BUFFER_MISSING_GLB_DATA",
    "BUFFER_VIEW_TOO_LONG",
    "GLB_CHUNK_TOO_BIG",
    "GLB_LENGTH_MISMATCH",
    "GLB_UNEXPECTED_END_OF_CHUNK_DATA",
    "GLB_UNEXPECTED_END_OF_CHUNK_HEADER",
    "GLB_UNEXPECTED_END_OF_HEADER",
    "INVALID_JSON",
    "MESH_PRIMITIVE_UNEQUAL_ACCESSOR_COUNT",
    "TYPE_MISMATCH",
    "UNRESOLVED_REFERENCE",
}


@dataclass(frozen=True)
class Result:
    """One file's outcome; `name` is its path below the folder of bad files, `codes` the validator's errors."""

    name: str
    code: int
    seconds: float
    said: str
    pictured: bool
    finite: bool
    codes: frozenset[str]

    @property
    def errors(self) -> list[str]:
        return [line for line in self.said.splitlines() if line.startswith("error: ")]

    @property
    def warned(self) -> bool:
        return "warning: " in self.said


@dataclass(frozen=True)
class Corpus:
    results: list[Result]
    peaks_mb: list[float]


@pytest.fixture(scope="module")
def corpus(assets: Path, tmp_path_factory: pytest.TempPathFactory) -> Corpus:
    """All bad files rendered, by worker processes with warnings as errors."""
    root = assets / "invalid"
    files = sorted(path for path in root.rglob("*") if path.suffix.lower() in SUFFIXES)
    environment = {**os.environ, "PYTHONPATH": str(TESTS)}
    environment.pop("PHRT_ASSETS", None)
    command = [sys.executable, "-W", "error", str(TESTS / "render_each.py")]
    workers = [
        subprocess.Popen(
            [*command, str(tmp_path_factory.mktemp("pictures"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for _ in range(WORKERS)
    ]
    # Small lists: they fit into the pipe, so that all workers start before any is waited for.
    for number, worker in enumerate(workers):
        assert worker.stdin is not None
        worker.stdin.write("".join(f"{path}\n" for path in files[number::WORKERS]))
        worker.stdin.close()
        worker.stdin = None
    rows = [json.loads(line) for worker in workers for line in worker.communicate(timeout=600)[0].splitlines()]
    assert [worker.returncode for worker in workers] == [0] * WORKERS
    peaks = [row["peak_mb"] for row in rows if "peak_mb" in row]
    results = [result_of(row, root) for row in rows if "path" in row]
    assert len(results) == len(files)
    return Corpus(sorted(results, key=lambda result: result.name), peaks)


def result_of(row: dict[str, object], root: Path) -> Result:
    path = Path(str(row.pop("path")))
    return Result(name=str(path.relative_to(root)), codes=frozenset(error_codes(path)), **row)  # type: ignore[arg-type]


def error_codes(path: Path) -> set[str]:
    """The errors of the validator's report beside a file; none where there is no report."""
    report = path.with_name(path.name + ".report.json")
    if not report.exists():
        return set()
    return {issue["code"] for issue in json.loads(report.read_text())["issues"]["messages"] if issue["severity"] == 0}


def test_the_corpus_is_there(corpus: Corpus) -> None:
    assert len(corpus.results) > 200
    assert {Path(result.name).suffix.lower() for result in corpus.results} == SUFFIXES
    assert sum(result.code == 2 for result in corpus.results) > 90
    assert sum(result.code == 0 for result in corpus.results) > 90
    assert sum(bool(result.codes & NEVER_DRAWN) for result in corpus.results) > 25


def test_a_file_is_a_picture_or_an_error_never_a_crash(corpus: Corpus) -> None:
    assert {result.name: result.said for result in corpus.results if result.code not in (0, 2)} == {}
    assert [result.name for result in corpus.results if "Traceback" in result.said] == []
    assert [result.name for result in corpus.results if result.pictured != (result.code == 0)] == []


def test_an_error_is_one_line_with_file_and_reason(corpus: Corpus) -> None:
    for result in corpus.results:
        if result.code == 2:
            assert len(result.errors) == 1, result.said
            assert Path(result.name).name in result.errors[0]
            reason = result.errors[0].partition(Path(result.name).name)[2]
            assert len(reason.strip(" :,")) >= len("is empty"), result.said


def test_no_picture_holds_a_nan(corpus: Corpus) -> None:
    assert [result.name for result in corpus.results if not result.finite] == []


def test_nothing_hangs_or_fills_the_memory(corpus: Corpus) -> None:
    assert {result.name: result.seconds for result in corpus.results if result.seconds > LONGEST_S} == {}
    assert len(corpus.peaks_mb) == WORKERS
    assert max(corpus.peaks_mb) < LARGEST_MB


def test_data_past_its_end_is_never_drawn(corpus: Corpus) -> None:
    assert {
        result.name: result.codes for result in corpus.results if result.code == 0 and result.codes & NEVER_DRAWN
    } == {}


def test_what_the_validator_calls_wrong_is_never_silent(corpus: Corpus) -> None:
    assert [result.name for result in corpus.results if result.codes and result.code == 0 and not result.warned] == []


def test_a_file_that_is_cut_off_says_so(corpus: Corpus) -> None:
    (result,) = [result for result in corpus.results if result.name == "truncated/sponza_crytek_truncated.obj"]
    assert result.code == 0
    assert "the file is cut off, the picture lacks the rest" in result.said


@pytest.mark.parametrize("name", ["assimp/invalid/OutOfMemory.off", "assimp/invalid/readme.txt", "assimp/LICENSE"])
def test_other_files_are_told_what_can_be_read(assets: Path, tmp_path: Path, name: str) -> None:
    done = phrt("render", str(assets / "invalid" / name), "-o", str(tmp_path / "x.png"))
    assert done.code == 2
    suffix = Path(name).suffix
    allowed = ".glb, .gltf, .obj, .ply, .stl, .yaml, .yml, .json"
    assert done.errors == [f"error: {assets / 'invalid' / name}: no loader reads '{suffix}' files; read are: {allowed}"]
