"""The pages say what the code says: generated tables are current, channels, options and names are there, links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import generate
import pytest

import phrt
from phrt import errors
from phrt.channels import CHANNELS
from phrt.frame import FrameResult
from phrt.registry import get_registry

PROJECT = Path(__file__).resolve().parents[2]
DOCS = PROJECT / "docs"
PAGES = [PROJECT / "README.md", PROJECT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
EVERYTHING = "\n".join(page.read_text() for page in PAGES)
LINK = re.compile(r"\]\(([^)\s]+)\)")
LARGEST_PICTURE_BYTES = 1_000_000


def section(page: str, heading: str) -> str:
    """The text below `heading` up to the next heading."""
    _, found, rest = page.partition(f"\n{heading}\n")
    return re.split(r"^#+ ", rest, maxsplit=1, flags=re.MULTILINE)[0] if found else ""


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and the site make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def broken_links(page: Path, text: str) -> list[str]:
    """The relative links in `text` that lead to no file, or to no heading of a page."""
    broken = []
    for link in LINK.findall(text):
        if link.startswith(("http:", "https:", "mailto:")):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    return broken


@pytest.mark.parametrize("name", generate.PAGES)
def test_generated_tables_are_current(name: str) -> None:
    text = (DOCS / name).read_text()
    assert "<!-- generated: " in text
    assert generate.refreshed(text) == text, "run: .venv/bin/python docs/generate.py"


def test_a_stale_table_is_noticed() -> None:
    text = (DOCS / "gbuffer.md").read_text()
    stale = text.replace("| `depth` |", "| `deep` |")
    assert stale != text
    assert generate.refreshed(stale) == text


def test_every_channel_is_documented() -> None:
    page = (DOCS / "gbuffer.md").read_text()
    assert [
        name for name, c in CHANNELS.items() if not re.search(rf"^\| `{name}` \|.*{re.escape(c.meaning)}", page, re.M)
    ] == []


def test_every_layer_is_documented() -> None:
    page = section((DOCS / "gbuffer.md").read_text(), "## Layers")
    names = [generate.import_factory(entry.name, entry).writes.name for entry in generate.built_in("effect")]
    assert len(names) >= 4
    assert [name for name in names if f"| `{name}` |" not in page] == []


def test_every_plugin_and_option_is_documented() -> None:
    page = (DOCS / "options.md").read_text()
    missing = []
    for entry in get_registry().plugins():
        if entry.origin != "built-in":
            continue
        text = section(page, f"### {entry.kind} `{entry.name}`")
        wanted = [entry.plugin.summary, *(f"| `{name}` |" for name in entry.plugin.options.model_fields)]
        missing += [f"{entry.kind} {entry.name}: {each}" for each in wanted if each not in text]
    assert missing == []


def test_every_option_says_what_it_means() -> None:
    bare = [
        f"{entry.name}.{name}"
        for entry in get_registry().plugins()
        for name, field in entry.plugin.options.model_fields.items()
        if not field.description
    ]
    assert bare == []


def test_every_error_is_documented_with_its_base_and_meaning() -> None:
    page = (DOCS / "reference" / "errors.md").read_text()
    classes = [e for e in vars(errors).values() if isinstance(e, type) and issubclass(e, BaseException)]
    assert len(classes) >= 7
    for each in classes:
        row = f"| `{each.__name__}` | `{each.__base__.__name__}` | {str(each.__doc__).split('.')[0]}"
        assert row in page


def test_every_public_name_is_documented() -> None:
    assert [name for name in phrt.__all__ if not re.search(rf"\b{name}\b", EVERYTHING)] == []


def test_every_field_of_a_frame_is_documented() -> None:
    names = [name for name in FrameResult.__dataclass_fields__ if name not in ("index", "time")]
    assert [name for name in names if f"frame.{name}" not in EVERYTHING] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(PROJECT)))
def test_links_lead_somewhere(page: Path) -> None:
    assert broken_links(page, page.read_text()) == []


def test_a_broken_link_is_noticed() -> None:
    readme = PROJECT / "README.md"
    text = "[a](docs/nothing.md) [b](docs/gbuffer.md#layers) [c](docs/gbuffer.md#nothing) [d](https://example.org)"
    assert broken_links(readme, text) == ["docs/nothing.md", "docs/gbuffer.md#nothing"]


def roots(page: Path) -> list[Path]:
    """Where the files lie that a page names: in the project, or in the package that it is about."""
    return [PROJECT, *([PROJECT / "plugins" / f"phrt-{page.stem}"] if page.parent.name == "packages" else [])]


def test_files_that_pages_name_exist() -> None:
    pattern = re.compile(r"`((?:core|backends|heuristics|plugins|scenes|tests|docs|benchmarks|scripts)/[\w./-]+)`")
    named = {(page, path) for page in PAGES for path in pattern.findall(page.read_text())}
    assert len(named) > 20
    missing = [(page, path) for page, path in named if not any((root / path).exists() for root in roots(page))]
    assert sorted(f"{page.name}: {path}" for page, path in missing) == []


def test_pictures_are_small() -> None:
    pictures = [path for path in (DOCS / "images").iterdir() if path.is_file()]
    assert pictures
    assert [path.name for path in pictures if path.stat().st_size > LARGEST_PICTURE_BYTES] == []
