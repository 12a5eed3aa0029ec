"""The page as a file: what it says, in which order, and what it never does."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from bench_kit import write_bench
from report_kit import HOSTILE

from phrt.errors import OptionError
from phrt_plugins.bench.results import BenchRun
from phrt_plugins.report import html
from phrt_plugins.report.html import content_hash, page_of, write_page
from phrt_plugins.report.ranking import rank_run
from phrt_plugins.report.report import steps_of, write_report


class Words(HTMLParser):
    """Texts and tags of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self._quiet = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._quiet = tag if tag in ("style", "script") else ""

    def handle_endtag(self, tag: str) -> None:
        self._quiet = ""

    def handle_data(self, data: str) -> None:
        if not self._quiet and data.strip():
            self.texts.append(data.strip())

    @property
    def text(self) -> str:
        return "\n".join(self.texts)


class Steps:
    """A progress bar that counts."""

    def __init__(self) -> None:
        self.done, self.said = 0, [""]

    def step(self, text: str) -> None:
        self.said.append(text)

    def advance(self) -> None:
        self.done += 1


@pytest.fixture(scope="module")
def words(page_path: Path) -> Words:
    return Words(page_path.read_text())


def test_the_verdict_is_on_top(words: Words, bench_folder: Path) -> None:
    said = rank_run(BenchRun.read(bench_folder)).verdict
    assert said in words.texts
    assert words.texts.index(said) < words.texts.index("Leaderboards")


def test_every_section_is_there(words: Words) -> None:
    titles = [
        "Leaderboards", "Error against cost", "Share of the oracle", "Frame times", "What was traced when",
        "Predicted and actual cost", "Pictures", "Worst frames", "What failed", "How it was made",
    ]  # fmt: skip
    headings = [text for text in words.texts if text in titles]
    # Once in the list of contents, then as headings (figures may be called the same).
    assert headings[:10] == titles
    assert [title for title in titles if headings.count(title) < 2] == []


def test_shares_of_the_oracle_are_there_over_the_path_and_by_frame(words: Words) -> None:
    assert "of the oracle's that traces parts" in words.text
    assert "Shares by frame under 50ms" in words.texts


def test_failures_are_named_first_and_explained_at_the_end(words: Words) -> None:
    assert f"2 of 6 cells failed: {HOSTILE} under" in words.text
    assert "ZeroDivisionError: division by zero" in words.text


def test_worst_frames_say_why(words: Words) -> None:
    assert "raster_only asked for nothing in this frame" in words.text


def test_machine_versions_and_config_are_there(words: Words) -> None:
    assert {"Machine", "Versions", "numpy", "Processor"} <= set(words.texts)
    assert '"judge_every": 2' in words.text


def test_nothing_is_asked_of_a_network(words: Words) -> None:
    for _, attributes in words.tags:
        for name in ("src", "href", "action", "srcset", "data"):
            assert (attributes.get(name) or "data:").startswith(("data:", "#"))
    assert [tag for tag, _ in words.tags if tag in ("iframe", "object", "embed", "base", "form")] == []
    assert [attributes for tag, attributes in words.tags if tag == "link"] == [{"rel": "icon", "href": "data:,"}]


def test_nothing_of_the_data_is_a_tag(words: Words, page_path: Path) -> None:
    assert not [attributes for _, attributes in words.tags if any(name.startswith("on") for name in attributes)]
    assert "<img src=x" not in page_path.read_text()
    assert [tag for tag, _ in words.tags].count("script") == 1


def test_only_our_script_may_run(words: Words) -> None:
    policy = next(a["content"] or "" for tag, a in words.tags if tag == "meta" and "http-equiv" in a)
    assert policy.startswith("default-src 'none'")
    assert f"script-src '{content_hash(html.asset('script.js'))}'" in policy


def test_ids_of_all_figures_are_unique(page_path: Path) -> None:
    ids = re.findall(r' id="([^"]+)"', page_path.read_text())
    assert len(ids) == len(set(ids))


def test_an_unfinished_run_says_so_on_top(tmp_path: Path) -> None:
    folder = write_bench(
        tmp_path / "run",
        heuristics=("gain", "raster_only"),
        budgets=("50ms",),
        unfinished="gain",
        oracle=False,
        pictures=False,
    )
    bar = Steps()
    made = write_report(BenchRun.read(folder), tmp_path / "report.html", bar)
    assert bar.done == steps_of(BenchRun.read(folder))
    assert bar.said[-1] == "writing"
    assert made.warnings[0].startswith("This comparison is still running, or was ended: 3 of 4 blocks are there.")
    found = Words((tmp_path / "report.html").read_text())
    assert found.texts.index(made.warnings[0]) < found.texts.index(made.verdict)
    assert [title for title in ("Pictures", "What failed") if title in found.texts] == []
    assert [title for title in ("Frame times", "Worst frames") if title not in found.texts] == []
    assert made.pictures == 0


def test_a_run_that_has_only_begun_gives_a_page(tmp_path: Path) -> None:
    folder = write_bench(
        tmp_path / "run",
        heuristics=("raster_only",),
        budgets=("none",),
        blocks=1,
        unfinished="raster_only",
        oracle=False,
    )
    made = write_report(BenchRun.read(folder), tmp_path / "report.html")
    assert made.verdict.startswith("Nothing can be compared")
    assert made.figures == 0
    assert "0 of 1 blocks" in made.warnings[0]


def test_what_was_there_stays_until_the_new_page_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    path.write_text("before")

    def refuse(self: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", refuse)
        with pytest.raises(OptionError, match=r"cannot write '.*report\.html': No space left on device"):
            write_page(path, "after")
    assert path.read_text() == "before"
    assert [each.name for each in tmp_path.iterdir()] == ["report.html"]
    write_page(path, "after \udcff")
    assert path.read_text() == "after ?"


def test_a_value_that_is_missing_is_an_error_of_ours() -> None:
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError):
        page_of({"title": "x"})


def test_assets_are_part_of_the_package() -> None:
    assert "@media print" in html.asset("style.css")
    assert "@media (max-width" in html.asset("style.css")
    for name in ("style.css", "script.js"):
        assert not re.search(r"https?://|@import|</script|</style", html.asset(name))
