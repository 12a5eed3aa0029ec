"""The built site: complete, at home on a disk without a network, searchable, and readable on a phone and in the dark."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import needs
import pytest
import report_kit
from report_kit import visit
from site_kit import PAGES, PROJECT

import phrt
import phrt.recording
import phrt.testing
from phrt import interfaces
from phrt.registry.manager import KINDS

FETCHED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "video": "src"}
PHONE = 400


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of the site, and what building it said."""
    for package in ("mkdocs", "material", "mkdocstrings_handlers"):
        if find_spec(package) is None:
            needs.absent(f"the site cannot be built without {package}: pip install 'phrt[docs]'")
    folder = tmp_path_factory.mktemp("documentation") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--no-strict", "--site-dir", str(folder)]
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=PROJECT, env=quiet, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return folder, done.stderr


@pytest.fixture
def site(build: tuple[Path, str]) -> Path:
    return build[0]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with report_kit.browser() as opened:
        yield opened


def built(site: Path, page: str) -> Path:
    return site / page.replace(".md", ".html")


class Fetched(HTMLParser):
    """Everything that a page makes a browser fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "link" and given.get("rel") in ("canonical", "next", "prev"):
            return
        if address := given.get(FETCHED.get(tag, "")):
            self.addresses.append(address)


def fetched(text: str) -> list[str]:
    parser = Fetched()
    parser.feed(text)
    return parser.addresses


def elsewhere(addresses: list[str]) -> list[str]:
    return [address for address in addresses if re.match(r"(https?:)?//", address)]


def test_nothing_is_wrong_that_a_strict_build_would_refuse(build: tuple[Path, str]) -> None:
    assert [line for line in build[1].splitlines() if not line.startswith("INFO ")] == []


def test_every_page_is_built(site: Path) -> None:
    assert [page for page in PAGES if not built(site, page).is_file()] == []
    assert [path.name for path in site.rglob("*.py")] == []


def test_no_page_fetches_anything_from_elsewhere(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) >= len(PAGES)
    assert {a for path in pages for a in elsewhere(fetched(path.read_text(encoding="utf-8")))} == set()
    assert [
        path.name
        for path in site.rglob("*.css")
        if re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", path.read_text())
    ] == []


def test_a_page_that_fetches_something_is_noticed() -> None:
    text = (
        '<link rel="canonical" href="https://a"><script src="//b/c.js"></script><img src="d.png"><a href="https://e">'
    )
    assert elsewhere(fetched(text)) == ["//b/c.js"]


def test_everything_that_pages_fetch_is_there(site: Path) -> None:
    missing = set()
    for path in site.rglob("*.html"):
        if path.name == "404.html":  # its addresses begin at the site's root
            continue
        for address in fetched(path.read_text(encoding="utf-8")):
            file = (path.parent / address.partition("?")[0].partition("#")[0]).resolve()
            if not address.startswith("data:") and not file.exists():
                missing.add(f"{path.name}: {address}")
    assert missing == set()


def test_every_public_name_is_in_the_python_reference(site: Path) -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in (site / "reference" / "api").glob("*.html"))
    found = set(re.findall(r'id="(phrt[\w.]*)"', text))
    errors = {
        name
        for name in phrt.__all__
        if isinstance(getattr(phrt, name), type) and issubclass(getattr(phrt, name), BaseException)
    }
    names = {f"phrt.{name}" for name in phrt.__all__ if name not in errors | {"__version__"}}
    names |= {f"phrt.testing.{name}" for name in phrt.testing.__all__}
    names |= {f"phrt.recording.{name}" for name in phrt.recording.__all__}
    for module in ("heuristic", "effect", "tracer", "gbuffer", "loader", "metric"):
        source = (Path(interfaces.__path__[0]) / f"{module}.py").read_text()
        names |= {f"phrt.interfaces.{module}.{name}" for name in re.findall(r"^class (\w+)", source, re.MULTILINE)}
    names |= {f"phrt.registry.descriptors.{each.__name__}" for each in KINDS.values()}
    assert len(names) > 40
    assert sorted(names - found) == []


@pytest.mark.parametrize("page", ["index.md", "howto/run_a_comparison.md", "options.md", "reference/api/interfaces.md"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_open_from_disk_without_a_word(chromium: Any, site: Path, page: str, scheme: str) -> None:
    with visit(chromium, built(site, page), color_scheme=scheme) as seen:
        seen.page.wait_for_load_state("load")
        assert seen.page.locator("h1").is_visible()
        assert (
            seen.page.evaluate("document.body.dataset.mdColorScheme") == {"light": "default", "dark": "slate"}[scheme]
        )
        assert seen.page.evaluate("[...document.images].filter((i) => i.naturalWidth === 0).length") == 0
        assert seen.said == []
        assert seen.asked == []


def test_the_search_finds_words_without_a_network(chromium: Any, site: Path) -> None:
    with visit(chromium, built(site, "index.md")) as seen:
        seen.page.locator("input.md-search__input").click()
        seen.page.keyboard.type("selection_graph")
        first = seen.page.locator(".md-search-result__item a").first
        first.wait_for(timeout=20_000)
        found = seen.page.locator(".md-search-result__item").all_inner_texts()
        assert any("selection_graph" in text for text in found)
        assert "heuristics.html" in " ".join(
            seen.page.locator(".md-search-result__link").evaluate_all("(links) => links.map((link) => link.href)")
        )
        assert seen.said == []
        assert seen.asked == []


@pytest.mark.parametrize("page", ["index.md", "tutorial.md", "command-line.md", "metrics.md", "explanation/paper.md"])
def test_a_phone_shows_pages_without_scrolling_sideways(chromium: Any, site: Path, page: str) -> None:
    with visit(chromium, built(site, page), width=PHONE) as seen:
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= PHONE
        size = seen.page.evaluate("parseFloat(getComputedStyle(document.querySelector('article p')).fontSize)")
        assert size >= 14


def test_nothing_of_a_page_is_left_as_markdown(site: Path) -> None:
    left = re.compile(r"^(?:<p>)?(?:- |\d+\. |\||```|#+ )", re.MULTILINE)
    for page in PAGES:
        text = built(site, page).read_text(encoding="utf-8")
        article = re.sub(r"<(pre|script|style)\b.*?</\1>", "", text, flags=re.DOTALL).partition("<article")[2]
        assert left.findall(article.partition("</article>")[0]) == [], (
            f"{page}: a list needs a blank line, and four spaces inside"
        )


def test_every_public_module_is_in_the_python_reference(site: Path) -> None:
    public = (PROJECT / "docs" / "plugins.md").read_text().partition("## What is public")[2]
    rows = re.findall(r"^\| (`phrt.*?) \|", public, re.MULTILINE)
    modules = set(re.findall(r"`(phrt[\w.]*\w)(?:\.\*)?`", "\n".join(rows))) - {"phrt", "phrt.errors"}
    assert len(modules) > 10
    found = "".join(path.read_text(encoding="utf-8") for path in (site / "reference" / "api").glob("*.html"))
    assert [module for module in sorted(modules) if f'id="{module}' not in found] == []
