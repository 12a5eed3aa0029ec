"""`phrt report` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_kit import Outcome, phrt


def test_it_writes_a_page_beside_the_run(bench_folder: Path, reported: Outcome) -> None:
    target = bench_folder / "report.html"
    assert (reported.code, reported.errors) == (0, [])
    said = json.loads(reported.printed)
    assert said["file"] == str(target)
    assert said["bytes"] == target.stat().st_size
    assert said["cells"] == 6
    assert said["figures"] >= 7
    assert said["pictures"] > 20
    assert said["verdict"].startswith("gain ")
    assert "cells failed" in said["notes"][0]


@pytest.mark.parametrize(("form", "sign"), [("markdown", "| --:"), ("latex", r"\toprule")])
def test_tables_for_a_text(bench_folder: Path, tmp_path: Path, form: str, sign: str) -> None:
    printed = phrt("report", str(bench_folder), "--tables", form)
    assert printed.code == 0
    assert sign in printed.printed
    assert "gain" in printed.printed
    target = tmp_path / ("tables.tex" if form == "latex" else "tables.md")
    written = phrt("report", str(bench_folder), "--tables", form, "-o", str(target))
    assert (written.code, written.printed) == (0, "")
    assert target.read_text().strip() == printed.printed.strip()


def test_no_folder_of_a_comparison_is_a_clear_error(tmp_path: Path) -> None:
    for folder, why in ((tmp_path, "there is no bench.json in it"), (tmp_path / "none", "there is no such folder")):
        done = phrt("report", str(folder))
        assert done.code == 2
        assert done.errors == [f"error: '{folder}' is no folder of phrt bench: {why}"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-o", "{tmp}/report.pdf"], "'.pdf' is not one of .html, .htm"),
        (["-o", "{tmp}/none/report.html"], "does not exist"),
        (["--tables", "latex", "-o", "{tmp}/x.html"], "'.html' is not one of .tex, .txt"),
        (["--tables", "word"], "'word' is not one of 'markdown', 'latex'"),
    ],
)
def test_what_cannot_be_written_is_said_before_work(
    bench_folder: Path, tmp_path: Path, arguments: list[str], said: str
) -> None:
    done = phrt("report", str(bench_folder), *(argument.format(tmp=tmp_path) for argument in arguments))
    assert done.code == 2
    assert said in " ".join(done.said.split())
    assert list(tmp_path.iterdir()) == []
