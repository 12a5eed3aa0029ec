"""What the documentation's site is made of, read without building it: its pages and mkdocs.yml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

PROJECT = Path(__file__).resolve().parents[1]
DOCS = PROJECT / "docs"
PAGES = sorted(str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md"))


class Loader(yaml.SafeLoader):
    """Of mkdocs.yml, in which a function is named."""


Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda loader, suffix, node: suffix)
CONFIG: dict[str, Any] = yaml.load((PROJECT / "mkdocs.yml").read_text(), Loader)


def pages_of(nav: Any) -> list[str]:
    """The pages of a part of the navigation, in order."""
    if isinstance(nav, str):
        return [nav]
    return [page for entry in (nav.values() if isinstance(nav, dict) else nav) for page in pages_of(entry)]


def part(title: str) -> list[str]:
    """The pages of one of its four parts."""
    return next(pages_of(entry[title]) for entry in CONFIG["nav"] if title in entry)
