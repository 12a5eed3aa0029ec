"""A made-up comparison and its page, made once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import report_kit
from bench_kit import write_bench
from cli_kit import Outcome, phrt


@pytest.fixture(scope="session")
def bench_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three contestants under two budgets; one of them failed, and its label and the title are hostile."""
    folder = write_bench(tmp_path_factory.mktemp("report") / "run", failed="selection_graph")
    return report_kit.renamed(folder, "selection_graph", report_kit.HOSTILE, title=f"Made up {report_kit.HOSTILE}")


@pytest.fixture(scope="session")
def reported(bench_folder: Path) -> Outcome:
    """What the command said when it wrote the report of `bench_folder`."""
    return phrt("report", str(bench_folder), "--json")


@pytest.fixture(scope="session")
def page_path(reported: Outcome, bench_folder: Path) -> Path:
    """The report of `bench_folder`."""
    assert reported.code == 0, reported.said
    return bench_folder / "report.html"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A browser; closed with the module, as other tests cannot run an event loop beside playwright's."""
    with report_kit.browser() as opened:
        yield opened
