"""The site's contents, without building it: every page has one place, and no link leads out of the documentation."""

from __future__ import annotations

import re

import pytest
from site_kit import CONFIG, DOCS, PAGES, pages_of, part

LINK = re.compile(r"\]\(([^)\s]+)\)")


def leading_out(page: str, text: str) -> list[str]:
    """Links of a page that are no pages, pictures or files of the documentation."""
    links = [link.partition("#")[0] for link in LINK.findall(text)]
    files = [link for link in links if link and not link.startswith(("http:", "https:", "mailto:"))]
    return [f for f in files if not (DOCS / page).parent.joinpath(f).resolve().is_relative_to(DOCS) or f.endswith("/")]


def test_every_page_has_one_place_in_the_navigation() -> None:
    listed = pages_of(CONFIG["nav"])
    assert sorted(set(PAGES) - set(listed)) == [], "add them to nav in mkdocs.yml"
    assert sorted(listed) == PAGES


def test_the_four_kinds_of_documentation_are_there() -> None:
    assert [next(iter(entry)) for entry in CONFIG["nav"]] == [
        "PHRT", "Tutorial", "How-to guides", "Reference", "Explanation",
    ]  # fmt: skip
    assert {"command-line.md", "options.md", "gbuffer.md", "metrics.md", "scene_format.md"} <= set(part("Reference"))
    assert {"explanation/paper.md", "design.md", "results.md"} <= set(part("Explanation"))
    assert {f"howto/{path.name}" for path in (DOCS / "howto").iterdir()} <= set(part("How-to guides"))


@pytest.mark.parametrize("page", PAGES)
def test_no_link_leads_out_of_the_site(page: str) -> None:
    assert leading_out(page, (DOCS / page).read_text()) == []


def test_a_link_that_leads_out_is_noticed() -> None:
    text = "[a](../README.md) [b](loaders/) [c](design.md#light) [d](https://example.org) [e](#here)"
    assert leading_out("index.md", text) == ["../README.md", "loaders/"]


@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_one_title_and_no_heading_twice(page: str) -> None:
    text = re.sub(r"^```.*?^```", "", (DOCS / page).read_text(), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    assert len(re.findall(r"^# ", text, re.MULTILINE)) == 1
    assert sorted({each for each in headings if headings.count(each) > 1}) == []


def test_the_config_asks_for_nothing_from_the_network() -> None:
    assert CONFIG["theme"]["font"] is False
    assert "repo_url" not in CONFIG
    assert "analytics" not in CONFIG.get("extra", {})
    assert "offline" in CONFIG["plugins"]
    assert CONFIG["strict"] is True
