"""Every source that the code cites by name and year has an entry in docs/references.bib."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "core/phrt", "backends/phrt_backends", "heuristics/phrt_heuristics", "plugins/phrt_plugins",
    "plugins/phrt-saliency/phrt_saliency", "plugins/phrt-caustics/phrt_caustics",
)  # fmt: skip
CITATION = re.compile(r"\b([A-Z][a-zA-Z]+)(?:-[A-Z]\w+)?(?: et al\.| and [A-Z][\w-]+)?,? ((?:19|20)\d\d)\b(?!-)")
NOT_NAMES = {"MIT", "SIGGRAPH", "Version", "Mesa", "GL", "DEM"}


def cited() -> dict[tuple[str, str], Path]:
    """(last name, year) of each citation, with a file it is in."""
    found: dict[tuple[str, str], Path] = {}
    for package in PACKAGES:
        for path in sorted((PROJECT / package).rglob("*.py")):
            for name, year in CITATION.findall(path.read_text()):
                if name not in NOT_NAMES:
                    found[name.lower(), year] = path
    return found


def entries() -> set[tuple[str, str]]:
    """(first author's last name or its first part, year) of each entry."""
    found = set()
    text = (PROJECT / "docs" / "references.bib").read_text()
    for entry in re.split(r"^@", text, flags=re.MULTILINE)[1:]:
        author = re.search(r"author = \{(.*?)\},\n", entry)
        year = re.search(r"year = \{(\d{4})\}", entry)
        assert author, entry
        assert year, entry
        plain = unicodedata.normalize("NFKD", re.sub(r"\\['\"`^~]|[{}]", "", author[1]))
        last = plain.split(",")[0].lower()
        found |= {(part, year[1]) for part in (last, *re.split(r"[-']", last))}
    return found


def test_every_citation_in_the_code_has_an_entry() -> None:
    known = entries()
    missing = {f"{name} {year} ({path.name})" for (name, year), path in cited().items() if (name, year) not in known}
    assert not missing


def test_the_code_cites_the_paper_it_implements() -> None:
    assert ("andrade", "2014") in cited()
