"""A made-up comparison and its page, made once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import report_kit
from bench_kit import write_bench

from phrt_plugins.bench.results import BenchRun
from phrt_plugins.report.report import write_report


@pytest.fixture(scope="session")
def bench_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three contestants under two budgets; one of them failed, and its label and the title are hostile."""
    folder = write_bench(tmp_path_factory.mktemp("report") / "run", failed="selection_graph")
    return report_kit.renamed(folder, "selection_graph", report_kit.HOSTILE, title=f"Made up {report_kit.HOSTILE}")


@pytest.fixture(scope="session")
def page_path(bench_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of `bench_folder`."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(BenchRun.read(bench_folder), path)
    return path


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    with report_kit.browser() as opened:
        yield opened
